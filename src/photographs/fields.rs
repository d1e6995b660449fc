//! Fields of a JSON file, with messages that name the file, the frame and the field.

use std::path::Path;

use serde_json::{Map, Value};

use super::draft::wrong;
use super::pose::Rows;
use crate::error::{Error, Result};

/// The fields of an object, and those of the file that hold for all of its frames.
pub(super) struct Fields<'a> {
    pub file: &'a Path,
    /// The object's name in messages.
    pub place: &'a str,
    own: &'a Map<String, Value>,
    top: Option<&'a Map<String, Value>>,
}

impl<'a> Fields<'a> {
    pub fn new(
        file: &'a Path,
        place: &'a str,
        own: &'a Value,
        top: Option<&'a Value>,
    ) -> Result<Self> {
        let object = own.as_object().ok_or_else(|| {
            Error::format(
                file,
                format!("{place} is {own}, expected an object with fields"),
            )
        })?;
        Ok(Self {
            file,
            place,
            own: object,
            top: top.and_then(Value::as_object),
        })
    }

    fn wrong(&self, field: &str, found: &Value, expected: &str) -> Error {
        let mut shown = found.to_string();
        if shown.len() > 200 {
            shown = shown.chars().take(200).collect::<String>() + "…";
        }
        let message = format!("is {shown}, expected {expected}");
        wrong(self.file, self.place, field, &message)
    }

    /// Returns a field of the object, or else of the file. `null` counts as missing.
    fn get(&self, field: &str) -> Option<&'a Value> {
        let own = self.own.get(field).filter(|value| !value.is_null());
        own.or_else(|| self.top?.get(field).filter(|value| !value.is_null()))
    }

    pub fn number(&self, field: &str) -> Result<Option<f64>> {
        let number = |value: &Value| {
            let number = value.as_f64().filter(|v| v.is_finite());
            number.ok_or_else(|| self.wrong(field, value, "a finite number"))
        };
        self.get(field).map(number).transpose()
    }

    pub fn flag(&self, field: &str) -> Result<bool> {
        let flag = |value: &Value| {
            let flag = value.as_bool();
            flag.ok_or_else(|| self.wrong(field, value, "true or false"))
        };
        Ok(self.get(field).map(flag).transpose()?.unwrap_or(false))
    }

    pub fn text(&self, field: &str) -> Result<Option<&'a str>> {
        self.as_text(field, self.get(field))
    }

    /// Returns a text of the object itself.
    pub fn own_text(&self, field: &str) -> Result<Option<&'a str>> {
        self.as_text(field, self.own.get(field).filter(|value| !value.is_null()))
    }

    fn as_text(&self, field: &str, value: Option<&'a Value>) -> Result<Option<&'a str>> {
        let text = |value: &'a Value| {
            let text = value.as_str();
            text.ok_or_else(|| self.wrong(field, value, "a text"))
        };
        value.map(text).transpose()
    }

    /// Returns a list of texts, empty if it is missing.
    pub fn texts(&self, field: &str) -> Result<Vec<&'a str>> {
        let Some(value) = self.get(field) else {
            return Ok(Vec::new());
        };
        let texts = value
            .as_array()
            .and_then(|list| list.iter().map(Value::as_str).collect());
        texts.ok_or_else(|| self.wrong(field, value, "a list of texts"))
    }

    /// Returns the first three rows of a matrix of 3 or 4 rows with 4 numbers each.
    pub fn rows(&self, field: &str) -> Result<Option<Rows>> {
        let Some(value) = self.own.get(field).filter(|value| !value.is_null()) else {
            return Ok(None);
        };
        let row = |row: &Value| -> Option<[f64; 4]> {
            let numbers: Option<Vec<f64>> = row.as_array()?.iter().map(Value::as_f64).collect();
            numbers?.try_into().ok()
        };
        let rows: Option<Vec<_>> = value
            .as_array()
            .and_then(|rows| rows.iter().map(row).collect());
        let rows = rows.filter(|rows| match rows.len() {
            3 => true,
            4 => rows[3] == [0.0, 0.0, 0.0, 1.0],
            _ => false,
        });
        let expected = "3 rows of 4 finite numbers, and (0, 0, 0, 1) if there is a fourth";
        let rows = rows.ok_or_else(|| self.wrong(field, value, expected))?;
        Ok(Some([rows[0], rows[1], rows[2]]))
    }
}
