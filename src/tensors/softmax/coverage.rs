//! The paper's blurred triangles (Eq. 1), for pairs of a ray and a triangle.

use burn::tensor::{Bool, DType, Tensor, TensorData};

use super::pairs::Pairs;
use crate::geometry::{Context, Nearest, Topology, Triangles, Vec3, detached, nearest_on_triangle};
use crate::tensors::rays::{NO_TRIANGLE, Rays};

/// The parameters of Eq. 1, in the triangles' unit.
#[derive(Clone, Copy, Debug)]
pub struct CoverageSettings {
    /// Blur of edges σ, a squared length.
    pub sigma: f64,
    /// Hits at a smaller distance do not count.
    pub t_min: f64,
    /// Rays that leave a surface start to hit others gradually, over a distance √start: a hit at t counts by 1 −
    /// exp(−t²/start). 0 is a hard start.
    pub start: f64,
    /// Hits beyond (1 − margin)·distance of an arrival do not count.
    pub arrival_margin: f64,
}

/// The coverage of rays by triangles, for pairs `[K, N]`.
#[derive(Clone, Debug)]
pub struct Coverage {
    /// Distance along the ray to the triangle's plane; 0 where the pair does not count.
    pub t: Tensor<2>,
    /// ±D/σ; 0 where the pair does not count.
    logit: Tensor<2>,
    /// n·d, untracked: negative where the ray hits the triangle's front.
    pub cosine: Tensor<2>,
    /// Pairs that do not count.
    pub discounted: Tensor<2, Bool>,
    /// Pairs that count by max(0, 2p − 1), and only inside: neighbors of a triangle at an end of the ray.
    softened: Option<Tensor<2, Bool>>,
    /// The factor of each hit from the blurred start of its ray.
    begun: Option<Tensor<2>>,
}

impl Coverage {
    /// Returns exp(−|logit|).
    fn decay(&self) -> Tensor<2> {
        self.logit.clone().abs().neg().exp()
    }

    /// Returns log p of Eq. 1 as it counts, for pairs that count. For softened pairs it is the logarithm of 2p − 1. It
    /// is lower near the start of a ray that leaves a surface.
    pub fn log_probability(&self) -> Tensor<2> {
        let decay = self.decay();
        let mut log = self.logit.clone().clamp_max(0.0) - (decay.clone() + 1.0).log();
        if let Some(softened) = &self.softened {
            // 2p − 1 = (1 − e)/(1 + e) with e = exp(−logit).
            let soft = decay.neg() + 1.0;
            log = log + soft.mask_fill(softened.clone().bool_not(), 1.0).log();
        }
        match &self.begun {
            Some(share) => log + share.clone().clamp_min(1e-30).log(),
            None => log,
        }
    }

    /// Returns 1 − p as it counts: 1 where a pair does not count.
    fn passed(&self) -> Tensor<2> {
        let decay = self.decay();
        let outside = self.logit.clone().lower_elem(0.0);
        // 1 − p = sigmoid(−logit); a softened pair passes 2e/(1 + e).
        let mut passed = decay.clone().mask_fill(outside, 1.0) / (decay + 1.0);
        if let Some(softened) = &self.softened {
            passed = passed.clone().mask_where(softened.clone(), passed * 2.0);
        }
        if let Some(share) = &self.begun {
            passed = passed * share.clone() + share.clone().neg() + 1.0;
        }
        passed.mask_fill(self.discounted.clone(), 1.0)
    }

    /// Returns p as it counts.
    #[cfg(test)]
    pub fn probability(&self) -> Tensor<2> {
        self.passed().neg() + 1.0
    }
}

/// Returns the |n·d| up to which a ray counts as parallel to a triangle.
pub(crate) fn grazing(dtype: DType) -> f64 {
    if dtype == DType::F64 { 1e-9 } else { 1e-6 }
}

/// The intersections `[K, N]` of rays with the planes of triangles.
pub struct PlaneHits {
    /// Distances, tracked with rays and triangles.
    pub t: Tensor<2>,
    /// n·d, untracked: negative where a ray hits the front.
    pub cosine: Tensor<2>,
    /// Whether the ray is not parallel to the plane, and the triangle has area.
    exist: Tensor<2, Bool>,
}

