//! The stages of a path: small functions over the lists of a scene, one source for the host and for kernels of GPUs.
//!
//! `scene` holds the lists, `features` what is in them. `corners`, `texture` and `surface` make the point that a ray hits,
//! `lights` connects it to lights, `leaving` sends the path on, by random `numbers`. `edge_search`, `edge_points`,
//! `edge_sides`, `jumps` and `film` are of the jumps at edges. Beside each stage is its way back, whose derivatives go to
//! `sums`, by `parts`; in kernels these are `totals`. What calls the stages, traces rays and keeps records is in `kernel`
//! and `gpu`.

#![allow(unused_assignments)] // Variables of a kernel need a first value.
#![allow(clippy::too_many_arguments)] // Kernels have no globals.
#![allow(
    clippy::assign_op_pattern,
    clippy::collapsible_if,
    clippy::field_reassign_with_default,
    reason = "the language of kernels has no other form, or conditions of compilation are nested so"
)]

mod corners;
mod edge_points;
mod edge_search;
mod edge_sides;
mod features;
mod film;
mod jumps;
mod leaving;
mod lights;
mod numbers;
mod parts;
mod scene;
mod seen;
mod sums;
mod surface;
mod texture;
#[cfg(feature = "wgpu")]
mod totals;

pub(crate) use edge_points::*;
pub(crate) use edge_search::*;
pub(crate) use edge_sides::*;
pub(crate) use features::{Derivatives, Features};
pub(crate) use film::*;
pub(crate) use jumps::*;
pub(crate) use leaving::*;
pub(crate) use lights::*;
pub(crate) use numbers::*;
pub(crate) use parts::*;
pub(crate) use scene::*;
pub(crate) use seen::*;
pub(crate) use sums::*;
pub(crate) use surface::*;
pub(crate) use texture::*;
#[cfg(feature = "wgpu")]
pub(crate) use totals::*;
