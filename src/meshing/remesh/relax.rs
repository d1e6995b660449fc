//! The surface that a remeshing keeps, and vertices that move on it.

use glam::DVec3;
use rayon::prelude::*;

use super::super::bvh::{Bvh, Nearest};
use super::super::mesh::TriangleMesh;
use super::edits::stays;
use super::surface::Surface;

/// The mesh that is remeshed.
pub(super) struct Reference<'a> {
    mesh: &'a TriangleMesh,
    bvh: Bvh,
    normals: Vec<DVec3>,
    /// The wanted edge length at each vertex.
    lengths: &'a [f64],
}

impl<'a> Reference<'a> {
    pub fn new(mesh: &'a TriangleMesh, lengths: &'a [f64]) -> Self {
        let faces = 0..mesh.faces.len() as u32;
        let normals = faces
            .map(|k| mesh.area_vector(k).normalize_or_zero())
            .collect();
        Self {
            mesh,
            bvh: Bvh::new(mesh),
            normals,
            lengths,
        }
    }

    /// The nearest point whose face has a similar normal, so that thin parts keep their two sides; the nearest of all
    /// if there is none within a few edges.
    pub fn nearest(&self, point: DVec3, normal: DVec3, length: f64) -> Option<Nearest> {
        let similar = |k: u32| self.normals[k as usize].dot(normal) >= 0.2;
        let near = self.bvh.nearest(point, (2.0 * length).powi(2), similar);
        near.or_else(|| self.bvh.nearest(point, f64::INFINITY, |_| true))
    }

    /// The wanted edge length at a point of the surface.
    fn length(&self, near: &Nearest) -> f64 {
        let corners = self.mesh.faces[near.on.face as usize].map(|v| self.lengths[v as usize]);
        (0..3).map(|i| near.on.barycentric[i] * corners[i]).sum()
    }
}

/// Moves vertices in the surface towards the middle of the faces around them, weighted by area, and onto the reference.
pub(super) fn relax(surface: &mut Surface, reference: &Reference) {
    let target = |v: u32| {
        let i = v as usize;
        if surface.locked[i] || surface.around[i].is_empty() {
            return None;
        }
        let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
        for &k in &surface.around[i] {
            let [a, b, c] = surface.corners(k);
            let wanted: f64 = surface.faces[k as usize]
                .iter()
                .map(|&u| surface.lengths[u as usize])
                .sum();
            let weight = (b - a).cross(c - a).length() / wanted.powi(2);
            sum += (a + b + c) / 3.0 * weight;
            weights += weight;
        }
        let (own, normal) = (surface.points[i], surface.vertex_normal(v));
        let middle = if weights > 0.0 { sum / weights } else { own };
        let to = middle - own;
        let moved = own + to - normal * normal.dot(to);
        reference.nearest(moved, normal, surface.lengths[i])
    };
    let targets: Vec<Option<Nearest>> = (0..surface.points.len() as u32)
        .into_par_iter()
        .map(target)
        .collect();
    for (v, near) in targets.into_iter().enumerate() {
        let Some(near) = near else { continue };
        let own = surface.points[v];
        let mean = surface.vertex_normal(v as u32);
        for part in [1.0, 0.5, 0.25] {
            let place = own.lerp(near.point, part);
            let fits = |&k: &u32| {
                let (face, old) = (surface.faces[k as usize], surface.corners(k));
                let moved = |i: usize| if face[i] as usize == v { place } else { old[i] };
                stays(old, [0, 1, 2].map(moved), mean)
            };
            if surface.around[v].iter().all(fits) {
                surface.points[v] = place;
                surface.lengths[v] = reference.length(&near);
                break;
            }
        }
    }
}
