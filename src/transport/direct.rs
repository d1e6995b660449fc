//! Light from points of emitters and from an environment map at surface points.

use burn::tensor::{Int, Tensor};

use super::bsdf::{density as density_of_scattering, scattered};
use super::cones::AtBounce;
use super::lights::{SkyMap, Views, nonzero};
use super::surface::SurfacePoints;
use super::tracer::{Sight, Tracer};
use crate::error::Result;
use crate::geometry::{Vec3, detached, gather_row, host_values, host_vectors};
use crate::sampling::Dimension;
use crate::visibility::Rays;

/// Points of emitters, one for each of some paths, by strategies whose densities carry no
/// gradient: what they estimate is an integral over the emitters' own area, in which the points
/// are fixed and move with the geometry.
struct LightPoints {
    emitter: Vec<u32>,
    /// Weights of corners b and c.
    b: Vec<f64>,
    c: Vec<f64>,
    /// Probability of the emitter when emitters are chosen.
    chance: Vec<f64>,
}

/// Two strategies for points on emitters.
struct Combined {
    /// Whether these points were found by the second, scattering.
    by_scattering: bool,
    /// The paths for which the second is used.
    used: Vec<bool>,
}

/// Shaded points, how the light gets there, and where it goes.
struct Shaded<'a> {
    points: &'a SurfacePoints,
    incoming: &'a Vec3,
    time: &'a Option<Tensor<2>>,
    at: AtBounce<'a>,
}

fn views(tracer: &Tracer, shaded: &Shaded) -> Result<Views> {
    Ok(Views {
        position: host_vectors(&shaded.points.position)?,
        time: match tracer.scene().triangles.velocity {
            Some(_) => shaded.time.as_ref().map(host_values).transpose()?,
            None => None,
        },
    })
}

/// Light from one point of one emitter triangle at each surface point: planes of
/// f·cos θ·cos θ_e/r²·L_e·T over the density. With `scattered`, the direction in which each path goes
/// on and whether it is to be used, also from the emitters that lie there (the power heuristic), as
/// rows of some paths. Empty where the scene has no emitter.
pub(crate) fn connect(
    tracer: &Tracer,
    points: &SurfacePoints,
    rays: &Rays,
    paths: &[(u32, u32)],
    bounce: u32,
    scattered: Option<(&Vec3, &[bool])>,
) -> Result<Vec<(Option<Vec<u32>>, Vec3)>> {
    let lights = tracer.transport.lights;
    if lights.is_empty() {
        return Ok(Vec::new());
    }
    let shaded = Shaded {
        points,
        incoming: &rays.direction,
        time: &rays.time,
        at: AtBounce { paths, bounce },
    };
    let looks = lights.depends_on_position() || scattered.is_some();
    let views = looks.then(|| views(tracer, &shaded)).transpose()?;
    let dimensions = [Dimension::EmitterU, Dimension::EmitterV];
    let [u, v] = tracer.transport.sampler.uniform(paths, bounce, dimensions);
    let chosen = lights.choose(views.as_ref(), &u);
    let (b, c) = chosen
        .iter()
        .zip(&v)
        .map(|((_, _, u), v)| (u.sqrt() * (1.0 - v), u.sqrt() * v))
        .unzip();
    let chosen = LightPoints {
        emitter: chosen.iter().map(|e| e.0).collect(),
        b,
        c,
        chance: chosen.iter().map(|e| e.1).collect(),
    };
    let combined = scattered.map(|(_, used)| Combined {
        by_scattering: false,
        used: used.to_vec(),
    });
    let mut found = vec![(None, arriving(tracer, &shaded, chosen, combined)?)];
    if let (Some((direction, used)), Some(views)) = (scattered, &views) {
        let direction = host_vectors(direction)?;
        let context = &tracer.scene().context;
        let mut hits = lights.intersect(views, &direction);
        hits.retain(|h| used[h.path as usize]);
        if !hits.is_empty() {
            let which: Vec<u32> = hits.iter().map(|h| h.path).collect();
            let index = context.index_row(&which);
            let shaded = Shaded {
                points: &points.pick(context, &which),
                incoming: &rays.direction.gather(&index),
                time: &rays.time.as_ref().map(|t| gather_row(t.clone(), &index)),
                at: AtBounce {
                    paths: &which.iter().map(|&i| paths[i as usize]).collect::<Vec<_>>(),
                    bounce,
                },
            };
            let chosen = LightPoints {
                chance: lights.chance(views, &hits),
                emitter: hits.iter().map(|h| h.emitter).collect(),
                b: hits.iter().map(|h| h.b).collect(),
                c: hits.iter().map(|h| h.c).collect(),
            };
            let combined = Combined {
                by_scattering: true,
                used: vec![true; which.len()],
            };
            let light = arriving(tracer, &shaded, chosen, Some(combined))?;
            found.push((Some(which), light));
        }
    }
    Ok(found)
}

