//! What is seen of a fit: errors before it begins, progress, warnings and pictures.

use std::path::PathBuf;
use std::process::Stdio;

use crate::common;
use crate::common::errors::{message, says};
use crate::common::process::again;
use burn::module::{Module, Param};
use burn::optim::{AdamConfig, SgdConfig};
use softray::optim::{Evaluation, Fit, Fitted, Step, Warning};
use softray::prelude::*;

#[derive(Module, Debug)]
struct Point {
    at: Param<Tensor<1>>,
}

fn point(device: &Device) -> Point {
    Point {
        at: Param::from_tensor(Tensor::from_floats([0.5, -0.3], device)),
    }
}

fn tracked() -> Device {
    Device::flex().autodiff()
}

fn fit(module: Point, steps: usize) -> Fit<Point> {
    Fit::new(module, AdamConfig::new().init(), steps).with_progress(false)
}

fn bowl(point: &Point, _: &Step) -> softray::Result<Evaluation> {
    let x = point.at.val();
    Ok(Evaluation::new((x.clone() * x).sum()))
}

fn folder(name: &str) -> PathBuf {
    common::target_folder(&format!("fit-output-{name}"))
}

#[test]
fn modules_that_record_no_gradients_are_errors_before_the_first_step() {
    let never = |_: &Point, _: &Step| -> softray::Result<Evaluation> { panic!("a step") };
    for device in common::cpu_devices() {
        let found = message(fit(point(&device), 5).run(never));
        says(&found, ["parameter at"]);
        says(&found, ["device.autodiff()"]);
    }
    let found = message(fit(point(&tracked()).no_grad(), 5).run(never));
    says(&found, ["frozen, at"]);
    #[derive(Module, Debug)]
    struct Empty {}
    let fitted = Fit::new(Empty {}, AdamConfig::new().init(), 5)
        .run(|_: &Empty, _: &Step| -> softray::Result<Evaluation> { panic!("a step") });
    let found = message(fitted);
    says(&found, ["without parameters"]);
    // Nothing is left behind.
    let folder = folder("plain");
    let inside = folder.join("fit");
    message(
        fit(point(&Device::flex()), 5)
            .with_folder(&inside)
            .run(never),
    );
    assert!(!inside.exists());
}

#[test]
#[allow(deprecated)] // burn deprecates ndarray; users ask for it
fn losses_out_of_the_graph_are_errors() {
    let run = |loss: fn(&Point) -> Tensor<1>| {
        let step = move |p: &Point, _: &Step| Ok(Evaluation::new(loss(p)));
        message(fit(point(&tracked()), 5).run(step))
    };
    // On the plain device, and on one with autodiff but from no parameter.
    for loss in [
        |p: &Point| p.at.val().inner().sum(),
        |p: &Point| p.at.val().inner().autodiff().sum(),
        |_: &Point| Tensor::from_floats([1.0], &tracked()),
    ] {
        let found = run(loss);
        says(&found, ["loss of step 0"]);
        says(&found, ["val()"]);
    }
    #[cfg(feature = "ndarray")]
    {
        #[allow(deprecated)] // burn deprecates ndarray
        let other = run(|_| {
            let ndarray = Device::ndarray().autodiff();
            Tensor::<1>::ones([1], &ndarray).require_grad()
        });
        assert!(other.contains("device of the loss"), "{other}");
        says(&other, ["ndarray", "flex"]);
    }
    let found = run(|_| Tensor::<1>::ones([1], &tracked()).require_grad());
    says(&found, ["gradient is absent"]);
    let found = run(|p| p.at.val().detach().sum());
    says(&found, ["detach()"]);
    let found = run(|p| p.at.val());
    says(&found, ["of 2 numbers"]);
}

/// Two parameters, of which a loss may depend on one.
#[derive(Module, Debug)]
struct Pair {
    a: Point,
    b: Point,
}

