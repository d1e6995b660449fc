//! Values of a PLY file, one after the other.

use super::header::Format;
use crate::io::numbers::Kind;

/// What is left of a file after its header.
pub(super) struct Values<'a> {
    pub format: Format,
    pub rest: &'a [u8],
    /// Whether each row has a line of its own.
    pub by_line: bool,
}

impl Values<'_> {
    /// The next value, or what is wrong with it.
    pub fn next(&mut self, kind: Kind) -> Result<f64, String> {
        if self.format == Format::Ascii {
            return self.word();
        }
        let size = kind.size();
        let Some((bytes, rest)) = self.rest.split_at_checked(size) else {
            return Err("the file ends before it".into());
        };
        self.rest = rest;
        let mut all = [0; 8];
        all[..size].copy_from_slice(bytes);
        if self.format == Format::BigEndian {
            all[..size].reverse();
        }
        Ok(kind.number(&all))
    }

    /// Called after a row: leaves out what else is in its line.
    pub fn end_row(&mut self) {
        if self.by_line {
            let end = self.rest.iter().position(|&b| b == b'\n');
            self.rest = &self.rest[end.unwrap_or(self.rest.len())..];
        }
    }

    /// The number that a word is.
    fn word(&mut self) -> Result<f64, String> {
        let text = self.rest.trim_ascii_start();
        let end = text.iter().position(u8::is_ascii_whitespace);
        let (word, rest) = text.split_at(end.unwrap_or(text.len()));
        self.rest = rest;
        if word.is_empty() {
            return Err("the file ends before it".into());
        }
        let number = std::str::from_utf8(word).ok().and_then(|w| w.parse().ok());
        number.ok_or_else(|| {
            let shown = String::from_utf8_lossy(&word[..word.len().min(20)]);
            format!("it is {shown:?}, expected a number")
        })
    }

    /// The number of values of the next list: not more than there can be in the rest of the file.
    pub fn length(&mut self, count: Kind, item: Kind) -> Result<usize, String> {
        let length = self.next(count)?;
        let each = match self.format {
            // A space and a digit.
            Format::Ascii => 2,
            _ => item.size(),
        };
        let most = self.rest.len() / each;
        if length.fract() != 0.0 || length < 0.0 {
            return Err(format!("its length is {length}"));
        }
        if length > most as f64 {
            return Err(format!(
                "its length is {length}, but the file has {most} more at most"
            ));
        }
        Ok(length as usize)
    }
}
