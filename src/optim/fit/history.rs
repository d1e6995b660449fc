use std::fmt;

use crate::error::{Error, Result};
use crate::figure::{Figure, Plot};
use crate::optim::schedule::{TOLERANCE, stopped_falling};

/// The record of a step of a fit.
///
/// [`Fit`](super::Fit) has an example.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The step number, counted from 0.
    pub step: usize,
    /// The loss before the step.
    pub loss: f64,
    /// The Euclidean norm of the gradient over all parameters, before clipping.
    pub gradient_norm: f64,
    /// The learning rate.
    pub rate: f64,
    /// The blur, if the fit has a blur schedule: in degrees for cones, σ for the softmax.
    pub blur: Option<f64>,
    /// Seconds of the fit so far. Time that a killed run spent after its last checkpoint does not count.
    pub seconds: f64,
    /// The values of the evaluation, named by [`History::names`].
    pub values: Vec<f64>,
}

/// The steps of a fit, in order.
///
/// [`Fit`](super::Fit) has an example.
#[derive(Clone, Default, PartialEq)]
pub struct History {
    /// The names of the evaluations' values.
    pub names: Vec<String>,
    /// One row per step.
    pub rows: Vec<Row>,
}

type Column = (&'static str, fn(&Row) -> Option<f64>);

const COLUMNS: [Column; 6] = [
    ("step", |r| Some(r.step as f64)),
    ("loss", |r| Some(r.loss)),
    ("gradient_norm", |r| Some(r.gradient_norm)),
    ("rate", |r| Some(r.rate)),
    ("blur", |r| r.blur),
    ("seconds", |r| Some(r.seconds)),
];

impl fmt::Debug for History {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut all = f.debug_struct("History");
        all.field("steps", &self.rows.len());
        if let (Some(first), Some(last)) = (self.rows.first(), self.rows.last()) {
            all.field("first_loss", &first.loss)
                .field("last_loss", &last.loss)
                .field("seconds", &last.seconds);
        }
        if !self.names.is_empty() {
            all.field("names", &self.names);
        }
        all.finish_non_exhaustive()
    }
}

impl History {
    /// Returns a value over the steps, as points (step, value). The name is that of an evaluation's value, or
    /// `loss`, `gradient_norm`, `rate`, `blur` or `seconds`. For any other name the result is empty.
    pub fn curve(&self, name: &str) -> Vec<(f64, f64)> {
        let place = self.names.iter().position(|n| n == name);
        let column = COLUMNS.iter().find(|c| c.0 == name);
        let value = |r: &Row| match place {
            Some(k) => r.values.get(k).copied(),
            None => column.and_then(|c| c.1(r)),
        };
        let point = |r: &Row| Some((r.step as f64, value(r)?));
        self.rows.iter().filter_map(point).collect()
    }

    /// Plots values over the steps as curves; the names are those of [`History::curve`].
    ///
    /// # Errors
    /// If a name is unknown.
    pub fn plot(&self, title: impl Into<String>, names: &[&str]) -> Result<Plot> {
        let columns = COLUMNS.map(|c| c.0);
        let known = |name: &str| columns.contains(&name) || self.names.iter().any(|n| n == name);
        if let Some(bad) = names.iter().find(|name| !known(name)) {
            return Err(Error::invalid(
                "history",
                "name of a curve",
                format!("{bad:?}"),
                format!("one of {:?} or {:?}", &columns[1..], self.names),
            ));
        }
        let plot = Plot::new(title, "step", "");
        // The title names a single curve.
        Ok(names.iter().fold(plot, |plot, &name| {
            let label = if names.len() > 1 { name } else { "" };
            plot.with_curve(label, self.curve(name))
        }))
    }

    /// Plots the magnitude of the loss over the steps, on a logarithmic axis; unbiased losses may be negative.
    pub fn loss_plot(&self) -> Plot {
        let points = self.curve("loss").into_iter();
        let points = points.map(|(step, loss)| (step, loss.abs()));
        Plot::new("|loss|", "step", "")
            .with_log_scale()
            .with_curve("", points)
    }

    /// Plots the loss, the gradient's norm and, if the fit has a schedule for it, the blur, on logarithmic
    /// axes.
    pub fn figure(&self) -> Figure {
        let over_steps = |title: &str, name: &str| {
            let plot = Plot::new(title, "step", "").with_log_scale();
            plot.with_curve("", self.curve(name))
        };
        let figure = Figure::new("").with_plot(self.loss_plot());
        let figure = figure.with_plot(over_steps("norm of the gradient", "gradient_norm"));
        if self.curve("blur").is_empty() {
            return figure;
        }
        figure.with_plot(over_steps("blur", "blur"))
    }

