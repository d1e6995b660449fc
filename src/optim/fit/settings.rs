//! The settings that a checkpoint must have to resume from it, and groups of parameters.

use std::collections::HashMap;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param, ParamGroup, ParamId};
use burn::optim::{GradientsParams, ModuleOptimizer};
use burn::tensor::{Tensor, TensorData};

use super::check::{ParameterInfo, parameters};
use super::{Fit, Warning};
use crate::error::{Error, Result};
use crate::geometry::host_values;
use crate::optim::schedule::Blur;

/// The sizes of the gradients of the test steps of an optimizer.
const SLOPES: [f64; 3] = [1.0, 10.0, 0.3];
/// The learning rate of the test steps.
const RATE: f64 = 0.1;
/// The number of a parameter's entries whose changes identify its optimizer.
const ENTRIES: usize = 4;
/// What stands between the name and the value of a setting.
const IS: &str = " = ";
/// The largest number of settings in a message.
const MAX_NAMED: usize = 8;

impl<M: Module> Fit<M> {
    /// Returns the settings that must match a checkpoint's, as lines of a name and a value.
    pub(super) fn settings(&self) -> Result<String> {
        let parameters = parameters(&self.module, &GradientsParams::new())?;
        let group_rate = |p: &ParameterInfo| {
            let mut groups = self.rates.iter().rev();
            let (_, rate) = groups.find(|(group, _)| contains(group, p))?;
            Some(format!("{} {rate}", p.path))
        };
        let rates: Vec<String> = parameters.iter().filter_map(group_rate).collect();
        let blur = self.blur.as_ref().map_or("none".into(), Blur::to_string);
        let clip = self.clip.map_or("none".into(), |norm| norm.to_string());
        let mut settings = vec![
            ("seed".into(), self.seed.to_string()),
            ("rate".into(), self.rate.to_string()),
            ("groups' rates".into(), rates.join(", ")),
            ("blur".into(), blur),
            ("clip".into(), clip),
        ];
        if let Some(average) = &self.average {
            settings.push(("average".into(), average.decay.to_string()));
        }
        let changes = changes(&self.optimizer, &self.module)?;
        for p in parameters.iter().filter(|p| p.is_trained()) {
            let name = format!("optimizer of {} (test steps)", p.path);
            let changes = changes.get(&p.id).cloned().unwrap_or_default();
            settings.push((name, changes));
        }
        let line = |(name, value): &(String, String)| format!("{name}{IS}{value}\n");
        Ok(settings.iter().map(line).collect())
    }

    /// Returns a warning for each group with a rate that contains no parameter.
    pub(super) fn empty_groups(&self) -> Result<Vec<Warning>> {
        let parameters = parameters(&self.module, &GradientsParams::new())?;
        let groups = self.rates.iter().map(|(group, _)| group);
        let empty = groups.filter(|group| !parameters.iter().any(|p| contains(group, p)));
        let warning = |group: &ParamGroup| Warning::EmptyGroup {
            group: format!("{group:?}"),
            parameters: parameters.iter().map(|p| p.path.clone()).collect(),
        };
        Ok(empty.map(warning).collect())
    }
}

fn contains(group: &ParamGroup, p: &ParameterInfo) -> bool {
    group.matches(&p.id, Some(&p.path))
}

