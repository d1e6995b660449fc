//! Kernels beside tensors, which are their specification: the same images, outputs and gradients for the
//! same seed, but for rounding, which now and then makes a draw another. Where glossy material moves and rays have no
//! cones, rays of kernels follow it in derivatives; the gradients are then the same in the mean.

use crate::common::errors::{message, says};
use crate::common::facets::{clamped_cases, facet_cases};
use crate::common::gradients::{
    CONES, Case, Effort, SHARP, Setup, all_classes, assert_agreement, floor_and_light, lights,
    of_seed,
};
use crate::common::long;
use crate::common::numbers::{apart, mean_and_error, pairs};
use crate::common::tensors::{gradient, leaf, values};
use burn::tensor::{DType, Device};
use softray::prelude::*;

/// Every class of parameter, f64 in tensors beside f32 in kernels.
#[test]
fn gradients_of_every_class() {
    let flex = Device::flex();
    let setups: [Setup; 2] = [(&flex, |o| o), (&flex, |o| o.with_engine(Engine::Tensors))];
    for visibility in [SHARP, CONES.visibility] {
        let samples = 16;
        let effort = Effort {
            visibility,
            samples,
        };
        assert_agreement(&all_classes(), setups, DType::F64, effort, |_| 1e-3);
    }
}

/// Every parameter of BSDFs of facets, and emissive textures.
#[test]
fn gradients_of_facets_and_of_emissive_textures() {
    let follows = |case: &Case| case.name.ends_with("that moves");
    let (followed, others): (Vec<Case>, Vec<Case>) = facet_cases().into_iter().partition(follows);
    assert_eq!(followed.len(), 2);
    let others = [others, lights::glowing(), lights::crossings()];
    let others: Vec<Case> = others.into_iter().flatten().collect();
    let flex = Device::flex();
    let setups: [Setup; 2] = [(&flex, |o| o), (&flex, |o| o.with_engine(Engine::Tensors))];
    for visibility in [SHARP, CONES.visibility] {
        let effort = Effort {
            visibility,
            samples: 16,
        };
        assert_agreement(&others, setups, DType::F64, effort, |_| 1e-3);
        if visibility == CONES.visibility {
            assert_agreement(&followed, setups, DType::F64, effort, |_| 1e-3);
            continue;
        }
        for case in &followed {
            let of = |seed| setups.map(|at| of_seed(case, at, DType::F32, effort, seed));
            assert_equal_means(case.name, &(0..96).map(of).collect::<Vec<_>>(), 0.5);
        }
    }
}

/// That two estimates for each seed have the same mean, the difference with an error of at most a share of it.
fn assert_equal_means(name: &str, pairs: &[[f64; 2]], precision: f64) {
    let mean_of =
        |f: &dyn Fn(&[f64; 2]) -> f64| mean_and_error(&pairs.iter().map(f).collect::<Vec<_>>());
    let ((mean, _), (apart, error)) =
        (mean_of(&|pair| pair[1]), mean_of(&|pair| pair[0] - pair[1]));
    println!("{name}: {mean:.4e}, {apart:.1e} ± {error:.1e} apart");
    assert!(
        error < precision * mean.abs(),
        "{name}: ± {error} of {mean}"
    );
    assert!(
        apart.abs() < 4.0 * error,
        "{name}: {apart} ± {error} of {mean}"
    );
}

/// Where the model clamps a parameter its gradient is 0, so that no step of a fit is thrown far off.
#[test]
fn values_outside_of_their_ranges_have_no_gradient() {
    let flex = Device::flex();
    let engines: [Setup; 2] = [(&flex, |o| o), (&flex, |o| o.with_engine(Engine::Tensors))];
    for case in clamped_cases() {
        let found = engines.map(|at| of_seed(&case, at, DType::F64, CONES, 5));
        println!("{}: {found:?}", case.name);
        assert_eq!(found, [0.0; 2], "{}", case.name);
    }
}

/// A scene in which everything happens at once: a glossy ball with smooth normals that moves, a textured
/// floor, a lamp, a map of a sky, a lens.
fn everything(device: &Device, sky: bool) -> (Scene, Camera, Vec<Tensor<1>>) {
    let tracked = |v: &[f32]| leaf(v, device);
    let place = tracked(&[0.3, 0.8, 0.1]);
    let texels = tracked(&[0.2, 0.3, 0.4, 0.5, 0.4, 0.3, 0.6, 0.6, 0.2, 0.3, 0.7, 0.5]);
    let tilt = tracked(&[0.1, 0.05, -0.1]);
    let gloss = tracked(&[0.4, 0.5, 0.3]);
    let exponent = tracked(&[20.0]);
    let velocity = tracked(&[0.2, 0.1, 0.0]);
    let emission = tracked(&[4.0, 3.6, 3.2]);
    let eye = tracked(&[0.2, 1.3, 4.2]);
    let lens = tracked(&[0.08]);
    let light = tracked(&[1.0]);

    let ball = shapes::icosphere(1, device);
    let smooth = ball.vertices.clone() + tilt.clone().reshape([1, 3]);
    let ball = ball
        .with_normals(smooth)
        .scaled(Tensor::from_floats([0.6], device))
        .translated(place.clone());
    let [floor, lamp] = floor_and_light(device);
    let shiny = Material::phong([0.3, 0.3, 0.2], gloss.clone(), exponent.clone());
    let texture = ColorTexture::texture(texels.clone().reshape([2, 2, 3]));
    let mut scene = Scene::new()
        .with_object(Object::new(floor).with_material(Material::diffuse(texture)))
        .with_object(Object::new(lamp).with_material(Material::emitter(emission.clone())))
        .with_object(
            Object::new(ball)
                .with_material(shiny)
                .with_velocity(velocity.clone()),
        );
    scene = if sky {
        let base: Vec<f64> = (0..8 * 4 * 3).map(|i| 0.2 + 0.1 * (i % 7) as f64).collect();
        let base = Tensor::<1>::from_data(base.as_slice(), device) * light.clone();
        scene.with_environment(Environment::map(base.reshape([4, 8, 3])))
    } else {
        scene.with_environment(light.clone().expand([3]) * 0.4)
    };
    let camera = Camera::look_at(eye.clone(), [0.0, 0.9, 0.0])
        .with_fov_y(38.0)
        .with_thin_lens(lens.clone(), 4.0);
    let all = vec![
        place, texels, tilt, gloss, exponent, velocity, emission, eye, lens, light,
    ];
    (scene, camera, all)
}

