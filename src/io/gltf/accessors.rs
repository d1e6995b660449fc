//! Arrays of numbers, read where they lie in their buffers (glTF 2.0, section 3.6.2): an array takes no memory,
//! whatever it claims to hold.

use bytes::Bytes;

use super::Document;
use super::schema::Sparse as SparseJson;
use crate::error::Result;
use crate::io::numbers::Kind;

/// The kind of OpenGL's number.
fn kind(number: u32) -> Option<Kind> {
    Some(match number {
        5120 => Kind::I8,
        5121 => Kind::U8,
        5122 => Kind::I16,
        5123 => Kind::U16,
        5125 => Kind::U32,
        5126 => Kind::F32,
        _ => return None,
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
    /// None where all is 0.
    base: Option<Strided>,
    sparse: Option<Sparse>,
}

/// Rows at equal distances.
struct Strided {
    bytes: Bytes,
    stride: usize,
}

/// Rows that differ from the base, by increasing number.
struct Sparse {
    count: usize,
    index: Kind,
    indices: Strided,
    values: Strided,
}

impl Document<'_> {
    /// The bytes of a buffer's view.
    pub fn view(&self, index: usize, place: &str) -> Result<Bytes> {
        let view = self.get(&self.root.buffer_views, index, place, "bufferViews")?;
        let name = format!("bufferViews[{index}]");
        let field = format!("{name}.buffer");
        // Of the buffers that were read there are as many as the file has.
        let _ = self.get(&self.root.buffers, view.buffer, &field, "buffers")?;
        let bytes = &self.buffers[view.buffer];
        let offset = view.byte_offset;
        let end = offset.checked_add(view.byte_length);
        let length = bytes.len();
        match end.filter(|&end| end <= length as u64) {
            Some(end) => Ok(bytes.slice(offset as usize..end as usize)),
            None => {
                let message = format!(
                    "ends after byte {} of buffers[{}], which has {length}",
                    u128::from(offset) + u128::from(view.byte_length),
                    view.buffer
                );
                Err(self.fail(name, message))
            }
        }
    }

    /// An accessor all of whose rows lie in their views.
    pub fn accessor(&self, index: usize, place: &str) -> Result<Accessor> {
        let json = self.get(&self.root.accessors, index, place, "accessors")?;
        let name = format!("accessors[{index}]");
        let component = self.component(json.component_type, &name)?;
        let width = match json.kind.as_str() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            kind => {
                let message = format!("is {kind:?}, expected SCALAR, VEC2, VEC3 or VEC4");
                return Err(self.fail(format!("{name}.type"), message));
            }
        };
        let size = width * component.size();
        let claimed = json.count;
        let base = match json.buffer_view {
            Some(view) => {
                let stride = self.stride(view, size, &name)?;
                let shape = [claimed, size as u64, stride];
                Some(self.strided(view, json.byte_offset, shape, &name)?)
            }
            None => {
                // Rows of zeros that nothing stands for: not more than the file has bytes.
                let most: usize = self.buffers.iter().map(|b| b.len()).sum();
                let message = format_args!("is {claimed} without a bufferView in {most} bytes");
                let valid = claimed <= most as u64;
                self.unless(valid, format_args!("{name}.count"), message)?;
                None
            }
        };
        let sparse = json.sparse.as_ref().map(|s| self.sparse(s, size, &name));
        Ok(Accessor {
            count: claimed as usize,
            width,
            component,
            normalized: json.normalized,
            base,
            sparse: sparse.transpose()?,
        })
    }

    fn component(&self, number: u32, name: &str) -> Result<Kind> {
        let expected = "expected 5120 to 5123, 5125 or 5126";
        let unknown = || format!("is {number}, {expected}");
        kind(number).ok_or_else(|| self.fail(format!("{name}.componentType"), unknown()))
    }

    fn sparse(&self, json: &SparseJson, size: usize, name: &str) -> Result<Sparse> {
        let (count, size) = (json.count, size as u64);
        let (indices, values) = (&json.indices, &json.values);
        let field = format!("{name}.sparse.indices");
        let index = self.component(indices.component_type, &field)?;
        let wide = index.size() as u64;
        let (view, offset) = (indices.buffer_view, indices.byte_offset);
        let at = self.strided(view, offset, [count, wide, wide], &field)?;
        let field = format!("{name}.sparse.values");
        let (view, offset) = (values.buffer_view, values.byte_offset);
        let values = self.strided(view, offset, [count, size, size], &field)?;
        Ok(Sparse {
            count: count as usize,
            index,
            indices: at,
            values,
        })
    }

    /// The distance between rows of a size.
    fn stride(&self, view: usize, size: usize, name: &str) -> Result<u64> {
        let field = format!("{name}.bufferView");
        let json = self.get(&self.root.buffer_views, view, field, "bufferViews")?;
        // Some files say 0 for rows without gaps.
        let given = json.byte_stride.filter(|&s| s > 0);
        let stride = given.unwrap_or(size);
        let place = format_args!("bufferViews[{view}].byteStride");
        let message =
            format_args!("is {stride}, but a row of accessors that use it has {size} bytes");
        self.unless(stride >= size, place, message)?;
        Ok(stride as u64)
    }

    /// Rows of a view: a number of them, their size and their distance.
    fn strided(
        &self,
        view: usize,
        offset: u64,
        [count, size, stride]: [u64; 3],
        name: &str,
    ) -> Result<Strided> {
        let bytes = self.view(view, &format!("{name}.bufferView"))?;
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
                    "has {count} rows of {size} bytes from byte {} on, more than bufferViews[{view}] \
                     holds in {length} bytes",
                    offset
                );
                Err(self.fail(name, message))
            }
        }
    }
}

impl Accessor {
    /// A row's first numbers, 0 where it has fewer.
    pub fn row<const N: usize>(&self, row: usize) -> [f64; N] {
        let place = self.place(row);
        std::array::from_fn(|i| match place {
            Some(bytes) if i < self.width => self.number(bytes, i),
            _ => 0.0,
        })
    }

    /// A row's first number as it is.
    pub fn index(&self, row: usize) -> u32 {
        self.place(row)
            .map_or(0, |bytes| self.component.number(bytes) as u32)
    }

    /// Whether its numbers may be indices.
    pub fn is_index(&self) -> bool {
        use Kind::{U8, U16, U32};
        self.width == 1 && matches!(self.component, U8 | U16 | U32)
    }

    /// The bytes of a row, None where it is 0.
    fn place(&self, row: usize) -> Option<&[u8]> {
        let replaced = self.sparse.as_ref().and_then(|s| Some((s, s.find(row)?)));
        let (from, row) = match replaced {
            Some((sparse, at)) => (&sparse.values, at),
            None => (self.base.as_ref()?, row),
        };
        from.bytes.get(row * from.stride..)
    }

    /// A number of a row: integers that are normalised stand for [0, 1] or [−1, 1].
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
    /// Where the values of a row stand, if it differs from the base.
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
