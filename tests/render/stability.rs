//! Nothing a scene can hold makes an image or a gradient infinite or NaN, and what should not
//! matter does not: scale, place, orientation.

use crate::common::errors::{message, says};
use crate::common::gradients::SHARP;
use crate::common::memory::resident;
use crate::common::numbers::{furthest, largest, mean, pairs, rmse};
use crate::common::process::alone;
use crate::common::scenes::{on_axis, scene_file, under_sky};
use crate::common::stress::cases::cases;
use crate::common::stress::{Failures, Outcome, Thing, World};
use crate::common::tensors::{gradient, leaf, radiance, tensor};
use crate::common::{cpu_devices, long};
use burn::tensor::{DType, Device};
use softray::prelude::*;

/// Every case on both CPU backends in both float types.
#[test]
fn images_and_gradients_are_finite() {
    let mut failures = Failures::default();
    let all = cases();
    for (number, (name, world)) in all.iter().enumerate() {
        for device in cpu_devices() {
            for dtype in [DType::F32, DType::F64] {
                let is_flex = device == Device::flex();
                // The short tier takes Flex in f32, and a sample of the rest.
                let first = is_flex && dtype == DType::F32;
                if !(long() || first || number.is_multiple_of(7)) {
                    continue;
                }
                let name = format!("{name}, {device:?}, {dtype:?}");
                failures.note(&name, world.run(&device, dtype));
            }
        }
    }
    println!("{} cases", all.len());
    failures.assert_none();
}

/// Triangles at random, of sizes and at distances a million times apart, in scenes of 1e-12 to 1e12.
#[test]
fn soups_of_any_size_are_finite() {
    let mut failures = Failures::default();
    let mut state = 1u64;
    let mut random = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 11) as f64 / (1u64 << 53) as f64 * 2.0 - 1.0
    };
    for (round, exponent) in (0..if long() { 40 } else { 4 })
        .flat_map(|round| [-12, -6, 0, 6, 12].map(|exponent| (round, exponent)))
    {
        let scale = 10f64.powi(exponent);
        let mut vertices = Vec::new();
        for _ in 0..30 {
            let size = scale * 10f64.powf(3.0 * random());
            let at: [f64; 3] = std::array::from_fn(|_| size * random());
            for _ in 0..3 {
                vertices.push(std::array::from_fn(|k| at[k] + size * random()));
            }
        }
        let faces: Vec<[u32; 3]> = (0..30).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        for form in [
            Visibility::cone(0.0),
            Visibility::cone(2.865),
            Visibility::softmax(1e-4 * scale * scale, 1e-3),
        ] {
            let soup = Thing::new("soup", vertices.clone(), faces.clone());
            let world = World::new().with(|w| {
                w.things = vec![soup.emitting([1.0, 0.5, 0.2])];
                w.eye = [0.3 * scale, 1.6 * scale, 4.0 * scale];
                w.target = [0.0, 0.1 * scale, 0.0];
                w.options = w.options.clone().with_visibility(form);
            });
            let name = format!("soup {round} of 1e{exponent}, {form:?}");
            failures.note(&name, world.run(&Device::flex(), DType::F32));
        }
    }
    failures.assert_none();
}

/// The largest difference of two images or gradients, relative to their largest value.
fn apart(a: &[f64], b: &[f64]) -> f64 {
    let scale = largest(a.iter().chain(b).copied());
    assert!(scale > 0.0, "nothing to compare");
    furthest(a, b) / scale
}

/// Paths are the same but where rounding tips a decision: all pixels but that share.
fn share_apart(a: &[f64], b: &[f64], tolerance: f64) -> f64 {
    let close = |(x, y): &(f64, f64)| (x - y).abs() <= tolerance * x.abs().max(y.abs()).max(1e-3);
    1.0 - pairs(a, b).filter(close).count() as f64 / a.len() as f64
}

fn forms() -> [Visibility; 2] {
    [Visibility::cone(1.146), Visibility::softmax(1e-3, 1e-2)]
}

