//! What pictures need beyond radiance: clamped indirect light, and albedos for denoisers.

use crate::common::numbers::{furthest, largest, mean, pairs};
use crate::common::scenes::{diffuse, facing_front, floor, lamp, on_axis, under_sky};
use crate::common::tensors::{leaf, radiance, values};
use crate::images::share_of_close_pixels;
use burn::tensor::Device;
use softray::prelude::*;

/// A small bright lamp, whose light a shiny ball throws onto a floor. All indirect light of one bounce meets the ball,
/// so its color is the ball's.
fn caustic() -> (Scene, Camera) {
    let device = Device::flex();
    let ball = shapes::icosphere(3, &device);
    let normals = ball.vertices.clone();
    let ball = ball.with_normals(normals).scaled(0.6);
    let shiny = Material::phong([0.0; 3], [0.8, 0.4, 0.2], 60.0);
    let lamp = lamp(0.05, 0.0, [2000.0; 3], &device);
    let scene = Scene::new()
        .with_object(diffuse(floor(2.0, 0.0, &device), [0.5; 3]))
        .with_object(Object::new(ball.translated([0.0, 0.6, 0.0])).with_material(shiny))
        .with_object(lamp.map_mesh(|m| m.translated([0.8, 2.5, 0.5])));
    let camera = Camera::look_at([0.0, 2.0, 4.0], [0.0, 0.4, 0.0]).with_fov_y(45.0);
    (scene, camera)
}

fn options(size: usize, samples: u32, bounces: u32) -> RenderOptions {
    let options = RenderOptions::new(size, size).with_samples(samples);
    options.with_bounces(bounces).with_seed(3)
}

/// One sample a pixel: each point of a path is connected to the lamp at most twice, by light and by BSDF sampling.
#[test]
fn clamps_scale_indirect_light_of_each_sample() {
    let (scene, camera) = caustic();
    let of = |options: &RenderOptions| radiance(&scene, &camera, options);
    let limit = 0.1;
    let clamped = |bounces| options(128, 1, bounces).with_indirect_clamp(limit);
    let direct = of(&options(128, 1, 0));
    assert_eq!(of(&clamped(0)), direct);
    let all = of(&options(128, 1, 1));
    assert_eq!(of(&options(128, 1, 1).with_indirect_clamp(1e30)), all);
    let found = of(&clamped(1));
    assert_eq!(of(&clamped(1)), found);
    let mut limited = 0;
    for ((found, all), direct) in (found.chunks(3).zip(all.chunks(3))).zip(direct.chunks(3)) {
        let indirect = |v: &[f64]| -> Vec<f64> { pairs(v, direct).map(|(v, d)| v - d).collect() };
        let rounding = 1e-6 * (1.0 + largest(all.iter().copied()));
        let [now, before] = [indirect(found), indirect(all)];
        assert!(now[0] <= (2.0 * limit).min(before[0]) + rounding);
        for (channel, share) in [(1, 0.5), (2, 0.25)] {
            assert!((now[channel] - share * now[0]).abs() <= rounding, "{now:?}");
        }
        if before[0] <= limit {
            assert_eq!(found, all);
        } else {
            limited += 1;
            assert!(now[0] >= limit - rounding);
        }
    }
    assert!(limited > 50, "{limited}");
}

/// The mean falls by no more than a tenth, and the variance of indirect light by more than five times.
#[test]
fn clamps_remove_fireflies() {
    let (scene, camera) = caustic();
    let statistics = |options: &RenderOptions| {
        let of_seed = |seed| {
            let options = options.clone().with_seed(seed);
            let all = radiance(&scene, &camera, &options);
            let direct = radiance(&scene, &camera, &options.with_bounces(0));
            let indirect = pairs(&all, &direct).map(|(a, b)| a - b).collect();
            (mean(&all), indirect)
        };
        let (means, images): (Vec<f64>, Vec<Vec<f64>>) = (0..8).map(of_seed).unzip();
        let variance = |i: usize| {
            let values: Vec<f64> = images.iter().map(|image| image[i]).collect();
            let middle = mean(&values);
            mean(
                &values
                    .iter()
                    .map(|v| (v - middle).powi(2))
                    .collect::<Vec<_>>(),
            )
        };
        let variances: Vec<f64> = (0..images[0].len()).map(variance).collect();
        [mean(&means), mean(&variances)]
    };
    let [whole, noisy] = statistics(&options(48, 16, 2));
    let [less, calm] = statistics(&options(48, 16, 2).with_indirect_clamp(1.0));
    println!("mean {whole} → {less}, variance {noisy} → {calm}");
    assert!(less < whole && less > 0.9 * whole, "{less} {whole}");
    assert!(calm < 0.2 * noisy, "{calm} {noisy}");
}

