//! GPUs, or a software driver of one, beside the host.
//!
//! `SOFTRAY_WGPU_KIND=cpu` picks a software adapter.

#[path = "../common/mod.rs"]
mod common;
mod device;

mod backend;
mod batch;
mod compiled;
mod kernels;
mod losses;
mod memory;
mod pictures;
