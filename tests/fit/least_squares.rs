//! Fits by Gauss–Newton steps.

use burn::module::{Module, Param};
use softray::optim::{LeastSquares, Residual, Step, Warning};
use softray::prelude::*;

use crate::common::errors::{message, says};
use crate::common::folder::Folder;
use crate::common::tensors::values;

#[derive(Module, Debug)]
struct Ball {
    at: Param<Tensor<1>>,
    /// The logarithm of the radius.
    size: Param<Tensor<1>>,
    /// It has no influence on the image.
    unused: Param<Tensor<1>>,
}

const START: [f64; 3] = [0.4, -0.3, 0.5];

struct Problem {
    device: Device,
    camera: Camera,
    options: RenderOptions,
    target: Tensor<3>,
}

impl Problem {
    fn new() -> Self {
        let device = Device::flex();
        let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]).with_fov_y(40.0);
        let options = RenderOptions::new(24, 24).with_samples(16).with_bounces(0);
        let mut problem = Self {
            target: Tensor::zeros([24, 24, 3], &device),
            device,
            camera,
            options,
        };
        let goal = problem.ball([0.0; 3], 0.0);
        let fine = problem.options.clone().with_samples(512).with_seed(9);
        let image = render(&problem.scene(&goal), &problem.camera, &fine);
        problem.target = image.expect("a target").radiance;
        problem
    }

    fn ball(&self, at: [f64; 3], size: f64) -> Ball {
        let device = self.device.clone().autodiff();
        let leaf = |v: &[f64]| Param::from_tensor(Tensor::from_data(v, &device));
        Ball {
            at: leaf(&at),
            size: leaf(&[size]),
            unused: leaf(&[7.0]),
        }
    }

    fn scene(&self, ball: &Ball) -> Scene {
        let mesh = shapes::icosphere(2, &self.device)
            .scaled(ball.size.val().exp())
            .translated(ball.at.val());
        Scene::new()
            .with_object(Object::new(mesh).with_material(Material::diffuse([0.3, 0.5, 0.7])))
            .with_environment([1.0; 3])
    }

    fn residual(&self, ball: &Ball, step: &Step) -> Residual {
        let options = step.options(&self.options, 0);
        let target = self.target.clone();
        Residual::new(self.scene(ball), self.camera.clone(), options, target)
    }

    fn fit(&self, steps: usize) -> LeastSquares<Ball> {
        let start = self.ball(START, -0.3);
        LeastSquares::new(start, steps).with_progress(false)
    }
}

fn numbers(ball: &Ball) -> Vec<f64> {
    [&ball.at, &ball.size, &ball.unused]
        .map(|p| values(&p.val()))
        .concat()
}

/// Position and size in the image arrive in ten steps, and what has no influence stays and is named.
#[test]
fn a_ball_arrives_in_ten_steps() {
    let problem = Problem::new();
    let fit = problem.fit(10);
    let fitted = fit.run(|ball, step| {
        // Renders record no tape, which no backward pass would free.
        assert!(!ball.at.val().is_tracked());
        Ok(vec![problem.residual(ball, step)])
    });
    let fitted = fitted.expect("a fit");
    let found = numbers(&fitted.module);
    println!("{found:?}, {:?}", fitted.history.rows.last());
    assert!(found[..2].iter().all(|v| v.abs() < 0.02), "{found:?}");
    // A view hardly shows whether a ball is nearer or larger.
    let radius = found[3].exp() / (4.0 - found[2]);
    assert!((radius / 0.25 - 1.0).abs() < 0.01, "{radius}");
    assert_eq!(found[4], 7.0);
    let unused = |w: &Warning| *w == Warning::Unused(vec!["unused".into()]);
    assert!(fitted.warnings.iter().any(unused), "{:?}", fitted.warnings);
    assert_eq!(fitted.history.names, ["damping", "averaged", "noise"]);
    assert!(fitted.module.at.val().is_require_grad());
}

