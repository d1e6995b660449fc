//! Microfacets that reflect, in tensors: conductors and metallic–roughness.

use std::f64::consts::PI;

use burn::tensor::Tensor;

use super::facets::{Facets, clamped, fitted};
use super::{Drawn, Numbers, TensorBsdf, cosine};
use crate::error::Result;
use crate::geometry::{Context, Vec3, detached};
use crate::tensors::surface::{Model, SurfacePoints};
use softray_kernels::host::{BsdfKind, MAX_METAL_IOR};
use softray_kernels::model::bsdf::{
    DIELECTRIC_F0, Fit, dielectric_facets, lost, mean_of_dielectric_facets,
};

/// The least probability of each lobe if there are two.
const MIN_PROBABILITY: f64 = 0.05;

/// Returns Fresnel's reflectance of a metal with the index η − i k.
fn conductor(cosine: &Tensor<2>, eta: Tensor<2>, k: Tensor<2>) -> Tensor<2> {
    let square = cosine.clone() * cosine.clone();
    let rest = square.clone().neg() + 1.0;
    let product = eta.clone() * k.clone();
    let (eta2, k2) = (eta.clone() * eta, k.clone() * k);
    let t0 = eta2.clone() - k2.clone() - rest.clone();
    let sum = (t0.clone() * t0.clone() + eta2 * k2 * 4.0)
        .clamp_min(1e-24)
        .sqrt();
    let a = ((sum.clone() + t0.clone()) * 0.5).clamp_min(1e-24).sqrt();
    // The sum above cancels where η is small and t0 ≤ 0, so this form replaces it there.
    let behind = detached(&t0).lower_equal_elem(0.0);
    let stable = product * ((sum.clone() - t0).clamp_min(1e-24).recip() * 2.0).sqrt();
    let a = a.mask_where(behind, stable);
    let (t1, t2) = (sum.clone() + square.clone(), a * cosine.clone() * 2.0);
    let (t3, t4) = (
        square * sum + rest.clone() * rest.clone(),
        t2.clone() * rest,
    );
    let across = (t1.clone() - t2.clone()) / (t1 + t2);
    let ratio = (t3.clone() - t4.clone()) / (t3 + t4).clamp_min(1e-24);
    across * (ratio + 1.0) * 0.5
}

/// Returns (1 − cos)⁵.
fn schlick(cosine: &Tensor<2>) -> Tensor<2> {
    (cosine.clone().neg() + 1.0).clamp_min(0.0).powi_scalar(5)
}

/// Facets that reflect.
pub(super) struct Metal<'a>(Facets<'a>);

impl<'a> Metal<'a> {
    pub fn new(points: &'a SurfacePoints, model: &Model, incoming: &Vec3) -> Self {
        let mut metal = Self(Facets::new(points, model, incoming));
        let Facets { first, second, .. } = &mut metal.0;
        if model.kind.bsdf == BsdfKind::Conductor {
            for v in [first, second] {
                *v = v.map(|x| clamped(&x, 0.0, MAX_METAL_IOR));
            }
        } else {
            second.x = clamped(&second.x, 0.0, 1.0);
        }
        metal
    }

    fn is_conductor(&self) -> bool {
        self.0.kind.bsdf == BsdfKind::Conductor
    }

    /// Returns Fresnel's reflectance of a conductor.
    fn fresnel(&self, cosine: &Tensor<2>) -> Vec3 {
        self.0
            .first
            .zip(&self.0.second, |eta, k| conductor(cosine, eta, k))
    }

    /// Returns the reflectance of facets, including multiple-scattering compensation. For metallic–roughness, it is the
    /// sum of the reflectances of metal and non-metal, each weighted by its share.
    fn reflectance(&self, context: &Context, cosine: &Tensor<2>) -> Result<Vec3> {
        let lost = match self.0.kind.compensated {
            true => self.fitted(context, lost, &self.0.nv)?,
            false => self.0.nv.zeros_like().detach(),
        };
        if self.is_conductor() {
            let f0 = self.fresnel(&cosine.ones_like().detach());
            let more = f0.map(|f0| f0 * lost.clone() + 1.0);
            return Ok(self.fresnel(cosine).mul(&more));
        }
        let f0 = f64::from(DIELECTRIC_F0);
        let white = schlick(cosine);
        let metal = &self.0.second.x;
        let rest = (white.clone() * (1.0 - f0) + f0) * (lost.clone() * f0 + 1.0);
        let rest = rest * (metal.clone().neg() + 1.0);
        Ok(self.0.first.map(|base| {
            let of_metal = (base.clone().neg() + 1.0) * white.clone() + base.clone();
            of_metal * (base * lost.clone() + 1.0) * metal.clone() + rest.clone()
        }))
    }

