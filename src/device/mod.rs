//! Devices by name, so that one program can run on CPUs and GPUs.

#[cfg(feature = "remote")]
pub(crate) mod remote;
#[cfg(test)]
mod tests;
mod work;

#[cfg(all(feature = "wgpu", not(target_family = "wasm")))]
use std::sync::{Mutex, PoisonError};

use burn::backend::DispatchDevice;
use burn::tensor::Device;
#[cfg(feature = "wgpu")]
use burn::tensor::wgpu::WgpuBackend;
#[cfg(all(feature = "wgpu", not(target_family = "wasm")))]
use burn::tensor::wgpu::WgpuInitError;

use crate::error::{Error, Result};
pub use work::{Stage, Work, stages_of, work};
#[cfg(feature = "gpu")]
pub(crate) use work::{count_launch, count_searches, count_upload, kernel};
pub(crate) use work::{count_read_back, stage};

/// The environment variable with the default device of [`named`]. burn uses the same variable.
pub const VARIABLE: &str = "BURN_DEVICE";

/// The names of devices, CPUs first, and whether this program was built with the feature of that name.
const BACKENDS: [(&str, bool); 7] = [
    ("flex", cfg!(feature = "flex")),
    ("ndarray", cfg!(feature = "ndarray")),
    ("wgpu", cfg!(feature = "wgpu")),
    ("vulkan", cfg!(feature = "vulkan")),
    ("metal", cfg!(feature = "metal")),
    ("cuda", cfg!(feature = "cuda")),
    ("rocm", cfg!(feature = "rocm")),
];

/// Returns the device with a name: `flex`, `ndarray`, `wgpu`, `vulkan`, `metal`, `cuda` or `rocm`.
///
/// With `None` the name is the value of the environment variable `BURN_DEVICE`, or `flex` if that is not set. On
/// `wgpu`, `vulkan` and `metal` burn chooses the GPU (a high-power one if there is one) unless the name contains a
/// kind: `wgpu:discrete`, `wgpu:integrated`, `wgpu:virtual` or `wgpu:cpu` (a software driver). A number selects one of
/// several GPUs: `wgpu:discrete:1`, `cuda:1`. Case does not matter.
///
/// With the feature `remote`, `ws://host:port` and `iroh:<id>` are devices of servers (`softray::remote::connect`); the
/// environment variable `SOFTRAY_TOKEN` has the token.
///
/// The device has no autodiff. Put parameters on `device.autodiff()` and constants on the device itself.
///
/// ```
/// let device = softray::device::named(Some("flex"))?;
/// assert_eq!(device, burn::tensor::Device::flex());
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If the name is unknown, the program was built without the device's feature, or the machine lacks such a GPU or its
/// driver. burn's own `Device::vulkan` does not check this, and panics at the first tensor.
pub fn named(name: Option<&str>) -> Result<Device> {
    let variable = std::env::var(VARIABLE).ok();
    match (name, &variable) {
        (Some(name), _) => parse("name", name),
        (None, Some(name)) => parse(VARIABLE, name),
        (None, None) => parse("name", "flex"),
    }
}

#[allow(unreachable_patterns)] // earlier arms match the names of enabled features
#[allow(deprecated)] // burn deprecates ndarray, which this crate still supports
fn parse(field: &str, name: &str) -> Result<Device> {
    let lower = name.trim().to_lowercase();
    #[cfg(feature = "remote")]
    if lower.starts_with("ws://") || lower.starts_with("iroh:") {
        return remote::connect(&lower, &std::env::var(remote::TOKEN).unwrap_or_default());
    }
    let (backend, kind) = match lower.split_once(':') {
        Some((backend, kind)) => (backend, Some(kind)),
        None => (lower.as_str(), None),
    };
    let unknown = || Error::invalid("device", field, format!("{name:?}"), names());
    match (backend, kind) {
        #[cfg(feature = "flex")]
        ("flex", None) => Ok(Device::flex()),
        #[cfg(feature = "ndarray")]
        ("ndarray", None) => Ok(Device::ndarray()),
        #[cfg(feature = "wgpu")]
        ("wgpu", kind) => on_gpu(&lower, gpu(kind).ok_or_else(unknown)?, WgpuBackend::Auto),
        #[cfg(feature = "vulkan")]
        ("vulkan", kind) => on_gpu(&lower, gpu(kind).ok_or_else(unknown)?, WgpuBackend::Vulkan),
        #[cfg(feature = "metal")]
        ("metal", kind) => on_gpu(&lower, gpu(kind).ok_or_else(unknown)?, WgpuBackend::Metal),
        #[cfg(feature = "cuda")]
        ("cuda", number) => {
            let number = index(number).ok_or_else(unknown)?;
            available(&lower, burn::cubecl::Device::cuda(number), || {
                Device::cuda(number)
            })
        }
        #[cfg(feature = "rocm")]
        ("rocm", number) => {
            let number = index(number).ok_or_else(unknown)?;
            available(&lower, burn::cubecl::Device::rocm(number), || {
                Device::rocm(number)
            })
        }
        ("flex" | "ndarray", None) | ("wgpu" | "vulkan" | "metal" | "cuda" | "rocm", _) => {
            Err(Error::invalid(
                "device",
                field,
                format!("{name:?}"),
                format!(
                    "a backend that was built in; build with `--features {backend}` for this one, or in another \
                     crate with `softray = {{ …, features = [\"{backend}\"] }}` in Cargo.toml"
                ),
            ))
        }
        _ => Err(unknown()),
    }
}

