//! Is a gradient right? [`gradcheck`] compares autodiff with central differences of renders of the
//! same scene, with standard errors, on a scene of the caller's.

use std::fmt;
use std::sync::Arc;

use burn::tensor::{DType, Device, Tensor, TensorData};
use rayon::prelude::*;

use crate::debug::{numbers, tensor};
use crate::error::{Error, Result, one_of};
use crate::geometry::host_values;
use crate::render::{RenderOptions, is_cpu, render};
use crate::scene::{Camera, Flattened, Scene};

/// A parameter to check: a tensor `[C]`, component by component or along one direction.
#[derive(Clone)]
pub struct Checked {
    name: String,
    values: Vec<f64>,
    direction: Option<Vec<f64>>,
    step: f64,
}

impl Checked {
    /// By name, with its values and the step h of (f(x + h) − f(x − h))/2h, which is off by about
    /// h²·f'''/6: a few per cent of what the parameter means for the scene.
    pub fn new(name: impl Into<String>, values: impl Into<Vec<f64>>, step: f64) -> Self {
        Self {
            name: name.into(),
            values: values.into(),
            direction: None,
            step,
        }
    }

    /// Checks the derivative along one direction in place of each component's: for parameters
    /// with many, such as vertices.
    pub fn along(mut self, direction: impl Into<Vec<f64>>) -> Self {
        self.direction = Some(direction.into());
        self
    }

    /// The directions to check, by name.
    fn directions(&self) -> Vec<(String, Vec<f64>)> {
        let n = self.values.len();
        match &self.direction {
            Some(d) => vec![(self.name.clone(), d.clone())],
            None if n == 1 => vec![(self.name.clone(), vec![1.0])],
            None => (0..n)
                .map(|i| {
                    let axis = (0..n).map(|j| if i == j { 1.0 } else { 0.0 }).collect();
                    (format!("{}[{i}]", self.name), axis)
                })
                .collect(),
        }
    }

    fn check(&self) -> Result<()> {
        let invalid = |field: &str, value: String, expected: &str| {
            Err(Error::invalid(&self.name, field, value, expected))
        };
        if self.values.is_empty() || self.values.iter().any(|v| !v.is_finite()) {
            return invalid("values", format!("{:?}", self.values), "finite numbers");
        }
        if !(self.step.is_finite() && self.step > 0.0) {
            return invalid("step", self.step.to_string(), "a finite number > 0");
        }
        match &self.direction {
            Some(d) if d.len() != self.values.len() || d.iter().any(|v| !v.is_finite()) => invalid(
                "direction",
                format!("{d:?}"),
                "a finite number for each value",
            ),
            _ => Ok(()),
        }
    }
}

/// The parameters as tensors, handed to the closure that builds a scene.
#[derive(Clone)]
pub struct Point {
    /// Where the scene has to be.
    pub device: Device,
    /// The float type that all of the scene's tensors need: see [`Mesh::cast`](crate::scene::Mesh::cast).
    pub dtype: DType,
    tensors: Vec<(String, Tensor<1>)>,
}

impl Point {
    /// A parameter `[C]`, in the graph where autodiff is asked.
    ///
    /// # Errors
    /// If there is none of that name.
    pub fn get(&self, name: &str) -> Result<Tensor<1>> {
        let found = self.tensors.iter().find(|(n, _)| n == name);
        found.map(|(_, t)| t.clone()).ok_or_else(|| {
            let names = one_of(self.tensors.iter().map(|(n, _)| n.as_str()));
            Error::invalid("gradcheck", "parameter", format!("{name:?}"), names)
        })
    }
}

/// What is differentiated: a scalar `[1]` of the radiance `[H, W, 3]`.
pub type Objective = Arc<dyn Fn(Tensor<3>) -> Tensor<1> + Send + Sync>;

/// How [`gradcheck`] goes about it.
#[derive(Clone)]
pub struct GradCheck {
    options: RenderOptions,
    device: Device,
    dtype: DType,
    precision: f64,
    tolerance: f64,
    negligible: f64,
    least: u64,
    budget: u64,
    objective: Objective,
    only: Option<Vec<String>>,
}