fn world(form: Visibility) -> World {
    World::new().with(|w| {
        w.options = RenderOptions::new(12, 12)
            .with_samples(4)
            .with_bounces(2)
            .with_visibility(form)
            .with_seed(3);
        w.thing("ball").velocity = Some([0.2, 0.1, 0.0]);
        w.lens = Some((0.05, 4.0));
    })
}

/// The world times s.
fn scaled(form: Visibility, s: f64) -> Outcome {
    let scaled = world(form).mapped(|p| p.map(|x| s * x)).with(|w| {
        if let Visibility::Softmax(SoftmaxOptions { sigma, gamma, .. }) = form {
            let softmax = Visibility::softmax(sigma * s * s, gamma);
            w.options = w.options.clone().with_visibility(softmax);
        }
        w.thing("ball").velocity = Some([0.2 * s, 0.1 * s, 0.0]);
        w.lens = Some((0.05 * s, 4.0 * s));
    });
    scaled.run(&Device::flex(), DType::F32).expect("an image")
}

/// Times s, with the σ of a softmax times s²: the same image. Gradients to lengths are divided by s.
#[test]
fn scale_does_not_matter() {
    for form in forms() {
        let expected = world(form)
            .run(&Device::flex(), DType::F32)
            .expect("an image");
        for s in [1e-6, 1e-3, 0.37, 128.0, 1e3, 1e6] {
            let found = scaled(form, s);
            assert_eq!(found.not_finite(), None, "{form:?}, scale {s:e}");
            let tipped = share_apart(&expected.image, &found.image, 1e-3);
            assert!(tipped < 0.02, "{form:?}, scale {s:e}: {tipped}");
            let lengths = ["ball vertices", "floor vertices", "light vertices", "eye"];
            for name in lengths
                .into_iter()
                .chain(["ball velocity", "aperture", "focus"])
            {
                let rescaled: Vec<f64> = found.gradient(name).iter().map(|g| g * s).collect();
                let far = apart(expected.gradient(name), &rescaled);
                assert!(far < 0.05, "{form:?}, scale {s:e}: {name} {far}");
            }
            for name in ["ball diffuse", "light emission", "fov", "environment"] {
                let far = apart(expected.gradient(name), found.gradient(name));
                assert!(far < 0.02, "{form:?}, scale {s:e}: {name} {far}");
            }
        }
        // By powers of two nothing even rounds differently.
        for s in [2f64.powi(-20), 0.25, 2f64.powi(20)] {
            let found = scaled(form, s);
            assert_eq!(expected.image, found.image, "{form:?}, scale {s:e}");
        }
    }
}

/// Scene and camera shifted by up to 1e4 scene sizes in f32. What the vertices themselves lose by
/// rounding can't come back, 1e4·6e-8 of the scene's size; nothing is lost beyond it.
#[test]
fn place_does_not_matter() {
    for form in forms() {
        let device = Device::flex();
        let near = world(form).run(&device, DType::F32).expect("an image");
        for distance in [1.0, 1e2, 1e4] {
            let size = 3.0 * distance;
            let shift = |p: [f64; 3]| [p[0] + size, p[1] - 0.7 * size, p[2] + 0.4 * size];
            // The same rounding of vertices and camera, but at the origin and in f64.
            let rounded = |p: [f64; 3]| shift(p).map(|x| f64::from(x as f32));
            let back = |p: [f64; 3]| {
                let o = shift([0.0; 3]);
                std::array::from_fn(|i| rounded(p)[i] - o[i])
            };
            let expected = world(form)
                .mapped(back)
                .run(&device, DType::F64)
                .expect("an image");
            let found = world(form)
                .mapped(shift)
                .run(&device, DType::F32)
                .expect("an image");
            assert_eq!(found.not_finite(), None, "{form:?}, {distance:e}");
            let tipped = share_apart(&expected.image, &found.image, 1e-2);
            let moved = (found.mean() / near.mean() - 1.0).abs();
            println!("{form:?}, {distance:e} sizes: {tipped} of the values, mean off by {moved:e}");
            assert!(tipped < 0.03, "{form:?}, {distance:e}: {tipped}");
            assert!(moved < 0.02, "{form:?}, {distance:e}: {moved}");
        }
    }
}

