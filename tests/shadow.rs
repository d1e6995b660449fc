//! A shadow alone moves its caster: the camera does not see the triangle.

mod common;

use burn::tensor::Device;
use common::values;
use rayon::prelude::*;
use softray::prelude::*;

const SIGMA: f64 = 1e-3;

/// The derivative image of the occluder's translation in x against central differences of
/// unblurred renders. One backward pass gives Σ weight·d image/dx, so the image is projected on
/// the reference itself, for the slope, and on blocks of 8 × 8 pixels, for the correlation.
fn agrees_with_unblurred_differences(visibility: Visibility) {
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
            .sigma(SIGMA)
            .visibility(visibility)
            .seed(seed);
        let image = render(&scene, &file.camera, &options).expect("an image");
        let gradients = (image.radiance * weights.clone()).sum().backward();
        values(&offset.grad(&gradients).expect("a gradient"))[0]
    };
    let mean = |weights: &Tensor<3>, seeds: u64| {
        let all: Vec<f64> = (0..seeds)
            .into_par_iter()
            .map(|s| project(weights, s))
            .collect();
        all.iter().sum::<f64>() / all.len() as f64
    };
    let square: f64 = expected.pixels.iter().map(|&v| f64::from(v).powi(2)).sum();
    // The least-squares slope of the rendered derivative over the reference.
    let slope = mean(&weights, seeds) / square;
    println!("slope {slope}");
    assert!((0.9..1.1).contains(&slope), "{slope}");

    let (w, h) = (file.width, file.height);
    let (mut found, mut wanted) = (Vec::new(), Vec::new());
    for block in 0..(w / 8) * (h / 8) {
        let (by, bx) = (block / (w / 8), block % (w / 8));
        let mut mask = vec![0f32; w * h * 3];
        let mut sum = 0.0;
        for (i, m) in mask.iter_mut().enumerate() {
            if i / 3 / w / 8 == by && i / 3 % w / 8 == bx {
                *m = 1.0;
                sum += f64::from(expected.pixels[i]);
            }
        }
        let mask = HostImage::new(w, h, mask)
            .expect("an image")
            .to_tensor(&device);
        found.push(mean(&mask, seeds / 4));
        wanted.push(sum);
    }
    let correlation = correlation(&found, &wanted);
    println!("correlation {correlation}");
    assert!(correlation > 0.9, "{correlation}");
}

#[test]
fn in_softmax_form() {
    agrees_with_unblurred_differences(Visibility::softmax(1e-2));
}

#[test]
fn in_layered_form() {
    agrees_with_unblurred_differences(Visibility::Layered);
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let (ma, mb) = (mean(a), mean(b));
    let dot = |f: &dyn Fn(usize) -> f64| (0..a.len()).map(f).sum::<f64>();
    dot(&|i| (a[i] - ma) * (b[i] - mb))
        / (dot(&|i| (a[i] - ma).powi(2)) * dot(&|i| (b[i] - mb).powi(2))).sqrt()
}
