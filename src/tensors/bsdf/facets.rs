//! Microfacets in tensors: the GGX distribution with Smith masking, and sampling of visible half vectors
//! ([`softray_kernels::model::bsdf`]).

use std::f64::consts::{PI, TAU};

use burn::tensor::Tensor;

use super::{Numbers, frame, from_frame};
use crate::geometry::{Context, Vec3, detached, host_values};
use crate::tensors::surface::{Model, SurfacePoints};
use softray_kernels::host::MaterialKind;
use softray_kernels::model::bsdf::Fit;

/// The least α.
const MIN_ALPHA: f64 = 1e-3;
/// The least square that is a divisor.
const TINY: f64 = 1e-12;

/// Facets at the surface points of one model. The other points have substitute parameters, so that no value there is
/// NaN.
pub(super) struct Facets<'a> {
    pub points: &'a SurfacePoints,
    pub kind: MaterialKind,
    /// The direction towards the eye, on the normal's side.
    pub view: Vec3,
    pub alpha: Tensor<2>,
    pub nv: Tensor<2>,
    pub rv: Tensor<2>,
    /// The parameters that precede the roughness.
    pub first: Vec3,
    pub second: Vec3,
}

/// Returns √(α² + (1 − α²) c²).
fn slant(square: &Tensor<2>, cosine: &Tensor<2>) -> Tensor<2> {
    let cosines = cosine.clone() * cosine.clone();
    (square.clone() + (square.clone().neg() + 1.0) * cosines).sqrt()
}

impl<'a> Facets<'a> {
    pub fn new(points: &'a SurfacePoints, model: &Model, incoming: &Vec3) -> Self {
        let other = model.row.clone().lower_elem(0.5);
        let safe = |place: usize, value: f64| {
            points.parameters[place].map(|p| p.mask_fill(other.clone(), value))
        };
        let roughness = clamped(&safe(2, 0.5).x, 0.0, 1.0);
        let alpha = (roughness.clone() * roughness).clamp_min(MIN_ALPHA);
        let along = points.normal.dot(incoming);
        // Where an interpolated normal faces away, the view direction is mirrored.
        let behind = along.clone().clamp_min(0.0) * 2.0;
        let nv = along.abs();
        Self {
            points,
            kind: model.kind,
            view: points.normal.scale(&behind).sub(incoming),
            rv: slant(&(alpha.clone() * alpha.clone()), &nv),
            alpha,
            nv,
            first: safe(0, 0.5),
            second: safe(1, 1.5),
        }
    }

    fn square(&self) -> Tensor<2> {
        self.alpha.clone() * self.alpha.clone()
    }

    /// Returns D(h) for vectors along h.
    pub fn distribution(&self, half: &Vec3) -> Tensor<2> {
        let normal = &self.points.normal;
        let height = normal.dot(half);
        let across = half.sub(&normal.scale(&height));
        let share = across.dot(&across) / half.dot(half).clamp_min(TINY);
        let square = self.square();
        let e = square.clone() + (square.clone().neg() + 1.0) * share;
        let below = detached(&height).lower_equal_elem(0.0);
        (square * (1.0 / PI) / (e.clone() * e)).mask_fill(below, 0.0)
    }

    /// Returns V = G/(4 n·v n·l).
    pub fn visibility(&self, nl: &Tensor<2>) -> Tensor<2> {
        let nl = nl.clone().clamp_min(TINY);
        let rl = slant(&self.square(), &nl);
        let sum = nl * self.rv.clone() + self.nv.clone() * rl;
        sum.clamp_min(TINY).recip() * 0.5
    }

    /// Returns the density D of visible facets over v·h.
    pub fn visible(&self, half: &Vec3) -> Tensor<2> {
        self.distribution(half) * 2.0 / (self.nv.clone() + self.rv.clone())
    }

    /// Samples the half vector of a visible facet with two uniform numbers (Dupuy and Benyoub 2023).
    pub fn draw(&self, context: &Context, numbers: &Numbers) -> Vec3 {
        let Numbers { u, v, .. } = numbers;
        let axes = frame(&self.points.normal);
        let [x, y] = axes.map(|axis| axis.dot(&self.view));
        let z = self.points.normal.dot(&self.view);
        let row = |f: &dyn Fn(usize) -> f64| context.row(&(0..u.len()).map(f).collect::<Vec<_>>());
        let stretched = Vec3::new(x * self.alpha.clone(), y * self.alpha.clone(), z).normalized();
        let height = row(&|i| 1.0 - u[i]) - row(&|i| u[i]) * stretched.z.clone();
        let sine = ((height.clone() * height.clone()).neg() + 1.0)
            .clamp_min(1e-7)
            .sqrt();
        let cap = Vec3::new(
            sine.clone() * row(&|i| (TAU * v[i]).cos()),
            sine * row(&|i| (TAU * v[i]).sin()),
            height,
        );
        let sum = cap.add(&stretched);
        let local = Vec3::new(
            sum.x * self.alpha.clone(),
            sum.y * self.alpha.clone(),
            sum.z.clamp_min(0.0),
        )
        .normalized();
        from_frame(&self.points.normal, &[local.x, local.y, local.z])
    }

    /// Returns the directions into which facets reflect the view direction.
    pub fn reflected(&self, half: &Vec3) -> Vec3 {
        half.scale(&(self.view.dot(half) * 2.0)).sub(&self.view)
    }
}

/// Clamps numbers to a range. Clamped numbers have no derivative.
pub(super) fn clamped(x: &Tensor<2>, low: f64, high: f64) -> Tensor<2> {
    let (below, above) = (detached(x).lower_elem(low), detached(x).greater_elem(high));
    x.clone().mask_fill(below, low).mask_fill(above, high)
}

/// Evaluates a fit of the kernels at cosines, α and indices of refraction. The fit's derivatives enter the graph.
pub(super) fn fitted(
    context: &Context,
    fit: impl Fn(f32, f32, f32) -> Fit,
    [cosine, alpha, eta]: [&Tensor<2>; 3],
) -> crate::Result<Tensor<2>> {
    let (c, a, n) = (host_values(cosine)?, host_values(alpha)?, host_values(eta)?);
    let found: Vec<Fit> = (0..c.len())
        .map(|i| fit(c[i] as f32, a[i] as f32, n[i] as f32))
        .collect();
    let row = |f: fn(&Fit) -> f32| {
        context.row(&found.iter().map(|x| f64::from(f(x))).collect::<Vec<_>>())
    };
    let change = |t: &Tensor<2>| t.clone() - detached(t);
    Ok(row(|f| f.value)
        + row(|f| f.by_cosine) * change(cosine)
        + row(|f| f.by_alpha) * change(alpha)
        + row(|f| f.by_eta) * change(eta))
}
