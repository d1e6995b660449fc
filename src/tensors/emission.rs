//! The emission of materials, in tensors.

use burn::tensor::{Int, Tensor};

use super::surface::look_up;
use crate::error::Result;
use crate::geometry::{Vec3, detached};
use crate::scene::Flattened;
use softray_kernels::host::Channel;

/// Returns the emission of materials at texture coordinates `uv`. `cosine` is the cosine to the normal of the front.
/// From behind, the emission is 0.
pub(super) fn emission(
    scene: &Flattened,
    materials: &[u32],
    index: &Tensor<2, Int>,
    uv: &Option<[Tensor<2>; 2]>,
    cosine: &Tensor<2>,
) -> Result<Vec3> {
    let channel = scene.materials.channel(Channel::Emission.place());
    let front = look_up(&scene.context, channel, materials, index, uv)?;
    let behind = detached(cosine).lower_equal_elem(0.0);
    Ok(front.map(|x| x.mask_fill(behind.clone(), 0.0)))
}
