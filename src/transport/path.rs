//! The path loop: draw a surface, connect it to an emitter, scatter, repeat.

use std::cell::RefCell;

use burn::tensor::{IndexingUpdateOp, Tensor};

use super::diagnostics::Diagnostics;
use super::surface::SurfacePoints;
use super::{Dimension, Sampler, bsdf, emitters};
use crate::error::Result;
use crate::geometry::{Context, Vec3, gather_row, host_values, plain};
use crate::scene::Flattened;
use crate::visibility::{
    Coverage, CoverageSettings, DepthRange, Rays, Sparse, SparseWeights, Visibility, Weights,
    coverage,
};

/// What a path does.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PathSettings {
    /// σ of Eq. 1, in units of the flattened scene, squared.
    pub sigma: f64,
    /// The form of visibility.
    pub visibility: Visibility,
    /// Bounces after the surface that the camera sees; 0 is direct light only.
    pub bounces: u32,
    /// Whether to count what is degenerate.
    pub diagnostics: bool,
    /// The bounce from which paths may be ended at random.
    pub roulette_after: Option<u32>,
}

/// The blurred start of rays that leave a surface, over σ.
const START: f64 = 0.25;

/// A scene with the settings and random numbers of a render.
pub(crate) struct Tracer<'a> {
    pub scene: &'a Flattened,
    pub settings: &'a PathSettings,
    pub sampler: &'a Sampler,
    /// Candidates by a hierarchy; without it all triangles are asked, in tensors.
    pub sparse: Option<&'a Sparse>,
    /// What the rays met.
    pub census: RefCell<Census>,
    /// What was degenerate, if that is asked for.
    pub diagnostics: RefCell<Option<Diagnostics>>,
}

/// The weights of the surfaces of each ray, by all triangles in tensors or by candidates.
pub(crate) enum RayWeights<'a> {
    Dense(Box<Weights>),
    Sparse(Box<SparseWeights<'a>>),
}

impl RayWeights<'_> {
    fn draw(&self, context: &Context, random: &[f64]) -> Result<Vec<u32>> {
        match self {
            Self::Dense(w) => w.draw(context, random),
            Self::Sparse(w) => Ok(w.draw(random)),
        }
    }

    fn ratio(&self, context: &Context, drawn: &[u32]) -> Option<Tensor<2>> {
        match self {
            Self::Dense(w) => w.ratio(context, drawn),
            Self::Sparse(w) => w.ratio(drawn),
        }
    }

    /// W of the background `[1, N]`, in the graph if a gradient can flow.
    pub fn attached_background(&self) -> Tensor<2> {
        match self {
            Self::Dense(w) => w.attached_background(),
            Self::Sparse(w) => w.attached_background(),
        }
    }
}

/// What rays met.
#[derive(Clone, Debug, Default)]
pub(crate) struct Census {
    /// Camera, bounce and shadow rays.
    pub rays: u64,
    /// Triangles asked, ray by ray.
    pub tested: u64,
    /// Rays that looked for their next surface, by bounce.
    pub bounces: Vec<u64>,
    /// How many camera and bounce rays met how many surfaces that matter.
    pub surfaces: Vec<u64>,
}

impl Census {
    /// Both together.
    pub fn merge(&mut self, other: &Self) {
        self.rays += other.rays;
        self.tested += other.tested;
        for (own, other) in [
            (&mut self.surfaces, &other.surfaces),
            (&mut self.bounces, &other.bounces),
        ] {
            own.resize(own.len().max(other.len()), 0);
            own.iter_mut().zip(other).for_each(|(a, b)| *a += b);
        }
    }
}

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
struct Contribution {
    bounce: u32,
    slots: Vec<u32>,
    light: Vec3,
}

/// The ratios W/stop(W) of the surfaces that some of a tile's paths drew.
struct Draw {
    slots: Vec<u32>,
    ratio: Tensor<2>,
}

impl<'a> Tracer<'a> {
    /// Hits nearer than this don't count: relative to the scene's size.
    pub(crate) fn t_min(&self) -> f64 {
        1e-5 * self.scene.radius()
    }

    fn coverage_settings(&self) -> CoverageSettings {
        CoverageSettings {
            sigma: self.settings.sigma,
            t_min: self.t_min(),
            start: START * self.settings.sigma,
            arrival_margin: 1e-4,
        }
    }

    fn coverage(&self, rays: &Rays) -> Coverage {
        let settings = self.coverage_settings();
        let mut census = self.census.borrow_mut();
        census.tested += (rays.len() * self.scene.triangles.len()) as u64;
        coverage(
            &self.scene.context,
            &self.scene.triangles,
            &self.scene.topology,
            rays,
            &settings,
        )
    }

