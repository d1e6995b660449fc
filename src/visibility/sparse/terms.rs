//! Triangles on the host and in the graph, and the linear term that goes into the graph.

use std::sync::Arc;

use burn::tensor::{IndexingUpdateOp, Int, Tensor, TensorData};
use glam::DVec3;
use rayon::prelude::*;

use super::ray::{HostRays, Surface};
use crate::accel::{Hierarchy, HierarchyCache, HostTriangle};
use crate::error::Result;
use crate::geometry::{Context, Triangles, Vec3, detached, host_values};
use crate::visibility::Rays;

/// Many triangles may be left out of a ray, and gradients are more sensitive than images: each is
/// allowed this share of the cutoff.
const SAFETY: f64 = 0.1;

/// The triangles that the rays of a scene are traced with.
pub(crate) struct Sparse {
    pub(super) hierarchy: Arc<Hierarchy>,
    /// Corner coordinates a.x … c.z of each triangle `[T, 9]`, in the graph where they are.
    pub(super) corners: Tensor<2>,
    /// Velocities `[T, 3]`, if anything moves.
    pub(super) velocity: Option<Tensor<2>>,
    /// Triangles of smaller opacity, and what lies behind more than 1 − cutoff, are left out.
    pub(super) cutoff: f64,
}

impl Sparse {
    /// With boxes over the triangles.
    pub(crate) fn new(triangles: &Triangles, hierarchy: Arc<Hierarchy>, cutoff: f64) -> Self {
        let (corners, velocity) = tables(triangles);
        Self {
            hierarchy,
            corners,
            velocity,
            cutoff: SAFETY * cutoff,
        }
    }

    pub(crate) fn hierarchy(&self) -> Arc<Hierarchy> {
        self.hierarchy.clone()
    }

    /// Whether a gradient can flow to triangles or rays.
    pub(super) fn is_tracked(&self, rays: &Rays) -> bool {
        self.corners.is_tracked()
            || self.velocity.as_ref().is_some_and(Tensor::is_tracked)
            || rays.origin.is_tracked()
            || rays.direction.is_tracked()
    }
}

fn host_triangles(triangles: &Triangles) -> Result<Vec<HostTriangle>> {
    let (corners, velocity) = tables(triangles);
    let host = host_values(&corners)?;
    let moved = velocity.as_ref().map(host_values).transpose()?;
    let valid = host_values(&triangles.valid.clone().float())?;
    let vector = |v: &[f64]| DVec3::new(v[0], v[1], v[2]);
    let of_row = |(k, v): (usize, &[f64])| {
        let corners = [vector(v), vector(&v[3..]), vector(&v[6..])];
        let shift = moved.as_ref().map_or(DVec3::ZERO, |m| vector(&m[3 * k..]));
        HostTriangle::new(corners, shift, valid[k] > 0.0)
    };
    Ok(host.par_chunks_exact(9).enumerate().map(of_row).collect())
}

/// Boxes over triangles that are read back, or those of a cache fitted to them.
pub(crate) fn hierarchy_of(
    triangles: &Triangles,
    cache: Option<&HierarchyCache>,
) -> Result<Arc<Hierarchy>> {
    let list = host_triangles(triangles)?;
    Ok(match cache {
        Some(cache) => cache.take(list, None),
        None => Arc::new(Hierarchy::new(list, None)),
    })
}

/// Corner coordinates `[T, 9]` and velocities `[T, 3]`.
fn tables(triangles: &Triangles) -> (Tensor<2>, Option<Tensor<2>>) {
    let c = &triangles.corners;
    let columns = [&c.a, &c.b, &c.c].map(Vec3::columns);
    let velocity = triangles.velocity.as_ref().map(Vec3::columns);
    (Tensor::cat(columns.to_vec(), 1), velocity)
}

