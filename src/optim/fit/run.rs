//! The loop over the steps of a fit.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::Device;
use web_time::Instant;

use super::check::{clip, loss_of_step, no_gradient, not_finite};
use super::checkpoint::{AVERAGE, Checkpoints};
use super::devices::{Part, evaluate_over};
use super::progress::Progress;
use super::step::Evaluated;
use super::{Evaluation, Fit, Fitted, History, Report, Row, Step, Stop, Warning};
use crate::error::{Error, Result};
use crate::optim::schedule::Blur;

/// A function that evaluates a step, given the steps before it.
pub(super) type Evaluate<'a, M> = dyn FnMut(&M, &Step, &History) -> Result<Evaluated> + 'a;

/// A running fit.
struct Run<M> {
    fit: Fit<M>,
    /// The settings that a checkpoint must match; empty without checkpoints.
    settings: String,
    checkpoints: Option<Checkpoints>,
    history: History,
    resumed: Option<usize>,
    progress: Progress,
    /// The number of steps without a fall of the loss that count as a plateau.
    window: usize,
    plateaus: Vec<usize>,
    /// The reason for an end before the last step.
    stop: Option<Stop>,
    start: Instant,
    /// Seconds taken by earlier runs.
    before: f64,
}

impl<M: Module> Fit<M> {
    /// Runs the steps and returns the fitted module.
    ///
    /// At each step, `f` receives the module and the [`Step`] and returns the loss. Its result must depend only
    /// on these two arguments. Then a fit that is killed and resumed ends with the same parameters as an
    /// uninterrupted fit.
    ///
    /// # Errors
    /// Before the first step: if a setting is out of its range, no parameter of the module is on a device with
    /// autodiff, a folder cannot be used, or a checkpoint belongs to a fit with other settings or to another
    /// module.
    ///
    /// At a step: any error of `f` or a callback; if the loss is not one number in the graph of the module's
    /// parameters, the loss or the gradient is not finite, the values, images or targets do not meet the
    /// conditions of [`Evaluation`], the first step has no image for [`Fit::with_pictures`], or a file cannot be
    /// written.
    pub fn run(self, mut f: impl FnMut(&M, &Step) -> Result<Evaluation>) -> Result<Fitted<M>> {
        self.run_steps(&mut |module, step, _| {
            let evaluation = f(module, step)?;
            evaluation.check()?;
            let loss = loss_of_step(&evaluation.loss, step.index)?;
            let gradients = GradientsParams::from_grads(evaluation.loss.backward(), module);
            Ok(Evaluated {
                evaluation,
                loss,
                gradients,
            })
        })
    }

    /// Like [`run`](Self::run), by one thread for each of several devices.
    ///
    /// `f` receives a copy of the module on the device of its [`Part`], and returns the loss of that part: for example
    /// of the views of [`Part::of`]. Losses, gradients, and values of the same name are **summed** over the parts, in the
    /// order of the devices, so a mean over views divides by the number of all views. Images and targets of all parts are
    /// recorded, under names of their own.
    ///
    /// The module stays on its own device, where the optimizer steps. Each step copies its parameters to every device,
    /// and the gradients back. The result is the same whatever the order in which the threads finish, and that of one
    /// device but for rounding. A device may be named several times.
    ///
    /// ```
    /// use burn::module::{Module, Param};
    /// use burn::optim::AdamConfig;
    /// use softray::optim::{Evaluation, Fit, Part};
    /// use softray::prelude::*;
    ///
    /// #[derive(Module, Debug)]
    /// struct Color {
    ///     albedo: Param<Tensor<1>>,
    /// }
    ///
    /// let start = Tensor::full([3], 0.5, &Device::flex().autodiff());
    /// let views = [0.0, 90.0, 180.0, 270.0];
    /// let devices = [Device::flex(), Device::flex()];
    /// let fit = Fit::new(Color { albedo: Param::from_tensor(start) }, AdamConfig::new().init(), 3);
    /// let fitted = fit.run_over(&devices, |color: &Color, step, part: &Part| {
    ///     let ball = Object::new(shapes::icosphere(1, &part.device));
    ///     let scene = Scene::new()
    ///         .with_object(ball.with_material(Material::diffuse(color.albedo.val())))
    ///         .with_environment([1.0; 3]);
    ///     let cameras = part.of(&views).map(|&angle: &f64| Camera::orbit([0.0; 3], 4.0, angle, 10.0));
    ///     let cameras = cameras.collect::<softray::Result<Vec<_>>>()?;
    ///     let options = step.options(&RenderOptions::new(8, 8).with_samples(2), part.index as u64);
    ///     let images = render_batch(&Batch::new(vec![scene], cameras)?, &options)?;
    ///     let darker = (images.radiance - 0.2).powf_scalar(2.0).sum();
    ///     Ok(Evaluation::new(darker / (views.len() * 8 * 8 * 3) as f64))
    /// })?;
    /// assert!(fitted.history.rows[2].loss < fitted.history.rows[0].loss);
    /// # Ok::<(), softray::Error>(())
    /// ```
    ///
    /// # Errors
    /// Like [`run`](Self::run), if there is no device, or if the server of a device has gone.
    pub fn run_over(
        self,
        devices: &[Device],
        f: impl Fn(&M, &Step, &Part) -> Result<Evaluation> + Sync,
    ) -> Result<Fitted<M>> {
        Error::unless(
            !devices.is_empty(),
            "fit",
            "devices",
            "empty",
            "at least one",
        )?;
        self.run_steps(&mut |module, step, _| evaluate_over(module, step, devices, &f))
    }

