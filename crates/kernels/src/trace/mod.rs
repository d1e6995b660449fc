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

pub use edge_points::*;
pub use edge_search::*;
pub use edge_sides::*;
pub use features::{Derivatives, Features};
pub use film::*;
pub use film_pieces::*;
pub use following::*;
#[cfg(feature = "gpu")]
pub use fours::*;
pub use jumps::*;
pub use leaving::*;
pub use lights::*;
pub use numbers::*;
pub use parts::*;
pub use pixel::*;
pub use scene::*;
pub use seen::*;
pub use sums::*;
pub use surface::*;
pub use texture::*;
#[cfg(feature = "gpu")]
pub use totals::*;
