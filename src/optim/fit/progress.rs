//! The display of a running fit: a bar on a terminal, otherwise lines at intervals.

use std::io::Write;

use indicatif::{ProgressBar, ProgressStyle};
use web_time::{Duration, Instant};

use super::{History, Row, Stop, Warning};
use softray_kernels::warnings::warn;

/// The least time between lines.
const PAUSE: Duration = Duration::from_secs(10);
/// The number of steps of whose values the mean is shown.
const WINDOW: usize = 10;
const TEMPLATE: &str = "fitting {bar:40} {pos}/{len} [{elapsed} < {eta}] {msg}";

pub(super) struct Progress {
    shown: Shown,
    steps: usize,
    /// Steps taken before this run began, and the time at which it began.
    before: usize,
    start: Instant,
    /// The last step of this run.
    latest: Option<Latest>,
    pub warnings: Vec<Warning>,
}

enum Shown {
    Nothing,
    Bar(ProgressBar),
    /// Lines on the standard error: the time of the last line, and the number of steps taken by then.
    Lines(Option<(Instant, usize)>),
}

/// The last step that was taken.
struct Latest {
    done: usize,
    /// The loss, the blur and the evaluation's values.
    state: String,
}

impl Progress {
    pub fn new(shown: bool, steps: usize) -> Self {
        let style = ProgressStyle::with_template(TEMPLATE);
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
        let bar = ProgressBar::new(steps as u64).with_style(style);
        let shown = match (shown, bar.is_hidden()) {
            (false, _) => Shown::Nothing,
            // The bar is hidden if the standard error is not a terminal.
            (true, true) => Shown::Lines(None),
            (true, false) => Shown::Bar(bar),
        };
        Self {
            shown,
            steps,
            before: 0,
            start: Instant::now(),
            latest: None,
            warnings: Vec::new(),
        }
    }

    /// Begins the display of a run that resumes after `before` steps.
    pub fn begin(&mut self, before: usize) {
        self.before = before;
        self.start = Instant::now();
        if let Shown::Bar(bar) = &self.shown {
            bar.set_position(before as u64);
            bar.reset_eta();
        }
    }

    /// Shows the state after the last step of a history.
    pub fn step(&mut self, history: &History) {
        let Some(row) = history.rows.last() else {
            return;
        };
        if matches!(self.shown, Shown::Nothing) {
            return;
        }
        let (done, state) = (row.step + 1, state(row, &history.recent(WINDOW)));
        match &mut self.shown {
            Shown::Nothing => {}
            Shown::Bar(bar) => {
                bar.set_message(state);
                bar.set_position(done as u64);
            }
            Shown::Lines(last) => {
                let latest = Latest { done, state };
                if last.is_none_or(|(last, _)| last.elapsed() >= PAUSE) {
                    *last = Some((Instant::now(), done));
                    write_line(&line(
                        &latest,
                        (self.before, self.steps),
                        self.start.elapsed(),
                    ));
                }
                self.latest = Some(latest);
            }
        }
    }

    /// Ends the display. If lines are written, the last line gives the reason for an early end.
    pub fn finish(&mut self, stop: Stop) {
        let why = match stop {
            Stop::Steps => "",
            Stop::Early => "; it ends, since the loss has stopped falling",
            Stop::Callback => "; it ends, as the callback asked",
        };
        match (&self.shown, &self.latest) {
            (Shown::Bar(bar), _) => bar.finish_and_clear(),
            (Shown::Lines(last), Some(latest)) => {
                let written = last.is_some_and(|(_, done)| done == latest.done);
                if !written || stop != Stop::Steps {
                    let text = line(latest, (self.before, self.steps), self.start.elapsed());
                    write_line(&(text + why));
                }
            }
            _ => {}
        }
    }

    /// Stores and logs a warning.
    pub fn warn(&mut self, warning: Warning) {
        let log = || warn(warning.kind(), format_args!("fit: {warning}"));
        match &self.shown {
            // A line on the same terminal appears above the bar.
            Shown::Bar(bar) => bar.suspend(log),
            _ => log(),
        }
        self.warnings.push(warning);
    }
}

/// Writes a line to the standard error. Failures are ignored, so that the fit continues.
fn write_line(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Returns the loss, the blur and values: `loss 1.234e-3, blur 2.0e-2, PSNR 27.1`.
fn state(row: &Row, values: &[(&str, f64)]) -> String {
    let mut text = format!("loss {:.3e}", row.loss);
    if let Some(blur) = row.blur {
        text += &format!(", blur {blur:.1e}");
    }
    for (name, value) in values {
        text += &match value.abs() {
            0.1..1e4 => format!(", {name} {value:.1}"),
            _ => format!(", {name} {value:.1e}"),
        };
    }
    text
}

/// Returns the line of a step: `fit: step 40/200, loss 1.234e-3, blur 2.0e-2, 12 s, about 48 s left`.
fn line(latest: &Latest, (before, steps): (usize, usize), elapsed: Duration) -> String {
    let Latest { done, state } = latest;
    let mut text = format!("fit: step {done}/{steps}, {state}, {}", time(elapsed));
    let (taken, left) = (done - before, steps.saturating_sub(*done));
    if taken > 0 && left > 0 {
        let left = elapsed.mul_f64(left as f64 / taken as f64);
        text += &format!(", about {} left", time(left));
    }
    text
}

fn time(time: Duration) -> String {
    let seconds = time.as_secs_f64();
    if seconds < 9.95 {
        return format!("{seconds:.1} s");
    }
    let seconds = seconds.round() as u64;
    match (seconds / 3600, seconds / 60 % 60, seconds % 60) {
        (0, 0, s) => format!("{s} s"),
        (0, m, s) => format!("{m} min {s} s"),
        (h, m, _) => format!("{h} h {m} min"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_say_how_far_it_is() {
        let at = |done, before, blur, seconds, values: &[(&str, f64)]| {
            let row = Row {
                step: done - 1,
                loss: 1.2e-3,
                gradient_norm: 1.0,
                rate: 0.1,
                blur,
                seconds,
                values: Vec::new(),
            };
            let state = state(&row, values);
            let latest = Latest { done, state };
            line(&latest, (before, 200), Duration::from_secs_f64(seconds))
        };
        assert_eq!(
            at(40, 0, Some(0.02), 12.0, &[]),
            "fit: step 40/200, loss 1.200e-3, blur 2.0e-2, 12 s, about 48 s left"
        );
        // Steps taken before a resumption do not count towards the time.
        assert_eq!(
            at(150, 100, None, 100.0, &[]),
            "fit: step 150/200, loss 1.200e-3, 1 min 40 s, about 1 min 40 s left"
        );
        assert_eq!(
            at(200, 0, None, 7300.0, &[("PSNR", 27.12), ("error", 1e-4)]),
            "fit: step 200/200, loss 1.200e-3, PSNR 27.1, error 1.0e-4, 2 h 1 min"
        );
        assert_eq!(time(Duration::from_millis(340)), "0.3 s");
    }
}
