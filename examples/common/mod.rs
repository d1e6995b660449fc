//! Shared by the examples: the log, progress bars, fits.

use indicatif::{ProgressBar, ProgressStyle};

#[allow(dead_code)] // only those that fit something
pub mod study;

/// Shows warnings; `RUST_LOG` chooses otherwise.
pub fn log() {
    let warnings = env_logger::Env::default().default_filter_or("warn");
    env_logger::Builder::from_env(warnings).init();
}

/// A progress bar of known length.
#[allow(dead_code)] // those that fit have one of the fit
pub fn bar(length: u64, message: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:12} {bar:40} {pos}/{len} [{elapsed} < {eta}]");
    ProgressBar::new(length)
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        .with_message(message)
}

/// A progress bar that a render moves.
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
