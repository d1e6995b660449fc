//! Kernels on a GPU beside those of the host.

use std::time::Instant;

use crate::common::facets::{clamped_cases, facet_cases};
use crate::common::gradients::{
    CONES, Case as Class, Effort, Setup, all_classes, assert_agreement, lights, of_seed,
};
use crate::common::numbers::{apart, largest, pairs};
use crate::common::scenes::{diffuse, emitting, facing_front, floor, lamp, scene_file};
use crate::common::tensors::{gradient, leaf, radiance, tensor, with_leaves};
use crate::device::device;
use burn::tensor::{DType, Device};
use softray::prelude::*;

/// Eight samples a pixel.
const EIGHT: Effort = Effort {
    samples: 8,
    ..CONES
};

/// The same random numbers and formulas: images differ by rounding, and repeat. In few pixels a path passes a seam.
#[test]
fn images_are_those_of_the_host() {
    for bounces in [0, 3] {
        let at = |device: &Device| {
            let file = scene_file("cornell", device);
            let options = RenderOptions::new(64, 64)
                .with_samples(64)
                .with_bounces(bounces);
            radiance(&file.scene, &file.camera, &options.with_seed(2))
        };
        let gpu = at(&device());
        assert_eq!(gpu, at(&device()));
        let host = at(&Device::flex());
        let apart: Vec<f64> = pairs(&gpu, &host)
            .map(|(a, b)| ((a - b) / (1.0 + b)).abs())
            .collect();
        let pixels = apart.chunks(3).map(|c| largest(c.iter().copied()));
        let others: Vec<f64> = pixels.filter(|&x| x.is_nan() || x >= 2e-6).collect();
        println!("{bounces} bounces: {others:?} apart");
        assert!(others.len() <= 4 && others.iter().all(|&x| x < 1e-2));
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
    let options = (case.options)(RenderOptions::new(12, 12).with_samples(8).with_seed(3));
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
        .with_object(diffuse(floor(2.0, 0.0, device), [0.5, 0.4, 0.3]).with_name("floor"))
        .with_object(lamp(0.5, 2.4, [5.0, 4.0, 3.0], device).with_name("lamp"))
        .with_object(emitting(
            facing_front([-1.6, -1.2], [0.2, 0.9], -1.0, device),
            [3.0, 3.0, 4.0],
        ))
        .with_object(diffuse(ball, [0.3, 0.5, 0.6]).with_velocity([0.3, 0.1, 0.0]))
        .with_object(diffuse(sheet, [0.6, 0.3, 0.2]));
    let camera = Camera::look_at([0.3, 1.4, 4.0], [0.0, 0.6, 0.0]).with_thin_lens(0.1, 3.8);
    (scene, camera)
}

#[expect(clippy::too_many_lines, reason = "a list of scenes")]
fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "shadow",
            scene: |device| {
                let file = scene_file("shadow", device);
                (file.scene, file.camera)
            },
            options: |o| o.with_bounces(0),
            pixels: None,
        },
        Case {
            name: "cornell",
            scene: |device| {
                let file = scene_file("cornell", device);
                (file.scene, file.camera)
            },
            options: |o| o.with_bounces(2),
            pixels: None,
        },
        Case {
            name: "flying",
            scene: flying,
            options: |o| o.with_bounces(1),
            pixels: None,
        },
        Case {
            name: "gloss",
            scene: |device| {
                let (scene, camera) = flying(device);
                let gloss = Material::phong([0.3, 0.2, 0.2], [0.5; 3], 20.0);
                let scene = scene
                    .map_object("floor", |o| o.with_material(gloss.clone()))
                    .expect("the floor")
                    .with_environment([0.3, 0.4, 0.5]);
                (scene, camera)
            },
            options: |o| o.with_bounces(1).with_visibility(Visibility::cone(2.865)),
            pixels: None,
        },
        Case {
            name: "map",
            scene: |device| {
                let (scene, camera) = flying(device);
                let texels: Vec<f64> = (0..384).map(|i| 0.5 + 0.5 * f64::from(i).sin()).collect();
                let map = tensor(&texels, [8, 16, 3], device, DType::F32);
                let mut scene = scene.with_environment(Environment::map(map));
                for object in &mut scene.objects {
                    object.mesh = object.mesh.clone().smooth_normals();
                }
                (scene, camera)
            },
            options: |o| o.with_bounces(1).with_depth().with_normals().with_albedo(),
            pixels: None,
        },
        // Lines in which triangles pass through each other.
        Case {
            name: "crossings",
            scene: |device| {
                let ball = shapes::icosahedron(device).scaled([0.6; 3]);
                let ball = ball.translated([0.1, 0.2, 0.1]);
                let scene = Scene::new()
                    .with_object(diffuse(floor(2.0, 0.0, device), [0.5, 0.4, 0.3]))
                    .with_object(lamp(0.5, 2.4, [5.0, 4.0, 3.0], device))
                    .with_object(diffuse(ball, [0.3, 0.5, 0.6]))
                    .with_environment([0.2, 0.3, 0.4]);
                let camera = Camera::look_at([0.3, 1.4, 4.0], [0.0, 0.3, 0.0]);
                (scene, camera.with_orthographic(3.0))
            },
            options: |o| o.with_bounces(2),
            pixels: None,
        },
        // Holes, in what is seen, what casts shadows and what shines.
        Case {
            name: "masks",
            scene: |device| {
                let (mut scene, camera) = flying(device);
                let alphas = [0.2, 0.9, 0.8, 0.1, 0.7, 0.3];
                let alphas = tensor(&alphas, [2, 3], device, DType::F32);
                for object in &mut scene.objects {
                    let count = object.mesh.vertices.dims()[0];
                    let uvs: Vec<f64> = (0..2 * count).map(|i| 0.7 * i as f64).collect();
                    let uvs = tensor(&uvs, [count, 2], device, DType::F32);
                    object.mesh = object.mesh.clone().with_uvs(uvs);
                    let material = object.materials[0].clone();
                    object.materials[0] = material.with_alpha_mask(alphas.clone(), 0.45);
                }
                (scene, camera)
            },
            options: |o| o.with_bounces(1),
            pixels: None,
        },
        // So many that one is drawn from a tree, beside lights without extent.
        Case {
            name: "many lights",
            scene: |device| {
                let (scene, camera) = flying(device);
                let ball = shapes::icosphere(1, device).scaled([0.3; 3]);
                let ball = emitting(ball.translated([-1.2, 1.1, 0.6]), [1.0, 2.0, 3.0]);
                let gloss = Material::phong([0.3, 0.2, 0.2], [0.5; 3], 6.0);
                let scene = scene
                    .map_object("floor", |o| o.with_material(gloss.clone()))
                    .expect("the floor")
                    .with_object(ball)
                    .with_light(Light::point([0.9, 1.5, 1.2], [2.0, 1.0, 0.5]))
                    .with_light(Light::directional([-0.4, -1.0, -0.6], [0.3, 0.4, 0.5]));
                (scene, camera)
            },
            options: |o| o.with_bounces(1),
            pixels: None,
        },
        Case {
            name: "pixels",
            scene: flying,
            options: |o| o.with_bounces(1),
            pixels: Some(&[7, 30, 31, 66, 67, 68, 79, 90, 100, 143]),
        },
    ]
}

