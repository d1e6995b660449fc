//! The weights of a ray's surfaces, what passes them, and the derivatives of both.

use super::finder::Finder;
use super::ray::{Span, Surface};
use crate::visibility::Softmax;

impl Finder<'_> {
    /// Sorts the surfaces of a ray by depth, sets their weights and drops those that are nothing;
    /// returns that of the background.
    pub fn weigh(&self, span: Span, found: &mut Vec<Surface>) -> f64 {
        let Softmax { gamma, epsilon, .. } = self.form;
        let score = |s: &Surface| (span.far - s.t) / (span.depth() * gamma);
        // Most rays meet one surface.
        if let [s] = &mut found[..]
            && s.log[0] + score(s) - epsilon / gamma > self.log_cutoff
        {
            s.weight = 1.0;
            return 0.0;
        }
        let background = softmax(
            found,
            score,
            epsilon / gamma,
            (self.cutoff, self.log_cutoff),
        );
        found.sort_unstable_by(|a, b| a.t.total_cmp(&b.t).then(a.triangle.cmp(&b.triangle)));
        background
    }
}

/// Drops surfaces, and the background, whose weights add up to less than `cutoff`, sets those of the
/// rest, and returns that of the background. `log_cutoff` is ln(10/cutoff).
fn softmax(
    all: &mut Vec<Surface>,
    score: impl Fn(&Surface) -> f64,
    background: f64,
    (cutoff, log_cutoff): (f64, f64),
) -> f64 {
    let full = |s: &Surface| s.log[0] + score(s);
    let largest = all.iter().map(full).fold(background, f64::max);
    let count = all.len() + 1;
    let least = largest
        - if count <= 10 {
            log_cutoff
        } else {
            (count as f64 / cutoff).ln()
        };
    let part = |score: f64| {
        if score < least {
            0.0
        } else {
            (score - largest).exp()
        }
    };
    let rest = part(background);
    let mut total = rest;
    all.retain_mut(|s| {
        s.weight = part(full(s));
        total += s.weight;
        s.weight > 0.0
    });
    all.iter_mut().for_each(|s| s.weight /= total);
    rest / total
}

/// The share of light that passes surfaces, ∏ (1 − p), and its derivatives by each p.
pub(super) fn passed(found: &[Surface], by_p: &mut Vec<f64>) -> f64 {
    let passed: f64 = found.iter().map(|s| 1.0 - s.p).product();
    by_p.clear();
    by_p.extend(found.iter().map(|s| -passed / (1.0 - s.p).max(1e-30)));
    passed
}

/// The weights of the surfaces of one ray, to be differentiated.
pub(super) struct WeightGradient<'a> {
    pub form: Softmax,
    pub surfaces: &'a [Surface],
    /// W of the background.
    pub background: f64,
    /// far − near.
    pub depth: f64,
    /// Whether the ray starts inside of the bounds: near = max(|o| − ρ, 0) is 0 and
    /// far = |o| + ρ.
    pub inside: bool,
}

impl WeightGradient<'_> {
    /// Derivatives of Σ v·W + v·W_background: calls `emit` with surfaces and their derivatives by logit
    /// and by t; returns that by far.
    pub fn backward(
        &self,
        values: &[f64],
        background: f64,
        mut emit: impl FnMut(&Surface, f64, f64),
    ) -> f64 {
        let surfaces = self.surfaces;
        // Shares under this are nothing beside the largest part of the sum.
        let parts = surfaces.iter().zip(values);
        let parts = parts.map(|(s, v)| (s.weight * v).abs());
        let tiny = 1e-12 * parts.fold((self.background * background).abs(), f64::max);
        let per_depth = 1.0 / self.depth / self.form.gamma;
        let weighted = surfaces.iter().zip(values).map(|(s, v)| s.weight * v);
        let mean = weighted.sum::<f64>() + self.background * background;
        let mut far = 0.0;
        for (s, v) in surfaces.iter().zip(values) {
            let share = (v - mean) * s.weight;
            let [_, by_logit, by_t] = s.log;
            if share.abs() > tiny {
                emit(s, share * by_logit, share * (by_t - per_depth));
            }
            // ∂z/∂far/γ: outside of the bounds only far − t depends on far, inside its divisor does
            // too.
            let kept = if self.inside { s.t / self.depth } else { 1.0 };
            far += share * kept * per_depth;
        }
        far
    }
}