    fn weights(&self, rays: &Rays) -> Result<RayWeights<'a>> {
        let range = DepthRange::new(rays, self.scene.radius());
        let (context, topology) = (&self.scene.context, &self.scene.topology);
        self.census.borrow_mut().rays += rays.len() as u64;
        if let Some(sparse) = self.sparse {
            let settings = self.coverage_settings();
            let form = self.settings.visibility;
            let weights = sparse.weights(context, topology, rays, &settings, form, range)?;
            let mut census = self.census.borrow_mut();
            census.tested += weights.offered;
            for count in weights.counts() {
                if census.surfaces.len() <= count {
                    census.surfaces.resize(count + 1, 0);
                }
                census.surfaces[count] += 1;
            }
            return Ok(RayWeights::Sparse(Box::new(weights)));
        }
        let weights =
            self.settings
                .visibility
                .weights(context, topology, self.coverage(rays), range)?;
        if let Some(d) = self.diagnostics.borrow_mut().as_mut() {
            d.weights(&weights, &self.scene.triangles.valid)?;
        }
        Ok(RayWeights::Dense(Box::new(weights)))
    }

    /// The share of light that arrives along shadow rays.
    pub(crate) fn transmittance(&self, rays: &Rays, needed: &[bool]) -> Result<Tensor<2>> {
        let (context, topology) = (&self.scene.context, &self.scene.topology);
        let form = self.settings.visibility;
        if let Some(sparse) = self.sparse {
            let settings = self.coverage_settings();
            let (passed, offered) =
                sparse.transmittance(context, topology, rays, &settings, form, needed)?;
            let mut census = self.census.borrow_mut();
            census.tested += offered;
            census.rays += needed.iter().filter(|&&n| n).count() as u64;
            return Ok(passed);
        }
        self.census.borrow_mut().rays += rays.len() as u64;
        Ok(form.transmittance(context, topology, &self.coverage(rays)))
    }
}

