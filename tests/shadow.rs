//! A shadow alone moves its caster: the camera does not see the triangle.

mod common;

use burn::tensor::Device;
use common::values;
use rayon::prelude::*;
use softray::prelude::*;

/// The derivative image of the occluder's translation in x against central differences of
/// unblurred renders. One backward pass gives Σ weight·d image/dx, so the image is projected on
/// the reference itself and on ones.
#[test]
fn its_gradient_is_that_of_unblurred_differences() {
    let device = Device::flex();
    let file = SceneFile::load(common::reference("shadow/scene.json"), &device).expect("a scene");
    let expected =
        HostImage::read(common::reference("shadow/gradient-occluder-x.exr")).expect("a reference");
    let weights = expected.to_tensor(&device);
    let (samples, seeds) = if common::long() { (64, 64) } else { (16, 8) };
    let project = |weights: &Tensor<3>, seed: u64| {
        let offset = Tensor::<1>::zeros([3], &device).autodiff().require_grad();
        let scene = file
            .scene
            .clone()
            .map_object("occluder", |o| o.map_mesh(|m| m.translated(offset.clone())));
        let options = RenderOptions::new(file.width, file.height)
            .samples(samples)
            .bounces(0)
            .blur(1e-3, 1e-2)
            .seed(seed);
        let image = render(&scene, &file.camera, &options).expect("an image");
        let gradients = (image.radiance * weights.clone()).sum().backward();
        values(&offset.grad(&gradients).expect("a gradient"))[0]
    };
    let mean = |weights: &Tensor<3>| {
        let all: Vec<f64> = (0..seeds)
            .into_par_iter()
            .map(|s| project(weights, s))
            .collect();
        all.iter().sum::<f64>() / all.len() as f64
    };
    let square: f64 = expected.pixels.iter().map(|&v| f64::from(v).powi(2)).sum();
    // The least-squares slope of the rendered derivative over the reference.
    let slope = mean(&weights) / square;
    println!("slope {slope}");
    assert!((0.9..1.1).contains(&slope), "{slope}");
}
