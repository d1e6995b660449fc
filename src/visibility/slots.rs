use burn::tensor::{Int, Tensor, TensorData};

use super::Coverage;
use crate::error::Result;
use crate::geometry::{Context, Topology, host_values};

/// Pairs with p < exp(−60) can't change a weight by more than rounding.
const LEAST_LOGIT: f64 = -60.0;

/// The surfaces that matter to each ray in order of (t, index): slots `[K, N]`, K that of the ray
/// with the most. The order is a decision, made on the host; what it serves are tensors. Slots that
/// a ray leaves empty come last and count nothing.
#[derive(Clone, Debug)]
pub(super) struct Slots {
    /// The triangle of each slot.
    pub triangle: Tensor<2, Int>,
    /// 1 where there is a surface, else 0.
    pub used: Tensor<2>,
    /// Slots by layer, within a layer by depth, and the way back.
    pub to_layers: Tensor<2, Int>,
    pub from_layers: Tensor<2, Int>,
    /// In the order of layers: where the slot's layer begins, and one past its end.
    pub begin: Tensor<2, Int>,
    pub end: Tensor<2, Int>,
    /// In the order of depth: the next slot of the same layer, K if there is none.
    pub next: Tensor<2, Int>,
    /// 1 at the last slot of each layer.
    pub last: Tensor<2>,
    /// The triangles on the host, rows of slots.
    pub list: Vec<u32>,
    /// K and N.
    pub shape: [usize; 2],
}

impl Slots {
    /// None if no surface matters to any ray.
    pub fn new(
        context: &Context,
        topology: &Topology,
        coverage: &Coverage,
    ) -> Result<Option<Self>> {
        let [triangles, n] = coverage.t.dims();
        let dropped = coverage
            .logit
            .clone()
            .lower_elem(LEAST_LOGIT)
            .bool_or(coverage.counted.clone().bool_not());
        // One tensor to read: ±t, negative for backs, 0 for what does not matter.
        let front = coverage.cosine.clone().lower_elem(0.0);
        let key = coverage
            .t
            .clone()
            .neg()
            .mask_where(front, coverage.t.clone());
        let key = host_values(&key.mask_fill(dropped, 0.0))?;

        let mut count = vec![0u32; n];
        for row in key.chunks_exact(n) {
            for (c, &v) in count.iter_mut().zip(row) {
                *c += u32::from(v != 0.0);
            }
        }
        let k = count.iter().copied().max().unwrap_or(0) as usize;
        if k == 0 {
            return Ok(None);
        }
        // By ray: (t, triangle, layer).
        let mut found = vec![Vec::<(f64, u32, u32)>::new(); n];
        for (list, &c) in found.iter_mut().zip(&count) {
            list.reserve_exact(c as usize);
        }
        for triangle in 0..triangles {
            let object = topology.object[triangle];
            for (list, &v) in found.iter_mut().zip(&key[triangle * n..]) {
                if v != 0.0 {
                    list.push((v.abs(), triangle as u32, 2 * object + u32::from(v < 0.0)));
                }
            }
        }

        let mut list = vec![0u32; k * n];
        let mut used = vec![0.0; k * n];
        let mut last = vec![0.0; k * n];
        let [mut to, mut from, mut begin, mut end, mut next] = [(); 5].map(|()| vec![0i32; k * n]);
        let mut by_layer: Vec<usize> = Vec::with_capacity(k);
        for (i, surfaces) in found.iter_mut().enumerate() {
            // Stable: ties stay in order of the index.
            surfaces.sort_by(|a, b| a.0.total_cmp(&b.0));
            let layer = |slot: usize| surfaces.get(slot).map_or(u32::MAX, |s| s.2);
            for (slot, s) in surfaces.iter().enumerate() {
                list[slot * n + i] = s.1;
                used[slot * n + i] = 1.0;
            }
            by_layer.clear();
            by_layer.extend(0..k);
            by_layer.sort_by_key(|&slot| layer(slot));
            let mut first = 0;
            while first < k {
                let own = layer(by_layer[first]);
                let past = (first..k).find(|&m| layer(by_layer[m]) != own).unwrap_or(k);
                for m in first..past {
                    let slot = by_layer[m];
                    to[m * n + i] = slot as i32;
                    from[slot * n + i] = m as i32;
                    begin[m * n + i] = first as i32;
                    end[m * n + i] = past as i32;
                    let following = if m + 1 < past { by_layer[m + 1] } else { k };
                    next[slot * n + i] = following as i32;
                    if m + 1 == past {
                        last[slot * n + i] = 1.0;
                    }
                }
                first = past;
            }
        }
        let shape = [k, n];
        let index = |v: Vec<i32>| Tensor::from_data(TensorData::new(v, shape), &context.device);
        Ok(Some(Self {
            triangle: index(list.iter().map(|&t| t as i32).collect()),
            used: context.tensor(&used, shape),
            to_layers: index(to),
            from_layers: index(from),
            begin: index(begin),
            end: index(end),
            next: index(next),
            last: context.tensor(&last, shape),
            list,
            shape,
        }))
    }

