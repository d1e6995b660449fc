//! GPUs, or a software driver of one, beside the host.
//!
//! `SOFTRAY_GPU` names the device, as in `SOFTRAY_GPU=vulkan:cpu` for a software driver.

#[path = "../common/mod.rs"]
mod common;
mod device;

mod backend;
mod batch;
mod compiled;
mod faces;
mod forward;
mod kernels;
mod late;
mod losses;
mod memory;
mod pictures;
