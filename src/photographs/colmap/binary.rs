//! The binary files of COLMAP: little-endian numbers without padding.

use std::path::Path;

use super::lens::{Lens, ModelName, Placed, model_of};
use crate::error::{Error, Result};
use crate::photographs::draft::finite;

/// The bytes of a file that are not yet read.
struct Bytes<'a> {
    file: &'a Path,
    rest: &'a [u8],
    length: usize,
}

impl<'a> Bytes<'a> {
    fn new(file: &'a Path, bytes: &'a [u8]) -> Self {
        Self {
            file,
            rest: bytes,
            length: bytes.len(),
        }
    }

    fn cut(&self, place: &str, what: &str) -> Error {
        let length = self.length;
        let message = format!("{place}: the file ends after {length} bytes within its {what}");
        Error::format(self.file, message)
    }

    /// Returns the next bytes.
    fn take<const N: usize>(&mut self, place: &str, what: &str) -> Result<[u8; N]> {
        let Some((bytes, rest)) = self.rest.split_first_chunk::<N>() else {
            return Err(self.cut(place, what));
        };
        self.rest = rest;
        Ok(*bytes)
    }

    fn float(&mut self, place: &str, what: &str) -> Result<f64> {
        Ok(f64::from_le_bytes(self.take(place, what)?))
    }

    fn floats<const N: usize>(&mut self, place: &str, what: &str) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.float(place, what)?;
        }
        Ok(numbers)
    }

    fn long(&mut self, place: &str, what: &str) -> Result<u64> {
        Ok(u64::from_le_bytes(self.take(place, what)?))
    }

    fn word(&mut self, place: &str, what: &str) -> Result<u32> {
        Ok(u32::from_le_bytes(self.take(place, what)?))
    }

    /// Returns a text that ends with a 0 byte.
    fn text(&mut self, place: &str, what: &str) -> Result<String> {
        let Some(end) = self.rest.iter().position(|&b| b == 0) else {
            return Err(self.cut(place, what));
        };
        let text = String::from_utf8_lossy(&self.rest[..end]).into_owned();
        self.rest = &self.rest[end + 1..];
        Ok(text)
    }

    /// Leaves out `count` entries of `size` bytes each.
    fn skip(&mut self, count: u64, size: u64, place: &str, what: &str) -> Result<()> {
        let bytes = count
            .checked_mul(size)
            .and_then(|n| usize::try_from(n).ok());
        let rest = bytes.and_then(|n| self.rest.get(n..));
        self.rest = rest.ok_or_else(|| self.cut(place, what))?;
        Ok(())
    }

    /// Checks that nothing is left.
    fn end(&self) -> Result<()> {
        match self.rest.len() {
            0 => Ok(()),
            n => {
                let message = format!("{n} bytes follow after its last entry, expected none");
                Err(Error::format(self.file, message))
            }
        }
    }
}

/// Reads `cameras.bin`: the cameras by their numbers.
pub(super) fn cameras(file: &Path, bytes: &[u8]) -> Result<Vec<(u32, Lens)>> {
    let mut bytes = Bytes::new(file, bytes);
    let count = bytes.long("cameras", "number of cameras")?;
    let mut cameras = Vec::new();
    for i in 0..count {
        let id = bytes.word(&format!("the camera at place {i}"), "number")?;
        let place = format!("camera {id}");
        let model = i32::from_le_bytes(bytes.take(&place, "model")?);
        let (model, parameters) = model_of(file, &place, ModelName::Number(model))?;
        let size = [bytes.long(&place, "width")?, bytes.long(&place, "height")?];
        let parameters = (0..parameters).map(|_| bytes.float(&place, "parameters"));
        let parameters = parameters.collect::<Result<_>>()?;
        cameras.push((
            id,
            Lens {
                model,
                size,
                parameters,
            },
        ));
    }
    bytes.end()?;
    Ok(cameras)
}

/// Reads `images.bin`: the images by their numbers.
pub(super) fn images(file: &Path, bytes: &[u8]) -> Result<Vec<(u32, Placed)>> {
    let mut bytes = Bytes::new(file, bytes);
    let count = bytes.long("images", "number of images")?;
    let mut images = Vec::new();
    for i in 0..count {
        let id = bytes.word(&format!("the image at place {i}"), "number")?;
        let place = format!("image {id}");
        let quaternion = bytes.floats(&place, "rotation")?;
        let translation = bytes.floats(&place, "translation")?;
        let camera = bytes.word(&place, "camera")?;
        let name = bytes.text(&place, "name")?;
        // Each has its place in the image and the number of its point.
        let features = bytes.long(&place, "number of features")?;
        bytes.skip(features, 24, &place, "features")?;
        images.push((
            id,
            Placed {
                quaternion,
                translation,
                camera,
                name,
            },
        ));
    }
    bytes.end()?;
    Ok(images)
}

/// Reads `points3D.bin`: the places of the points.
pub(super) fn points(file: &Path, bytes: &[u8]) -> Result<Vec<[f64; 3]>> {
    let mut bytes = Bytes::new(file, bytes);
    let count = bytes.long("points", "number of points")?;
    let mut points = Vec::new();
    for i in 0..count {
        let place = format!("the point at place {i}");
        bytes.long(&place, "number")?;
        let point = bytes.floats(&place, "coordinates")?;
        for value in point {
            finite(file, &place, "coordinate", value)?;
        }
        // Its color and error, and the features that show it.
        bytes.skip(1, 3 + 8, &place, "color and error")?;
        let track = bytes.long(&place, "number of features")?;
        bytes.skip(track, 8, &place, "features")?;
        points.push(point);
    }
    bytes.end()?;
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cut_files_are_named() {
        let file = Path::new("points3D.bin");
        let mut whole = 1u64.to_le_bytes().to_vec();
        whole.extend(7u64.to_le_bytes());
        for v in [1.0f64, 2.0, 3.0] {
            whole.extend(v.to_le_bytes());
        }
        whole.extend([0; 11]);
        whole.extend(1u64.to_le_bytes());
        whole.extend([0; 8]);
        assert_eq!(points(file, &whole).expect("points"), [[1.0, 2.0, 3.0]]);
        for length in 0..whole.len() {
            let error = points(file, &whole[..length]).expect_err("a cut file");
            let message = error.to_string();
            assert!(message.contains("points3D.bin") && message.contains("ends after"));
        }
        whole.push(0);
        let error = points(file, &whole)
            .expect_err("a byte too many")
            .to_string();
        assert!(error.contains("1 bytes follow"), "{error}");
    }

    #[test]
    fn numbers_that_are_too_large_take_no_memory() {
        let file = Path::new("images.bin");
        let error = images(file, &u64::MAX.to_le_bytes()).expect_err("no image");
        assert!(error.to_string().contains("the image at place 0"));
    }
}
