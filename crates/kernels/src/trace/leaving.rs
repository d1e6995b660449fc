//! The ray with which a path leaves a surface point, and its backward pass.

use crate::cube::*;

use super::scene::{CONE, Scene};
use super::sums::Sums;
use super::surface::{Point, PointGradient, RayGradient};
use super::texture::{sky, sky_backward};
use crate::model::bsdf::{Scatter, Turning};
use crate::model::choice::survival;
use crate::model::cone::{Bend, bend, bend_backward, lifted};
use crate::model::{V3, splat};

/// A ray with which a path leaves a surface point.
#[apply(zeroed!)]
pub struct Leaving {
    /// Whether the path continues.
    pub goes_on: bool,
    pub start: V3,
    pub bend: Bend,
    pub throughput: V3,
    /// Survival probability of the path.
    pub survival: f32,
}

/// Makes the ray that leaves a surface point in a sampled direction after `bounce` bounces. `u` is the uniform number
/// for Russian roulette, `cone_u` and `cone_v` are those for the cone.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn leave(
    scene: &Scene,
    p: &Point,
    scatter: &Scatter,
    throughput: V3,
    bounce: u32,
    u: f32,
    cone_u: f32,
    cone_v: f32,
) -> Leaving {
    let mut left = leave_sharply(p, scatter, throughput);
    if comptime!(scene.features.roulette) {
        if bounce < scene.bounces && bounce >= scene.roulette_after {
            left.survival = survival(left.throughput);
            left.goes_on = select(u >= left.survival, false, left.goes_on);
            left.throughput = left.throughput * (1.0 / left.survival);
        }
    }
    if comptime!(scene.features.cones) {
        let direction = scatter.direction;
        let outer = p.shading.outer(direction);
        left.bend = bend(direction, outer, scene.settings[CONE], cone_u, cone_v);
    }
    left
}

/// Makes the ray that leaves a surface point in exactly the sampled direction, without Russian roulette or cone.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn leave_sharply(p: &Point, scatter: &Scatter, throughput: V3) -> Leaving {
    let direction = scatter.direction;
    Leaving {
        goes_on: !scatter.weight.is_zero(),
        start: lifted(p.position, p.shading.outer(direction)),
        bend: Bend {
            offset: splat(0.0),
            mirrored: false.runtime(),
            direction,
        },
        throughput: throughput.times(scatter.weight),
        survival: 1.0f32.runtime(),
    }
}

/// Backward pass of a ray that left a surface point, and of the environment's light if the ray `escaped`. Turns
/// derivatives with respect to the throughput after the point and to the ray into those with respect to the point.
/// Returns the derivative with respect to the throughput before the point.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn leave_backward(
    scene: &Scene,
    sums: &Sums,
    p: &Point,
    scatter: &Scatter,
    bent: &Bend,
    survival: f32,
    escaped: bool,
    throughput: V3,
    by_throughput: V3,
    by_ray: RayGradient,
    g: V3,
    by: &mut PointGradient,
) -> V3 {
    by.position += by_ray.origin;
    let mut by_direction = by_ray.direction;
    let mut by_after = by_throughput;
    if escaped {
        let after = throughput.times(scatter.weight) * (1.0 / survival);
        by_after += g.times(sky(scene, bent.direction));
        by_direction += sky_backward(scene, sums, bent.direction, g.times(after));
    }
    let by_survivor = by_after * (1.0 / survival);
    let geometric = p.shading.geometric;
    let by_axis = bend_backward(
        bent,
        scatter.direction,
        geometric,
        by_direction,
        &mut by.geometric,
    );
    let by_weight = by_survivor.times(throughput);
    let mut turning: Turning = scene.turning(&p.shading, scatter.direction, scatter.of_gloss);
    let left = 1.0 - by_ray.share;
    turning.by_direction = turning.by_direction * left - by_ray.by_share * turning.part;
    turning.part *= left;
    let of_parameters = comptime!(sums.of.materials || scene.features.textured);
    (p.shading).sample_backward(
        scatter,
        by_weight,
        by_axis,
        &turning,
        of_parameters,
        &mut by.shading,
    );
    by_survivor.times(scatter.weight)
}
