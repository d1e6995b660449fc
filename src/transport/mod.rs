//! Light transport: one loop over the bounces of a path, emitters, BSDF, random numbers.

mod batch;
mod bsdf;
mod cones;
mod diagnostics;
mod emitters;
mod lights;
mod path;
pub(crate) mod sampler;
mod sampling;
mod sky;
mod surface;
mod texture;
mod tracer;

pub(crate) use cones::{Cones, Hits};
pub use diagnostics::Diagnostics;
pub(crate) use lights::Lights;
pub(crate) use path::{Radiance, trace};
pub(crate) use sampler::{Dimension, Sampler, mix};
pub use sampling::{EmitterSampling, Sampling, Sequence, SurfaceSampling};
pub(crate) use sky::Sky;
pub(crate) use surface::SurfacePoints;
pub(crate) use tracer::{Census, PathSettings, RayWeights, Sight, Transport};
