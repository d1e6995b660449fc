//! The tests that depend on the backend, on wgpu: a GPU or a software Vulkan driver.
//!
//! `SOFTRAY_WGPU_KIND=cpu` picks a software adapter.
#![cfg(feature = "wgpu")]

mod common;

use burn::tensor::{DType, Device, DeviceKind};
use common::numbers::norm;
use common::scenes::scene_file;
use common::tensors::{gradient, radiance};
use softray::prelude::*;

fn kind() -> DeviceKind {
    match std::env::var("SOFTRAY_WGPU_KIND").as_deref() {
        Ok("cpu") => DeviceKind::Cpu,
        _ => DeviceKind::DefaultDevice,
    }
}

fn device() -> Device {
    #[cfg(feature = "vulkan")]
    return Device::vulkan(kind());
    #[cfg(not(feature = "vulkan"))]
    Device::wgpu(kind())
}

#[test]
fn the_image_is_that_of_the_cpu_and_repeats() {
    for form in [Visibility::default(), Visibility::softmax(1e-2, 1e-3)] {
        image_of_the_cpu(form);
    }
}

fn image_of_the_cpu(form: Visibility) {
    let at = |device: &Device| {
        let file = scene_file("cornell", device);
        let options = RenderOptions::new(32, 32)
            .samples(16)
            .bounces(1)
            .visibility(form)
            .seed(2);
        radiance(&file.scene, &file.camera, &options)
    };
    let gpu = at(&device());
    assert_eq!(gpu, at(&device()));
    let cpu = at(&Device::flex());
    let close = common::images::share_of_close_pixels(&gpu, &cpu);
    println!("{:.2} % of the pixels within 1e-3", 100.0 * close);
    assert!(close >= 0.99, "{close}");
}

#[test]
fn gradients_are_those_of_the_cpu() {
    let at = |device: &Device| {
        let file = scene_file("shadow", device);
        let offset = Tensor::<1>::zeros([3], device).autodiff().require_grad();
        let scene = file
            .scene
            .map_object("occluder", |o| o.map_mesh(|m| m.translated(offset.clone())))
            .expect("the object");
        let options = RenderOptions::new(12, 12).samples(8).bounces(0).seed(3);
        let image = render(&scene, &file.camera, &options).expect("an image");
        let gradients = image.radiance.powf_scalar(2.0).sum().backward();
        gradient(&offset, &gradients)
    };
    let (gpu, cpu) = (at(&device()), at(&Device::flex()));
    let norm = norm(&cpu);
    for (g, c) in gpu.iter().zip(&cpu) {
        assert!((g - c).abs() < 1e-2 * norm, "{gpu:?}, on the CPU {cpu:?}");
    }
}

#[test]
fn every_gradient_of_the_softmax_is_that_of_the_cpu() {
    use common::gradients::{Effort, SOFTMAX, Setup, agreement};
    let (gpu, cpu) = (device(), Device::flex());
    let setups: [Setup; 2] = [(&gpu, |o| o), (&cpu, |o| o)];
    let effort = Effort {
        samples: 4,
        ..SOFTMAX
    };
    for (case, apart) in agreement(setups, DType::F32, effort) {
        assert!(apart < 1e-2, "{case}: {apart:e}");
    }
}

/// The tensor program on the device beside the kernels, for the same seed.
#[test]
fn both_engines_agree() {
    use common::gradients::{CONES, Effort, Setup, agreement};
    let gpu = device();
    let setups: [Setup; 2] = [(&gpu, |o| o), (&gpu, |o| o.engine(Engine::Tensors))];
    let effort = Effort {
        samples: 4,
        ..CONES
    };
    // Rounding in f32 tips a draw now and then.
    for (case, apart) in agreement(setups, DType::F32, effort) {
        assert!(apart < 2e-2, "{case}: {apart:e}");
    }
}

/// Of the loss and of each parameter's gradient: f32, sums in another order.
#[test]
fn a_training_step_is_that_of_the_cpu() {
    use common::training::{assert_close, assert_taught, step};
    let gpu = step(&device());
    assert_taught(&gpu);
    assert_close(&gpu, &step(&Device::flex()), 5e-2);
}

/// A sample of the scenes at the edge of what floats hold.
#[test]
fn images_and_gradients_are_finite() {
    use common::stress::{Failures, cases::cases};
    let mut failures = Failures::default();
    for (name, world) in cases().into_iter().step_by(23) {
        failures.note(&name, world.run(&device(), DType::F32));
    }
    failures.assert_none();
}