impl GradCheck {
    /// With the settings of each render, whose seed is replaced. On a CPU backend in f64, else in
    /// f32. The objective is the mean radiance under weights that rise across the image, so that
    /// no symmetry cancels.
    pub fn new(options: RenderOptions, device: &Device) -> Self {
        let device = device.clone().inner();
        let dtype = if is_cpu(&device) {
            DType::F64
        } else {
            DType::F32
        };
        Self {
            options,
            device,
            dtype,
            precision: 0.01,
            tolerance: 0.03,
            negligible: 0.0,
            least: 32,
            budget: 4096,
            only: None,
            objective: Arc::new(|radiance| {
                let [h, w, _] = radiance.dims();
                let weights: Vec<f32> = (0..h * w)
                    .map(|i| {
                        0.5 + ((i % w) as f32 + 0.5) / w as f32 + 0.5 * (i / w) as f32 / h as f32
                    })
                    .collect();
                let device = radiance.device().inner();
                let weights = Tensor::<1>::from_floats(weights.as_slice(), &device)
                    .cast(radiance.dtype())
                    .reshape([h, w, 1]);
                (radiance * weights).mean()
            }),
        }
    }

    /// The float type of all tensors.
    pub fn dtype(mut self, dtype: DType) -> Self {
        self.dtype = dtype;
        self
    }

    /// Renders are added until both standard errors are under this share of the difference
    /// (1 % by default).
    pub fn precision(mut self, share: f64) -> Self {
        self.precision = share;
        self
    }

    /// A disagreement is more than 3.5 standard errors and more than this share of the difference,
    /// which is what steps of a finite size may be off by (3 % by default).
    pub fn tolerance(mut self, share: f64) -> Self {
        self.tolerance = share;
        self
    }

    /// Derivatives whose standard errors are under this are precise enough, whatever their value:
    /// for parameters that change nothing.
    pub fn negligible(mut self, absolute: f64) -> Self {
        self.negligible = absolute;
        self
    }

    /// The least and the most seeds for each side: a gradient takes one render a seed, a
    /// difference two (32 and 4,096 by default).
    pub fn seeds(mut self, least: u64, most: u64) -> Self {
        self.least = least.max(2);
        self.budget = most.max(least).max(2);
        self
    }

    /// Checks only the parameters of these names; the scene gets all, the others as constants.
    pub fn only(mut self, names: &[&str]) -> Self {
        self.only = Some(names.iter().map(|n| (*n).to_owned()).collect());
        self
    }

    fn checks(&self, p: &Checked) -> bool {
        self.only
            .as_ref()
            .is_none_or(|names| names.contains(&p.name))
    }

    /// What is differentiated.
    pub fn objective(mut self, f: impl Fn(Tensor<3>) -> Tensor<1> + Send + Sync + 'static) -> Self {
        self.objective = Arc::new(f);
        self
    }
}

/// A mean over seeds with its standard error.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    /// The mean.
    pub mean: f64,
    /// Its standard error.
    pub error: f64,
    /// How many seeds.
    pub seeds: u64,
}

impl Estimate {
    fn of(values: &[f64]) -> Self {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        Self {
            mean,
            error: (squares / (n - 1.0) / n).sqrt(),
            seeds: values.len() as u64,
        }
    }
}

/// What a comparison says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Precise, and the same.
    Agrees,
    /// Not the same.
    Disagrees,
    /// Not told apart, but the budget was spent before the standard errors were small enough.
    Undecided,
}

/// One derivative by both ways.
#[derive(Clone, Debug)]
pub struct Row {
    /// The parameter, with the component where it has several.
    pub parameter: String,
    /// By autodiff.
    pub gradient: Estimate,
    /// By central differences.
    pub difference: Estimate,
    /// What to make of it.
    pub verdict: Verdict,
}

impl Row {
    /// gradient/difference − 1.
    pub fn relative(&self) -> f64 {
        self.gradient.mean / self.difference.mean - 1.0
    }

