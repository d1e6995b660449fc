//! Gradients of every class of parameter against central differences, in both forms of visibility.

mod random_scenes;

use crate::common;
use crate::common::errors::{message, says};
use crate::common::facets::facet_cases;
use crate::common::gradients::{
    CONES, Case, Effort, SHARP, SOFTMAX, Setup, all_classes, assert_agreement, cases, check, lights,
};
use crate::common::numbers::mean_and_error;
use crate::common::scenes::{facing_down, floor};
use crate::common::tensors::{gradient, tensor, values};
use burn::tensor::{DType, Device};
use random_scenes::{RandomScene, compare};
use softray::gradcheck::{Checked, GradCheck, Point, Verdict, gradcheck};
use softray::prelude::*;

/// Standard errors are at most 8 % of the reference, in the long tier those of the case; both agree within 3.5 of them and
/// 3 %. What stays undecided is a failure. Cases that are too noisy for the short tier are left out there.
fn agree_with_central_differences(effort: Effort, cases: Vec<Case>) {
    let device = Device::flex();
    let mut failures = Vec::new();
    for case in cases {
        let (precision, seeds) = match common::long() {
            true => (case.precision, [100, 25_000]),
            false if case.precision > 0.08 => continue,
            false => (0.08, [32, 2000]),
        };
        let row = check(&case, &device, effort, precision, seeds);
        if row.verdict != Verdict::Agrees {
            failures.push((case.name, row.verdict));
        }
    }
    assert!(failures.is_empty(), "{failures:?}");
}

#[test]
fn softmax_agrees_with_central_differences() {
    agree_with_central_differences(SOFTMAX, cases());
}

#[test]
fn cones_agree_with_central_differences() {
    agree_with_central_differences(CONES, cases());
    agree_with_central_differences(CONES, lights::crossings());
}

#[test]
fn cones_without_an_angle_agree_with_central_differences() {
    let visibility = SHARP;
    let effort = Effort {
        visibility,
        ..CONES
    };
    agree_with_central_differences(effort, cases());
    agree_with_central_differences(effort, lights::crossings());
}

/// Shadows of lights without a surface have derivatives where a blur makes them soft.
#[test]
fn lights_agree_with_central_differences() {
    agree_with_central_differences(CONES, lights::still());
    agree_with_central_differences(CONES, lights::moving());
    agree_with_central_differences(SOFTMAX, lights::still());
    let visibility = SHARP;
    let effort = Effort {
        visibility,
        ..CONES
    };
    agree_with_central_differences(effort, lights::still());
}

#[test]
fn emissive_textures_agree_with_central_differences() {
    agree_with_central_differences(CONES, lights::glowing());
}

#[test]
fn facets_agree_with_central_differences() {
    agree_with_central_differences(CONES, facet_cases());
}

/// Random scenes by `make`, of seeds from `SOFTRAY_SEED` on. In the long tier these are `count` or `SOFTRAY_SCENES`, and
/// four of five derivatives are known within 5 %. `tests/faults/run` counts how often this finds a wrong factor of a
/// single term: in all of ten runs where the term is most of some derivative, seldom where it is a small part of many.
fn random_scenes_agree(make: fn(u64) -> RandomScene, count: u64, precision: f64, renders: u64) {
    let number = |name: &str, otherwise| {
        let given = std::env::var(name).ok();
        given.and_then(|v| v.parse().ok()).unwrap_or(otherwise)
    };
    let first: u64 = number("SOFTRAY_SEED", 0);
    let (count, precision, renders) = match common::long() {
        true => (number("SOFTRAY_SCENES", count), precision, renders),
        false => (3, 0.03, 48),
    };
    let scenes: Vec<_> = (first..first + count).map(make).collect();
    let outcome = compare(&scenes, precision, renders);
    let undecided = &outcome.undecided;
    let of = outcome.derivatives;
    println!("{} of {of} undecided: {undecided:#?}", undecided.len());
    assert!(outcome.disagree.is_empty(), "{:#?}", outcome.disagree);
    assert!(of > 0);
    if common::long() && of >= 20 {
        assert!(
            5 * outcome.known >= 4 * of,
            "{} of {of} within 5 %",
            outcome.known
        );
    }
}

/// None of the scenes that the long tier may draw is an error.
#[test]
fn random_scenes_have_images() {
    for seed in 0..300 {
        let drawn = RandomScene::new(seed);
        let options = drawn.options.clone().with_samples(1);
        let image = render(&drawn.scene, &drawn.camera, &options);
        let image = image.unwrap_or_else(|e| panic!("scene {seed}, {}: {e}", drawn.description));
        let values = values(&image.radiance);
        assert!(values.iter().all(|v| v.is_finite()), "scene {seed}");
    }
}

#[test]
fn random_scenes_agree_with_central_differences() {
    random_scenes_agree(RandomScene::new, 100, 0.01, 400);
}

#[test]
fn bodies_that_pass_through_each_other_agree_with_central_differences() {
    random_scenes_agree(RandomScene::of_crossing_bodies, 20, 0.007, 8000);
}

/// The same seed gives the same gradient on the other CPU backend.
#[cfg(feature = "ndarray")]
#[test]
fn the_same_on_ndarray() {
    for effort in [SOFTMAX, CONES] {
        let devices = common::cpu_devices();
        let setups: [Setup; 2] = [(&devices[1], |o| o), (&devices[0], |o| o)];
        assert_agreement(&all_classes(), setups, DType::F64, effort, |_| 1e-6);
    }
}

