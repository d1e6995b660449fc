//! The path loop: draw a surface, connect it to an emitter, scatter, repeat.

use std::cell::RefCell;

use burn::tensor::{IndexingUpdateOp, Tensor};

use super::diagnostics::Diagnostics;
use super::surface::SurfacePoints;
use super::{Dimension, Lights, Sampler, Sampling, Sky, SurfaceSampling, bsdf, emitters};
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
    /// How surfaces, emitters and directions are chosen.
    pub sampling: Sampling,
}

/// The blurred start of rays that leave a surface, over σ.
const START: f64 = 0.25;

/// A scene with the settings and random numbers of a render.
#[derive(Clone, Copy)]
pub(crate) struct Transport<'a> {
    pub scene: &'a Flattened,
    pub settings: &'a PathSettings,
    pub sampler: &'a Sampler,
    pub lights: &'a Lights,
    pub sky: Option<&'a Sky>,
    /// Candidates by a hierarchy; without it all triangles are asked, in tensors.
    pub sparse: Option<&'a Sparse>,
}

/// What traces the paths of a tile.
pub(crate) struct Tracer<'a> {
    pub transport: Transport<'a>,
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

    /// Several surfaces of each ray, (ray, surface, W over the probability of being here): systematic
    /// sampling, in which a surface is taken with probability min(1, 4W). The number of triangles
    /// stands for the background.
    fn split(&self, context: &Context, random: &[f64]) -> Result<Vec<(u32, u32, f64)>> {
        let weights = match self {
            Self::Sparse(w) => return Ok(w.split(random, SPLIT)),
            Self::Dense(w) => w,
        };
        let draws = (0..SPLIT).map(|m| {
            let shifted = random.iter().map(|u| (u + m as f64) / SPLIT as f64);
            weights.draw(context, &shifted.collect::<Vec<_>>())
        });
        let draws = draws.collect::<Result<Vec<_>>>()?;
        let shares = draws.iter().map(|drawn| weights.of(context, drawn));
        let shares = shares.collect::<Result<Vec<_>>>()?;
        let mut found = Vec::new();
        for i in 0..random.len() {
            for m in (0..SPLIT).filter(|&m| m == 0 || draws[m][i] != draws[m - 1][i]) {
                let share = shares[m][i].max(1.0 / SPLIT as f64);
                found.push((i as u32, draws[m][i], share));
            }
        }
        Ok(found)
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
    bounce: u32,
    slots: Vec<u32>,
    /// What part of its slot a path stands for, where that is not all.
    share: Option<Vec<f64>>,
    ratio: Tensor<2>,
}

