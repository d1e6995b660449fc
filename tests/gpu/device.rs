//! The device that tests of GPUs take.

use std::sync::Once;

use burn::backend::DispatchDevice;
use burn::tensor::Device;

use crate::common::numbers::{largest, pairs};

/// The device that `SOFTRAY_GPU` names for `device::named`, such as `vulkan:cpu`; by default the first GPU of the first
/// of these features. On `wgpu` kernels are SPIR-V with the feature `vulkan`, and WGSL without it.
///
/// # Panics
/// If `SOFTRAY_SHADERS` names another language (`spirv` or `wgsl`) than that of its compiler: a test of one of them
/// shall not pass by the other.
pub fn device() -> Device {
    let built = [
        ("vulkan", cfg!(feature = "vulkan")),
        ("metal", cfg!(feature = "metal")),
        ("wgpu", cfg!(feature = "wgpu")),
        ("cuda", cfg!(feature = "cuda")),
        ("rocm", cfg!(feature = "rocm")),
    ];
    let first = built.iter().find(|b| b.1).expect("a feature of a GPU");
    let name = std::env::var("SOFTRAY_GPU").unwrap_or_else(|_| first.0.to_owned());
    let device = softray::device::named(Some(&name)).expect("the device of the tests");
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

/// The language that kernels for a device are compiled into, from the name of its runtime: `wgpu<spirv>`, `cuda`.
fn language(device: &Device) -> String {
    let DispatchDevice::Cube(cube) = device.clone().inner().as_dispatch().clone() else {
        panic!("{device:?} is no GPU");
    };
    let name = cube.client().name();
    let language = name.split(['<', '>']).nth(1);
    language.unwrap_or(name).to_owned()
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
