//! Reads the values of a PLY file in order.

use super::header::Format;
use crate::io::numbers::Kind;

/// The unread part of a file after its header.
pub(super) struct Values<'a> {
    pub format: Format,
    pub rest: &'a [u8],
    /// Whether each row has its own line.
    pub by_line: bool,
}

impl Values<'_> {
    /// Reads the next value. An error describes the problem.
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

    /// Ends a row: skips the rest of its line if rows have their own lines.
    pub fn end_row(&mut self) {
        if self.by_line {
            let end = self.rest.iter().position(|&b| b == b'\n');
            self.rest = &self.rest[end.unwrap_or(self.rest.len())..];
        }
    }

    /// Reads the next word as a number.
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

    /// Reads the length of the next list. A length that the rest of the file cannot hold is an error.
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
