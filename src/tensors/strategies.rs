//! The sampling strategies of a render.

use serde::{Deserialize, Serialize};
use softray_kernels::sampling::{EmitterSampling, Sequence};

/// The surfaces from which a path continues if several share a primary ray.
///
/// [`Sampling`] has an example.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum SurfaceSampling {
    /// One surface, drawn by its weight, as in the paper.
    Drawn,
    /// All surfaces that matter, each with its weight. Every surface with a weight of at least a quarter gets a path,
    /// and a smaller one gets a path only by chance. Gradients of visibility then have no noise from a draw. Bounce
    /// rays draw one surface.
    #[default]
    Split,
}

/// The sampling strategies of a render. They change neither the image nor the gradients to which a render converges,
/// only how fast it converges.
///
/// ```
/// use softray::prelude::*;
/// let paper = RenderOptions::new(64, 64).with_sampling(Sampling::paper());
/// let mut sampling = Sampling::default();
/// sampling.sequence = Sequence::Independent;
/// sampling.emitters = EmitterSampling::Power;
/// sampling.surfaces = SurfaceSampling::Drawn;
/// # let _ = (paper, RenderOptions::new(64, 64).with_sampling(sampling));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct Sampling {
    /// The source of random numbers.
    pub sequence: Sequence,
    /// The probabilities of emitters.
    pub emitters: EmitterSampling,
    /// The surfaces from which the paths of primary rays continue.
    pub surfaces: SurfaceSampling,
    /// Whether MIS by the power heuristic (Veach and Guibas 1995) combines two strategies. If so, points on emitters
    /// are also sampled by the BSDF (from glossy surfaces), and directions to an environment map by both the map and
    /// the BSDF. If not, light sampling alone serves emitters, and the BSDF alone serves the map.
    pub multiple_importance: bool,
}

impl Default for Sampling {
    fn default() -> Self {
        Self {
            sequence: Sequence::default(),
            emitters: EmitterSampling::default(),
            surfaces: SurfaceSampling::default(),
            multiple_importance: true,
        }
    }
}

impl Sampling {
    /// Returns the paper's strategies: independent numbers, one surface drawn for each ray, and the same probability
    /// for all emitters.
    pub fn paper() -> Self {
        Self {
            sequence: Sequence::Independent,
            emitters: EmitterSampling::Uniform,
            surfaces: SurfaceSampling::Drawn,
            multiple_importance: false,
        }
    }
}
