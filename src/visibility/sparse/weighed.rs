//! The weights of a ray's surfaces, what passes them, and the derivatives of both.

use super::finder::Finder;
use super::forms::{layered, pull, softened, softmax, through_all, through_layers};
use super::ray::{Span, Surface};
use crate::visibility::Visibility;
use crate::visibility::soft_pairs::SoftRay;

impl Finder<'_> {
    /// Sorts the surfaces from `first` on by depth, sets their weights and drops those that are
    /// nothing; returns that of the background.
    #[inline(always)]
    pub fn weigh(&self, span: Span, all: &mut Vec<Surface>, first: usize) -> f64 {
        // Most rays meet one surface, or one that hides all others.
        if let [s] = &mut all[first..] {
            match self.form {
                Visibility::Layered | Visibility::Cone { .. } => {
                    s.weight = s.p.min(1.0);
                    return 1.0 - s.weight;
                }
                Visibility::Softmax { gamma, epsilon } => {
                    let z = (span.far - s.t) / span.depth();
                    if s.log[0] + (z - epsilon) / gamma > self.nats {
                        s.weight = 1.0;
                        return 0.0;
                    }
                }
                Visibility::LayeredSoft { .. } => {
                    let room = 1.0 - s.p;
                    let background = if room < self.full { 0.0 } else { room };
                    s.weight = 1.0 - background;
                    return background;
                }
            }
        }
        self.weigh_all(span, all, first)
    }

    fn weigh_all(&self, span: Span, all: &mut Vec<Surface>, first: usize) -> f64 {
        let (far, depth) = (span.far, span.depth());
        if let Visibility::Softmax { gamma, epsilon } = self.form {
            let per_depth = 1.0 / (depth * gamma);
            let score = |s: &Surface| (far - s.t) * per_depth;
            let cutoff = (self.cutoff, self.nats);
            let background = softmax(all, first, score, epsilon / gamma, cutoff);
            by_depth(&mut all[first..]);
            return background;
        }
        let found = &mut all[first..];
        by_depth(found);
        match self.form {
            Visibility::LayeredSoft { gamma } => {
                let soft = softened(found);
                let ray = SoftRay::new(&soft.0, soft.1, 1.0 / depth / gamma, self.full);
                for (s, weight) in found.iter_mut().zip(ray.weights()) {
                    s.weight = weight;
                }
                ray.background
            }
            _ => layered(found),
        }
    }

    /// The share of light that passes surfaces, and its derivatives by each p, in their new order.
    #[inline(always)]
    pub fn pass(&self, found: &mut [Surface], by_p: &mut Vec<f64>) -> f64 {
        if found.is_empty() {
            by_p.clear();
            return 1.0;
        }
        self.pass_all(found, by_p)
    }

    fn pass_all(&self, found: &mut [Surface], by_p: &mut Vec<f64>) -> f64 {
        if matches!(self.form, Visibility::Softmax { .. }) {
            through_all(found, by_p)
        } else {
            through_layers(found, by_p, self.full)
        }
    }
}

fn by_depth(found: &mut [Surface]) {
    if found.len() > 1 {
        found.sort_unstable_by(|a, b| a.t.total_cmp(&b.t).then(a.triangle.cmp(&b.triangle)));
    }
}

/// Room for the derivatives of one ray's weights.
#[derive(Default)]
pub(crate) struct PullScratch {
    by_p: Vec<f64>,
    by_t: Vec<f64>,
    layers: Vec<(u32, f64, f64)>,
    /// What the weights count, for whoever needs a list.
    pub values: Vec<f64>,
}

/// The weights of the surfaces of one ray, to be differentiated.
pub(crate) struct Weighed<'a> {
    pub form: Visibility,
    pub surfaces: &'a [Surface],
    /// W of the background.
    pub background: f64,
    /// far − near.
    pub depth: f64,
    /// Whether the ray starts inside of the bounds: near = max(|o| − ρ, 0) is 0 and
    /// far = |o| + ρ.
    pub inside: bool,
    pub full: f64,
    pub cutoff: f64,
}

impl Weighed<'_> {
    /// Derivatives of Σ v·W + v·W_background: calls `emit` with surfaces, their derivatives by
    /// logit and by t, and the slope of p under which the first counts nothing; returns that by far.
    #[inline(always)]
    pub fn pull(
        &self,
        values: &[f64],
        background: f64,
        scratch: &mut PullScratch,
        mut emit: impl FnMut(&Surface, f64, f64, f64),
    ) -> f64 {
        let PullScratch {
            by_p, by_t, layers, ..
        } = scratch;
        let surfaces = self.surfaces;
        let softmax = matches!(self.form, Visibility::Softmax { .. });
        if let ([s], [v], false) = (surfaces, values, softmax) {
            // In layers what one surface leaves is the background's.
            let layered = matches!(self.form, Visibility::Layered);
            let least = if layered { self.cutoff } else { 0.0 };
            let by_p = if 1.0 - s.p < self.full {
                0.0
            } else {
                v - background
            };
            emit(s, by_p * s.slope, by_p * s.slope_t, least);
            return 0.0;
        }
        // What is nothing beside the largest part of the sum.
        let parts = surfaces.iter().zip(values);
        let parts = parts.map(|(s, v)| (s.weight * v).abs());
        let tiny = 1e-12 * parts.fold((self.background * background).abs(), f64::max);
        match self.form {
            Visibility::Softmax { gamma, .. } => {
                let per_depth = 1.0 / self.depth / gamma;
                let weighted = surfaces.iter().zip(values).map(|(s, v)| s.weight * v);
                let mean = weighted.sum::<f64>() + self.background * background;
                let mut far = 0.0;
                for (s, v) in surfaces.iter().zip(values) {
                    let share = (v - mean) * s.weight;
                    let [_, by_logit, by_t] = s.log;
                    if share.abs() > tiny {
                        emit(s, share * by_logit, share * (by_t - per_depth), 0.0);
                    }
                    // ∂z/∂far/γ: outside of the bounds only far − t depends on far, inside its
                    // divisor does too.
                    let kept = if self.inside { s.t / self.depth } else { 1.0 };
                    far += share * kept * per_depth;
                }
                far
            }
            Visibility::LayeredSoft { gamma } => {
                let list = softened(surfaces);
                let ray = SoftRay::new(&list.0, list.1, 1.0 / self.depth / gamma, self.full);
                let by_depth = ray.pull(values, background, by_p, by_t);
                for (k, s) in surfaces.iter().enumerate() {
                    let (a, b) = (by_p[k] * s.slope, by_p[k] * s.slope_t + by_t[k]);
                    if a.abs() + b.abs() > tiny {
                        emit(s, a, b, 0.0);
                    }
                }
                // Only inside of the bounds does far − near move, with far.
                if self.inside {
                    -by_depth / self.depth
                } else {
                    0.0
                }
            }
            Visibility::Layered | Visibility::Cone { .. } => {
                let background = (background, self.background);
                pull(surfaces, values, background, self.full, by_p, layers);
                for (s, g) in surfaces.iter().zip(by_p.iter()) {
                    emit(s, g * s.slope, g * s.slope_t, self.cutoff);
                }
                0.0
            }
        }
    }
}
