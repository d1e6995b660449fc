//! Warnings of likely mistakes. All of them go through this file.

use std::collections::HashMap;
use std::fmt::Display;
use std::io::Write;
use std::panic::Location;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{LazyLock, Mutex, PoisonError};

use log::{LevelFilter, max_level};

/// The variable that hides warnings if its value is 0.
const VARIABLE: &str = "SOFTRAY_WARNINGS";

/// The most different warnings from one place in the code that are printed.
const MAX_PER_PLACE: usize = 8;

static HIDDEN: AtomicBool = AtomicBool::new(false);

/// The warnings that were printed, by the place in the code that they come from.
type Printed = HashMap<&'static Location<'static>, Vec<String>>;

static PRINTED: LazyLock<Mutex<Printed>> = LazyLock::new(Mutex::default);

/// Shows or hides warnings on the standard error, where they are shown by default if no logger is installed.
///
/// Warnings are about likely mistakes that are not errors: a black image, a camera that sees nothing of the scene, parts
/// of a file that are not read. Each goes to the `log` crate. If the program has installed no logger (the maximum level
/// of `log` is off), it is also printed to the standard error, as a line that begins with `softray: warning:`. The same
/// text is printed once in a process, and at most eight texts of one kind. The crate prints nothing else without a
/// request.
///
/// The environment variable `SOFTRAY_WARNINGS=0` hides the printed warnings, too. Neither changes what a logger receives.
///
/// ```
/// softray::show_warnings(false);
/// ```
pub fn show_warnings(shown: bool) {
    HIDDEN.store(!shown, Ordering::Relaxed);
}

/// Logs a warning, and prints it if no logger is installed.
#[track_caller]
pub(crate) fn warn(text: impl Display) {
    log::warn!("{text}");
    let hidden =
        HIDDEN.load(Ordering::Relaxed) || std::env::var_os(VARIABLE).is_some_and(|v| v == "0");
    if hidden || max_level() != LevelFilter::Off {
        return;
    }
    let text = text.to_string();
    let mut printed = PRINTED.lock().unwrap_or_else(PoisonError::into_inner);
    let of_place = printed.entry(Location::caller()).or_default();
    if of_place.len() >= MAX_PER_PLACE || of_place.contains(&text) {
        return;
    }
    let mut lines = format!("softray: warning: {text}\n");
    of_place.push(text);
    if of_place.len() == MAX_PER_PLACE {
        lines += "softray: more warnings of this kind are not printed; a logger receives all\n";
    }
    // A failure is ignored, so that the program continues.
    let _ = std::io::stderr().write_all(lines.as_bytes());
}

/// Logs a warning, formatted as by `format!`, and prints it if no logger is installed.
macro_rules! warning {
    ($($text:tt)*) => {
        $crate::warnings::warn(format_args!($($text)*))
    };
}
pub(crate) use warning;
