//! How paths are sampled, of both engines: random numbers, the choice of emitters, and the strategies that a
//! user sets.

mod emitters;
mod numbers;
mod sampler;
mod strategies;
mod stream;

#[cfg(feature = "wgpu")]
pub(crate) use emitters::{BY_POWER, Chosen, Fixed, GRAZING, LightTree};
pub(crate) use emitters::{Emitter, EmitterHit, Emitters, Met, Receiver};
pub(crate) use numbers::{Numbers, RUN, Run};
pub(crate) use sampler::Sampler;
pub use strategies::{EmitterSampling, Sampling, Sequence, SurfaceSampling};
pub(crate) use stream::{Dimensions, Four};
#[cfg(feature = "wgpu")]
pub(crate) use stream::{Stream, points};
