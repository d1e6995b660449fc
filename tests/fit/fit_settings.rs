//! Settings of fits: mistakes, more steps, rates of groups.

use super::run::{Point, adam, bowl, folder, place, point};
use crate::common::errors::{message, says};
use burn::module::{Module, Param, ParamGroup};
use burn::optim::{AdamConfig, SgdConfig};
use burn::tensor::Device;
use softray::optim::{
    BlurSchedule, Evaluation, Fit, LargeSteps, LargeStepsConfig, Rate, Step, Warning,
};
use softray::prelude::*;

#[test]
fn mistakes_are_named() {
    let fit = || Fit::new(point(&[0.5]), adam(), 10).with_progress(false);
    let nan = |p: &Point, step: &Step| {
        let factor = if step.index == 3 { f64::NAN } else { 1.0 };
        Ok(Evaluation::new(p.at.val().sum() * factor))
    };
    assert!(message(fit().run(nan)).contains("the loss of step 3 is NaN"));
    let root = |p: &Point, _: &Step| Ok(Evaluation::new((p.at.val() * 0.0).sqrt().sum()));
    assert!(message(fit().run(root)).contains("the gradient of step 0"));
    let apart = |_: &Point, _: &Step| {
        let loss = Tensor::from_floats([1.0], &Device::flex())
            .autodiff()
            .require_grad();
        Ok(Evaluation::new(loss))
    };
    assert!(message(fit().run(apart)).contains("gradient is absent"));
    assert!(message(fit().with_rate(-1.0).run(bowl)).contains("rate is -1"));
    assert!(message(fit().with_seed(1 << 24).run(bowl)).contains("seed"));
    assert!(message(fit().with_clip(0.0).run(bowl)).contains("clip is 0"));
    let other = |p: &Point, step: &Step| {
        let evaluation = Evaluation::new(p.at.val().sum());
        let name = if step.index == 2 { "b" } else { "a" };
        Ok(evaluation.with_value(name, 0.0))
    };
    assert!(message(fit().run(other)).contains("values of step 2"));
    // A checkpoint of a fit with other settings, which are named.
    let folder = folder("mistakes");
    fit().with_folder(&folder).run(bowl).expect("a fit");
    let sgd = SgdConfig::new().init();
    let slower = AdamConfig::new().with_beta_1(0.8).init();
    let of = |optimizer| Fit::new(point(&[0.5]), optimizer, 10).with_progress(false);
    let own = ParamGroup::from_path("at");
    for (name, other) in [
        ("seed", fit().with_seed(5)),
        ("rate", fit().with_rate(Rate::cosine(0.01))),
        (
            "blur",
            fit().with_blur(BlurSchedule::decay(0.1, 0.01, 5).expect("one")),
        ),
        ("groups' rates", fit().with_rate_of(own, 0.1)),
        ("optimizer of at (test steps)", of(sgd)),
        ("optimizer of at (test steps)", of(slower)),
    ] {
        let found = message(other.with_folder(&folder).run(bowl));
        let named = found.matches(" now").count() == 1 && found.contains(&format!("({name}: "));
        assert!(named, "{name}: {found}");
    }
    let fitted = fit()
        .with_seed(5)
        .with_folder(&folder)
        .with_restart(true)
        .run(bowl);
    assert_eq!(fitted.expect("a fit").resumed, None);
}

#[test]
fn finished_fits_continue_with_more_steps() {
    let folder = folder("more");
    let fit = |steps| Fit::new(point(&[0.5, -1.0]), adam(), steps).with_progress(false);
    fit(10).with_folder(&folder).run(bowl).expect("a fit");
    let more = fit(25).with_folder(&folder).run(bowl).expect("a fit");
    assert_eq!((more.resumed, more.history.rows.len()), (Some(10), 25));
    let less = fit(20).with_folder(&folder).run(bowl);
    assert!(message(less).contains("steps is 20, expected at least 25"));
    let whole = fit(25).run(bowl).expect("a fit");
    assert_eq!(place(&more.module), place(&whole.module));
}

/// A group's rate moves its own parameters alone.
#[test]
fn groups_have_rates_of_their_own() {
    let at = || point(&[0.5, -1.0]);
    let fit = || Fit::new(at(), SgdConfig::new().init(), 3).with_progress(false);
    let moved = |fit: Fit<Point>| place(&fit.run(bowl).expect("a fit").module);
    let other = fit().with_rate_of(ParamGroup::from_path("nowhere"), 0.7);
    let other = other.run(bowl).expect("a fit");
    assert_eq!(moved(fit()), place(&other.module));
    let [warning] = &other.warnings[..] else {
        panic!("{:?}", other.warnings);
    };
    assert!(matches!(warning, Warning::EmptyGroup { .. }));
    says(warning.to_string(), ["nowhere", "no effect", ": at"]);
    let own = || ParamGroup::from_path("at");
    assert_eq!(
        moved(fit().with_rate(0.3)),
        moved(fit().with_rate_of(own(), 0.3))
    );
    let twice = fit()
        .with_rate_of(ParamGroup::all(), 0.7)
        .with_rate_of(own(), 0.3);
    assert_eq!(moved(fit().with_rate(0.3)), moved(twice));
    assert!(message(fit().with_rate_of(own(), -1.0).run(bowl)).contains("rate is -1"));
}

#[derive(Module, Debug)]
struct Ball {
    vertices: Param<Tensor<2>>,
    color: Param<Tensor<1>>,
}

/// A fit goes on with the same optimizers of groups, from any values, and with no others.
#[test]
fn optimizers_of_groups_are_compared() {
    let folder = folder("groups");
    let mesh = shapes::icosphere(1, &Device::flex().autodiff());
    let fit = |lambda: f64, beta: f32, start: f32, steps: usize| {
        let config = LargeStepsConfig::default().with_lambda(lambda);
        let large = LargeSteps::from_mesh(&mesh, &config).expect("an optimizer");
        let colors = AdamConfig::new().with_beta_1(beta).init();
        let group = ParamGroup::from_path("vertices");
        let color = Tensor::from_floats([start, 0.5, 0.5], &Device::flex().autodiff());
        let ball = Ball {
            vertices: Param::from_tensor(mesh.vertices.clone()),
            color: Param::from_tensor(color),
        };
        Fit::new(ball, colors.with_group(group, large, None), steps)
            .with_progress(false)
            .with_folder(&folder)
            .run(|ball: &Ball, _: &_| {
                let far = (ball.vertices.val() - 1.0).powf_scalar(2.0).mean();
                Ok(Evaluation::new(
                    far + ball.color.val().powf_scalar(2.0).sum(),
                ))
            })
    };
    fit(19.0, 0.9, 0.5, 4).expect("a fit");
    let more = fit(19.0, 0.9, 0.1, 6).expect("a fit");
    assert_eq!(more.resumed, Some(4));
    for (name, other, same) in [
        ("vertices", fit(25.0, 0.9, 0.5, 8), "color"),
        ("color", fit(19.0, 0.8, 0.5, 8), "vertices"),
    ] {
        let found = message(other);
        says(&found, [&*format!("(optimizer of {name} (test steps): ")]);
        assert!(!found.contains(&format!("optimizer of {same}")), "{found}");
    }
}
