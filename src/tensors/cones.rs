//! Cones, whose rays hit hard surfaces. The host computes the hits with a BVH. The choice of the surface carries no
//! gradient; the boundary term of the kernels is the derivative of visibility.

use std::sync::Arc;

use burn::tensor::Tensor;
use glam::DVec3;
use pulp::Arch;

use super::rays::{HostRay, Rays};
use super::softmax::List;
use super::surface::SurfacePoints;
use crate::error::Result;
use crate::geometry::{Context, Vec3, host_vectors};
use softray_kernels::accel::{Hierarchy, Hit, HitRay, NOTHING};
use softray_kernels::host::Holes;
use softray_kernels::model::cone::{Bend, bend, lifted, up_to_plane};
use softray_kernels::model::{Four, V3};
use softray_kernels::sampling::{Dimensions, Sampler};

/// Paths (pixel, sample) at a bounce, which are keys of random numbers.
#[derive(Clone, Copy)]
pub(crate) struct AtBounce<'a> {
    pub paths: &'a [(u32, u32)],
    pub bounce: u32,
}

/// Cones of one half-angle, and the triangles that their rays hit.
pub(crate) struct Cones {
    hierarchy: Arc<Hierarchy>,
    holes: Option<Arc<Holes>>,
    arch: Arch,
    /// The tangent of the half-angle.
    tangent: f32,
    sampler: Sampler,
}

impl Cones {
    /// `sampler` is the render's sampler.
    pub fn new(
        hierarchy: Arc<Hierarchy>,
        holes: Option<Arc<Holes>>,
        angle: f64,
        sampler: &Sampler,
    ) -> Self {
        Self {
            hierarchy,
            holes,
            arch: Arch::new(),
            tangent: angle.tan() as f32,
            sampler: sampler.of_purpose(1),
        }
    }

    pub fn hierarchy(&self) -> Arc<Hierarchy> {
        self.hierarchy.clone()
    }

    /// Returns two random numbers for the cone of a bounce ray, then two for the cone of a shadow ray.
    fn numbers(&self, at: AtBounce, i: usize) -> Four {
        if self.tangent == 0.0 {
            return Four::default();
        }
        let (pixel, sample) = at.paths[i];
        let numbers = self.sampler.stream(pixel, sample);
        numbers.numbers(Dimensions::of_set(at.bounce))
    }

    /// Returns the normal, on the ray's side, of the surface that a ray leaves, if it leaves one.
    fn normal(&self, ray: &HostRay) -> Option<V3> {
        let normal = V3::from(self.hierarchy.triangles[ray.departure? as usize].normal);
        let side = if normal.dot(ray.direction.into()) < 0.0 {
            -1.0
        } else {
            1.0
        };
        Some(normal * side)
    }

    /// Returns the triangle that each ray hits, which covers the whole ray.
    pub fn nearest(&self, rays: &Rays) -> Result<Vec<Option<List>>> {
        let of = |ray: &HostRay| {
            let origin = V3::from(ray.origin);
            let start = self.normal(ray).map_or(origin, |n| lifted(origin, n));
            let direction = V3::from(ray.direction);
            HitRay::new(start, direction, ray.time as f32, f32::INFINITY)
        };
        let list: Vec<HitRay> = rays.host()?.iter().map(of).collect();
        let mut hits = Vec::new();
        let holes = self.holes.as_deref();
        (self.hierarchy).hits::<false, false>(self.arch, holes, &list, &mut hits);
        let of = |hit: &Hit| List {
            triangles: (hit.triangle != NOTHING)
                .then_some(hit.triangle)
                .into_iter()
                .collect(),
            is_whole: hit.triangle != NOTHING,
        };
        Ok(hits.iter().map(|hit| Some(of(hit))).collect())
    }

    /// Bends the directions that were sampled at surface points, each within its cone. The result is tracked with the
    /// axes. The offset from an axis is constant.
    pub fn bend(
        &self,
        context: &Context,
        points: &SurfacePoints,
        axis: Vec3,
        at: AtBounce,
    ) -> Result<Vec3> {
        if self.tangent == 0.0 {
            return Ok(axis);
        }
        let (axes, normals) = (
            host_vectors(&axis)?,
            host_vectors(&points.geometric_normal)?,
        );
        let clear = points.clear()?;
        let bends: Vec<Bend> = (0..axes.len())
            .map(|i| {
                let Four { x: u, y: v, .. } = self.numbers(at, i);
                // A refracted ray leaves on the other side.
                let refracted = clear.get(i) == Some(&true) && axes[i].dot(normals[i]) < 0.0;
                let outer = normals[i] * if refracted { -1.0 } else { 1.0 };
                bend(axes[i].into(), outer.into(), self.tangent, u, v)
            })
            .collect();
        let offsets: Vec<DVec3> = bends.iter().map(|b| b.offset.into()).collect();
        let direction = axis.add(&Vec3::from_host(context, &offsets)).normalized();
        let mirrored = bends.iter().map(|b| if b.mirrored { 2.0 } else { 0.0 });
        let mirrored = context.row(&mirrored.collect::<Vec<_>>());
        let normal = &points.geometric_normal;
        let along = direction.dot(normal) * mirrored;
        Ok(direction.sub(&normal.scale(&along)))
    }

    /// Returns 1 for shadow rays without an occluder, and 0 for the others and for rays that are not `needed`. Rays are
    /// bent about their directions. Rays to an emitter end at the emitter's plane.
    pub fn unblocked(
        &self,
        context: &Context,
        rays: &Rays,
        needed: &[bool],
        at: AtBounce,
    ) -> Result<Tensor<2>> {
        let host = rays.host()?;
        let which: Vec<usize> = (0..rays.len()).filter(|&i| needed[i]).collect();
        let of = |&i: &usize| {
            let (ray, axis) = (&host[i], V3::from(host[i].direction));
            let origin = V3::from(ray.origin);
            let normal = self.normal(ray).unwrap_or(V3::ZERO);
            let start = lifted(origin, normal);
            let Four { z: u, w: v, .. } = self.numbers(at, i);
            let direction = bend(axis, normal, self.tangent, u, v).direction;
            let limit = ray.distance.map_or(f32::INFINITY, |distance| {
                let emitter = ray.emitter.map(|e| &self.hierarchy.triangles[e as usize]);
                // The plane of a delta light is perpendicular to the direction towards the light.
                let normal = emitter.map_or(-axis, |e| e.normal.into());
                up_to_plane(start, direction, normal, origin + axis * distance as f32)
            });
            HitRay::new(start, direction, ray.time as f32, limit)
        };
        let list: Vec<HitRay> = which.iter().map(of).collect();
        let mut hits = Vec::new();
        let holes = self.holes.as_deref();
        (self.hierarchy).hits::<true, false>(self.arch, holes, &list, &mut hits);
        let mut passed = vec![0.0; rays.len()];
        for ((&i, hit), ray) in which.iter().zip(&hits).zip(&list) {
            let arrives = ray.limit > 0.0 && hit.triangle == NOTHING;
            passed[i] = f64::from(u8::from(arrives));
        }
        Ok(context.row(&passed))
    }
}