    /// Runs the steps with a function that returns the gradients of a step for the optimizer.
    pub(super) fn run_steps(self, f: &mut Evaluate<'_, M>) -> Result<Fitted<M>> {
        let mut run = Run::open(self)?;
        while run.stop.is_none() && run.history.rows.len() < run.fit.steps {
            run = run.step(f)?;
            if run.history.rows.len().is_multiple_of(run.fit.every) {
                run.save()?;
            }
        }
        run.finish()
    }
}

impl<M: Module> Run<M> {
    /// Resumes from a checkpoint if there is one.
    fn open(mut fit: Fit<M>) -> Result<Self> {
        fit.check()?;
        if let Some(pictures) = &fit.pictures {
            let folder = &pictures.folder;
            std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
        }
        // Only checkpoints use the settings.
        let settings = fit.folder.as_ref().map(|_| fit.settings());
        let settings = settings.transpose()?.unwrap_or_default();
        let mut progress = Progress::new(fit.progress, fit.steps);
        fit.empty_groups()?
            .into_iter()
            .for_each(|warning| progress.warn(warning));
        let mut warn = |warning| progress.warn(warning);
        let restart = fit.restart;
        let mut open = |folder: &Path| Checkpoints::open(folder, restart, &mut warn);
        let checkpoints = fit.folder.as_deref().map(&mut open).transpose()?;
        let mut history = History::default();
        let mut resumed = None;
        let newest = checkpoints.as_ref();
        let newest = newest.map(|c| c.newest(&settings, &mut warn));
        if let Some(newest) = newest.transpose()?.flatten() {
            (fit.module, fit.optimizer) = newest.load(fit.module, fit.optimizer)?;
            if let Some(average) = &mut fit.average {
                average.module = newest.load_module(AVERAGE, average.module.clone())?;
            }
            history = newest.history;
            let (steps, done) = (fit.steps, history.rows.len());
            let expected = format!("at least {done}, which the checkpoint has");
            Error::unless(done <= steps, "fit", "steps", steps, &expected)?;
            resumed = Some(done);
        }
        // Blur that depends on the loss is restored from the losses so far.
        for row in &history.rows {
            observe(&mut fit.blur, row.loss);
        }
        progress.begin(history.rows.len());
        let window = fit.patience.unwrap_or((fit.steps / 5).max(20));
        let plateaus = history.plateaus(window);
        // A fit that ended early is not continued.
        let flat = plateaus.last().is_some_and(|p| p + 1 == history.rows.len());
        Ok(Self {
            window,
            plateaus,
            stop: (flat && fit.patience.is_some()).then_some(Stop::Early),
            before: history.rows.last().map_or(0.0, |r| r.seconds),
            start: Instant::now(),
            fit,
            settings,
            checkpoints,
            history,
            resumed,
            progress,
        })
    }

