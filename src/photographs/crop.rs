//! Crops about objects.

use super::camera::Window;
use super::photograph::Photograph;
use crate::error::{Error, Result};

/// The value of a mask above which a pixel shows the object.
const SHOWN: f32 = 0.02;

/// Crops photographs of any sizes to windows of the same size about their masks, each with at least `margin` pixels around
/// its object where the photograph has them: a batch of renders has one size, and pixels without the object cost time.
///
/// # Errors
/// If a mask is empty, or the common window is larger than a photograph.
pub fn crop_to_masks(photographs: &[Photograph], margin: usize) -> Result<Vec<Photograph>> {
    let boxes: Vec<[[usize; 2]; 2]> = photographs.iter().map(shown).collect::<Result<_>>()?;
    let widest = |axis: usize| {
        let widths = boxes
            .iter()
            .map(|b| b[axis][1] - b[axis][0] + 2 * margin)
            .max();
        let limit = photographs.iter().map(|p| p.camera.size[axis]).max();
        widths.unwrap_or(0).min(limit.unwrap_or(0))
    };
    let size = [widest(0), widest(1)];
    let cropped = |(photograph, shown): (&Photograph, &[[usize; 2]; 2])| {
        let start = [0, 1].map(|axis| {
            let middle = (shown[axis][0] + shown[axis][1]) / 2;
            let last = photograph.camera.size[axis].saturating_sub(size[axis]);
            middle.saturating_sub(size[axis] / 2).min(last)
        });
        photograph.cropped(Window { start, size })
    };
    photographs.iter().zip(&boxes).map(cropped).collect()
}

/// Returns the first and the past-the-end column and row of the object.
fn shown(photograph: &Photograph) -> Result<[[usize; 2]; 2]> {
    let width = photograph.camera.size[0];
    let mut found = [[usize::MAX, 0]; 2];
    let pixels = photograph.mask.iter().enumerate();
    for (i, _) in pixels.filter(|(_, mask)| **mask > SHOWN) {
        for (range, at) in found.iter_mut().zip([i % width, i / width]) {
            *range = [range[0].min(at), range[1].max(at + 1)];
        }
    }
    let name = format!("photograph {:?}", photograph.name);
    let some = found[0][1] > 0;
    Error::unless(
        some,
        &name,
        "mask",
        "0 everywhere",
        "some pixels of the object",
    )?;
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photographs::{PhotographOptions, Photographs};

    /// All windows have the same size, contain their masks, and keep the rays of their pixels.
    #[test]
    fn windows_are_alike_and_contain_masks() {
        let set = Photographs::open("tests/data/photographs").expect("the set");
        let options = PhotographOptions::new().with_longest_side(40);
        let all = set.load(&[0, 8, 32], &options).expect("photographs");
        let all = all.photographs;
        let crops = crop_to_masks(&all, 2).expect("crops");
        let sum = |mask: &[f32]| mask.iter().filter(|m| **m > SHOWN).count();
        for (whole, crop) in all.iter().zip(&crops) {
            assert_eq!(crop.camera.size, crops[0].camera.size);
            assert!(crop.mask.len() < whole.mask.len());
            assert_eq!(sum(&crop.mask), sum(&whole.mask));
            let shift = [0, 1].map(|i| whole.camera.principal[i] - crop.camera.principal[i]);
            let ray = whole.camera.ray([3.5 + shift[0], 4.5 + shift[1]]);
            assert_eq!(crop.camera.ray([3.5, 4.5]), ray);
        }
        let mut empty = all;
        empty[1].mask.fill(0.0);
        let error = crop_to_masks(&empty, 2).expect_err("no object");
        assert!(error.to_string().contains("008"), "{error}");
    }
}
