//! Direct light at surface points, from points of emitters and from an environment map.

use burn::tensor::Tensor;
use glam::DVec3;

use super::bsdf::{density as density_of_scattering, scattered};
use super::cones::AtBounce;
use super::delta_lights::from_delta_lights;
use super::emission::emission;
use super::lights::{Chosen, SkyMap, Views, nonzero};
use super::shaded::Shaded;
use super::tracer::{Sight, Tracer};
use crate::error::Result;
use crate::geometry::{Vec3, detached, gather_row, host_values, host_vectors};
use softray_kernels::model::v3;
use softray_kernels::sampling::Dimensions;

/// Returns light from one point of one emitter at each surface point, as planes of f·cos θ·cos θ_e/r²·L_e·T over the
/// density. Each result holds the indices of its paths, or `None` for all. The list is empty if the scene has no
/// emitter.
///
/// `scattered` holds the sampled direction of each path ([`Scatter::gathered`](super::bsdf::Scatter::gathered)), and whether such directions are used. If
/// given, light from the emitters in these directions is added (MIS by the power heuristic).
pub(super) fn connect(
    tracer: &Tracer,
    shaded: Shaded,
    scattered: Option<(&[DVec3], &[bool])>,
) -> Result<Vec<(Option<Vec<u32>>, Vec3)>> {
    let lights = tracer.transport.lights;
    if lights.emitters.is_empty() {
        return Ok(Vec::new());
    }
    let scene = tracer.scene();
    let time = shaded.rays.time.as_ref();
    let time = time.filter(|_| scene.triangles.velocity.is_some());
    let looks = lights.emitters.depends_on_position() || scattered.is_some();
    let views = match looks {
        true => Some(Views {
            position: host_vectors(&shaded.points.position)?,
            normal: host_vectors(&shaded.points.geometric_normal)?,
            time: time.map(host_values).transpose()?,
        }),
        false => None,
    };
    let AtBounce { paths, bounce } = shaded.at;
    let sampler = tracer.transport.sampler;
    let [_, _, u, v] = sampler.uniform(paths, Dimensions::emitter(bounce));
    let (chosen, of_lights) = lights.choose(views.as_ref(), &u, &v);
    let mut found = Vec::new();
    if of_lights.is_empty() {
        let combined = scattered.map(|(_, used)| (false, used));
        found.push((None, arriving(tracer, shaded, &chosen, combined)?));
    } else {
        let which: Vec<u32> = chosen.iter().map(|c| c.path).collect();
        if !which.is_empty() {
            let used = scattered.map(|(_, used)| {
                let some = which.iter().map(|&i| used[i as usize]);
                some.collect::<Vec<_>>()
            });
            let light = shaded.of_some(&scene.context, &which, |shaded| {
                arriving(tracer, shaded, &chosen, used.as_deref().map(|u| (false, u)))
            })?;
            found.push((Some(which), light));
        }
        let which: Vec<u32> = of_lights.iter().map(|c| c.path).collect();
        let light = shaded.of_some(&scene.context, &which, |shaded| {
            from_delta_lights(tracer, shaded, &of_lights)
        })?;
        found.push((Some(which), light));
    }
    if let (Some((directions, used)), Some(views)) = (scattered, &views) {
        let mut hits = lights.intersect(views, directions);
        hits.retain(|h| used[h.path as usize]);
        if !hits.is_empty() {
            let which: Vec<u32> = hits.iter().map(|h| h.path).collect();
            let all = vec![true; which.len()];
            let light = shaded.of_some(&scene.context, &which, |shaded| {
                arriving(tracer, shaded, &hits, Some((true, &all)))
            })?;
            found.push((Some(which), light));
        }
    }
    Ok(found)
}

/// Returns the divisor of a sample under the power heuristic of two strategies: the weight w₁ = p₁²/(p₁² + p₂²) makes
/// it (p₁² + p₂²)/p₁ (Veach and Guibas 1995, β = 2).
fn power_heuristic(a: Tensor<2>, b: Tensor<2>, is_b: bool) -> Tensor<2> {
    let own = if is_b { b.clone() } else { a.clone() };
    (a.clone() * a + b.clone() * b) / own.clamp_min(1e-30)
}

