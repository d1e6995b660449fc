//! Code shared by the examples: the log, progress bars, fits.

use indicatif::{ProgressBar, ProgressStyle};

#[allow(dead_code)] // only the examples with a fit use it
pub mod study;

/// Logs warnings, or the levels in `RUST_LOG`.
pub fn log() {
    let warnings = env_logger::Env::default().default_filter_or("warn");
    env_logger::Builder::from_env(warnings).init();
}

/// Creates a progress bar of a known length.
#[allow(dead_code)] // examples with a fit have the bar of the fit
pub fn bar(length: u64, message: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:12} {bar:40} {pos}/{len} [{elapsed} < {eta}]");
    ProgressBar::new(length)
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        .with_message(message)
}

/// Creates a progress bar, and the callback with which a render updates it.
#[allow(dead_code)]
pub fn render_progress(
    message: &'static str,
) -> (ProgressBar, impl Fn(usize, usize) + Send + Sync + 'static) {
    let bar = bar(1, message);
    let moved = bar.clone();
    let progress = move |done, all| {
        moved.set_length(all as u64);
        moved.set_position(done as u64);
    };
    (bar, progress)
}
