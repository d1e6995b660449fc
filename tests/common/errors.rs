//! Messages of errors.

use std::fmt::Display;

/// The message of a result that has to be an error.
#[track_caller]
pub fn message<T, E: Display>(result: Result<T, E>) -> String {
    match result {
        Ok(_) => panic!("no error"),
        Err(error) => error.to_string(),
    }
}

/// That a text has all of these parts.
#[track_caller]
pub fn says<const N: usize>(text: impl Display, parts: [&str; N]) {
    let text = text.to_string();
    for part in parts {
        assert!(text.contains(part), "no {part:?} in {text:?}");
    }
}
