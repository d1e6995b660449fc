//! Memory of a GPU.

use crate::common::process::alone;
use crate::common::scenes::{diffuse, facing_front, floor, lamp};
use crate::common::tensors::{gradient, leaf, values};
use crate::device::device;
use burn::tensor::Device;
use softray::prelude::*;

/// A step of a training: the gradient by the place of a square.
fn step(device: &Device, options: &RenderOptions) -> Vec<f64> {
    let place = leaf(&[0.1, 0.6, 0.1], device);
    let square = facing_front([-0.5, 0.4], [-0.4, 0.5], 0.0, device).translated(place.clone());
    let scene = Scene::new()
        .with_object(diffuse(floor(2.0, 0.0, device), [0.5, 0.4, 0.3]))
        .with_object(lamp(0.5, 2.4, [5.0, 4.0, 3.0], device))
        .with_object(diffuse(square, [0.3, 0.5, 0.6]));
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

/// The derivatives of an image by two numbers, of so many samples.
fn derive(device: &Device, samples: u32) {
    let build = |device: &Device, v: &[f64]| {
        let square = facing_front([-0.5, 0.4], [-0.4, 0.5], 0.0, device);
        let square = square.translated([v[0], 0.6, 0.1]);
        let scene = Scene::new()
            .with_object(diffuse(floor(2.0, 0.0, device), [0.5, 0.4, 0.3]))
            .with_object(lamp(0.5, 2.4, [5.0, v[1], 3.0], device))
            .with_object(diffuse(square, [0.3, 0.5, 0.6]));
        Ok((scene, Camera::look_at([0.3, 1.4, 4.0], [0.0, 0.3, 0.0])))
    };
    let numbers = [0.1, 4.0];
    let of_numbers = Tangent::of_numbers(&numbers, |v| build(&Device::flex(), v));
    let (_, _, tangents) = of_numbers.expect("tangents");
    let (scene, camera) = build(device, &numbers).expect("a scene");
    // A path may have so many surfaces that not all records are kept at once.
    let options = RenderOptions::new(16, 16)
        .with_samples(samples)
        .with_bounces(700);
    let all = render_derivative(&scene, &camera, &options, &tangents).expect("derivatives");
    assert!(values(&all.tangents.radiance).iter().any(|&v| v != 0.0));
}

/// Most bytes of the records of a backward pass, and a third more for all else.
const MOST: u64 = 700 << 20;

/// So many samples that their records would take more, in the long tier.
fn many() -> u32 {
    if crate::common::long() { 64 } else { 16 }
}

/// Derivatives along directions leave nothing behind, and take limited memory for any number of samples.
#[test]
fn memory_of_derivatives_is_limited() {
    if !alone(memory_of_derivatives_is_limited) {
        return;
    }
    let device = device();
    let mut sizes = Vec::new();
    for samples in [4, 4, many()] {
        derive(&device, samples);
        sizes.push(bytes(&device));
    }
    println!(
        "bytes in use and reserved with 4, 4 and {} samples: {sizes:?}",
        many()
    );
    let [[_, first], [used, again], [used_more, more]] = sizes[..] else {
        panic!("three sizes")
    };
    assert!(first > 0 && again.max(more) < MOST);
    assert!(used_more <= used + 64 * 1024);
    device.memory_cleanup();
    assert_eq!(bytes(&device)[0], 0);
}

#[test]
fn memory_is_flat_over_steps() {
    if !alone(memory_is_flat_over_steps) {
        return;
    }
    let device = device();
    let options = |samples| {
        RenderOptions::new(16, 16)
            .with_samples(samples)
            .with_bounces(1)
    };
    let mut sizes = Vec::new();
    for seed in 0..30 {
        step(&device, &options(4).with_seed(seed));
        sizes.push(bytes(&device));
    }
    println!("bytes in use and reserved by steps: {sizes:?}");
    let ([used, reserved], [used_later, reserved_later]) = (sizes[2], sizes[29]);
    // CubeCL keeps the numbers that some hundred launches were given. An image of a step has 3 KiB, its records 200.
    assert!(used > 0 && used_later <= used + 27 * 1024);
    assert!(10 * reserved_later <= 11 * reserved);
    device.memory_cleanup();
    assert_eq!(bytes(&device)[0], 0);
    // A path may have so many surfaces that not all records are kept at once. The first step takes few paths a launch, and
    // measures how many the others take. Gradients do not depend on it.
    let mut long = Vec::new();
    for samples in [8, 8, many()] {
        let by = step(&device, &options(samples).with_bounces(700));
        long.push((bytes(&device)[1], by));
    }
    let reserved: Vec<u64> = long.iter().map(|l| l.0).collect();
    println!(
        "bytes reserved with 8, 8 and {} samples: {reserved:?}",
        many()
    );
    assert!(reserved[0] > 4 * reserved_later && reserved[2] < MOST);
    assert_eq!(long[0].1, long[1].1);
}
