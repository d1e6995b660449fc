//! Derivatives by both methods, and their report.

use std::fmt;

/// A mean over seeds with its standard error.
///
/// [`gradcheck`](super::gradcheck) has an example.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    /// The mean.
    pub mean: f64,
    /// The standard error of the mean.
    pub error: f64,
    /// The number of seeds.
    pub seeds: u64,
}

impl Estimate {
    /// From the values of all seeds. Two seeds, of opposite points, make one independent number.
    pub(super) fn of(by_seed: &[f64]) -> Self {
        let pairs = by_seed.chunks_exact(2);
        let values: Vec<f64> = pairs.map(|pair| (pair[0] + pair[1]) / 2.0).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        Self {
            mean,
            error: (squares / (n - 1.0) / n).sqrt(),
            seeds: by_seed.len() as u64,
        }
    }
}

/// The outcome of a comparison.
///
/// [`gradcheck`](super::gradcheck) has an example.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The comparison is precise, and no disagreement is significant.
    Agrees,
    /// The difference exceeds both 3.5 standard errors (more for few seeds) and the tolerance.
    Disagrees,
    /// No disagreement is significant, but the seeds ran out before the standard error was small enough.
    Undecided,
}

/// One derivative by both methods.
///
/// [`gradcheck`](super::gradcheck) has an example.
#[derive(Clone, Debug)]
pub struct Row {
    /// The parameter's name, with the component's index if it has several.
    pub parameter: String,
    /// The derivative by autodiff, in the mean over the box of all steps.
    pub gradient: Estimate,
    /// The derivative by central differences, over the whole width of the box.
    pub difference: Estimate,
    /// gradient − difference. Its standard error is smaller than both others if they share noise.
    pub apart: Estimate,
    /// The outcome of the comparison.
    pub verdict: Verdict,
}

impl Row {
    /// Returns gradient/difference − 1.
    pub fn relative(&self) -> f64 {
        self.gradient.mean / self.difference.mean - 1.0
    }

    /// Returns |gradient − difference| in standard errors.
    fn standard_errors(&self) -> f64 {
        let Estimate { mean, error, .. } = self.apart;
        if mean == 0.0 { 0.0 } else { mean.abs() / error }
    }
}

/// The result of [`gradcheck`](super::gradcheck). It prints as a table.
///
/// [`gradcheck`](super::gradcheck) has an example.
#[derive(Clone, Debug)]
pub struct Report {
    /// The rows, one for each derivative.
    pub rows: Vec<Row>,
}

impl Report {
    /// Whether every row agrees.
    pub fn agrees(&self) -> bool {
        self.rows.iter().all(|r| r.verdict == Verdict::Agrees)
    }

    /// Returns the mean of |g/d − 1| over the rows, where g is the autodiff derivative ([`Row::gradient`]) and d is the
    /// central difference ([`Row::difference`]). Rows with d = 0 are left out.
    pub fn mean_relative_error(&self) -> f64 {
        let rows = self.rows.iter().filter(|r| r.difference.mean != 0.0);
        let errors: Vec<f64> = rows.map(|r| r.relative().abs()).collect();
        errors.iter().sum::<f64>() / errors.len().max(1) as f64
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.rows.iter().map(|r| r.parameter.chars().count());
        let width = width.max().unwrap_or(0).max(9);
        writeln!(
            f,
            "{:width$}  {:>24}  {:>24}  {:>9}  {:>6}  {:>6}  verdict",
            "parameter", "gradient", "difference", "relative", "errors", "seeds"
        )?;
        for r in &self.rows {
            let side = |e: &Estimate| format!("{:.5e} ± {:.1e}", e.mean, e.error);
            writeln!(
                f,
                "{:width$}  {:>24}  {:>24}  {:>+8.2} %  {:>6.1}  {:>6}  {}",
                r.parameter,
                side(&r.gradient),
                side(&r.difference),
                100.0 * r.relative(),
                r.standard_errors(),
                r.apart.seeds,
                match r.verdict {
                    Verdict::Agrees => "agrees",
                    Verdict::Disagrees => "DISAGREES",
                    Verdict::Undecided => "undecided: budget spent",
                }
            )?;
        }
        Ok(())
    }
}
