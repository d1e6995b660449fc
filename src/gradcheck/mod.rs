//! Gradient checks. [`gradcheck`] compares autodiff with central differences of renders of the caller's scene, with
//! standard errors.
//!
//! By the fundamental theorem of calculus, the difference f(x + h) − f(x − h) is the integral of f′ between both ends. So
//! the gradient is rendered at random points of this interval, and its mean equals the difference for any h, also where f
//! has kinks. Differences of Monte Carlo renders have much noise at small steps; at large steps they have little. Of
//! several parameters the interval is a box, in which all of them vary at once.

mod parameter;
mod report;
mod run;
mod settings;
mod weights;

use crate::error::{Error, Result, one_of};
use crate::scene::{Camera, Normalization, Scene};

pub use parameter::{Checked, Point};
pub use report::{Estimate, Report, Row, Verdict};
use run::{Direction, Run, point};
pub use settings::GradCheck;

/// Compares gradients by autodiff with central differences of renders, both in the mean over a box of parameters.
///
/// `build` makes the scene and the camera from the parameters. It runs for every render, on several threads on a CPU.
/// The bounds of the scene are fixed to those of the options if set, and to the initial scene's otherwise.
///
/// ```
/// use softray::gradcheck::{Checked, GradCheck, Verdict, gradcheck};
/// use softray::prelude::*;
///
/// let options = RenderOptions::new(8, 8).with_samples(4).with_bounces(0);
/// let settings = GradCheck::new(options, &Device::flex()).with_precision(0.1).with_seeds(16, 256);
/// let parameters = [Checked::new("albedo", [0.5], 0.05)];
/// let report = gradcheck(&parameters, &settings, |point| {
///     let ball = shapes::icosahedron(&point.device).cast(point.dtype);
///     let albedo = point.get("albedo")?.expand([3]);
///     let scene = Scene::new()
///         .with_object(Object::new(ball).with_material(Material::diffuse(albedo)))
///         .with_environment([1.0; 3]);
///     Ok((scene, Camera::look_at([0.0, 0.0, 4.0], [0.0; 3])))
/// })?;
/// println!("{report}");
/// let row = &report.rows[0];
/// println!("{}: apart by {} ± {}", row.parameter, row.apart.mean, row.apart.error);
/// assert_eq!(row.verdict, Verdict::Agrees);
/// assert!(report.agrees());
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If parameters or their names are not valid, `build` fails, the scene can't be rendered, or the objective does not
/// depend on the checked parameters.
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
    let (host, context) = scene.read_back()?;
    camera.check(Some(&context))?;
    let normalization = Normalization::new(&host);
    let run = Run {
        parameters,
        settings,
        options: settings.options.clone().normalization_or(normalization),
        build: &build,
    };
    let mut directions = Vec::new();
    for (parameter, p) in parameters.iter().enumerate() {
        if settings.checks(p) {
            let all = p.directions().into_iter();
            directions.extend(all.map(|(name, vector)| Direction {
                parameter,
                name,
                vector,
            }));
        }
    }
    let objective = match &settings.objective {
        Some(objective) => objective.clone(),
        None => run.weighted_mean(&directions)?,
    };
    let rows = run.rows(&directions, &objective)?;
    Ok(Report { rows })
}

/// Checks that there are parameters, that their names are unique, and that `only` lists some of them.
fn check_names(parameters: &[Checked], settings: &GradCheck) -> Result<()> {
    let unless = |valid, field: &str, value: &str, expected: &str| {
        Error::unless(valid, "gradcheck", field, value, expected)
    };
    unless(
        !parameters.is_empty(),
        "parameters",
        "empty",
        "at least one",
    )?;
    let names: Vec<&str> = parameters.iter().map(|p| p.name.as_str()).collect();
    for (i, name) in names.iter().enumerate() {
        let (once, expected) = (!names[..i].contains(name), "a name of its own for each");
        unless(
            once,
            "name of two parameters",
            &format!("{name:?}"),
            expected,
        )?;
    }
    let Some(only) = &settings.only else {
        return Ok(());
    };
    let known = one_of(names.iter().copied());
    unless(!only.is_empty(), "only", "empty", &known)?;
    only.iter().try_for_each(|name| {
        let found = format!("{name:?}");
        unless(
            names.contains(&name.as_str()),
            "a name given to only",
            &found,
            &known,
        )
    })
}
