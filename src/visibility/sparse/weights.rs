//! The weights of a ray's surfaces, what passes them, and the derivatives of both.

use burn::tensor::{IndexingUpdateOp, Tensor};
use rayon::prelude::*;

use super::finder::Finder;
use super::ray::{HostRays, Lists, RAYS_A_PIECE, Surface, pieces};
use super::terms::{Sparse, Terms};
use crate::geometry::Context;
use crate::visibility::{DepthRange, Rays, Softmax, Span};

impl Finder<'_> {
    /// Sorts the surfaces of a ray by depth, sets their weights and drops those that are nothing;
    /// returns that of the background.
    pub fn weigh(&self, span: Span, found: &mut Vec<Surface>) -> f64 {
        let score = |s: &Surface| self.form.score(span, s.t);
        let background = self.form.background();
        // Most rays meet one surface.
        if let [s] = &mut found[..]
            && s.log[0] + score(s) - background > self.log_cutoff
        {
            s.weight = 1.0;
            return 0.0;
        }
        let background = softmax(found, score, background, (self.cutoff, self.log_cutoff));
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
    pub span: Span,
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
        let weighted = surfaces.iter().zip(values).map(|(s, v)| s.weight * v);
        let mean = weighted.sum::<f64>() + self.background * background;
        let mut far = 0.0;
        for (s, v) in surfaces.iter().zip(values) {
            let share = (v - mean) * s.weight;
            let [_, by_logit, by_t] = s.log;
            let [score_by_t, by_far] = self.form.slopes(self.span, s.t);
            if share.abs() > tiny {
                emit(s, share * by_logit, share * (by_t + score_by_t));
            }
            far += share * by_far;
        }
        far
    }
}

/// The weights of the surfaces that each ray meets.
pub(crate) struct SparseWeights<'a> {
    pub(super) sparse: &'a Sparse,
    pub(super) context: Context,
    pub(super) rays: Rays,
    pub(super) host: HostRays,
    pub(super) surfaces: Lists<Surface>,
    pub(super) background: Vec<f64>,
    pub(super) form: Softmax,
    pub(super) range: DepthRange,
    pub(super) spans: Vec<Span>,
    pub(super) triangles: u32,
    pub(super) tracked: bool,
    /// Candidates offered by the hierarchy.
    pub offered: u64,
}

