//! Warnings about a file. A warning lists a few names and counts the rest.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::LoadLimits;
use crate::error::{Error, Result};
use softray_kernels::warnings::warn;

/// The most names that [`Notes::add`] lists in a warning.
const MAX_NAMES: usize = 5;

/// Warnings to log once a file is read. Each sentence has a list of names and a count.
#[derive(Default)]
pub(super) struct Notes(RefCell<BTreeMap<&'static str, (BTreeSet<String>, usize)>>);

impl Notes {
    /// Adds a name to a warning. Only the first few names are listed, the rest are counted.
    pub fn add(&self, sentence: &'static str, name: impl Into<String>) {
        let mut all = self.0.borrow_mut();
        let (names, count) = all.entry(sentence).or_default();
        *count += 1;
        if names.len() < MAX_NAMES {
            names.insert(name.into());
        }
    }

    /// Adds a part of a file to a warning. Every part is listed, once.
    pub fn part(&self, sentence: &'static str, name: impl Into<String>) {
        let mut all = self.0.borrow_mut();
        let (names, count) = all.entry(sentence).or_default();
        *count += usize::from(names.insert(name.into()));
    }

    /// Adds a fault, such as a malformed material, to the warnings. It is an error if limits are strict or if it
    /// exceeds a limit.
    pub fn fault(&self, error: Error, limits: &LoadLimits) -> Result<()> {
        let message = error.to_string();
        // Messages about limits contain the setting that changes them.
        if limits.strict || message.contains("LoadLimits::") {
            return Err(error);
        }
        self.add("it is rendered without what can't be read", message);
        Ok(())
    }

    /// Logs one warning for each sentence.
    pub fn warn(&self, path: &Path) {
        for (sentence, (names, count)) in &*self.0.borrow() {
            let more = match count - names.len() {
                0 => String::new(),
                more => format!(" and {more} more"),
            };
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            let (path, names) = (path.display(), names.join(", "));
            warn(sentence, format_args!("{path}: {sentence}: {names}{more}"));
        }
    }
}
