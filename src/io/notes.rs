//! Warnings about a file that name some of what they are about, and count the rest.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::LoadLimits;
use crate::error::{Error, Result};

/// The most names in a warning, but for those of parts.
const MOST: usize = 5;

/// What is to be said about a file once it is read, by sentences: names, and how many there were.
#[derive(Default)]
pub(super) struct Notes(RefCell<BTreeMap<&'static str, (BTreeSet<String>, usize)>>);

impl Notes {
    /// Notes one of the things that a sentence is about.
    pub fn add(&self, sentence: &'static str, name: impl Into<String>) {
        let mut all = self.0.borrow_mut();
        let (names, count) = all.entry(sentence).or_default();
        *count += 1;
        if names.len() < MOST {
            names.insert(name.into());
        }
    }

    /// Notes a part of a file that a sentence is about; each is named, and once.
    pub fn part(&self, sentence: &'static str, name: impl Into<String>) {
        let mut all = self.0.borrow_mut();
        let (names, count) = all.entry(sentence).or_default();
        *count += usize::from(names.insert(name.into()));
    }

    /// Notes a fault of materials or textures. It is an error where limits are strict or are what it is about.
    pub fn fault(&self, error: Error, limits: &LoadLimits) -> Result<()> {
        let message = error.to_string();
        // Messages of limits name the setting that changes them.
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
            log::warn!("{}: {sentence}: {}{more}", path.display(), names.join(", "));
        }
    }
}
