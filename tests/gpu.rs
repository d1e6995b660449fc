//! Kernels on a GPU beside those of the host.
#![cfg(feature = "wgpu")]

mod common;

use std::time::Instant;

use burn::tensor::{Device, DeviceKind};
use common::scenes::scene_file;
use common::tensors::radiance;
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

#[test]
fn cornell() {
    let at = |device: &Device, bounces: u32| {
        let file = scene_file("cornell", device);
        let options = RenderOptions::new(64, 64)
            .samples(64)
            .bounces(bounces)
            .seed(2);
        let start = Instant::now();
        let image = radiance(&file.scene, &file.camera, &options);
        println!("{device:?} {bounces} {:?}", start.elapsed());
        image
    };
    for bounces in [0, 3] {
        let gpu = at(&device(), bounces);
        let again = at(&device(), bounces);
        assert_eq!(gpu, again);
        let cpu = at(&Device::flex(), bounces);
        let worst = gpu
            .iter()
            .zip(&cpu)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        println!("largest {worst:e}");
    }
}