/// How far derivatives of one seed may be from those of the host: twice what rounding makes of the index of glass.
fn limit(class: &Class) -> f64 {
    2e-4 + class.flips
}

/// All cases in the long tier, and each `n`-th in the short one: a software driver compiles kernels for each.
pub fn each<T>(cases: Vec<T>, n: usize) -> Vec<T> {
    let step = if crate::common::long() { 1 } else { n };
    cases.into_iter().step_by(step).collect()
}

/// Every class of parameter, at one seed.
#[test]
fn derivatives_of_all_classes() {
    let (gpu, cpu) = (device(), Device::flex());
    let setups: [Setup; 2] = [(&gpu, |o| o), (&cpu, |o| o)];
    let effort = Effort {
        samples: 5,
        ..CONES
    };
    assert_agreement(&each(all_classes(), 4), setups, DType::F32, effort, limit);
}

/// Emissive textures, and bodies that cross.
#[test]
fn derivatives_of_emissive_textures() {
    let (gpu, cpu) = (device(), Device::flex());
    let setups: [Setup; 2] = [(&gpu, |o| o), (&cpu, |o| o)];
    let effort = EIGHT;
    for cases in [lights::glowing(), lights::crossings()] {
        assert_agreement(&cases, setups, DType::F32, effort, limit);
    }
}