fn flat(steps: usize, shown: bool) -> Fitted<Pair> {
    let module = Pair {
        a: point(&tracked()),
        b: point(&tracked()),
    };
    // So slow that the loss is flat.
    Fit::new(module, SgdConfig::new().init(), steps)
        .with_rate(1e-9)
        .with_progress(shown)
        .run(|pair: &Pair, step: &_| bowl(&pair.a, step))
        .expect("a fit")
}

/// A schedule for the blur that no render uses; a loss that reads it is right.
#[test]
fn a_blur_that_is_not_used_is_a_warning() {
    let run = |f: fn(&Point, &Step) -> softray::Result<Evaluation>| {
        let fit = fit(point(&tracked()), 3).with_blur(BlurSchedule::constant(1.0).expect("a blur"));
        fit.run(f).expect("a fit").warnings
    };
    assert_eq!(run(bowl), [Warning::UnusedBlur]);
    let by_options = |point: &Point, step: &Step| {
        let options = step.options(&RenderOptions::new(4, 4), 0);
        assert_eq!(options.blur, Some(1.0));
        bowl(point, step)
    };
    assert_eq!(run(by_options), []);
    let by_number = |point: &Point, step: &Step| {
        assert_eq!(step.blur(), Some(1.0));
        bowl(point, step)
    };
    assert_eq!(run(by_number), []);
}

#[test]
fn warnings_are_returned() {
    let found = flat(90, false);
    let plateau = |step| Warning::Plateau { step, window: 20 };
    let unused = Warning::Unused(vec!["b.at".into()]);
    let expected = [unused, plateau(39), plateau(59), plateau(79)];
    assert_eq!(found.warnings, expected);
    assert_eq!(found.plateaus, [39, 59, 79]);
    assert!(
        found.warnings[0]
            .to_string()
            .contains("no gradient reaches b.at")
    );
    assert_eq!(
        fit(point(&tracked()), 3).run(bowl).expect("a fit").warnings,
        []
    );
}

/// What the process that is watched shows.
const WATCHED: &str = "SOFTRAY_FIT_SHOWN";

/// A process whose standard error is no terminal and which has no logger.
#[test]
fn without_a_terminal_there_are_lines() {
    if let Some(shown) = std::env::var_os(WATCHED) {
        flat(50, shown == "yes");
        return;
    }
    let watch = |shown: &str| {
        let output = again(without_a_terminal_there_are_lines)
            .env(WATCHED, shown)
            .stdout(Stdio::null())
            .output()
            .expect("a process");
        assert!(output.status.success());
        String::from_utf8(output.stderr).expect("text")
    };
    let text = watch("yes");
    let lines: Vec<&str> = text.lines().filter(|l| l.contains("fit: ")).collect();
    assert_eq!(lines.len(), 4, "{text}");
    assert!(
        lines[0].contains("warning: fit: no gradient reaches b.at"),
        "{text}"
    );
    assert!(
        lines[1].starts_with("fit: step 1/50, loss 3.400e-1, 0.0 s, about "),
        "{text}"
    );
    assert!(lines[2].contains("warning: fit: at step 39"), "{text}");
    assert!(
        lines[3].starts_with("fit: step 50/50, loss 3.400e-1, "),
        "{text}"
    );
    // Warnings are there without progress, too.
    let text = watch("no");
    let lines: Vec<&str> = text.lines().collect();
    assert!(
        lines.len() == 2 && lines.iter().all(|l| l.contains("warning: fit: ")),
        "{text}"
    );
}

/// An image that a parameter makes, and a target.
fn seen(point: &Point, size: usize) -> (Tensor<3>, Tensor<3>) {
    let image = point
        .at
        .val()
        .slice([0..1])
        .reshape([1, 1, 1])
        .repeat(&[8, 8, 3]);
    (image, Tensor::ones([size, size, 3], &Device::flex()) * 0.2)
}

