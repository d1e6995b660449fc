//! Renders on the devices of servers (features `remote` and `remote-server`), over burn's remote backend.
//!
//! [`connect`] returns a device of a server. A scene whose tensors are on it renders there, forward and backward, by the
//! same calls as on other devices. The example `render_server` is a server. `docs/MACHINES.md` has the setup, the
//! failures, and measurements.
//!
//! - A render waits until the server has finished, so that its errors are errors of the call. A gradient does not wait:
//!   if it fails, it is NaN, and the next render on the device, or [`finish`], returns the error.
//! - Faces, constants and options are sent once, tensors are handles. The server keeps what a forward pass prepared for
//!   its backward pass.
//! - Warnings of likely mistakes appear in the server's log, and progress is reported once, at the end.

#[cfg(feature = "remote-server")]
mod operation;
#[cfg(feature = "remote-server")]
mod service;

use burn::tensor::Device;

pub use crate::device::remote::{connect, set_time_limit};
use crate::error::Result;
#[cfg(feature = "remote-server")]
pub use service::{RenderService, ServiceLimits};

/// Waits for the last gradients on a device of a server. On other devices it returns at once.
///
/// # Errors
/// If a gradient failed, or the server has gone.
pub fn finish(device: &Device) -> Result<()> {
    crate::render::finish(device)
}
