//! The path loop: draw a surface, connect it to an emitter, scatter, repeat.

use std::cell::RefCell;

use burn::tensor::{IndexingUpdateOp, Tensor};

use super::batch::{Batch, is_identity, roulette, times, weighted};
use super::cones::AtBounce;
use super::diagnostics::Diagnostics;
use super::surface::SurfacePoints;
use super::tracer::{Census, RayWeights, Sight, Tracer, Transport};
use super::{Dimension, Sky, SurfaceSampling, bsdf, emitters};
use crate::error::Result;
use crate::geometry::Vec3;
use crate::scene::Flattened;
use crate::visibility::Rays;

/// What the paths of a tile bring back; rows `[1, N]`.
pub(crate) struct Radiance<'a> {
    pub radiance: Vec3,
    /// How the surfaces share the camera rays, with those rays.
    pub first: RayWeights<'a>,
    /// What the rays met.
    pub census: Census,
    /// What was degenerate, if that was asked for.
    pub diagnostics: Option<Diagnostics>,
}

/// Contributions of some of a tile's paths.
pub(super) struct Contribution {
    pub bounce: u32,
    pub slots: Vec<u32>,
    pub light: Vec3,
}

/// The ratios W/stop(W) of the surfaces that some of a tile's paths drew.
struct Draw {
    bounce: u32,
    slots: Vec<u32>,
    /// What part of its slot a path stands for, where that is not all.
    share: Option<Vec<f64>>,
    ratio: Tensor<2>,
}

/// Radiance along camera rays, each of the path (pixel, sample); `per_pixel` consecutive paths
/// belong to one pixel.
pub(crate) fn trace<'a>(
    transport: Transport<'a>,
    rays: Rays,
    paths: &[(u32, u32)],
    per_pixel: usize,
) -> Result<Radiance<'a>> {
    let Transport {
        scene,
        settings,
        sampler,
        sky,
        ..
    } = transport;
    // Light of a map is gathered along directions drawn from it as well; other light of an
    // environment where bounce rays miss.
    let combined = settings.sampling.multiple_importance;
    let map = sky.and_then(Sky::map).filter(|_| combined);
    let sky = sky.filter(|_| map.is_none());
    let tracer = Tracer {
        transport,
        census: RefCell::default(),
        diagnostics: RefCell::new(settings.diagnostics.then(Diagnostics::default)),
    };
    let context = &scene.context;
    let count = paths.len();
    let triangles = scene.triangles.len() as u32;
    let mut found: Vec<Contribution> = Vec::new();
    let mut draws: Vec<Draw> = Vec::new();
    let mut batch = Batch {
        paths: paths.to_vec(),
        slots: (0..count as u32).collect(),
        share: None,
        rays,
        throughput: None,
    };
    let mut first = None;
    let mut seen = None;
    // Black surfaces end a path.
    let useful = |k: u32| {
        k < triangles && {
            let m = scene.topology.material[k as usize] as usize;
            scene.materials.kinds[m].reflects
        }
    };

    for bounce in 0..=settings.bounces {
        let weights = tracer.weights(&batch.rays)?;
        let alive = batch.paths.len() as u64;
        tracer.census.borrow_mut().bounces.push(alive);
        if bounce == 0 {
            seen = emitters::seen(&transport, &weights, &batch.rays.direction)?;
        }
        let dark = scene.emitters.is_empty() && transport.sky.is_none();
        let split = bounce == 0 && settings.sampling.surfaces == SurfaceSampling::Split;
        let [random] = sampler.uniform(&batch.paths, bounce, [Dimension::Surface]);
        let drawn = if split {
            let drawn = if dark {
                Vec::new()
            } else {
                batch.split(&tracer, &weights, &random, useful)?
            };
            first = Some(weights);
            drawn
        } else {
            let drawn = weights.draw(context, &random)?;
            if let Some(ratio) = weights.ratio(context, &drawn) {
                batch.throughput = Some(times(batch.throughput.take(), &ratio));
                draws.push(Draw {
                    bounce,
                    slots: batch.slots.clone(),
                    share: batch.share.clone(),
                    ratio,
                });
            }
            if bounce == 0 {
                first = Some(weights);
            }
            drawn
        };
        if dark || drawn.is_empty() {
            break;
        }
        // Who drew the background sees the environment, and is done. Camera rays have seen it.
        if let Some(sky) = sky
            && bounce > 0
        {
            let missed: Vec<u32> = (0..drawn.len() as u32)
                .filter(|&i| drawn[i as usize] >= triangles)
                .collect();
            if !missed.is_empty() {
                let n = missed.len();
                let index = context.index_row(&missed);
                let light = sky.radiance(context, &batch.rays.direction.gather(&index))?;
                let light = light.map(|e| e.expand([1, n]));
                found.push(batch.contribution(context, bounce, Some(&missed), light));
            }
        }
        let hits: Vec<u32> = (0..drawn.len() as u32)
            .filter(|&i| useful(drawn[i as usize]))
            .collect();
        if hits.is_empty() {
            break;
        }
        let drawn: Vec<u32> = hits.iter().map(|&i| drawn[i as usize]).collect();
        batch.keep(context, &hits);
        let points = SurfacePoints::new(scene, &batch.rays, drawn)?;
        let incoming = batch.rays.direction.clone();
        let last = bounce == settings.bounces;
        // Points on emitters are found well from a matt surface without its help.
        let glossy: Vec<bool> = (points.triangle.iter())
            .map(|&k| scene.materials.kinds[scene.topology.material[k as usize] as usize].glossy)
            .collect();
        let by_scattering = combined && !scene.emitters.is_empty() && glossy.iter().any(|&g| g);
        let goes_on = !last || sky.is_some();
        let scatter = (goes_on || by_scattering || map.is_some())
            .then(|| bsdf::sample(context, &points, &incoming, sampler, &batch.paths, bounce));
        let direction = scatter.as_ref().map(|s| &s.direction);
        let along = direction.filter(|_| by_scattering);
        let along = along.map(|d| (d, glossy.as_slice()));
        let mut lit =
            emitters::connect(&tracer, &points, &batch.rays, &batch.paths, bounce, along)?;
        if let (Some(map), Some(direction)) = (map, direction) {
            let (rays, paths) = (&batch.rays, &batch.paths);
            lit.extend(emitters::from_sky(
                &tracer, map, &points, rays, paths, bounce, direction,
            )?);
        }
        for (which, light) in lit {
            found.push(batch.contribution(context, bounce, which.as_deref(), light));
        }
        let Some(scatter) = scatter.filter(|_| goes_on) else {
            break;
        };
        let direction = match transport.sight {
            Sight::Cones(cones) => {
                let at = AtBounce {
                    paths: &batch.paths,
                    bounce,
                };
                cones.bend(context, &points, scatter.direction, at)?
            }
            Sight::Softmax(..) => scatter.direction,
        };
        batch.rays = Rays {
            origin: points.position,
            direction,
            time: batch.rays.time,
            departure: Some(points.triangle),
            arrival: None,
        };
        let next = weighted(scatter.weight, batch.throughput.take());
        if let Some(d) = tracer.diagnostics.borrow_mut().as_mut() {
            d.throughput(&next)?;
        }
        batch.throughput = Some(next);
        if last {
            // The environment's share of the direct light at the last hit.
            if let Some(sky) = sky {
                let visible = tracer.weights(&batch.rays)?.attached_background(context);
                let light = sky
                    .radiance(context, &batch.rays.direction)?
                    .scale(&visible);
                found.push(batch.contribution(context, bounce, None, light));
            }
            break;
        }
        if settings.roulette_after.is_some_and(|after| bounce >= after) {
            let survivors = roulette(&tracer, &mut batch, bounce)?;
            batch.keep(context, &survivors);
            if batch.paths.is_empty() {
                break;
            }
        }
    }
    let first = match first {
        Some(first) => first,
        None => tracer.weights(&batch.rays)?,
    };
    if let Some(d) = tracer.diagnostics.borrow_mut().as_mut() {
        for c in &found {
            d.light(&c.light)?;
        }
    }
    let mut radiance = whole(scene, &found, 0, count);
    if let Some(seen) = seen {
        radiance = radiance.add(&seen);
    }
    for draw in &draws {
        let later = whole(scene, &found, draw.bounce, count).plain();
        if let Some(control) = control_variate(scene, draw, &later, per_pixel) {
            radiance = radiance.add(&control);
        }
    }
    Ok(Radiance {
        radiance,
        first,
        census: tracer.census.into_inner(),
        diagnostics: tracer.diagnostics.into_inner(),
    })
}

