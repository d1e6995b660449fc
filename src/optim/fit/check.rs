//! Checks of a fit before its first step, and of the loss and the gradients of a step.

use burn::module::{Module, ModuleVisitor, Param, ParamId};
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor};

use super::Fit;

use crate::device::label;
use crate::error::{Error, Result};
use crate::geometry::host_values;

fn invalid(field: impl Into<String>, value: impl ToString, expected: &str) -> Error {
    Error::invalid("fit", field, value, expected)
}

impl<M: Module> Fit<M> {
    /// Checks that the settings are in their ranges, and that the module has parameters that can be fitted.
    pub(super) fn check(&self) -> Result<()> {
        Error::unless(self.seed < 1 << 24, "fit", "seed", self.seed, "below 2²⁴")?;
        for (field, value) in [
            ("steps", self.steps),
            ("checkpoint_every", self.every),
            ("early_stop", self.patience.unwrap_or(1)),
            ("pictures", self.pictures.as_ref().map_or(1, |p| p.every)),
        ] {
            Error::unless(value > 0, "fit", field, value, "at least 1")?;
        }
        Error::unless_positive("fit", "clip", self.clip.unwrap_or(1.0))?;
        let decay = self.average.as_ref().map_or(0.0, |average| average.decay);
        let valid = (0.0..1.0).contains(&decay);
        Error::unless(valid, "fit", "average", decay, "at least 0 and below 1")?;
        self.rate.check()?;
        self.rates.iter().try_for_each(|(_, rate)| rate.check())?;
        check_parameters(&self.module)
    }
}

/// A parameter of a module.
pub(super) struct ParameterInfo {
    pub id: ParamId,
    pub path: String,
    /// The device, if it does not record gradients.
    plain: Option<Device>,
    frozen: bool,
    /// The sum of the squares of the gradient's entries, if the parameter has a gradient.
    square: Option<f64>,
}

/// Collects the parameters of a module.
struct Parameters<'a> {
    gradients: &'a GradientsParams,
    path: Vec<String>,
    parameters: Result<Vec<ParameterInfo>>,
}

impl ModuleVisitor for Parameters<'_> {
    fn enter_module(&mut self, name: &str, _container_type: &str) {
        self.path.push(name.into());
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let Ok(parameters) = &mut self.parameters else {
            return;
        };
        let gradient = self.gradients.get::<D>(param.id);
        match gradient.map(|g| host_values(&g)).transpose() {
            Ok(gradient) => {
                let (tensor, path) = (param.base(), self.path.join("."));
                let records = tensor.is_autodiff();
                parameters.push(ParameterInfo {
                    id: param.id,
                    path,
                    plain: (!records).then(|| tensor.device()),
                    frozen: records && !tensor.is_require_grad(),
                    square: gradient.map(|g| g.iter().map(|x| x * x).sum()),
                });
            }
            Err(error) => self.parameters = Err(error),
        }
    }
}

impl ParameterInfo {
    /// Whether the fit may change it.
    pub fn is_trained(&self) -> bool {
        self.plain.is_none() && !self.frozen
    }
}

/// Returns the parameters of a module, and the squares of their gradients.
pub(super) fn parameters<M: Module>(
    module: &M,
    gradients: &GradientsParams,
) -> Result<Vec<ParameterInfo>> {
    let mut visitor = Parameters {
        gradients,
        path: Vec::new(),
        parameters: Ok(Vec::new()),
    };
    module.visit(&mut visitor);
    visitor.parameters
}

/// Checks that a module has a parameter that records gradients.
fn check_parameters<M: Module>(module: &M) -> Result<()> {
    let parameters = parameters(module, &GradientsParams::new())?;
    if parameters.iter().any(ParameterInfo::is_trained) {
        return Ok(());
    }
    let plain = parameters.iter().find_map(|p| Some((p, p.plain.as_ref()?)));
    Err(match (plain, parameters.first()) {
        (Some((p, device)), _) => invalid(
            format!("device of the parameter {}", p.path),
            format!("{device:?}, which records no gradients"),
            "one with autodiff: make the module on device.autodiff()",
        ),
        (None, Some(p)) => invalid(
            "module",
            format!("frozen, {} as all of its parameters", p.path),
            "a parameter that requires a gradient",
        ),
        (None, None) => invalid("module", "without parameters", "at least one of floats"),
    })
}

/// Scales gradients so that their Euclidean norm is at most `most`. Returns the norm before scaling, if there
/// are gradients, and the paths of parameters that are not frozen but have no gradient.
pub(super) fn clip<M: Module>(
    module: &M,
    gradients: &mut GradientsParams,
    most: Option<f64>,
) -> Result<(Option<f64>, Vec<String>)> {
    let parameters = parameters(module, gradients)?;
    let squares = parameters.iter().filter_map(|p| p.square);
    let norm = squares.reduce(|a, b| a + b).map(f64::sqrt);
    if let (Some(norm), Some(most)) = (norm, most)
        && norm > most
        && norm.is_finite()
    {
        let factor = most / norm;
        module.visit(&mut Scale { gradients, factor });
    }
    let missing = parameters.into_iter();
    let missing = missing.filter(|p| p.square.is_none() && !p.frozen);
    Ok((norm, missing.map(|p| p.path).collect()))
}

struct Scale<'a> {
    gradients: &'a mut GradientsParams,
    factor: f64,
}

impl ModuleVisitor for Scale<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if let Some(gradient) = self.gradients.remove::<D>(param.id) {
            self.gradients.register(param.id, gradient * self.factor);
        }
    }
}

/// Returns the loss as a number; an error if it is not a finite number in an autodiff graph.
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

/// Returns the error for a loss whose graph contains no parameter.
pub(super) fn no_gradient<M: Module>(module: &M, loss: &Tensor<1>) -> Error {
    let (device, devices) = (loss.device(), module.devices());
    if devices.iter().all(|d| *d != device) {
        let name = |d: &Device| format!("{} ({d:?})", label(d));
        let devices: Vec<String> = devices.iter().map(name).collect();
        return invalid(
            "device of the loss",
            name(&device),
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