    /// Takes a step.
    fn step(mut self, f: &mut Evaluate<'_, M>) -> Result<Self> {
        let index = self.history.rows.len();
        let first = index == 0 || self.resumed == Some(index);
        let steps = self.fit.steps;
        let due = |every: usize| index.is_multiple_of(every) || index + 1 == steps;
        let pictures = self.fit.pictures.as_ref();
        let pictures = pictures.filter(|p| first || due(p.every));
        let step = Step {
            index,
            blur: self.fit.blur.as_ref().map(|b| b.value(index)),
            pictured: pictures.is_some(),
            seed: self.fit.seed,
            blurred: Arc::default(),
        };
        let Evaluated {
            mut evaluation,
            loss,
            mut gradients,
        } = f(&self.fit.module, &step, &self.history)?;
        if first && step.blur.is_some() && !step.blurred.load(Ordering::Relaxed) {
            self.progress.warn(Warning::UnusedBlur);
        }
        let (norm, missing) = clip(&self.fit.module, &mut gradients, self.fit.clip)?;
        let Some(norm) = norm else {
            return Err(no_gradient(&self.fit.module, &evaluation.loss));
        };
        if !norm.is_finite() {
            return Err(not_finite("the gradient", norm, index));
        }
        if !missing.is_empty() && first {
            self.progress.warn(Warning::Unused(missing));
        }
        let rate = self.fit.rate.at(index, steps);
        let row = Row {
            step: index,
            loss,
            gradient_norm: norm,
            rate,
            blur: step.blur,
            seconds: self.before + self.start.elapsed().as_secs_f64(),
            values: Vec::new(),
        };
        self.history
            .push(std::mem::take(&mut evaluation.values), row)?;
        if let (Some(pictures), Some(row)) = (pictures, self.history.rows.last()) {
            pictures.write(&evaluation, row, first)?;
        }
        if let Some((every, callback)) = &mut self.fit.callback
            && due(*every)
        {
            let wanted = callback(&Report {
                module: &self.fit.module,
                step: &step,
                steps,
                history: &self.history,
                evaluation: &evaluation,
            })?;
            self.stop = (!wanted).then_some(Stop::Callback);
        }
        drop(evaluation);
        let rates = self.fit.rates_at(index);
        self.fit.module = self.fit.optimizer.step(rates, self.fit.module, gradients);
        observe(&mut self.fit.blur, loss);
        self.progress.step(&self.history);
        if let Some(average) = &mut self.fit.average {
            average.take(&self.fit.module, index + 1);
        }
        let (window, last) = (self.window, self.plateaus.last().copied());
        if self.history.is_flat(index + 1, window, last) {
            self.plateaus.push(index);
            let step = index;
            self.progress.warn(Warning::Plateau { step, window });
            self.stop = self.fit.patience.map(|_| Stop::Early).or(self.stop);
        }
        Ok(self)
    }

    /// Writes a checkpoint if the fit has a folder.
    fn save(&self) -> Result<()> {
        self.checkpoints.as_ref().map_or(Ok(()), |checkpoints| {
            let average = self.fit.average.as_ref().map(|average| &average.module);
            let modules = (&self.fit.module, average);
            checkpoints.write(modules, &self.fit.optimizer, &self.history, &self.settings)
        })
    }

    fn finish(mut self) -> Result<Fitted<M>> {
        let stop = self.stop.unwrap_or(Stop::Steps);
        self.progress.finish(stop);
        let steps = self.history.rows.len();
        if !steps.is_multiple_of(self.fit.every) && self.resumed != Some(steps) {
            self.save()?;
        }
        if let Some(checkpoints) = &self.checkpoints {
            checkpoints.finish(&self.history)?;
        }
        Ok(Fitted {
            module: self.fit.module,
            average: self.fit.average.map(|average| average.module),
            history: self.history,
            stop,
            resumed: self.resumed,
            plateaus: self.plateaus,
            warnings: self.progress.warnings,
        })
    }
}

fn observe(blur: &mut Option<Blur>, loss: f64) {
    if let Some(blur) = blur {
        blur.observe(loss);
    }
}
