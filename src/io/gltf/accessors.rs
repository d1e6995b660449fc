//! Arrays of numbers, read in place from their buffers (glTF 2.0, section 3.6.2). An array takes no memory, whatever
//! size it declares.

use bytes::Bytes;

use super::Document;
use super::fields::Fields;
use crate::error::Result;
use crate::io::numbers::Kind;

/// Returns the type of an array's numbers, which the file gives as an OpenGL constant.
fn component(json: &Fields) -> Result<Kind> {
    let path = "componentType";
    Ok(match json.required(path)? {
        5120 => Kind::I8,
        5121 => Kind::U8,
        5122 => Kind::I16,
        5123 => Kind::U16,
        5125 => Kind::U32,
        5126 => Kind::F32,
        other => {
            let message = format!("is {other}, expected 5120 to 5123, 5125 or 5126");
            return Err(json.document.fail(json.at(path), message));
        }
    })
}

/// Rows of numbers.
pub(super) struct Accessor {
    /// The number of rows.
    pub count: usize,
    /// Numbers in a row.
    pub width: usize,
    component: Kind,
    normalized: bool,
    /// `None` if all numbers are 0.
    base: Option<Strided>,
    sparse: Option<Sparse>,
}

/// Rows with a constant stride.
struct Strided {
    bytes: Bytes,
    stride: usize,
}

/// Rows that differ from the base, in order of their indices.
struct Sparse {
    count: usize,
    index: Kind,
    indices: Strided,
    values: Strided,
}

impl Document<'_> {
    /// Returns the bytes of a buffer view.
    pub fn view(&self, index: usize, place: &str) -> Result<Bytes> {
        let json = self.fields(&self.root.buffer_views, index, place, "bufferViews")?;
        let buffer = json.required("buffer")?;
        let bytes = self.get(&self.buffers, buffer, json.at("buffer"), "buffers")?;
        let offset: u64 = json.get("byteOffset")?.unwrap_or(0);
        let claimed: u64 = json.required("byteLength")?;
        let end = offset.checked_add(claimed);
        let length = bytes.len();
        match end.filter(|&end| end <= length as u64) {
            Some(end) => Ok(bytes.slice(offset as usize..end as usize)),
            None => {
                let message = format!(
                    "ends after byte {} of buffers[{buffer}], which has {length}",
                    u128::from(offset) + u128::from(claimed),
                );
                Err(self.fail(json.place, message))
            }
        }
    }

    /// Returns an accessor. Rows that do not lie in their views are an error.
    pub fn accessor(&self, index: usize, place: &str) -> Result<Accessor> {
        let json = self.fields(&self.root.accessors, index, place, "accessors")?;
        let component = component(&json)?;
        let width = match json.required("type")? {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            kind => {
                let message = format!("is {kind:?}, expected SCALAR, VEC2, VEC3 or VEC4");
                return Err(self.fail(json.at("type"), message));
            }
        };
        let size = width * component.size();
        let claimed: u64 = json.required("count")?;
        let base = match json.get("bufferView")? {
            Some(view) => {
                let stride = self.stride(view, size, json.at("bufferView"))?;
                Some(self.strided(&json, [claimed, size as u64, stride])?)
            }
            None => {
                // Rows of zeros have no data. Their number must not exceed the bytes of the buffers.
                let most: usize = self.buffers.iter().map(|b| b.len()).sum();
                let message = format_args!("is {claimed} without a bufferView in {most} bytes");
                let valid = claimed <= most as u64;
                self.unless(valid, json.at("count"), message)?;
                None
            }
        };
        Ok(Accessor {
            count: claimed as usize,
            width,
            component,
            normalized: json.get("normalized")?.unwrap_or(false),
            base,
            sparse: self.sparse(&json.within("sparse")?, size as u64)?,
        })
    }

    fn sparse(&self, json: &Fields, size: u64) -> Result<Option<Sparse>> {
        if json.json.is_null() {
            return Ok(None);
        }
        let count: u64 = json.required("count")?;
        let (indices, values) = (json.within("indices")?, json.within("values")?);
        let index = component(&indices)?;
        let wide = index.size() as u64;
        Ok(Some(Sparse {
            count: count as usize,
            index,
            indices: self.strided(&indices, [count, wide, wide])?,
            values: self.strided(&values, [count, size, size])?,
        }))
    }

    /// Returns the stride of rows of `size` bytes.
    fn stride(&self, view: usize, size: usize, place: String) -> Result<u64> {
        let json = self.fields(&self.root.buffer_views, view, place, "bufferViews")?;
        // Some files set 0 for rows without gaps.
        let given = json.get("byteStride")?.filter(|&s| s > 0);
        let stride = given.unwrap_or(size);
        let message =
            format_args!("is {stride}, but a row of accessors that use it has {size} bytes");
        self.unless(stride >= size, json.at("byteStride"), message)?;
        Ok(stride as u64)
    }

    /// Returns rows in the view of an object, by their count, size and stride.
    fn strided(&self, json: &Fields, [count, size, stride]: [u64; 3]) -> Result<Strided> {
        let view = json.required("bufferView")?;
        let bytes = self.view(view, &json.at("bufferView"))?;
        let offset: u64 = json.get("byteOffset")?.unwrap_or(0);
        let end = match count {
            0 => Some(0),
            _ => (count - 1).checked_mul(stride).and_then(|last| {
                let end = last.checked_add(size)?;
                end.checked_add(offset)
            }),
        };
        match end.filter(|&end| end <= bytes.len() as u64) {
            Some(0) => Ok(Strided {
                bytes: Bytes::new(),
                stride: 0,
            }),
            Some(end) => Ok(Strided {
                bytes: bytes.slice(offset as usize..end as usize),
                stride: stride as usize,
            }),
            None => {
                let length = bytes.len();
                let message = format!(
                    "has {count} rows of {size} bytes from byte {offset} on, more than \
                     bufferViews[{view}] holds in {length} bytes"
                );
                Err(self.fail(&json.place, message))
            }
        }
    }
}

