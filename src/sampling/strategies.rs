//! The strategies by which a render samples.

use serde::{Deserialize, Serialize};

use crate::cube::*;
use crate::lanes::Record;

/// The source of a render's random numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Sequence {
    /// Independent uniform numbers.
    Independent,
    /// Owen-scrambled sequences (Burley 2020) of the kind of Sobol's, with 16 dimensions that are
    /// spread well in pairs and fours too (Ahmed et al. 2023), each dealt to a block of pixels in
    /// Morton order (Ahmed and Wonka 2020): image, lens, shutter, emitters and directions are
    /// stratified together, within a pixel and over the pixels of a block, which is what gradients
    /// are sums over. Numbers of samples that are powers of two serve it best, 16, 64 and 256 above
    /// all. A standard error is that over independent seeds, not over samples or pixels.
    #[default]
    Sobol,
}

known_to_kernels!(Sequence);

/// All paths share it.
impl Record for Sequence {
    type Lanes = Self;

    #[inline(always)]
    fn get(lanes: &Self, _: usize) -> Self {
        *lanes
    }

    #[inline(always)]
    fn set(self, lanes: &mut Self, _: usize) {
        *lanes = self;
    }
}

/// The probabilities with which emitters, which are triangles and lights without a surface, are connected to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum EmitterSampling {
    /// All alike, as in the paper.
    Uniform,
    /// In proportion to power: area times radiance of a triangle.
    Power,
    /// About in proportion to the light that each brings to a point, and a tenth by power. Up to 64 are weighed by
    /// solid angle times radiance; where these lie all in one plane, by power. More are drawn by a tree, whose bounds
    /// of place, orientation and power take the point's own normal into account, in a time that grows with the
    /// logarithm of their number. Lights without a surface are among them.
    #[default]
    SolidAngle,
}

/// The choice between the surfaces that share a camera ray, from which its path goes on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum SurfaceSampling {
    /// One, drawn with its weight, as in the paper.
    Drawn,
    /// All that matter, each with its weight: a path for every surface with a weight of at least a
    /// quarter, fewer of smaller ones by chance. Gradients of visibility then have no noise of a
    /// draw. Bounce rays draw one.
    #[default]
    Split,
}

/// The strategies by which a render samples. No choice changes what it converges to, nor its gradients: only how
/// fast.
///
/// ```
/// use softray::prelude::*;
/// let paper = RenderOptions::new(64, 64).sampling(Sampling::paper());
/// let mut sampling = Sampling::default();
/// sampling.sequence = Sequence::Independent;
/// # let _ = (paper, RenderOptions::new(64, 64).sampling(sampling));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct Sampling {
    /// The source of random numbers.
    pub sequence: Sequence,
    /// The probabilities of emitters.
    pub emitters: EmitterSampling,
    /// The surfaces that camera rays go on from.
    pub surfaces: SurfaceSampling,
    /// Whether points on emitters (from glossy surfaces) and directions to an environment map are
    /// chosen by the BSDF as well, combined by the power heuristic (Veach and Guibas 1995).
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
    /// The paper's: independent numbers, one surface drawn a ray, one emitter of all drawn alike.
    pub fn paper() -> Self {
        Self {
            sequence: Sequence::Independent,
            emitters: EmitterSampling::Uniform,
            surfaces: SurfaceSampling::Drawn,
            multiple_importance: false,
        }
    }
}
