//! Blurred visibility: how much each triangle counts along a ray (Eq. 1), how the surfaces of a
//! ray share its weight (Eq. 2–3), and how much light passes along a segment.
//!
//! Every form reduces to values without tape and a *linear* attached part: the derivative of a
//! weight with respect to the logits and distances of its pairs is known in closed form, so only
//! those two enter the graph, multiplied by coefficients that carry no tape.

mod depth;
mod edge;
mod layered;
mod slots;
mod soft_order;
mod soft_pairs;
mod softmax;
mod sparse;
mod transmittance;
mod weights;

use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::geometry::{Context, Topology};

pub use depth::DepthRange;
pub use edge::{Coverage, CoverageSettings, Rays, coverage};
pub(crate) use edge::{full_room, grazing};
pub(crate) use sparse::{
    Finder, HostRay, PullScratch, Span, Surface, Weighed, cutoff_of_triangle, host_triangles,
};
pub use sparse::{Sparse, SparseWeights};
pub use weights::Weights;

/// How the surfaces that a ray meets share its weight, and how much light passes along a segment.
/// `docs/VISIBILITY.md` compares the forms by measurement: [`Visibility::Layered`] is the accurate
/// one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Visibility {
    /// The paper's (Eq. 3, corrected): softmax over log p_k + z_k/γ and ε/γ for the background,
    /// z_k = (far − t_k)/(far − near); light passes by ∏(1 − p_k) over triangles.
    Softmax {
        /// Blur in depth γ, in units of the scene's depth.
        gamma: f64,
        /// ε, the score of the background.
        epsilon: f64,
    },
    /// Layers of an object's front or back triangles: C_ℓ(t) = Σ p_j over those nearer than t,
    /// T(t) = ∏(1 − min(1, C_ℓ(t))), W_k = T just before t_k − T just after; light passes by T.
    /// The order in depth is hard: where surfaces pass through each other their crossing has no
    /// gradient.
    Layered,
    /// The same with sigmoid((z_j − z_k)/γ) in place of t_j < t_k, which gives the crossing of
    /// surfaces a gradient.
    LayeredSoft {
        /// Blur in depth γ, in units of the scene's depth.
        gamma: f64,
    },
    /// Rays are cones.
    Cone {
        /// Half-angle of the cones, radians.
        angle: f64,
        /// Radius in pixels.
        pixels: f64,
    },
}

impl Visibility {
    /// The softmax form with ε = 1e-3.
    pub fn softmax(gamma: f64) -> Self {
        Self::Softmax {
            gamma,
            epsilon: 1e-3,
        }
    }

    pub(crate) fn cone(&self) -> [f64; 2] {
        match *self {
            Self::Cone { angle, pixels } => [pixels, angle],
            _ => [0.0; 2],
        }
    }

    pub(crate) fn check(&self) -> Result<()> {
        let positive = |gamma: f64| {
            if gamma.is_finite() && gamma > 0.0 {
                return Ok(());
            }
            Err(Error::invalid(
                "options",
                "gamma",
                gamma,
                "a finite number > 0",
            ))
        };
        match *self {
            Self::Softmax { gamma, epsilon } => {
                positive(gamma)?;
                if epsilon.is_finite() {
                    return Ok(());
                }
                Err(Error::invalid(
                    "options",
                    "epsilon",
                    epsilon,
                    "a finite number",
                ))
            }
            Self::Layered => Ok(()),
            Self::LayeredSoft { gamma } => positive(gamma),
            Self::Cone { .. } => Ok(()),
        }
    }

    /// The weights of all surfaces of each ray.
    ///
    /// # Errors
    /// If the order in depth can't be read back from the device.
    pub fn weights(
        &self,
        context: &Context,
        topology: &Topology,
        coverage: Coverage,
        range: DepthRange,
    ) -> Result<Weights> {
        match *self {
            Self::Softmax { gamma, epsilon } => {
                Ok(softmax::weights(coverage, range, gamma, epsilon))
            }
            Self::Layered | Self::Cone { .. } => layered::weights(context, topology, coverage),
            Self::LayeredSoft { gamma } => {
                soft_order::weights(context, topology, coverage, range, gamma)
            }
        }
    }

    /// The share of light that passes all counted triangles: a row `[1, N]`, in the graph if a
    /// gradient can flow.
    pub fn transmittance(
        &self,
        context: &Context,
        topology: &Topology,
        coverage: &Coverage,
    ) -> Tensor<2> {
        match self {
            Self::Softmax { .. } => transmittance::transmittance(coverage),
            Self::Layered | Self::LayeredSoft { .. } | Self::Cone { .. } => {
                layered::transmittance(context, topology, coverage)
            }
        }
    }
}
