//! Path tracing with derivatives, on lists of numbers: the kernels of [softray](https://docs.rs/softray), without tensors.
//!
//! A [`host::HostScene`] is a scene as lists. [`kernel::KernelScene`] packs it, [`kernel::View`] adds a camera and settings,
//! renders pixels, and sums derivatives of a loss backward over the same paths. On the host the stages of a path run on
//! eight paths at once. With the feature `gpu`, CubeCL compiles the same functions for GPUs.
//!
//! The crate is made for softray: its modules are open to that crate, and their items change without notice.

#![allow(
    rustdoc::private_intra_doc_links,
    reason = "most modules are hidden: their documentation is for readers of the code"
)]

#[doc(hidden)]
pub mod accel;
#[doc(hidden)]
pub mod cube;
pub mod host;
#[doc(hidden)]
pub mod kernel;
#[doc(hidden)]
pub mod lanes;
#[doc(hidden)]
pub mod model;
#[doc(hidden)]
#[doc(hidden)]
pub mod sampling;
#[doc(hidden)]
pub mod trace;
pub mod warnings;