    /// Evaluates a fit of the kernels at cosines and the facets' α.
    fn fitted(
        &self,
        context: &Context,
        fit: fn(f32, f32) -> Fit,
        cosine: &Tensor<2>,
    ) -> Result<Tensor<2>> {
        let by_two = |c: f32, a: f32, _: f32| fit(c, a);
        fitted(context, by_two, [cosine, &self.0.alpha, &self.0.alpha])
    }

    /// Returns the probability of sampling a direction from the facets, untracked.
    fn gloss(&self) -> Tensor<2> {
        if self.is_conductor() {
            return self.0.nv.ones_like().detach();
        }
        let sum = |v: &Vec3| detached(&v.x).abs() + detached(&v.y).abs() + detached(&v.z).abs();
        let metal = detached(&self.0.second.x);
        let white = schlick(&self.0.nv);
        let rest = (metal.clone().neg() + 1.0) * f64::from(DIELECTRIC_F0);
        let f0 = self.0.first.scale(&metal).map(|x| x + rest.clone());
        let reflected = f0.map(|f0| (f0.clone().neg() + 1.0) * white.clone() + f0);
        let reflected = sum(&reflected);
        let below = (metal.neg() + 1.0) * sum(&self.0.first);
        let all = below.clone().lower_equal_elem(0.0);
        let share = reflected.clone() / (reflected + below);
        share
            .clamp(MIN_PROBABILITY, 1.0 - MIN_PROBABILITY)
            .mask_fill(all, 1.0)
    }
}

impl TensorBsdf for Metal<'_> {
    fn albedo(&self) -> Vec3 {
        match self.is_conductor() {
            true => self.fresnel(&self.0.nv.ones_like().detach()),
            false => self.0.first.clone(),
        }
    }

    fn evaluate(&self, context: &Context, outgoing: &Vec3) -> Result<Vec3> {
        let half = self.0.view.add(outgoing);
        let nl = self.0.points.normal.dot(outgoing).clamp_min(0.0);
        let cosine = cosine(self.0.points, outgoing);
        let vh = half.dot(&half).clamp_min(1e-24).sqrt() * 0.5;
        let facing = self.0.distribution(&half) * self.0.visibility(&nl) * cosine.clone();
        let mut f = self.reflectance(context, &vh)?.scale(&facing);
        if !self.is_conductor() {
            let fit = |c: &Tensor<2>| self.fitted(context, dielectric_facets, c);
            let seen = fit(&self.0.nv)?.neg() + 1.0;
            let lit = fit(&nl)?.neg() + 1.0;
            let mean = |_: f32, alpha: f32| {
                let mean = mean_of_dielectric_facets(alpha);
                Fit {
                    value: mean.x,
                    by_cosine: 0.0,
                    by_alpha: mean.y,
                    by_eta: 0.0,
                }
            };
            let mean = self.fitted(context, mean, &self.0.nv)?;
            let through = seen * lit / (mean.neg() + 1.0);
            let below = (self.0.second.x.clone().neg() + 1.0) * (1.0 / PI) * cosine;
            f = f.add(&self.0.first.scale(&(below * through)));
        }
        Ok(f)
    }

    fn density(&self, outgoing: &Vec3) -> Tensor<2> {
        let gloss = self.gloss();
        let facets = self.0.visible(&self.0.view.add(outgoing)) * 0.25;
        let below = self.0.points.normal.dot(outgoing).clamp_min(0.0) * (1.0 / PI);
        facets * gloss.clone() + below * (gloss.neg() + 1.0)
    }

    fn draw(&self, context: &Context, numbers: &Numbers) -> Drawn {
        let reflected = self.0.reflected(&self.0.draw(context, numbers));
        let of_gloss = numbers.lobe.clone().lower(self.gloss());
        let matt = &numbers.matt;
        Drawn {
            direction: matt.zip(&reflected, |m, r| m.mask_where(of_gloss.clone(), r)),
            lost: None,
        }
    }
}