#[test]
fn clamps_of_both_engines() {
    let (scene, camera) = caustic();
    let sky = Tensor::from_floats([[[40.0, 30.0, 20.0], [0.1, 0.2, 0.3]]], &Device::flex());
    for scene in [
        scene.clone(),
        scene.clone().with_environment([3.0, 2.0, 1.0]),
        scene.with_environment(Environment::map(sky)),
    ] {
        let of = |engine| {
            let options = options(24, 8, 2)
                .with_indirect_clamp(0.3)
                .with_engine(engine);
            radiance(&scene, &camera, &options)
        };
        let close = share_of_close_pixels(&of(Engine::Kernels), &of(Engine::Tensors));
        assert!(close >= 0.99, "{close}");
    }
}

/// One surface a pixel, side by side.
#[test]
fn albedos_are_colors_of_surfaces() {
    let device = Device::flex();
    let (eta, k) = ([0.2, 0.9, 1.1], [3.9, 2.4, 2.2]);
    // Fresnel's reflectance along the normal.
    let f0 = |c: usize| {
        let squares = |x: f64| x * x + k[c] * k[c];
        squares(eta[c] - 1.0) / squares(eta[c] + 1.0)
    };
    let metal = Material::metallic_roughness([0.9, 0.6, 0.3], 1.0, 0.4);
    let gloss = Material::phong([0.2; 3], [0.3, 0.4, 0.8], 20.0);
    let cells = [
        (Material::diffuse([0.8, 0.3, 0.2]), [0.8, 0.3, 0.2]),
        (gloss, [0.5, 0.6, 1.0]),
        (metal, [0.9, 0.6, 0.3]),
        (Material::conductor(eta, k, 0.3), [f0(0), f0(1), f0(2)]),
        (Material::dielectric(1.5, 0.1), [1.0; 3]),
        (Material::emitter([5.0, 0.5, 0.25]), [1.0, 0.5, 0.25]),
    ];
    let square = |i: usize| facing_front([i as f64, i as f64 + 1.0], [-0.5, 0.5], 0.0, &device);
    let objects = cells.iter().enumerate();
    let objects = objects.map(|(i, (m, _))| Object::new(square(i)).with_material(m.clone()));
    let scene = objects.fold(Scene::new(), Scene::with_object);
    // The lower half of a pixel, and a pixel without a surface.
    let half = facing_front([6.0, 7.0], [-0.5, 0.0], 0.0, &device);
    let scene = scene.with_object(diffuse(half, [0.8, 0.4, 0.2]));
    let camera = Camera::look_at([4.0, 0.0, 5.0], [4.0, 0.0, 0.0]).with_orthographic(1.0);
    let mut expected: Vec<f64> = cells.iter().flat_map(|c| c.1).collect();
    expected.extend([0.4, 0.2, 0.1, 0.0, 0.0, 0.0]);
    // A pixel's samples lie inside of it.
    let (angle, pixels) = (0.0, 0.0);
    let options = RenderOptions::new(8, 1).with_samples(64).with_albedo();
    let options = options.with_visibility(Visibility::Cone { angle, pixels });
    for engine in [Engine::Kernels, Engine::Tensors] {
        let options = options.clone().with_engine(engine);
        let image = render(&scene, &camera, &options).expect("an image");
        let found = values(&image.albedo.expect("albedo"));
        assert!(furthest(&found, &expected) < 1e-5, "{engine:?}: {found:?}");
    }
}

/// A plane that fills the image, rendered in every way, with a tracked color.
#[test]
fn albedos_of_all_kinds_of_renders() {
    let device = Device::flex();
    let plane = facing_front([-9.0, 9.0], [-9.0, 9.0], 0.0, &device);
    let color = leaf(&[0.8, 0.3, 0.2], &device);
    let scene = |color: Parameter<3>| {
        let material = Material::diffuse(color);
        under_sky(plane.clone()).map_object("object", |o| o.with_material(material.clone()))
    };
    let (tracked, scene) = (scene(color.into()), scene([0.8, 0.3, 0.2].into()));
    let (tracked, scene) = (tracked.expect("a plane"), scene.expect("a plane"));
    let camera = on_axis(3.0);
    let options = RenderOptions::new(6, 4).with_samples(32).with_albedo();
    let softmax = options
        .clone()
        .with_visibility(Visibility::softmax(1e-6, 1e-4));
    let batch = Batch::new(vec![scene.clone()], vec![camera.clone(); 2]).expect("a batch");
    let with = |options: RenderOptions| render(&scene, &camera, &options);
    let images = [
        with(softmax),
        with(options.clone().with_pass(1, 2)),
        with(options.clone().with_adaptive()),
        with(options.clone().with_object_ids().with_normals()),
        render_pixels(&scene, &camera, &options, &[3, 3, 0]),
        render_batch(&batch, &options).map(|images| images.view(1)),
        render(&tracked, &camera, &options),
    ];
    for (i, image) in images.into_iter().enumerate() {
        let image = image.expect("an image");
        assert_eq!(image.radiance.is_tracked(), i == 6);
        let albedo = image.albedo.expect("albedo");
        assert!(!albedo.is_tracked());
        assert_eq!(albedo.dims(), image.radiance.dims());
        for found in values(&albedo).chunks(3) {
            assert!(furthest(found, &[0.8, 0.3, 0.2]) < 1e-5, "{i}: {found:?}");
        }
    }
}
