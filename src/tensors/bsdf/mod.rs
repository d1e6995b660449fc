//! BSDFs in tensors, one file for each model ([`formulas`]).

mod dielectric;
mod facets;
mod metal;
mod phong;

use std::f64::consts::TAU;

use burn::tensor::{Bool, Tensor};
use glam::DVec3;

use super::lights::nonzero;
use super::surface::{Model, SurfacePoints};
use crate::error::Result;
use crate::geometry::{Context, Vec3, detached, host_vectors};
use dielectric::Dielectric;
use metal::Metal;
use phong::Phong;
use softray_kernels::host::BsdfKind;
use softray_kernels::model::bsdf::HORIZON;
use softray_kernels::model::frame::TURN;
use softray_kernels::sampling::{Dimensions, Sampler};

/// A BSDF at surface points.
trait TensorBsdf {
    /// Returns the approximate color of the surfaces, whatever the light and the view.
    fn albedo(&self) -> Vec3;

    /// Returns f(wi, wo)·cos θ_i as planes, 0 where nothing is scattered.
    fn evaluate(&self, context: &Context, outgoing: &Vec3) -> Result<Vec3>;

    /// Returns the density of directions. The probabilities of lobes are untracked.
    fn density(&self, outgoing: &Vec3) -> Tensor<2>;

    fn draw(&self, context: &Context, numbers: &Numbers) -> Drawn;
}

/// Uniform numbers of surface points, and directions of matt surfaces that the first two numbers sample.
struct Numbers {
    u: Vec<f64>,
    v: Vec<f64>,
    lobe: Tensor<2>,
    matt: Vec3,
}

/// Sampled directions, and which of them are lost.
struct Drawn {
    direction: Vec3,
    lost: Option<Tensor<2, Bool>>,
}

/// Returns the formulas of a model. Points of other models have substitute parameters. `incoming` is the ray's
/// direction.
fn formulas<'a>(
    points: &'a SurfacePoints,
    model: &Model,
    incoming: &'a Vec3,
) -> Box<dyn TensorBsdf + 'a> {
    match model.kind.bsdf {
        BsdfKind::Phong => Box::new(Phong { points, incoming }),
        BsdfKind::MetallicRoughness | BsdfKind::Conductor => {
            Box::new(Metal::new(points, model, incoming))
        }
        BsdfKind::Dielectric => Box::new(Dielectric::new(points, model, incoming)),
    }
}

/// Replaces the values of points whose `row` is 1.
fn replaced(all: Vec3, row: &Tensor<2>, some: &Vec3) -> Vec3 {
    let which: Tensor<2, Bool> = row.clone().greater_elem(0.5);
    all.zip(some, |a, s| a.mask_where(which.clone(), s))
}

/// Returns the approximate color of surfaces, whatever the light.
pub(crate) fn albedo(points: &SurfacePoints, incoming: &Vec3) -> Vec3 {
    let mut color = Phong { points, incoming }.albedo();
    for model in &points.models {
        let own = formulas(points, model, incoming).albedo();
        color = replaced(color, &model.row, &own);
    }
    color
}

/// Returns f(wi, wo)·cos θ_i as planes, 0 where nothing is scattered. `incoming` is the ray's direction.
pub(crate) fn scattered(
    context: &Context,
    points: &SurfacePoints,
    incoming: &Vec3,
    outgoing: &Vec3,
) -> Result<Vec3> {
    let mut f = Phong { points, incoming }.evaluate(context, outgoing)?;
    for model in &points.models {
        let own = formulas(points, model, incoming).evaluate(context, outgoing)?;
        f = replaced(f, &model.row, &own);
    }
    Ok(f)
}

/// Returns cos θ to the shading normal, limited to four times the cosine to the geometric normal
/// ([`softray_kernels::model::bsdf`]). It is 0 below the surface.
fn cosine(points: &SurfacePoints, outgoing: &Vec3) -> Tensor<2> {
    let shaded = points.normal.dot(outgoing);
    if !points.smooth {
        return shaded.clamp_min(0.0);
    }
    let horizon = points.geometric_normal.dot(outgoing) * HORIZON;
    shaded.min_pair(horizon).clamp_min(0.0)
}

