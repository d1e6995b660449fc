//! The device that tests of GPUs take.

use std::sync::Once;

use burn::backend::DispatchDevice;
use burn::tensor::Device;

use crate::common::numbers::{largest, pairs};

/// The name of the tests' device for `device::named`: `SOFTRAY_GPU`, such as `vulkan:cpu`; by default the first GPU of the
/// first of these features.
pub fn name() -> String {
    let built = [
        ("vulkan", cfg!(feature = "vulkan")),
        ("metal", cfg!(feature = "metal")),
        ("wgpu", cfg!(feature = "wgpu")),
        ("cuda", cfg!(feature = "cuda")),
        ("rocm", cfg!(feature = "rocm")),
    ];
    let first = built.iter().find(|b| b.1).expect("a feature of a GPU");
    std::env::var("SOFTRAY_GPU").unwrap_or_else(|_| first.0.to_owned())
}

/// The device of [`name`]. On `wgpu` kernels are SPIR-V with the feature `vulkan`, and WGSL without it. With that feature
/// and `SOFTRAY_SHADERS=wgsl` the device is one that CubeCL compiles WGSL for.
///
/// # Panics
/// If `SOFTRAY_SHADERS` names another language (`spirv` or `wgsl`) than that of its compiler: a test of one of them
/// shall not pass by the other.
pub fn device() -> Device {
    let wanted = std::env::var("SOFTRAY_SHADERS").ok();
    let device = match &wanted {
        #[cfg(feature = "vulkan")]
        Some(language) if language == "wgsl" => wgsl::device(),
        _ => softray::device::named(Some(&name())).expect("the device of the tests"),
    };
    let language = language(&device);
    static SHOWN: Once = Once::new();
    SHOWN.call_once(|| {
        let name = device.identity().map(|i| i.name).unwrap_or_default();
        // Not `println!`, which is shown for tests that fail alone.
        let line = format!("\nGPU {name:?}, kernels in {language}\n");
        let _ = std::io::Write::write_all(&mut std::io::stderr(), line.as_bytes());
    });
    if let Some(wanted) = wanted {
        assert_eq!(
            language, wanted,
            "the language of kernels, and SOFTRAY_SHADERS"
        );
    }
    device
}

/// Handles of an instance's first adapter by Vulkan, with a device of changed limits.
#[cfg(feature = "wgpu")]
pub fn setup(
    instance: burn::tensor::wgpu::wgpu::Instance,
    change: impl FnOnce(&mut burn::tensor::wgpu::wgpu::Limits),
) -> burn::tensor::wgpu::WgpuSetup {
    use burn::tensor::wgpu::{WgpuSetup, wgpu};
    // Natively these are ready at once.
    fn ready<T>(future: impl Future<Output = T>) -> T {
        let mut context = std::task::Context::from_waker(std::task::Waker::noop());
        match std::pin::pin!(future).poll(&mut context) {
            std::task::Poll::Ready(value) => value,
            std::task::Poll::Pending => panic!("it is not ready"),
        }
    }
    let backend = wgpu::Backend::Vulkan;
    let adapter = ready(instance.enumerate_adapters(backend.into())).remove(0);
    let mut limits = adapter.limits();
    change(&mut limits);
    let (device, queue) = ready(adapter.request_device(&wgpu::DeviceDescriptor {
        required_limits: limits,
        // With these CubeCL times kernels if the adapter has them.
        required_features: adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
        ..Default::default()
    }))
    .expect("a device");
    WgpuSetup {
        instance,
        adapter,
        device,
        queue,
        backend,
    }
}

/// A device for which CubeCL compiles WGSL although SPIR-V is built in.
#[cfg(feature = "vulkan")]
mod wgsl {
    use std::sync::LazyLock;

    use burn::tensor::Device;
    use burn::tensor::wgpu::wgpu::hal::{api::Vulkan, vulkan};
    use burn::tensor::wgpu::wgpu::{Instance, InstanceDescriptor, InstanceFlags, Limits};

    use super::setup;

    /// Vulkan 1.0, as Vulkan encodes versions.
    const VERSION: u32 = 1 << 22;

    /// Vulkan's first adapter as an instance of Vulkan 1.0 without extensions shows it: without the features that SPIR-V
    /// kernels need.
    pub fn device() -> Device {
        static DEVICE: LazyLock<Device> = LazyLock::new(|| {
            // Vulkan 1.0 does not tell how large a buffer may be.
            let of_web_gpu = Limits::default().max_buffer_size;
            let setup = setup(instance(), |limits| limits.max_buffer_size = of_web_gpu);
            let device = Device::wgpu_options().setup(setup).init();
            device.expect("a device")
        });
        DEVICE.clone()
    }

    #[allow(unsafe_code)] // wgpu takes instances of others by unsafe functions alone
    fn instance() -> Instance {
        let whole = Instance::new(InstanceDescriptor::new_without_display_handle());
        // SAFETY: the handles are those of an instance that lives until the last use of the new one has ended. That it
        // knows more than it says has no consequence.
        unsafe {
            let shared = whole.as_hal::<Vulkan>().expect("Vulkan").shared_instance();
            let (entry, raw) = (shared.entry().clone(), shared.raw_instance().clone());
            let old = vulkan::Instance::from_raw(
                entry,
                raw,
                VERSION,
                0,
                None,
                Vec::new(),
                InstanceFlags::empty(),
                Default::default(),
                false,
                Some(Box::new(move || drop(whole))),
            );
            Instance::from_hal::<Vulkan>(old.expect("an instance"))
        }
    }
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
