//! Fits by Gauss–Newton steps with Levenberg–Marquardt damping.

mod equations;
mod numbers;

use std::path::Path;

use burn::module::Module;
use burn::optim::SgdConfig;
use burn::tensor::Tensor;

use super::step::Evaluated;
use super::{Evaluation, Fit, Fitted, History, Rate, Report, Step};
use crate::error::{Error, Result};
use crate::geometry::{detached, host_values};
use crate::optim::loss::halves;
use crate::optim::schedule::Blur;
use crate::render::{RenderOptions, Tangent, Values, render, render_derivative};
use crate::scene::{Camera, Scene};
use equations::{Equations, Linear};
use numbers::{gradients, numbers, with_numbers};

/// The most numbers of a module: each costs derivative images.
const MAX_NUMBERS: usize = 256;
/// The damping of the first step, the least and the most, and the factor between those that a step tries.
const DAMPING: f64 = 1.0;
const MIN_DAMPING: f64 = 1e-6;
const MAX_DAMPING: f64 = 1e6;
const FACTOR: f64 = 10.0;
/// The samples of residuals, relative to those of derivatives: near the target, their noise is most of the noise of a step.
const RESIDUAL: u32 = 4;
/// The names of values in the history: the damping, the number of steps that are averaged, and the level of noise below
/// which losses are not distinguished.
const NAMES: [&str; 3] = ["damping", "averaged", "noise"];

/// A view whose image should become a target: a scene, a camera, the options of its renders and the target image.
///
/// [`LeastSquares`] has an example.
#[derive(Clone, Debug)]
pub struct Residual {
    scene: Scene,
    camera: Camera,
    options: RenderOptions,
    target: Tensor<3>,
    name: String,
    levels: usize,
    values: Vec<(String, f64)>,
}

impl Residual {
    /// Creates the residual of a view. `target` is an image `[H, W, 3]` of the size of the options. The seed of the options
    /// has no effect, since each render of a fit has its own; [`Step::options`] sets the blur of the step.
    pub fn new(scene: Scene, camera: Camera, options: RenderOptions, target: Tensor<3>) -> Self {
        Self {
            scene,
            camera,
            options,
            target,
            name: "render".into(),
            levels: 1,
            values: Vec::new(),
        }
    }

    /// Sets the name of the view in pictures; `"render"` by default. Names of a fit's views are unique.
    pub fn with_name(mut self, name: impl Into<String>) -> Self {
        self.name = name.into();
        self
    }

    /// Compares image and target on this many levels of their [`pyramid`](crate::loss::pyramid), as
    /// [`multi_scale_unbiased`](crate::loss::multi_scale_unbiased) does; 1 by default. With more levels, a fit may start
    /// further away.
    pub fn with_levels(mut self, levels: usize) -> Self {
        self.levels = levels;
        self
    }

    /// Adds a value for the history; see [`Evaluation::with_value`].
    pub fn with_value(mut self, name: impl Into<String>, value: f64) -> Self {
        self.values.push((name.into(), value));
        self
    }

    fn check(&self) -> Result<()> {
        let object = format!("residual {:?}", self.name);
        let (found, expected) = (
            self.target.dims(),
            [self.options.height, self.options.width, 3],
        );
        let same = found == expected;
        let (found, expected) = (format!("{found:?}"), format!("{expected:?} like the image"));
        Error::unless(same, &object, "shape of the target", found, &expected)?;
        Error::unless(
            self.levels > 0,
            &object,
            "levels",
            self.levels,
            "at least 1",
        )
    }

    /// Returns the values of the pyramids of images `[B, H, W, 3]`, for each image one list. They are scaled so that the sum
    /// of their squares is the mean over levels of the mean square.
    fn flattened(&self, images: Tensor<4>) -> Result<Vec<Vec<f64>>> {
        let count = images.dims()[0];
        let levels = halves(detached(&images), self.levels);
        let mut all = vec![Vec::new(); count];
        for level in &levels {
            let values = host_values(level)?;
            let each = values.len() / count;
            let scale = ((levels.len() * each) as f64).sqrt().recip();
            for (to, own) in all.iter_mut().zip(values.chunks_exact(each)) {
                to.extend(own.iter().map(|v| v * scale));
            }
        }
        Ok(all)
    }