/// Returns the density per solid angle with which [`sample`] draws a direction, untracked.
pub(crate) fn density(points: &SurfacePoints, incoming: &Vec3, outgoing: &Vec3) -> Tensor<2> {
    let points = points.detached();
    let (incoming, outgoing) = (incoming.detached(), outgoing.detached());
    density_of(&points, &incoming, &outgoing)
}

/// Returns the density with which [`sample`] draws a direction. The probabilities of lobes are untracked.
fn density_of(points: &SurfacePoints, incoming: &Vec3, outgoing: &Vec3) -> Tensor<2> {
    let mut density = Phong { points, incoming }.density(outgoing);
    for model in &points.models {
        let own = formulas(points, model, incoming).density(outgoing);
        density = density.mask_where(model.row.clone().greater_elem(0.5), own);
    }
    density
}

/// A sampled direction, and the throughput f·cos/pdf along it.
pub(crate) struct Scatter {
    pub direction: Vec3,
    /// RGB factor. It is 0 where the sample is lost: no light is gathered along its direction, although others may sample
    /// that direction.
    pub weight: Vec3,
}

impl Scatter {
    /// Returns the directions along which light is gathered, 0 for those that are lost.
    pub fn gathered(&self) -> Result<Vec<DVec3>> {
        let directions = host_vectors(&self.direction)?;
        let mut found = vec![DVec3::ZERO; directions.len()];
        for i in nonzero(&self.weight)? {
            found[i as usize] = directions[i as usize];
        }
        Ok(found)
    }
}

/// Draws a lobe with a probability in proportion to its albedo, and a direction from this lobe. Divides by the density
/// of the mixture.
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
    let matt = from_frame(&points.normal, &local);
    let phong = Phong { points, incoming };
    if phong.gloss().is_none() {
        // f·cos/pdf is k_d in all directions, except near the horizon of a smooth surface.
        let mut weight = points.parameters[0].clone();
        if points.smooth {
            let drawn_by = points.normal.dot(&matt).clamp_min(1e-7);
            weight = weight.scale(&(cosine(points, &matt) / drawn_by));
        }
        return Ok(Scatter {
            weight,
            direction: matt,
        });
    }
    let lobe = context.row(&lobe);
    let numbers = Numbers { u, v, lobe, matt };
    // Directions and densities do not follow the parameters: detached sampling, as in the kernels.
    let still = &points.with_constant_parameters();
    let phong = Phong {
        points: still,
        incoming,
    };
    let mut direction = phong.draw(context, &numbers).direction;
    // A direction of lower density cannot have been drawn, and its value is 0 as well.
    let mut impossible = numbers.lobe.zeros_like().greater_elem(0.5);
    for model in &points.models {
        let drawn = formulas(still, model, incoming).draw(context, &numbers);
        if let Some(lost) = drawn.lost {
            let own = model.row.clone().greater_elem(0.5);
            impossible = impossible.bool_or(lost.bool_and(own));
        }
        direction = replaced(direction, &model.row, &drawn.direction);
    }
    let value = scattered(context, points, incoming, &direction)?;
    let density = density_of(still, incoming, &direction);
    let impossible = impossible.bool_or(detached(&density).lower_elem(1e-20));
    let density = density.mask_fill(impossible.clone(), 1.0);
    Ok(Scatter {
        weight: value.map(|f| f.mask_fill(impossible.clone(), 0.0) / density.clone()),
        direction,
    })
}

/// Returns two unit vectors that are perpendicular to a unit axis and to each other, as [`softray_kernels::model::frame`] does.
fn frame(axis: &Vec3) -> [Vec3; 2] {
    let sign = detached(&axis.z)
        .greater_equal_elem(TURN)
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

/// Rotates a local direction so that z lies along a unit axis.
fn from_frame(axis: &Vec3, [x, y, z]: &[Tensor<2>; 3]) -> Vec3 {
    let [tangent, bitangent] = frame(axis);
    let across = tangent.scale(x).add(&bitangent.scale(y));
    across.add(&axis.scale(z))
}
