//! Sampling for both engines: random numbers, the choice of emitters, and the strategies that a user sets.

mod emitters;
mod numbers;
mod sampler;
mod strategies;
mod stream;
mod table;

#[cfg(feature = "gpu")]
pub use emitters::EmitterPlace;
pub use emitters::{
    Choosing, Chosen, Emitter, EmitterGroup, EmitterHit, EmitterKinds, EmitterLists,
    EmitterTriangle, Emitters, Fixed, LightTree, Met, Receiver, no_emitter_hit,
};
pub use numbers::draw_eight;
#[cfg(feature = "gpu")]
pub use sampler::LENGTH;
pub use sampler::Sampler;
pub use strategies::{EmitterSampling, Sampling, Sequence, SurfaceSampling};
pub use stream::{Dimensions, Stream};
pub use table::points;
