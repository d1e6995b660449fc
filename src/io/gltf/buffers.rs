//! Bytes that a file has, or names.

use std::collections::HashMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::Document;
use crate::error::Result;
use crate::io::description::Bytes;
use crate::io::limits::read_bytes;

/// Where a URI leads.
pub(super) enum Target {
    Data(Vec<u8>),
    File(PathBuf),
}

/// The bytes of all buffers, and how many of them are in other files; a file is read once however many buffers name it.
pub(super) fn load(document: &Document, binary: Option<Bytes>) -> Result<(Vec<Bytes>, u64)> {
    let mut files: HashMap<PathBuf, Arc<Vec<u8>>> = HashMap::new();
    let mut buffers = Vec::with_capacity(document.root.buffers.len());
    for (i, json) in document.root.buffers.iter().enumerate() {
        let place = format!("buffers[{i}]");
        let bytes = match (&json.uri, &binary) {
            (None, Some(binary)) if i == 0 => binary.clone(),
            (None, _) => {
                let message =
                    "has no uri, which only the first one of a .glb with a binary chunk may lack";
                return Err(document.fail(place, message));
            }
            (Some(uri), _) => {
                let buffer = match document.target(uri, &place)? {
                    Target::Data(data) => Arc::new(data),
                    Target::File(file) => {
                        // Whatever way leads to it.
                        let key = file.canonicalize().unwrap_or_else(|_| file.clone());
                        match files.get(&key) {
                            Some(read) => read.clone(),
                            None => {
                                let read = Arc::new(read_bytes(&file, document.limits)?);
                                files.insert(key, read.clone());
                                read
                            }
                        }
                    }
                };
                let range = 0..buffer.len();
                Bytes { buffer, range }
            }
        };
        let (found, claimed) = (bytes.range.len() as u64, json.byte_length);
        let message = format_args!("is {claimed}, but there are {found} bytes");
        document.unless(
            claimed <= found,
            format_args!("{place}.byteLength"),
            message,
        )?;
        let end = bytes.range.start + claimed as usize;
        buffers.push(Bytes {
            range: bytes.range.start..end,
            ..bytes
        });
    }
    let read = files.values().map(|file| file.len() as u64).sum();
    Ok((buffers, read))
}

impl Document<'_> {
    /// The file that a URI names, or the data that it is.
    pub fn target(&self, uri: &str, place: impl Display) -> Result<Target> {
        let place = format!("{place}.uri");
        if let Some(data) = uri.strip_prefix("data:") {
            let Some((kind, data)) = data.split_once(',') else {
                return Err(self.fail(place, "is data without a comma before its bytes"));
            };
            if !kind.ends_with(";base64") {
                return Err(self.fail(place, format!("is data of {kind:?}, expected base64")));
            }
            let data = base64(data.as_bytes());
            let data = data.ok_or_else(|| self.fail(place, "is data that is no base64"))?;
            return Ok(Target::Data(data));
        }
        // A letter alone may be a disk.
        let scheme = uri.split_once(':').map(|(scheme, _)| scheme);
        let letters = |s: &&str| s.len() > 1 && s.chars().all(|c| c.is_ascii_alphanumeric());
        if let Some(scheme) = scheme.filter(letters) {
            let message = format!("is of the scheme {scheme:?}, expected a file's name or data");
            return Err(self.fail(place, message));
        }
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let file = folder.join(percent_decoded(uri));
        let from = format!("{}, {place}", self.path.display());
        self.limits.check_place(&file, folder, &from)?;
        Ok(Target::File(file))
    }
}

/// The bytes of base64 (RFC 4648), or None where it is malformed. Padding may be missing.
fn base64(text: &[u8]) -> Option<Vec<u8>> {
    let end = text.iter().rposition(|&c| c != b'=').map_or(0, |i| i + 1);
    let digit = |c: u8| {
        Some(match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        })
    };
    let mut bytes = Vec::with_capacity(end / 4 * 3 + 2);
    for group in text[..end].chunks(4) {
        if group.len() == 1 {
            return None;
        }
        let mut all = 0u32;
        for &c in group {
            all = all << 6 | u32::from(digit(c)?);
        }
        all <<= 6 * (4 - group.len());
        bytes.extend_from_slice(&all.to_be_bytes()[1..group.len()]);
    }
    Some(bytes)
}

/// A name with its `%20` and the like replaced; what is no such pair of digits stays.
fn percent_decoded(uri: &str) -> String {
    let (mut decoded, mut rest) = (Vec::with_capacity(uri.len()), uri.as_bytes());
    while let [first, after @ ..] = rest {
        let pair = after.get(..2).filter(|_| *first == b'%');
        let pair = pair.and_then(|pair| std::str::from_utf8(pair).ok());
        match pair.and_then(|pair| u8::from_str_radix(pair, 16).ok()) {
            Some(byte) => {
                decoded.push(byte);
                rest = &after[2..];
            }
            None => {
                decoded.push(*first);
                rest = after;
            }
        }
    }
    String::from_utf8_lossy(&decoded).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The examples of RFC 4648.
    #[test]
    fn base64_is_decoded() {
        for (text, expected) in [
            ("", ""),
            ("Zg==", "f"),
            ("Zm8=", "fo"),
            ("Zm8", "fo"),
            ("Zm9v", "foo"),
            ("Zm9vYmFy", "foobar"),
        ] {
            assert_eq!(base64(text.as_bytes()), Some(expected.into()), "{text}");
        }
        assert_eq!(base64(b"++//"), Some(vec![0xfb, 0xef, 0xff]));
        for malformed in ["Z", "Zm9vY", "Zm 9v", "=Zg"] {
            assert_eq!(base64(malformed.as_bytes()), None, "{malformed}");
        }
    }

    #[test]
    fn names_are_decoded() {
        assert_eq!(percent_decoded("oak%20wood%C3%A9.png"), "oak woodé.png");
        assert_eq!(percent_decoded("100%"), "100%");
        assert_eq!(percent_decoded("%zz%4"), "%zz%4");
    }
}
