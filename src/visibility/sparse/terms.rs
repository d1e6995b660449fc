//! The linear term that goes into the graph.

use burn::tensor::{IndexingUpdateOp, Int, Tensor, TensorData};
use glam::DVec3;

use super::ray::{HostRays, Surface};
use super::triangles::Sparse;
use crate::geometry::{Context, Vec3, detached};
use crate::visibility::Rays;

/// Linear terms of rays: Σ over their surfaces.
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