/// Returns light from a point of an emitter at each surface point, over its density. If two strategies sample points,
/// `combined` states whether the second (scattering) sampled these, and for which paths it is used.
///
/// Densities carry no gradient. They estimate an integral over the emitters' own area, in which the points are fixed
/// and move with the geometry.
fn arriving(
    tracer: &Tracer,
    shaded: Shaded,
    chosen: &[Chosen],
    combined: Option<(bool, &[bool])>,
) -> Result<Vec3> {
    let scene = tracer.scene();
    let context = &scene.context;
    let Shaded { points, rays, at } = shaded;
    let (incoming, time) = (&rays.direction, &rays.time);
    let row = |f: fn(&Chosen) -> f64| context.row(&chosen.iter().map(f).collect::<Vec<_>>());
    let emitter: Vec<u32> = chosen.iter().map(|c| c.emitter).collect();
    let index = context.index_row(&emitter);
    // The points at the shutter times of the paths.
    let (b, c) = (row(|c| c.weights[0]), row(|c| c.weights[1]));
    let a = (b.clone() + c.clone()).neg() + 1.0;
    let corners = &scene.triangles.corners;
    let mut light = (corners.a.gather(&index).scale(&a))
        .add(&corners.b.gather(&index).scale(&b))
        .add(&corners.c.gather(&index).scale(&c));
    if let (Some(time), Some(velocity)) = (time, &scene.triangles.velocity) {
        light = light.add(&velocity.gather(&index).scale(time));
    }
    let to_light = light.sub(&points.position);
    // The distance to a light that touches the receiver is at least `t_min`, the least distance of a hit.
    let squared = to_light
        .dot(&to_light)
        .clamp_min((tracer.t_min() * tracer.t_min()).max(1e-37));
    let distance = squared.clone().sqrt();
    let direction = to_light.map(|x| x / distance.clone());
    let cosine = scene.triangles.normal.gather(&index).dot(&direction).neg();
    let facing = cosine.clone().clamp_min(0.0);
    let area = gather_row(scene.triangles.area.clone(), &index);
    let material = |&k: &u32| scene.topology.material[k as usize];
    let materials: Vec<u32> = emitter.iter().map(material).collect();
    let uv = scene.uvs.as_ref().map(|corners| {
        let at = |f: fn(&Vec3) -> &Tensor<2>| {
            let of =
                |corner: &Vec3, w: &Tensor<2>| gather_row(f(corner).clone(), &index) * w.clone();
            of(&corners.a, &a) + of(&corners.b, &b) + of(&corners.c, &c)
        };
        [at(|v| &v.x), at(|v| &v.y)]
    });
    let of_material = context.index_row(&materials);
    let emission = emission(scene, &materials, &of_material, &uv, &cosine)?;
    let mut shadow = points.ray(direction, time.clone());
    shadow.arrival = Some((emitter, detached(&distance)));
    // If the light or the surface faces away, or if the surface reflects nothing in this direction, no light arrives,
    // with or without an occluder.
    let reflected = scattered(context, points, incoming, &shadow.direction)?;
    let dense = matches!(tracer.transport.sight, Sight::Softmax(_, None));
    let needed = if !dense {
        let sum = detached(&reflected.x) + detached(&reflected.y) + detached(&reflected.z);
        let needed = host_values(&(sum.abs() * detached(&facing)))?;
        needed.iter().map(|&v| v != 0.0).collect()
    } else {
        vec![true; chosen.len()]
    };
    let passed = tracer.transmittance(&shadow, &needed, at)?;
    let per_area = facing / squared * area;
    let per_area = match &scene.holes {
        Some(holes) => {
            let weights = |c: &Chosen| {
                let [u, v] = c.weights.map(|w| w as f32);
                v3(1.0 - u - v, u, v)
            };
            let shines = |c: &Chosen| u8::from(!holes.masks().open(c.emitter, weights(c)));
            let shines: Vec<f64> = chosen.iter().map(|c| shines(c).into()).collect();
            per_area * context.row(&shines)
        }
        None => per_area,
    };
    // The density is in units of the emitter's area. It carries no gradient, since the points stay fixed on the
    // emitter.
    let mut density = row(|c| c.chance);
    if let Some((by_scattering, used)) = combined {
        let used: Vec<f64> = used.iter().map(|&u| f64::from(u8::from(u))).collect();
        let along = density_of_scattering(points, incoming, &shadow.direction) * context.row(&used);
        density = power_heuristic(density, along * detached(&per_area), by_scattering);
    }
    let light = emission.scale(&(per_area * passed / density));
    Ok(reflected.mul(&light))
}

/// Returns light from an environment map at each surface point along two directions: one sampled from the map, and the
/// one in which the path continues (MIS by the power heuristic). Each result holds the indices of its paths. Directions
/// carry no gradient, since the integral is over a fixed sphere.
pub(super) fn from_map(
    tracer: &Tracer,
    map: &SkyMap,
    shaded: Shaded,
    scattered: &[DVec3],
) -> Result<Vec<(Option<Vec<u32>>, Vec3)>> {
    let AtBounce { paths, bounce } = shaded.at;
    let sampler = tracer.transport.sampler;
    let [_, _, u, v] = sampler.uniform(paths, Dimensions::choices(bounce));
    let (drawn, chances) = map.choose(&u, &v);
    let densities = scattered.iter().map(|&d| map.density(d)).collect();
    let mut found = Vec::new();
    for (by_scattering, directions, density) in
        [(false, &drawn[..], chances), (true, scattered, densities)]
    {
        let directions = (directions, density.as_slice());
        found.extend(along(tracer, map, shaded, directions, by_scattering)?);
    }
    Ok(found)
}

fn along(
    tracer: &Tracer,
    map: &SkyMap,
    shaded: Shaded,
    (directions, density): (&[DVec3], &[f64]),
    by_scattering: bool,
) -> Result<Option<(Option<Vec<u32>>, Vec3)>> {
    let context = &tracer.scene().context;
    let towards = Vec3::from_host(context, directions);
    // No ray is traced where nothing is reflected.
    let incoming = shaded.rays.direction.detached();
    let points = shaded.points.detached();
    let which = nonzero(&scattered(context, &points, &incoming, &towards)?)?;
    if which.is_empty() {
        return Ok(None);
    }
    let density: Vec<f64> = which.iter().map(|&i| density[i as usize]).collect();
    let towards = towards.gather(&context.index_row(&which));
    let light = shaded.of_some(context, &which, |Shaded { points, rays, at }| {
        let next = points.ray(towards.clone(), rays.time.clone());
        let passed = match tracer.transport.sight {
            Sight::Cones(_) => tracer.transmittance(&next, &vec![true; which.len()], at)?,
            Sight::Softmax(..) => tracer.weights(&next)?.background(),
        };
        let by_bsdf = density_of_scattering(points, &rays.direction, &towards);
        let density = power_heuristic(context.row(&density), by_bsdf, by_scattering);
        let light = map.radiance(context, &towards)?.scale(&(passed / density));
        Ok(scattered(context, points, &rays.direction, &towards)?.mul(&light))
    })?;
    Ok(Some((Some(which), light)))
}
