//! Kernels on a GPU beside those of the host.
#![cfg(feature = "wgpu")]

mod common;

use std::time::Instant;

use burn::tensor::{DType, Device};
use common::gpu::device;
use common::gradients::{CONES, Effort, Setup, agreement};
use common::scenes::{diffuse, emitting, facing_front, floor, lamp, scene_file};
use common::tensors::{gradient, leaf, radiance, tensor, with_leaves};
use softray::prelude::*;

/// The same random numbers and formulas: images differ by rounding, and repeat to the bit.
#[test]
fn images_are_those_of_the_host() {
    for bounces in [0, 3] {
        let at = |device: &Device| {
            let file = scene_file("cornell", device);
            let options = RenderOptions::new(64, 64).samples(64).bounces(bounces);
            radiance(&file.scene, &file.camera, &options.seed(2))
        };
        let gpu = at(&device());
        assert_eq!(gpu, at(&device()));
        let apart = |(a, b): (&f64, &f64)| (a - b).abs() / (1.0 + b);
        let host = at(&Device::flex());
        let worst = gpu.iter().zip(&host).map(apart).fold(0.0, f64::max);
        println!("{bounces} bounces: {worst:e} apart");
        assert!(worst < 2e-6, "{worst:e}");
    }
}

/// A scene for a device, and how it is rendered.
struct Case {
    name: &'static str,
    scene: fn(&Device) -> (Scene, Camera),
    options: fn(RenderOptions) -> RenderOptions,
    /// All if there is no list.
    pixels: Option<&'static [u32]>,
}

/// Derivatives of a weighted sum of an image by all vertices and velocities.
fn by_vertices(case: &Case, device: &Device) -> Vec<f64> {
    let (scene, camera) = (case.scene)(device);
    let mut scene = with_leaves(scene);
    let velocity = leaf(&[0.3, 0.1, 0.0], device);
    let flies = scene.objects.iter().any(|o| o.velocity.is_some());
    for object in &mut scene.objects {
        let flies = object.velocity.is_some();
        object.velocity = flies.then(|| velocity.clone().into());
    }
    let options = (case.options)(RenderOptions::new(12, 12).samples(8).seed(3));
    let start = Instant::now();
    let (rows, image) = match case.pixels {
        None => (12, render(&scene, &camera, &options)),
        Some(pixels) => (1, render_pixels(&scene, &camera, &options, pixels)),
    };
    let image = image.expect("an image");
    let columns = image.radiance.dims()[1];
    let weights = |channels: usize| -> Tensor<3> {
        let count = rows * columns * channels;
        let list: Vec<f64> = (0..count).map(|i| 0.3 + (0.37 * i as f64).sin()).collect();
        tensor(&list, [rows, columns, channels], device, DType::F32)
    };
    let mut loss = (image.radiance * weights(3)).sum();
    if let Some(normals) = image.normals {
        loss = loss + (normals * weights(3)).sum() * 0.1;
    }
    for plane in [image.depth, image.opacity].into_iter().flatten() {
        loss = loss + (plane * weights(1).squeeze_dim::<2>(2)).sum() * 0.1;
    }
    let gradients = loss.backward();
    let mut all = Vec::new();
    for object in &scene.objects {
        all.extend(gradient(&object.mesh.vertices, &gradients));
    }
    if flies {
        all.extend(gradient(&velocity, &gradients));
    }
    println!("{} on {device:?}: {:?}", case.name, start.elapsed());
    all
}

/// A ball that flies over a floor under two lights.
fn flying(device: &Device) -> (Scene, Camera) {
    let ball = shapes::icosahedron(device)
        .scaled([0.4; 3])
        .translated([0.2, 0.7, 0.1]);
    let sheet = shapes::triangle(
        [-1.1, 0.8, 0.3],
        [-0.2, 0.9, 0.6],
        [-0.5, 1.3, -0.3],
        device,
    );
    let scene = Scene::new()
        .with(diffuse(floor(2.0, 0.0, device), [0.5, 0.4, 0.3]).named("floor"))
        .with(lamp(0.5, 2.4, [5.0, 4.0, 3.0], device).named("lamp"))
        .with(emitting(
            facing_front([-1.6, -1.2], [0.2, 0.9], -1.0, device),
            [3.0, 3.0, 4.0],
        ))
        .with(diffuse(ball, [0.3, 0.5, 0.6]).velocity([0.3, 0.1, 0.0]))
        .with(diffuse(sheet, [0.6, 0.3, 0.2]));
    let camera = Camera::look_at([0.3, 1.4, 4.0], [0.0, 0.6, 0.0]).thin_lens(0.1, 3.8);
    (scene, camera)
}

fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "shadow",
            scene: |device| {
                let file = scene_file("shadow", device);
                (file.scene, file.camera)
            },
            options: |o| o.bounces(0),
            pixels: None,
        },
        Case {
            name: "cornell",
            scene: |device| {
                let file = scene_file("cornell", device);
                (file.scene, file.camera)
            },
            options: |o| o.bounces(2),
            pixels: None,
        },
        Case {
            name: "flying",
            scene: flying,
            options: |o| o.bounces(1),
            pixels: None,
        },
        Case {
            name: "gloss",
            scene: |device| {
                let (scene, camera) = flying(device);
                let gloss = Material::diffuse([0.3, 0.2, 0.2]).specular([0.5; 3], 20.0);
                let scene = scene
                    .map_object("floor", |o| o.material(gloss.clone()))
                    .expect("the floor")
                    .environment([0.3, 0.4, 0.5]);
                (scene, camera)
            },
            options: |o| o.bounces(1).visibility(Visibility::cone(0.05)),
            pixels: None,
        },
        Case {
            name: "map",
            scene: |device| {
                let (scene, camera) = flying(device);
                let texels: Vec<f64> = (0..384).map(|i| 0.5 + 0.5 * f64::from(i).sin()).collect();
                let map = tensor(&texels, [8, 16, 3], device, DType::F32);
                let mut scene = scene.environment(Environment::map(map));
                for object in &mut scene.objects {
                    object.mesh = object.mesh.clone().smooth_normals();
                }
                (scene, camera)
            },
            options: |o| o.bounces(1).with_depth().with_normals().with_opacity(),
            pixels: None,
        },
        // Lines in which triangles pass through each other.
        Case {
            name: "crossings",
            scene: |device| {
                let ball = shapes::icosahedron(device).scaled([0.6; 3]);
                let ball = ball.translated([0.1, 0.2, 0.1]);
                let scene = Scene::new()
                    .with(diffuse(floor(2.0, 0.0, device), [0.5, 0.4, 0.3]))
                    .with(lamp(0.5, 2.4, [5.0, 4.0, 3.0], device))
                    .with(diffuse(ball, [0.3, 0.5, 0.6]))
                    .environment([0.2, 0.3, 0.4]);
                let camera = Camera::look_at([0.3, 1.4, 4.0], [0.0, 0.3, 0.0]);
                (scene, camera.orthographic(3.0))
            },
            options: |o| o.bounces(2),
            pixels: None,
        },
        Case {
            name: "pixels",
            scene: flying,
            options: |o| o.bounces(1),
            pixels: Some(&[7, 30, 31, 66, 67, 68, 79, 90, 100, 143]),
        },
    ]
}

/// Every class of parameter, at one seed.
#[test]
fn derivatives_of_all_classes() {
    let (gpu, cpu) = (device(), Device::flex());
    let setups: [Setup; 2] = [(&gpu, |o| o), (&cpu, |o| o)];
    let effort = Effort {
        samples: 8,
        ..CONES
    };
    for (name, apart) in agreement(setups, DType::F32, effort) {
        assert!(apart < 1e-4, "{name}: {apart}");
    }
}

#[test]
fn derivatives_by_vertices() {
    for case in cases() {
        let found = by_vertices(&case, &device());
        let again = by_vertices(&case, &device());
        let wanted = by_vertices(&case, &Device::flex());
        let norm = wanted.iter().map(|x| x * x).sum::<f64>().sqrt();
        let apart = found.iter().zip(&wanted).map(|(a, b)| (a - b).powi(2));
        let apart = apart.sum::<f64>().sqrt() / norm;
        println!("{}: {apart:e} of {norm}", case.name);
        assert_eq!(found, again);
        assert!(apart < 1e-5);
    }
}

/// Edges of many faces are drawn from a tree, by a number that runs out of bits: then rounding makes now and then a
/// draw another. Means over seeds are the same within their paired standard errors.
#[test]
fn derivatives_by_a_fine_mesh_have_the_same_mean() {
    let of = |device: &Device, seed: u64| {
        let place = leaf(&[0.1, 0.8, 0.1], device);
        let ball = shapes::icosphere(2, device).scaled([0.6; 3]);
        let scene = Scene::new()
            .with(diffuse(floor(2.0, 0.0, device), [0.5, 0.4, 0.3]))
            .with(lamp(0.5, 2.4, [5.0, 4.0, 3.0], device))
            .with(diffuse(ball.translated(place.clone()), [0.3, 0.5, 0.6]))
            .environment([0.2, 0.3, 0.4]);
        let camera = Camera::look_at([0.3, 1.4, 4.0], [0.0, 0.3, 0.0]);
        let options = RenderOptions::new(12, 12).samples(8).bounces(1).seed(seed);
        let image = render(&scene, &camera, &options).expect("an image");
        let weights: Vec<f64> = (0..432).map(|i| 0.3 + f64::from(i) / 432.0).collect();
        let weights = tensor(&weights, [12, 12, 3], device, DType::F32);
        let gradients = (image.radiance * weights).sum().backward();
        gradient(&place, &gradients)
    };
    let (gpu, cpu) = (device(), Device::flex());
    // Other seeds in the long tier.
    let (first, seeds) = if common::long() {
        (5000, 480)
    } else {
        (0, 160)
    };
    let pairs: Vec<[Vec<f64>; 2]> = (first..first + seeds)
        .map(|s| [of(&gpu, s), of(&cpu, s)])
        .collect();
    for axis in 0..3 {
        let n = seeds as f64;
        let mean = |f: &dyn Fn(&[Vec<f64>; 2]) -> f64| pairs.iter().map(f).sum::<f64>() / n;
        let host = mean(&|p| p[1][axis]);
        let apart = mean(&|p| p[0][axis] - p[1][axis]);
        let square = mean(&|p| (p[0][axis] - p[1][axis] - apart).powi(2));
        let error = (square / (n - 1.0)).sqrt();
        let noise = (mean(&|p| (p[1][axis] - host).powi(2)) / (n - 1.0)).sqrt();
        println!("{axis}: {host:.4} ± {noise:.4}, apart {apart:.4} ± {error:.4}");
        assert!(apart.abs() < 3.5 * error + 1e-6 * host.abs(), "{axis}");
    }
}
