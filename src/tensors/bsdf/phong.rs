//! Lambert plus normalized Phong in tensors: f = k_d/π + k_s (n + 2)/(2π) cosⁿα.

use std::f64::consts::{PI, TAU};

use burn::tensor::Tensor;

use super::{Drawn, Numbers, TensorBsdf, cosine, from_frame};
use crate::error::Result;
use crate::geometry::{Context, Vec3, detached};
use crate::tensors::surface::SurfacePoints;

/// The model at all surface points.
pub(super) struct Phong<'a> {
    pub points: &'a SurfacePoints,
    pub incoming: &'a Vec3,
}

impl Phong<'_> {
    /// Returns k_s and the exponent, if any material of the scene is glossy.
    pub fn gloss(&self) -> Option<(&Vec3, &Tensor<2>)> {
        let parameters = &self.points.parameters;
        Some((parameters.get(1)?, &parameters[2].x))
    }

    /// Returns the probability of the specular lobe, untracked: its share of the albedo.
    fn share_of_gloss(&self, specular: &Vec3) -> Tensor<2> {
        let sum = |k: &Vec3| detached(&(k.x.clone() + k.y.clone() + k.z.clone())).abs();
        let (kd, ks) = (sum(&self.points.parameters[0]), sum(specular));
        ks.clone() / (kd + ks).clamp_min(1e-20)
    }

    fn mirror(&self) -> Vec3 {
        let along = self.points.normal.dot(self.incoming) * 2.0;
        self.incoming.sub(&self.points.normal.scale(&along))
    }

    /// Returns cosⁿα of directions.
    fn lobe(&self, exponent: &Tensor<2>, outgoing: &Vec3) -> Tensor<2> {
        phong(exponent, &self.mirror().dot(outgoing))
    }
}

impl TensorBsdf for Phong<'_> {
    fn albedo(&self) -> Vec3 {
        let diffuse = &self.points.parameters[0];
        match self.gloss() {
            Some((specular, _)) => diffuse.add(specular),
            None => diffuse.clone(),
        }
    }

    fn evaluate(&self, _: &Context, outgoing: &Vec3) -> Result<Vec3> {
        let cosine = cosine(self.points, outgoing);
        let mut f = self.points.parameters[0].scale_by(1.0 / PI);
        if let Some((specular, exponent)) = self.gloss() {
            let norm = (exponent.clone() + 2.0) * (1.0 / TAU);
            f = f.add(&specular.scale(&(self.lobe(exponent, outgoing) * norm)));
        }
        Ok(f.scale(&cosine))
    }

    fn density(&self, outgoing: &Vec3) -> Tensor<2> {
        let cosine = self.points.normal.dot(outgoing).clamp_min(0.0) * (1.0 / PI);
        let Some((specular, exponent)) = self.gloss() else {
            return cosine;
        };
        let p_specular = self.share_of_gloss(specular);
        let norm = (exponent.clone() + 1.0) * (1.0 / TAU);
        let lobe = self.lobe(exponent, outgoing);
        cosine * (p_specular.clone().neg() + 1.0) + lobe * norm * p_specular
    }

    fn draw(&self, context: &Context, numbers: &Numbers) -> Drawn {
        let matt = &numbers.matt;
        let Some((specular, exponent)) = self.gloss() else {
            return Drawn {
                direction: matt.clone(),
                lost: None,
            };
        };
        let Numbers { u, v, .. } = numbers;
        let list = |f: &dyn Fn(usize) -> f64| -> Tensor<2> {
            context.row(&(0..u.len()).map(f).collect::<Vec<_>>())
        };
        // The Phong lobe lies about the mirror direction: cos α = u^(1/(n + 1)). u is kept away from 0 and 1, where the
        // derivative of the square root is unbounded.
        let log_u = list(&|i| u[i].clamp(1e-7, 1.0 - 1e-7).ln());
        let log_cosine = log_u / (exponent.clone() + 1.0);
        let cosine = log_cosine.clone().exp();
        let sine = ((log_cosine * 2.0).exp().neg() + 1.0)
            .clamp_min(context.epsilon())
            .sqrt();
        let local = [
            sine.clone() * list(&|i| (TAU * v[i]).cos()),
            sine * list(&|i| (TAU * v[i]).sin()),
            cosine,
        ];
        let glossy = from_frame(&self.mirror(), &local);
        let of_gloss = numbers.lobe.clone().lower(self.share_of_gloss(specular));
        Drawn {
            direction: matt.zip(&glossy, |d, g| d.mask_where(of_gloss.clone(), g)),
            lost: None,
        }
    }
}

/// Returns cosⁿα, or 0 for α over 90°.
fn phong(exponent: &Tensor<2>, cosine: &Tensor<2>) -> Tensor<2> {
    let behind = detached(cosine).lower_equal_elem(1e-12);
    let log = cosine
        .clone()
        .mask_fill(behind.clone(), 1.0)
        .clamp_max(1.0)
        .log();
    (log * exponent.clone()).exp().mask_fill(behind, 0.0)
}
