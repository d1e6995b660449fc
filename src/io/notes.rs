//! Warnings about a file that name some of what they are about, and count the rest.

use std::collections::BTreeMap;
use std::path::Path;

use super::LoadLimits;
use crate::error::{Error, Result};

/// The most names in a warning.
const MOST: usize = 5;

/// What is to be said about a file once it is read.
#[derive(Default)]
pub(super) struct Notes(BTreeMap<&'static str, (Vec<String>, usize)>);

impl Notes {
    /// Notes one of the things that a sentence is about.
    pub fn add(&mut self, sentence: &'static str, name: impl Into<String>) {
        let (names, count) = self.0.entry(sentence).or_default();
        *count += 1;
        if names.len() < MOST {
            names.push(name.into());
        }
    }

    /// Notes a fault of materials or textures. It is an error where limits are strict or are what it is about.
    pub fn fault(&mut self, error: Error, limits: &LoadLimits) -> Result<()> {
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
        for (sentence, (names, count)) in &self.0 {
            let more = match count - names.len() {
                0 => String::new(),
                more => format!(" and {more} more"),
            };
            log::warn!("{}: {sentence}: {}{more}", path.display(), names.join(", "));
        }
    }
}
