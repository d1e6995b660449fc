//! The camera of a scene on the host: conversion to the kernels' camera, and of its derivatives back to scene
//! parameters.

use std::ops::Range;

use glam::DVec3;

use super::{Camera as Model, Dual};
use crate::host::{Bounds, HostProjection, ParameterId, SceneFrame};
use crate::model::{Pair, V3};

/// A camera in scene units.
#[derive(Clone, Copy, Debug)]
pub struct HostCamera {
    pub eye: DVec3,
    pub target: DVec3,
    pub up: DVec3,
    pub projection: HostProjection,
    /// Aperture radius and focus distance, if rays need a lens point.
    pub lens: Option<[f64; 2]>,
    /// Half the height of the view at distance 1.
    pub half_height: f64,
}

/// Unit vectors of a camera, and the scale and shift along them of a film point (x, y), in halves of the image
/// height.
struct Frame {
    forward: DVec3,
    right: DVec3,
    up: DVec3,
    scale: [f64; 2],
    shift: [f64; 2],
}

impl HostCamera {
    fn frame(&self, unit: f64, aspect: f64) -> Frame {
        let forward = (self.target - self.eye).normalize();
        let right = forward.cross(self.up.normalize()).normalize();
        let [sx, sy, tx, ty] = self.projection.film(unit, aspect);
        Frame {
            forward,
            right,
            up: right.cross(forward),
            scale: [sx, sy],
            shift: [tx, ty],
        }
    }

    /// Returns whether any point of some boxes may be in view of an image with the aspect ratio `aspect` (width over
    /// height). Rays leave the image by at most `beyond`, in halves of its height. The result is false only if each
    /// box lies on the outer side of one of the planes about the view.
    pub fn may_see(&self, boxes: &[Bounds], aspect: f64, beyond: f64) -> bool {
        let f = self.frame(1.0, aspect);
        let half = [aspect + beyond, 1.0 + beyond];
        let [aperture, focus] = self.lens.unwrap_or([0.0, 1.0]);
        let parallel = self.projection.is_parallel();
        // Distances behind the five planes.
        let behind = |p: DVec3| -> [f64; 5] {
            let offset = p - self.eye;
            let z = offset.dot(f.forward);
            let depth = if parallel { 1.0 } else { z };
            let across: [[f64; 2]; 2] = std::array::from_fn(|i| {
                let reach = f.scale[i] * half[i] * depth + aperture * (1.0 + z / focus);
                let along = offset.dot([f.right, f.up][i]) - f.shift[i] * depth;
                [along - reach, -along - reach]
            });
            let [[right, left], [top, bottom]] = across;
            [-z, right, left, top, bottom]
        };
        let is_outside = |b: &Bounds| {
            let all = b.corners().map(|corner| behind(corner.into()));
            (0..5).any(|plane| all.iter().all(|distances| distances[plane] > 0.0))
        };
        !boxes.iter().all(is_outside)
    }

    /// Returns whether the camera is in front of a plane through a point.
    pub fn is_before(&self, point: DVec3, normal: DVec3) -> bool {
        let from = match self.projection.is_parallel() {
            true => self.eye - self.target,
            false => self.eye - point,
        };
        from.dot(normal) > 0.0
    }

    /// Returns the position of the eye and the point that it looks at.
    pub fn line_of_sight(&self) -> [DVec3; 2] {
        [self.eye, self.target]
    }

    /// Returns the camera of an image of `width` × `height` pixels, in internal units.
    pub fn model(&self, inner: &SceneFrame, width: u32, height: u32) -> Model {
        let (width, height) = (f64::from(width), f64::from(height));
        let f = self.frame(inner.unit, width / height);
        let [across, upward] = [f.right * f.scale[0], f.up * f.scale[1]];
        let forward = f.forward + f.right * f.shift[0] + f.up * f.shift[1];
        // The unit vectors are orthogonal, so this is the inverse.
        let [x, y, z] = [
            (f.right - f.forward * f.shift[0]) / f.scale[0],
            (f.up - f.forward * f.shift[1]) / f.scale[1],
            f.forward,
        ]
        .map(V3::from);
        let (aperture, per_focus) = match self.lens {
            Some([aperture, focus]) => (aperture / inner.unit, inner.unit / focus),
            None => (0.0, 0.0),
        };
        Model {
            eye: inner.inner(self.eye).into(),
            across: across.into(),
            upward: upward.into(),
            forward: forward.into(),
            dual: Dual { x, y, z },
            lens: Pair {
                first: (f.right * aperture).into(),
                second: (f.up * aperture).into(),
            },
            aperture: aperture as f32,
            per_focus: per_focus as f32,
            parallel: self.projection.is_parallel(),
            width: width as f32,
            height: height as f32,
            filter: 0.0,
        }
    }