/// Returns the coordinates of the rays' origins along an axis of each pair, in the frame of the unshifted triangle.
fn along(axis: &Vec3, triangles: &Triangles, rays: &Rays, pairs: &Pairs) -> Tensor<2> {
    // Broadcast products replace `matmul`, which is no faster for an inner length of 3, may round to less than f32 on
    // GPUs, and returns zeros on SwiftShader.
    let along = axis.dot(&rays.origin);
    match (&rays.time, &triangles.velocity) {
        // n·(o − time·velocity) = n·o − time·(n·velocity)
        (Some(time), Some(velocity)) => along - axis.dot(&pairs.vectors(velocity)) * time.clone(),
        _ => along,
    }
}

impl PlaneHits {
    pub fn new(context: &Context, triangles: &Triangles, rays: &Rays, pairs: &Pairs) -> Self {
        let normal = pairs.vectors(&triangles.normal);
        let height = pairs.of(&triangles.plane) - along(&normal, triangles, rays, pairs);
        let cosine = normal.dot(&rays.direction);
        let detached_cosine = detached(&cosine);
        let exist = detached_cosine
            .clone()
            .abs()
            .greater_elem(grazing(context.dtype))
            .bool_and(pairs.valid(&triangles.valid).expand(cosine.dims()));
        Self {
            // The inputs of the division are made safe, since masking its output would not prevent NaN.
            t: height / cosine.mask_fill(exist.clone().bool_not(), 1.0),
            cosine: detached_cosine,
            exist,
        }
    }

    /// Returns the hits' coordinates in the triangles' frames, tracked with rays and triangles.
    fn places(&self, triangles: &Triangles, rays: &Rays, pairs: &Pairs) -> [Tensor<2>; 2] {
        let of = |(axis, corner): (&Vec3, &Tensor<2>)| {
            let axis = &pairs.vectors(axis);
            let from = along(axis, triangles, rays, pairs) - pairs.of(corner);
            from + self.t.clone() * axis.dot(&rays.direction)
        };
        [
            (&triangles.u, &triangles.a_u),
            (&triangles.v, &triangles.a_v),
        ]
        .map(of)
    }

    /// Returns the pairs that count by the rules at both ends of a ray, and which of them are softened.
    fn counted(
        &self,
        context: &Context,
        (topology, pairs): (&Topology, &Pairs),
        rays: &Rays,
        settings: &CoverageSettings,
        nearest: &Nearest,
    ) -> (Tensor<2, Bool>, Option<Tensor<2, Bool>>) {
        let t = detached(&self.t);
        let mut counted = (self.exist.clone()).bool_and(t.clone().greater_elem(settings.t_min));
        // Keeps values finite: at such a distance outside, p is exactly 0.
        let largest = settings.sigma * 1e30;
        counted = counted.bool_and(
            nearest
                .squared_distance
                .clone()
                .lower_elem(largest.min(1e37)),
        );
        if let Some((_, distance)) = &rays.arrival {
            let end = distance.clone() * (1.0 - settings.arrival_margin);
            counted = counted.bool_and(t.clone().lower(end));
        }
        let (excluded, softened) = end_masks(context, topology, pairs, rays);
        if let Some(excluded) = excluded {
            counted = counted.bool_and(excluded.bool_not());
        }
        if let Some(hidden) = hidden_sides(context, (topology, pairs), rays, &self.cosine, &t) {
            counted = counted.bool_and(hidden.bool_not());
        }
        if let Some(softened) = &softened {
            // max(0, 2p − 1) is 0 outside, and below rounding close to the border.
            let none = nearest
                .squared_distance
                .clone()
                .lower_elem(settings.sigma * context.epsilon())
                .bool_or(nearest.inside.clone().bool_not());
            counted = counted.bool_and(softened.clone().bool_and(none).bool_not());
        }
        (counted, softened)
    }
}

/// Computes plane hits and edge distances (Eq. 1), with the rules at both ends of a ray.
pub fn coverage(
    context: &Context,
    (triangles, topology): (&Triangles, &Topology),
    rays: &Rays,
    pairs: &Pairs,
    settings: &CoverageSettings,
) -> Coverage {
    let hits = PlaneHits::new(context, triangles, rays, pairs);
    let [base, apex_u, apex_v] =
        [&triangles.base, &triangles.apex_u, &triangles.apex_v].map(|plane| pairs.of(plane));
    let [x, y] = hits.places(triangles, rays, pairs);
    let nearest = nearest_on_triangle(&detached(&x), &detached(&y), &base, &apex_u, &apex_v);
    let (counted, softened) = hits.counted(context, (topology, pairs), rays, settings, &nearest);
    let discounted = counted.clone().bool_not();
    let t = hits.t.mask_fill(discounted.clone(), 0.0);

    // The squared distance at a fixed nearest point has the right derivative (envelope theorem).
    let Nearest {
        weight_b, weight_c, ..
    } = nearest;
    let from_border_x = x - (weight_b * base + weight_c.clone() * apex_u);
    let from_border_y = y - weight_c * apex_v;
    let squared = from_border_x.clone() * from_border_x + from_border_y.clone() * from_border_y;
    let per_sigma = 1.0 / settings.sigma;
    let sign = nearest.inside.float().cast(context.dtype) * (2.0 * per_sigma) - per_sigma;
    let begun = (rays.departure.is_some() && settings.start > 0.0).then(|| {
        let scaled = t.clone() * settings.start.recip();
        (scaled * t.clone()).neg().exp().neg() + 1.0
    });
    Coverage {
        logit: (squared * sign).mask_fill(discounted.clone(), 0.0),
        t,
        cosine: hits.cosine,
        softened: softened.map(|s| s.bool_and(counted)),
        discounted,
        begun,
    }
}

