//! The header of a PLY file: its elements and their properties.

use crate::io::numbers::Kind;

/// The encoding of a file's values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Format {
    Ascii,
    LittleEndian,
    BigEndian,
}

fn kind(name: &str) -> Option<Kind> {
    Some(match name {
        "char" | "int8" => Kind::I8,
        "uchar" | "uint8" => Kind::U8,
        "short" | "int16" => Kind::I16,
        "ushort" | "uint16" => Kind::U16,
        "int" | "int32" => Kind::I32,
        "uint" | "uint32" => Kind::U32,
        "float" | "float32" => Kind::F32,
        "double" | "float64" => Kind::F64,
        _ => return None,
    })
}

/// A property of an element: a scalar or a list in each row.
#[derive(Debug, PartialEq)]
pub(super) struct Property {
    pub name: String,
    pub kind: Kind,
    /// The type of a list's length; `None` for a scalar.
    pub list: Option<Kind>,
}

/// An element: rows with the same properties.
#[derive(Debug, PartialEq)]
pub(super) struct Element {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
}

impl Element {
    /// Returns the index of the scalar property with the first of `names` that exists.
    pub fn scalar(&self, names: &[&str]) -> Option<usize> {
        self.find(names, false)
    }

    /// Returns the index of the list property with the first of `names` that exists.
    pub fn list(&self, names: &[&str]) -> Option<usize> {
        self.find(names, true)
    }

    fn find(&self, names: &[&str], list: bool) -> Option<usize> {
        names.iter().find_map(|name| {
            let mut all = self.properties.iter();
            all.position(|p| p.list.is_some() == list && p.name == *name)
        })
    }

    /// Returns the least number of bytes that the rows take.
    pub fn least_bytes(&self, format: Format) -> u128 {
        let of = |p: &Property| match format {
            // A digit and a space.
            Format::Ascii => 2,
            _ => p.list.unwrap_or(p.kind).size() as u128,
        };
        u128::from(self.count) * self.properties.iter().map(of).sum::<u128>()
    }
}

/// The header of a file.
#[derive(Debug, PartialEq)]
pub(super) struct Header {
    pub format: Format,
    pub elements: Vec<Element>,
    /// Texture files from `TextureFile` comments, which MeshLab and other programs write.
    pub textures: Vec<String>,
    /// The offset of the first byte after the header.
    pub end: usize,
}

impl Header {
    /// Parses the first lines of a file up to `end_header`. An error reports the line number.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        let (mut format, mut elements, mut textures) = (None, Vec::<Element>::new(), Vec::new());
        let mut end = 0;
        for number in 1.. {
            let rest = &bytes[end..];
            let length = rest.iter().position(|&b| b == b'\n');
            let Some(length) = length else {
                return Err(match number {
                    1 => "it is no PLY file: it has no lines".into(),
                    _ => "its header does not end with \"end_header\"".into(),
                });
            };
            end += length + 1;
            let line = String::from_utf8_lossy(&rest[..length]);
            let fail = |message: String| Err(format!("line {number}: {message}"));
            let words: Vec<&str> = line.split_whitespace().collect();
            match words.as_slice() {
                ["ply"] if number == 1 => {}
                _ if number == 1 => {
                    return fail("it is no PLY file, which begins with \"ply\"".into());
                }
                ["end_header"] => break,
                ["format", name, _version] => {
                    format = Some(match *name {
                        "ascii" => Format::Ascii,
                        "binary_little_endian" => Format::LittleEndian,
                        "binary_big_endian" => Format::BigEndian,
                        _ => return fail(format!("the format {name:?} is not known")),
                    });
                }
                ["comment", "TextureFile", ..] => {
                    let name = line.split_once("TextureFile").map_or("", |(_, name)| name);
                    textures.push(name.trim().to_owned());
                }
                ["element", name, count] => {
                    let Ok(count) = count.parse() else {
                        return fail(format!("element {name} has the count {count:?}"));
                    };
                    elements.push(Element {
                        name: (*name).into(),
                        count,
                        properties: Vec::new(),
                    });
                }
                ["property", rest @ ..] => {
                    let Some(element) = elements.last_mut() else {
                        return fail("a property comes before any element".into());
                    };
                    match property(rest) {
                        Some(property) => element.properties.push(property),
                        None => return fail(format!("{line:?} is no property with a known type")),
                    }
                }
                [] | ["comment" | "obj_info", ..] => {}
                _ => return fail(format!("{:?} is not known", line.trim())),
            }
        }
        let format = format.ok_or("its header has no format")?;
        Ok(Self {
            format,
            elements,
            textures,
            end,
        })
    }
}

fn property(words: &[&str]) -> Option<Property> {
    let (list, of, name) = match words {
        ["list", count, of, name] => (Some(kind(count)?), of, name),
        [of, name] => (None, of, name),
        _ => return None,
    };
    Some(Property {
        name: (*name).into(),
        kind: kind(of)?,
        list,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_of_any_line_ending() {
        let lines = [
            "ply",
            "format ascii 1.0",
            "comment TextureFile oak wood.png",
            "element vertex 3",
            "property float32 x",
            "element face 1",
            "property list uchar int vertex_indices",
            "end_header",
            "0 0 0",
        ];
        for end in ["\n", "\r\n"] {
            let text = lines.join(end);
            let header = Header::parse(text.as_bytes()).expect("a header");
            assert_eq!(&text[header.end..], "0 0 0");
            assert_eq!(header.textures, ["oak wood.png"]);
            assert_eq!(header.elements[0].scalar(&["u", "x"]), Some(0));
            assert_eq!(header.elements[1].list(&["vertex_indices"]), Some(0));
            assert_eq!(header.elements[1].scalar(&["vertex_indices"]), None);
        }
    }
}