#[test]
fn pictures_stand_beside_their_targets() {
    let folder = folder("pictures");
    let inside = folder.join("a").join("b");
    let pictured = std::rc::Rc::new(std::cell::RefCell::new(Vec::new()));
    let steps = pictured.clone();
    let step = move |p: &Point, step: &Step| {
        if step.pictured {
            steps.borrow_mut().push(step.index);
        }
        let (image, target) = seen(p, 8);
        let loss = (image.clone() - target.clone()).powi_scalar(2).mean();
        let evaluation = Evaluation::new(loss).with_image("render", image.clone());
        Ok(evaluation
            .with_target("render", target)
            .with_image("alone", image))
    };
    let fit = fit(point(&tracked()), 26)
        .with_rate(0.01)
        .with_pictures(&inside, 10);
    let fit = fit.on_step(25, |report| {
        let figure = report.figure()?.image()?;
        assert!(
            figure.width > 3 * 256 && figure.height > 2 * 256,
            "{figure:?}"
        );
        assert_eq!(report.steps, 26);
        Ok(true)
    });
    fit.run(step).expect("a fit");
    assert_eq!(*pictured.borrow(), [0, 10, 20, 25]);
    let read = |step: usize| {
        HostImage::read(inside.join(format!("step-{step:06}.png"))).expect("a picture")
    };
    let images = [0, 10, 20, 25].map(read);
    assert_eq!(std::fs::read_dir(&inside).expect("a folder").count(), 4);
    let size = |i: &HostImage| (i.width, i.height);
    assert!(
        images.iter().all(|i| size(i) == size(&images[0])),
        "for animations"
    );
    // The difference is above 0, red, at first by the whole scale, and then pales.
    let difference = |i: &HostImage| {
        let at = 3 * (150 * i.width + 2 * (256 + 20) + 140);
        [i.pixels[at], i.pixels[at + 2]]
    };
    let blues = images.each_ref().map(|i| difference(i)[1]);
    assert!(
        images.iter().all(|i| difference(i)[0] > difference(i)[1]),
        "{blues:?}"
    );
    assert!(blues.is_sorted() && blues[3] > 3.0 * blues[0], "{blues:?}");
}

#[test]
fn mistakes_with_pictures_are_named() {
    let folder = folder("mistakes");
    let pictures = || fit(point(&tracked()), 3).with_pictures(&folder, 1);
    let with = |add: fn(Evaluation, &Point) -> Evaluation| {
        move |p: &Point, step: &Step| Ok(add(bowl(p, step)?, p))
    };
    let found = message(pictures().run(bowl));
    says(&found, ["Evaluation::with_image"]);
    let found = message(pictures().run(with(|e, p| {
        let (image, target) = seen(p, 4);
        e.with_image("a", image).with_target("a", target)
    })));
    says(&found, ["[4, 4, 3]", "[8, 8, 3]"]);
    let found = message(pictures().run(with(|e, p| {
        let (image, target) = seen(p, 8);
        e.with_image("a", image).with_target("b", target)
    })));
    says(&found, ["\"b\"", "[\"a\"]"]);
    let found = message(pictures().run(with(|e, p| {
        let (image, _) = seen(p, 8);
        e.with_image("a", image.clone()).with_image("a", image)
    })));
    says(&found, ["named twice"]);
    assert_eq!(std::fs::read_dir(&folder).expect("a folder").count(), 0);
    // A folder that can't be made is an error before the first step.
    let file = folder.join("file");
    std::fs::write(&file, "").expect("a file");
    let fit = || fit(point(&tracked()), 3);
    let never = |_: &Point, _: &Step| -> softray::Result<Evaluation> { panic!("a step") };
    let found = message(fit().with_pictures(file.join("pictures"), 1).run(never));
    says(&found, ["pictures"]);
    let found = message(fit().with_pictures(&folder, 0).run(never));
    says(&found, ["pictures is 0"]);
}

#[test]
fn histories_name_the_curves_they_lack() {
    let step = |p: &Point, step: &Step| Ok(bowl(p, step)?.with_value("x", 1.0));
    let fitted = fit(point(&tracked()), 3).run(step).expect("a fit");
    for names in [&["x", "loss"][..], &["blur"], &["gradient_norm"]] {
        fitted.history.plot("", names).expect("a plot");
    }
    let error = message(fitted.history.plot("", &["x", "y"]));
    says(&error, ["\"y\"", "[\"x\"]"]);
}