/// Checks that the settings of a checkpoint are those of this fit.
pub(super) fn check_settings(checkpoint: &str, there: &str, now: &str) -> Result<()> {
    let pairs = |text| -> Vec<(&str, &str)> {
        let lines = str::lines(text);
        lines.filter_map(|line| line.split_once(IS)).collect()
    };
    let (there, now) = (pairs(there), pairs(now));
    let gone = there.iter().filter(|a| now.iter().all(|b| a.0 != b.0));
    let differ: Vec<String> = now
        .iter()
        .chain(gone)
        .filter_map(|&(name, _)| {
            let of = |all: &[(&str, &str)]| {
                let setting = all.iter().find(|s| s.0 == name);
                setting.map_or("nothing".into(), |s| s.1.to_owned())
            };
            let (there, now) = (of(&there), of(&now));
            (there != now).then(|| format!("{name}: {there} there, {now} now"))
        })
        .collect();
    let mut named = differ[..differ.len().min(MAX_NAMED)].join("; ");
    if differ.len() > MAX_NAMED {
        named += &format!("; and {} more", differ.len() - MAX_NAMED);
    }
    Error::unless(
        differ.is_empty(),
        "fit",
        &format!("settings of the checkpoint {checkpoint}"),
        format!("those of another fit ({named})"),
        "the same: use these settings, use another folder, or start anew with Fit::with_restart(true)",
    )
}

/// Returns how far a few steps of an optimizer move the first entries of each trained parameter. Optimizers have no
/// names; this identifies them and their settings. Values and gradients depend only on the places of entries, so a
/// module with other values gives the same result.
fn changes<M: Module>(optimizer: &ModuleOptimizer, module: &M) -> Result<HashMap<ParamId, String>> {
    let mut optimizer = optimizer.clone();
    let start = module.clone().map(&mut Start);
    let mut moved = start.clone();
    for (step, size) in SLOPES.into_iter().enumerate() {
        let slope = |i: f64| size * (1.3 * i + step as f64 + 0.4).sin();
        let mut slopes = Slopes {
            slope: &slope,
            gradients: GradientsParams::new(),
        };
        moved.visit(&mut slopes);
        moved = optimizer.step(RATE, moved, slopes.gradients);
    }
    let (before, after) = (entries(&start)?, entries(&moved)?);
    let text = |(id, after): (ParamId, Vec<f64>)| {
        let pairs = after.iter().zip(&before[&id]);
        let changes: Vec<String> = pairs.map(|(a, b)| format!("{:.3e}", a - b)).collect();
        (id, changes.join(" "))
    };
    Ok(after.into_iter().map(text).collect())
}

/// Makes a tensor like another from a function of the places of entries, without autodiff.
fn filled<const D: usize>(like: &Tensor<D>, f: &dyn Fn(f64) -> f64) -> Tensor<D> {
    let (dims, device) = (like.dims(), like.device().inner());
    let values: Vec<f64> = (0..dims.iter().product())
        .map(|i: usize| f(i as f64))
        .collect();
    Tensor::from_data(TensorData::new(values, dims), (&device, like.dtype()))
}

/// Sets trained parameters to values that depend only on the places of entries.
struct Start;

impl ModuleMapper for Start {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        param.map(|tensor| match tensor.is_require_grad() {
            true => {
                let start = filled(&tensor, &|i| (0.7 * i + 0.2).cos());
                start.autodiff().require_grad()
            }
            false => tensor,
        })
    }
}

/// Makes gradients of trained parameters.
struct Slopes<'a> {
    slope: &'a dyn Fn(f64) -> f64,
    gradients: GradientsParams,
}

impl ModuleVisitor for Slopes<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let tensor = param.val();
        if tensor.is_require_grad() {
            self.gradients
                .register(param.id, filled(&tensor, self.slope));
        }
    }
}

/// Reads the first entries of trained parameters.
fn entries<M: Module>(module: &M) -> Result<HashMap<ParamId, Vec<f64>>> {
    struct Entries(Result<HashMap<ParamId, Vec<f64>>>);
    impl ModuleVisitor for Entries {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let tensor = param.val();
            let Ok(all) = &mut self.0 else {
                return;
            };
            if tensor.is_require_grad() {
                let count = tensor.dims().iter().product::<usize>();
                let first = tensor.reshape([count]).narrow(0, 0, count.min(ENTRIES));
                match host_values(&first) {
                    Ok(values) => _ = all.insert(param.id, values),
                    Err(error) => self.0 = Err(error),
                }
            }
        }
    }
    let mut entries = Entries(Ok(HashMap::new()));
    module.visit(&mut entries);
    entries.0
}
