//! Renders on servers, which are processes of their own: the example `render_server`.
#![allow(clippy::unwrap_used)]

mod bytes;
#[path = "../common/mod.rs"]
mod common;
#[cfg(feature = "gpu")]
#[path = "../gpu/device.rs"]
mod device;
mod faults;
#[cfg(feature = "gpu")]
mod gpu;
mod predictor;
mod same;
mod server;
mod training;
