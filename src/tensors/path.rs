//! The path loop: draw a surface, connect it to an emitter, scatter, repeat.

use burn::tensor::Tensor;

use super::SurfaceSampling;
use super::bsdf::{self, Scatter};
use super::cones::AtBounce;
use super::diagnostics::Diagnostics;
use super::direct;
use super::lights::{Sky, SkyMap};
use super::paths::{Contribution, PathBatch, roulette, times, weighted};
use super::rays::{Rays, spread};
use super::seen;
use super::shaded::Shaded;
use super::softmax::Shares;
use super::surface::SurfacePoints;
use super::tracer::{RayStatistics, Sight, Tracer, Transport};
use crate::error::Result;
use crate::geometry::Vec3;
use crate::scene::Flattened;

/// The light of a tile's paths, in rows `[1, N]`.
pub(crate) struct Radiance {
    pub radiance: Vec3,
    /// The shares of surfaces in the primary rays, with these rays.
    pub first: Shares,
    /// The albedo of a surface of each primary ray, if requested; untracked.
    pub albedo: Option<Vec3>,
    pub statistics: RayStatistics,
    /// Counts of degenerate cases, if requested.
    pub diagnostics: Option<Diagnostics>,
}

/// The ratios W / detach(W) of the surfaces that some of a tile's paths drew.
struct Draw {
    bounce: u32,
    slots: Vec<u32>,
    /// The fraction of its slot that each path represents. `None` stands for 1.
    share: Option<Vec<f64>>,
    ratio: Tensor<2>,
}

/// The paths of a tile while they are traced.
struct Tracing<'a> {
    tracer: Tracer<'a>,
    batch: PathBatch,
    /// The map, if its light is added both along directions sampled from it and along scattered directions.
    map: Option<&'a SkyMap>,
    /// Other environments, whose light is added where bounce rays miss.
    sky: Option<&'a Sky>,
    contributions: Vec<Contribution>,
    draws: Vec<Draw>,
    /// The shares of surfaces in the primary rays, and the light that these rays see.
    first: Option<Shares>,
    seen: Option<Vec3>,
    albedo: Option<Vec3>,
}

/// Returns the radiance along primary rays, each of which belongs to a path (pixel, sample). `per_pixel` consecutive
/// paths belong to one pixel.
pub(crate) fn trace<'a>(
    transport: Transport<'a>,
    rays: Rays,
    paths: &[(u32, u32)],
    per_pixel: usize,
) -> Result<Radiance> {
    let Transport {
        scene,
        settings,
        sky,
        ..
    } = transport;
    let combined = settings.sampling.multiple_importance;
    let map = sky.and_then(Sky::map).filter(|_| combined);
    let mut tracing = Tracing {
        tracer: Tracer::new(transport),
        batch: PathBatch {
            paths: paths.to_vec(),
            slots: (0..paths.len() as u32).collect(),
            share: None,
            rays,
            throughput: None,
        },
        map,
        sky: sky.filter(|_| map.is_none()),
        contributions: Vec::new(),
        draws: Vec::new(),
        first: None,
        seen: None,
        albedo: None,
    };
    let dark = transport.lights.emitters.is_empty() && sky.is_none();
    for bounce in 0..=settings.bounces {
        let drawn = tracing.draw(bounce, dark)?;
        if dark || drawn.is_empty() {
            break;
        }
        tracing.environment_on_miss(bounce, &drawn)?;
        // Black surfaces end a path.
        let hits: Vec<u32> = (0..drawn.len() as u32)
            .filter(|&i| reflects(scene, drawn[i as usize]))
            .collect();
        if hits.is_empty() {
            break;
        }
        let drawn: Vec<u32> = hits.iter().map(|&i| drawn[i as usize]).collect();
        tracing.batch.keep(&scene.context, &hits);
        let mut points = SurfacePoints::new(scene, &tracing.batch.rays, drawn)?;
        if let Some(least) = settings.least_roughness {
            points.regularize(least, bounce);
        }
        let Some(scatter) = tracing.direct_light(&points, bounce)? else {
            break;
        };
        tracing.go_on(points, scatter, bounce)?;
        if bounce == settings.bounces {
            tracing.environment_at_end(bounce)?;
            break;
        }
        if settings.roulette_after.is_some_and(|after| bounce >= after) {
            let survivors = roulette(&tracing.tracer, &mut tracing.batch, bounce)?;
            tracing.batch.keep(&scene.context, &survivors);
            if tracing.batch.paths.is_empty() {
                break;
            }
        }
    }
    tracing.finish(paths.len(), per_pixel)
}

/// Returns whether a triangle reflects light. Indices past the last triangle reflect none.
fn reflects(scene: &Flattened, triangle: u32) -> bool {
    let material = scene.topology.material.get(triangle as usize);
    material.is_some_and(|&m| scene.materials.kinds[m as usize].reflects)
}