/// A fit that is interrupted ends with the same bits, and frozen parameters stay.
#[test]
fn a_resumed_fit_ends_with_the_same_numbers() {
    let problem = Problem::new();
    let folder = Folder::new("least_squares");
    let run = |steps: usize, folder: Option<&Folder>| {
        let mut ball = problem.ball(START, -0.3);
        ball.size = ball.size.set_require_grad(false);
        let mut fit = LeastSquares::new(ball, steps)
            .with_progress(false)
            .with_checkpoint_every(1);
        if let Some(folder) = folder {
            fit = fit
                .with_folder(folder.path("fit"))
                .with_pictures(folder.path("pictures"), 2);
        }
        fit.run(|ball, step| Ok(vec![problem.residual(ball, step)]))
            .expect("a fit")
    };
    let whole = run(5, None);
    run(2, Some(&folder));
    let resumed = run(5, Some(&folder));
    assert_eq!(resumed.resumed, Some(2));
    assert_eq!(numbers(&whole.module), numbers(&resumed.module));
    assert_eq!(values(&resumed.module.size.val())[0], f64::from(-0.3f32));
    assert!(folder.path("pictures/step-000004.png").is_file());
}

/// Several views share the numbers, each with its name in pictures and its values in the history.
#[test]
fn views_share_the_numbers() {
    let problem = Problem::new();
    let other = Camera::look_at([4.0, 0.5, 0.0], [0.0; 3]).with_fov_y(40.0);
    let fine = problem.options.clone().with_samples(512);
    let side = render(&problem.scene(&problem.ball([0.0; 3], 0.0)), &other, &fine);
    let side = side.expect("a target").radiance;
    let fitted = problem.fit(8).run(|ball, step| {
        let options = step.options(&problem.options, 0);
        let second = Residual::new(problem.scene(ball), other.clone(), options, side.clone())
            .with_name("side")
            .with_levels(3);
        let x = values(&ball.at.val())[0];
        Ok(vec![
            problem.residual(ball, step).with_value("x", x),
            second,
        ])
    });
    let fitted = fitted.expect("a fit");
    let found = numbers(&fitted.module);
    assert!(found[..4].iter().all(|v| v.abs() < 0.02), "{found:?}");
    let x = fitted.history.curve("x");
    assert!((x[0].1 - START[0]).abs() < 1e-6);
}

#[test]
fn errors_name_what_is_wrong() {
    let problem = Problem::new();
    let of = |residuals: &dyn Fn(&Ball, &Step) -> Vec<Residual>| {
        message(
            problem
                .fit(1)
                .run(|ball, step| Ok(residuals(ball, step)))
                .map(drop),
        )
    };
    says(of(&|_, _| Vec::new()), ["residuals", "at least one"]);
    let twice =
        |ball: &Ball, step: &Step| vec![problem.residual(ball, step), problem.residual(ball, step)];
    says(of(&twice), ["render", "named twice"]);
    let small = |ball: &Ball, _: &Step| {
        let options = RenderOptions::new(8, 8);
        vec![Residual::new(
            problem.scene(ball),
            problem.camera.clone(),
            options,
            problem.target.clone(),
        )]
    };
    says(
        of(&small),
        ["shape of the target", "[24, 24, 3]", "[8, 8, 3]"],
    );
    let still = |_: &Ball, step: &Step| vec![problem.residual(&problem.ball([0.0; 3], 0.0), step)];
    says(of(&still), ["derivatives", "on which the images depend"]);
    let level = |ball: &Ball, step: &Step| vec![problem.residual(ball, step).with_levels(0)];
    says(of(&level), ["levels", "at least 1"]);
    let mut large = problem.ball([0.0; 3], 0.0);
    large.unused = Param::from_tensor(Tensor::zeros([300], &problem.device.clone().autodiff()));
    let fit = LeastSquares::new(large, 1).with_progress(false);
    let fitted = fit.run(|ball, step| Ok(vec![problem.residual(ball, step)]));
    says(
        message(fitted.map(drop)),
        ["numbers of the module", "256", "Fit"],
    );
}