/// Lists the names of devices and marks those that this program was built without.
fn names() -> String {
    let of = |built: bool| {
        let names = BACKENDS.iter().filter(|b| b.1 == built).map(|b| b.0);
        names.collect::<Vec<_>>().join(" or ")
    };
    let missing = match of(false) {
        none if none.is_empty() => String::new(),
        some => format!(", or {some} in a program that is built with the feature of that name"),
    };
    format!(
        "{}{missing}; a GPU may have a kind or a number after a colon, as in wgpu:cpu and cuda:1",
        of(true)
    )
}

/// Returns the name of a CPU backend without details of its device, or `None` on GPUs, with or without autodiff.
fn cpu(device: &Device) -> Option<&'static str> {
    match device.clone().inner().as_dispatch() {
        #[cfg(feature = "flex")]
        DispatchDevice::Flex(_) => Some("flex"),
        #[cfg(feature = "ndarray")]
        DispatchDevice::NdArray(_) => Some("ndarray"),
        #[allow(unreachable_patterns)] // if no other backend is enabled
        _ => None,
    }
}

/// Whether a device is a CPU. Tiles of rays then run on several host threads.
pub(crate) fn is_cpu(device: &Device) -> bool {
    cpu(device).is_some()
}

/// Checks that this crate supports scenes on a device's backend.
///
/// # Errors
/// For devices of other backends, and of servers without the feature `remote`. The message includes a remedy.
pub(crate) fn check(device: &Device) -> Result<()> {
    #[cfg(feature = "gpu")]
    if matches!(
        device.clone().inner().as_dispatch(),
        DispatchDevice::Cube(_)
    ) {
        return Ok(());
    }
    #[cfg(feature = "remote")]
    if remote::remote(device).is_some() {
        return Ok(());
    }
    match is_cpu(device) {
        true => Ok(()),
        false => Err(of_another_backend(label(device))),
    }
}

fn of_another_backend(label: String) -> Error {
    let message = format!(
        "this crate takes no scenes on devices of this backend; make the tensors of scene and camera on {}, and move \
         images to this device with `to_device`",
        names()
    );
    Error::device(label, message)
}

/// Whether kernels run on a device: on any of CubeCL's but its CPU, for which the host's kernels are faster.
#[cfg(feature = "gpu")]
pub(crate) fn runs_kernels(device: &Device) -> bool {
    let device = device.clone().inner();
    let DispatchDevice::Cube(device) = device.as_dispatch() else {
        return false;
    };
    !matches!(device, burn::cubecl::Device::Cpu(_))
}

/// Returns a device's name as in [`named`], or its debug text if [`named`] does not take it. Autodiff makes no
/// difference.
pub(crate) fn label(device: &Device) -> String {
    #[cfg(feature = "gpu")]
    match device.clone().inner().as_dispatch() {
        DispatchDevice::Cube(burn::cubecl::Device::Cuda(gpu)) => {
            return format!("cuda:{}", gpu.index);
        }
        DispatchDevice::Cube(burn::cubecl::Device::Hip(gpu)) => {
            return format!("rocm:{}", gpu.index);
        }
        _ => {}
    }
    #[cfg(feature = "wgpu")]
    if let DispatchDevice::Cube(burn::cubecl::Device::Wgpu(gpu)) =
        device.clone().inner().as_dispatch()
    {
        use burn::cubecl::device::WgpuDeviceKind::*;
        let backend = match gpu.backend {
            burn::cubecl::device::WgpuBackend::Auto => "wgpu".to_owned(),
            pinned => format!("{pinned:?}").to_lowercase(),
        };
        return match &gpu.kind {
            DiscreteGpu(n) => format!("{backend}:discrete:{n}"),
            IntegratedGpu(n) => format!("{backend}:integrated:{n}"),
            VirtualGpu(n) => format!("{backend}:virtual:{n}"),
            Cpu => format!("{backend}:cpu"),
            DefaultDevice => backend,
            other => format!("{backend}, {other:?}"),
        };
    }
    #[cfg(feature = "remote")]
    if let Some(address) = remote::address(device) {
        return address;
    }
    let inner = || format!("{:?}", device.clone().inner().as_dispatch());
    cpu(device).map_or_else(inner, str::to_owned)
}

