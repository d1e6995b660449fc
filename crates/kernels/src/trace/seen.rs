//! What a camera ray sees of a surface point, and its backward pass.

#[cfg(feature = "gpu")]
use crate::cube::*;

use super::pixel::Seen;
use super::scene::{EMITS, Scene};
use super::sums::Sums;
use super::surface::{Point, PointGradient};
use crate::model::{V3, splat};

/// Returns the radiance that a surface point emits toward the point that sees it.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn emitted(scene: &Scene, p: &Point) -> V3 {
    let mut emission = splat(0.0);
    if scene.bits_of(p.material) & EMITS != 0 {
        let cosine = -p.side * p.shading.geometric.dot(p.shading.incoming);
        emission = scene.emission_of(p.material, p.uv, cosine);
    }
    emission
}

/// Returns the albedo that a camera ray sees, in [0, 1]: the color of the BSDF plus the emission.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn albedo_of(scene: &Scene, p: &Point) -> V3 {
    let color = p.shading.albedo() + emitted(scene, p);
    color.max(splat(0.0)).min(splat(1.0))
}

/// Backward pass of the quantities that the camera sees of a surface point, for the upstream gradient: its emission,
/// with respect to the position too if it is textured, its normal, and its distance. Returns the derivative with
/// respect to the distance.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn seen_backward(
    scene: &Scene,
    sums: &Sums,
    p: &Point,
    upstream: &Seen,
    by: &mut PointGradient,
) -> f32 {
    if p.side > 0.0 && scene.bits_of(p.material) & EMITS != 0 {
        if scene.glows(p.material) {
            by.emission = upstream.radiance;
        } else {
            scene.emission_backward(sums, p.material, p.uv, upstream.radiance);
        }
    }
    by.geometric += upstream.normal;
    upstream.depth
}
