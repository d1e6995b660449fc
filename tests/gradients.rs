//! Gradients of every class of parameter against central differences, in both forms of visibility.

mod common;

use burn::tensor::{DType, Device};
use common::gradients::{Effort, LAYERED, SOFTMAX, agreement, cases, check};
use softray::gradcheck::{Checked, GradCheck, Verdict, gradcheck};
use softray::prelude::*;

/// The short tier asks for agreement within 3.5 standard errors, and for errors small enough that
/// a wrong factor of two shows in every class. The long tier asks for standard errors of 1 % of
/// the reference, and agreement within 3.5 of them and 3 %.
fn agree_with_central_differences(effort: Effort) {
    let device = Device::flex();
    let long = common::long();
    let (precision, seeds) = if long {
        (0.01, [100, 12_000])
    } else {
        (0.08, [32, 240])
    };
    let mut failures = Vec::new();
    for case in cases() {
        let row = check(&case, &device, effort, precision, seeds);
        let value = row.difference.mean.abs();
        let error = row.gradient.error.hypot(row.difference.error);
        let close = match row.verdict {
            Verdict::Agrees => true,
            Verdict::Disagrees => !long && row.standard_errors() <= 3.5,
            Verdict::Undecided => !long && error <= 0.15 * value,
        };
        if !close {
            failures.push(case.name);
        }
    }
    assert!(failures.is_empty(), "{failures:?}");
}

#[test]
fn softmax_agrees_with_central_differences() {
    agree_with_central_differences(SOFTMAX);
}

#[test]
fn layered_agrees_with_central_differences() {
    agree_with_central_differences(LAYERED);
}

/// The same seed gives the same gradient on the other CPU backend.
#[test]
fn the_same_on_ndarray() {
    for effort in [SOFTMAX, LAYERED] {
        let devices = (&common::cpu_devices()[1], &Device::flex());
        for (case, apart) in agreement(devices, DType::F64, effort) {
            assert!(apart < 1e-6, "{case}: {apart:e}");
        }
    }
}

/// A floor under a sky and a lamp; the albedo of the floor, times a factor whose gradient is cut to a
/// share of the right one.
fn floor(point: &softray::gradcheck::Point, share: f64) -> softray::Result<(Scene, Camera)> {
    let device = &point.device;
    let quad = shapes::quad(
        [-2.0, 0.0, 2.0],
        [2.0, 0.0, 2.0],
        [2.0, 0.0, -2.0],
        [-2.0, 0.0, -2.0],
        device,
    );
    let p = point.get("albedo")?;
    let albedo = p.clone() * share + p.detach() * (1.0 - share);
    let scene = Scene::new()
        .with(Object::new(quad.cast(point.dtype)).material(Material::diffuse(albedo.expand([3]))))
        .environment([1.0; 3]);
    Ok((scene, Camera::look_at([0.0, 2.0, 4.0], [0.0; 3])))
}

#[test]
fn gradcheck_tells_right_from_wrong_and_from_unknown() {
    let options = RenderOptions::new(8, 8).samples(4).bounces(0).sigma(1e-3);
    let settings = GradCheck::new(options, &Device::flex());
    let parameters = [Checked::new("albedo", [0.5], 0.05)];
    let verdict = |settings: &GradCheck, share| {
        let report = gradcheck(&parameters, settings, |p| floor(p, share)).expect("a report");
        println!("{report}");
        report.rows[0].verdict
    };
    assert_eq!(verdict(&settings, 1.0), Verdict::Agrees);
    for wrong in [0.0, 0.5, 0.93, 1.07, -1.0] {
        assert_eq!(verdict(&settings, wrong), Verdict::Disagrees, "{wrong}");
    }
    // What the camera sees of the floor's edge is noise: not told in two seeds to 1e-6.
    let hasty = settings.clone().precision(1e-6).seeds(2, 2);
    assert_eq!(verdict(&hasty, 1.0), Verdict::Undecided);

    let bad = [Checked::new("albedo", [0.5], 0.0)];
    let error = gradcheck(&bad, &settings, |p| floor(p, 1.0)).expect_err("an error");
    assert!(error.to_string().contains("albedo: step is 0"), "{error}");
    let error = gradcheck(&[Checked::new("a", [0.5], 0.1)], &settings, |p| {
        floor(p, 1.0)
    });
    let error = error.expect_err("an error").to_string();
    assert!(
        error.contains("albedo") && error.contains("[\"a\"]"),
        "{error}"
    );
}

/// A noisy image times itself is too large by its variance, and so is its gradient: at the minimum
/// of the loss of the converged image the plain form pulls, the two-sample form does not.
#[test]
fn the_square_of_noise_biases_a_loss() {
    let device = Device::flex();
    let lamp = |radiance: Tensor<1>| {
        let light = shapes::quad(
            [-0.5, 1.5, -0.5],
            [0.5, 1.5, -0.5],
            [0.5, 1.5, 0.5],
            [-0.5, 1.5, 0.5],
            &device,
        );
        let ground = shapes::quad(
            [-2.0, 0.0, 2.0],
            [2.0, 0.0, 2.0],
            [2.0, 0.0, -2.0],
            [-2.0, 0.0, -2.0],
            &device,
        );
        Scene::new()
            .with(Object::new(light).material(Material::emitter(radiance.expand([3]))))
            .with(Object::new(ground).material(Material::diffuse([0.5; 3])))
    };
    let camera = Camera::look_at([0.0, 1.0, 3.0], [0.0; 3]).fov_y(40.0);
    let image = |radiance: Tensor<1>, samples, seed| {
        let options = RenderOptions::new(8, 8)
            .samples(samples)
            .bounces(1)
            .seed(seed);
        render(&lamp(radiance), &camera, &options)
            .expect("an image")
            .radiance
    };
    let right = Tensor::<1>::from_floats([4.0], &device);
    let target = image(right.clone(), 8192, u64::MAX);
    let leaf = || right.clone().autodiff().require_grad();
    let mean_and_error = |gradients: &[f64]| {
        let n = gradients.len() as f64;
        let mean = gradients.iter().sum::<f64>() / n;
        let squares: f64 = gradients.iter().map(|g| (g - mean).powi(2)).sum();
        (mean, (squares / (n - 1.0) / n).sqrt())
    };
    let (mut plain, mut unbiased) = (Vec::new(), Vec::new());
    for seed in 0..200 {
        let p = leaf();
        let loss = softray::loss::mse(image(p.clone(), 2, 2 * seed), target.clone());
        let gradients = loss.backward();
        plain.push(common::values(&p.grad(&gradients).expect("a gradient"))[0]);
        let p = leaf();
        let [a, b] = [0, 1].map(|i| image(p.clone(), 2, 2 * seed + i));
        let gradients = softray::loss::mse_unbiased(a, b, target.clone()).backward();
        unbiased.push(common::values(&p.grad(&gradients).expect("a gradient"))[0]);
    }
    let (plain, error) = mean_and_error(&plain);
    assert!(plain > 10.0 * error, "{plain} ± {error}");
    let (unbiased, error) = mean_and_error(&unbiased);
    println!("plain {plain}, two samples {unbiased} ± {error}");
    assert!(unbiased.abs() < 3.5 * error, "{unbiased} ± {error}");
    assert!(unbiased.abs() < 0.1 * plain, "{unbiased}, plain {plain}");
}
