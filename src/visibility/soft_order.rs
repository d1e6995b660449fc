//! The layered form with a soft order in depth: where it asks whether surface j is nearer than k,
//! sigmoid((z_j − z_k)/γ) answers, so that surfaces that pass through each other have a gradient
//! of their crossing. The weights are scaled to add up to what the layers hold back.

use burn::tensor::activation::sigmoid;
use burn::tensor::{IndexingUpdateOp, Tensor};

use super::slots::Slots;
use super::{Coverage, DepthRange, Weights, weights::Derivative};
use crate::error::Result;
use crate::geometry::{Context, Topology, plain};

/// Weights by slot `[K, N]` and of the background `[1, N]`, in the graph.
#[derive(Clone, Debug)]
pub(super) struct SoftOrder {
    slots: Slots,
    weight: Tensor<2>,
    background: Tensor<2>,
    triangles: usize,
}

pub(super) fn weights(
    context: &Context,
    topology: &Topology,
    coverage: Coverage,
    range: DepthRange,
    gamma: f64,
) -> Result<Weights> {
    let [triangles, n] = coverage.t.dims();
    let zeros = |rows| Tensor::zeros([rows, n], (&context.device, context.dtype));
    let Some(slots) = Slots::new(context, topology, &coverage)? else {
        return Ok(Weights {
            surfaces: zeros(triangles),
            background: zeros(1) + 1.0,
            coverage,
            derivative: Derivative::None,
        });
    };
    let k = slots.shape[0];
    let at_slots = |t: &Tensor<2>| t.clone().gather(0, slots.triangle.clone()) * slots.used.clone();
    let mut p = at_slots(&coverage.probability());
    let mut t = at_slots(&coverage.t);
    if let Some((attached_t, logit)) = &coverage.attached {
        let logit = at_slots(logit);
        p = p + (logit.clone() - plain(&logit)) * at_slots(&coverage.slope());
        t = at_slots(attached_t);
        if let Some(slope) = coverage.slope_by_distance() {
            p = p + (t.clone() - plain(&t)) * at_slots(&slope);
        }
    }
    let full_room = coverage.full;
    let per_depth = range.per_depth() / gamma;
    let row = |values: &Tensor<2>, i: usize| values.clone().slice([i..i + 1]);

    let empty = slots.last.clone().neg() + 1.0;
    // ∏ over layers of (1 − min(1, C_ℓ)), each taken at its last slot.
    let passed = |sums: Tensor<2>| {
        // At a seam of one object Σ p is 1 up to rounding: full, without a derivative.
        let room = sums.neg().add_scalar(1.0);
        let full = plain(&room).lower_elem(full_room);
        let room = room.mask_fill(full, 0.0);
        let room = room * slots.last.clone() + empty.clone();
        (1..k).fold(row(&room, 0), |passed, i| passed * row(&room, i))
    };
    let (with, _) = slots.sums(p.clone());
    let background = passed(with);
    let mut raw = Vec::new();
    for i in 0..k {
        let nearer = sigmoid((row(&t, i) - t.clone()) * per_depth.clone());
        // Itself left out.
        let mut keep = vec![1.0; k];
        keep[i] = 0.0;
        let before = p.clone() * nearer * context.column(&keep);
        let (sums, _) = slots.sums(before.clone());
        let without = passed(sums);
        // Where so many surfaces share a place and a depth that each finds its layer full, none
        // would take anything: this faint part decides between them there, and nowhere else.
        let crowd = before.clone().sum_dim(0) + 1.0;
        let faint = row(&p, i) * 1e-6 / (crowd.clone() * crowd);
        let own = slots.only(i, row(&p, i));
        let (sums, _) = slots.sums(before + own);
        raw.push((without - passed(sums)).clamp_min(0.0) + faint);
    }
    let raw = Tensor::cat(raw, 0);
    let total = raw.clone().sum_dim(0);
    // What next to nothing takes needs no scale, and the square of its inverse would overflow.
    let nothing = plain(&total).lower_elem(1e-12);
    let scale = (background.clone().neg() + 1.0) / total.mask_fill(nothing.clone(), 1.0);
    let scale = scale.mask_fill(nothing, 1.0);
    let weight = raw * scale;
    let (value, background_value) = (plain(&weight), plain(&background));
    let surfaces =
        zeros(triangles).scatter(0, slots.triangle.clone(), value, IndexingUpdateOp::Add);
    let derivative = if coverage.attached.is_some() {
        Derivative::SoftOrder(Box::new(SoftOrder {
            slots,
            weight,
            background,
            triangles,
        }))
    } else {
        Derivative::None
    };
    Ok(Weights {
        surfaces,
        background: background_value,
        coverage,
        derivative,
    })
}

impl SoftOrder {
    /// A row that is 0 and has the derivative of Σ v_k·W_k + v·W_background.
    pub fn by_mean(&self, values: Tensor<2>, background: Tensor<2>) -> Tensor<2> {
        let values = values.gather(0, self.slots.triangle.clone()) * self.slots.used.clone();
        let mean = (self.weight.clone() * values).sum_dim(0) + self.background.clone() * background;
        mean.clone() - plain(&mean)
    }

    /// A row that is 0 and has the derivative of log W of the drawn surfaces; none where a caller
    /// names one of weight 0, which no ray draws.
    pub fn by_log(&self, context: &Context, drawn: &[u32]) -> Option<Tensor<2>> {
        let (one_hot, missed) = self.slots.drawn(context, drawn, self.triangles);
        let weight = (self.weight.clone() * one_hot).sum_dim(0) + self.background.clone() * missed;
        let value = plain(&weight);
        let absent = value.clone().lower_equal_elem(0.0);
        let scale = value.clone().mask_fill(absent.clone(), 1.0).recip();
        Some((weight - value) * scale.mask_fill(absent, 0.0))
    }
}
