//! Bytes that a file contains or refers to.

use std::collections::HashMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};

use bytes::Bytes;
use data_encoding::BASE64_NOPAD;
use percent_encoding::percent_decode_str;

use super::Document;
use crate::error::Result;

/// The target of a URI.
pub(super) enum Target {
    Data(Vec<u8>),
    File(PathBuf),
}

/// Returns the bytes of all buffers, and the total size of the other files that were read. A file is read once,
/// however many buffers refer to it.
pub(super) fn load(document: &Document, binary: Option<Bytes>) -> Result<(Vec<Bytes>, u64)> {
    let mut files: HashMap<PathBuf, Bytes> = HashMap::new();
    let all = &document.root.buffers;
    let mut buffers = Vec::with_capacity(all.len());
    for i in 0..all.len() {
        let json = document.fields(all, i, "", "buffers")?;
        let (uri, place) = (json.get("uri")?, &json.place);
        let bytes = match (uri, &binary) {
            (None, Some(binary)) if i == 0 => binary.clone(),
            (None, _) => {
                let message =
                    "has no uri, which only the first one of a .glb with a binary chunk may lack";
                return Err(document.fail(place, message));
            }
            (Some(uri), _) => match document.target(uri, place)? {
                Target::Data(data) => data.into(),
                Target::File(file) => {
                    // One file may have several paths.
                    let key = document.files.key(&file);
                    match files.get(&key) {
                        Some(read) => read.clone(),
                        None => {
                            let read = document.files.read_bytes(&file).map_err(|e| {
                                e.named_by(&format!("{}, {place}.uri", document.path.display()))
                            });
                            let read = Bytes::from(read?);
                            files.insert(key, read.clone());
                            read
                        }
                    }
                }
            },
        };
        let (found, claimed): (_, u64) = (bytes.len() as u64, json.required("byteLength")?);
        let message = format_args!("is {claimed}, but there are {found} bytes");
        document.unless(claimed <= found, json.at("byteLength"), message)?;
        buffers.push(bytes.slice(..claimed as usize));
    }
    let read = files.values().map(|file| file.len() as u64).sum();
    Ok((buffers, read))
}

impl Document<'_> {
    /// Returns the file that a URI refers to, or the data that it contains.
    pub fn target(&self, uri: &str, place: impl Display) -> Result<Target> {
        let place = format!("{place}.uri");
        if let Some(data) = uri.strip_prefix("data:") {
            let Some((kind, data)) = data.split_once(',') else {
                return Err(self.fail(place, "is data without a comma before its bytes"));
            };
            if !kind.ends_with(";base64") {
                return Err(self.fail(place, format!("is data of {kind:?}, expected base64")));
            }
            let data = base64(data);
            let data = data.ok_or_else(|| self.fail(place, "is data that is no base64"))?;
            return Ok(Target::Data(data));
        }
        // A single letter may be a drive.
        let scheme = uri.split_once(':').map(|(scheme, _)| scheme);
        let letters = |s: &&str| s.len() > 1 && s.chars().all(|c| c.is_ascii_alphanumeric());
        if let Some(scheme) = scheme.filter(letters) {
            let message = format!("is of the scheme {scheme:?}, expected a file's name or data");
            return Err(self.fail(place, message));
        }
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let file = folder.join(&*percent_decode_str(uri).decode_utf8_lossy());
        let from = format!("{}, {place}", self.path.display());
        self.files.check_place(&file, folder, &from)?;
        Ok(Target::File(file))
    }
}

/// Decodes base64 (RFC 4648); the result is `None` if it is malformed. Padding may be missing.
fn base64(text: &str) -> Option<Vec<u8>> {
    let mut lenient = BASE64_NOPAD.specification();
    lenient.check_trailing_bits = false;
    let encoding = lenient.encoding().ok()?;
    encoding.decode(text.trim_end_matches('=').as_bytes()).ok()
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
            assert_eq!(base64(text), Some(expected.into()), "{text}");
        }
        assert_eq!(base64("++//"), Some(vec![0xfb, 0xef, 0xff]));
        for malformed in ["Z", "Zm9vY", "Zm 9v", "=Zg"] {
            assert_eq!(base64(malformed), None, "{malformed}");
        }
    }
}
