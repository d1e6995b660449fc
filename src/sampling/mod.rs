//! Sampling for both engines: random numbers, the choice of emitters, and the strategies that a user sets.

mod emitters;
mod numbers;
mod sampler;
mod strategies;
mod stream;
mod table;

#[cfg(feature = "gpu")]
pub(crate) use emitters::EmitterPlace;
pub(crate) use emitters::{
    Choosing, Chosen, Emitter, EmitterGroup, EmitterHit, EmitterKinds, EmitterLists,
    EmitterTriangle, Emitters, Fixed, LightTree, Met, Receiver, no_emitter_hit,
};
pub(crate) use numbers::draw_eight;
#[cfg(feature = "gpu")]
pub(crate) use sampler::LENGTH;
pub(crate) use sampler::Sampler;
pub use strategies::{EmitterSampling, Sampling, Sequence, SurfaceSampling};
pub(crate) use stream::{Dimensions, Stream};
pub(crate) use table::points;
