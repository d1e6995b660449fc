//! Clamped indirect light and albedos on a GPU beside the host.

use crate::common::numbers::{apart, furthest};
use crate::common::scenes::{diffuse, floor, lamp};
use crate::common::tensors::values;
use crate::device::device;
use burn::tensor::Device;
use softray::prelude::*;

fn at(device: &Device, options: RenderOptions) -> Image {
    let ball = shapes::icosphere(2, device).translated([0.0, 1.0, 0.0]);
    let gold = Material::conductor([0.2, 0.9, 1.1], [3.9, 2.4, 2.2], 0.4);
    let scene = Scene::new()
        .with_object(diffuse(floor(2.0, 0.0, device), [0.5, 0.6, 0.7]))
        .with_object(Object::new(ball).with_material(gold))
        .with_object(lamp(0.3, 3.0, [40.0, 30.0, 20.0], device))
        .with_environment([0.4, 0.5, 0.6]);
    let camera = Camera::look_at([0.0, 3.0, 6.0], [0.0, 1.0, 0.0]).with_fov_y(40.0);
    render(&scene, &camera, &options).expect("an image")
}

/// The same formulas: the images differ by rounding, and in few pixels a path passes a seam.
#[test]
fn clamps_and_albedos_are_those_of_the_host() {
    let options = RenderOptions::new(24, 24).with_samples(16).with_bounces(2);
    let free = at(&Device::flex(), options.clone());
    let options = options.with_indirect_clamp(0.2).with_albedo();
    let [gpu, host] = [device(), Device::flex()].map(|device| at(&device, options.clone()));
    let of = |image: &Image| values(&image.radiance);
    assert!(apart(&of(&gpu), &of(&host)) < 1e-4);
    assert!(apart(&of(&free), &of(&host)) > 1e-2);
    let albedo = |image: Image| values(&image.albedo.expect("albedo"));
    assert!(furthest(&albedo(gpu), &albedo(host)) < 1e-4);
}
