//! The device that tests of GPUs take.

use std::sync::Once;

use burn::backend::DispatchDevice;
use burn::tensor::{Device, DeviceKind};

use crate::common::numbers::{largest, pairs};

/// The device: the first GPU, or a software driver where `SOFTRAY_WGPU_KIND` is `cpu`. With the feature `vulkan` its
/// kernels are SPIR-V, without it WGSL.
///
/// # Panics
/// If `SOFTRAY_SHADERS` names another language (`spirv` or `wgsl`) than that of its compiler: a test of one of them
/// shall not pass by the other.
pub fn device() -> Device {
    let kind = match std::env::var("SOFTRAY_WGPU_KIND").as_deref() {
        Ok("cpu") => DeviceKind::Cpu,
        Ok(other) => panic!("SOFTRAY_WGPU_KIND is {other:?}, expected \"cpu\" or nothing"),
        Err(_) => DeviceKind::DefaultDevice,
    };
    #[cfg(feature = "vulkan")]
    let device = Device::vulkan(kind);
    #[cfg(not(feature = "vulkan"))]
    let device = Device::wgpu(kind);
    let language = language(&device);
    static SHOWN: Once = Once::new();
    SHOWN.call_once(|| {
        let name = device.identity().map(|i| i.name).unwrap_or_default();
        // Not `println!`, which is shown for tests that fail alone.
        let line = format!("\nGPU {name:?}, kernels in {language}\n");
        let _ = std::io::Write::write_all(&mut std::io::stderr(), line.as_bytes());
    });
    if let Ok(wanted) = std::env::var("SOFTRAY_SHADERS") {
        assert_eq!(
            language, wanted,
            "the language of kernels, and SOFTRAY_SHADERS"
        );
    }
    device
}

/// The language that kernels for a device are compiled into, from the name of its runtime: `wgpu<spirv>`.
fn language(device: &Device) -> String {
    let DispatchDevice::Cube(cube) = device.clone().inner().as_dispatch().clone() else {
        panic!("{device:?} is no GPU");
    };
    let name = cube.client().name();
    let language = name.split(['<', '>']).nth(1);
    language.unwrap_or_else(|| panic!("{name}")).to_owned()
}

/// How an image differs from that of the host at the same seed by more than rounding of what both compute: in few pixels a
/// path met another surface by rounding.
#[derive(Debug)]
pub struct Flips {
    /// Pixels that differ by more than 1e-3 of 1 + their value.
    pub pixels: usize,
    /// The largest difference.
    pub most: f64,
}

impl Flips {
    /// Of two images of three channels.
    pub fn of(found: &[f64], wanted: &[f64]) -> Self {
        let pixels = found.chunks_exact(3).zip(wanted.chunks_exact(3));
        let close = |(a, b): (f64, f64)| (a - b).abs() <= 1e-3 * (1.0 + b);
        let differs = |(a, b): &(&[f64], &[f64])| !pairs(a, b).all(close);
        Self {
            pixels: pixels.filter(differs).count(),
            most: largest(pairs(found, wanted).map(|(a, b)| a - b)),
        }
    }

    /// That so many pixels differ at most, and none by more than one of its samples can bring in the scenes of these
    /// tests: radiance 17, that of their brightest light.
    #[track_caller]
    pub fn assert_at_most(&self, pixels: usize, samples: u32) {
        let one = 17.0 / f64::from(samples);
        assert!(self.pixels <= pixels && self.most <= one, "{self:?}");
    }
}
