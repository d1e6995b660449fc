//! Random scenes over all that a scene may be made of, and their gradients beside central differences.

mod bodies;
mod maker;

use burn::tensor::{Device, Tensor};
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
    pub disagree: Vec<String>,
    pub undecided: Vec<String>,
}

/// Derivatives below this count as 0: a jump is a difference of two numbers in f32, over the angle of a cone.
const ROUNDING: f64 = 2e-6;
/// Steps of differences, in parts of those of the scene, until two agree with each other.
const STEPS: [f64; 4] = [1.0, 0.25, 0.0625, 0.015625];

/// Compares derivatives of scenes with central differences by common random numbers. They disagree where they are
/// more than 2 % and 3.5 standard errors apart, and differences don't change with their steps. Where they do, as where
/// two faces are nearly in one plane, they are taken again with a fourth of the step and four times the renders.
pub fn compare(scenes: &[RandomScene], precision: f64, renders: u64) -> Outcome {
    let mut outcome = Outcome::default();
    for scene in scenes {
        let seed = scene.seed;
        println!("scene {seed}: {}", scene.description);
        let chosen = choose(scene, seed);
        for mut row in rows(scene, &chosen, STEPS[0], precision, renders) {
            for step in &STEPS[1..] {
                if row.verdict != Verdict::Disagrees || is_zero(&row) {
                    break;
                }
                println!("  first {}", line(&row));
                let before = row.difference;
                let again = rows(scene, &[&row.parameter], *step, precision, 4 * renders);
                row = again.into_iter().next().expect("its row");
                let moved = (before.mean - row.difference.mean).abs();
                if moved < 0.2 * (row.gradient.mean - row.difference.mean).abs() {
                    break;
                }
            }
            println!("  {}", line(&row));
            if is_zero(&row) {
                continue;
            }
            outcome.derivatives += 1;
            let list = match row.verdict {
                Verdict::Agrees => continue,
                Verdict::Disagrees => &mut outcome.disagree,
                Verdict::Undecided => &mut outcome.undecided,
            };
            list.push(format!("scene {seed}, {}", line(&row)));
        }
    }
    outcome
}

fn is_zero(row: &Row) -> bool {
    row.gradient.mean.abs().max(row.difference.mean.abs()) < ROUNDING
}

fn line(row: &Row) -> String {
    let error = row.apart.error / row.difference.mean.abs();
    format!(
        "{}: {:+.3e}, difference {:+.3e}, {:+.1} % ± {:.1} % {:?}",
        row.parameter,
        row.gradient.mean,
        row.difference.mean,
        100.0 * row.relative(),
        100.0 * error,
        row.verdict
    )
}

/// The mean radiance, counted most at a place beside the middle of the image, so that what moves has a derivative.
pub fn spot(image: Tensor<3>) -> Tensor<1> {
    let [h, w, _] = image.dims();
    let weights: Vec<f64> = (0..h * w)
        .map(|i| {
            let x = ((i % w) as f64 + 0.5) / w as f64 - 0.6;
            let y = ((i / w) as f64 + 0.5) / h as f64 - 0.45;
            0.2 + 2.0 * (-(x * x + y * y) / 0.03).exp()
        })
        .collect();
    let like = (&image.device().inner(), image.dtype());
    let weights = Tensor::<1>::from_data(weights.as_slice(), like).reshape([h, w, 1]);
    (image * weights).mean()
}

/// Some of the parameters of a scene.
fn choose(scene: &RandomScene, seed: u64) -> Vec<&str> {
    let numbers = scene.numbers.iter().filter(|n| n.differentiable);
    let names: Vec<&str> = numbers.map(|n| n.name()).collect();
    let keys = noise(names.len(), seed ^ 0x5bd1_e995);
    let mut order: Vec<usize> = (0..names.len()).collect();
    order.sort_by(|&a, &b| keys[a].total_cmp(&keys[b]));
    order.iter().take(PARAMETERS).map(|&i| names[i]).collect()
}

/// Derivatives by parameters, with steps that are times `step` those of the scene.
fn rows(scene: &RandomScene, names: &[&str], step: f64, precision: f64, renders: u64) -> Vec<Row> {
    let numbers = scene.numbers.iter();
    let parameters: Vec<Checked> = numbers
        .map(|n| Checked::new(n.name(), [n.value], n.step * step))
        .collect();
    let settings = GradCheck::new(scene.options.clone(), &Device::flex())
        .with_precision(precision)
        .with_tolerance(0.02)
        .with_seeds(16, renders)
        .with_objective(spot)
        .with_parameters(names);
    let report = gradcheck(&parameters, &settings, |point| Ok(scene.build(point)));
    report
        .unwrap_or_else(|e| panic!("{}: {e}", scene.description))
        .rows
}
