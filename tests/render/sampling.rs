//! How a render samples changes its noise, not what it converges to: mean and gradient.

use crate::common;
use crate::common::numbers::{mean_and_error, rmse};
use crate::common::scenes::{diffuse, emitting, facing_down, facing_up};
use crate::common::tensors::{gradient, leaf, radiance, row, values};
use burn::tensor::{Device, Tensor};
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
    let gloss = Material::phong([0.2, 0.25, 0.3], [0.6; 3], shininess.clone());
    let ball = shapes::icosphere(1, device)
        .scaled(Tensor::from_floats([0.4], device))
        .translated(Tensor::from_floats([0.3, 0.5, 0.2], device) + offset.clone());
    Scene::new()
        .with_object(
            Object::new(facing_up([-2.0, 2.0], [-2.0, 2.0], 0.0, device)).with_material(gloss),
        )
        .with_object(emitting(
            facing_down([-1.2, 1.0], [-1.9, -0.2], 2.0, device),
            [2.0; 3],
        ))
        .with_object(emitting(
            facing_down([1.2, 1.3], [0.5, 0.6], 1.1, device),
            [60.0; 3],
        ))
        .with_object(diffuse(ball, [0.5, 0.4, 0.3]))
}

/// Mean radiance, and the derivatives by the ball's place and the floor's shininess.
fn of(sampling: Sampling, seed: u64) -> [f64; 3] {
    let device = Device::flex();
    let (offset, shininess) = (leaf(&[0.0; 3], &device), leaf(&[30.0], &device));
    let options = RenderOptions::new(12, 12)
        .with_samples(16)
        .with_bounces(1)
        .with_sampling(sampling)
        .with_seed(seed);
    let camera = Camera::look_at([0.0, 1.2, 4.0], [0.0, 0.6, 0.0]).with_fov_y(45.0);
    let scene = room(&offset, &shininess, &device);
    let image = render(&scene, &camera, &options).expect("an image");
    let mean = image.radiance.mean();
    let gradients = mean.backward();
    let along = gradient(&offset, &gradients);
    let along = along[0] + 0.5 * along[1] - along[2];
    [values(&mean)[0], along, gradient(&shininess, &gradients)[0]]
}

fn estimate(all: &[[f64; 3]], i: usize) -> (f64, f64) {
    let of_one: Vec<f64> = all.iter().map(|v| v[i]).collect();
    mean_and_error(&of_one)
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
            // Noise that is larger would hide what is wrong.
            assert!(error < 0.1 * b.abs(), "{name}, {what}: {error} of {b}");
            assert!((a - b).abs() < 4.0 * error, "{name}, {what}: {a} and {b}");
        }
    }
}

/// A large light mirrored by a shiny floor: points chosen by the BSDF as well take most of the noise
/// away.
#[test]
fn both_strategies_find_a_mirrored_light() {
    let device = Device::flex();
    let scene = room(&row(&[0.0; 3], &device), &row(&[2000.0], &device), &device);
    let camera = Camera::look_at([0.0, 1.0, 3.0], [0.0, 0.0, 0.0]).with_fov_y(40.0);
    let image = |sampling, samples, seed| {
        let options = RenderOptions::new(24, 24)
            .with_samples(samples)
            .with_bounces(0)
            .with_sampling(sampling)
            .with_seed(seed);
        radiance(&scene, &camera, &options)
    };
    let mut one = Sampling::default();
    one.multiple_importance = false;
    let expected = image(Sampling::default(), 4096, 9);
    let noise = |sampling| rmse(&image(sampling, 64, 2), &expected);
    let (both, one) = (noise(Sampling::default()), noise(one));
    println!("both {both}, one {one}");
    assert!(both < 0.3 * one, "{both}, {one}");
}

/// One path for each surface of a camera ray that matters: where a ray meets one surface, one.
#[test]
fn paths_are_split_only_where_surfaces_share_a_ray() {
    let device = Device::flex();
    let scene = room(&row(&[0.0; 3], &device), &row(&[10.0], &device), &device);
    let camera = Camera::look_at([0.0, 1.2, 4.0], [0.0, 0.6, 0.0]).with_fov_y(45.0);
    let rays = |surfaces, sigma| {
        let mut sampling = Sampling::default();
        sampling.surfaces = surfaces;
        let options = RenderOptions::new(32, 32)
            .with_samples(4)
            .with_bounces(1)
            .with_visibility(Visibility::softmax(sigma, 1e-3))
            .with_sampling(sampling);
        let image = render(&scene, &camera, &options).expect("an image");
        image.statistics.bounces[1] as f64
    };
    let more = |sigma| rays(SurfaceSampling::Split, sigma) / rays(SurfaceSampling::Drawn, sigma);
    let (sharp, blurred) = (more(1e-8), more(1e-2));
    println!("{sharp}, {blurred}");
    assert!(sharp < 1.02 && sharp > 0.98, "{sharp}");
    assert!(blurred > 1.02 && blurred < 2.0, "{blurred}");
}

