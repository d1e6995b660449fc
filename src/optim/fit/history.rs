use std::fmt::Write;

use crate::error::{Error, Result};
use crate::figure::{Figure, Plot};

/// A step of a fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Counted from 0.
    pub step: usize,
    /// The loss before the step.
    pub loss: f64,
    /// The Euclidean norm of the gradient over all parameters, before it was clipped.
    pub gradient_norm: f64,
    /// The learning rate.
    pub rate: f64,
    /// The blur, if it had a schedule: radians, or σ in scene units squared.
    pub blur: Option<f64>,
    /// Seconds since the fit began, without those that a killed run had taken since its last
    /// checkpoint.
    pub seconds: f64,
    /// The numbers of the evaluation, named by [`History::names`].
    pub values: Vec<f64>,
}

/// The steps of a fit, in their order.
#[derive(Clone, Default, PartialEq)]
pub struct History {
    /// The names of the evaluations' numbers.
    pub names: Vec<String>,
    /// The steps.
    pub rows: Vec<Row>,
}

const COLUMNS: [&str; 6] = ["step", "loss", "gradient_norm", "rate", "blur", "seconds"];

impl History {
    /// A number over the steps, as points (step, value): a number of the evaluations, or `loss`,
    /// `gradient_norm`, `rate`, `blur` or `seconds`. It is empty for any other name.
    pub fn curve(&self, name: &str) -> Vec<(f64, f64)> {
        let place = self.names.iter().position(|n| n == name);
        let value = |r: &Row| match (name, place) {
            (_, Some(k)) => r.values.get(k).copied(),
            ("loss", _) => Some(r.loss),
            ("gradient_norm", _) => Some(r.gradient_norm),
            ("rate", _) => Some(r.rate),
            ("blur", _) => r.blur,
            ("seconds", _) => Some(r.seconds),
            _ => None,
        };
        let point = |r: &Row| Some((r.step as f64, value(r)?));
        self.rows.iter().filter_map(point).collect()
    }

    /// Numbers over the steps, as curves of a plot; for the names see [`History::curve`].
    ///
    /// # Errors
    /// If there are no numbers of a name.
    pub fn plot(&self, title: impl Into<String>, names: &[&str]) -> Result<Plot> {
        let known = |name: &str| COLUMNS.contains(&name) || self.names.iter().any(|n| n == name);
        if let Some(bad) = names.iter().find(|name| !known(name)) {
            return Err(Error::invalid(
                "history",
                "name of a curve",
                format!("{bad:?}"),
                format!("one of {:?} or {:?}", &COLUMNS[1..], self.names),
            ));
        }
        let plot = Plot::new(title, "step", "");
        // A single curve is named by the title.
        Ok(names.iter().fold(plot, |plot, &name| {
            let label = if names.len() > 1 { name } else { "" };
            plot.curve(label, self.curve(name))
        }))
    }

    /// The magnitude of the loss over the steps, on a logarithmic axis: losses that are free of bias
    /// may be negative.
    pub fn loss_plot(&self) -> Plot {
        let points = self.curve("loss").into_iter();
        let points = points.map(|(step, loss)| (step, loss.abs()));
        Plot::new("|loss|", "step", "").log().curve("", points)
    }

    /// Plots of the loss, the gradient's norm, and the blur if it had a schedule, on logarithmic axes.
    pub fn figure(&self) -> Figure {
        let over_steps = |title: &str, name: &str| {
            let plot = Plot::new(title, "step", "").log();
            plot.curve("", self.curve(name))
        };
        let figure = Figure::new("").plot(self.loss_plot());
        let figure = figure.plot(over_steps("norm of the gradient", "gradient_norm"));
        if self.curve("blur").is_empty() {
            return figure;
        }
        figure.plot(over_steps("blur", "blur"))
    }