/// Contributions of a bounce and all later ones, added up by path.
fn whole(scene: &Flattened, found: &[Contribution], from: u32, count: usize) -> Vec3 {
    let zero = Tensor::<2>::zeros([1, count], (&scene.context.device, scene.context.dtype));
    let mut sum = Vec3::new(zero.clone(), zero.clone(), zero);
    for c in found.iter().filter(|c| c.bounce >= from) {
        sum = sum.add(&c.light.map(|l| spread(scene, l, &c.slots, count)));
    }
    sum
}

/// A row of some paths as a row of all, zero elsewhere.
fn spread(scene: &Flattened, row: Tensor<2>, slots: &[u32], count: usize) -> Tensor<2> {
    if is_identity(slots, count) {
        return row;
    }
    let context = &scene.context;
    Tensor::<2>::zeros([1, count], (&context.device, context.dtype)).scatter(
        1,
        context.index_row(slots),
        row,
        IndexingUpdateOp::Add,
    )
}

/// A term of value 0 that lowers the variance of the gradient of a draw. The derivative of a
/// drawn weight has an expectation of 0 whatever it is multiplied by, as long as that does not
/// depend on the draw: so the mean of what the pixel's *other* paths brought back is taken off
/// (a leave-one-out baseline of the score-function estimator).
fn control_variate(scene: &Flattened, draw: &Draw, later: &Vec3, per_pixel: usize) -> Option<Vec3> {
    if per_pixel < 2 {
        return None;
    }
    let count = later.x.dims()[1];
    let mut change = draw.ratio.clone() - 1.0;
    if let Some(share) = &draw.share {
        change = change * scene.context.row(share);
    }
    let change = spread(scene, change, &draw.slots, count);
    Some(later.map(|l| {
        let l = l.reshape([count / per_pixel, per_pixel]);
        let others = (l.clone().sum_dim(1) - l) / (per_pixel - 1) as f64;
        (others.reshape([1, count]) * change.clone()).neg()
    }))
}