/// A glossy ball on a floor among 240 emissive triangles, which are offset too, with two lights without a surface.
fn many_lamps([offset, of_lamps]: [&Tensor<1>; 2], device: &Device) -> Scene {
    let at = |mesh: Mesh, size: f32, place: Tensor<1>| {
        mesh.scaled(Tensor::from_floats([size], device))
            .translated(place)
    };
    let ball = at(
        shapes::icosphere(1, device),
        0.4,
        row(&[0.1, 0.5, 0.2], device) + offset.clone(),
    );
    let gloss = Material::phong([0.3, 0.25, 0.2], [0.5; 3], 40.0);
    let mut scene = Scene::new()
        .with_object(diffuse(
            facing_up([-2.0, 2.0], [-2.0, 2.0], 0.0, device),
            [0.5; 3],
        ))
        .with_object(Object::new(ball).with_material(gloss))
        .with_light(Light::point([1.4, 0.9, 0.9], [0.5; 3]))
        .with_light(Light::directional([0.5, -1.0, -0.4], [0.2; 3]));
    for place in [[-1.0, 0.7, 0.9], [1.2, 1.2, -0.7], [-0.6, 1.9, -0.8]] {
        let place = row(&place, device) + of_lamps.clone();
        let lamp = at(shapes::icosphere(1, device), 0.12, place);
        scene = scene.with_object(emitting(lamp, [9.0; 3]));
    }
    scene
}

/// A tree over many emitters changes neither mean nor gradients, and takes noise away beside a uniform choice.
#[test]
fn many_emitters_by_a_tree() {
    let device = Device::flex();
    let of = |emitters, seed: u64| {
        let mut sampling = Sampling::default();
        sampling.emitters = emitters;
        let [offset, of_lamps] = [0, 1].map(|_| leaf(&[0.0; 3], &device));
        let options = RenderOptions::new(12, 12)
            .with_samples(16)
            .with_bounces(1)
            .with_visibility(Visibility::cone(2.865))
            .with_sampling(sampling)
            .with_seed(seed);
        // It doesn't see the lamps, whose light would be noise of another kind.
        let camera = Camera::look_at([0.2, 2.6, 0.3], [0.2, 0.0, 0.3])
            .with_up([0.0, 0.0, -1.0])
            .with_orthographic(1.4);
        let scene = many_lamps([&offset, &of_lamps], &device);
        let image = render(&scene, &camera, &options).expect("an image");
        let mean = image.radiance.clone().mean();
        let gradients = mean.clone().backward();
        // Where derivatives are large beside their noise.
        let ball = gradient(&offset, &gradients)[1];
        let lamps = gradient(&of_lamps, &gradients)[0];
        ([values(&mean)[0], ball, lamps], values(&image.radiance))
    };
    let seeds = if common::long() { 1024 } else { 128 };
    let run = |emitters| {
        let all: Vec<_> = (0..seeds).map(|seed| of(emitters, seed)).collect();
        let apart = all.windows(2).map(|two| rmse(&two[0].1, &two[1].1));
        let noise = common::numbers::mean(&apart.collect::<Vec<_>>());
        let estimates = [0, 1, 2].map(|i| {
            let values: Vec<f64> = all.iter().map(|one| one.0[i]).collect();
            mean_and_error(&values)
        });
        (estimates, noise)
    };
    let (tree, noise) = run(EmitterSampling::SolidAngle);
    for emitters in [EmitterSampling::Uniform, EmitterSampling::Power] {
        let (other, noise_of_other) = run(emitters);
        for (i, what) in ["mean", "ball", "lamps"].into_iter().enumerate() {
            let ((a, ea), (b, eb)) = (tree[i], other[i]);
            println!("{emitters:?}, {what}: {a:.4e} ± {ea:.1e} by the tree, {b:.4e} ± {eb:.1e}");
            // Noise that is larger would hide what is wrong.
            let clear = ea < 0.1 * a.abs() && eb < 0.3 * b.abs();
            assert!(clear, "{what}: {a} ± {ea} and {b} ± {eb}");
            assert!((a - b).abs() < 4.0 * ea.hypot(eb), "{what}: {a} and {b}");
        }
        println!("noise of a pixel {noise} by the tree, {noise_of_other} by {emitters:?}");
        let at_most = match emitters {
            EmitterSampling::Uniform => 0.25,
            // From here all lamps are about as far.
            _ => 1.15,
        };
        assert!(noise < at_most * noise_of_other, "{noise} {noise_of_other}");
    }
}
