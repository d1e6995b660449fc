//! Light from an environment map at surface points.

use super::bsdf::{density as density_of_scattering, scattered};
use super::cones::AtBounce;
use super::emitters::power_heuristic;
use super::sky::{SkyMap, nonzero};
use super::surface::SurfacePoints;
use super::tracer::{Sight, Tracer};
use crate::error::Result;
use crate::geometry::{Vec3, gather_row, host_vectors};
use crate::sampling::Dimension;
use crate::visibility::Rays;

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