/// Every parameter of BSDFs of facets, at one seed.
#[test]
fn derivatives_of_facets() {
    let (gpu, cpu) = (device(), Device::flex());
    let setups: [Setup; 2] = [(&gpu, |o| o), (&cpu, |o| o)];
    let cases = each(facet_cases(), 6);
    assert_agreement(&cases, setups, DType::F32, EIGHT, limit);
}

/// The same with a least roughness after a bounce, which is above that of most materials.
#[test]
fn derivatives_with_path_regularization() {
    let (gpu, cpu) = (device(), Device::flex());
    let setups: [Setup; 2] = [
        (&gpu, |o| o.with_path_regularization(0.9)),
        (&cpu, |o| o.with_path_regularization(0.9)),
    ];
    let cases = each(facet_cases(), 9);
    assert_agreement(&cases, setups, DType::F32, EIGHT, limit);
}

/// Parameters outside of their ranges have no gradient, as on the host.
#[test]
fn values_outside_of_their_ranges_have_no_gradient() {
    let effort = EIGHT;
    for case in clamped_cases() {
        let found = of_seed(&case, (&device(), |o| o), DType::F32, effort, 5);
        assert_eq!(found, 0.0, "{}", case.name);
    }
}

#[test]
fn derivatives_by_vertices() {
    let mut flipped = 0;
    for case in cases() {
        let found = by_vertices(&case, &device());
        let again = by_vertices(&case, &device());
        let wanted = by_vertices(&case, &Device::flex());
        let apart = apart(&found, &wanted);
        println!("{}: {apart:e}", case.name);
        assert_eq!(found, again, "{}", case.name);
        // In a scene or two a path may meet another surface by rounding.
        assert!(apart < 1e-4, "{}: {apart:e}", case.name);
        flipped += usize::from(apart > 1e-5);
    }
    assert!(flipped <= 2, "{flipped}");
}

/// What a render on a GPU counts on request is what the host counts.
#[test]
fn rays_are_counted_on_request() {
    let counted = ["cornell", "map", "pixels"];
    let mut cases = cases();
    cases.retain(|case| counted.contains(&case.name));
    assert_eq!(cases.len(), counted.len());
    for case in &cases {
        let at = |device: &Device, counted: bool| {
            let (scene, camera) = (case.scene)(device);
            let options = (case.options)(RenderOptions::new(12, 12).with_samples(8).with_seed(3));
            let options = options.with_bounces(3).with_russian_roulette(1);
            let more = |options: RenderOptions| options.with_statistics().with_diagnostics();
            let options = if counted { more(options) } else { options };
            let image = match case.pixels {
                None => render(&scene, &camera, &options),
                Some(pixels) => render_pixels(&scene, &camera, &options, pixels),
            };
            let image = image.expect("an image");
            (image.statistics, image.diagnostics)
        };
        let gpu = device();
        let (found, mut wanted) = (at(&gpu, true), at(&Device::flex(), true));
        assert_eq!(found.0.program, Program::DeviceKernels);
        wanted.0.program = found.0.program;
        println!("{}: {:?}", case.name, found.0);
        assert!(found.0.bounces.len() > 1, "{}", case.name);
        assert_eq!(found, wanted, "{}", case.name);
        if case.name == "pixels" {
            let mut nothing = Statistics::default();
            nothing.program = found.0.program;
            assert_eq!(at(&gpu, false), (nothing, None));
        }
    }
}
