//! The renderer as tensor operations, whose derivatives burn computes. Suggested order of reading:
//!
//! 1. `visibility` and `strategies`: the user's choice; `rays`: the rays that are traced.
//! 2. `softmax`: the paper's form, Eq. 1 to 3; `cones`: hard surfaces, the specification of the kernels.
//! 3. `path`: the loop over the bounces of a path, with its state in `paths`; `tracer`: either form of visibility for
//!    it.
//! 4. `surface`: points of surfaces; `bsdf`: their BSDFs.
//! 5. `direct`: light of emitters and maps at surface points (`shaded`); `delta_lights`: light of delta lights;
//!    `lights`: the choice among them; `seen`: the light that primary rays see.

mod bsdf;
mod cones;
mod delta_lights;
mod diagnostics;
mod direct;
mod emission;
mod lights;
mod path;
mod paths;
mod rays;
mod seen;
mod shaded;
mod softmax;
mod strategies;
mod surface;
mod tracer;
mod visibility;

pub(crate) use cones::Cones;
pub use diagnostics::Diagnostics;
pub(crate) use lights::{Lights, Sky};
pub(crate) use path::{Radiance, trace};
pub(crate) use rays::Rays;
pub(crate) use softmax::{Candidates, Group, hierarchy_of};
pub use strategies::{Sampling, SurfaceSampling};
pub(crate) use tracer::{PathSettings, RayStatistics, Sight, Tracer, Transport};
pub(crate) use visibility::VisibilityForm;
pub use visibility::{SoftmaxOptions, Visibility};
