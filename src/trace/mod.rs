//! The stages of a path: small functions over the lists of a scene, with one source for the host and for GPU kernels.
//!
//! `scene` defines the lists, `features` what they contain, and `pixel` what a camera ray sees. `corners`, `texture` and `surface` build the surface
//! point that a ray hits, `lights` connects it to lights, and `leaving` continues the path, with random `numbers`.
//! `edge_search`, `edge_points`, `edge_sides`, `jumps`, `film` and `film_pieces` compute boundary terms at edges.
//!
//! Each stage stands next to its backward pass, which adds derivatives to `sums`, by `parts`; in kernels these are
//! `totals`. The callers in `kernel` and `gpu` run the stages, trace rays and keep records.

#![allow(unused_assignments)] // Kernel variables need an initial value.
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
mod film_pieces;
mod following;
#[cfg(feature = "gpu")]
mod fours;
mod jumps;
mod leaving;
mod lights;
mod numbers;
mod parts;
mod pixel;
mod scene;
mod seen;
mod sums;
mod surface;
mod texture;
#[cfg(feature = "gpu")]
mod totals;

pub(crate) use edge_points::*;
pub(crate) use edge_search::*;
pub(crate) use edge_sides::*;
pub(crate) use features::{Derivatives, Features};
pub(crate) use film::*;
pub(crate) use film_pieces::*;
pub(crate) use following::*;
#[cfg(feature = "gpu")]
pub(crate) use fours::*;
pub(crate) use jumps::*;
pub(crate) use leaving::*;
pub(crate) use lights::*;
pub(crate) use numbers::*;
pub(crate) use parts::*;
pub(crate) use pixel::*;
pub(crate) use scene::*;
pub(crate) use seen::*;
pub(crate) use sums::*;
pub(crate) use surface::*;
pub(crate) use texture::*;
#[cfg(feature = "gpu")]
pub(crate) use totals::*;
