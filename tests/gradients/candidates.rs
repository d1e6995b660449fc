//! What hierarchies of boxes find: of the softmax, against all triangles in tensors, the specification,
//! images and gradients differ by what the cutoff allows.

use crate::common::long;
use crate::common::numbers::{pairs, rmse};
use crate::common::scenes::{diffuse, emitting, facing_front, on_axis, under_sky};
use crate::common::stress::{Outcome, Thing, World};
use crate::common::tensors::radiance;
use burn::tensor::{DType, Device};
use softray::prelude::*;

fn worlds() -> Vec<(&'static str, World)> {
    let device = Device::flex();
    let ball = |subdivisions| {
        World::new().with(|w| {
            let fine = shapes::icosphere(subdivisions, &device);
            let Thing { gloss, .. } = w.thing("ball").clone();
            *w.thing("ball") = Thing::shape("ball", fine, [0.4, 0.7, 0.0], 0.6);
            w.thing("ball").gloss = gloss;
        })
    };
    let moving = ball(1).with(|w| {
        w.thing("ball").velocity = Some([0.4, 0.2, 0.1]);
        w.thing("light").velocity = Some([-0.2, 0.0, 0.3]);
        w.lens = Some((0.1, 4.0));
    });
    let textured = World::new().with(|w| {
        let uvs = vec![[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]];
        let texels = (0..12).map(|i| 0.1 + 0.05 * f64::from(i)).collect();
        w.thing("floor").texture = Some(([2, 2], texels, uvs));
    });
    vec![
        ("few", World::new()),
        ("80 faces, moving, lens", moving),
        ("320 faces", ball(2)),
        ("textured", textured),
    ]
}

/// Σ|a − b|/Σ|b| over the gradients of a parameter.
#[track_caller]
fn apart(a: &[f64], b: &[f64]) -> f64 {
    let scale: f64 = b.iter().map(|v| v.abs()).sum();
    assert!(scale > 0.0, "nothing to compare");
    pairs(a, b).map(|(a, b)| (a - b).abs()).sum::<f64>() / scale
}

fn both(world: &World, sigma: f64, gamma: f64, cutoff: f64) -> [Outcome; 2] {
    let options = RenderOptions::new(10, 10)
        .with_samples(4)
        .with_bounces(1)
        .with_seed(5);
    let softmax = SoftmaxOptions::new(sigma, gamma).with_cutoff(cutoff);
    [softmax.with_brute_force(), softmax].map(|softmax| {
        let world = World {
            options: options.clone().with_visibility(softmax),
            ..world.clone()
        };
        world.run(&Device::flex(), DType::F64).expect("an image")
    })
}

/// With next to no cutoff both are the same up to rounding: value and every gradient. The nearer a
/// triangle, the farther beside a ray it has to be looked for: none is missed where nearness counts
/// most. What counts less than the cutoff allows, as the light's albedo here, has no gradient to compare. The short tier
/// takes a third of the pairs of widths with each world, and all of them with some world.
#[test]
fn without_a_cutoff_they_are_the_same() {
    for (number, (name, world)) in worlds().into_iter().enumerate() {
        for (i, gamma) in [1e-3, 1e-2, 0.1].into_iter().enumerate() {
            for (j, sigma) in [1e-6, 1e-4, 1e-3, 2e-2].into_iter().enumerate() {
                if !(long() || (number + i + j).is_multiple_of(3)) {
                    continue;
                }
                let [expected, found] = both(&world, sigma, gamma, 1e-18);
                let image = rmse(&found.image, &expected.image);
                assert!(image < 1e-9, "{name}, γ {gamma}, σ {sigma}: {image:e}");
                for parameter in ["ball vertices", "floor vertices", "eye", "light emission"] {
                    let far = apart(found.gradient(parameter), expected.gradient(parameter));
                    assert!(
                        far < 1e-5,
                        "{name}, γ {gamma}, σ {sigma}, {parameter}: {far:e}"
                    );
                }
            }
        }
    }
}

/// The error falls with the cutoff. A draw that it tips changes a path altogether: two of the hundred
/// pixels may be such, the bound is that of the others.
#[test]
fn the_cutoff_bounds_the_error() {
    for (name, world) in worlds() {
        for (cutoff, value, slope) in [(1e-2, 0.1, 1.0), (1e-4, 0.02, 0.05), (1e-8, 1e-5, 1e-3)] {
            let [expected, found] = both(&world, 1e-3, 1e-2, cutoff);
            let mean = expected.mean();
            let pairs = found.image.chunks(3).zip(expected.image.chunks(3));
            let mut pixels: Vec<f64> = pairs.map(|(a, b)| rmse(a, b)).collect();
            pixels.sort_by(f64::total_cmp);
            let most = &pixels[..pixels.len() - 2];
            let image = rmse(most, &vec![0.0; most.len()]) / mean;
            assert!(image < value, "{name}, cutoff {cutoff:e}: {image:e}");
            for parameter in ["ball vertices", "light emission", "eye", "floor vertices"] {
                let far = apart(found.gradient(parameter), expected.gradient(parameter));
                println!("{name}, {cutoff:e}, {parameter}: {far:.2e}");
                assert!(
                    far < slope,
                    "{name}, cutoff {cutoff:e}, {parameter}: {far:e}"
                );
            }
        }
    }
}

