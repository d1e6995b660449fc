//! Counts of degenerate cases in a render, on request.

use burn::tensor::{Bool, Tensor};
use serde::{Deserialize, Serialize};

use super::softmax::{Weights, grazing};
use crate::error::Result;
use crate::geometry::{Vec3, detached, host_values};

/// Counts of degenerate cases in a render.
///
/// Cones have neither weights nor parallel hits, so their kernels count only triangles and light. For the softmax,
/// counting reads data back from the device and takes time. Renders without counting have no such cost.
///
/// [`Statistics`](crate::render::Statistics) has an example.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Diagnostics {
    /// Triangles without area, which no ray hits.
    pub degenerate_triangles: u64,
    /// Pairs of a primary or bounce ray and a triangle that are too parallel to count (|n·d| ≤ 1e-6 in f32, 1e-9 in
    /// f64).
    pub parallel_pairs: u64,
    /// NaN or infinite weights of surfaces.
    pub non_finite_weights: u64,
    /// NaN or infinite throughputs of paths.
    pub non_finite_throughputs: u64,
    /// NaN or infinite values of the light that paths contribute.
    pub non_finite_light: u64,
    /// The mean of 1/ΣW² over primary and bounce rays, including the background: the effective number of surfaces among
    /// which a draw chooses. It is 1 without blur.
    pub effective_surfaces: f64,
    /// The largest throughput of a path. If it is far over 1, few paths dominate the image.
    pub largest_throughput: f64,
    /// The number of rays in the mean of `effective_surfaces`.
    pub(crate) rays: u64,
}

impl Diagnostics {
    /// Merges other counts into these.
    pub(crate) fn merge(&mut self, other: &Self) {
        let rays = (self.rays + other.rays).max(1) as f64;
        self.effective_surfaces = (self.effective_surfaces * self.rays as f64
            + other.effective_surfaces * other.rays as f64)
            / rays;
        self.rays += other.rays;
        self.degenerate_triangles = self.degenerate_triangles.max(other.degenerate_triangles);
        self.parallel_pairs += other.parallel_pairs;
        self.non_finite_weights += other.non_finite_weights;
        self.non_finite_throughputs += other.non_finite_throughputs;
        self.non_finite_light += other.non_finite_light;
        self.largest_throughput = self.largest_throughput.max(other.largest_throughput);
    }

    /// Counts the weights of a batch of rays.
    pub(crate) fn weights(
        &mut self,
        weights: &Weights,
        cosines: &Tensor<2>,
        valid: &Tensor<2, Bool>,
    ) -> Result<()> {
        let delta = grazing(cosines.dtype());
        // Degenerate triangles were replaced by one whose cosine has no meaning.
        let parallel = cosines.clone().abs().lower_equal_elem(delta);
        let parallel = parallel.bool_and(valid.clone().expand(cosines.dims()));
        let n = weights.background.dims()[1] as u64;
        self.parallel_pairs += count(parallel)?;
        self.non_finite_weights += count_non_finite(&weights.surfaces)?;
        self.non_finite_weights += count_non_finite(&weights.background)?;
        let square = |t: &Tensor<2>| t.clone() * t.clone();
        let squares = square(&weights.surfaces).sum_dim(0) + square(&weights.background);
        let effective = host_values(&squares)?;
        let sum: f64 = effective.iter().map(|s| s.recip()).sum();
        self.merge(&Self {
            effective_surfaces: sum / n as f64,
            rays: n,
            degenerate_triangles: count(valid.clone().bool_not())?,
            ..Self::default()
        });
        Ok(())
    }

    /// Counts the throughputs of paths that are not finite, and updates the largest.
    pub(crate) fn throughput(&mut self, throughput: &Vec3) -> Result<()> {
        for plane in [&throughput.x, &throughput.y, &throughput.z] {
            self.non_finite_throughputs += count_non_finite(plane)?;
            let largest = host_values(plane)?
                .into_iter()
                .filter(|v| v.is_finite())
                .fold(0.0, f64::max);
            self.largest_throughput = self.largest_throughput.max(largest);
        }
        Ok(())
    }

    /// Counts the light of paths that is not finite.
    pub(crate) fn light(&mut self, light: &Vec3) -> Result<()> {
        for plane in [&light.x, &light.y, &light.z] {
            self.non_finite_light += count_non_finite(plane)?;
        }
        Ok(())
    }
}

fn count(mask: Tensor<2, Bool>) -> Result<u64> {
    Ok(host_values(&mask.float())?.iter().sum::<f64>() as u64)
}

fn count_non_finite(t: &Tensor<2>) -> Result<u64> {
    let values = host_values(&detached(t))?;
    Ok(values.iter().filter(|v| !v.is_finite()).count() as u64)
}
