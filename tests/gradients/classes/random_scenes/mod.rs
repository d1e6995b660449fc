//! Random scenes over all that a scene may be made of, and their gradients beside central differences.

mod bodies;
mod maker;

use burn::tensor::Device;
use softray::gradcheck::{Checked, GradCheck, Row, Verdict, gradcheck};

use crate::common::numbers::noise;
pub use maker::RandomScene;

/// Parameters of a scene that are differentiated.
const PARAMETERS: usize = 4;

/// The outcome of some scenes: the number of derivatives that are not 0, and those of them that disagree or that noise
/// leaves undecided.
#[derive(Default)]
pub struct Outcome {
    pub derivatives: usize,
    /// Of these, those whose comparison has a standard error of at most 5 %.
    pub known: usize,
    pub disagree: Vec<String>,
    pub undecided: Vec<String>,
}

/// Derivatives below this count as 0: a jump is a difference of two numbers in f32, over the angle of a cone.
const ROUNDING: f64 = 2e-6;
/// Compares derivatives of scenes with central differences. They disagree where they are more than 1 % and 3.5 standard
/// errors apart.
pub fn compare(scenes: &[RandomScene], precision: f64, renders: u64) -> Outcome {
    let mut outcome = Outcome::default();
    for scene in scenes {
        let seed = scene.seed;
        let start = std::time::Instant::now();
        println!("scene {seed}: {}", scene.description);
        let chosen = choose(scene, seed);
        for row in rows(scene, &chosen, precision, renders) {
            println!("  {}", line(&row));
            if is_zero(&row) {
                continue;
            }
            outcome.derivatives += 1;
            outcome.known += usize::from(row.apart.error <= 0.05 * row.difference.mean.abs());
            let list = match row.verdict {
                Verdict::Agrees => continue,
                Verdict::Disagrees => &mut outcome.disagree,
                Verdict::Undecided => &mut outcome.undecided,
            };
            list.push(format!("scene {seed}, {}", line(&row)));
        }
        println!("  {:.1} s", start.elapsed().as_secs_f64());
    }
    outcome
}

fn is_zero(row: &Row) -> bool {
    row.gradient.mean.abs().max(row.difference.mean.abs()) < ROUNDING
}

fn line(row: &Row) -> String {
    let error = row.apart.error / row.difference.mean.abs();
    format!(
        "{}: {:+.3e} ± {:.1} %, difference {:+.3e} ± {:.1} %, {:+.1} % ± {:.1} % {:?}, {} seeds",
        row.parameter,
        row.gradient.mean,
        100.0 * row.gradient.error / row.difference.mean.abs(),
        row.difference.mean,
        100.0 * row.difference.error / row.difference.mean.abs(),
        100.0 * row.relative(),
        100.0 * error,
        row.verdict,
        row.apart.seeds
    )
}

/// Parameters that most scenes have.
const COMMON: [&str; 6] = [
    "albedo",
    "roughness",
    "translation",
    "rotation",
    "scale",
    "camera: target",
];

/// Some of the parameters of a scene, rather those that few scenes have.
fn choose(scene: &RandomScene, seed: u64) -> Vec<&str> {
    let numbers = scene.numbers.iter().filter(|n| n.differentiable);
    let names: Vec<&str> = numbers.map(|n| n.name()).collect();
    let key = |(name, noise): (&&str, f64)| {
        let common = COMMON.iter().any(|common| name.ends_with(common));
        noise.abs() * if common { 3.0 } else { 1.0 }
    };
    let keys = names.iter().zip(noise(names.len(), seed ^ 0x5bd1_e995));
    let keys: Vec<f64> = keys.map(key).collect();
    let mut order: Vec<usize> = (0..names.len()).collect();
    order.sort_by(|&a, &b| keys[a].total_cmp(&keys[b]));
    order.iter().take(PARAMETERS).map(|&i| names[i]).collect()
}

/// Derivatives by parameters.
fn rows(scene: &RandomScene, names: &[&str], precision: f64, renders: u64) -> Vec<Row> {
    let numbers = scene.numbers.iter();
    let parameters: Vec<Checked> = numbers
        .map(|n| Checked::new(n.name(), [n.value], n.step))
        .collect();
    let settings = GradCheck::new(scene.options.clone(), &Device::flex())
        .with_precision(precision)
        .with_seeds(32, renders)
        .with_parameters(names);
    let report = gradcheck(&parameters, &settings, |point| Ok(scene.build(point)));
    report
        .unwrap_or_else(|e| panic!("{}: {e}", scene.description))
        .rows
}
