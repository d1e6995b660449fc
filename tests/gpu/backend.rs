//! The tests that depend on the backend, on wgpu.

use crate::common::numbers::{furthest, norm};
use crate::common::process::again;
use crate::common::scenes::scene_file;
use crate::common::tensors::{gradient, radiance};
use crate::device::{Flips, device, setup};
use burn::tensor::{DType, Device};
use softray::prelude::*;

/// In a process of its own, whose loader finds no driver.
#[test]
fn a_machine_without_the_device_is_an_error() {
    if std::env::var_os("SOFTRAY_NO_DRIVER").is_some() {
        let said = |name| match softray::device::named(Some(name)) {
            Ok(_) => "a device".to_owned(),
            Err(error) => error.to_string(),
        };
        #[cfg(feature = "vulkan")]
        println!("\nerror {}", said("vulkan"));
        println!("\nerror {}", said("wgpu:discrete:40"));
        return;
    }
    let output = again(a_machine_without_the_device_is_an_error)
        .env("SOFTRAY_NO_DRIVER", "1")
        .env("VK_DRIVER_FILES", "/nowhere/driver.json")
        .env("VK_ICD_FILENAMES", "/nowhere/driver.json")
        .output()
        .expect("a process");
    let text = String::from_utf8_lossy(&output.stdout);
    let errors: Vec<&str> = text
        .lines()
        .filter_map(|l| l.strip_prefix("error "))
        .collect();
    println!("{errors:#?}");
    assert_eq!(
        errors.len(),
        1 + usize::from(cfg!(feature = "vulkan")),
        "{output:?}"
    );
    let named = if cfg!(feature = "vulkan") {
        "vulkan"
    } else {
        "wgpu"
    };
    assert!(
        errors[0].starts_with(&format!("device {named}")),
        "{errors:?}"
    );
    for message in errors {
        for part in ["adapter", "driver", "VK_DRIVER_FILES", "flex"] {
            assert!(message.contains(part), "no {part:?} in {message}");
        }
    }
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(!errors.contains("panicked"), "{errors}");
}

#[test]
fn a_device_that_allows_too_few_bindings_is_an_error() {
    use burn::tensor::wgpu::wgpu;
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let setup = setup(instance, |limits| {
        limits.max_storage_buffers_per_shader_stage = 7;
    });
    let device = Device::wgpu_options().setup(setup).init();
    let device = device.expect("a device");
    let file = scene_file("cornell", &device);
    let options = RenderOptions::new(8, 8).with_samples(1);
    let error = render(&file.scene, &file.camera, &options).expect_err("few bindings");
    let error = error.to_string();
    println!("{error}");
    for part in ["device", "7 buffers", "allows 7", "CPU"] {
        assert!(error.contains(part), "no {part:?} in {error}");
    }
}

#[test]
fn an_image_tells_what_program_ran() {
    let ran = |device: &Device, engine: Engine| {
        let file = scene_file("cornell", device);
        let options = RenderOptions::new(4, 4).with_samples(1).with_engine(engine);
        let image = render(&file.scene, &file.camera, &options).expect("an image");
        image.statistics.program
    };
    assert_eq!(ran(&device(), Engine::Auto), Program::DeviceKernels);
    assert_eq!(ran(&device(), Engine::Tensors), Program::Tensors);
    assert_eq!(ran(&Device::flex(), Engine::Kernels), Program::HostKernels);
}

#[test]
fn the_image_is_that_of_the_cpu_and_repeats() {
    for form in [Visibility::default(), Visibility::softmax(1e-2, 1e-3)] {
        image_of_the_cpu(form);
    }
}

fn image_of_the_cpu(form: Visibility) {
    const SAMPLES: u32 = 16;
    let at = |device: &Device| {
        let file = scene_file("cornell", device);
        let options = RenderOptions::new(32, 32)
            .with_samples(SAMPLES)
            .with_bounces(1)
            .with_visibility(form)
            .with_seed(2);
        radiance(&file.scene, &file.camera, &options)
    };
    let gpu = at(&device());
    assert_eq!(gpu, at(&device()));
    let cpu = at(&Device::flex());
    let flips = Flips::of(&gpu, &cpu);
    println!("{form:?}: {flips:?}");
    flips.assert_at_most(3, SAMPLES);
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
        let options = RenderOptions::new(12, 12)
            .with_samples(8)
            .with_bounces(0)
            .with_seed(3);
        let image = render(&scene, &file.camera, &options).expect("an image");
        let gradients = image.radiance.powf_scalar(2.0).sum().backward();
        gradient(&offset, &gradients)
    };
    let (gpu, cpu) = (at(&device()), at(&Device::flex()));
    let norm = norm(&cpu);
    let apart = furthest(&gpu, &cpu);
    assert!(apart < 1e-2 * norm, "{gpu:?}, on the CPU {cpu:?}");
}

#[test]
fn every_gradient_of_the_softmax_is_that_of_the_cpu() {
    use crate::common::gradients::{Effort, SOFTMAX, Setup, all_classes, assert_agreement};
    let (gpu, cpu) = (device(), Device::flex());
    let setups: [Setup; 2] = [(&gpu, |o| o), (&cpu, |o| o)];
    let effort = Effort {
        samples: 4,
        ..SOFTMAX
    };
    assert_agreement(&all_classes(), setups, DType::F32, effort, |_| 1e-2);
}

/// The tensor program on the device beside the kernels, for the same seed.
#[test]
fn both_engines_agree() {
    use crate::common::gradients::{CONES, Effort, Setup, all_classes, assert_agreement};
    let gpu = device();
    let setups: [Setup; 2] = [(&gpu, |o| o), (&gpu, |o| o.with_engine(Engine::Tensors))];
    let effort = Effort {
        samples: 4,
        ..CONES
    };
    // Rounding in f32 tips a draw now and then: 1e-3 of a derivative, where most are 1e-6 apart.
    assert_agreement(&all_classes(), setups, DType::F32, effort, |_| 3e-3);
}

/// Of the loss and of each parameter's gradient: f32, sums in another order, which is 5e-7 on a software driver.
#[test]
fn a_training_step_is_that_of_the_cpu() {
    use crate::common::training::{assert_close, assert_taught, step};
    let gpu = step(&device());
    assert_taught(&gpu);
    assert_close(&gpu, &step(&Device::flex()), 1e-4);
}

/// A sample of the scenes at the edge of what floats hold.
#[test]
fn images_and_gradients_are_finite() {
    use crate::common::stress::{Failures, cases::cases};
    let mut failures = Failures::default();
    for (name, world) in cases().into_iter().step_by(23) {
        println!("{name}");
        failures.note(&name, world.run(&device(), DType::F32));
    }
    failures.assert_none();
}
