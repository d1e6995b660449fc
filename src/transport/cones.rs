//! Cones: their rays hit hard surfaces, found by boxes on the host. The choice of the surface carries no
//! gradient; the kernels' jumps are the derivative of visibility.

use std::sync::Arc;

use burn::tensor::Tensor;
use glam::DVec3;
use pulp::Arch;

use super::surface::SurfacePoints;
use crate::accel::{Hierarchy, Hit, HitRay, NOTHING};
use crate::error::Result;
use crate::geometry::{Context, Vec3, host_values, host_vectors};
use crate::model::V3;
use crate::model::cone::{Bend, bend, lifted, up_to_plane};
use crate::sampling::Sampler;
use crate::scene::Holes;
use crate::visibility::Rays;

/// Paths (pixel, sample) at a bounce, which random numbers belong to.
#[derive(Clone, Copy)]
pub(crate) struct AtBounce<'a> {
    pub paths: &'a [(u32, u32)],
    pub bounce: u32,
}

/// Cones of one half-angle, and the triangles that their rays meet.
pub(crate) struct Cones {
    hierarchy: Arc<Hierarchy>,
    holes: Option<Arc<Holes>>,
    arch: Arch,
    /// The tangent of the half-angle.
    tangent: f32,
    sampler: Sampler,
}

#[derive(Clone, Debug)]
pub(crate) struct Hits {
    /// The triangle of each; the number of triangles stands for none.
    pub triangle: Vec<u32>,
    /// Whether each came to its front.
    pub front: Vec<bool>,
    pub rays: Rays,
    triangles: u32,
}

impl Hits {
    pub fn is_hit(&self, ray: usize) -> bool {
        self.triangle[ray] < self.triangles
    }

    /// 1 for rays with a property, else 0: a row `[1, N]`.
    pub fn row(&self, context: &Context, is: impl Fn(usize) -> bool) -> Tensor<2> {
        let values = (0..self.triangle.len()).map(|i| f64::from(u8::from(is(i))));
        context.row(&values.collect::<Vec<_>>())
    }
}

struct HostRays {
    origin: Vec<V3>,
    direction: Vec<V3>,
    time: Option<Vec<f64>>,
}

impl Cones {
    /// `sampler` is that of the render.
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
            sampler: sampler.stream(1),
        }
    }

    pub fn hierarchy(&self) -> Arc<Hierarchy> {
        self.hierarchy.clone()
    }

    /// Random numbers for the cones of a bounce (two) and of a shadow ray (two).
    fn numbers(&self, at: AtBounce, i: usize) -> [f32; 4] {
        if self.tangent == 0.0 {
            return [0.0; 4];
        }
        self.sampler.numbers(at.paths[i]).set(at.bounce)
    }

    fn host(&self, rays: &Rays) -> Result<HostRays> {
        let vectors = |v: &Vec3| -> Result<Vec<V3>> {
            Ok(host_vectors(v)?.into_iter().map(V3::from).collect())
        };
        Ok(HostRays {
            origin: vectors(&rays.origin)?,
            direction: vectors(&rays.direction)?,
            time: rays.time.as_ref().map(host_values).transpose()?,
        })
    }

    /// The side's normal of the surface that a ray leaves, if it leaves one.
    fn normal(&self, rays: &Rays, host: &HostRays, i: usize) -> Option<V3> {
        let k = rays.departure.as_ref()?[i] as usize;
        let normal = V3::from(self.hierarchy.triangles[k].normal);
        let side = if normal.dot(host.direction[i]) < 0.0 {
            -1.0
        } else {
            1.0
        };
        Some(normal * side)
    }

    /// A ray along a direction, which may be bent from its own.
    fn ray(&self, host: &HostRays, i: usize, start: V3, direction: V3, limit: f32) -> HitRay {
        let time = host.time.as_ref().map_or(0.0, |t| t[i]) as f32;
        HitRay::new(start, direction, time, limit)
    }

    pub fn nearest(&self, rays: &Rays) -> Result<Hits> {
        let host = self.host(rays)?;
        let of = |i: usize| {
            let start = match self.normal(rays, &host, i) {
                Some(normal) => lifted(host.origin[i], normal),
                None => host.origin[i],
            };
            self.ray(&host, i, start, host.direction[i], f32::INFINITY)
        };
        let list: Vec<HitRay> = (0..rays.len()).map(of).collect();
        let mut hits = Vec::new();
        let holes = self.holes.as_deref();
        (self.hierarchy).hits::<false>(self.arch, holes, &list, &mut hits);
        let count = self.hierarchy.triangles.len() as u32;
        let is_front = |(hit, d): (&Hit, &V3)| {
            let triangle = self.hierarchy.triangles.get(hit.triangle as usize);
            triangle.is_some_and(|t| V3::from(t.normal).dot(*d) < 0.0)
        };
        Ok(Hits {
            triangle: hits.iter().map(|h| h.triangle.min(count)).collect(),
            front: hits.iter().zip(&host.direction).map(is_front).collect(),
            rays: rays.clone(),
            triangles: count,
        })
    }

    /// Directions of the cones about those that were drawn at surface points, in the graph: what is added
    /// to an axis stays as it is.
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
                let [u, v, ..] = self.numbers(at, i);
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

    /// 1 for shadow rays that nothing blocks, bent about their directions; 0 for the others and for those
    /// that aren't needed. Rays that arrive at an emitter end at its plane.
    pub fn unblocked(
        &self,
        context: &Context,
        rays: &Rays,
        needed: &[bool],
        at: AtBounce,
    ) -> Result<Tensor<2>> {
        let host = self.host(rays)?;
        let distances = rays.arrival.as_ref().map(|(_, d)| host_values(d));
        let distances = distances.transpose()?;
        let mut list = Vec::new();
        let which: Vec<usize> = (0..rays.len()).filter(|&i| needed[i]).collect();
        for &i in &which {
            let axis = host.direction[i];
            let normal = self.normal(rays, &host, i).unwrap_or(V3::ZERO);
            let start = lifted(host.origin[i], normal);
            let [_, _, u, v] = self.numbers(at, i);
            let direction = bend(axis, normal, self.tangent, u, v).direction;
            let limit = match (&rays.arrival, &distances) {
                (Some((emitters, _)), Some(distances)) => {
                    let light = host.origin[i] + axis * distances[i] as f32;
                    let emitter = self.hierarchy.triangles.get(emitters[i] as usize);
                    // A light without a surface has its plane across the direction to it.
                    let normal = emitter.map_or(-axis, |e| e.normal.into());
                    up_to_plane(start, direction, normal, light)
                }
                _ => f32::INFINITY,
            };
            list.push(self.ray(&host, i, start, direction, limit));
        }
        let mut hits = Vec::new();
        let holes = self.holes.as_deref();
        (self.hierarchy).hits::<true>(self.arch, holes, &list, &mut hits);
        let mut passed = vec![0.0; rays.len()];
        for ((&i, hit), ray) in which.iter().zip(&hits).zip(&list) {
            let arrives = ray.limit > 0.0 && hit.triangle == NOTHING;
            passed[i] = f64::from(u8::from(arrives));
        }
        Ok(context.row(&passed))
    }
}
