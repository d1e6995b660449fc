//! How a render samples changes its noise, not what it converges to: mean and gradient.

mod common;

use burn::tensor::{Device, Tensor};
use common::values;
use softray::prelude::*;

/// The default with one part put back to the paper's at a time.
fn variants() -> Vec<(&'static str, Sampling)> {
    let change = |f: &dyn Fn(&mut Sampling)| {
        let mut sampling = Sampling::default();
        f(&mut sampling);
        sampling
    };
    let plain = Sampling::paper();
    vec![
        ("default", Sampling::default()),
        ("independent", change(&|s| s.sequence = plain.sequence)),
        ("uniform emitters", change(&|s| s.emitters = plain.emitters)),
        ("by power", change(&|s| s.emitters = EmitterSampling::Power)),
        ("one strategy", change(&|s| s.multiple_importance = false)),
    ]
}

/// A room with a large light near a glossy floor, a small bright one in another plane, and a ball.
fn room(offset: &Tensor<1>, shininess: &Tensor<1>, device: &Device) -> Scene {
    let level = |x: [f64; 2], z: [f64; 2], y: f64, up: bool| {
        let mut corners = [
            [x[0], y, z[1]],
            [x[1], y, z[1]],
            [x[1], y, z[0]],
            [x[0], y, z[0]],
        ];
        if !up {
            corners.reverse();
        }
        let [a, b, c, d] = corners;
        Object::new(shapes::quad(a, b, c, d, device))
    };
    let gloss = Material::diffuse([0.2, 0.25, 0.3]).specular([0.6; 3], shininess.clone());
    let ball = shapes::icosphere(1, device)
        .scaled(Tensor::from_floats([0.4], device))
        .translated(Tensor::from_floats([0.3, 0.5, 0.2], device) + offset.clone());
    Scene::new()
        .with(level([-2.0, 2.0], [-2.0, 2.0], 0.0, true).material(gloss))
        .with(level([-1.2, 1.0], [-1.9, -0.2], 2.0, false).material(Material::emitter([2.0; 3])))
        .with(level([1.2, 1.3], [0.5, 0.6], 1.1, false).material(Material::emitter([60.0; 3])))
        .with(Object::new(ball).material(Material::diffuse([0.5, 0.4, 0.3])))
}

/// Mean radiance, and the derivatives by the ball's place and the floor's shininess.
fn of(sampling: Sampling, seed: u64) -> [f64; 3] {
    let device = Device::flex();
    let leaf = |v: &[f32]| {
        Tensor::<1>::from_floats(v, &device)
            .autodiff()
            .require_grad()
    };
    let (offset, shininess) = (leaf(&[0.0; 3]), leaf(&[30.0]));
    let options = RenderOptions::new(12, 12)
        .samples(16)
        .bounces(1)
        .sampling(sampling)
        .seed(seed);
    let camera = Camera::look_at([0.0, 1.2, 4.0], [0.0, 0.6, 0.0]).fov_y(45.0);
    let scene = room(&offset, &shininess, &device);
    let mean = render(&scene, &camera, &options)
        .expect("an image")
        .radiance
        .mean();
    let gradients = mean.backward();
    let by = |t: &Tensor<1>| values(&t.grad(&gradients).expect("a gradient"));
    let along = by(&offset);
    [
        values(&mean)[0],
        along[0] + 0.5 * along[1] - along[2],
        by(&shininess)[0],
    ]
}

fn estimate(all: &[[f64; 3]], i: usize) -> (f64, f64) {
    let n = all.len() as f64;
    let mean = all.iter().map(|v| v[i]).sum::<f64>() / n;
    let squares: f64 = all.iter().map(|v| (v[i] - mean).powi(2)).sum();
    (mean, (squares / (n - 1.0) / n).sqrt())
}

#[test]
fn mean_and_gradients_stay() {
    let seeds = if common::long() { 1024 } else { 96 };
    let run = |s| -> Vec<[f64; 3]> { (0..seeds).map(|seed| of(s, seed)).collect() };
    let plain = run(Sampling::paper());
    for (name, sampling) in variants() {
        let found = run(sampling);
        for (i, what) in ["mean", "ball", "shininess"].iter().enumerate() {
            let ((a, ea), (b, eb)) = (estimate(&found, i), estimate(&plain, i));
            println!("{name}, {what}: {a:.4e} ± {ea:.1e}, plain {b:.4e} ± {eb:.1e}");
            let error = ea.hypot(eb);
            assert!((a - b).abs() < 4.0 * error, "{name}, {what}: {a} and {b}");
        }
    }
}

/// A large light mirrored by a shiny floor: points chosen by the BSDF as well take most of the noise
/// away.
#[test]
fn both_strategies_find_a_mirrored_light() {
    let device = Device::flex();
    let scene = room(
        &Tensor::zeros([3], &device),
        &Tensor::from_floats([2000.0], &device),
        &device,
    );
    let camera = Camera::look_at([0.0, 1.0, 3.0], [0.0, 0.0, 0.0]).fov_y(40.0);
    let image = |sampling, samples, seed| {
        let options = RenderOptions::new(24, 24)
            .samples(samples)
            .bounces(0)
            .sampling(sampling)
            .seed(seed);
        values(
            &render(&scene, &camera, &options)
                .expect("an image")
                .radiance,
        )
    };
    let mut one = Sampling::default();
    one.multiple_importance = false;
    let expected = image(Sampling::default(), 4096, 9);
    let rmse = |sampling| {
        let found = image(sampling, 64, 2);
        let squares = found.iter().zip(&expected).map(|(a, b)| (a - b).powi(2));
        (squares.sum::<f64>() / found.len() as f64).sqrt()
    };
    let (both, one) = (rmse(Sampling::default()), rmse(one));
    println!("both {both}, one {one}");
    assert!(both < 0.3 * one, "{both}, {one}");
}

/// One path for each surface of a camera ray that matters: where a ray meets one surface, one.
#[test]
fn paths_are_split_only_where_surfaces_share_a_ray() {
    let device = Device::flex();
    let scene = room(
        &Tensor::zeros([3], &device),
        &Tensor::from_floats([10.0], &device),
        &device,
    );
    let camera = Camera::look_at([0.0, 1.2, 4.0], [0.0, 0.6, 0.0]).fov_y(45.0);
    let rays = |surfaces, sigma| {
        let mut sampling = Sampling::default();
        sampling.surfaces = surfaces;
        let options = RenderOptions::new(32, 32)
            .samples(4)
            .bounces(1)
            .visibility(Visibility::softmax(sigma, 1e-3))
            .sampling(sampling);
        let image = render(&scene, &camera, &options).expect("an image");
        image.statistics.bounces[1] as f64
    };
    let more = |sigma| rays(SurfaceSampling::Split, sigma) / rays(SurfaceSampling::Drawn, sigma);
    let (sharp, blurred) = (more(1e-8), more(1e-2));
    println!("{sharp}, {blurred}");
    assert!(sharp < 1.02 && sharp > 0.98, "{sharp}");
    assert!(blurred > 1.02 && blurred < 2.0, "{blurred}");
}