/// Boxes fitted to triangles that moved find what new ones find; what moved too far, or has other
/// faces, is built anew.
#[test]
fn boxes_are_fitted_while_little_moves() {
    let device = Device::flex();
    let camera = on_axis(4.0).with_fov_y(40.0);
    let cache = HierarchyCache::default();
    let options = RenderOptions::new(16, 16).with_samples(2).with_bounces(1);
    let cached = options.clone().with_cache(&cache);
    let at = |mesh: Mesh| {
        let scene = under_sky(mesh);
        let image = |o: &RenderOptions| radiance(&scene, &camera, o);
        assert_eq!(image(&cached), image(&options));
    };
    let ball = |n| shapes::icosphere(n, &device);
    let stretched = |factor: f32| {
        let m = ball(2);
        let scale = Tensor::<2>::from_floats([[factor, 1.0, 1.0]], &device);
        let vertices = m.vertices.clone() * scale;
        m.with_vertices(vertices)
    };
    // Those that stay are taken as they are.
    for _ in 0..2 {
        at(ball(2));
        assert_eq!(cache.counts(), [1, 0]);
    }
    for i in 1..5 {
        at(stretched(1.0 + 0.02 * i as f32));
        assert_eq!(cache.counts(), [1, i]);
    }
    // Vertices dealt at random: the old tree is useless.
    let m = ball(2);
    let count = m.vertices.dims()[0] as i32;
    let order: Vec<i32> = (0..count).map(|i| (i * 61) % count).collect();
    let order = Tensor::<1, burn::tensor::Int>::from_ints(order.as_slice(), &device);
    let shuffled = m.vertices.clone().select(0, order);
    at(m.with_vertices(shuffled));
    assert_eq!(cache.counts(), [2, 4]);
    at(ball(1));
    assert_eq!(cache.counts(), [3, 4]);
}

/// Work that cannot matter is not done.
#[test]
fn what_a_scene_does_not_need_is_skipped() {
    let device = Device::flex();
    let run = |scene: &Scene, bounces| {
        let camera = on_axis(4.0).with_fov_y(60.0);
        let options = RenderOptions::new(32, 32)
            .with_samples(4)
            .with_bounces(bounces);
        let image = render(scene, &camera, &options);
        image.expect("an image").statistics
    };
    let camera_rays = 32 * 32 * 4;
    let ball = || diffuse(shapes::icosphere(2, &device), [0.5; 3]);
    // Without light nothing leaves the first surface.
    let dark = run(&Scene::new().with_object(ball()), 5);
    assert_eq!(dark.rays, camera_rays);
    // Under a sky rays that miss end: a ball seen from outside is left after one bounce.
    let sky = Scene::new().with_object(ball()).with_environment([1.0; 3]);
    let found = run(&sky, 5);
    assert!(found.rays < 2 * camera_rays, "{found:?}");
    assert_eq!(found.bounces[0], camera_rays);
    assert!(found.bounces.windows(2).all(|b| b[1] < b[0]), "{found:?}");
    // Surfaces that reflect nothing end a path.
    let black = diffuse(shapes::icosphere(2, &device), [0.0; 3]);
    let black = run(
        &Scene::new().with_object(black).with_environment([1.0; 3]),
        5,
    );
    assert_eq!(black.rays, camera_rays);
    // A light that shines away from all: no shadow ray.
    let lamp = |up: bool| {
        let x = if up { [0.5, -0.5] } else { [-0.5, 0.5] };
        emitting(facing_front(x, [0.0, 0.5], 1.5, &device), [1.0; 3])
    };
    let away = run(
        &Scene::new().with_object(ball()).with_object(lamp(false)),
        0,
    );
    assert_eq!(away.rays, camera_rays);
    let towards = run(&Scene::new().with_object(ball()).with_object(lamp(true)), 0);
    assert!(towards.rays > camera_rays, "{towards:?}");
}

/// Constants record no tape, whatever else is in the graph.
#[test]
fn a_constant_scene_leaves_nothing_behind() {
    let device = Device::flex();
    let scene = under_sky(shapes::icosphere(1, &device));
    let camera = on_axis(4.0);
    let options = RenderOptions::new(8, 8).with_samples(2);
    let softmax = SoftmaxOptions::new(1e-3, 1e-3);
    let of = |softmax| options.clone().with_visibility(softmax);
    for options in [options.clone(), of(softmax), of(softmax.with_brute_force())] {
        let image = render(&scene, &camera, &options).expect("an image");
        assert!(!image.radiance.is_tracked());
    }
}