type Masks = (Option<Tensor<2, Bool>>, Option<Tensor<2, Bool>>);

/// Returns masks of the excluded triangles (at the ends of the ray) and of the softened ones (their neighbors).
fn end_masks(context: &Context, topology: &Topology, pairs: &Pairs, rays: &Rays) -> Masks {
    let ends: Vec<&Vec<u32>> = [
        rays.departure.as_ref(),
        rays.arrival.as_ref().map(|(emitter, _)| emitter),
    ]
    .into_iter()
    .flatten()
    .collect();
    if ends.is_empty() {
        return (None, None);
    }
    let (rows, n) = (pairs.rows(), rays.len());
    let mut excluded = vec![false; rows * n];
    let mut softened = vec![false; rows * n];
    for end in ends {
        for (i, &k) in end.iter().enumerate().filter(|e| *e.1 != NO_TRIANGLE) {
            if let Some(row) = pairs.row_of(i, k) {
                excluded[row * n + i] = true;
            }
            pairs.rows_beside(i, k, &topology.neighbors, |row| {
                softened[row * n + i] = true
            });
        }
    }
    let mask = |v| Tensor::from_data(TensorData::new(v, [rows, n]), &context.device);
    (Some(mask(excluded)), Some(mask(softened)))
}

/// Returns the sides of closed objects that cannot be visible. Near its end on an emitter, a ray is treated like a ray
/// that leaves the emitter: there the emitter's object shows its other side.
fn hidden_sides(
    context: &Context,
    (topology, pairs): (&Topology, &Pairs),
    rays: &Rays,
    cosine: &Tensor<2>,
    t: &Tensor<2>,
) -> Option<Tensor<2, Bool>> {
    if topology.visible_side.iter().all(|&s| s == 0.0) {
        return None;
    }
    let side = pairs.constant(context, &topology.visible_side) * cosine.clone();
    let hidden = side.clone().lower_elem(0.0);
    let Some((emitter, distance)) = &rays.arrival else {
        return Some(hidden);
    };
    let closed = |&e: &u32| topology.closed.get(e as usize).is_some_and(|&c| c);
    if !emitter.iter().any(closed) {
        return Some(hidden);
    }
    let objects: Vec<f64> = topology.object.iter().map(|&o| o.into()).collect();
    let object_of = |e: u32| topology.object.get(e as usize).map(|&o| f64::from(o));
    let of_emitter = emitter.iter().map(|&e| object_of(e).unwrap_or(-1.0));
    let of_emitter: Vec<f64> = of_emitter.collect();
    // A ray from an object to itself changes sides halfway.
    let from: Vec<f64> = emitter
        .iter()
        .enumerate()
        .map(|(i, &e)| {
            let same = rays
                .departure
                .as_ref()
                .is_some_and(|d| object_of(d[i]) == object_of(e));
            if same { 0.5 } else { 0.0 }
        })
        .collect();
    let near_end = pairs
        .constant(context, &objects)
        .equal(context.row(&of_emitter))
        .bool_and(
            t.clone()
                .greater_equal(distance.clone() * context.row(&from)),
        );
    Some(hidden.mask_where(near_end, side.greater_elem(0.0)))
}

/// Returns the fraction of light that passes all counted triangles, ∏(1 − p_k) = exp Σ log(1 − p_k), as a row `[1, N]`.
///
/// The paper writes 1 − ∏(1 − p_k) instead, which is the opacity.
pub fn transmittance(coverage: &Coverage) -> Tensor<2> {
    // Behind something opaque, neither light nor a gradient arrives.
    coverage.passed().clamp_min(1e-30).log().sum_dim(0).exp()
}
