//! A shadow alone moves its caster: the camera does not see the triangle.

use crate::common;
use crate::common::numbers::{apart, mean};
use crate::common::scenes::scene_file;
use crate::common::tensors::gradient;
use burn::tensor::Device;
use rayon::prelude::*;
use softray::prelude::*;

/// The derivative image of the occluder's translation in x, pixel by pixel, against central
/// differences of unblurred renders: each pixel is a render with a backward pass of its own.
fn agrees_with_unblurred_differences(visibility: Visibility) {
    let device = Device::flex();
    let file = scene_file("shadow", &device);
    let expected =
        HostImage::read(common::reference("shadow/gradient-occluder-x.exr")).expect("a reference");
    let samples = if common::long() { 1024 } else { 64 };
    let options = RenderOptions::new(file.width, file.height)
        .with_samples(samples)
        .with_bounces(0)
        .with_visibility(visibility);
    let derivative = |pixel: u32| {
        let offset = Tensor::<1>::zeros([3], &device).autodiff().require_grad();
        let scene = file
            .scene
            .clone()
            .map_object("occluder", |o| o.map_mesh(|m| m.translated(offset.clone())))
            .expect("the object");
        let image = render_pixels(&scene, &file.camera, &options, &[pixel]).expect("a pixel");
        let gradients = image.radiance.sum().backward();
        gradient(&offset, &gradients)[0]
    };
    let count = (file.width * file.height) as u32;
    let found: Vec<f64> = (0..count).into_par_iter().map(derivative).collect();
    let wanted: Vec<f64> = expected
        .pixels
        .chunks_exact(3)
        .map(|p| p.iter().map(|&v| f64::from(v)).sum())
        .collect();

    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let centerd = |v: &[f64]| {
        let mean = mean(v);
        v.iter().map(|x| x - mean).collect::<Vec<f64>>()
    };
    let (a, b) = (centerd(&found), centerd(&wanted));
    let correlation = dot(&a, &b) / (dot(&a, &a) * dot(&b, &b)).sqrt();
    let slope = dot(&found, &wanted) / dot(&wanted, &wanted);
    let error = apart(&found, &wanted);
    println!("correlation {correlation}, slope {slope}, relative L2 error {error}");
    assert!(correlation > 0.98, "{correlation}");
    assert!((0.95..1.05).contains(&slope), "{slope}");
    assert!(error < if common::long() { 0.1 } else { 0.2 }, "{error}");
}

#[test]
fn in_softmax_form() {
    agrees_with_unblurred_differences(Visibility::softmax(1e-3, 1e-2));
}

#[test]
fn by_cones() {
    agrees_with_unblurred_differences(Visibility::default());
}
