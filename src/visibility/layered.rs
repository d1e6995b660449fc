//! The layered form: a layer is (object, sign of n·d). C_ℓ(t) = Σ p over the layer's triangles
//! nearer than t, T(t) = ∏ (1 − min(1, C_ℓ(t))), W_k = T just before t_k − T just after.

use burn::tensor::{IndexingUpdateOp, Tensor};

use super::slots::Slots;
use super::{Coverage, Weights, weights::Derivative};
use crate::error::Result;
use crate::geometry::{Context, Topology};

/// What the derivatives of the layered weights need; slots `[K, N]`, without tape.
#[derive(Clone, Debug)]
pub(super) struct Layers {
    slots: Slots,
    /// W of each slot.
    weight: Tensor<2>,
    /// W of the background `[1, N]`.
    background: Tensor<2>,
    /// T just after each slot.
    after: Tensor<2>,
    /// 1/(1 − C) just after each slot, 0 where its layer is full.
    inverse_room: Tensor<2>,
    triangles: usize,
}

pub(super) fn weights(
    context: &Context,
    topology: &Topology,
    coverage: Coverage,
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
    let index = slots.triangle.clone();
    let p = coverage.probability().gather(0, index.clone()) * slots.used.clone();
    let (with, without) = slots.sums(p.clone());
    let room = without.clamp_max(1.0).neg() + 1.0;
    let full = room.clone().lower_equal_elem(0.0);
    // The share of what is left of its own layer that a surface takes.
    let taken = p.min_pair(room.clone()) / room.mask_fill(full.clone(), 1.0);
    let taken = taken.mask_fill(full, 0.0);
    let after = (taken.clone().neg() + 1.0).cumprod(0);
    let k = slots.shape[0];
    let before = Tensor::cat(vec![zeros(1) + 1.0, after.clone().slice([0..k - 1])], 0);
    let weight = before * taken;
    let background = after.clone().slice([k - 1..k]);
    let surfaces =
        zeros(triangles).scatter(0, index.clone(), weight.clone(), IndexingUpdateOp::Add);
    let derivative = if coverage.attached.is_some() {
        let room = with.neg() + 1.0;
        let full = room.clone().lower_elem(coverage.full);
        Derivative::Layered(Box::new(Layers {
            inverse_room: room
                .mask_fill(full.clone(), 1.0)
                .recip()
                .mask_fill(full, 0.0),
            background: background.clone(),
            slots,
            weight,
            after,
            triangles,
        }))
    } else {
        Derivative::None
    };
    Ok(Weights {
        surfaces,
        background,
        coverage,
        derivative,
    })
}

impl Layers {
    /// ∂(Σ v_k·W_k + v·W_background)/∂p for all pairs `[T, N]`; v by slot, and of the background.
    fn pull(&self, v: Tensor<2>, background: Tensor<2>) -> Tensor<2> {
        // Σ v_k·(T before − T after) + v·T(∞) = v_1 + Σ (v_(k+1) − v_k)·T after k
        let k = self.slots.shape[0];
        let step = if k > 1 {
            Tensor::cat(vec![v.clone().slice([1..k]), background], 0)
        } else {
            background
        } - v;
        // ∂T/∂C_ℓ = −T/(1 − C_ℓ), C_ℓ constant between two slots of the layer.
        let by_sum = self.slots.until_next(step * self.after.clone()) * self.inverse_room.clone();
        let by_p = self.slots.later(by_sum).neg() * self.slots.used.clone();
        let n = self.slots.shape[1];
        let zeros = Tensor::zeros([self.triangles, n], (&by_p.device(), by_p.dtype()));
        zeros.scatter(0, self.slots.triangle.clone(), by_p, IndexingUpdateOp::Add)
    }

    /// The same for values of the triangles `[T, N]`.
    pub fn by_mean(&self, values: Tensor<2>, background: Tensor<2>) -> Tensor<2> {
        self.pull(values.gather(0, self.slots.triangle.clone()), background)
    }

    /// ∂ log W/∂p of the drawn surfaces; 0 where a caller names one of weight 0, which no ray draws.
    pub fn by_log(&self, context: &Context, drawn: &[u32]) -> Tensor<2> {
        let (one_hot, missed) = self.slots.drawn(context, drawn, self.triangles);
        let weight = (one_hot.clone() * self.weight.clone()).sum_dim(0)
            + missed.clone() * self.background.clone();
        let absent = weight.clone().lower_equal_elem(0.0);
        let inverse = weight.mask_fill(absent.clone(), 1.0).recip();
        let inverse = inverse.mask_fill(absent, 0.0);
        self.pull(one_hot * inverse.clone(), missed * inverse)
    }
}

/// T along whole rays: layers by their sums, whatever the order.
pub(super) fn transmittance(
    context: &Context,
    topology: &Topology,
    coverage: &Coverage,
) -> Tensor<2> {
    let p = coverage.probability();
    let front = coverage.cosine.clone().lower_elem(0.0);
    let sides = [
        p.clone().mask_fill(front.clone().bool_not(), 0.0),
        p.mask_fill(front.clone(), 0.0),
    ];
    // Rows of a layer's triangles, by object.
    let object = &topology.object;
    let mut rows = Vec::new();
    let mut first = 0;
    while first < object.len() {
        let past = object[first..].partition_point(|&o| o == object[first]) + first;
        rows.push(first..past);
        first = past;
    }
    let room = sides.map(|p| {
        let sums = rows
            .iter()
            .map(|r| p.clone().slice([r.clone()]).sum_dim(0))
            .collect();
        Tensor::cat(sums, 0).neg().add_scalar(1.0).clamp_min(0.0)
    });
    let mut passed = room[0].clone().slice([0..1]);
    for (side, room) in room.iter().enumerate() {
        for o in 0..rows.len() {
            if (side, o) != (0, 0) {
                passed = passed * room.clone().slice([o..o + 1]);
            }
        }
    }
    if coverage.attached.is_none() {
        return passed;
    }
    let numbers: Vec<i32> = rows
        .iter()
        .enumerate()
        .flat_map(|(o, r)| vec![o as i32; r.len()])
        .collect();
    let of_triangle =
        Tensor::<1, burn::tensor::Int>::from_ints(numbers.as_slice(), &context.device);
    let [front_slope, back_slope] = room.map(|room| {
        let full = room.clone().lower_elem(coverage.full);
        let inverse = room
            .mask_fill(full.clone(), 1.0)
            .recip()
            .mask_fill(full, 0.0);
        (inverse * passed.clone())
            .neg()
            .select(0, of_triangle.clone())
    });
    match coverage.by_probability(back_slope.mask_where(front, front_slope)) {
        Some(change) => passed + change,
        None => passed,
    }
}