    /// Renders an image and returns it with its residuals. There are `times` as many samples as for derivatives.
    fn residuals(&self, seed: u64, times: u32) -> Result<(Tensor<3>, Vec<f64>)> {
        let samples = self.options.samples.saturating_mul(times);
        let options = self.options.clone().with_samples(samples).with_seed(seed);
        let image = detached(&render(&self.scene, &self.camera, &options)?.radiance);
        let target = detached(&self.target).cast(image.dtype());
        let difference = image.clone() - target.to_device(&image.device());
        let mut all = self.flattened(difference.unsqueeze())?;
        Ok((image, all.swap_remove(0)))
    }

    /// Returns an image, its residuals and their derivatives.
    fn linear(&self, tangents: &[Tangent], [seed, other]: [u64; 2]) -> Result<(Tensor<3>, Linear)> {
        let (image, residuals) = self.residuals(other, RESIDUAL)?;
        let options = self.options.clone().with_seed(seed);
        let all = render_derivative(&self.scene, &self.camera, &options, tangents)?;
        let by_number = self.flattened(all.tangents.radiance)?;
        Ok((
            image,
            Linear {
                residuals,
                by_number,
            },
        ))
    }

    /// Returns the loss from two renders.
    fn loss(&self, seeds: [u64; 2]) -> Result<f64> {
        let [a, b] = seeds.map(|seed| self.residuals(seed, 1));
        Ok(a?.1.iter().zip(&b?.1).map(|(a, b)| a * b).sum())
    }
}

/// Fits up to some dozens of numbers of a module to images: a pose, a camera, a lens, a light.
///
/// Each step renders the images and their derivatives by all numbers ([`render_derivative`]), and solves the linear least
/// squares problem of the residuals image − target (Gauss–Newton) with a damping (Levenberg 1944, Marquardt 1963). Where
/// the images are smooth functions of the numbers, it arrives in about ten steps. Far from the target, give it a wide
/// blur at first ([`LeastSquares::with_blur`]), as for gradient descent.
///
/// *Noise.* A step renders all derivatives twice, and two images with four times as many samples, each with a seed of its own.
/// It multiplies only values of different renders: residuals with derivatives, and derivatives with derivatives. So noise
/// biases neither the gradient nor the matrix. The solution, which divides by the matrix, has a bias of the order of the
/// matrix's variance: it makes steps a little too long or too short, and does not move the point at which the fit ends.
///
/// Where the loss would fall by less than its noise, each step is an estimate of the target with noise of its own. From there
/// on the fit takes the mean of these estimates: step n of them moves the numbers by 1/n of the solution. So more steps
/// reduce the noise of the result, as more samples do.
///
/// *Damping.* A step tries several dampings, renders the scene at each resulting point with the same seeds, and takes
/// the point with the least loss. If all are clearly worse than the current point, the numbers stay, and the next step begins
/// with a larger damping. Steps that are averaged have little damping. The history has as values the damping, the number of steps that are averaged and the level of
/// noise of the loss; its gradient norm is the length of the step.
///
/// Folders, checkpoints, pictures, the history and callbacks are those of [`Fit`].
///
/// ```
/// use burn::module::{Module, Param};
/// use softray::optim::{LeastSquares, Residual, Step};
/// use softray::prelude::*;
///
/// #[derive(Module, Debug)]
/// struct Place {
///     at: Param<Tensor<1>>,
/// }
///
/// let device = Device::flex();
/// let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0]).with_fov_y(40.0);
/// let options = RenderOptions::new(24, 24).with_samples(16).with_bounces(0);
/// let scene = |at: Tensor<1>| {
///     Scene::new()
///         .with_object(Object::new(shapes::icosphere(1, &device).translated(at)))
///         .with_environment([1.0, 1.0, 1.0])
/// };
/// let goal = scene(Tensor::zeros([3], &device));
/// let target = render(&goal, &camera, &options.clone().with_samples(256))?.radiance;
/// let start = Tensor::from_floats([0.3, -0.2, 0.4], &device.clone().autodiff());
/// let fitted = LeastSquares::new(Place { at: Param::from_tensor(start) }, 8).run(|place, step: &Step| {
///     let options = step.options(&options, 0);
///     Ok(vec![Residual::new(scene(place.at.val()), camera.clone(), options, target.clone())])
/// })?;
/// let far = fitted.module.at.val().abs().max().into_scalar::<f32>();
/// assert!(far < 0.02, "{far}");
/// # Ok::<(), softray::Error>(())
/// ```
pub struct LeastSquares<M> {
    fit: Fit<M>,
}

impl<M: Module> LeastSquares<M> {
    /// Creates a fit of a module on a device with autodiff in `steps` steps. Frozen parameters stay as they are.
    pub fn new(module: M, steps: usize) -> Self {
        let fit = Fit::new(module, SgdConfig::new().init(), steps);
        Self {
            fit: fit.with_rate(Rate::constant(1.0)),
        }
    }

