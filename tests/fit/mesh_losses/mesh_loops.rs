//! Losses of the shape of meshes by plain loops.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

/// Cotangent weights by plain loops, by edge.
pub fn cotangents(v: &[DVec3], faces: &[[u32; 3]]) -> BTreeMap<[u32; 2], f64> {
    let mut weights = BTreeMap::new();
    for f in faces {
        for i in 0..3 {
            let [at, p, q] = [f[i], f[(i + 1) % 3], f[(i + 2) % 3]];
            let (a, b) = (
                v[p as usize] - v[at as usize],
                v[q as usize] - v[at as usize],
            );
            let limit = 3f64.to_radians().tan().recip();
            let cot = (a.dot(b) / a.cross(b).length()).clamp(-limit, limit);
            *weights.entry([p.min(q), p.max(q)]).or_insert(0.0) += cot / 2.0;
        }
    }
    weights.values_mut().for_each(|w| *w = w.max(0.0));
    weights
}

/// The Laplacian loss by plain loops.
pub fn umbrella(v: &[DVec3], weights: &BTreeMap<[u32; 2], f64>) -> f64 {
    let mut sums = vec![(DVec3::ZERO, 0.0); v.len()];
    for (&[i, j], &w) in weights {
        for (p, q) in [(i as usize, j as usize), (j as usize, i as usize)] {
            sums[p].0 += w * (v[q] - v[p]);
            sums[p].1 += w;
        }
    }
    let squares = sums.iter().map(|(s, w)| (*s / *w).length_squared());
    squares.sum::<f64>() / v.len() as f64
}

/// The loss on bends by plain loops.
pub fn bends(v: &[DVec3], faces: &[[u32; 3]], f: fn(f64) -> f64) -> f64 {
    let normal = |f: &[u32; 3]| {
        let [a, b, c] = f.map(|i| v[i as usize]);
        (b - a).cross(c - a).normalize()
    };
    let corners = |f: &[u32; 3]| f.iter().copied().collect::<BTreeSet<_>>();
    let (mut sum, mut count) = (0.0, 0);
    for (i, a) in faces.iter().enumerate() {
        for b in &faces[..i] {
            if corners(a).intersection(&corners(b)).count() == 2 {
                sum += f(normal(a).dot(normal(b)));
                count += 1;
            }
        }
    }
    sum / f64::from(count)
}