impl Accessor {
    /// Returns the first numbers of a row, padded with 0.
    pub fn row<const N: usize>(&self, row: usize) -> [f64; N] {
        let place = self.place(row);
        std::array::from_fn(|i| match place {
            Some(bytes) if i < self.width => self.number(bytes, i),
            _ => 0.0,
        })
    }

    /// Returns the first number of a row as an integer.
    pub fn index(&self, row: usize) -> u32 {
        self.place(row)
            .map_or(0, |bytes| self.component.number(bytes) as u32)
    }

    /// Returns whether the numbers can be indices.
    pub fn is_index(&self) -> bool {
        use Kind::{U8, U16, U32};
        self.width == 1 && matches!(self.component, U8 | U16 | U32)
    }

    /// Returns the bytes of a row, `None` if the row is 0.
    fn place(&self, row: usize) -> Option<&[u8]> {
        let replaced = self.sparse.as_ref().and_then(|s| Some((s, s.find(row)?)));
        let (from, row) = match replaced {
            Some((sparse, at)) => (&sparse.values, at),
            None => (self.base.as_ref()?, row),
        };
        from.bytes.get(row * from.stride..)
    }

    /// Returns a number of a row. Normalized integers are scaled to [0, 1] or [−1, 1].
    fn number(&self, row: &[u8], i: usize) -> f64 {
        let kind = self.component;
        let value = kind.number(row.get(i * kind.size()..).unwrap_or(&[]));
        match self.normalized && kind != Kind::F32 {
            true => (value / kind.one()).max(-1.0),
            false => value,
        }
    }
}

impl Sparse {
    /// Returns the position of a row's values, if the row differs from the base.
    fn find(&self, row: usize) -> Option<usize> {
        let at = |i: usize| {
            let bytes = self.indices.bytes.get(i * self.indices.stride..);
            self.index.number(bytes.unwrap_or(&[])) as usize
        };
        let (mut low, mut high) = (0, self.count);
        while low < high {
            let middle = low + (high - low) / 2;
            match at(middle).cmp(&row) {
                std::cmp::Ordering::Less => low = middle + 1,
                std::cmp::Ordering::Equal => return Some(middle),
                std::cmp::Ordering::Greater => high = middle,
            }
        }
        None
    }
}