    /// Runs the steps and returns the fitted module.
    ///
    /// `f` receives the module and the [`Step`] and returns the views to compare. It runs many times in a step, also with
    /// other numbers, and must depend only on these arguments. It does not render.
    ///
    /// # Errors
    /// Like [`Fit::run`] and [`render_derivative`]; if there is no view, a target has another size than its view, two views
    /// have the same name, or the module has more than 256 numbers that are not frozen.
    pub fn run(self, mut f: impl FnMut(&M, &Step) -> Result<Vec<Residual>>) -> Result<Fitted<M>> {
        self.fit.run_steps(&mut |module, step, history| {
            let problem = Problem::new(module, step)?;
            problem.evaluated(&mut |module| f(module, step), history)
        })
    }
}

/// Passes settings on to [`Fit`].
macro_rules! settings {
    ($($name:ident($argument:ident: $type:ty);)*) => {
        impl<M: Module> LeastSquares<M> {$(
            #[doc = concat!("See [`Fit::", stringify!($name), "`].")]
            pub fn $name(mut self, $argument: $type) -> Self {
                self.fit = self.fit.$name($argument);
                self
            }
        )*}
    };
}

settings! {
    with_seed(seed: u64);
    with_blur(blur: impl Into<Blur>);
    with_early_stop(patience: usize);
    with_folder(folder: impl AsRef<Path>);
    with_checkpoint_every(steps: usize);
    with_restart(restart: bool);
    with_progress(shown: bool);
}

impl<M: Module> LeastSquares<M> {
    /// See [`Fit::with_pictures`]. Each view is a row.
    pub fn with_pictures(mut self, folder: impl AsRef<Path>, every: usize) -> Self {
        self.fit = self.fit.with_pictures(folder, every);
        self
    }

    /// See [`Fit::on_step`].
    pub fn on_step(
        mut self,
        every: usize,
        f: impl FnMut(&Report<M>) -> Result<bool> + 'static,
    ) -> Self {
        self.fit = self.fit.on_step(every, f);
        self
    }
}

/// The views of a module.
type Views<'a, M> = &'a mut dyn FnMut(&M) -> Result<Vec<Residual>>;

/// The problem of a step.
struct Problem<'a, M> {
    module: &'a M,
    step: &'a Step,
    numbers: Vec<f64>,
}

impl<'a, M: Module> Problem<'a, M> {
    fn new(module: &'a M, step: &'a Step) -> Result<Self> {
        let numbers = numbers(module)?;
        let few = numbers.len() <= MAX_NUMBERS;
        let expected = format!("at most {MAX_NUMBERS} that are not frozen; Fit is for more");
        Error::unless(
            few,
            "least squares",
            "numbers of the module",
            numbers.len(),
            &expected,
        )?;
        Ok(Self {
            module,
            step,
            numbers,
        })
    }

    /// Returns the seeds of a pair of renders of a view. The first pair is for derivatives, the second for images.
    fn seeds(&self, view: usize, pair: u64) -> [u64; 2] {
        let first = 4 * view as u64 + 2 * pair;
        [first, first + 1].map(|render| self.step.seed(render))
    }

    /// Evaluates the step. The gradients move the numbers to the next point if their rate is 1.
    fn evaluated(&self, f: Views<M>, history: &History) -> Result<Evaluated> {
        let views = f(self.module)?;
        Error::unless(
            !views.is_empty(),
            "least squares",
            "residuals",
            "empty",
            "at least one",
        )?;
        views.iter().try_for_each(Residual::check)?;
        let (mut evaluation, equations) = self.equations(&views, f)?;
        let unused: Vec<usize> = equations.unused().collect();
        if unused.len() == self.numbers.len() && self.step.index == 0 {
            let expected = "numbers of the module on which the images depend";
            return Err(Error::invalid(
                "least squares",
                "derivatives",
                "0",
                expected,
            ));
        }
        let last = |name: &str| history.curve(name).last().map(|point| point.1);
        let [damping, averaged, _] = NAMES.map(last);
        let noise = equations.variance.sqrt();
        // Far from the target, earlier steps do not count.
        let (damping, step, averaged) = if equations.decrease() < noise {
            let (damping, step) = equations.step_of_least_damping();
            (damping, step, averaged.unwrap_or(0.0) + 1.0)
        } else {
            let (damping, step) = self.best(&equations, damping.unwrap_or(DAMPING), f)?;
            (damping, step, 1.0)
        };
        let values = NAMES.into_iter().zip([damping, averaged, noise]);
        evaluation = values.fold(evaluation, |all, (name, value)| all.with_value(name, value));
        let step: Vec<f64> = step.iter().map(|x| x / averaged).collect();
        let nothing = unused.len() == self.numbers.len();
        let moves = |i: usize| nothing || !unused.contains(&i);
        Ok(Evaluated {
            evaluation,
            loss: equations.loss,
            gradients: gradients(self.module, &step, moves),
        })
    }