#[derive(Default)]
pub(super) struct Terms {
    /// Ray, triangle, and the nine coefficients.
    pub(super) ray: Vec<i32>,
    pub(super) triangle: Vec<i32>,
    pub(super) corners: Vec<f64>,
    pub(super) velocity: Vec<f64>,
    /// By ray: coefficients of origin and direction.
    pub(super) origin: Vec<DVec3>,
    pub(super) direction: Vec<DVec3>,
}

impl Terms {
    pub(super) fn begin_ray(&mut self) {
        self.origin.push(DVec3::ZERO);
        self.direction.push(DVec3::ZERO);
    }

    /// Adds a·dlogit + b·dt of a surface of the ray begun last, which is the i-th.
    #[allow(clippy::too_many_arguments)] // one place, all of it numbers of one pair
    pub(super) fn add(
        &mut self,
        sparse: &Sparse,
        rays: &HostRays,
        i: usize,
        s: &Surface,
        a: f64,
        b: f64,
        least: f64,
    ) {
        let triangle = &sparse.hierarchy.triangles[s.triangle as usize];
        let Some([f, m]) = s.backward(triangle, rays.direction[i], a, b, least) else {
            return;
        };
        let from_ray = f - m;
        let last = self.origin.len() - 1;
        self.origin[last] += from_ray;
        self.direction[last] += from_ray * s.t;
        self.ray.push(last as i32);
        self.triangle.push(s.triangle as i32);
        for c in 0..3 {
            let v = m * s.hit[c] - f * s.border[c];
            self.corners.extend(v.to_array());
        }
        if let Some(time) = &rays.time {
            self.velocity.extend((from_ray * -time[i]).to_array());
        }
    }

    pub(super) fn join(&mut self, other: Self) {
        let base = self.origin.len() as i32;
        self.ray.extend(other.ray.into_iter().map(|r| base + r));
        self.triangle.extend(other.triangle);
        self.corners.extend(other.corners);
        self.velocity.extend(other.velocity);
        self.origin.extend(other.origin);
        self.direction.extend(other.direction);
    }

    /// A row that is 0 and has these derivatives; None if nothing is in the graph.
    pub(super) fn row(
        self,
        sparse: &Sparse,
        context: &Context,
        rays: &Rays,
        n: usize,
    ) -> Option<Tensor<2>> {
        let pairs = self.ray.len();
        let mut sum: Option<Tensor<2>> = None;
        let mut add = |row: Tensor<2>| {
            sum = Some(match sum.take() {
                Some(sum) => sum + row,
                None => row,
            });
        };
        for (value, coefficients) in [
            (&rays.origin, &self.origin),
            (&rays.direction, &self.direction),
        ] {
            if value.is_tracked() {
                add(value.dot(&Vec3::from_host(context, coefficients)));
            }
        }
        if pairs > 0 {
            let int = |v: Vec<i32>| {
                let data = TensorData::new(v, [pairs]);
                Tensor::<1, Int>::from_data(data, &context.device)
            };
            let ray = int(self.ray).reshape([1, pairs]);
            let triangle = int(self.triangle);
            let zeros = || Tensor::<2>::zeros([1, n], (&context.device, context.dtype));
            let mut spread = |table: &Tensor<2>, coefficients: &[f64], width: usize| {
                let rows = table.clone().select(0, triangle.clone());
                let rows = rows * context.tensor(coefficients, [pairs, width]);
                let sums = rows.sum_dim(1).reshape([1, pairs]);
                add(zeros().scatter(1, ray.clone(), sums, IndexingUpdateOp::Add));
            };
            if sparse.corners.is_tracked() {
                spread(&sparse.corners, &self.corners, 9);
            }
            if let Some(velocity) = &sparse.velocity
                && velocity.is_tracked()
                && !self.velocity.is_empty()
            {
                spread(velocity, &self.velocity, 3);
            }
        }
        let sum = sum?;
        let value = detached(&sum);
        Some(sum - value)
    }
}
