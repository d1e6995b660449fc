//! The chunks of a `.glb` file (glTF 2.0, section 4).

use std::ops::Range;

/// Returns the range of the JSON in a file, and the range of its binary chunk if it has one. A file that is not a
/// container is all JSON.
pub(super) fn split(bytes: &[u8]) -> Result<(Range<usize>, Option<Range<usize>>), String> {
    if !bytes.starts_with(b"glTF") {
        // Skips a byte-order mark.
        let start = if bytes.starts_with(&[0xef, 0xbb, 0xbf]) {
            3
        } else {
            0
        };
        return Ok((start..bytes.len(), None));
    }
    let version = number(bytes, 4).ok_or("it ends within its header")?;
    if version != 2 {
        return Err(format!("its version is {version}, expected 2"));
    }
    let json = chunk(bytes, 12, b"JSON")?;
    // A chunk and its length include padding. Some writers do not count it in the length, others do not write it.
    let is_binary = |&at: &usize| bytes.get(at + 4..at + 8) == Some(b"BIN\0");
    let padded = json.end.next_multiple_of(4);
    let next = Some(json.end).filter(is_binary).unwrap_or(padded);
    let binary = match next < bytes.len() {
        true => Some(chunk(bytes, next, b"BIN\0")?),
        false => None,
    };
    Ok((json, binary))
}

/// Returns the range of the contents of the chunk that starts at byte `at`.
fn chunk(bytes: &[u8], at: usize, kind: &[u8; 4]) -> Result<Range<usize>, String> {
    let name = String::from_utf8_lossy(&kind[..]).replace('\0', "");
    let length = number(bytes, at).ok_or(format!("it ends before the chunk {name}"))?;
    let found = bytes.get(at + 4..at + 8).unwrap_or(&[]);
    if found != kind {
        let found = String::from_utf8_lossy(found);
        return Err(format!(
            "at byte {at} there is the chunk {found:?}, expected {name}"
        ));
    }
    let start = at + 8;
    let end = start.checked_add(length as usize);
    match end.filter(|&end| end <= bytes.len()) {
        Some(end) => Ok(start..end),
        None => Err(format!(
            "its chunk {name} has {length} bytes, but the file has {} after its header",
            bytes.len() - start
        )),
    }
}

fn number(bytes: &[u8], at: usize) -> Option<u32> {
    let bytes = bytes.get(at..at + 4)?;
    Some(u32::from_le_bytes(bytes.try_into().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
        let mut bytes = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
        for (kind, contents) in chunks {
            bytes.extend((contents.len() as u32).to_le_bytes());
            bytes.extend(*kind);
            bytes.extend(*contents);
        }
        bytes
    }

    /// As in other readers, the binary chunk follows immediately, or after padding that no length includes.
    #[test]
    fn chunks_without_padding_are_read() {
        let close = file(&[(b"JSON", b"{ }"), (b"BIN\0", b"abcd")]);
        assert_eq!(split(&close), Ok((20..23, Some(31..35))));
        let mut apart = file(&[(b"JSON", b"{ }")]);
        apart.push(b' ');
        let binary = file(&[(b"BIN\0", b"abc")]);
        apart.extend(&binary[12..]);
        assert_eq!(split(&apart), Ok((20..23, Some(32..35))));
        let alone = file(&[(b"JSON", b"{ }")]);
        assert_eq!(split(&alone), Ok((20..23, None)));
    }

    #[test]
    fn chunks_are_found() {
        let both = file(&[(b"JSON", b"{}  "), (b"BIN\0", b"abcd")]);
        assert_eq!(split(&both), Ok((20..24, Some(32..36))));
        let one = file(&[(b"JSON", b"{}  ")]);
        assert_eq!(split(&one), Ok((20..24, None)));
        assert_eq!(split(b"{}"), Ok((0..2, None)));
        for length in 4..both.len() {
            let cut = split(&both[..length]);
            // The file may end after the first chunk.
            assert_eq!(cut.is_ok(), length == 24, "{length}: {cut:?}");
        }
    }
}