    /// Renders all views with derivatives.
    fn equations(&self, views: &[Residual], f: Views<M>) -> Result<(Evaluation, Equations)> {
        let shapes = views.iter().map(|v| Values::of(&v.scene, &v.camera));
        let shapes = shapes.collect::<Result<Vec<_>>>()?;
        let mut build = |numbers: &[f64]| {
            let views = f(&with_numbers(self.module, numbers))?;
            let same = views.len() == shapes.len();
            let expected = format!("{} at all points", shapes.len());
            Error::unless(
                same,
                "least squares",
                "number of residuals",
                views.len(),
                &expected,
            )?;
            Ok(views.into_iter().map(|v| (v.scene, v.camera)).collect())
        };
        let by_number = Tangent::of_views(&self.numbers, &shapes, &mut build)?;
        let device = views[0].target.device();
        let mut evaluation = Evaluation::new(Tensor::zeros([1], &device));
        let mut all: Option<Equations> = None;
        for (index, view) in views.iter().enumerate() {
            let tangents: Vec<Tangent> = by_number.iter().map(|of| of[index].clone()).collect();
            let seeds = [0, 1].map(|pair| self.seeds(index, pair));
            let [a, b] = [0, 1].map(|k| view.linear(&tangents, seeds.map(|pair| pair[k])));
            let ((image, a), (_, b)) = (a?, b?);
            let own = Equations::new(&a, &b);
            match &mut all {
                None => all = Some(own),
                Some(all) => all.add(&own),
            }
            let values = view.values.iter();
            evaluation = values
                .fold(evaluation, |all, (name, value)| {
                    all.with_value(name, *value)
                })
                .with_image(view.name.as_str(), image)
                .with_target(view.name.as_str(), view.target.clone());
        }
        evaluation.check()?;
        let equations = all
            .ok_or_else(|| Error::invalid("least squares", "residuals", "empty", "at least one"))?;
        Ok((evaluation, equations))
    }

    /// Returns the damping and the step with the least loss: it goes from the last damping to larger and to smaller ones
    /// while the loss falls. The step is 0 if none reduces the loss.
    fn best(&self, equations: &Equations, last: f64, f: Views<M>) -> Result<(f64, Vec<f64>)> {
        let none = vec![0.0; self.numbers.len()];
        let here = self.loss(&none, f)?;
        let mut tried = |damping: f64| -> (f64, f64, Vec<f64>) {
            let step = equations.step(damping);
            // A long step may lead to a scene that is an error.
            let of_step = step.map(|step| (self.loss(&step, f).unwrap_or(f64::INFINITY), step));
            let (loss, step) = of_step.unwrap_or((f64::INFINITY, none.clone()));
            (loss, damping, step)
        };
        let mut best = tried(last);
        for factor in [FACTOR, FACTOR.recip()] {
            let from = best.1;
            let dampings = (1..).map(|k| from * factor.powi(k));
            for damping in dampings.take_while(|d| (MIN_DAMPING..=MAX_DAMPING).contains(d)) {
                let next = tried(damping);
                // Larger dampings are tried until one reduces the loss.
                let hopeless = factor > 1.0 && best.0.min(next.0) >= here;
                if next.0 >= best.0 && !hopeless {
                    break;
                }
                if next.0 < best.0 {
                    best = next;
                }
            }
            if best.1 != last {
                break;
            }
        }
        // Differences within the noise do not matter.
        if best.0 > here + equations.variance.sqrt() {
            return Ok((DAMPING.max(last), none));
        }
        Ok((best.1, best.2))
    }

    /// Returns the loss after a step, with the same seeds for all steps.
    fn loss(&self, step: &[f64], f: Views<M>) -> Result<f64> {
        let pairs = self.numbers.iter().zip(step);
        let numbers: Vec<f64> = pairs.map(|(number, step)| number + step).collect();
        let views = f(&with_numbers(self.module, &numbers))?;
        let views = views.iter().enumerate();
        let losses = views.map(|(index, view)| view.loss(self.seeds(index, 1)));
        losses.sum()
    }
}