/// Radiance, opacity, depth, normals, albedo, objects, and the gradients of all parameters of a loss of all
/// outputs.
fn outcome(
    engine: Engine,
    sky: bool,
    form: Visibility,
    (seed, is_linear): (u64, bool),
) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let device = Device::flex();
    let (scene, camera, parameters) = everything(&device, sky);
    let options = RenderOptions::new(32, 24)
        .with_samples(16)
        .with_bounces(2)
        .with_russian_roulette(1)
        .with_visibility(form)
        .with_engine(engine)
        .with_seed(seed)
        .with_opacity()
        .with_depth()
        .with_normals()
        .with_albedo()
        .with_object_ids();
    let image = render(&scene, &camera, &options).expect("an image");
    let (opacity, depth) = (image.opacity.expect("it"), image.depth.expect("it"));
    let (normals, ids) = (image.normals.expect("it"), image.object_ids.expect("it"));
    // The mean gradient of a loss that is not linear depends on how the noise of gradient and image belong together.
    let of_light = if is_linear {
        image.radiance.clone().sum() + depth.clone().sum() * 0.1
    } else {
        image.radiance.clone().powf_scalar(2.0).sum()
            + (opacity.clone() * depth.clone()).sum() * 0.1
    };
    let loss = of_light + normals.clone().slice([0..24, 0..16, 0..3]).sum();
    let outputs = vec![
        values(&image.radiance),
        values(&opacity),
        values(&depth),
        values(&normals),
        values(&image.albedo.expect("it")),
        values(&ids.float()),
    ];
    let gradients = loss.backward();
    let gradients = parameters.iter().map(|p| gradient(p, &gradients));
    (outputs, gradients.collect())
}

#[test]
fn everything_at_once() {
    for (sky, form) in [
        (false, Visibility::cone(0.0)),
        (false, Visibility::cone(5.73)),
        (true, Visibility::cone(0.0)),
        (true, Visibility::cone(5.73)),
    ] {
        let kernels = outcome(Engine::Kernels, sky, form, (7, false));
        let tensors = outcome(Engine::Tensors, sky, form, (7, false));
        for (i, (a, b)) in kernels.0.iter().zip(&tensors.0).enumerate() {
            let close = pairs(a, b).filter(|(x, y)| (x - y).abs() < 1e-3).count();
            let share = close as f64 / a.len() as f64;
            println!("output {i}: {:.2} % within 1e-3", 100.0 * share);
            assert!(share >= 0.99, "{form:?}, sky {sky}, output {i}: {share}");
        }
        for (i, (a, b)) in kernels.1.iter().zip(&tensors.1).enumerate() {
            // Those that move rays or material, if rays follow it.
            if form == Visibility::cone(0.0) && [0, 2, 5, 7, 8].contains(&i) {
                continue;
            }
            let apart = apart(a, b);
            println!("gradient {i}: {apart:.1e} apart");
            assert!(
                apart < 1e-2,
                "{form:?}, sky {sky}, {i}: {apart:e}: {a:?} {b:?}"
            );
        }
    }
}

#[test]
fn everything_that_moves_has_the_same_mean_gradient() {
    let form = Visibility::cone(0.0);
    for sky in [false, true] {
        let of = |seed| {
            let of_engine = |engine| outcome(engine, sky, form, (seed, true)).1;
            [Engine::Kernels, Engine::Tensors].map(of_engine)
        };
        let all: Vec<_> = (0..if long() { 512 } else { 32 }).map(of).collect();
        for (name, i) in [("place", 0), ("tilt", 2), ("velocity", 5), ("eye", 7)] {
            // Of three derivatives, their sum with different weights.
            let sum = |v: &Vec<Vec<f64>>| -> f64 {
                let weights = [1.0, 0.7, 0.4].into_iter().cycle();
                v[i].iter().zip(weights).map(|(x, w)| x * w).sum()
            };
            let pairs: Vec<[f64; 2]> = all.iter().map(|both| both.each_ref().map(sum)).collect();
            assert_equal_means(name, &pairs, 0.5);
        }
    }
}

#[test]
fn the_softmax_is_not_for_kernels() {
    let device = Device::flex();
    let (scene, camera, _) = everything(&device, false);
    let options = RenderOptions::new(4, 4)
        .with_visibility(Visibility::softmax(1e-3, 1e-3))
        .with_engine(Engine::Kernels);
    says(message(render(&scene, &camera, &options)), ["engine"]);
}
