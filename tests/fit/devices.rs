//! Fits over several devices.

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use softray::burn;
use softray::optim::{Evaluation, Fit, Part};
use softray::prelude::*;

use crate::common::views::squares;

#[derive(Module, Debug)]
struct Color {
    albedo: Param<Tensor<1>>,
}

fn color() -> Color {
    Color {
        albedo: Param::from_tensor(Tensor::full([3], 0.5, &Device::flex().autodiff())),
    }
}

/// The albedos and losses of a fit to six views.
fn fitted(devices: &[Device]) -> (Vec<f32>, Vec<f64>) {
    let views: Vec<f64> = (0..6).map(|i| 60.0 * f64::from(i)).collect();
    let fit = Fit::new(color(), AdamConfig::new().init(), 5).with_progress(false);
    let fitted = fit.run_over(devices, |color: &Color, _, part: &Part| {
        let ball = Object::new(shapes::icosphere(1, &part.device));
        let ball = ball.with_material(Material::diffuse(color.albedo.val()));
        let scene = Scene::new().with_object(ball).with_environment([1.0; 3]);
        let options = RenderOptions::new(8, 8).with_samples(2);
        let loss = squares(&scene, part.of(&views), &options)?;
        let loss = loss * (views.len() as f64).recip();
        let own = format!("views of {}", part.index);
        let count = part.of(&views).len() as f64;
        let evaluation = Evaluation::new(loss).with_value("views", count);
        Ok(evaluation.with_value(own, count))
    });
    let fitted = fitted.expect("a fit");
    let last = fitted.history.rows.last().expect("a row");
    // The sum over the parts, and a value of each.
    assert_eq!(last.values.len(), 1 + devices.len());
    assert_eq!(last.values[0], views.len() as f64);
    assert_eq!(last.values[1..].iter().sum::<f64>(), views.len() as f64);
    let losses = fitted.history.rows.iter().map(|row| row.loss).collect();
    let albedo = fitted.module.albedo.val().inner().into_data();
    (albedo.iter().collect(), losses)
}

#[test]
fn several_devices_fit_as_one() {
    let (one, losses) = fitted(&[Device::flex()]);
    assert!(losses[4] < losses[0]);
    for count in [2, 4] {
        let devices = vec![Device::flex(); count];
        let (several, sums) = fitted(&devices);
        assert_eq!((several.clone(), sums.clone()), fitted(&devices));
        for (a, b) in one.iter().zip(&several) {
            assert!((a - b).abs() < 1e-5, "{one:?} {several:?}");
        }
        for (a, b) in losses.iter().zip(&sums) {
            assert!((a - b).abs() < 1e-5 * a, "{losses:?} {sums:?}");
        }
    }
}

#[test]
fn errors_of_parts_are_those_of_the_fit() {
    let fit = || Fit::new(color(), AdamConfig::new().init(), 1).with_progress(false);
    let none = fit().run_over(&[], |_, _, _| unreachable!("no part"));
    let said = none.expect_err("no device").to_string();
    assert!(said.contains("devices"), "{said}");
    let failing = fit().run_over(
        &[Device::flex(), Device::flex()],
        |color: &Color, _, part| {
            let value = if part.index == 1 { f64::NAN } else { 1.0 };
            Ok(Evaluation::new(color.albedo.val().sum() * value))
        },
    );
    let said = failing.expect_err("NaN").to_string();
    assert!(said.contains("loss"), "{said}");
}