    /// Adds the derivatives with respect to a camera's parameters at their places, from those with respect to its
    /// [`Model`] ([`OF_CAMERA`](crate::trace::OF_CAMERA)). The image has the aspect ratio `aspect` (width over
    /// height), and a pixel filter with a radius of `filter` pixels.
    pub fn backward(
        &self,
        sums: &[f64],
        unit: f64,
        (aspect, filter): (f64, f64),
        places: &[(ParameterId, Range<usize>)],
        all: &mut [f64],
    ) {
        if places.is_empty() {
            return;
        }
        let f = self.frame(unit, aspect);
        let [aperture, focus] = self.lens.unwrap_or([0.0, 1.0]);
        let lens = aperture / unit;
        let vector = |k: usize| DVec3::from_slice(&sums[3 * k..]);
        let [by_eye, by_x, by_y, by_z, by_lens_x, by_lens_y] = std::array::from_fn(vector);
        let (by_per_focus, by_radius) = (sums[18], sums[19]);
        let by_right = by_x * f.scale[0] + by_z * f.shift[0] + by_lens_x * lens;
        let by_cross = by_y * f.scale[1] + by_z * f.shift[1] + by_lens_y * lens;
        // right = (forward × up)/|…|, up = right × forward, forward = (target − eye)/|…|.
        let view = self.target - self.eye;
        let up = self.up.normalize();
        let across = f.forward.cross(up);
        let by_right = by_right + f.forward.cross(by_cross);
        let by_across = (by_right - f.right * f.right.dot(by_right)) / across.length();
        let by_forward = by_z + by_cross.cross(f.right) + up.cross(by_across);
        let by_up = by_across.cross(f.forward);
        let mut by_view = (by_forward - f.forward * f.forward.dot(by_forward)) / view.length();
        // The radius of a cone in pixels is inversely proportional to the height of the view at distance 1.
        let by_filter = by_radius * filter;
        if self.projection.is_parallel() {
            by_view += f.forward * (by_filter / view.length());
        }
        let by_height = by_y.dot(f.up) - by_filter / f.scale[1];
        let by_shift = [by_z.dot(f.right), by_z.dot(f.up)];
        let by_film = [by_x.dot(f.right), by_height, by_shift[0], by_shift[1]];
        let slopes = self.projection.slopes(unit, aspect).into_iter();
        let by = |slopes: [f64; 4]| slopes.iter().zip(by_film).map(|(s, g)| s * g).sum();
        let by_numbers: Vec<f64> = slopes.map(by).collect();
        for (id, range) in places {
            let add = |all: &mut [f64], by: &[f64]| {
                for (to, by) in all[range.clone()].iter_mut().zip(by) {
                    *to += by;
                }
            };
            match id {
                ParameterId::Eye => add(all, &(by_eye / unit - by_view).to_array()),
                ParameterId::Target => add(all, &by_view.to_array()),
                ParameterId::Up => {
                    let by = (by_up - up * up.dot(by_up)) / self.up.length();
                    add(all, &by.to_array());
                }
                ParameterId::Aperture => {
                    let by = by_lens_x.dot(f.right) + by_lens_y.dot(f.up);
                    add(all, &[by / unit]);
                }
                ParameterId::Focus => add(all, &[-by_per_focus * unit / (focus * focus)]),
                ParameterId::FieldOfView | ParameterId::ViewHeight => add(all, &by_numbers),
                ParameterId::FocalLength => add(all, &by_numbers[..2]),
                ParameterId::PrincipalPoint => add(all, &by_numbers[2..]),
                _ => {}
            }
        }
    }
}