/// Rotations about the three axes, one after the other.
fn turn([x, y, z]: [f64; 3], angles: [f64; 3]) -> [f64; 3] {
    let q = glam::DQuat::from_euler(glam::EulerRot::XYZ, angles[0], angles[1], angles[2]);
    (q * glam::DVec3::new(x, y, z)).to_array()
}

/// A rigid motion of scene and camera. Directions drawn from a BSDF take their frame from the
/// world's axes, so paths that use them are others: direct light from points chosen on emitters only.
#[test]
fn orientation_does_not_matter() {
    // A cone's directions take their frame from the world's axes too.
    for form in [Visibility::default(), forms()[1]] {
        let still = || {
            world(form).with(|w| {
                w.environment = [0.0; 3];
                let mut sampling = Sampling::default();
                sampling.multiple_importance = false;
                w.options = w.options.clone().with_bounces(0).with_sampling(sampling);
            })
        };
        let device = Device::flex();
        let expected = still().run(&device, DType::F32).expect("an image");
        for angles in [[0.3, 0.0, 0.0], [0.0, 1.7, 0.4], [2.0, -1.0, 3.0]] {
            let turned = still()
                .mapped(|p| turn(p, angles).map(|x| x + 0.25))
                .with(|w| {
                    w.up = turn(w.up, angles);
                    let ball = w.thing("ball");
                    ball.velocity = ball.velocity.map(|v| turn(v, angles));
                });
            let found = turned.run(&device, DType::F32).expect("an image");
            let tipped = share_apart(&expected.image, &found.image, 1e-3);
            assert!(tipped < 0.01, "{form:?}, {angles:?}: {tipped}");
            for name in ["ball diffuse", "light emission", "aperture", "focus"] {
                let far = apart(expected.gradient(name), found.gradient(name));
                assert!(far < 0.02, "{form:?}, {angles:?}: {name} {far}");
            }
            // A gradient to a direction turns with it.
            let eye = |o: &Outcome| -> [f64; 3] { o.gradient("eye").try_into().expect("three") };
            let far = apart(&turn(eye(&expected), angles), &eye(&found));
            assert!(far < 0.02, "{form:?}, {angles:?}: eye {far}");
        }
    }
}

/// Blur → 0: images settle, without a jump.
#[test]
fn the_limits_are_approached_without_a_jump() {
    let device = Device::flex();
    let at = |form: Visibility, seed: u64| {
        let world = World::new().with(|w| {
            w.options = RenderOptions::new(12, 12)
                .with_samples(16)
                .with_bounces(1)
                .with_visibility(form)
                .with_seed(seed);
        });
        world.run(&device, DType::F32).expect("an image").image
    };
    let sharp = at(SHARP, 0);
    let noise = rmse(&at(SHARP, 1), &sharp);
    let close = |what: String, form: Visibility, [of_mean, of_pixels]: [f64; 2]| {
        let image = at(form, 0);
        let moved = (mean(&image) / mean(&sharp) - 1.0).abs();
        let off = rmse(&image, &sharp) / noise;
        println!("{what}: the mean is off by {moved:.4}, pixels by {off:.3} of the noise");
        assert!(moved < of_mean, "{what}: {moved}");
        assert!(off < of_pixels, "{what}: {off}");
    };
    for exponent in 6..=14 {
        let blur = 10f64.powi(-exponent);
        let [angle, pixels] = [blur.sqrt().to_degrees(), blur.sqrt()];
        let cone = Visibility::Cone { angle, pixels };
        close(format!("angle {angle:e}"), cone, [0.01, 1.2]);
        // The swelling √(σ·Δz/γ) needs σ ≪ γ.
        let gamma = 10f64.powi(-(exponent / 2));
        let swelling = (blur / gamma).sqrt();
        let softmax = Visibility::softmax(blur, gamma);
        close(
            format!("σ 1e-{exponent}, γ {gamma:e}"),
            softmax,
            [3.0 * swelling + 0.01, 1.2],
        );
    }
}

