//! Warnings of likely mistakes. All of them go through this file.

use std::collections::{BTreeSet, HashMap};
use std::fmt::Display;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::Write;
use std::panic::Location;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{LazyLock, Mutex, PoisonError};

use log::{Level, LevelFilter, log_enabled, max_level};

/// What loggers filter by.
const TARGET: &str = "softray::warnings";

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

/// Shows or hides warnings on the standard error.
pub fn show(shown: bool) {
    HIDDEN.store(!shown, Ordering::Relaxed);
}

/// Logs a warning, or prints it if no logger is installed. `kind` distinguishes warnings from one place in the code.
#[track_caller]
pub fn warn(kind: &'static str, text: impl Display) {
    match max_level() {
        LevelFilter::Off => print((Location::caller(), kind), text.to_string()),
        _ => log::warn!(target: TARGET, "{text}"),
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
    let is_new = log_enabled!(target: TARGET, Level::Warn) && logged.insert(hasher.finish());
    // A logger may take long, or warn itself.
    drop(logged);
    if is_new {
        log::warn!(target: TARGET, "{text}");
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