/// Radiance along camera rays, each of the path (pixel, sample); `per_pixel` consecutive paths
/// belong to one pixel.
pub(crate) fn trace<'a>(
    scene: &'a Flattened,
    settings: &'a PathSettings,
    sampler: &'a Sampler,
    sparse: Option<&'a Sparse>,
    rays: Rays,
    paths: &[(u32, u32)],
    per_pixel: usize,
) -> Result<Radiance<'a>> {
    let tracer = Tracer {
        scene,
        settings,
        sampler,
        sparse,
        census: RefCell::default(),
        diagnostics: RefCell::new(settings.diagnostics.then(Diagnostics::default)),
    };
    let context = &scene.context;
    let count = paths.len();
    let mut found: Vec<Contribution> = Vec::new();
    let mut draws: Vec<Draw> = Vec::new();
    let mut paths = paths.to_vec();
    let mut slots: Vec<u32> = (0..count as u32).collect();
    let mut rays = rays;
    let mut throughput: Option<Vec3> = None;
    let mut first = None;
    let mut seen = None;

    for bounce in 0..=settings.bounces {
        let weights = tracer.weights(&rays)?;
        tracer.census.borrow_mut().bounces.push(paths.len() as u64);
        let random = sampler.uniform(&paths, bounce, Dimension::Surface);
        let drawn = weights.draw(context, &random)?;
        if let Some(ratio) = weights.ratio(context, &drawn) {
            throughput = Some(times(throughput, &ratio));
            let slots = slots.clone();
            draws.push(Draw { slots, ratio });
        }
        if bounce == 0 {
            seen = emitters::seen(scene, &weights)?;
            first = Some(weights);
        }

        if scene.emitters.is_empty() && scene.environment.is_none() {
            break;
        }
        // Who drew the background sees the environment, and is done. Camera rays have seen it.
        let triangles = scene.triangles.len() as u32;
        let is_surface = |i: &usize| drawn[*i] < triangles;
        if let Some(environment) = &scene.environment
            && bounce > 0
        {
            let missed: Vec<usize> = (0..paths.len()).filter(|i| !is_surface(i)).collect();
            if !missed.is_empty() {
                let n = missed.len();
                let light = environment.map(|e| e.expand([1, n]));
                found.push(Contribution {
                    bounce,
                    slots: missed.iter().map(|&i| slots[i]).collect(),
                    light: weighted(light, pick(context, &throughput, &missed)),
                });
            }
        }
        // Black surfaces end a path.
        let useful = |i: &usize| {
            is_surface(i) && {
                let m = scene.topology.material[drawn[*i] as usize] as usize;
                scene.materials.reflects[m]
            }
        };
        let hits: Vec<usize> = (0..paths.len()).filter(useful).collect();
        if hits.is_empty() {
            break;
        }
        let drawn: Vec<u32> = hits.iter().map(|&i| drawn[i]).collect();
        keep(
            context,
            &hits,
            &mut paths,
            &mut slots,
            &mut rays,
            &mut throughput,
        );
        let points = SurfacePoints::new(scene, &rays, drawn)?;

        let light = emitters::connect(
            &tracer,
            &points,
            &rays.direction,
            &rays.time,
            &paths,
            bounce,
        )?;
        if let Some(light) = light {
            found.push(Contribution {
                bounce,
                slots: slots.clone(),
                light: weighted(light, throughput.clone()),
            });
        }
        let last = bounce == settings.bounces;
        if last && scene.environment.is_none() {
            break;
        }
        let scatter = bsdf::sample(context, &points, &rays.direction, sampler, &paths, bounce);
        rays = Rays {
            origin: points.position,
            direction: scatter.direction,
            time: rays.time,
            departure: Some(points.triangle),
            arrival: None,
        };
        let next = weighted(scatter.weight, throughput);
        if let Some(d) = tracer.diagnostics.borrow_mut().as_mut() {
            d.throughput(&next)?;
        }
        throughput = Some(next);
        if last {
            // The environment's share of the direct light at the last hit.
            if let Some(environment) = &scene.environment {
                let visible = tracer.weights(&rays)?.attached_background();
                found.push(Contribution {
                    bounce,
                    slots: slots.clone(),
                    light: weighted(environment.scale(&visible), throughput.clone()),
                });
            }
            break;
        }
        if settings.roulette_after.is_some_and(|after| bounce >= after) {
            let survivors = roulette(&tracer, &mut throughput, &paths, bounce)?;
            keep(
                context,
                &survivors,
                &mut paths,
                &mut slots,
                &mut rays,
                &mut throughput,
            );
            if paths.is_empty() {
                break;
            }
        }
    }
    let first = match first {
        Some(first) => first,
        None => tracer.weights(&rays)?,
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
    for (bounce, draw) in draws.iter().enumerate() {
        let later = whole(scene, &found, bounce as u32, count).plain();
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

/// Ends paths at random in proportion to their throughput, and returns those that go on.
fn roulette(
    tracer: &Tracer,
    throughput: &mut Option<Vec3>,
    paths: &[(u32, u32)],
    bounce: u32,
) -> Result<Vec<usize>> {
    let Some(current) = throughput else {
        return Ok((0..paths.len()).collect());
    };
    let largest = plain(&current.x)
        .max_pair(plain(&current.y))
        .max_pair(plain(&current.z));
    // Not under 5 %, so that a path whose light is 0 for now still carries its gradient.
    let survival: Vec<f64> = host_values(&largest)?
        .iter()
        .map(|q| q.clamp(0.05, 1.0))
        .collect();
    let random = tracer.sampler.uniform(paths, bounce, Dimension::Roulette);
    let inverse: Vec<f64> = survival.iter().map(|q| q.recip()).collect();
    *current = current.scale(&tracer.scene.context.row(&inverse));
    Ok((0..paths.len())
        .filter(|&i| random[i] < survival[i])
        .collect())
}

/// Drops all paths but some from the batch.
fn keep(
    context: &Context,
    which: &[usize],
    paths: &mut Vec<(u32, u32)>,
    slots: &mut Vec<u32>,
    rays: &mut Rays,
    throughput: &mut Option<Vec3>,
) {
    if which.len() == paths.len() {
        return;
    }
    *paths = which.iter().map(|&i| paths[i]).collect();
    *slots = which.iter().map(|&i| slots[i]).collect();
    if which.is_empty() {
        return;
    }
    let index = context.index_row(&which.iter().map(|&i| i as u32).collect::<Vec<_>>());
    rays.origin = rays.origin.gather(&index);
    rays.direction = rays.direction.gather(&index);
    rays.time = rays.time.take().map(|t| gather_row(t, &index));
    if let Some(departure) = &mut rays.departure {
        *departure = which.iter().map(|&i| departure[i]).collect();
    }
    *throughput = throughput.take().map(|t| t.gather(&index));
}

fn pick(context: &Context, throughput: &Option<Vec3>, which: &[usize]) -> Option<Vec3> {
    let index = context.index_row(&which.iter().map(|&i| i as u32).collect::<Vec<_>>());
    throughput.as_ref().map(|t| t.gather(&index))
}

/// A throughput times a scalar a path; none stands for 1.
fn times(throughput: Option<Vec3>, ratio: &Tensor<2>) -> Vec3 {
    match throughput {
        Some(t) => t.scale(ratio),
        None => Vec3::new(ratio.clone(), ratio.clone(), ratio.clone()),
    }
}

fn weighted(light: Vec3, throughput: Option<Vec3>) -> Vec3 {
    match throughput {
        Some(t) => light.mul(&t),
        None => light,
    }
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
    if slots.len() == count {
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
    let change = spread(scene, draw.ratio.clone() - 1.0, &draw.slots, count);
    Some(later.map(|l| {
        let l = l.reshape([count / per_pixel, per_pixel]);
        let others = (l.clone().sum_dim(1) - l) / (per_pixel - 1) as f64;
        (others.reshape([1, count]) * change.clone()).neg()
    }))
}