/// The divisor of a sample under the power heuristic of two strategies: w₁ = p₁²/(p₁² + p₂²)
/// makes that (p₁² + p₂²)/p₁ (Veach and Guibas 1995, β = 2).
pub(super) fn power_heuristic(a: Tensor<2>, b: Tensor<2>, is_b: bool) -> Tensor<2> {
    let own = if is_b { b.clone() } else { a.clone() };
    (a.clone() * a + b.clone() * b) / own.clamp_min(1e-30)
}

/// Light from a point of an emitter at each surface point, over its density.
fn arriving(
    tracer: &Tracer,
    shaded: &Shaded,
    chosen: LightPoints,
    combined: Option<Combined>,
) -> Result<Vec3> {
    let scene = tracer.scene();
    let context = &scene.context;
    let Shaded {
        points,
        incoming,
        time,
        at,
    } = *shaded;
    let emitter = chosen.emitter;
    let index = context.index_row(&emitter);
    let light = positions(tracer, time, &index, &chosen.b, &chosen.c);
    let to_light = light.sub(&points.position);
    // A light that touches the receiver is held off by the distance under which hits don't count.
    let squared = to_light
        .dot(&to_light)
        .clamp_min((tracer.t_min() * tracer.t_min()).max(1e-37));
    let distance = squared.clone().sqrt();
    let direction = to_light.map(|x| x / distance.clone());
    let facing = scene
        .triangles
        .normal
        .gather(&index)
        .dot(&direction)
        .neg()
        .clamp_min(0.0);
    let area = gather_row(scene.triangles.area.clone(), &index);
    let count = emitter.len();
    let materials: Vec<u32> = emitter
        .iter()
        .map(|&k| scene.topology.material[k as usize])
        .collect();
    let emission = scene
        .materials
        .emission()
        .gather(&context.index_row(&materials));
    let rays = Rays {
        origin: points.position.clone(),
        direction,
        time: time.clone(),
        departure: Some(points.triangle.clone()),
        arrival: Some((emitter, detached(&distance))),
    };
    // Where the light or the surface faces away, or the surface reflects nothing there, nothing
    // arrives whatever is in between.
    let reflected = scattered(points, incoming, &rays.direction);
    let dense = matches!(tracer.transport.sight, Sight::Softmax(_, None));
    let needed = if !dense {
        let sum = detached(&reflected.x) + detached(&reflected.y) + detached(&reflected.z);
        let needed = host_values(&(sum.abs() * detached(&facing)))?;
        needed.iter().map(|&v| v != 0.0).collect()
    } else {
        vec![true; count]
    };
    let passed = tracer.transmittance(&rays, &needed, at)?;
    let per_area = facing / squared * area;
    // In units of the emitter's area, without gradient: the points stay where they are on it.
    let mut density = context.row(&chosen.chance);
    if let Some(Combined {
        by_scattering,
        used,
    }) = combined
    {
        let used: Vec<f64> = used.iter().map(|&u| f64::from(u8::from(u))).collect();
        let along = density_of_scattering(points, incoming, &rays.direction) * context.row(&used);
        density = power_heuristic(density, along * detached(&per_area), by_scattering);
    }
    let light = emission.scale(&(per_area * passed / density));
    Ok(reflected.mul(&light))
}

