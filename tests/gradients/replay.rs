//! A render is one node of the graph, whose backward pass traces its paths again: the same bits whatever the
//! threads, for any loss, and in memory that does not grow with samples or bounces.

use crate::common::errors::{message, says};
use crate::common::memory::peak;
use crate::common::numbers::{apart, largest, pairs};
use crate::common::process::again;
use crate::common::scenes::{diffuse, floor, scene_file};
use crate::common::tensors::{gradient, leaf, radiance, tensor, values, with_leaves};
use burn::tensor::{DType, Device};
use softray::prelude::*;

/// The gradient of a loss that is not linear in the image, with outputs beside radiance, through a
/// part of the user's own before the scene.
fn of_a_loss(options: &RenderOptions) -> (f64, Vec<f64>) {
    let device = Device::flex();
    let angle = leaf(&[0.2], &device);
    let file = scene_file("cornell", &device);
    let scene = file
        .scene
        .map_object("short", |o| {
            let turn =
                Transform::new().with_axis_angle([0.0, 1.0, 0.0], angle.clone().sin() * 30.0);
            o.map_mesh(|m| m.transformed(&turn))
        })
        .expect("the object");
    let image = render(&scene, &file.camera, options).expect("an image");
    let opacity = image.opacity.expect("opacity").sum();
    let depth = image.depth.expect("depth").mean();
    let loss = image.radiance.powf_scalar(2.0).mean().log() + opacity * 0.01 + depth.sqrt();
    let gradients = loss.backward();
    (values(&loss)[0], gradient(&angle, &gradients))
}

/// Cones, and the paper's form with a blur that many surfaces share.
fn forms() -> [Visibility; 2] {
    [Visibility::cone(1.146), Visibility::softmax(1e-2, 1e-2)]
}

#[test]
fn any_loss_and_any_threads() {
    for form in forms() {
        // So many paths that those of an eighth of the pixels say how many samples edges are given.
        let options = RenderOptions::new(24, 24)
            .with_samples(16)
            .with_bounces(1)
            .with_visibility(form)
            .with_opacity()
            .with_depth();
        let on = |threads: usize, rays: usize| {
            let options = options.clone().with_rays_per_tile(rays);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.expect("threads").install(|| of_a_loss(&options))
        };
        let one = on(1, 512);
        for threads in [2, 3, 5] {
            assert_eq!(one, on(threads, 512), "{form:?}, {threads} threads");
        }
        let other = on(2, 300);
        assert!((one.0 - other.0).abs() < 1e-5 * one.0.abs());
        assert!((one.1[0] - other.1[0]).abs() < 1e-3 * one.1[0].abs());
    }
}

#[test]
fn pixels_are_those_of_the_image() {
    let device = Device::flex();
    let file = scene_file("cornell", &device);
    let options = RenderOptions::new(20, 16)
        .with_samples(5)
        .with_bounces(2)
        .with_seed(3);
    let whole = radiance(&file.scene, &file.camera, &options);
    let pixels: Vec<u32> = (0..97).map(|i| (i * 37) % 320).collect();
    let part = render_pixels(&file.scene, &file.camera, &options, &pixels).expect("pixels");
    assert_eq!(part.radiance.dims(), [1, 97, 3]);
    let part = values(&part.radiance);
    for (i, &p) in pixels.iter().enumerate() {
        let p = p as usize;
        assert_eq!(part[3 * i..3 * i + 3], whole[3 * p..3 * p + 3], "pixel {p}");
    }
    let at = |list: &[u32]| render_pixels(&file.scene, &file.camera, &options, list);
    says(message(at(&[320])), ["320"]);
    assert!(at(&[]).is_err());
}

/// A pixel that is named twice counts twice, in what is seen and where edges move.
#[test]
fn pixels_may_be_named_twice() {
    let device = Device::flex();
    let by = |pixels: &[u32], weights: &[f64]| {
        let file = scene_file("shadow", &device);
        let scene = with_leaves(file.scene);
        let options = RenderOptions::new(12, 12).with_samples(8).with_seed(3);
        let image = render_pixels(&scene, &file.camera, &options, pixels).expect("pixels");
        assert_eq!(image.radiance.dims(), [1, pixels.len(), 3]);
        let weights = tensor(weights, [1, pixels.len(), 1], &device, DType::F32);
        let gradients = (image.radiance * weights).sum().backward();
        let of = |o: &Object| gradient(&o.mesh.vertices, &gradients);
        scene.objects.iter().flat_map(of).collect::<Vec<_>>()
    };
    let once = by(&[40, 66, 77], &[1.0, 3.0, 0.5]);
    let twice = by(&[66, 40, 66, 77], &[2.0, 1.0, 1.0, 0.5]);
    assert!(once.iter().any(|&g| g != 0.0));
    for (a, b) in pairs(&once, &twice) {
        assert!((a - b).abs() <= 1e-6 * a.abs().max(1e-3), "{a} {b}");
    }
}

