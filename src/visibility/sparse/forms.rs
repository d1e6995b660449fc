//! The forms of visibility for one ray: weights and transmittances of its surfaces, and their
//! derivatives.

use super::Surface;
use crate::visibility::soft_pairs::Soft;

/// Sets the weights of surfaces in order of depth; returns that of the background.
pub(super) fn layered(found: &mut [Surface]) -> f64 {
    let mut passed = 1.0;
    for i in 0..found.len() {
        let layer = found[i].layer;
        let before: f64 = found[..i]
            .iter()
            .filter(|s| s.layer == layer)
            .map(|s| s.p)
            .sum();
        let room = (1.0 - before).max(0.0);
        let taken = if room > 0.0 {
            found[i].p.min(room) / room
        } else {
            0.0
        };
        found[i].weight = passed * taken;
        passed *= 1.0 - taken;
    }
    passed
}

/// Surfaces for the soft order, and how many layers they have.
pub(super) fn softened(found: &[Surface]) -> (Vec<Soft>, usize) {
    let mut layers: Vec<u32> = Vec::new();
    let soft = found.iter().map(|s| {
        let known = layers.iter().position(|&l| l == s.layer);
        let layer = known.unwrap_or_else(|| {
            layers.push(s.layer);
            layers.len() - 1
        });
        Soft {
            layer,
            t: s.t,
            p: s.p,
        }
    });
    let soft = soft.collect();
    (soft, layers.len())
}

/// Drops surfaces from `first` on, and the background, whose weights add up to less than `cutoff`, sets
/// those of the rest, and returns that of the background. `nats` is ln(10/cutoff).
pub(super) fn softmax(
    all: &mut Vec<Surface>,
    first: usize,
    score: impl Fn(&Surface) -> f64,
    background: f64,
    (cutoff, nats): (f64, f64),
) -> f64 {
    let full = |s: &Surface| s.log[0] + score(s);
    let largest = all[first..].iter().map(full).fold(background, f64::max);
    let count = all.len() - first + 1;
    let least = largest
        - if count <= 10 {
            nats
        } else {
            (count as f64 / cutoff).ln()
        };
    let part = |score: f64| {
        if score < least {
            0.0
        } else if score < largest {
            (score - largest).exp()
        } else {
            1.0
        }
    };
    let rest = part(background);
    let (mut kept, mut total) = (first, rest);
    for i in first..all.len() {
        let weight = part(full(&all[i]));
        if weight > 0.0 {
            if kept < i {
                all[kept] = all[i];
            }
            all[kept].weight = weight;
            total += weight;
            kept += 1;
        }
    }
    all.truncate(kept);
    if total != 1.0 {
        all[first..].iter_mut().for_each(|s| s.weight /= total);
    }
    rest / total
}

/// ∏ (1 − p), and its derivatives by each p.
pub(super) fn through_all(found: &[Surface], by_p: &mut Vec<f64>) -> f64 {
    let passed: f64 = found.iter().map(|s| 1.0 - s.p).product();
    by_p.clear();
    by_p.extend(found.iter().map(|s| -passed / (1.0 - s.p).max(1e-30)));
    passed
}

/// ∏ over layers of 1 − min(1, Σ p), and its derivatives by each p.
pub(super) fn through_layers(found: &mut [Surface], by_p: &mut Vec<f64>, full: f64) -> f64 {
    by_p.clear();
    found.sort_unstable_by(|a, b| a.layer.cmp(&b.layer).then(a.triangle.cmp(&b.triangle)));
    let mut passed = 1.0;
    for layer in found.chunk_by(|a, b| a.layer == b.layer) {
        let room = (1.0 - layer.iter().map(|s| s.p).sum::<f64>()).max(0.0);
        passed *= room;
        let inverse = if room < full { 0.0 } else { -1.0 / room };
        by_p.extend(layer.iter().map(|_| inverse));
    }
    by_p.iter_mut().for_each(|g| *g *= passed);
    passed
}

/// ∂(Σ v_k·W_k + v·W_background)/∂p of surfaces in order of depth.
pub(super) fn pull(
    surfaces: &[Surface],
    values: &[f64],
    (background, passed): (f64, f64),
    full: f64,
    by_p: &mut Vec<f64>,
    scratch: &mut Vec<(u32, f64, f64)>,
) {
    let n = surfaces.len();
    by_p.clear();
    by_p.resize(n, 0.0);
    // By layer: Σ p so far, and Σ step·T/(1 − C) over later slots.
    scratch.clear();
    for s in surfaces {
        match scratch.iter_mut().find(|l| l.0 == s.layer) {
            Some(l) => l.1 += s.p,
            None => scratch.push((s.layer, s.p, 0.0)),
        }
    }
    let mut after = passed;
    for k in (0..n).rev() {
        let next = if k + 1 < n { values[k + 1] } else { background };
        let step = (next - values[k]) * after;
        for l in scratch.iter_mut() {
            let room = 1.0 - l.1;
            if room >= full {
                l.2 += step / room;
            }
        }
        let s = &surfaces[k];
        if let Some(l) = scratch.iter_mut().find(|l| l.0 == s.layer) {
            by_p[k] = -l.2;
            l.1 -= s.p;
        }
        after += s.weight;
    }
}
