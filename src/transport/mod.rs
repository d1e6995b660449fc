//! Path tracing in tensors: one loop over the bounces of a path, emitters, BSDF.

mod bsdf;
mod cones;
mod delta_lights;
mod diagnostics;
mod direct;
mod lights;
mod path;
mod paths;
mod seen;
mod shaded;
mod surface;
mod tracer;

pub(crate) use cones::{Cones, Hits};
pub use diagnostics::Diagnostics;
pub(crate) use lights::{Lights, Sky};
pub(crate) use path::{Radiance, trace};
pub(crate) use surface::SurfacePoints;
pub(crate) use tracer::{PathSettings, RayStatistics, RayWeights, Sight, Transport};