    /// The means of the evaluations' values over the last steps.
    pub(super) fn recent(&self, steps: usize) -> Vec<(&str, f64)> {
        let rows = &self.rows[self.rows.len().saturating_sub(steps)..];
        let mean = |k: usize| rows.iter().map(|r| r.values[k]).sum::<f64>() / rows.len() as f64;
        let names = self.names.iter().enumerate();
        names.map(|(k, name)| (name.as_str(), mean(k))).collect()
    }

    /// Adds a step with the values of its evaluation.
    pub(super) fn push(&mut self, values: Vec<(String, f64)>, mut row: Row) -> Result<()> {
        let (names, values): (Vec<String>, _) = values.into_iter().unzip();
        if self.rows.is_empty() {
            let bad = |n: &&String| n.is_empty() || n.contains(['"', ',', '\n', '\r']);
            if let Some(bad) = names.iter().find(bad) {
                let expected = "a name without quotes, commas and line breaks";
                let bad = format!("{bad:?}");
                return Err(Error::invalid("fit", "name of a value", bad, expected));
            }
            self.names = names;
        } else if self.names != names {
            return Err(Error::invalid(
                "fit",
                format!("values of step {}", row.step),
                format!("{names:?}"),
                format!("{:?} like at the steps before", self.names),
            ));
        }
        row.values = values;
        self.rows.push(row);
        Ok(())
    }

    /// Returns whether after `steps` steps the loss has stopped falling over the last `window` steps. The blur
    /// must be constant over 2·`window` steps, and the last plateau must be at least `window` steps ago.
    pub(super) fn is_flat(&self, steps: usize, window: usize, last: Option<usize>) -> bool {
        let Some(first) = steps.checked_sub(2 * window) else {
            return false;
        };
        let rows = &self.rows[first..steps];
        let losses: Vec<f64> = rows.iter().map(|r| r.loss).collect();
        last.is_none_or(|last| steps > last + window)
            && rows.iter().all(|r| r.blur == rows[0].blur)
            && stopped_falling(&losses, TOLERANCE)
    }

    /// Returns the steps at which [`History::is_flat`] holds.
    pub(super) fn plateaus(&self, window: usize) -> Vec<usize> {
        let mut found = Vec::new();
        for n in 1..=self.rows.len() {
            if self.is_flat(n, window, found.last().copied()) {
                found.push(n - 1);
            }
        }
        found
    }

    /// Returns the history as comma-separated values below a line of names. The numbers can be read back
    /// exactly.
    pub fn to_csv(&self) -> String {
        let names = COLUMNS.iter().map(|c| c.0);
        let names = names.chain(self.names.iter().map(String::as_str));
        let mut text = names.collect::<Vec<_>>().join(",") + "\n";
        for r in &self.rows {
            let values = r.values.iter().copied().map(Some);
            let cells = COLUMNS.iter().map(|c| c.1(r)).chain(values);
            let cells = cells.map(|v| v.map_or(String::new(), |v| v.to_string()));
            text += &(cells.collect::<Vec<_>>().join(",") + "\n");
        }
        text
    }

    /// Reads the text of [`History::to_csv`]. The error describes the malformed line.
    pub(super) fn from_csv(text: &str) -> Result<Self, String> {
        let mut lines = text.lines();
        let head: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
        let columns = COLUMNS.map(|c| c.0);
        let Some(names) = head.strip_prefix(&columns) else {
            return Err(format!(
                "its columns are {head:?}, expected {columns:?} first"
            ));
        };
        let row = |line: &str| -> Option<Row> {
            let cell = |cell: &str| match cell {
                "" => Some(None),
                cell => cell.parse::<f64>().ok().map(Some),
            };
            let cells: Vec<_> = line.split(',').map(cell).collect::<Option<_>>()?;
            let [
                step,
                loss,
                gradient_norm,
                rate,
                blur,
                seconds,
                ref values @ ..,
            ] = cells[..]
            else {
                return None;
            };
            (values.len() == names.len()).then_some(())?;
            Some(Row {
                step: step? as usize,
                loss: loss?,
                gradient_norm: gradient_norm?,
                rate: rate?,
                blur,
                seconds: seconds?,
                values: values.iter().copied().collect::<Option<_>>()?,
            })
        };
        let rows = lines.map(|line| row(line).ok_or_else(|| format!("a malformed line: {line:?}")));
        Ok(Self {
            names: names.iter().map(|n| n.to_string()).collect(),
            rows: rows.collect::<Result<_, _>>()?,
        })
    }
}
