//! JSON objects. Each field is read by its path where it is used.

use serde::Deserialize;
use serde_json::Value;

use super::Document;
use crate::error::{Error, Result};

/// A JSON object of a file, and its place in the file.
pub(super) struct Fields<'a> {
    pub document: &'a Document<'a>,
    pub json: &'a Value,
    pub place: String,
}

/// The valid range of a number.
#[derive(Clone, Copy)]
pub(super) enum Range {
    Unit,
    NotNegative,
    Positive,
}

impl Range {
    /// Returns the number if it is in the range. [`Range::Unit`] allows for rounding and clamps the number.
    fn limit(self, value: f32) -> Option<f32> {
        let (valid, limited) = match self {
            Self::Unit => ((value - 0.5).abs() <= 0.5 + 1e-6, value.clamp(0.0, 1.0)),
            Self::NotNegative => (value >= 0.0, value),
            Self::Positive => (value > 0.0, value),
        };
        (valid && value.is_finite()).then_some(limited)
    }

    fn expected(self) -> &'static str {
        match self {
            Self::Unit => "a number in [0, 1]",
            Self::NotNegative => "a finite number ≥ 0",
            Self::Positive => "a finite number > 0",
        }
    }
}

impl<'a> Fields<'a> {
    /// Returns the place of a field.
    pub fn at(&self, path: &str) -> String {
        format!("{}.{path}", self.place)
    }

    /// Returns a field by its path, such as `spot.innerConeAngle`. The result is null if the field or its parent is
    /// missing.
    pub fn value(&self, path: &str) -> Result<&'a Value> {
        let mut json = self.json;
        for name in path.split('.') {
            json = match json {
                Value::Object(fields) => fields.get(name).unwrap_or(&Value::Null),
                Value::Null => json,
                _ => {
                    let message = "is in what is no object with fields";
                    return Err(self.document.fail(self.at(path), message));
                }
            };
        }
        Ok(json)
    }

    /// Returns the object in a field.
    pub fn within(&self, path: &str) -> Result<Self> {
        Ok(Self {
            document: self.document,
            json: self.value(path)?,
            place: self.at(path),
        })
    }

    /// Returns the value of a field, `None` if it is missing.
    pub fn get<T: Deserialize<'a>>(&self, path: &str) -> Result<Option<T>> {
        let found = Option::<T>::deserialize(self.value(path)?);
        let malformed = |e| format!("{}: {e}", self.at(path));
        found.map_err(|e| Error::format(self.document.path, malformed(e)))
    }

    /// Returns the value of a required field.
    pub fn required<T: Deserialize<'a>>(&self, path: &str) -> Result<T> {
        let missing = || self.document.fail(self.at(path), "is not there");
        self.get(path)?.ok_or_else(missing)
    }

    /// Returns a number in a range, or the default if the field is missing.
    pub fn number(&self, path: &str, default: f32, range: Range) -> Result<f64> {
        let [value] = self.check(path, [self.get(path)?.unwrap_or(default)], range)?;
        Ok(value)
    }

    /// Returns three numbers, like [`Self::number`].
    pub fn three(&self, path: &str, default: [f32; 3], range: Range) -> Result<[f64; 3]> {
        self.check(path, self.get(path)?.unwrap_or(default), range)
    }

    /// Returns the numbers of a field; one out of range is an error.
    pub fn check<const N: usize>(
        &self,
        path: &str,
        mut values: [f32; N],
        range: Range,
    ) -> Result<[f64; N]> {
        for value in &mut values {
            *value = range.limit(*value).ok_or_else(|| {
                let message = format!("is {value}, expected {}", range.expected());
                self.document.fail(self.at(path), message)
            })?;
        }
        Ok(values.map(f64::from))
    }
}
