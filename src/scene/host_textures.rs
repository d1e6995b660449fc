//! Textures and masks on the host. Each is read once, however many materials share it.

use std::collections::HashMap;
use std::sync::Arc;

use burn::tensor::Tensor;

use super::maps::AlphaMask;
use super::texture::Value;
use crate::error::{Error, Result};
use crate::geometry::{by_rows, place_of};
use softray_kernels::host::{HostTexture, Mask};

/// The images read so far, by the address and shape of their tensors. These tensors must outlive the cache.
#[derive(Default)]
pub(super) struct Shared {
    images: HashMap<(usize, [usize; 3]), Arc<Vec<f32>>>,
    numbers: HashMap<(usize, [usize; 2]), Arc<Vec<f32>>>,
    masks: HashMap<(usize, [usize; 2]), Arc<Vec<f32>>>,
}

/// Returns the cached values of a tensor, or reads and caches them.
fn once<const D: usize>(
    known: &mut HashMap<(usize, [usize; D]), Arc<Vec<f32>>>,
    tensor: &Tensor<D>,
    read: impl FnOnce() -> Result<Vec<f32>>,
) -> Result<Arc<Vec<f32>>> {
    let place = place_of(tensor);
    if let Some(found) = place.and_then(|place| known.get(&place)) {
        return Ok(found.clone());
    }
    let read = Arc::new(read()?);
    if let Some(place) = place {
        known.insert(place, read.clone());
    }
    Ok(read)
}

impl Shared {
    /// Reads a value back. A scalar is stored as the first of three numbers, and the others are 0.
    pub fn texture(&mut self, value: Value<'_>) -> Result<HostTexture> {
        let (texels, [height, width], wrap) = match value {
            Value::Color(p) => return Ok(HostTexture::Constant(p.values()?)),
            Value::Scalar(p) => return Ok(HostTexture::Constant([p.values()?[0], 0.0, 0.0])),
            Value::Image(image, wrap) => {
                let [height, width, channels] = image.dims();
                let texels = once(&mut self.images, image, || {
                    let mut texels = Vec::with_capacity(height * width * channels);
                    by_rows(image, |values| texels.extend_from_slice(values))?;
                    Ok(texels)
                })?;
                (texels, [height, width], wrap)
            }
            Value::ScalarImage(image, wrap) => {
                let [height, width] = image.dims();
                let texels = once(&mut self.numbers, image, || {
                    let mut texels = Vec::with_capacity(3 * height * width);
                    by_rows(image, |values| {
                        texels.extend(values.iter().flat_map(|&v| [v, 0.0, 0.0]));
                    })?;
                    Ok(texels)
                })?;
                (texels, [height, width], wrap)
            }
        };
        Ok(HostTexture::Image {
            texels,
            width,
            height,
            wrap,
        })
    }

    /// Reads a mask back. `material` returns the name of its material for error messages.
    pub fn mask(&mut self, mask: &AlphaMask, material: impl FnOnce() -> String) -> Result<Mask> {
        let [height, width] = mask.alpha.dims();
        let cutoff = mask.cutoff as f32;
        if !cutoff.is_finite() {
            let expected = "a finite number";
            return Err(Error::invalid(
                material(),
                "alpha cutoff",
                mask.cutoff,
                expected,
            ));
        }
        let alpha = once(&mut self.masks, &mask.alpha, || mask.numbers(&material()))?;
        Ok(Mask {
            alpha,
            size: [width, height],
            wrap: mask.wrap,
            cutoff,
        })
    }
}
