//! Lambert plus normalised Phong: f = k_d/π + k_s (n + 2)/(2π) cosⁿα, on both sides.

use std::f64::consts::{PI, TAU};

use burn::tensor::Tensor;

use super::surface::SurfacePoints;
use crate::geometry::{Context, Vec3, detached};
use crate::model::bsdf::HORIZON;
use crate::sampling::{Dimension, Sampler};
use crate::scene::Channel;

/// f(wi, wo)·cos θ_i as planes; zero below the surface. `incoming` is the ray's direction.
pub(crate) fn scattered(points: &SurfacePoints, incoming: &Vec3, outgoing: &Vec3) -> Vec3 {
    let cosine = cosine(points, outgoing);
    let mut f = points.parameters[Channel::Diffuse as usize].scale_by(1.0 / PI);
    if let Some((specular, exponent)) = gloss(points) {
        let lobe = phong(exponent, &mirror_cosine(points, incoming, outgoing));
        let norm = (exponent.clone() + 2.0) * (1.0 / TAU);
        f = f.add(&specular.scale(&(lobe * norm)));
    }
    f.scale(&cosine)
}

/// k_s and exponent, if any material of the scene is glossy.
fn gloss(points: &SurfacePoints) -> Option<(&Vec3, &Tensor<2>)> {
    let specular = points.parameters.get(Channel::Specular as usize)?;
    let exponent = &points.parameters[Channel::Shininess as usize].x;
    Some((specular, exponent))
}

/// cos θ to the shading normal, but at most four times that to the geometric normal
/// ([`crate::model::bsdf`]); 0 below the surface.
fn cosine(points: &SurfacePoints, outgoing: &Vec3) -> Tensor<2> {
    let shaded = points.normal.dot(outgoing);
    if !points.smooth {
        return shaded.clamp_min(0.0);
    }
    let horizon = points.geometric_normal.dot(outgoing) * HORIZON;
    shaded.min_pair(horizon).clamp_min(0.0)
}

/// The density per solid angle with which [`sample`] draws a direction, without tape.
pub(crate) fn density(points: &SurfacePoints, incoming: &Vec3, outgoing: &Vec3) -> Tensor<2> {
    let points = points.detached();
    let (incoming, outgoing) = (incoming.detached(), outgoing.detached());
    let cosine = points.normal.dot(&outgoing).clamp_min(0.0) * (1.0 / PI);
    let Some((specular, exponent)) = gloss(&points) else {
        return cosine;
    };
    let p_specular = share_of_gloss(&points, specular);
    let lobe = phong(exponent, &mirror_cosine(&points, &incoming, &outgoing));
    cosine * (p_specular.clone().neg() + 1.0)
        + lobe * ((exponent.clone() + 1.0) * (1.0 / TAU)) * p_specular
}

/// The probability of the specular lobe: its share of the albedo, without tape.
fn share_of_gloss(points: &SurfacePoints, specular: &Vec3) -> Tensor<2> {
    let sum = |k: &Vec3| detached(&(k.x.clone() + k.y.clone() + k.z.clone())).abs();
    let (kd, ks) = (
        sum(&points.parameters[Channel::Diffuse as usize]),
        sum(specular),
    );
    ks.clone() / (kd + ks).clamp_min(1e-20)
}

/// A sampled direction and the throughput f·cos/pdf along it.
pub(crate) struct Scatter {
    pub direction: Vec3,
    /// RGB factor; zero where the direction falls below the surface.
    pub weight: Vec3,
}

