//! How paths are sampled, of both engines: random numbers, the choice of emitters, and the strategies that a
//! user sets.

mod dimension;
mod emitters;
mod mix;
mod numbers;
mod points;
mod source;
mod strategies;
mod uniform;

pub(crate) use dimension::Dimension;
pub(crate) use emitters::{Emitter, EmitterHit, Emitters};
pub(crate) use mix::mix;
pub(crate) use numbers::{Numbers, RUN, Run};
pub(crate) use source::Sampler;
pub use strategies::{EmitterSampling, Sampling, Sequence, SurfaceSampling};