    pub(super) fn push(&mut self, values: Vec<(String, f64)>, mut row: Row) -> Result<()> {
        let names: Vec<String> = values.iter().map(|v| v.0.clone()).collect();
        if self.rows.is_empty() {
            if let Some(bad) = names
                .iter()
                .find(|n| n.is_empty() || n.contains(['"', ',', '\n', '\r']))
            {
                return Err(Error::invalid(
                    "fit",
                    "name of a value",
                    format!("{bad:?}"),
                    "a name without quotes, commas and line breaks",
                ));
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
        row.values = values.into_iter().map(|v| v.1).collect();
        self.rows.push(row);
        Ok(())
    }

    /// Whether after the last row the mean of the loss over the last steps is not 2 % less than over as
    /// many before, all with the same blur, and the last time that was so is long enough ago.
    pub(super) fn is_flat(&self, window: usize, last: Option<usize>) -> bool {
        flat(&self.rows, window, last)
    }

    /// The steps at which [`History::is_flat`] held.
    pub(super) fn plateaus(&self, window: usize) -> Vec<usize> {
        let mut found = Vec::new();
        for n in 1..=self.rows.len() {
            if flat(&self.rows[..n], window, found.last().copied()) {
                found.push(n - 1);
            }
        }
        found
    }

    /// Writes comma-separated values below a line of names; numbers read back exactly.
    pub fn to_csv(&self) -> String {
        let mut text = COLUMNS.map(String::from).to_vec();
        text.extend(self.names.iter().cloned());
        let mut text = text.join(",") + "\n";
        let optional = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
        for r in &self.rows {
            let blur = optional(r.blur);
            // Writing to a string can't fail.
            let _ = write!(
                text,
                "{},{},{},{},{blur},{}",
                r.step, r.loss, r.gradient_norm, r.rate, r.seconds
            );
            for value in &r.values {
                let _ = write!(text, ",{value}");
            }
            text.push('\n');
        }
        text
    }

    /// Reads the text of [`History::to_csv`]; the error is the line at fault.
    pub(super) fn from_csv(text: &str) -> std::result::Result<Self, String> {
        let mut lines = text.lines();
        let head: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
        if !head.starts_with(&COLUMNS) {
            return Err(format!(
                "its columns are {head:?}, expected {COLUMNS:?} first"
            ));
        }
        let names: Vec<String> = head[COLUMNS.len()..]
            .iter()
            .map(|n| n.to_string())
            .collect();
        let row = |line: &str| -> Option<Row> {
            let cells: Vec<&str> = line.split(',').collect();
            if cells.len() != head.len() {
                return None;
            }
            let number = |k: usize| cells[k].parse::<f64>().ok();
            let optional = |k: usize| match cells[k] {
                "" => Some(None),
                cell => cell.parse().ok().map(Some),
            };
            Some(Row {
                step: cells[0].parse().ok()?,
                loss: number(1)?,
                gradient_norm: number(2)?,
                rate: number(3)?,
                blur: optional(4)?,
                seconds: number(5)?,
                values: (COLUMNS.len()..cells.len())
                    .map(number)
                    .collect::<Option<_>>()?,
            })
        };
        let rows = lines
            .map(|line| row(line).ok_or_else(|| format!("a malformed line: {line:?}")))
            .collect::<std::result::Result<_, _>>()?;
        Ok(Self { names, rows })
    }
}

fn flat(rows: &[Row], window: usize, last: Option<usize>) -> bool {
    let Some(first) = rows.len().checked_sub(2 * window) else {
        return false;
    };
    if last.is_some_and(|last| rows.len() <= last + window) {
        return false;
    }
    let rows = &rows[first..];
    let same = rows.iter().all(|r| r.blur == rows[0].blur);
    let mean = |rows: &[Row]| rows.iter().map(|r| r.loss).sum::<f64>() / window as f64;
    let (before, after) = (mean(&rows[..window]), mean(&rows[window..]));
    same && after > before - 0.02 * before.abs()
}
