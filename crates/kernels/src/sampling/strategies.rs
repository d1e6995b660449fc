//! The sampling strategies of a render that kernels read.

use serde::{Deserialize, Serialize};

use crate::cube::*;
use crate::lanes::Record;

/// The source of a render's random numbers.
///
/// `Sampling` has an example.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Sequence {
    /// Independent uniform numbers.
    Independent,
    /// Owen-scrambled low-discrepancy sequences (Burley 2020), similar to Sobol's.
    ///
    /// They have 16 dimensions, which are also well distributed in pairs and fours (Ahmed et al. 2023). Each sequence
    /// is dealt to a block of pixels in Morton order (Ahmed and Wonka 2020). So image, lens, shutter time, emitters and
    /// directions are stratified together, within a pixel and over the pixels of a block, over which gradients are
    /// sums. The best numbers of samples are powers of two, above all 16, 64 and 256. A standard error must be taken
    /// over independent seeds, not over samples or pixels.
    #[default]
    Sobol,
}

known_to_kernels!(Sequence);

/// All paths share the sequence.
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

/// The probabilities with which next-event estimation chooses emitters: emitting triangles and delta lights.
///
/// `Sampling` has an example.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum EmitterSampling {
    /// The same probability for all, as in the paper.
    Uniform,
    /// Probabilities in proportion to power; for a triangle this is area times radiance.
    Power,
    /// Probabilities about in proportion to the light that each emitter brings to a point, and for a tenth to its
    /// power.
    ///
    /// Up to 64 emitters are weighted by solid angle times radiance, or by power if all are static triangles in one
    /// plane. More emitters are drawn from a tree. Its bounds of position, orientation and power account for the
    /// point's own normal, and its time grows with the logarithm of the number of emitters. Delta lights are included.
    #[default]
    SolidAngle,
}
