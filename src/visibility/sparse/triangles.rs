//! Triangles on the host and in the graph, with boxes over them.

use std::sync::Arc;

use burn::tensor::Tensor;
use glam::DVec3;
use rayon::prelude::*;

use crate::accel::{Hierarchy, HierarchyCache, HostTriangle};
use crate::error::Result;
use crate::geometry::{Triangles, Vec3, host_values};
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

    /// The triangles and their boxes.
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

/// Reads triangles back.
///
/// # Errors
/// If they can't be read.
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
///
/// # Errors
/// If they can't be read.
pub(crate) fn hierarchy_of(
    triangles: &Triangles,
    cache: Option<&HierarchyCache>,
) -> Result<Arc<Hierarchy>> {
    let list = host_triangles(triangles)?;
    Ok(match cache {
        Some(cache) => cache.take(list),
        None => Arc::new(Hierarchy::new(list)),
    })
}

/// Corner coordinates `[T, 9]` and velocities `[T, 3]`.
fn tables(triangles: &Triangles) -> (Tensor<2>, Option<Tensor<2>>) {
    let c = &triangles.corners;
    let columns = [&c.a, &c.b, &c.c].map(Vec3::columns);
    let velocity = triangles.velocity.as_ref().map(Vec3::columns);
    (Tensor::cat(columns.to_vec(), 1), velocity)
}
