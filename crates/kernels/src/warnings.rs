//! Warnings of likely mistakes. All of them go through this file.

use std::collections::{BTreeSet, HashMap};
use std::fmt::Display;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::Write;
use std::panic::Location;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{LazyLock, Mutex, PoisonError};

use log::{Level, LevelFilter, log_enabled, max_level};

/// The variable that hides warnings if its value is 0.
const VARIABLE: &str = "SOFTRAY_WARNINGS";

/// The most different warnings of one kind that are printed.
const MAX_PER_KIND: usize = 8;

static HIDDEN: AtomicBool = AtomicBool::new(false);

/// The place in the code that a warning comes from, and a word for its kind if the place has several.
type Kind = (&'static Location<'static>, &'static str);

/// The warnings that were printed, by kind.
static PRINTED: LazyLock<Mutex<HashMap<Kind, Vec<String>>>> = LazyLock::new(Mutex::default);

/// The hashes of the texts of [`warn_once`] that a logger has received.
static LOGGED: Mutex<BTreeSet<u64>> = Mutex::new(BTreeSet::new());

/// Shows or hides warnings on the standard error, where they are shown by default if no logger is installed.
///
/// Warnings are about likely mistakes that are not errors: a black image, a camera that sees nothing of the scene, parts
/// of a file that are not read. Each goes to the `log` crate. If the program has installed no logger, it is printed to
/// the standard error instead, as a line that begins with `softray: warning:`. The same text is printed once in a
/// process, and at most eight texts of one kind. The crate prints nothing else without a request.
///
/// A logger whose maximum level is `Off` counts as none, so that warnings are printed. To hide them, call this function
/// with `false`, or set the environment variable `SOFTRAY_WARNINGS=0`. Neither changes what a logger receives.
///
/// A logger receives each text about scenes, cameras and options of renders once in a process, because a fit would
/// repeat it at every step. It receives every other warning, and every one of a black image.
///
/// ```
/// softray::show_warnings(false);
/// ```
pub fn show_warnings(shown: bool) {
    HIDDEN.store(!shown, Ordering::Relaxed);
}

/// Logs a warning, or prints it if no logger is installed. `kind` distinguishes warnings from one place in the code.
#[track_caller]
pub fn warn(kind: &'static str, text: impl Display) {
    match max_level() {
        LevelFilter::Off => print((Location::caller(), kind), text.to_string()),
        _ => log::warn!("{text}"),
    }
}

/// Like [`warn`], but a logger receives a text only once in a process: for what every render of a fit would repeat.
#[track_caller]
pub fn warn_once(kind: &'static str, text: impl Display) {
    let text = text.to_string();
    if max_level() == LevelFilter::Off {
        print((Location::caller(), kind), text);
        return;
    }
    let mut hasher = DefaultHasher::new();
    text.hash(&mut hasher);
    let mut logged = LOGGED.lock().unwrap_or_else(PoisonError::into_inner);
    let is_new = log_enabled!(Level::Warn) && logged.insert(hasher.finish());
    // A logger may take long, or warn itself.
    drop(logged);
    if is_new {
        log::warn!("{text}");
    }
}

/// Prints a warning, unless it was printed before or its kind was printed often.
fn print(kind: Kind, text: String) {
    if HIDDEN.load(Ordering::Relaxed) || std::env::var_os(VARIABLE).is_some_and(|v| v == "0") {
        return;
    }
    let mut printed = PRINTED.lock().unwrap_or_else(PoisonError::into_inner);
    let of_kind = printed.entry(kind).or_default();
    if of_kind.len() >= MAX_PER_KIND || of_kind.contains(&text) {
        return;
    }
    let mut lines = format!("softray: warning: {text}\n");
    of_kind.push(text);
    if of_kind.len() == MAX_PER_KIND {
        lines += "softray: more warnings of this kind are not printed; a logger receives all\n";
    }
    // A failure is ignored, so that the program continues.
    let _ = std::io::stderr().write_all(lines.as_bytes());
}

/// Logs a warning, formatted as by `format!`, or prints it if no logger is installed.
#[macro_export]
#[doc(hidden)]
macro_rules! warning {
    ($($text:tt)*) => {
        $crate::warnings::warn("", format_args!($($text)*))
    };
}

/// The same for what every render of a fit would repeat ([`warn_once`]).
#[macro_export]
#[doc(hidden)]
macro_rules! warning_once {
    ($($text:tt)*) => {
        $crate::warnings::warn_once("", format_args!($($text)*))
    };
}
