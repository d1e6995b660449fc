//! Explicit connection to one emitter point.

use burn::tensor::Tensor;

use super::Dimension;
use super::bsdf::scattered;
use super::path::{RayWeights, Tracer};
use super::surface::SurfacePoints;
use crate::error::Result;
use crate::geometry::{Vec3, host_values, plain};
use crate::scene::Flattened;
use crate::visibility::{Rays, SparseWeights};

/// What camera rays see of emitters and environment: the mean over all their surfaces, not over
/// drawn ones, which has no noise of a draw. None where all is black.
pub(crate) fn seen(scene: &Flattened, weights: &RayWeights) -> Result<Option<Vec3>> {
    if scene.emitters.is_empty() && scene.environment.is_none() {
        return Ok(None);
    }
    let context = &scene.context;
    let weights = match weights {
        RayWeights::Dense(weights) => weights,
        RayWeights::Sparse(weights) => return Ok(Some(seen_by_candidates(scene, weights)?)),
    };
    let front = weights.cosine().clone().lower_elem(0.0);
    let front = front.float().cast(context.dtype);
    let materials = context.index_row(&scene.topology.material);
    let emission = scene.materials.emission.gather(&materials);
    let mean = |emission: &Tensor<2>, environment: Option<&Tensor<2>>| {
        let emission = emission.clone().transpose() * front.clone();
        weights.mean(emission, environment.cloned())
    };
    let environment = scene.environment.as_ref();
    Ok(Some(Vec3::new(
        mean(&emission.x, environment.map(|e| &e.x)),
        mean(&emission.y, environment.map(|e| &e.y)),
        mean(&emission.z, environment.map(|e| &e.z)),
    )))
}

fn seen_by_candidates(scene: &Flattened, weights: &SparseWeights) -> Result<Vec3> {
    let material = &scene.topology.material;
    let emits = &scene.materials.emits;
    let channel = |emission: &Tensor<2>, environment: Option<&Tensor<2>>| -> Result<Tensor<2>> {
        let radiance = host_values(emission)?;
        let sky = environment
            .map(host_values)
            .transpose()?
            .map_or(0.0, |e| e[0]);
        let of = |k: u32, front: bool| {
            let m = material[k as usize];
            (front && emits[m as usize]).then_some(m)
        };
        let value = |_, k, front| of(k, front).map_or(0.0, |m| radiance[m as usize]);
        let mut mean = weights.mean(value, |_| sky);
        if emission.is_tracked()
            && let Some(row) = weights.spread(emission, |k, front| Some((of(k, front)?, 1.0)))
        {
            let value = plain(&row);
            mean = mean + (row - value);
        }
        if let Some(environment) = environment
            && environment.is_tracked()
        {
            let background = plain(&weights.attached_background());
            let value = plain(environment);
            mean = mean + (environment.clone() - value) * background;
        }
        Ok(mean)
    };
    let emission = &scene.materials.emission;
    let environment = scene.environment.as_ref();
    Ok(Vec3::new(
        channel(&emission.x, environment.map(|e| &e.x))?,
        channel(&emission.y, environment.map(|e| &e.y))?,
        channel(&emission.z, environment.map(|e| &e.z))?,
    ))
}

/// Light from one point of one emitter triangle, both uniform, at each surface point: planes of
/// f·cos θ·cos θ_e/r²·L_e·T over the density. None where the scene has no emitter.
pub(crate) fn connect(
    tracer: &Tracer,
    points: &SurfacePoints,
    incoming: &Vec3,
    time: &Option<Tensor<2>>,
    paths: &[(u32, u32)],
    bounce: u32,
) -> Result<Option<Vec3>> {
    let scene = tracer.scene;
    if scene.emitters.is_empty() {
        return Ok(None);
    }
    let context = &scene.context;
    let random = |d| tracer.sampler.uniform(paths, bounce, d);
    let count = scene.emitters.len();
    let emitter: Vec<u32> = random(Dimension::Emitter)
        .iter()
        .map(|&u| scene.emitters[((u * count as f64) as usize).min(count - 1)])
        .collect();
    let index = context.index_row(&emitter);
    let (u, v) = (random(Dimension::EmitterU), random(Dimension::EmitterV));
    let weights: Vec<(f64, f64)> = u
        .iter()
        .zip(&v)
        .map(|(&u, &v)| (u.sqrt() * (1.0 - v), u.sqrt() * v))
        .collect();
    let b = context.row(&weights.iter().map(|w| w.0).collect::<Vec<_>>());
    let c = context.row(&weights.iter().map(|w| w.1).collect::<Vec<_>>());
    let a = (b.clone() + c.clone()).neg() + 1.0;
    let corners = &scene.triangles.corners;
    let mut light = corners
        .a
        .gather(&index)
        .scale(&a)
        .add(&corners.b.gather(&index).scale(&b))
        .add(&corners.c.gather(&index).scale(&c));
    if let (Some(time), Some(velocity)) = (time, &scene.triangles.velocity) {
        light = light.add(&velocity.gather(&index).scale(time));
    }
    let to_light = light.sub(&points.position);
    // A light that touches the receiver is held off by the distance under which hits don't count.
    let squared = to_light
        .dot(&to_light)
        .clamp_min(tracer.t_min() * tracer.t_min());
    let distance = squared.clone().sqrt();
    let direction = to_light.map(|x| x / distance.clone());
    let facing = scene
        .triangles
        .normal
        .gather(&index)
        .dot(&direction)
        .neg()
        .clamp_min(0.0);
    let area = crate::geometry::gather_row(scene.triangles.area.clone(), &index);
    let materials: Vec<u32> = emitter
        .iter()
        .map(|&k| scene.topology.material[k as usize])
        .collect();
    let emission = scene
        .materials
        .emission
        .gather(&context.index_row(&materials));
    let rays = Rays {
        origin: points.position.clone(),
        direction,
        time: time.clone(),
        departure: Some(points.triangle.clone()),
        arrival: Some((emitter, plain(&distance))),
    };
    // Where the light or the surface faces away, or the surface reflects nothing there, nothing
    // arrives whatever is in between.
    let reflected = scattered(points, incoming, &rays.direction);
    let needed = if tracer.sparse.is_some() {
        let sum = plain(&reflected.x) + plain(&reflected.y) + plain(&reflected.z);
        let needed = host_values(&(sum.abs() * plain(&facing)))?;
        needed.iter().map(|&v| v != 0.0).collect()
    } else {
        vec![true; paths.len()]
    };
    let passed = tracer.transmittance(&rays, &needed)?;
    let geometry = facing / squared * area * passed * count as f64;
    let light = emission.scale(&geometry);
    Ok(Some(reflected.mul(&light)))
}
