//! Adaptive sampling: the same image with less noise, by as many rays.

use burn::tensor::Device;
use softray::prelude::*;

use crate::common::errors::{message, says};
use crate::common::numbers::{mean_and_error, rmse};
use crate::common::scenes::scene_file;
use crate::common::tensors::{gradient, leaf, radiance, values};

/// A scene of tests/data, its options, and these with adaptive sampling.
fn scene(name: &str, size: usize, samples: u32) -> (SceneFile, RenderOptions, RenderOptions) {
    let options = RenderOptions::new(size, size)
        .with_samples(samples)
        .with_bounces(1);
    let file = scene_file(name, &Device::flex());
    (file, options.clone(), options.with_adaptive())
}

#[test]
fn it_takes_noise_away_by_as_many_rays() {
    for (name, range) in [
        ("cornell", 0.3..0.7),
        ("shadow", 0.3..0.85),
        ("sphere", 0.85..1.15),
    ] {
        let (file, plain, adaptive) = scene(name, 32, 128);
        let image = |options: &RenderOptions, seed| {
            render(&file.scene, &file.camera, &options.clone().with_seed(seed)).expect("an image")
        };
        let reference = values(&image(&plain.clone().with_samples(4096), 99).radiance);
        let noise = |options: &RenderOptions| {
            let (mut squares, mut rays) = (0.0, 0);
            for seed in 0..4 {
                let image = image(options, seed);
                squares += rmse(&values(&image.radiance), &reference).powi(2);
                rays += image.statistics.rays;
            }
            (squares.sqrt(), rays as f64)
        };
        let (before, rays) = noise(&plain);
        let (after, taken) = noise(&adaptive);
        println!(
            "{name}: noise {:.3}, rays {:.3}",
            after / before,
            taken / rays
        );
        assert!(
            range.contains(&(after / before)),
            "{name}: {after} of {before}"
        );
        // The two images that tell where noise is take a 32nd.
        assert!((0.6..1.1).contains(&(taken / rays)), "{name}: {taken}");
    }
}

#[test]
fn means_and_gradients_stay() {
    let device = Device::flex();
    let (file, plain, adaptive) = scene("cornell", 16, 32);
    let of = |options: &RenderOptions, seed| {
        let mut scene = file.scene.clone();
        let by = leaf(&[1.0], &device);
        for object in &mut scene.objects {
            let vertices = object.mesh.vertices.clone() * by.clone().reshape([1, 1]);
            object.mesh = object.mesh.clone().with_vertices(vertices);
        }
        let image =
            render(&scene, &file.camera, &options.clone().with_seed(seed)).expect("an image");
        let mean = image.radiance.mean();
        [values(&mean)[0], gradient(&by, &mean.backward())[0]]
    };
    let runs =
        |options: &RenderOptions| -> Vec<[f64; 2]> { (0..120).map(|s| of(options, s)).collect() };
    let (plain, adaptive) = (runs(&plain), runs(&adaptive));
    for i in 0..2 {
        let estimate =
            |all: &[[f64; 2]]| mean_and_error(&all.iter().map(|v| v[i]).collect::<Vec<_>>());
        let ((a, ea), (b, eb)) = (estimate(&plain), estimate(&adaptive));
        println!("{a:.5} ± {ea:.1e}, adaptive {b:.5} ± {eb:.1e}");
        assert!(ea.hypot(eb) < 0.05 * a.abs(), "{ea} and {eb} of {a}");
        assert!((a - b).abs() < 4.0 * ea.hypot(eb), "{a} and {b}");
    }
}

/// Views of a batch are what they are alone, to the bit, whatever the tiles; outputs come with radiance.
#[test]
fn views_have_samples_of_their_own() {
    let (file, _, options) = scene("sphere", 24, 32);
    let options = options.with_depth().with_object_ids();
    let other = Camera::look_at([3.0, 1.0, 2.0], [0.0, 0.6, 0.0]);
    let batch = Batch::new(
        vec![file.scene.clone()],
        vec![file.camera.clone(), other.clone()],
    );
    let images = render_batch(&batch.expect("a batch"), &options).expect("images");
    for (i, camera) in [&file.camera, &other].into_iter().enumerate() {
        let own = options.of_view(i).with_rays_per_tile(500);
        let alone = render(&file.scene, camera, &own).expect("an image");
        let view = images.view(i);
        assert_eq!(values(&alone.radiance), values(&view.radiance));
        let depth = |image: &Image| values(image.depth.as_ref().expect("depth"));
        assert_eq!(depth(&alone), depth(&view));
        assert!(depth(&view).iter().any(|&d| d > 1.0));
    }
}

#[test]
fn lists_of_pixels_and_few_samples_have_no_more_than_without() {
    let (file, plain, adaptive) = scene("cornell", 16, 4);
    let paths = |options: &RenderOptions, pixels: &[u32]| {
        let image = render_pixels(&file.scene, &file.camera, options, pixels).expect("pixels");
        image.statistics.bounces[0]
    };
    let many = |o: &RenderOptions| paths(&o.clone().with_samples(64), &[3, 70, 200]);
    assert_eq!(many(&adaptive), many(&plain));
    let whole = render(&file.scene, &file.camera, &adaptive).expect("an image");
    assert_eq!(whole.statistics.bounces[0], 16 * 16 * 4);
}

#[test]
fn progress_counts_to_the_end() {
    use std::sync::Mutex;
    static CALLS: Mutex<Vec<(usize, usize)>> = Mutex::new(Vec::new());
    let (file, _, options) = scene("cornell", 32, 64);
    let options = options.with_progress(|n, all| CALLS.lock().expect("calls").push((n, all)));
    radiance(&file.scene, &file.camera, &options);
    let mut calls = CALLS.lock().expect("calls").clone();
    calls.sort_unstable();
    let all = calls[0].1;
    let expected: Vec<(usize, usize)> = (1..=all).map(|n| (n, all)).collect();
    assert_eq!(calls, expected);
}

#[test]
fn what_does_not_know_it_says_so() {
    let (file, _, options) = scene("cornell", 8, 8);
    let error = |options: RenderOptions| message(render(&file.scene, &file.camera, &options));
    says(
        error(options.clone().with_engine(Engine::Tensors)),
        ["adaptive", "Tensors"],
    );
    says(
        error(
            options
                .clone()
                .with_visibility(Visibility::softmax(1e-4, 1e-3)),
        ),
        ["adaptive", "softmax"],
    );
    says(
        error(options.with_samples(1 << 25)),
        ["samples", "adaptive"],
    );
}

#[test]
fn passes_and_clamps_have_no_gradients() {
    let device = Device::flex();
    let (room, camera) = cornell_box(&device);
    let offset = Tensor::<1>::zeros([3], &device).autodiff().require_grad();
    let moved = |o: Object| o.map_mesh(|m| m.translated(offset.clone()));
    let room = room.map_object("tall", moved).expect("a block");
    let options = RenderOptions::new(4, 4).with_samples(4);
    let clamped = options.clone().with_indirect_clamp(2.5);
    for (options, field, value) in [
        (options.with_pass(1, 2), "pass", "1 of 2"),
        (clamped.clone(), "indirect_clamp", "2.5"),
        (
            clamped.with_engine(Engine::Tensors),
            "indirect_clamp",
            "2.5",
        ),
    ] {
        let error = message(render(&room, &camera, &options));
        says(error, [field, value, "tracked", "gradients"]);
    }
}