impl<'a> Tracing<'a> {
    /// Returns the surfaces from which paths continue. The number of triangles stands for the background.
    fn draw(&mut self, bounce: u32, dark: bool) -> Result<Vec<u32>> {
        let Self { tracer, batch, .. } = self;
        let scene = tracer.scene();
        let Transport {
            settings, sampler, ..
        } = tracer.transport;
        let weights = tracer.weights(&batch.rays)?;
        let alive = batch.paths.len() as u64;
        tracer.statistics.borrow_mut().bounces.push(alive);
        if bounce == 0 {
            self.seen = seen::seen(&tracer.transport, &weights, &batch.rays)?;
        }
        let random = sampler.of_surfaces(&batch.paths, bounce);
        if bounce == 0 && settings.albedo {
            self.albedo = Some(seen::albedo(scene, &weights, &batch.rays, &random)?);
        }
        let split = bounce == 0 && settings.sampling.surfaces == SurfaceSampling::Split;
        let drawn = if split && dark {
            Vec::new()
        } else if split {
            batch.split(&scene.context, &weights, &random, |k| reflects(scene, k))?
        } else {
            let drawn = weights.draw(random)?;
            let all = (0..).zip(drawn.iter().copied());
            if let Some(ratio) = weights.ratio(all) {
                batch.throughput = Some(times(batch.throughput.take(), &ratio));
                self.draws.push(Draw {
                    bounce,
                    slots: batch.slots.clone(),
                    share: batch.share.clone(),
                    ratio,
                });
            }
            drawn
        };
        if bounce == 0 {
            self.first = Some(weights);
        }
        Ok(drawn)
    }

    /// Adds the environment's light to paths that drew the background. For primary rays, `seen` contains it.
    fn environment_on_miss(&mut self, bounce: u32, drawn: &[u32]) -> Result<()> {
        let Some(sky) = self.sky.filter(|_| bounce > 0) else {
            return Ok(());
        };
        let scene = self.tracer.scene();
        let context = &scene.context;
        let triangles = scene.triangles.len() as u32;
        let missed: Vec<u32> = (0..drawn.len() as u32)
            .filter(|&i| drawn[i as usize] >= triangles)
            .collect();
        if !missed.is_empty() {
            let n = missed.len();
            let index = context.index_row(&missed);
            let light = sky.radiance(context, &self.batch.rays.direction.gather(&index))?;
            let light = light.map(|e| e.expand([1, n]));
            let light = (self.batch).contribution(context, bounce, Some(&missed), light);
            self.add(bounce - 1, light);
        }
        Ok(())
    }

    /// Adds direct light from emitters and the map, and samples the directions in which paths continue. Returns `None`
    /// if they do not continue.
    fn direct_light(&mut self, points: &SurfacePoints, bounce: u32) -> Result<Option<Scatter>> {
        let Self { tracer, batch, .. } = &*self;
        let Transport {
            scene,
            settings,
            sampler,
            ..
        } = tracer.transport;
        let context = &scene.context;
        let (rays, paths) = (&batch.rays, &batch.paths);
        // On matt surfaces, light sampling alone serves points on emitters well.
        let glossy: Vec<bool> = (points.triangle.iter())
            .map(|&k| scene.materials.kinds[scene.topology.material[k as usize] as usize].glossy)
            .collect();
        let combined = settings.sampling.multiple_importance;
        let by_scattering = combined && !scene.emitters.is_empty() && glossy.iter().any(|&g| g);
        let goes_on = bounce < settings.bounces || self.sky.is_some();
        let scatter = (goes_on || by_scattering || self.map.is_some())
            .then(|| bsdf::sample(context, points, &rays.direction, sampler, paths, bounce));
        let scatter = scatter.transpose()?;
        let gathers = by_scattering || self.map.is_some();
        let directions = scatter.as_ref().filter(|_| gathers);
        let directions = directions.map(Scatter::gathered).transpose()?;
        let along = directions.as_deref().filter(|_| by_scattering);
        let along = along.map(|d| (d, glossy.as_slice()));
        let at = AtBounce { paths, bounce };
        let shaded = Shaded { points, rays, at };
        let mut lit = direct::connect(tracer, shaded, along)?;
        if let (Some(map), Some(directions)) = (self.map, &directions) {
            lit.extend(direct::from_map(tracer, map, shaded, directions)?);
        }
        for (which, light) in lit {
            let light = (self.batch).contribution(context, bounce, which.as_deref(), light);
            self.add(bounce, light);
        }
        Ok(scatter.filter(|_| goes_on))
    }

