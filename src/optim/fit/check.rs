//! Checks of a fit before it begins, and of the loss of a step.

use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::{GradientsParams, ModuleOptimizer};
use burn::tensor::{Device, Tensor};

use super::Fit;
use crate::error::{Error, Result};
use crate::geometry::host_values;

fn invalid(field: impl Into<String>, value: impl ToString, expected: &str) -> Error {
    Error::invalid("fit", field, value, expected)
}

impl<M: Module> Fit<M> {
    /// Checks that settings are in their ranges, and that the module has parameters that can be fitted.
    pub(super) fn check(&self) -> Result<()> {
        let at_least_one = |field: &str, value: usize| match value {
            0 => Err(invalid(field, 0, "at least 1")),
            _ => Ok(()),
        };
        if self.seed >= 1 << 24 {
            return Err(invalid("seed", self.seed, "below 2²⁴"));
        }
        at_least_one("steps", self.steps)?;
        at_least_one("checkpoint_every", self.every)?;
        at_least_one("early_stop", self.patience.unwrap_or(1))?;
        at_least_one("pictures", self.pictures.as_ref().map_or(1, |p| p.every))?;
        if let Some(clip) = self.clip
            && !(clip.is_finite() && clip > 0.0)
        {
            return Err(invalid("clip", clip, "a finite number > 0"));
        }
        self.rate.check()?;
        check_parameters(&self.module)
    }

    /// The settings that a fit must share with a checkpoint to resume it.
    pub(super) fn settings(&self) -> String {
        let Self {
            seed,
            rate,
            blur,
            clip,
            steps,
            optimizer,
            ..
        } = self;
        let optimizer = fingerprint(optimizer);
        format!(
            "seed {seed}\nsteps {steps}\nrate {rate:?}\nblur {blur:?}\nclip {clip:?}\n\
             optimizer {optimizer}\n"
        )
    }
}

/// Checks that a module has a parameter which records gradients.
fn check_parameters<M: Module>(module: &M) -> Result<()> {
    let mut found = Parameters::default();
    module.visit(&mut found);
    if found.trained {
        return Ok(());
    }
    Err(match (found.plain, found.frozen) {
        (Some((path, device)), _) => invalid(
            format!("device of the parameter {path}"),
            format!("{device}, which records no gradients"),
            "one with autodiff: make the module on device.autodiff()",
        ),
        (None, Some(path)) => invalid(
            "module",
            format!("frozen, {path} as all of its parameters"),
            "a parameter that requires a gradient",
        ),
        (None, None) => invalid("module", "without parameters", "at least one of floats"),
    })
}

/// The kinds of parameters that a module has, each with the first one's path.
#[derive(Default)]
struct Parameters {
    path: Vec<String>,
    trained: bool,
    plain: Option<(String, String)>,
    frozen: Option<String>,
}

impl ModuleVisitor for Parameters {
    fn enter_module(&mut self, name: &str, _container_type: &str) {
        self.path.push(name.into());
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let tensor = param.base();
        let path = || self.path.join(".");
        if !tensor.is_autodiff() {
            let device = format!("{:?}", tensor.device());
            self.plain.get_or_insert((path(), device));
        } else if tensor.is_require_grad() {
            self.trained = true;
        } else {
            self.frozen.get_or_insert(path());
        }
    }
}

/// The loss as a number, if it is one in an autodiff graph.
pub(super) fn loss_of_step(loss: &Tensor<1>, step: usize) -> Result<f64> {
    if !loss.is_tracked() {
        let value = match loss.is_autodiff() {
            true => "a constant".into(),
            false => format!("on {:?}, which records no gradients", loss.device()),
        };
        return Err(invalid(
            format!("loss of step {step}"),
            value,
            "in the graph of the module's parameters: computed from their val(), without inner(), \
             detach() and numbers in between",
        ));
    }
    let values = host_values(loss)?;
    match values[..] {
        [value] if value.is_finite() => Ok(value),
        [value] => Err(not_finite("the loss", value, step)),
        _ => Err(invalid(
            "loss",
            format!("of {} numbers", values.len()),
            "one number",
        )),
    }
}

/// The error of a loss whose graph has no parameter.
pub(super) fn no_gradient<M: Module>(module: &M, loss: &Tensor<1>) -> Error {
    let (device, devices) = (loss.device(), module.devices());
    if devices.iter().all(|d| *d != device) {
        let devices: Vec<String> = devices.iter().map(|d| format!("{d:?}")).collect();
        return invalid(
            "device of the loss",
            format!("{device:?}"),
            &format!("{}, that of the module's parameters", devices.join(" or ")),
        );
    }
    invalid(
        "gradient",
        "absent",
        "a parameter of the module in the graph of the loss: it is computed from their val(), without \
         inner(), detach() and numbers in between",
    )
}

pub(super) fn not_finite(what: &str, value: f64, step: usize) -> Error {
    invalid(format!("{what} of step {step}"), value, "a finite number")
}

/// A fingerprint of an optimiser, which has no name: the values that a parameter takes in three of its steps.
fn fingerprint(optimizer: &ModuleOptimizer) -> String {
    #[derive(Module, Debug)]
    struct Probe {
        x: Param<Tensor<2>>,
    }
    let device = Device::default();
    let mut optimizer = optimizer.clone();
    let start = Tensor::<2>::from_floats([[0.3, -2.0], [1.0, 0.1]], &device.clone().autodiff());
    let mut probe = Probe {
        x: Param::from_tensor(start),
    };
    for slope in [
        [[0.5f32, -1.0], [2.0, 0.1]],
        [[-0.2, 3.0], [0.1, 0.4]],
        [[0.7; 2]; 2],
    ] {
        let mut gradients = GradientsParams::new();
        gradients.register(probe.x.id, Tensor::<2>::from_floats(slope, &device));
        probe = optimizer.step(0.1, probe, gradients);
    }
    let values = host_values(&probe.x.val()).unwrap_or_default();
    let values: Vec<String> = values.iter().map(|v| format!("{v:.4}")).collect();
    values.join(" ")
}