/// A page may not wait for a GPU.
#[cfg(all(feature = "wgpu", target_family = "wasm"))]
fn on_gpu(name: &str, _: burn::tensor::DeviceKind, _: WgpuBackend) -> Result<Device> {
    let message =
        "a web page waits for its GPU by await, as in Device::wgpu_options().init_async().await?";
    Err(Error::device(name, message))
}

/// Initializes a wgpu device and returns it.
#[cfg(all(feature = "wgpu", not(target_family = "wasm")))]
fn on_gpu(name: &str, kind: burn::tensor::DeviceKind, api: WgpuBackend) -> Result<Device> {
    static STARTED: Mutex<Vec<Device>> = Mutex::new(Vec::new());
    let device = match api {
        #[cfg(feature = "vulkan")]
        WgpuBackend::Vulkan => Device::vulkan(kind.clone()),
        #[cfg(feature = "metal")]
        WgpuBackend::Metal => Device::metal(kind.clone()),
        _ => Device::wgpu(kind.clone()),
    };
    let mut started = STARTED.lock().unwrap_or_else(PoisonError::into_inner);
    if started.contains(&device) {
        return Ok(device);
    }
    let options = Device::wgpu_options().device_kind(kind).graphics_api(api);
    match options.init() {
        // A registration error means that the device is already initialized, such as by an earlier tensor.
        Ok(_) | Err(WgpuInitError::Registration { .. }) => {
            started.push(device.clone());
            Ok(device)
        }
        Err(WgpuInitError::AdapterUnavailable { message, .. }) => {
            // The rest is a long description of all adapters.
            let found = message.split(", adapters [").next().unwrap_or_default();
            let hint = match api {
                WgpuBackend::Metal => "",
                _ => {
                    " `vulkaninfo --summary` lists those of Vulkan, VK_DRIVER_FILES names one, wgpu:cpu takes a \
                     software driver;"
                }
            };
            let message = format!(
                "no such adapter was found ({found}). Is its driver installed?{hint} \"flex\" renders on the CPU \
                 without one"
            );
            Err(Error::device(name, message))
        }
        Err(other) => Err(Error::device(name, other.to_string())),
    }
}

/// Returns a device if the machine has it.
#[cfg(any(feature = "cuda", feature = "rocm"))]
fn available(
    name: &str,
    result: std::result::Result<burn::cubecl::Device, impl ToString>,
    device: impl FnOnce() -> Device,
) -> Result<Device> {
    match result {
        Ok(_) => Ok(device()),
        Err(reason) => Err(Error::device(name, reason.to_string())),
    }
}

/// Parses the number of a GPU; the first one if there is none.
#[cfg(any(feature = "cuda", feature = "rocm"))]
fn index(number: Option<&str>) -> Option<usize> {
    number.map_or(Some(0), |number| number.parse().ok())
}

#[cfg(feature = "wgpu")]
fn gpu(kind: Option<&str>) -> Option<burn::tensor::DeviceKind> {
    use burn::tensor::DeviceKind;
    let Some(kind) = kind else {
        return Some(DeviceKind::DefaultDevice);
    };
    let (kind, number) = match kind.split_once(':') {
        Some((kind, number)) => (kind, number.parse().ok()?),
        None => (kind, 0),
    };
    match kind {
        "discrete" => Some(DeviceKind::DiscreteGpu(number)),
        "integrated" => Some(DeviceKind::IntegratedGpu(number)),
        "virtual" => Some(DeviceKind::VirtualGpu(number)),
        "cpu" if number == 0 => Some(DeviceKind::Cpu),
        _ => None,
    }
}

/// The device of unit tests on GPUs: the one that `SOFTRAY_GPU` names, by default the first of the runtimes that are
/// built in.
#[cfg(all(test, feature = "gpu"))]
pub(crate) fn of_tests() -> Device {
    let name = std::env::var("SOFTRAY_GPU").unwrap_or_else(|_| {
        let first = BACKENDS[2..].iter().find(|b| b.1);
        first.expect("a feature of a GPU").0.to_owned()
    });
    named(Some(&name)).expect("the device of the tests")
}
