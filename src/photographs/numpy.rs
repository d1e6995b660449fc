//! Arrays of NumPy files.

use std::io::{Cursor, Read};
use std::path::Path;

use npyz::{Deserialize, NpyFile, Order};

use super::draft::finite;
use crate::error::{Error, Result};

/// The largest size of an array in an archive. Cameras take a few hundred bytes.
const MAX_BYTES: u64 = 1 << 24;

/// An array of numbers, the last axis fastest.
pub(super) struct Array {
    pub shape: Vec<usize>,
    pub values: Vec<f64>,
}

/// Reads the values of a file as numbers of a type. `None` if it has another type.
fn values_as<T: Deserialize + Into<f64>>(bytes: &[u8]) -> Option<std::io::Result<Vec<f64>>> {
    let npy = NpyFile::new(Cursor::new(bytes)).ok()?;
    let data = npy.try_data::<T>().ok()?;
    Some(data.map(|value| value.map(Into::into)).collect())
}

impl Array {
    /// Reads a `.npy` file. `place` names the array in messages.
    ///
    /// # Errors
    /// If the bytes are not one, it has no real numbers, or is not of one or two axes.
    pub fn parse(bytes: &[u8], path: &Path, place: &str) -> Result<Self> {
        let malformed = |message: String| Error::format(path, format!("{place}: {message}"));
        let npy = NpyFile::new(Cursor::new(bytes));
        let npy = npy.map_err(|e| malformed(format!("it is not a NumPy array: {e}")))?;
        let shape: Vec<usize> = npy.shape().iter().map(|&n| n as usize).collect();
        let count = shape.iter().try_fold(1usize, |all, &n| all.checked_mul(n));
        let count = count.filter(|&count| count <= bytes.len());
        let Some(count) = count.filter(|_| (1..=2).contains(&shape.len())) else {
            let message = format!(
                "its shape is {shape:?} in a file of {} bytes, expected one or two axes with all numbers in the file",
                bytes.len()
            );
            return Err(malformed(message));
        };
        let (order, kind) = (npy.order(), npy.dtype().descr());
        let read = values_as::<f64>(bytes).or_else(|| values_as::<f32>(bytes));
        let Some(read) = read else {
            return Err(malformed(format!(
                "its numbers are {kind}, expected floats"
            )));
        };
        let mut values = read.map_err(|e| malformed(format!("its numbers can't be read: {e}")))?;
        if values.len() != count {
            let message = format!("it has {} numbers, expected {count}", values.len());
            return Err(malformed(message));
        }
        if let (Order::Fortran, &[rows, columns]) = (order, &shape[..]) {
            let places = (0..count).map(|i| (i / columns) + (i % columns) * rows);
            values = places.map(|place| values[place]).collect();
        }
        for (i, &value) in values.iter().enumerate() {
            finite(path, place, &format!("value {i}"), value)?;
        }
        Ok(Self { shape, values })
    }
}

/// A `.npz` archive.
pub(super) struct Archive<'a> {
    zip: zip::ZipArchive<Cursor<&'a [u8]>>,
    path: &'a Path,
}

impl<'a> Archive<'a> {
    pub fn open(bytes: &'a [u8], path: &'a Path) -> Result<Self> {
        let zip = zip::ZipArchive::new(Cursor::new(bytes));
        let zip = zip.map_err(|e| Error::format(path, format!("it is not a .npz archive: {e}")))?;
        Ok(Self { zip, path })
    }

    /// Returns whether the archive has an array.
    pub fn has(&self, name: &str) -> bool {
        self.zip.index_for_name(&format!("{name}.npy")).is_some()
    }

    /// Reads the first three rows of a matrix `[4, 4]` or `[3, 4]`.
    pub fn rows(&mut self, name: &str) -> Result<[[f64; 4]; 3]> {
        let malformed = |message: String| Error::format(self.path, format!("{name}: {message}"));
        let entry = self.zip.by_name(&format!("{name}.npy"));
        let entry = entry.map_err(|e| malformed(format!("it is missing or can't be read: {e}")))?;
        let mut bytes = Vec::new();
        let read = entry.take(MAX_BYTES).read_to_end(&mut bytes);
        read.map_err(|e| malformed(format!("it can't be read: {e}")))?;
        let array = Array::parse(&bytes, self.path, name)?;
        if !matches!(array.shape[..], [3 | 4, 4]) {
            let message = format!("its shape is {:?}, expected [4, 4]", array.shape);
            return Err(malformed(message));
        }
        let row = |i: usize| [0, 1, 2, 3].map(|j| array.values[4 * i + j]);
        Ok([0, 1, 2].map(row))
    }
}

#[cfg(test)]
mod tests {
    use npyz::WriterBuilder;

    use super::*;

    fn written<T: npyz::AutoSerialize + Copy>(order: Order, values: &[T]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let options = npyz::WriteOptions::new().default_dtype().order(order);
        let writer = options.shape(&[2, 3]).writer(&mut bytes).begin_nd();
        let mut writer = writer.expect("a writer");
        writer.extend(values.iter().copied()).expect("values");
        writer.finish().expect("an array");
        bytes
    }

    #[test]
    fn types_and_orders() {
        let expected = [0.5, 1.0, 1.5, 2.0, 2.5, 3.0];
        let floats = written(Order::C, &expected.map(|v| v as f32));
        let columns = written(Order::Fortran, &[0.5, 2.0, 1.0, 2.5, 1.5, 3.0]);
        let path = Path::new("a.npy");
        for bytes in [floats, columns] {
            let array = Array::parse(&bytes, path, "poses").expect("an array");
            assert_eq!(
                (&array.shape[..], &array.values[..]),
                (&[2, 3][..], &expected[..])
            );
        }
        let bytes = written(Order::C, &expected);
        for length in 0..bytes.len() {
            let error = Array::parse(&bytes[..length], path, "poses").err();
            assert!(
                error
                    .expect("an error")
                    .to_string()
                    .contains("a.npy: poses: ")
            );
        }
        let error = Array::parse(&written(Order::C, &[true; 6]), path, "poses").err();
        assert!(
            error
                .expect("an error")
                .to_string()
                .contains("expected floats")
        );
    }
}
