//! Fits by Gauss–Newton steps with Levenberg–Marquardt damping.

mod equations;
mod numbers;
mod problem;
mod residual;

use std::path::Path;

use burn::module::Module;
use burn::optim::SgdConfig;

use super::{Fit, Fitted, Rate, Report, Step};
use crate::error::Result;
use crate::optim::schedule::Blur;
use problem::Problem;
pub use residual::Residual;

/// Fits up to some dozens of numbers of a module to images: a pose, a camera, a lens, a light.
///
/// Each step renders the images and their derivatives by all numbers ([`render_derivative`](crate::render::render_derivative)), and solves the linear least
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
/// on the fit takes the mean of these estimates, as long as the blur stays the same: step n of them moves the numbers by 1/n
/// of the solution. So more steps reduce the noise of the result, as more samples do.
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
    /// `f` receives the module, whose numbers are not tracked, and the [`Step`], and returns the views to compare. It runs many times in a step, also with
    /// other numbers, and must depend only on these arguments. It does not render.
    ///
    /// # Errors
    /// Like [`Fit::run`] and [`render_derivative`](crate::render::render_derivative); if there is no view, a target has another size than its view, two views
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