/// The peak of forward and backward in a process of its own.
fn peak_of(samples: u32, bounces: u32, form: usize) -> f64 {
    let output = again(memory_is_that_of_a_tile)
        .env("SOFTRAY_SETTINGS", format!("{samples} {bounces} {form}"))
        .output()
        .expect("a process");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let line = text.lines().find_map(|l| l.strip_prefix("peak "));
    line.and_then(|l| l.parse().ok())
        .unwrap_or_else(|| panic!("{text}"))
}

#[test]
fn memory_is_that_of_a_tile() {
    if let Ok(settings) = std::env::var("SOFTRAY_SETTINGS") {
        let numbers: Vec<u32> = settings
            .split(' ')
            .map(|v| v.parse().expect("a number"))
            .collect();
        let device = Device::flex();
        let file = scene_file("cornell", &device);
        let scene = with_leaves(file.scene);
        let options = RenderOptions::new(64, 64)
            .with_samples(numbers[0])
            .with_bounces(numbers[1])
            .with_visibility(forms()[numbers[2] as usize]);
        let image = render(&scene, &file.camera, &options).expect("an image");
        image.radiance.powf_scalar(2.0).mean().backward();
        println!("peak {}", peak());
        return;
    }
    for (number, form) in forms().into_iter().enumerate() {
        let samples = [4, 64, 256].map(|s| peak_of(s, 1, number));
        let bounces = [1, 3, 8].map(|b| peak_of(16, b, number));
        println!("{form:?}: over samples {samples:.1?} MiB, over bounces {bounces:.1?} MiB");
        for list in [samples, bounces] {
            let largest = largest(list);
            assert!(
                largest < 1.4 * list[0] && largest < 160.0,
                "{form:?}: {list:?}"
            );
        }
    }
}

/// Steps of a fit that keep what they prepared: a ball that passes through a floor and is deformed, then shrunk by half, then
/// loses an edge. Of each its gradient by all vertices.
fn of_steps(options: &RenderOptions, steps: std::ops::Range<i32>) -> Vec<Vec<f64>> {
    let device = Device::flex();
    let ball = shapes::icosphere(3, &device);
    let base = values(&ball.vertices);
    let faces = ball.faces.len();
    let at = |step: i32| {
        let mut moved = base.clone();
        for row in moved.chunks_exact_mut(3) {
            let bump = 1.0 + 0.02 * f64::from(step.min(3)) * (5.0 * row[0] + 3.0 * row[1]).sin();
            let size = if step > 3 { 0.5 } else { 1.0 };
            row.iter_mut().for_each(|x| *x *= size * bump);
        }
        if step > 4 {
            let [from, to] = [0, 1].map(|i| 3 * ball.faces[faces / 2][i] as usize);
            moved.copy_within(to..to + 3, from);
        }
        tensor(&moved, [moved.len() / 3, 3], &device, DType::F32)
    };
    let gradient_of = |step: i32| {
        let vertices = at(step).autodiff().require_grad();
        let scene = Scene::new()
            .with_object(Object::new(ball.clone().with_vertices(vertices.clone())))
            .with_object(diffuse(floor(3.0, -0.4, &device), [0.3, 0.6, 0.2]))
            .with_environment([0.6, 0.8, 1.0]);
        let camera = Camera::look_at([0.0, 2.0, 4.0], [0.0; 3]).with_fov_y(40.0);
        let image = render(&scene, &camera, options).expect("an image");
        let gradients = image.radiance.powf_scalar(2.0).sum().backward();
        gradient(&vertices, &gradients)
    };
    steps.map(gradient_of).collect()
}

/// What is kept from step to step repeats to the bit, serves where edges are the same, and not where they aren't.
#[test]
fn kept_edges_serve_the_next_step() {
    let options = RenderOptions::new(24, 24).with_samples(64).with_bounces(1);
    let cached = || {
        of_steps(
            &options.clone().with_cache(&HierarchyCache::default()),
            0..6,
        )
    };
    let (kept, alone) = (cached(), of_steps(&options, 0..6));
    assert_eq!(kept, cached());
    // The first finds nothing.
    assert_eq!(kept[0], alone[0]);
    let other_seed = of_steps(&options.clone().with_seed(1), 0..6);
    for (step, (kept, alone)) in kept.iter().zip(&alone).enumerate() {
        // All that differs is which edges are drawn.
        let (far, noise) = (apart(kept, alone), apart(&other_seed[step], alone));
        println!("{step}: {far:.4}, by the seed {noise:.4}");
        // The division of the tree over edges is kept from the first step until an edge is lost.
        assert_eq!(far > 0.0, (1..5).contains(&step), "{step}: {far}");
        assert!(far < 0.6, "{step}: {far}");
        assert!(far < 1.2 * noise, "{step}: {far} and {noise}");
        let sum = |of: &[f64], axis: usize| of.iter().skip(axis).step_by(3).sum::<f64>();
        for axis in 0..3 {
            let (a, b, c) = (
                sum(kept, axis),
                sum(alone, axis),
                sum(&other_seed[step], axis),
            );
            let allowed = 4.0 * (b - c).abs() + 0.03 * alone.iter().map(|g| g.abs()).sum::<f64>();
            assert!((a - b).abs() < allowed, "{step}, {axis}: {a} and {b}");
        }
    }
}