/// Draws one lobe in proportion to its albedo and a direction from it; divides by the density of
/// the mixture.
pub(crate) fn sample(
    context: &Context,
    points: &SurfacePoints,
    incoming: &Vec3,
    sampler: &Sampler,
    paths: &[(u32, u32)],
    bounce: u32,
) -> Scatter {
    let dimensions = [Dimension::DirectionU, Dimension::DirectionV];
    let [u, v] = sampler.uniform(paths, bounce, dimensions);
    let [lobe] = sampler.uniform(paths, bounce, [Dimension::Lobe]);
    let list = |f: &dyn Fn(usize) -> f64| -> Tensor<2> {
        context.row(&(0..u.len()).map(f).collect::<Vec<_>>())
    };
    // Cosine-weighted hemisphere about the shading normal.
    let local = [
        list(&|i| u[i].sqrt() * (TAU * v[i]).cos()),
        list(&|i| u[i].sqrt() * (TAU * v[i]).sin()),
        list(&|i| (1.0 - u[i]).sqrt()),
    ];
    let diffuse = from_frame(&points.normal, &local);
    let Some((specular, exponent)) = gloss(points) else {
        // f·cos/pdf is k_d, whatever the direction, but near the horizon of a smooth surface.
        let mut weight = points.parameters[Channel::Diffuse as usize].clone();
        if points.smooth {
            let drawn_by = points.normal.dot(&diffuse).clamp_min(1e-7);
            weight = weight.scale(&(cosine(points, &diffuse) / drawn_by));
        }
        return Scatter {
            weight,
            direction: diffuse,
        };
    };
    // Phong lobe about the mirror direction: cos α = u^(1/(n + 1)). The number is kept off 0 and
    // 1, where the derivative of the square root has no bound.
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
    let glossy = from_frame(&mirror(points, incoming), &local);

    let p_specular = share_of_gloss(points, specular);
    let lobe = context.row(&lobe).lower(p_specular.clone());
    let direction = diffuse.zip(&glossy, |d, g| d.mask_where(lobe.clone(), g));

    let value = scattered(points, incoming, &direction);
    let phong = phong(exponent, &mirror_cosine(points, incoming, &direction));
    let density = points.normal.dot(&direction).clamp_min(0.0)
        * ((p_specular.clone().neg() + 1.0) / PI)
        + phong * ((exponent.clone() + 1.0) * (1.0 / TAU)) * p_specular;
    // Below this the direction can't have been drawn, and the value is zero as well.
    let impossible = detached(&density).lower_elem(1e-20);
    let density = density.mask_fill(impossible.clone(), 1.0);
    Scatter {
        weight: value.map(|f| f.mask_fill(impossible.clone(), 0.0) / density.clone()),
        direction,
    }
}

fn mirror(points: &SurfacePoints, incoming: &Vec3) -> Vec3 {
    let along = points.normal.dot(incoming) * 2.0;
    incoming.sub(&points.normal.scale(&along))
}

fn mirror_cosine(points: &SurfacePoints, incoming: &Vec3, outgoing: &Vec3) -> Tensor<2> {
    mirror(points, incoming).dot(outgoing)
}

/// cosⁿα, 0 for α over 90°.
fn phong(exponent: &Tensor<2>, cosine: &Tensor<2>) -> Tensor<2> {
    let behind = detached(cosine).lower_equal_elem(1e-12);
    let log = cosine
        .clone()
        .mask_fill(behind.clone(), 1.0)
        .clamp_max(1.0)
        .log();
    (log * exponent.clone()).exp().mask_fill(behind, 0.0)
}

/// A local direction turned so that z lies along a unit axis (Duff et al. 2017).
fn from_frame(axis: &Vec3, local: &[Tensor<2>; 3]) -> Vec3 {
    let [x, y, z] = local.clone();
    let sign = detached(&axis.z)
        .greater_equal_elem(0.0)
        .float()
        .cast(axis.z.dtype())
        * 2.0
        - 1.0;
    let a = (axis.z.clone() + sign.clone()).recip().neg();
    let b = axis.x.clone() * axis.y.clone() * a.clone();
    let tangent = Vec3::new(
        sign.clone() * axis.x.clone() * axis.x.clone() * a.clone() + 1.0,
        sign.clone() * b.clone(),
        (sign.clone() * axis.x.clone()).neg(),
    );
    let bitangent = Vec3::new(
        b,
        axis.y.clone() * axis.y.clone() * a + sign,
        axis.y.clone().neg(),
    );
    tangent
        .scale(&x)
        .add(&bitangent.scale(&y))
        .add(&axis.scale(&z))
}
