//! Path tracing in tensors: one loop over the bounces of a path, emitters, BSDF, random numbers.

mod bsdf;
mod cones;
mod diagnostics;
mod emitters;
mod environment;
mod lights;
mod path;
mod paths;
pub(crate) mod sampler;
mod seen;
mod sky;
mod strategies;
mod surface;
mod texture;
mod tracer;

pub(crate) use cones::{Cones, Hits};
pub use diagnostics::Diagnostics;
pub(crate) use lights::Lights;
pub(crate) use path::{Radiance, trace};
pub(crate) use sampler::{Dimension, Sampler, mix};
pub(crate) use sky::Sky;
pub use strategies::{EmitterSampling, Sampling, Sequence, SurfaceSampling};
pub(crate) use surface::SurfacePoints;
pub(crate) use tracer::{PathSettings, RayStatistics, RayWeights, Sight, Transport};