    /// Adds light that arrives at points after `bounce` bounces. After the first surface it is scaled down to the limit
    /// of indirect light, if there is one.
    fn add(&mut self, bounce: u32, mut contribution: Contribution) {
        let limit = self.tracer.transport.settings.indirect_clamp;
        if let Some(limit) = limit.filter(|_| bounce > 0) {
            let Vec3 { x, y, z } = &contribution.light;
            let largest = x.clone().max_pair(y.clone()).max_pair(z.clone());
            // Exactly 1 for light within the limit. Light that overflows would become NaN.
            let most = f64::from(f32::MAX);
            let scale = (largest.clamp(limit, most) / limit).recip();
            let [x, y, z] = [x, y, z].map(|c| c.clone().clamp_max(most));
            contribution.light = Vec3 { x, y, z }.scale(&scale);
        }
        self.contributions.push(contribution);
    }

    fn go_on(&mut self, points: SurfacePoints, scatter: Scatter, bounce: u32) -> Result<()> {
        let Self { tracer, batch, .. } = self;
        let direction = match tracer.transport.sight {
            Sight::Cones(cones) => {
                let at = AtBounce {
                    paths: &batch.paths,
                    bounce,
                };
                cones.bend(&tracer.scene().context, &points, scatter.direction, at)?
            }
            Sight::Softmax(..) => scatter.direction,
        };
        batch.rays = points.ray(direction, batch.rays.time.take());
        let next = weighted(scatter.weight, batch.throughput.take());
        if let Some(d) = tracer.diagnostics.borrow_mut().as_mut() {
            d.throughput(&next)?;
        }
        batch.throughput = Some(next);
        Ok(())
    }

    /// Adds the environment's part of the direct light at the last hit.
    fn environment_at_end(&mut self, bounce: u32) -> Result<()> {
        if let Some(sky) = self.sky {
            let context = &self.tracer.scene().context;
            let rays = &self.batch.rays;
            let visible = self.tracer.weights(rays)?.background();
            let light = sky.radiance(context, &rays.direction)?.scale(&visible);
            let light = (self.batch).contribution(context, bounce, None, light);
            self.add(bounce, light);
        }
        Ok(())
    }

    fn finish(self, count: usize, per_pixel: usize) -> Result<Radiance> {
        let Self {
            tracer,
            batch,
            contributions,
            ..
        } = self;
        let scene = tracer.scene();
        let first = match self.first {
            Some(first) => first,
            None => tracer.weights(&batch.rays)?,
        };
        if let Some(d) = tracer.diagnostics.borrow_mut().as_mut() {
            for c in &contributions {
                d.light(&c.light)?;
            }
        }
        let mut radiance = whole(scene, &contributions, 0, count);
        if let Some(seen) = self.seen {
            radiance = radiance.add(&seen);
        }
        for draw in &self.draws {
            let later = whole(scene, &contributions, draw.bounce, count).detached();
            if let Some(control) = control_variate(scene, draw, &later, per_pixel) {
                radiance = radiance.add(&control);
            }
        }
        Ok(Radiance {
            radiance,
            first,
            albedo: self.albedo,
            statistics: tracer.statistics.into_inner(),
            diagnostics: tracer.diagnostics.into_inner(),
        })
    }
}

/// Sums up the contributions of a bounce and all later ones by path.
fn whole(scene: &Flattened, contributions: &[Contribution], from: u32, count: usize) -> Vec3 {
    let zero = Tensor::<2>::zeros([1, count], (&scene.context.device, scene.context.dtype));
    let mut sum = Vec3::new(zero.clone(), zero.clone(), zero);
    for c in contributions.iter().filter(|c| c.bounce >= from) {
        sum = sum.add(&c.light.map(|l| spread(&scene.context, l, &c.slots, count)));
    }
    sum
}

/// Returns a term of value 0 that lowers the variance of the gradient of a draw. The derivative of a drawn weight,
/// times any factor that does not depend on the draw, has an expectation of 0. So the mean contribution of the pixel's
/// *other* paths is subtracted (a leave-one-out baseline of the score-function estimator).
fn control_variate(scene: &Flattened, draw: &Draw, later: &Vec3, per_pixel: usize) -> Option<Vec3> {
    if per_pixel < 2 {
        return None;
    }
    let count = later.x.dims()[1];
    let mut change = draw.ratio.clone() - 1.0;
    if let Some(share) = &draw.share {
        change = change * scene.context.row(share);
    }
    let change = spread(&scene.context, change, &draw.slots, count);
    Some(later.map(|l| {
        let l = l.reshape([count / per_pixel, per_pixel]);
        let others = (l.clone().sum_dim(1) - l) / (per_pixel - 1) as f64;
        (others.reshape([1, count]) * change.clone()).neg()
    }))
}