    /// 1 at the slots of the drawn triangles `[K, N]`, and where the background was drawn `[1, N]`.
    pub fn drawn(
        &self,
        context: &Context,
        drawn: &[u32],
        triangles: usize,
    ) -> (Tensor<2>, Tensor<2>) {
        let [k, n] = self.shape;
        let mut one_hot = vec![0.0; k * n];
        let mut missed = vec![0.0; n];
        for (i, &triangle) in drawn.iter().enumerate() {
            if triangle as usize >= triangles {
                missed[i] = 1.0;
            } else if let Some(slot) = (0..k).find(|slot| self.list[slot * n + i] == triangle) {
                one_hot[slot * n + i] = 1.0;
            }
        }
        (context.tensor(&one_hot, [k, n]), context.row(&missed))
    }

    /// A row as one slot, zero in the others.
    pub fn only(&self, slot: usize, row: Tensor<2>) -> Tensor<2> {
        let zero = row.zeros_like();
        let rows = (0..self.shape[0]).map(|i| if i == slot { row.clone() } else { zero.clone() });
        Tensor::cat(rows.collect(), 0)
    }

    /// Sums over the slots of the same layer, in order of depth: up to and with each slot, and up
    /// to it.
    pub fn sums(&self, values: Tensor<2>) -> (Tensor<2>, Tensor<2>) {
        let sums = with_zero(values.gather(0, self.to_layers.clone()).cumsum(0));
        let base = sums.clone().gather(0, self.begin.clone());
        let k = self.shape[0];
        let [with, without] = [1..k + 1, 0..k].map(|range| {
            (sums.clone().slice([range]) - base.clone()).gather(0, self.from_layers.clone())
        });
        (with, without)
    }

    /// Sums over each slot and the later ones of the same layer.
    pub fn later(&self, values: Tensor<2>) -> Tensor<2> {
        let sums = with_zero(values.gather(0, self.to_layers.clone()).cumsum(0));
        let total = sums.clone().gather(0, self.end.clone());
        let before = sums.slice([0..self.shape[0]]);
        (total - before).gather(0, self.from_layers.clone())
    }

    /// Sums of depth-ordered values over the slots from each up to the next of its layer.
    pub fn until_next(&self, values: Tensor<2>) -> Tensor<2> {
        let sums = with_zero(values.cumsum(0));
        sums.clone().gather(0, self.next.clone()) - sums.slice([0..self.shape[0]])
    }
}

/// A row of zeros on top.
fn with_zero(values: Tensor<2>) -> Tensor<2> {
    let zero = values.clone().slice([0..1]) * 0.0;
    Tensor::cat(vec![zero, values], 0)
}
