//! The device that tests of GPUs take.
#![cfg(feature = "wgpu")]

use burn::tensor::{Device, DeviceKind};

/// `SOFTRAY_WGPU_KIND=cpu` takes a software driver, `SOFTRAY_WGSL` the language of browsers.
pub fn device() -> Device {
    let kind = match std::env::var("SOFTRAY_WGPU_KIND").as_deref() {
        Ok("cpu") => DeviceKind::Cpu,
        _ => DeviceKind::DefaultDevice,
    };
    match std::env::var("SOFTRAY_WGSL") {
        #[cfg(feature = "vulkan")]
        Err(_) => Device::vulkan(kind),
        _ => Device::wgpu(kind),
    }
}
