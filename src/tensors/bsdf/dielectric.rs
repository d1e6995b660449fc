//! The microfacet model of refracting matter, in tensors.

use burn::tensor::{Bool, Tensor};

use super::facets::{Facets, clamped, fitted};
use super::{Drawn, Numbers, TensorBsdf, cosine};
use crate::error::Result;
use crate::geometry::{Context, Vec3, detached};
use crate::tensors::surface::{Model, SurfacePoints};
use softray_kernels::host::{MAX_IOR, MIN_CONTRAST, MIN_IOR};
use softray_kernels::model::bsdf::{UPRIGHT, given_back};

/// Returns the fraction of light that is reflected on its way from the side of index 1 to the side of index η.
fn reflected_part(cosine: &Tensor<2>, eta: &Tensor<2>) -> Tensor<2> {
    let square = (cosine.clone() * cosine.clone()).neg() + 1.0;
    let square = square / (eta.clone() * eta.clone());
    let total = detached(&square).greater_equal_elem(1.0);
    let passed = (square.neg() + 1.0).clamp_min(1e-12).sqrt();
    let p = (eta.clone() * cosine.clone() - passed.clone())
        / (eta.clone() * cosine.clone() + passed.clone());
    let s =
        (cosine.clone() - eta.clone() * passed.clone()) / (cosine.clone() + eta.clone() * passed);
    ((p.clone() * p + s.clone() * s) * 0.5).mask_fill(total, 1.0)
}

/// The facet that turns the view direction into an outgoing direction.
struct Turn {
    half: Vec3,
    part: Tensor<2>,
    k: Tensor<2>,
    upright: Tensor<2>,
    eta: Tensor<2>,
    above: Tensor<2, Bool>,
}

/// Facets that reflect and refract.
pub(super) struct Dielectric<'a>(Facets<'a>);

impl<'a> Dielectric<'a> {
    pub fn new(points: &'a SurfacePoints, model: &Model, incoming: &Vec3) -> Self {
        let mut facets = Facets::new(points, model, incoming);
        facets.second.x = clamped(&facets.second.x, MIN_IOR, MAX_IOR);
        Self(facets)
    }

    /// Returns η, the index of refraction of the other side over the index of the view's side.
    fn eta(&self) -> Tensor<2> {
        let ior = self.0.second.x.clone();
        let near = (detached(&ior) - 1.0).abs().lower_elem(MIN_CONTRAST);
        let ior = ior.mask_fill(near, 1.0 + MIN_CONTRAST);
        let inside = self.0.points.inside.clone().greater_elem(0.5);
        ior.clone().mask_where(inside, ior.recip())
    }

    fn turn(&self, outgoing: &Vec3) -> Turn {
        let above = detached(&self.0.points.normal.dot(outgoing)).greater_elem(0.0);
        let eta = self.eta();
        let ones = eta.ones_like().detach();
        let half = self
            .0
            .view
            .add(&outgoing.scale(&eta.clone().mask_where(above.clone(), ones)));
        let down = detached(&half.dot(&self.0.points.normal)).lower_elem(0.0);
        let half = half.map(|x| x.clone().mask_where(down.clone(), x.neg()));
        let square = half.dot(&half).clamp_min(1e-24);
        let a = self.0.view.dot(&half).clamp_min(0.0);
        let b = outgoing.dot(&half).neg().clamp_min(0.0);
        let vh = (a.clone() / square.clone().sqrt()).clamp_max(1.0);
        let reflected = reflected_part(&vh, &eta);
        let nh = half.dot(&self.0.points.normal) / square.clone().sqrt();
        let upright = (nh * UPRIGHT).clamp_max(1.0);
        let k = a * b * 4.0 / (square.clone() * square);
        Turn {
            half,
            part: (reflected.clone().neg() + 1.0).mask_where(above.clone(), reflected),
            k: k.mask_fill(above.clone(), 1.0),
            upright: upright.mask_fill(above.clone(), 1.0),
            eta,
            above,
        }
    }

    /// Returns the fraction of light that facets with the given half vectors reflect, untracked.
    fn part_reflected(&self, half: &Vec3) -> Tensor<2> {
        let cosine = detached(&self.0.view.dot(half)).clamp(0.0, 1.0);
        reflected_part(&cosine, &detached(&self.eta()))
    }

    /// Returns the directions into which facets refract the view direction.
    fn refracted(&self, half: &Vec3) -> Vec3 {
        let eta = self.eta();
        let c = self.0.view.dot(half);
        let square = ((c.clone() * c.clone()).neg() + 1.0) / (eta.clone() * eta.clone());
        let passed = (square.neg() + 1.0).clamp_min(1e-8).sqrt();
        let along = half.scale(&(c / eta.clone() - passed));
        along.sub(&self.0.view.scale(&eta.recip()))
    }
}

impl TensorBsdf for Dielectric<'_> {
    fn albedo(&self) -> Vec3 {
        self.0.first.clone()
    }

    fn evaluate(&self, context: &Context, outgoing: &Vec3) -> Result<Vec3> {
        let t = self.turn(outgoing);
        let v = self.0.visibility(&self.0.points.normal.dot(outgoing).abs());
        let below = cosine(self.0.points, &outgoing.scale_by(-1.0));
        let cosine = below.mask_where(t.above.clone(), cosine(self.0.points, outgoing));
        let mut f = t.part * self.0.distribution(&t.half) * v * t.k * t.upright * cosine;
        if self.0.kind.compensated {
            f = f * fitted(context, given_back, [&self.0.nv, &self.0.alpha, &t.eta])?;
        }
        Ok(self
            .0
            .first
            .map(|tint| tint.mask_fill(t.above.clone(), 1.0) * f.clone()))
    }

    fn density(&self, outgoing: &Vec3) -> Tensor<2> {
        let t = self.turn(outgoing);
        let below = t.eta.clone() * t.eta * t.k;
        let jacobian = below.mask_fill(t.above, 1.0) * 0.25;
        detached(&t.part) * self.0.visible(&t.half) * jacobian
    }

    fn draw(&self, context: &Context, numbers: &Numbers) -> Drawn {
        let half = self.0.draw(context, numbers);
        let of_gloss = numbers.lobe.clone().lower(self.part_reflected(&half));
        let (reflected, refracted) = (self.0.reflected(&half), self.refracted(&half));
        let direction = refracted.zip(&reflected, |o, r| o.mask_where(of_gloss.clone(), r));
        // Light that a slanted facet turns to the wrong side is lost.
        let above = detached(&self.0.points.normal.dot(&direction)).greater_elem(0.0);
        Drawn {
            direction,
            lost: Some(above.not_equal(of_gloss)),
        }
    }
}