    /// |gradient − difference| in standard errors of both.
    pub fn standard_errors(&self) -> f64 {
        let apart = (self.gradient.mean - self.difference.mean).abs();
        let error = self.gradient.error.hypot(self.difference.error);
        if apart == 0.0 { 0.0 } else { apart / error }
    }
}

/// What [`gradcheck`] found; prints as a table.
#[derive(Clone, Debug)]
pub struct Report {
    /// One row for each derivative.
    pub rows: Vec<Row>,
}

impl Report {
    /// Whether every row agrees.
    pub fn agrees(&self) -> bool {
        self.rows.iter().all(|r| r.verdict == Verdict::Agrees)
    }

    /// The mean of |gradient/difference − 1| over derivatives that are not 0.
    pub fn mean_relative_error(&self) -> f64 {
        let errors: Vec<f64> = self
            .rows
            .iter()
            .filter(|r| r.difference.mean != 0.0)
            .map(|r| r.relative().abs())
            .collect();
        errors.iter().sum::<f64>() / errors.len().max(1) as f64
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.rows.iter().map(|r| r.parameter.chars().count());
        let width = width.max().unwrap_or(0).max(9);
        writeln!(
            f,
            "{:width$}  {:>24}  {:>24}  {:>9}  {:>6}  {:>13}  verdict",
            "parameter", "gradient", "difference", "relative", "errors", "seeds"
        )?;
        for r in &self.rows {
            let side = |e: &Estimate| format!("{:.5e} ± {:.1e}", e.mean, e.error);
            writeln!(
                f,
                "{:width$}  {:>24}  {:>24}  {:>+8.2} %  {:>6.1}  {:>13}  {}",
                r.parameter,
                side(&r.gradient),
                side(&r.difference),
                100.0 * r.relative(),
                r.standard_errors(),
                format!("{}, {}", r.gradient.seeds, r.difference.seeds),
                match r.verdict {
                    Verdict::Agrees => "agrees",
                    Verdict::Disagrees => "DISAGREES",
                    Verdict::Undecided => "undecided: budget spent",
                }
            )?;
        }
        Ok(())
    }
}

/// Compares autodiff with central differences of renders. `build` makes scene and camera from the
/// parameters; it is called for every render, from several threads on a CPU. The bounds of the scene
/// are held fixed: at those of the options, or else of the scene itself.
///
/// ```
/// use softray::gradcheck::{Checked, GradCheck, gradcheck};
/// use softray::prelude::*;
///
/// let options = RenderOptions::new(8, 8).samples(4).bounces(0);
/// let settings = GradCheck::new(options, &Device::flex()).precision(0.1).seeds(16, 256);
/// let parameters = [Checked::new("albedo", [0.5], 0.05)];
/// let report = gradcheck(&parameters, &settings, |point| {
///     let ball = shapes::icosahedron(&point.device).cast(point.dtype);
///     let albedo = point.get("albedo")?.expand([3]);
///     let scene = Scene::new()
///         .with(Object::new(ball).material(Material::diffuse(albedo)))
///         .environment([1.0; 3]);
///     Ok((scene, Camera::look_at([0.0, 0.0, 4.0], [0.0; 3])))
/// })?;
/// println!("{report}");
/// assert!(report.agrees());
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If a parameter is malformed, the scene can't be rendered, or it does not depend on a parameter.
pub fn gradcheck(
    parameters: &[Checked],
    settings: &GradCheck,
    build: impl Fn(&Point) -> Result<(Scene, Camera)> + Sync,
) -> Result<Report> {
    check_names(parameters, settings)?;
    for p in parameters {
        p.check()?;
    }
    let values: Vec<Vec<f64>> = parameters.iter().map(|p| p.values.clone()).collect();
    let (scene, camera) = build(&point(parameters, settings, &values, false))?;
    let normalization = Flattened::new(&scene, &camera, None)?.normalization;
    let run = Run {
        parameters,
        settings,
        options: settings.options.clone().normalization_or(normalization),
        build: &build,
    };
    let directions: Vec<(usize, String, Vec<f64>)> = parameters
        .iter()
        .enumerate()
        .filter(|(_, p)| settings.checks(p))
        .flat_map(|(i, p)| p.directions().into_iter().map(move |(n, d)| (i, n, d)))
        .collect();
    let differences = directions
        .iter()
        .map(|(i, _, d)| run.difference(*i, d))
        .collect::<Result<Vec<_>>>()?;
    let gradients = run.gradients(&directions, &differences)?;
    let rows = directions
        .into_iter()
        .zip(gradients.into_iter().zip(differences))
        .map(|((_, parameter, _), (gradient, difference))| Row {
            verdict: settings.verdict(gradient, difference),
            parameter,
            gradient,
            difference,
        });
    Ok(Report {
        rows: rows.collect(),
    })
}

