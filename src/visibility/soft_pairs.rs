//! The soft order in depth for the surfaces of one ray, on the host: what `soft_order` does in
//! tensors, with its derivatives by hand.

/// A surface as the soft order sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Soft {
    /// Layers are numbered from 0 in a ray.
    pub layer: usize,
    pub t: f64,
    pub p: f64,
}

/// The weights of a ray's surfaces before they are scaled, and what their derivatives need.
pub(super) struct SoftRay<'a> {
    surfaces: &'a [Soft],
    layers: usize,
    /// 1/(far − near)/γ.
    per_depth: f64,
    /// Less room than this is none.
    full: f64,
    /// What passes all.
    pub background: f64,
    raw: Vec<f64>,
    total: f64,
}

/// Decides between surfaces that find their layer full.
const FAINT: f64 = 1e-6;
/// Totals under this are not scaled.
const NOTHING: f64 = 1e-12;

/// What the surfaces but the i-th cover of each layer before it, with the order of each.
fn before(ray: &SoftRay, i: usize, cover: &mut Vec<f64>, order: &mut Vec<f64>) {
    cover.clear();
    cover.resize(ray.layers, 0.0);
    order.clear();
    let own = ray.surfaces[i].t;
    for (j, s) in ray.surfaces.iter().enumerate() {
        let nearer = 1.0 / (1.0 + (-(own - s.t) * ray.per_depth).exp());
        order.push(nearer);
        if j != i {
            cover[s.layer] += s.p * nearer;
        }
    }
}

/// ∏ max(0, 1 − C) over layers, one of them with more cover.
fn passed(cover: &[f64], layer: usize, more: f64, full: f64) -> f64 {
    let room = |(l, c): (usize, &f64)| room(*c, l == layer, more, full);
    cover.iter().enumerate().map(room).product()
}

/// 1 − C, or 0 where that is no more than rounding.
fn room(cover: f64, own: bool, more: f64, full: f64) -> f64 {
    let room = 1.0 - cover - if own { more } else { 0.0 };
    if room < full { 0.0 } else { room }
}

/// The derivative of `passed` by the cover of one layer.
fn by_cover(cover: &[f64], layer: usize, more: f64, by: usize, full: f64) -> f64 {
    let mut product = -1.0;
    for (l, c) in cover.iter().enumerate() {
        let room = room(*c, l == layer, more, full);
        if l != by {
            product *= room;
        } else if room == 0.0 {
            return 0.0;
        }
    }
    product
}

impl<'a> SoftRay<'a> {
    pub fn new(surfaces: &'a [Soft], layers: usize, per_depth: f64, full: f64) -> Self {
        let mut ray = Self {
            surfaces,
            layers,
            per_depth,
            full,
            background: 1.0,
            raw: Vec::with_capacity(surfaces.len()),
            total: 0.0,
        };
        let mut whole = vec![0.0; layers];
        surfaces.iter().for_each(|s| whole[s.layer] += s.p);
        ray.background = passed(&whole, 0, 0.0, full);
        let (mut cover, mut order) = (Vec::new(), Vec::new());
        for (i, s) in surfaces.iter().enumerate() {
            before(&ray, i, &mut cover, &mut order);
            let taken = passed(&cover, s.layer, 0.0, full) - passed(&cover, s.layer, s.p, full);
            let crowd = 1.0 + cover.iter().sum::<f64>();
            ray.raw.push(taken.max(0.0) + FAINT * s.p / (crowd * crowd));
        }
        ray.total = ray.raw.iter().sum();
        ray
    }

    fn scale(&self) -> f64 {
        if self.total < NOTHING {
            1.0
        } else {
            (1.0 - self.background) / self.total
        }
    }

    /// The weight of each surface.
    pub fn weights(&self) -> impl Iterator<Item = f64> + '_ {
        let scale = self.scale();
        self.raw.iter().map(move |r| r * scale)
    }

    /// Derivatives of Σ v·W + v·background by each p and t; returns that by log(1/(far − near)).
    pub fn pull(
        &self,
        values: &[f64],
        background: f64,
        by_p: &mut Vec<f64>,
        by_t: &mut Vec<f64>,
    ) -> f64 {
        let n = self.surfaces.len();
        for by in [&mut *by_p, &mut *by_t] {
            by.clear();
            by.resize(n, 0.0);
        }
        let scaled = self.total >= NOTHING;
        let sum: f64 = self.raw.iter().zip(values).map(|(r, v)| r * v).sum();
        let mean = if scaled { sum / self.total } else { 0.0 };
        let scale = self.scale();

        let mut whole = vec![0.0; self.layers];
        self.surfaces.iter().for_each(|s| whole[s.layer] += s.p);
        for (by, s) in by_p.iter_mut().zip(self.surfaces) {
            *by += (background - mean) * by_cover(&whole, 0, 0.0, s.layer, self.full);
        }
        let (mut cover, mut order) = (Vec::new(), Vec::new());
        let mut by_layer = vec![0.0; self.layers];
        let mut by_depth = 0.0;
        for (i, s) in self.surfaces.iter().enumerate() {
            let g = scale * (values[i] - mean);
            if g == 0.0 {
                continue;
            }
            before(self, i, &mut cover, &mut order);
            let full = self.full;
            let taken = passed(&cover, s.layer, 0.0, full) - passed(&cover, s.layer, s.p, full);
            let crowd = 1.0 + cover.iter().sum::<f64>();
            by_p[i] += g * FAINT / (crowd * crowd);
            let by_crowd = -2.0 * FAINT * s.p / (crowd * crowd * crowd);
            by_layer.fill(by_crowd);
            if taken > 0.0 {
                by_p[i] -= g * by_cover(&cover, s.layer, s.p, s.layer, self.full);
                for (l, by) in by_layer.iter_mut().enumerate() {
                    *by += by_cover(&cover, s.layer, 0.0, l, self.full)
                        - by_cover(&cover, s.layer, s.p, l, self.full);
                }
            }
            for (j, other) in self.surfaces.iter().enumerate() {
                if j == i {
                    continue;
                }
                let by = g * by_layer[other.layer];
                by_p[j] += by * order[j];
                let slope = by * other.p * order[j] * (1.0 - order[j]);
                by_t[i] += slope * self.per_depth;
                by_t[j] -= slope * self.per_depth;
                by_depth += slope * (s.t - other.t) * self.per_depth;
            }
        }
        by_depth
    }
}
