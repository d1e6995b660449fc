//! How surfaces scatter light, in tensors: Lambert plus normalised Phong, f = k_d/π + k_s (n + 2)/(2π) cosⁿα, here, and
//! facets.

mod dielectric;
mod facets;
mod metal;

use std::f64::consts::{PI, TAU};

use burn::tensor::{Bool, Tensor};

use super::surface::SurfacePoints;
use crate::error::Result;
use crate::geometry::{Context, Vec3, detached};
use crate::model::bsdf::HORIZON;
use crate::sampling::{Dimensions, Sampler};
use crate::scene::Bsdf;
use facets::Facets;

/// Values of some points in place of others.
fn replaced(all: Vec3, row: &Tensor<2>, some: &Vec3) -> Vec3 {
    let which: Tensor<2, Bool> = row.clone().greater_elem(0.5);
    all.zip(some, |a, s| a.mask_where(which.clone(), s))
}

/// f(wi, wo)·cos θ_i as planes; zero where nothing is scattered. `incoming` is the ray's direction.
pub(crate) fn scattered(
    context: &Context,
    points: &SurfacePoints,
    incoming: &Vec3,
    outgoing: &Vec3,
) -> Result<Vec3> {
    let mut f = by_phong(points, incoming, outgoing);
    for model in &points.models {
        let facets = Facets::new(points, model, incoming);
        let own = match model.kind.bsdf {
            Bsdf::Dielectric => facets.interface(context, outgoing)?,
            _ => facets.metal(context, outgoing)?,
        };
        f = replaced(f, &model.row, &own);
    }
    Ok(f)
}

fn by_phong(points: &SurfacePoints, incoming: &Vec3, outgoing: &Vec3) -> Vec3 {
    let cosine = cosine(points, outgoing);
    let mut f = points.parameters[0].scale_by(1.0 / PI);
    if let Some((specular, exponent)) = gloss(points) {
        let lobe = phong(exponent, &mirror_cosine(points, incoming, outgoing));
        let norm = (exponent.clone() + 2.0) * (1.0 / TAU);
        f = f.add(&specular.scale(&(lobe * norm)));
    }
    f.scale(&cosine)
}

/// k_s and exponent, if any material of the scene is glossy.
fn gloss(points: &SurfacePoints) -> Option<(&Vec3, &Tensor<2>)> {
    Some((points.parameters.get(1)?, &points.parameters[2].x))
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
    density_of(&points, &incoming, &outgoing)
}

/// The density with which [`sample`] draws a direction; the probabilities of lobes have no tape.
fn density_of(points: &SurfacePoints, incoming: &Vec3, outgoing: &Vec3) -> Tensor<2> {
    let mut density = phong_density(points, incoming, outgoing);
    for model in &points.models {
        let facets = Facets::new(points, model, incoming);
        let own = match model.kind.bsdf {
            Bsdf::Dielectric => facets.interface_density(outgoing),
            _ => facets.metal_density(outgoing),
        };
        density = density.mask_where(model.row.clone().greater_elem(0.5), own);
    }
    density
}

fn phong_density(points: &SurfacePoints, incoming: &Vec3, outgoing: &Vec3) -> Tensor<2> {
    let cosine = points.normal.dot(outgoing).clamp_min(0.0) * (1.0 / PI);
    let Some((specular, exponent)) = gloss(points) else {
        return cosine;
    };
    let p_specular = share_of_gloss(points, specular);
    let lobe = phong(exponent, &mirror_cosine(points, incoming, outgoing));
    cosine * (p_specular.clone().neg() + 1.0)
        + lobe * ((exponent.clone() + 1.0) * (1.0 / TAU)) * p_specular
}

/// The probability of the specular lobe: its share of the albedo, without tape.
fn share_of_gloss(points: &SurfacePoints, specular: &Vec3) -> Tensor<2> {
    let sum = |k: &Vec3| detached(&(k.x.clone() + k.y.clone() + k.z.clone())).abs();
    let (kd, ks) = (sum(&points.parameters[0]), sum(specular));
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
) -> Result<Scatter> {
    let [u, v, ..] = sampler.uniform(paths, Dimensions::direction(bounce));
    let [lobe, ..] = sampler.uniform(paths, Dimensions::choices(bounce));
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
        let mut weight = points.parameters[0].clone();
        if points.smooth {
            let drawn_by = points.normal.dot(&diffuse).clamp_min(1e-7);
            weight = weight.scale(&(cosine(points, &diffuse) / drawn_by));
        }
        return Ok(Scatter {
            weight,
            direction: diffuse,
        });
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

    let lobe = context.row(&lobe);
    let of_gloss = lobe.clone().lower(share_of_gloss(points, specular));
    let mut direction = diffuse.zip(&glossy, |d, g| d.mask_where(of_gloss.clone(), g));
    // Below this the direction can't have been drawn, and the value is zero as well.
    let mut impossible = lobe.zeros_like().greater_elem(0.5);
    for model in &points.models {
        let facets = Facets::new(points, model, incoming);
        let half = facets.draw(context, &u, &v);
        let is_interface = model.kind.bsdf == Bsdf::Dielectric;
        let chance = match is_interface {
            true => facets.part_reflected(&half),
            false => facets.metal_gloss(),
        };
        let of_gloss = lobe.clone().lower(chance);
        let (reflected, other) = (facets.reflected(&half), facets.refracted(&half));
        let other = if is_interface { other } else { diffuse.clone() };
        let own = other.zip(&reflected, |o, r| o.mask_where(of_gloss.clone(), r));
        if is_interface {
            // What a slanted facet turns to the wrong side is lost.
            let above = detached(&points.normal.dot(&own)).greater_elem(0.0);
            let own = model.row.clone().greater_elem(0.5);
            impossible = impossible.bool_or(above.not_equal(of_gloss).bool_and(own));
        }
        direction = replaced(direction, &model.row, &own);
    }
    let value = scattered(context, points, incoming, &direction)?;
    let density = density_of(points, incoming, &direction);
    let impossible = impossible.bool_or(detached(&density).lower_elem(1e-20));
    let density = density.mask_fill(impossible.clone(), 1.0);
    Ok(Scatter {
        weight: value.map(|f| f.mask_fill(impossible.clone(), 0.0) / density.clone()),
        direction,
    })
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

/// Two unit vectors across a unit axis, and across each other (Duff et al. 2017).
fn frame(axis: &Vec3) -> [Vec3; 2] {
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
    [tangent, bitangent]
}

/// A local direction turned so that z lies along a unit axis.
fn from_frame(axis: &Vec3, [x, y, z]: &[Tensor<2>; 3]) -> Vec3 {
    let [tangent, bitangent] = frame(axis);
    let across = tangent.scale(x).add(&bitangent.scale(y));
    across.add(&axis.scale(z))
}