impl<'a> Tracer<'a> {
    /// The scene.
    pub(crate) fn scene(&self) -> &'a Flattened {
        self.transport.scene
    }

    /// Hits nearer than this don't count: relative to the scene's size.
    pub(crate) fn t_min(&self) -> f64 {
        1e-5 * self.scene().radius()
    }

    fn coverage_settings(&self) -> CoverageSettings {
        CoverageSettings {
            sigma: self.transport.settings.sigma,
            t_min: self.t_min(),
            start: START * self.transport.settings.sigma,
            arrival_margin: 1e-4,
        }
    }

    fn coverage(&self, rays: &Rays) -> Coverage {
        let settings = self.coverage_settings();
        let scene = self.scene();
        let mut census = self.census.borrow_mut();
        census.tested += (rays.len() * scene.triangles.len()) as u64;
        coverage(
            &scene.context,
            &scene.triangles,
            &scene.topology,
            rays,
            &settings,
        )
    }

    pub(crate) fn weights(&self, rays: &Rays) -> Result<RayWeights<'a>> {
        let scene = self.scene();
        let range = DepthRange::new(rays, scene.radius());
        let (context, topology) = (&scene.context, &scene.topology);
        let form = self.transport.settings.visibility;
        self.census.borrow_mut().rays += rays.len() as u64;
        if let Some(sparse) = self.transport.sparse {
            let settings = self.coverage_settings();
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
        let weights = form.weights(context, topology, self.coverage(rays), range)?;
        if let Some(d) = self.diagnostics.borrow_mut().as_mut() {
            d.weights(&weights, &scene.triangles.valid)?;
        }
        Ok(RayWeights::Dense(Box::new(weights)))
    }

    /// The share of light that arrives along shadow rays.
    pub(crate) fn transmittance(&self, rays: &Rays, needed: &[bool]) -> Result<Tensor<2>> {
        let scene = self.scene();
        let (context, topology) = (&scene.context, &scene.topology);
        let form = self.transport.settings.visibility;
        if let Some(sparse) = self.transport.sparse {
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
            scene.materials.reflects[m]
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
        let by_scattering = combined && !scene.emitters.is_empty();
        let goes_on = !last || sky.is_some();
        let scatter = (goes_on || by_scattering || map.is_some())
            .then(|| bsdf::sample(context, &points, &incoming, sampler, &batch.paths, bounce));
        let direction = scatter.as_ref().map(|s| &s.direction);
        let along = direction.filter(|_| by_scattering);
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
        batch.rays = Rays {
            origin: points.position,
            direction: scatter.direction,
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
                let visible = tracer.weights(&batch.rays)?.attached_background();
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

/// Ends paths at random in proportion to their throughput, and returns those that go on.
fn roulette(tracer: &Tracer, batch: &mut Batch, bounce: u32) -> Result<Vec<u32>> {
    let count = batch.paths.len() as u32;
    let Some(current) = &mut batch.throughput else {
        return Ok((0..count).collect());
    };
    let largest = plain(&current.x)
        .max_pair(plain(&current.y))
        .max_pair(plain(&current.z));
    // Not under 5 %, so that a path whose light is 0 for now still carries its gradient.
    let survival: Vec<f64> = host_values(&largest)?
        .iter()
        .map(|q| q.clamp(0.05, 1.0))
        .collect();
    let sampler = tracer.transport.sampler;
    let [random] = sampler.uniform(&batch.paths, bounce, [Dimension::Roulette]);
    let inverse: Vec<f64> = survival.iter().map(|q| q.recip()).collect();
    *current = current.scale(&tracer.scene().context.row(&inverse));
    Ok((0..count)
        .filter(|&i| random[i as usize] < survival[i as usize])
        .collect())
}

/// The paths of a tile that are on their way.
struct Batch {
    /// Pixel and sample of each.
    paths: Vec<(u32, u32)>,
    /// The column of the tile that each belongs to.
    slots: Vec<u32>,
    /// What part of its slot a path stands for, where that is not all.
    share: Option<Vec<f64>>,
    rays: Rays,
    /// None stands for 1.
    throughput: Option<Vec3>,
}

/// How many draws a split makes: surfaces with a weight of at least its inverse are all taken.
const SPLIT: usize = 4;

impl Batch {
    /// Goes on with several surfaces of each ray in place of one. Returns them; paths are then those
    /// of the surfaces.
    fn split(
        &mut self,
        tracer: &Tracer,
        weights: &RayWeights,
        random: &[f64],
        useful: impl Fn(u32) -> bool,
    ) -> Result<Vec<u32>> {
        let context = &tracer.scene().context;
        let n = self.paths.len();
        // The first surface of each ray, then all others.
        let (mut first, mut others): (Vec<(u32, u32, f64)>, Vec<_>) = (Vec::new(), Vec::new());
        for entry in weights.split(context, random)? {
            if !useful(entry.1) {
                continue;
            }
            match first.last() {
                Some(last) if last.0 == entry.0 => others.push(entry),
                _ => first.push(entry),
            }
        }
        let mut change = None;
        if !first.is_empty() {
            let mut drawn = vec![tracer.scene().triangles.len() as u32; n];
            for &(i, k, _) in &first {
                drawn[i as usize] = k;
            }
            let index: Vec<u32> = first.iter().map(|e| e.0).collect();
            if let Some(ratio) = weights.ratio(context, &drawn) {
                let ratio = pick_row(context, ratio, &index, n);
                let index: Vec<u32> = others.iter().map(|e| e.0).collect();
                change = Some(if index.is_empty() {
                    ratio
                } else {
                    let rays = pick_rays(context, &self.rays, &index);
                    let drawn: Vec<u32> = others.iter().map(|e| e.1).collect();
                    let again = tracer.weights(&rays)?.ratio(context, &drawn);
                    let ones = || ratio.zeros_like().slice([0..1, 0..1]) + 1.0;
                    let again = again.unwrap_or_else(|| ones().expand([1, index.len()]));
                    Tensor::cat(vec![ratio, again], 1)
                });
            }
        }
        first.extend(others);
        let index: Vec<u32> = first.iter().map(|e| e.0).collect();
        let share: Vec<f64> = first.iter().map(|e| e.2).collect();
        self.keep(context, &index);
        let whole = share.iter().all(|&s| s == 1.0);
        if !whole && !share.is_empty() {
            let row = context.row(&share);
            change = Some(match change {
                Some(ratio) => ratio * row,
                None => row,
            });
            self.share = Some(share);
        }
        if let Some(change) = change {
            self.throughput = Some(times(self.throughput.take(), &change));
        }
        Ok(first.iter().map(|e| e.1).collect())
    }

    /// Goes on with some paths, as often as they are named.
    fn keep(&mut self, context: &Context, which: &[u32]) {
        if is_identity(which, self.paths.len()) {
            return;
        }
        self.paths = which.iter().map(|&i| self.paths[i as usize]).collect();
        self.slots = which.iter().map(|&i| self.slots[i as usize]).collect();
        if let Some(share) = &mut self.share {
            *share = which.iter().map(|&i| share[i as usize]).collect();
        }
        if which.is_empty() {
            return;
        }
        self.rays = pick_rays(context, &self.rays, which);
        let index = context.index_row(which);
        self.throughput = self.throughput.take().map(|t| t.gather(&index));
    }

    /// Light that some paths (all, if not named) bring back.
    fn contribution(
        &self,
        context: &Context,
        bounce: u32,
        which: Option<&[u32]>,
        light: Vec3,
    ) -> Contribution {
        let (slots, throughput) = match which {
            None => (self.slots.clone(), self.throughput.clone()),
            Some(which) => {
                let index = context.index_row(which);
                (
                    which.iter().map(|&i| self.slots[i as usize]).collect(),
                    self.throughput.as_ref().map(|t| t.gather(&index)),
                )
            }
        };
        Contribution {
            bounce,
            slots,
            light: weighted(light, throughput),
        }
    }
}

fn is_identity(which: &[u32], count: usize) -> bool {
    which.len() == count && which.iter().enumerate().all(|(i, &w)| i == w as usize)
}

fn pick_row(context: &Context, row: Tensor<2>, which: &[u32], count: usize) -> Tensor<2> {
    if is_identity(which, count) {
        return row;
    }
    gather_row(row, &context.index_row(which))
}

fn pick_rays(context: &Context, rays: &Rays, which: &[u32]) -> Rays {
    let index = context.index_row(which);
    let departure = rays.departure.as_ref();
    Rays {
        origin: rays.origin.gather(&index),
        direction: rays.direction.gather(&index),
        time: rays.time.clone().map(|t| gather_row(t, &index)),
        departure: departure.map(|d| which.iter().map(|&i| d[i as usize]).collect()),
        arrival: None,
    }
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