/// Devices round differently. Normals of the box's walls then differ by rounding from axes, and paths must stay the same.
#[test]
fn rounding_of_vertices_changes_few_paths() {
    let device = Device::flex();
    let file = scene_file("cornell", &device);
    let options = RenderOptions::new(32, 32).with_samples(4).with_bounces(3);
    let image = |rounding: f64| {
        let rounded = |o: Object| {
            o.map_mesh(|mut mesh| {
                let [count, _] = mesh.vertices.dims();
                let numbers = (0..3 * count).map(|i| 1.0 + rounding * (1.7 * i as f64).sin());
                let numbers: Vec<f64> = numbers.collect();
                let numbers = tensor(&numbers, [count, 3], &device, DType::F32);
                mesh.vertices = mesh.vertices * numbers;
                mesh
            })
        };
        let mut scene = file.scene.clone();
        scene.objects = scene.objects.into_iter().map(rounded).collect();
        radiance(&scene, &file.camera, &options)
    };
    let (exact, rounded) = (image(0.0), image(2e-7));
    let others = share_apart(&exact, &rounded, 1e-3);
    println!("{others} of the channels differ");
    assert!(exact != rounded && others < 0.01, "{others}");
}

#[test]
fn nan_texture_coordinates_are_an_error() {
    let world = World::new().with(|w| {
        let uvs = vec![[0.0, 0.0], [1.0, 0.0], [1.0, f64::NAN], [0.0, 1.0]];
        w.thing("floor").texture = Some(([2, 2], vec![0.5; 12], uvs));
    });
    let error = message(world.run(&Device::flex(), DType::F32));
    says(error, ["floor", "uvs 2", "NaN"]);
}

/// Texels in the graph may wander far over 1 during a fit.
#[test]
fn hdr_texels_stay_finite() {
    let world = World::new().with(|w| {
        let uvs = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        w.thing("floor").texture = Some(([1, 2], vec![50.0; 6], uvs));
    });
    let outcome = world.run(&Device::flex(), DType::F32);
    assert_eq!(outcome.expect("an image").not_finite(), None);
}

#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "memory is known on Linux alone")]
fn memory_stays_flat_over_repeated_renders() {
    if !alone(memory_stays_flat_over_repeated_renders) {
        return;
    }
    let device = Device::flex();
    let world = World::new();
    let plain = || {
        let scene = under_sky(shapes::icosphere(1, &device));
        render(&scene, &on_axis(4.0), &world.options).expect("an image")
    };
    let both = || world.run(&device, DType::F32).expect("an image");
    for _ in 0..100 {
        plain();
    }
    let before = resident();
    for _ in 0..1000 {
        plain();
    }
    let forward = resident();
    for _ in 0..50 {
        both();
    }
    let warm = resident();
    for _ in 0..200 {
        both();
    }
    let after = resident();
    println!("forward {before} → {forward} MiB, with backward {warm} → {after} MiB");
    // A leak of 2 KiB a render would show.
    assert!(
        before > 0.0 && forward <= before + 2.0,
        "{before} → {forward} MiB"
    );
    assert!(after <= warm + 2.0, "{warm} → {after} MiB");
}

/// Glass that shines is not lit by the plane that it is in, where rounding says which side a point is on.
#[test]
fn luminous_glass_has_small_gradients() {
    let device = Device::flex();
    let ior = leaf(&[1.6], &device);
    let glass = Material::dielectric(ior.clone(), 0.6).with_emission([0.5; 3]);
    let mesh = shapes::cylinder(0.6, 1.4, 9, &device).rotated([0.3, 1.0, 0.5], 23.0);
    let scene = Scene::new().with_object(Object::new(mesh).with_material(glass));
    let camera = Camera::look_at([0.3, 1.8, 4.2], [0.0; 3]).with_fov_y(35.0);
    for seed in 0..4 {
        let options = RenderOptions::new(16, 16)
            .with_samples(64)
            .with_bounces(2)
            .with_seed(seed);
        let image = render(&scene, &camera, &options).expect("an image");
        let by_ior = gradient(&ior, &image.radiance.mean().backward());
        println!("{by_ior:?}");
        assert!(by_ior[0].abs() < 0.1, "{by_ior:?}");
    }
}
