//! What the curves say, as Markdown: how much longer a setting takes than the base to the same
//! error.

use crate::settings::{Axis, Setting};
use crate::table::{Column, Row};

/// Seconds and error.
pub type Point = (f64, f64);

/// The points that no other one is both faster and more exact than, by time.
pub fn front(points: &[Point]) -> Vec<Point> {
    let mut sorted: Vec<Point> = points
        .iter()
        .copied()
        .filter(|p| p.0 > 0.0 && p.1 > 0.0 && p.1.is_finite())
        .collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut best = f64::INFINITY;
    sorted.retain(|p| {
        let better = p.1 < best;
        best = best.min(p.1);
        better
    });
    sorted
}

/// The time at which a front reaches an error, on straight lines between its points with both axes
/// logarithmic: errors fall with a power of the time, so the lines are nearly those of the curve.
fn time_to(front: &[Point], error: f64) -> Option<f64> {
    let last = front.last()?;
    if error == last.1 {
        return Some(last.0);
    }
    front.windows(2).find_map(|w| {
        let ((t0, e0), (t1, e1)) = (w[0], w[1]);
        (e1..=e0).contains(&error).then(|| {
            let share = (error / e0).ln() / (e1 / e0).ln();
            (t0.ln() + share * (t1 / t0).ln()).exp()
        })
    })
}

/// How many times as long one takes as another to the same error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ratio {
    /// At the smallest error that both reach, and the geometric mean over all errors that both
    /// have, evenly in their logarithm.
    Both { smallest: f64, mean: f64 },
    /// The other begins with a smaller error than this one ends with: at least so many times.
    Least(f64),
    /// This one begins with a smaller error than the other ends with: at most so many times.
    Most(f64),
    /// Not measured.
    Unknown,
}

/// The times of `slow` over those of `base` to the same error.
pub fn ratio(slow: &[Point], base: &[Point]) -> Ratio {
    const LEVELS: usize = 33;
    let (slow, base) = (front(slow), front(base));
    let (Some(first), Some(last)) = (slow.first(), slow.last()) else {
        return Ratio::Unknown;
    };
    let (Some(base_first), Some(base_last)) = (base.first(), base.last()) else {
        return Ratio::Unknown;
    };
    if base_first.1 < last.1 {
        return Ratio::Least(last.0 / base_first.0);
    }
    if first.1 < base_last.1 {
        return Ratio::Most(first.0 / base_last.0);
    }
    let at = |error: f64| Some(time_to(&slow, error)? / time_to(&base, error)?);
    let (low, high) = (last.1.max(base_last.1), first.1.min(base_first.1));
    let logs: Vec<f64> = (0..LEVELS)
        .filter_map(|i| {
            let share = i as f64 / (LEVELS - 1) as f64;
            at(low * (high / low).powf(share)).map(f64::ln)
        })
        .collect();
    match at(low) {
        Some(smallest) => Ratio::Both {
            smallest,
            mean: (logs.iter().sum::<f64>() / logs.len() as f64).exp(),
        },
        None => Ratio::Unknown,
    }
}

impl std::fmt::Display for Ratio {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Both { smallest, mean } => write!(f, "{smallest:.2} ({mean:.2})"),
            Self::Least(r) => write!(f, "> {r:.2}"),
            Self::Most(r) => write!(f, "< {r:.2}"),
            Self::Unknown => f.write_str("–"),
        }
    }
}

/// The curve of a setting in a scene.
pub fn curve(
    rows: &[Row],
    scene: &str,
    setting: &Setting,
    time: Column,
    error: Column,
) -> Vec<Point> {
    let points = rows
        .iter()
        .filter(|r| r.size.scene == scene && r.setting == *setting);
    points
        .map(|r| (r.values.get(time), r.values.get(error)))
        .collect()
}

/// The scenes of a table in order.
pub fn scenes(rows: &[Row]) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    for r in rows {
        if !all.contains(&r.size.scene) {
            all.push(r.size.scene.clone());
        }
    }
    all
}