/// Points of emitters by weights of their corners b and c, at the times of paths.
fn positions(
    tracer: &Tracer,
    time: &Option<Tensor<2>>,
    index: &Tensor<2, Int>,
    b: &[f64],
    c: &[f64],
) -> Vec3 {
    let scene = tracer.scene();
    let (b, c) = (scene.context.row(b), scene.context.row(c));
    let a = (b.clone() + c.clone()).neg() + 1.0;
    let corners = &scene.triangles.corners;
    let light = corners
        .a
        .gather(index)
        .scale(&a)
        .add(&corners.b.gather(index).scale(&b))
        .add(&corners.c.gather(index).scale(&c));
    match (time, &scene.triangles.velocity) {
        (Some(time), Some(velocity)) => light.add(&velocity.gather(index).scale(time)),
        _ => light,
    }
}

/// Light from an environment map at each surface point along two directions, one drawn from the map
/// and the one in which the path goes on (the power heuristic), as rows of some paths. Directions
/// carry no gradient: the integral is over a fixed sphere.
pub(crate) fn from_map(
    tracer: &Tracer,
    map: &SkyMap,
    points: &SurfacePoints,
    rays: &Rays,
    paths: &[(u32, u32)],
    bounce: u32,
    scattered: &Vec3,
) -> Result<Vec<(Option<Vec<u32>>, Vec3)>> {
    let dimensions = [Dimension::EnvironmentU, Dimension::EnvironmentV];
    let [u, v] = tracer.transport.sampler.uniform(paths, bounce, dimensions);
    let drawn = map.choose(&u, &v);
    let scattered = host_vectors(scattered)?;
    let densities = scattered.iter().map(|&d| map.density(d)).collect();
    let mut found = Vec::new();
    for (by_scattering, (directions, density)) in [(false, drawn), (true, (scattered, densities))] {
        found.extend(along(
            tracer,
            map,
            points,
            rays,
            (&directions, &density),
            AtBounce { paths, bounce },
            by_scattering,
        )?);
    }
    Ok(found)
}

#[allow(clippy::too_many_arguments)] // one place, called twice
fn along(
    tracer: &Tracer,
    map: &SkyMap,
    points: &SurfacePoints,
    rays: &Rays,
    (directions, density): (&[glam::DVec3], &[f64]),
    at: AtBounce,
    by_scattering: bool,
) -> Result<Option<(Option<Vec<u32>>, Vec3)>> {
    let context = &tracer.scene().context;
    let towards = Vec3::from_host(context, directions);
    // Where nothing is reflected no ray is traced.
    let reflected = scattered(&points.detached(), &rays.direction.detached(), &towards);
    let which = nonzero(&reflected)?;
    if which.is_empty() {
        return Ok(None);
    }
    let index = context.index_row(&which);
    let points = points.pick(context, &which);
    let incoming = rays.direction.gather(&index);
    let towards = towards.gather(&index);
    let density: Vec<f64> = which.iter().map(|&i| density[i as usize]).collect();
    let next = Rays {
        origin: points.position.clone(),
        direction: towards.clone(),
        time: rays.time.as_ref().map(|t| gather_row(t.clone(), &index)),
        departure: Some(points.triangle.clone()),
        arrival: None,
    };
    let paths: Vec<(u32, u32)> = which.iter().map(|&i| at.paths[i as usize]).collect();
    let passed = match tracer.transport.sight {
        Sight::Cones(_) => {
            let at = AtBounce {
                paths: &paths,
                ..at
            };
            tracer.transmittance(&next, &vec![true; paths.len()], at)?
        }
        Sight::Softmax(..) => tracer.weights(&next)?.attached_background(context),
    };
    let by_bsdf = density_of_scattering(&points, &incoming, &towards);
    let density = power_heuristic(context.row(&density), by_bsdf, by_scattering);
    let light = map.radiance(context, &towards)?.scale(&(passed / density));
    let reflected = scattered(&points, &incoming, &towards);
    Ok(Some((Some(which), reflected.mul(&light))))
}
