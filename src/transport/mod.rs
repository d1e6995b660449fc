//! Path tracing in tensors: one loop over the bounces of a path, emitters, BSDF.

mod bsdf;
mod cones;
mod diagnostics;
mod emitters;
mod environment;
mod lights;
mod path;
mod paths;
mod seen;
mod sky;
mod surface;
mod texture;
mod tracer;

pub(crate) use cones::{Cones, Hits};
pub use diagnostics::Diagnostics;
pub(crate) use lights::Lights;
pub(crate) use path::{Radiance, trace};
pub(crate) use sky::Sky;
pub(crate) use surface::SurfacePoints;
pub(crate) use tracer::{PathSettings, RayStatistics, RayWeights, Sight, Transport};