/// The same seed gives the same gradient by all triangles in tensors, but for what the cutoff drops.
#[test]
fn the_same_by_all_triangles() {
    let flex = Device::flex();
    let setups: [Setup; 2] = [
        (&flex, |o| {
            with_softmax(o, |softmax| softmax.with_cutoff(1e-9))
        }),
        (&flex, |o| with_softmax(o, SoftmaxOptions::with_brute_force)),
    ];
    // Ten times the cutoff; 2e-10 are left.
    assert_agreement(&all_classes(), setups, DType::F64, SOFTMAX, |_| 1e-8);
}

fn with_softmax(
    options: RenderOptions,
    change: fn(SoftmaxOptions) -> SoftmaxOptions,
) -> RenderOptions {
    let Visibility::Softmax(softmax) = options.visibility else {
        panic!("{options:?}");
    };
    options.with_visibility(change(softmax))
}

/// A floor under a sky and a lamp; the albedo of the floor, times a factor whose gradient is cut to a
/// share of the right one.
fn sunlit(point: &Point, share: f64) -> softray::Result<(Scene, Camera)> {
    let device = &point.device;
    let quad = floor(2.0, 0.0, device);
    let p = point.get("albedo")?;
    let albedo = p.clone() * share + p.detach() * (1.0 - share);
    let scene = Scene::new()
        .with_object(
            Object::new(quad.cast(point.dtype))
                .with_material(Material::diffuse(albedo.expand([3]))),
        )
        .with_environment([1.0; 3]);
    Ok((scene, Camera::look_at([0.0, 2.0, 4.0], [0.0; 3])))
}

#[test]
fn gradcheck_tells_right_from_wrong_and_from_unknown() {
    let options = RenderOptions::new(8, 8).with_samples(4).with_bounces(0);
    let settings = GradCheck::new(options, &Device::flex());
    let parameters = [Checked::new("albedo", [0.5], 0.05)];
    let verdict = |settings: &GradCheck, share| {
        let report = gradcheck(&parameters, settings, |p| sunlit(p, share)).expect("a report");
        println!("{report}");
        report.rows[0].verdict
    };
    assert_eq!(verdict(&settings, 1.0), Verdict::Agrees);
    for wrong in [0.0, 0.5, 0.9, 1.1, -1.0] {
        assert_eq!(verdict(&settings, wrong), Verdict::Disagrees, "{wrong}");
    }
    // Both ways share no noise where the edge of the floor moves: two seeds don't tell them apart.
    let hasty = settings.clone().with_precision(1e-6).with_seeds(2, 2);
    let parameters = [Checked::new("shift", [0.1], 0.05)];
    let report = gradcheck(&parameters, &hasty, |point| {
        let quad = floor(2.0, 0.0, &point.device).cast(point.dtype);
        let by = point.get("shift")? * tensor(&[1.0, 0.0, 0.0], [3], &point.device, point.dtype);
        let scene = Scene::new().with_object(Object::new(quad.translated(by)));
        let camera = Camera::look_at([0.0, 2.0, 4.0], [0.0; 3]);
        Ok((scene.with_environment([1.0; 3]), camera))
    });
    let verdict = report.expect("a report").rows[0].verdict;
    assert_eq!(verdict, Verdict::Undecided);

    let bad = [Checked::new("albedo", [0.5], 0.0)];
    let error = gradcheck(&bad, &settings, |p| sunlit(p, 1.0));
    says(message(error), ["albedo: step is 0"]);
    let other = [Checked::new("a", [0.5], 0.1)];
    let error = gradcheck(&other, &settings, |p| sunlit(p, 1.0));
    says(message(error), ["albedo", "[\"a\"]"]);
}

/// A noisy image times itself is too large by its variance, and so is its gradient: at the minimum
/// of the loss of the converged image the plain form pulls, the two-sample form does not.
#[test]
fn the_square_of_noise_biases_a_loss() {
    let device = Device::flex();
    let lamp = |radiance: Tensor<1>| {
        let light = facing_down([-0.5, 0.5], [-0.5, 0.5], 1.5, &device);
        let ground = floor(2.0, 0.0, &device);
        Scene::new()
            .with_object(Object::new(light).with_material(Material::emitter(radiance.expand([3]))))
            .with_object(Object::new(ground))
    };
    let camera = Camera::look_at([0.0, 1.0, 3.0], [0.0; 3]).with_fov_y(40.0);
    let image = |radiance: Tensor<1>, samples, seed| {
        let options = RenderOptions::new(8, 8)
            .with_samples(samples)
            .with_bounces(1)
            .with_seed(seed);
        let image = render(&lamp(radiance), &camera, &options);
        image.expect("an image").radiance
    };
    let right = Tensor::<1>::from_floats([4.0], &device);
    let target = image(right.clone(), 8192, u64::MAX);
    let leaf = || right.clone().autodiff().require_grad();
    let (mut plain, mut unbiased) = (Vec::new(), Vec::new());
    for seed in 0..200 {
        let p = leaf();
        let loss = softray::loss::mse(image(p.clone(), 2, 2 * seed), target.clone());
        let gradients = loss.expect("a loss").backward();
        plain.push(gradient(&p, &gradients)[0]);
        let p = leaf();
        let [a, b] = [0, 1].map(|i| image(p.clone(), 2, 2 * seed + i));
        let loss = softray::loss::mse_unbiased(a, b, target.clone());
        let gradients = loss.expect("a loss").backward();
        unbiased.push(gradient(&p, &gradients)[0]);
    }
    let (plain, error) = mean_and_error(&plain);
    assert!(plain > 10.0 * error, "{plain} ± {error}");
    let (unbiased, error) = mean_and_error(&unbiased);
    println!("plain {plain}, two samples {unbiased} ± {error}");
    assert!(unbiased.abs() < 3.5 * error, "{unbiased} ± {error}");
    assert!(unbiased.abs() < 0.1 * plain, "{unbiased}, plain {plain}");
}