/// That there is something to check, under names that tell parameters apart.
fn check_names(parameters: &[Checked], settings: &GradCheck) -> Result<()> {
    let invalid = |field, value: &str, expected: String| {
        Err(Error::invalid(
            "gradcheck",
            field,
            format!("{value:?}"),
            expected,
        ))
    };
    let names = || parameters.iter().map(|p| p.name.as_str());
    if parameters.is_empty() {
        return Err(Error::invalid(
            "gradcheck",
            "parameters",
            "empty",
            "at least one",
        ));
    }
    if let Some((_, twice)) = names()
        .enumerate()
        .find(|&(i, n)| names().take(i).any(|m| m == n))
    {
        return invalid(
            "name of two parameters",
            twice,
            "a name of its own for each".into(),
        );
    }
    let only = settings.only.as_deref().unwrap_or_default();
    match only.iter().find(|n| names().all(|m| m != n.as_str())) {
        Some(unknown) => invalid("a name given to only", unknown, one_of(names())),
        None if settings.only.is_some() && only.is_empty() => Err(Error::invalid(
            "gradcheck",
            "only",
            "empty",
            one_of(names()),
        )),
        None => Ok(()),
    }
}

impl fmt::Debug for Checked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut all = f.debug_struct("Checked");
        all.field("name", &self.name)
            .field("values", &numbers(self.values.iter().copied()))
            .field("step", &self.step);
        if let Some(direction) = &self.direction {
            all.field("direction", &numbers(direction.iter().copied()));
        }
        all.finish()
    }
}

impl fmt::Debug for Point {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tensors = self.tensors.iter().map(|(name, t)| (name, tensor(t)));
        f.debug_map().entries(tensors).finish()
    }
}

impl GradCheck {
    fn precise(&self, e: Estimate, value: f64) -> bool {
        e.error <= self.precision * value.abs() || e.error <= self.negligible
    }

    fn verdict(&self, g: Estimate, d: Estimate) -> Verdict {
        let apart = (g.mean - d.mean).abs();
        let error = g.error.hypot(d.error);
        let tolerated = self.tolerance * d.mean.abs() + self.negligible;
        if apart > 3.5 * error && apart > tolerated {
            Verdict::Disagrees
        } else if self.precise(g, d.mean) && self.precise(d, d.mean) {
            Verdict::Agrees
        } else {
            Verdict::Undecided
        }
    }
}

fn point(parameters: &[Checked], settings: &GradCheck, values: &[Vec<f64>], track: bool) -> Point {
    let tensors = parameters.iter().zip(values).map(|(p, v)| {
        let data = TensorData::new(v.clone(), [v.len()]);
        let t = Tensor::<1>::from_data(data, (&settings.device, settings.dtype));
        let t = if track && settings.checks(p) {
            t.autodiff().require_grad()
        } else {
            t
        };
        (p.name.clone(), t)
    });
    Point {
        device: settings.device.clone(),
        dtype: settings.dtype,
        tensors: tensors.collect(),
    }
}

struct Run<'a, F> {
    parameters: &'a [Checked],
    settings: &'a GradCheck,
    options: RenderOptions,
    build: &'a F,
}

/// Seeds of the differences begin here, so that both sides are independent.
const DIFFERENCES: u64 = 1 << 40;

