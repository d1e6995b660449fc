//! Settings of fits: mistakes, more steps, rates of groups.

use super::run::{Point, adam, bowl, folder, place, point};
use crate::common::errors::message;
use burn::module::ParamGroup;
use burn::optim::{AdamConfig, SgdConfig};
use burn::tensor::Device;
use softray::optim::{BlurSchedule, Evaluation, Fit, Rate, Step};
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
        ("optimizer", of(sgd)),
        ("optimizer", of(slower)),
    ] {
        let found = message(other.with_folder(&folder).run(bowl));
        let named = found.matches(" now").count() == 1 && found.contains(&format!("(\"{name} "));
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
    assert_eq!(moved(fit()), moved(other));
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
