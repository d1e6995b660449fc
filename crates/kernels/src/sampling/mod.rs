//! Sampling for both engines: random numbers, and the choice of emitters.

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
pub use strategies::{EmitterSampling, Sequence};
pub use stream::{Dimensions, Stream};
pub use table::points;