impl<F: Fn(&Point) -> Result<(Scene, Camera)> + Sync> Run<'_, F> {
    fn objective(&self, point: &Point, seed: u64) -> Result<Tensor<1>> {
        let (scene, camera) = (self.build)(point)?;
        let image = render(&scene, &camera, &self.options.clone().seed(seed))?;
        Ok((self.settings.objective)(image.radiance))
    }

    fn values(&self) -> Vec<Vec<f64>> {
        self.parameters.iter().map(|p| p.values.clone()).collect()
    }

    /// A function of some seeds, on all cores where that helps.
    fn over<T: Send>(
        &self,
        seeds: std::ops::Range<u64>,
        f: impl Fn(u64) -> Result<T> + Sync,
    ) -> Result<Vec<T>> {
        if is_cpu(&self.settings.device) {
            seeds.into_par_iter().map(&f).collect()
        } else {
            seeds.map(f).collect()
        }
    }

    /// Estimates columns of values by seed, adding seeds until all are precise.
    fn estimate(
        &self,
        columns: usize,
        first: u64,
        f: impl Fn(u64) -> Result<Vec<f64>> + Sync,
        value: impl Fn(usize, &Estimate) -> f64,
    ) -> Result<Vec<Estimate>> {
        let mut found: Vec<Vec<f64>> = Vec::new();
        let mut wanted = self.settings.least;
        loop {
            let seeds = first + found.len() as u64..first + wanted;
            found.extend(self.over(seeds, &f)?);
            let estimates: Vec<Estimate> = (0..columns)
                .map(|c| Estimate::of(&found.iter().map(|v| v[c]).collect::<Vec<_>>()))
                .collect();
            let n = found.len() as u64;
            // How many times the seeds the noisiest needs.
            let factor = estimates
                .iter()
                .enumerate()
                .filter(|(c, e)| !self.settings.precise(**e, value(*c, e)))
                .map(|(c, e)| {
                    let goal = self.settings.precision * value(c, e).abs();
                    (e.error / goal.max(self.settings.negligible)).powi(2)
                })
                .fold(1.0f64, f64::max);
            if factor <= 1.0 || n >= self.settings.budget {
                return Ok(estimates);
            }
            let more = (1.1 * factor).min(8.0) * n as f64;
            wanted = (more.ceil() as u64).min(self.settings.budget);
        }
    }

    fn difference(&self, parameter: usize, direction: &[f64]) -> Result<Estimate> {
        let step = self.parameters[parameter].step;
        let at = |sign: f64, seed: u64| -> Result<f64> {
            let mut values = self.values();
            for (v, d) in values[parameter].iter_mut().zip(direction) {
                *v += sign * step * d;
            }
            let point = point(self.parameters, self.settings, &values, false);
            Ok(host_values(&self.objective(&point, seed)?)?[0])
        };
        let one = |seed| Ok(vec![(at(1.0, seed)? - at(-1.0, seed)?) / (2.0 * step)]);
        Ok(self.estimate(1, DIFFERENCES, one, |_, e| e.mean)?[0])
    }

    fn gradients(
        &self,
        directions: &[(usize, String, Vec<f64>)],
        differences: &[Estimate],
    ) -> Result<Vec<Estimate>> {
        let one = |seed| -> Result<Vec<f64>> {
            let point = point(self.parameters, self.settings, &self.values(), true);
            let objective = self.objective(&point, seed)?;
            if !objective.is_tracked() {
                return Err(Error::invalid(
                    "gradcheck",
                    "objective",
                    "a constant",
                    "a scene that depends on the parameters",
                ));
            }
            let gradients = objective.backward();
            let found = point
                .tensors
                .iter()
                .map(|(_, t)| match t.grad(&gradients) {
                    Some(g) => host_values(&g),
                    None => Ok(vec![0.0; t.dims()[0]]),
                })
                .collect::<Result<Vec<_>>>()?;
            let along = |(i, _, d): &(usize, String, Vec<f64>)| -> f64 {
                found[*i].iter().zip(d).map(|(g, d)| g * d).sum()
            };
            Ok(directions.iter().map(along).collect())
        };
        self.estimate(directions.len(), 0, one, |c, _| differences[c].mean)
    }
}