/// The settings of a scene in order.
pub fn settings<'a>(rows: &'a [Row], scene: &str) -> Vec<&'a Setting> {
    let mut all: Vec<&Setting> = Vec::new();
    for r in rows.iter().filter(|r| r.size.scene == scene) {
        if !all.contains(&&r.setting) {
            all.push(&r.setting);
        }
    }
    all
}

/// The tables.
pub fn markdown(rows: &[Row], base: &Setting) -> String {
    let mut text = String::new();
    text += &to_the_same_error(rows, base);
    text += &at_most_samples(rows, base);
    text
}

/// Settings that converge to the same image and gradient as the base.
fn to_the_same_error(rows: &[Row], base: &Setting) -> String {
    let mut text = format!(
        "### Time to the same error, in times of the base\n\n\
         Base: {}. Errors are those against the converged image and gradient of the same blurred \
         scene, so noise; times are of forward passes for images and forward + backward for \
         gradients. Each is the ratio at the smallest error that both reach, by log-log \
         interpolation of the measured curves, and in brackets the geometric mean over all errors \
         that both have; > or < where the curves have no error in common.\n\n\
         | scene | setting | same RMSE | same gradient error | same translation gradient error |\n\
         |---|---|---|---|---|\n",
        base.label(base).trim_start_matches("base: ")
    );
    for scene in scenes(rows) {
        for setting in settings(rows, &scene) {
            if setting == base || !setting.same_limit(base) {
                continue;
            }
            let ratio = |time, error| {
                ratio(
                    &curve(rows, &scene, setting, time, error),
                    &curve(rows, &scene, base, time, error),
                )
            };
            text += &format!(
                "| {scene} | {} | {} | {} | {} |\n",
                setting.label(base),
                ratio(Column::Forward, Column::BlurredRmse),
                ratio(Column::ForwardBackward, Column::BlurredGradient),
                ratio(Column::ForwardBackward, Column::BlurredTranslation),
            );
        }
    }
    text + "\n"
}

/// What blur and cutoff cost in exactness: σ, forms and cutoffs at the most samples.
fn at_most_samples(rows: &[Row], base: &Setting) -> String {
    let mut text = "### Against the scene without blur, at the most samples\n\n\
         In brackets what the same blurred scene converges to; noise is the standard error of the \
         converged gradient and of the differences that it is compared with.\n\n\
         | scene | setting | samples | forward, s | forward + backward, s | RMSE | bias | gradient \
         error | translation gradient error | cosine | noise | peak, MiB |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|\n"
        .to_owned();
    for scene in scenes(rows) {
        for setting in settings(rows, &scene) {
            let axis = setting.axis(base);
            if setting != base && !matches!(axis, Some(Axis::Sigma | Axis::Form | Axis::Cutoff)) {
                continue;
            }
            let of = rows
                .iter()
                .filter(|r| r.size.scene == scene && r.setting == *setting);
            let Some(r) = of.max_by_key(|r| r.samples) else {
                continue;
            };
            let v = |c: Column| r.values.get(c);
            let peak = match v(Column::Peak) {
                peak if peak.is_nan() => "–".to_owned(),
                peak => format!("{peak:.0}"),
            };
            text += &format!(
                "| {scene} | {} | {} | {:.3} | {:.3} | {:.4} ({:.4}) | {:+.4} | {:.3} ({:.3}) | {:.3} ({:.3}) | {:.3} | {:.3}, {:.3} | {peak} |\n",
                setting.label(base),
                r.samples,
                v(Column::Forward),
                v(Column::ForwardBackward),
                v(Column::UnblurredRmse),
                v(Column::LimitRmse),
                v(Column::UnblurredBias),
                v(Column::UnblurredGradient),
                v(Column::LimitGradient),
                v(Column::UnblurredTranslation),
                v(Column::LimitTranslation),
                v(Column::UnblurredCosine),
                v(Column::GradientNoise),
                v(Column::DifferenceNoise),
            );
        }
    }
    text
}
