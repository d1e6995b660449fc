//! Accumulation of derivatives: in f64 on the host, in [`Totals`](super::Totals) on a GPU.

use std::cell::Cell;

use super::Derivatives;
use super::parts::{CAMERAS, LIGHTS, OF_LIGHT};
use super::scene::Scene;
#[cfg(feature = "gpu")]
use super::totals::{Totals, TotalsExpand};
use crate::cube::*;
use crate::model::V3;
use crate::model::camera::CameraGradient;
use crate::model::delta_light::DeltaGradient;

/// The sums that derivatives are added to, and which derivatives are requested.
#[derive(Clone, Copy)]
pub(crate) struct Sums<'a> {
    numbers: &'a [Cell<f64>],
    /// Index of the first sum of each part.
    first: &'a [u32],
    pub of: Derivatives,
}

/// In kernels this type stands for [`Totals`], which has the same methods and field; [`sums_of`] converts.
#[cfg(feature = "gpu")]
impl<'a> CubeType for Sums<'a> {
    type ExpandType = TotalsExpand<'a>;
}

impl<'a> Sums<'a> {
    pub fn new(numbers: &'a mut [f64], first: &'a [u32], of: Derivatives) -> Self {
        Self {
            numbers: Cell::from_mut(numbers).as_slice_of_cells(),
            first,
            of,
        }
    }

    /// Adds a derivative to a sum of a part.
    #[inline(always)]
    pub fn add(&self, at: u32, value: f32, part: u32) {
        let to = &self.numbers[(self.first[part as usize] + at) as usize];
        to.set(to.get() + f64::from(value));
    }

    /// Adds a vector of three derivatives.
    #[inline(always)]
    pub fn add_vector(&self, at: u32, value: V3, part: u32) {
        let first = (self.first[part as usize] + at) as usize;
        let to = &self.numbers[first..first + 3];
        to[0].set(to[0].get() + f64::from(value.x));
        to[1].set(to[1].get() + f64::from(value.y));
        to[2].set(to[2].get() + f64::from(value.z));
    }
}

/// Converts the sums of a kernel to the type that stages add to.
#[cfg(feature = "gpu")]
#[cube]
#[allow(unused_variables)]
pub(crate) fn sums_of<'a>(totals: Totals<'a>) -> Sums<'a> {
    intrinsic!(|_| totals)
}

/// Adds the derivatives with respect to delta light `k` if they are requested; `g` is the one with respect to its
/// strength.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(crate) fn add_to_light(scene: &Scene, sums: &Sums, k: u32, by: &DeltaGradient, g: V3) {
    let light = k - scene.emissive_count;
    if comptime!(sums.of.lights) && scene.wanted_lights[light as usize] != 0 {
        let first = OF_LIGHT * light;
        sums.add_vector(first, by.position, LIGHTS);
        sums.add_vector(first + 3, by.axis, LIGHTS);
        sums.add_vector(first + 6, g, LIGHTS);
        sums.add(first + 9, by.cos_inner, LIGHTS);
        sums.add(first + 10, by.cos_outer, LIGHTS);
    }
}

/// Adds the derivatives with respect to the camera.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(crate) fn add_to_camera(sums: &Sums, by: &CameraGradient) {
    sums.add_vector(0u32, by.eye, CAMERAS);
    sums.add_vector(3u32, by.across, CAMERAS);
    sums.add_vector(6u32, by.upward, CAMERAS);
    sums.add_vector(9u32, by.forward, CAMERAS);
    sums.add_vector(12u32, by.lens.first, CAMERAS);
    sums.add_vector(15u32, by.lens.second, CAMERAS);
    sums.add(18u32, by.per_focus, CAMERAS);
    sums.add(19u32, by.filter, CAMERAS);
}