impl SparseWeights<'_> {
    fn len(&self) -> usize {
        self.background.len()
    }

    /// Several surfaces of each ray, (ray, surface, W over its probability): systematic sampling with
    /// `draws` draws, in the order of triangles.
    pub fn split(&self, random: &[f64], draws: usize) -> Vec<(u32, u32, f64)> {
        let least = 1.0 / draws as f64;
        let mut found = Vec::with_capacity(self.len());
        let mut order: Vec<(u32, f64)> = Vec::new();
        for (i, u) in random.iter().enumerate() {
            let surfaces = self.surfaces.of(i);
            if let ([s], true) = (surfaces, self.background[i] <= 0.0) {
                found.push((i as u32, s.triangle, s.weight));
                continue;
            }
            order.clear();
            order.extend(surfaces.iter().map(|s| (s.triangle, s.weight)));
            order.sort_unstable_by_key(|s| s.0);
            order.push((self.triangles, self.background[i]));
            let total: f64 = order.iter().map(|s| s.1).sum();
            // The next number of the comb u, u + 1, … over cumulative weights in units of 1/draws.
            let (mut passed, mut next) = (0.0, total * u * least);
            for &(k, weight) in &order {
                passed += weight;
                if passed > next {
                    found.push((i as u32, k, weight.max(least)));
                    while passed > next {
                        next += total * least;
                    }
                }
            }
        }
        found
    }

    /// Draws one surface a ray: as the tensor program does, in the order of triangles.
    pub fn draw(&self, random: &[f64]) -> Vec<u32> {
        let one = |order: &mut Vec<(u32, f64)>, i: usize| {
            if let ([s], true) = (self.surfaces.of(i), self.background[i] <= 0.0) {
                return s.triangle;
            }
            order.clear();
            let surfaces = self.surfaces.of(i).iter();
            order.extend(surfaces.map(|s| (s.triangle, s.weight)));
            order.sort_unstable_by_key(|s| s.0);
            let total: f64 = order.iter().map(|s| s.1).sum::<f64>() + self.background[i];
            let threshold = total * random[i];
            let mut passed = 0.0;
            for &mut (triangle, weight) in order {
                passed += weight;
                if passed > threshold {
                    return triangle;
                }
            }
            self.triangles
        };
        (0..self.len())
            .into_par_iter()
            .with_min_len(RAYS_A_PIECE)
            .map_init(Vec::new, one)
            .collect()
    }

    /// W / detach(W) of the drawn surfaces `[1, N]`; None if no gradient can flow.
    pub fn ratio(&self, drawn: &[u32]) -> Option<Tensor<2>> {
        let change = self.change(|i, k, s| {
            let is = |k: u32| if drawn[i] == k { 1.0 } else { 0.0 };
            match s {
                Some(s) if s.weight > 0.0 => is(k) / s.weight,
                Some(_) => 0.0,
                None if self.background[i] > 0.0 => is(k) / self.background[i],
                None => 0.0,
            }
        })?;
        Some(change + 1.0)
    }

    /// A row that is 0 and has the derivative of Σ v·W over surfaces and background (the triangle
    /// past the last, without a surface); None if no gradient can flow.
    fn change(&self, v: impl Fn(usize, u32, Option<&Surface>) -> f64 + Sync) -> Option<Tensor<2>> {
        if !self.tracked {
            return None;
        }
        let parts: Vec<(Terms, Vec<f64>)> = pieces(self.len())
            .into_par_iter()
            .map(|range| {
                let mut terms = Terms::default();
                let (mut values, mut by_far) = (Vec::new(), Vec::new());
                for i in range {
                    terms.begin_ray();
                    let surfaces = self.surfaces.of(i);
                    values.clear();
                    values.extend(surfaces.iter().map(|s| v(i, s.triangle, Some(s))));
                    let background = v(i, self.triangles, None);
                    let far = self.gradient(i).backward(&values, background, |s, a, b| {
                        terms.add(self.sparse, &self.host, i, s, a, b, 0.0);
                    });
                    by_far.push(far);
                }
                (terms, by_far)
            })
            .collect();
        let (mut terms, mut by_far) = (Terms::default(), Vec::new());
        for (t, f) in parts {
            terms.join(t);
            by_far.extend(f);
        }
        let row = terms.row(self.sparse, &self.context, &self.rays, self.len());
        let far = self.range.change.as_ref();
        let far = far.map(|change| change.clone() * self.context.row(&by_far));
        match (row, far) {
            (Some(a), Some(b)) => Some(a + b),
            (a, b) => a.or(b),
        }
    }

    fn gradient(&self, i: usize) -> WeightGradient<'_> {
        WeightGradient {
            form: self.form,
            surfaces: self.surfaces.of(i),
            background: self.background[i],
            span: self.spans[i],
        }
    }

    /// Σ W·v of a host quantity: a row `[1, N]`, in the graph through the weights.
    pub fn mean(
        &self,
        v: impl Fn(usize, u32, bool) -> f64 + Sync,
        background: impl Fn(usize) -> f64 + Sync,
    ) -> Tensor<2> {
        let of = |i: usize, k: u32, s: Option<&Surface>| match s {
            Some(s) => v(i, k, s.cosine < 0.0),
            None => background(i),
        };
        let values: Vec<f64> = (0..self.len())
            .map(|i| {
                let surfaces = self.surfaces.of(i).iter();
                surfaces
                    .map(|s| s.weight * of(i, s.triangle, Some(s)))
                    .sum::<f64>()
                    + self.background[i] * of(i, self.triangles, None)
            })
            .collect();
        let value = self.context.row(&values);
        match self.change(of) {
            Some(change) => value + change,
            None => value,
        }
    }

    /// W of the background `[1, N]`, in the graph if a gradient can flow.
    pub fn attached_background(&self) -> Tensor<2> {
        self.mean(|_, _, _| 0.0, |_| 1.0)
    }

    /// Σ W·v of a column `[T, 1]` or `[M, 1]`, in the graph through it alone; `row` says which entry
    /// belongs to a surface, with a factor.
    pub fn spread(
        &self,
        column: &Tensor<2>,
        row: impl Fn(u32, bool) -> Option<(u32, f64)>,
    ) -> Option<Tensor<2>> {
        let (mut rays, mut rows, mut factors) = (Vec::new(), Vec::new(), Vec::new());
        for i in 0..self.surfaces.rays() {
            for s in self.surfaces.of(i) {
                if let Some((r, factor)) = row(s.triangle, s.cosine < 0.0)
                    && s.weight > 0.0
                {
                    rays.push(i as u32);
                    rows.push(r);
                    factors.push(factor * s.weight);
                }
            }
        }
        if rays.is_empty() {
            return None;
        }
        let context = &self.context;
        let values = crate::geometry::gather_row(column.clone(), &context.index_row(&rows));
        let values = values * context.row(&factors);
        let zeros = Tensor::<2>::zeros([1, self.len()], (&context.device, context.dtype));
        Some(zeros.scatter(1, context.index_row(&rays), values, IndexingUpdateOp::Add))
    }

    /// Σ W·t: the mean distance `[1, N]`, in the graph through weights and distances.
    pub fn mean_distance(&self) -> Tensor<2> {
        let values: Vec<f64> = (0..self.len())
            .map(|i| self.surfaces.of(i).iter().map(|s| s.weight * s.t).sum())
            .collect();
        let value = self.context.row(&values);
        if !self.tracked {
            return value;
        }
        let mut terms = Terms::default();
        for i in 0..self.len() {
            terms.begin_ray();
            for s in self.surfaces.of(i) {
                terms.add(self.sparse, &self.host, i, s, 0.0, s.weight, 0.0);
            }
        }
        let by_distance = terms.row(self.sparse, &self.context, &self.rays, self.len());
        let by_weight = self.change(|_, _, s| s.map_or(0.0, |s| s.t));
        [by_distance, by_weight]
            .into_iter()
            .flatten()
            .fold(value, |sum, term| sum + term)
    }

    /// Weights by object `[O, N]`, and of the background `[1, N]`, without tape.
    pub fn by_object(&self, object: &[u32], objects: usize) -> (Tensor<2>, Tensor<2>) {
        let n = self.len();
        let mut sums = vec![0.0; objects * n];
        for i in 0..n {
            for s in self.surfaces.of(i) {
                sums[object[s.triangle as usize] as usize * n + i] += s.weight;
            }
        }
        let background = self.context.row(&self.background);
        (self.context.tensor(&sums, [objects, n]), background)
    }

    /// The number of surfaces that share each ray.
    pub fn counts(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.len()).map(|i| self.surfaces.of(i).len())
    }
}
