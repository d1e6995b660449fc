//! Memory of a GPU, alone in its process, which is what is measured.
#![cfg(feature = "wgpu")]

mod common;

use burn::tensor::{Device, DeviceKind};
use common::scenes::{diffuse, facing_front, floor, lamp};
use common::tensors::{gradient, leaf};
use softray::prelude::*;

fn device() -> Device {
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

/// A step of a training: the gradient by the place of a square.
fn step(device: &Device, options: &RenderOptions) -> Vec<f64> {
    let place = leaf(&[0.1, 0.6, 0.1], device);
    let square = facing_front([-0.5, 0.4], [-0.4, 0.5], 0.0, device).translated(place.clone());
    let scene = Scene::new()
        .with(diffuse(floor(2.0, 0.0, device), [0.5, 0.4, 0.3]))
        .with(lamp(0.5, 2.4, [5.0, 4.0, 3.0], device))
        .with(diffuse(square, [0.3, 0.5, 0.6]));
    let camera = Camera::look_at([0.3, 1.4, 4.0], [0.0, 0.3, 0.0]);
    let image = render(&scene, &camera, options).expect("an image");
    let gradients = image.radiance.powf_scalar(2.0).sum().backward();
    gradient(&place, &gradients)
}

/// Bytes that are in use and bytes that are reserved.
fn bytes(device: &Device) -> [u64; 2] {
    let usage = device.memory_pool_usage().expect("a device that tells");
    [usage.bytes_in_use, usage.bytes_reserved]
}

#[test]
fn memory_is_flat_over_steps_and_samples() {
    let device = device();
    let options = |samples| RenderOptions::new(16, 16).samples(samples).bounces(1);
    let mut sizes = Vec::new();
    for seed in 0..30 {
        step(&device, &options(4).seed(seed));
        sizes.push(bytes(&device));
    }
    println!("bytes in use and reserved by steps: {sizes:?}");
    assert!(sizes[2][1] > 0);
    // Pools keep what a few steps needed.
    assert!(
        sizes[3..]
            .iter()
            .all(|s| s[0] <= sizes[2][0] && s[1] <= sizes[2][1])
    );
    // So many surfaces a path that the records of four samples are all that is kept at once.
    let mut long = Vec::new();
    for samples in [4, 4, 64] {
        let options = options(samples).bounces(2500);
        step(&device, &options);
        long.push(bytes(&device));
    }
    println!("with 4, 4 and 64 samples: {long:?}");
    assert!(long[0][1] > sizes[29][1]);
    assert!(
        long[2][0] <= long[1][0] && long[2][1] <= long[1][1],
        "{long:?}"
    );
}
