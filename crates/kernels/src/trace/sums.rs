//! Accumulation of derivatives: in f64 on the host, in [`Totals`](super::Totals) on a GPU.
//!
//! In forward mode the stages are the same: a derivative with respect to a parameter is multiplied by the parameter's
//! tangents as soon as it is added, and the products are sums of the pixel.

use std::cell::Cell;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::Derivatives;
use super::parts::{CAMERAS, LIGHTS, OF_LIGHT};
use super::pixel::Seen;
use super::scene::Scene;
#[cfg(feature = "gpu")]
use super::totals::{Totals, TotalsExpand};
use crate::cube::*;
use crate::model::V3;
use crate::model::camera::CameraGradient;
use crate::model::delta_light::DeltaGradient;

/// The sums that derivatives are added to, and which derivatives are requested.
#[derive(Clone, Copy)]
pub struct Sums<'a> {
    numbers: &'a [Cell<f64>],
    /// Index of the first sum of each part.
    first: &'a [u32],
    pub of: Derivatives,
    forward: Option<Forward<'a>>,
}

/// The sums of forward mode.
#[derive(Clone, Copy)]
struct Forward<'a> {
    tangents: &'a SumTangents,
    /// The first pixel that has sums, and the place of the sums of the current pixel and channel.
    first_pixel: u32,
    at: &'a AtomicUsize,
}

/// What forward mode multiplies with derivatives with respect to the sums' parameters.
pub struct SumTangents {
    /// The number of directions, `K`.
    pub directions: usize,
    /// One entry for each sum and direction, `[S, K]`.
    pub values: Vec<f64>,
    /// The channels of a pixel: each is 1 in one of the outputs.
    pub channels: Vec<Seen>,
}

impl SumTangents {
    /// Returns the number of sums of a channel: its derivatives, and its value.
    pub fn of_channel(&self) -> usize {
        self.directions + 1
    }

    /// Returns the number of sums of a pixel.
    pub fn of_pixel(&self) -> usize {
        self.channels.len() * self.of_channel()
    }
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
            forward: None,
        }
    }

    /// Makes these the sums `[P, C, K + 1]` of the pixels from `first_pixel` on.
    /// `at` stores the place of the current sums.
    pub fn forward(self, tangents: &'a SumTangents, first_pixel: u32, at: &'a AtomicUsize) -> Self {
        let forward = Some(Forward {
            tangents,
            first_pixel,
            at,
        });
        Self { forward, ..self }
    }

    /// The number of backward passes over the same paths: one for a loss, and in forward mode one for each channel.
    #[inline(always)]
    pub fn channels(&self) -> usize {
        match &self.forward {
            None => 1,
            Some(forward) => forward.tangents.channels.len(),
        }
    }

    /// In forward mode, what is added from now on belongs to a channel of a pixel.
    #[inline(always)]
    pub fn select(&self, pixel: u32, channel: usize) {
        if let Some(forward) = &self.forward {
            let own = (pixel - forward.first_pixel) as usize;
            let channels = own * forward.tangents.channels.len() + channel;
            let at = channels * forward.tangents.of_channel();
            forward.at.store(at, Ordering::Relaxed);
        }
    }

    /// Returns the part of an upstream gradient that belongs to a channel.
    #[inline(always)]
    pub fn of_channel(&self, upstream: &Seen, channel: usize) -> Seen {
        match &self.forward {
            None => *upstream,
            Some(forward) => upstream.masked(&forward.tangents.channels[channel]),
        }
    }

    /// The same for radiance.
    #[inline(always)]
    pub fn radiance_of(&self, upstream: V3, channel: usize) -> V3 {
        match &self.forward {
            None => upstream,
            Some(forward) => upstream.times(forward.tangents.channels[channel].radiance),
        }
    }

    /// Adds to the values of a pixel in forward mode: `light` times the weight `upstream` of each channel.
    pub fn add_values(&self, pixel: u32, upstream: &Seen, light: &Seen) {
        for channel in 0..self.channels() {
            self.select(pixel, channel);
            if let Some(forward) = &self.forward {
                let at = forward.at.load(Ordering::Relaxed);
                let to = &self.numbers[at + forward.tangents.directions];
                let value = self.of_channel(upstream, channel).jump(light);
                to.set(to.get() + f64::from(value));
            }
        }
    }

    /// Adds a derivative to a sum of a part.
    #[inline(always)]
    pub fn add(&self, at: u32, value: f32, part: u32) {
        let at = (self.first[part as usize] + at) as usize;
        if let Some(forward) = &self.forward {
            self.add_products(forward, at, &[value]);
            return;
        }
        let to = &self.numbers[at];
        to.set(to.get() + f64::from(value));
    }

    /// Adds a vector of three derivatives.
    #[inline(always)]
    pub fn add_vector(&self, at: u32, value: V3, part: u32) {
        let first = (self.first[part as usize] + at) as usize;
        if let Some(forward) = &self.forward {
            self.add_products(forward, first, &value.to_array());
            return;
        }
        let to = &self.numbers[first..first + 3];
        to[0].set(to[0].get() + f64::from(value.x));
        to[1].set(to[1].get() + f64::from(value.y));
        to[2].set(to[2].get() + f64::from(value.z));
    }

    /// Adds the products of derivatives and the tangents of their parameters. It is not inlined, so that it takes no
    /// room in the code of gradients.
    #[inline(never)]
    fn add_products(&self, forward: &Forward, first: usize, by: &[f32]) {
        let k = forward.tangents.directions;
        let to = &self.numbers[forward.at.load(Ordering::Relaxed)..][..k];
        let tangents = forward.tangents.values[first * k..].chunks_exact(k);
        for (&by, tangents) in by.iter().zip(tangents) {
            if by != 0.0 {
                for (to, tangent) in to.iter().zip(tangents) {
                    to.set(to.get() + f64::from(by) * tangent);
                }
            }
        }
    }
}

/// Converts the sums of a kernel to the type that stages add to.
#[cfg(feature = "gpu")]
#[cube]
#[allow(unused_variables)]
pub fn sums_of<'a>(totals: Totals<'a>) -> Sums<'a> {
    intrinsic!(|_| totals)
}

/// Adds the derivatives with respect to delta light `k` if they are requested; `g` is the one with respect to its
/// strength.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn add_to_light(scene: &Scene, sums: &Sums, k: u32, by: &DeltaGradient, g: V3) {
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
pub fn add_to_camera(sums: &Sums, by: &CameraGradient) {
    sums.add_vector(0u32, by.eye, CAMERAS);
    sums.add_vector(3u32, by.across, CAMERAS);
    sums.add_vector(6u32, by.upward, CAMERAS);
    sums.add_vector(9u32, by.forward, CAMERAS);
    sums.add_vector(12u32, by.lens.first, CAMERAS);
    sums.add_vector(15u32, by.lens.second, CAMERAS);
    sums.add(18u32, by.per_focus, CAMERAS);
    sums.add(19u32, by.filter, CAMERAS);
}
