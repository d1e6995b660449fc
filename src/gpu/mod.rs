//! Path tracing on GPUs with CubeCL kernels, in which each thread traces whole paths. The stages of a path come from
//! `trace`, and the host runs them too. This module calls them, traces rays and stores records.

#![allow(unused_assignments)] // Variables of a kernel need an initial value.
#![allow(clippy::too_many_arguments)] // Kernels have no globals.
#![allow(
    clippy::collapsible_if,
    clippy::collapsible_else_if,
    clippy::field_reassign_with_default,
    clippy::manual_clamp,
    clippy::implicit_saturating_sub,
    clippy::assign_op_pattern,
    reason = "the language of kernels has no other form, or conditions of compilation are nested so"
)]

mod backward;
mod buffers;
mod camera;
mod counts;
mod device;
mod directions;
mod edge_nodes;
mod film;
mod form;
mod gather;
mod gradient;
mod hit;
mod job;
mod jumps;
mod launch;
mod launch_backward;
mod loss;
mod made;
mod nodes;
mod pace;
mod packed;
mod passes;
mod path;
mod pixel_gradients;
mod placed;
mod plan;
mod records;
mod searches;
mod sums;
mod vertices;
mod walk;

pub(crate) use buffers::LastBuffers;
pub(crate) use counts::counts_of;
pub(crate) use device::{identity, identity_and_strides};
pub(crate) use directions::derivatives_of;
pub(crate) use form::check;
pub(crate) use job::{Job, Outputs};
pub(crate) use launch::trace;
pub(crate) use launch_backward::gradient_of;
pub(crate) use packed::{Packed, pack};
pub(crate) use placed::{FAR_MOVE, Reading, Row, ViewPlaces};
