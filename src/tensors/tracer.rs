//! The visibility that the paths of a tile are traced with: weights of surfaces and transmittances.

use std::cell::RefCell;

use burn::tensor::Tensor;

use super::cones::{AtBounce, Cones, Hits};
use super::diagnostics::Diagnostics;
use super::lights::Lights;
use super::lights::Sky;
use super::rays::{DepthRange, Rays};
use super::softmax::{
    Candidates, Coverage, CoverageSettings, Group, Groups, List, Pairs, Setting, Shares, Softmax,
    Weights, coverage, grouped, transmittance, weights,
};
use crate::error::Result;
use crate::geometry::Context;
use crate::sampling::Sampler;
use crate::sampling::Sampling;
use crate::scene::Flattened;

#[derive(Clone, Copy, Debug)]
pub(crate) struct PathSettings {
    /// Bounces after the surface that the camera sees; 0 is direct light only.
    pub bounces: u32,
    /// Whether to count what is degenerate.
    pub diagnostics: bool,
    /// The bounce from which paths may be ended at random.
    pub roulette_after: Option<u32>,
    /// The choice of surfaces, emitters and directions.
    pub sampling: Sampling,
}

/// The blurred start of rays that leave a surface, over σ.
const START: f64 = 0.25;

/// The visibility of a render.
#[derive(Clone, Copy)]
pub(crate) enum Sight<'a> {
    /// Hard surfaces, by rays of cones.
    Cones(&'a Cones),
    /// All triangles, shared by the paper's form (lengths in units of the flattened scene), with
    /// candidates of each ray by a hierarchy; without it each ray is paired with all triangles.
    Softmax(Softmax, Option<&'a Candidates>),
}

/// A scene with the settings and random numbers of a render.
#[derive(Clone, Copy)]
pub(crate) struct Transport<'a> {
    pub scene: &'a Flattened,
    pub settings: &'a PathSettings,
    pub sampler: &'a Sampler,
    pub lights: &'a Lights,
    pub sky: Option<&'a Sky>,
    pub sight: Sight<'a>,
}

/// The tracer of a tile's paths.
pub(crate) struct Tracer<'a> {
    pub transport: Transport<'a>,
    pub statistics: RefCell<RayStatistics>,
    /// Counts of degenerate cases, if they are asked for.
    pub diagnostics: RefCell<Option<Diagnostics>>,
}

/// The number of draws of a split: surfaces with a weight of at least its inverse are all taken.
const SPLIT: usize = 4;

/// The weights of the surfaces of each ray: all of it for the one that it hits, or shares.
pub(crate) enum RayWeights {
    Hits(Box<Hits>),
    Shares(Shares),
}

impl RayWeights {
    pub(super) fn draw(&self, random: Vec<f64>) -> Result<Vec<u32>> {
        match self {
            Self::Hits(h) => Ok(h.triangle.clone()),
            Self::Shares(w) => {
                let drawn = w.draw(&[random])?;
                Ok(drawn.concat().into_iter().map(|d| d.0).collect())
            }
        }
    }

    pub(super) fn ratio(&self, drawn: &[u32]) -> Option<Tensor<2>> {
        match self {
            Self::Hits(_) => None,
            Self::Shares(w) => w.ratio(drawn),
        }
    }

    /// Several surfaces of each ray, (ray, surface, W over the probability of being here): systematic
    /// sampling, in which a surface is taken with probability min(1, 4W). The number of triangles
    /// stands for the background.
    pub(super) fn split(&self, random: &[f64]) -> Result<Vec<(u32, u32, f64)>> {
        let shares = match self {
            Self::Hits(h) => {
                let all = h.triangle.iter().enumerate();
                return Ok(all.map(|(i, &k)| (i as u32, k, 1.0)).collect());
            }
            Self::Shares(shares) => shares,
        };
        let shifted = |m: usize| {
            let of = |u: &f64| (u + m as f64) / SPLIT as f64;
            random.iter().map(of).collect()
        };
        let draws = shares.draw(&(0..SPLIT).map(shifted).collect::<Vec<_>>())?;
        let mut found = Vec::new();
        for i in 0..random.len() {
            for m in (0..SPLIT).filter(|&m| m == 0 || draws[m][i].0 != draws[m - 1][i].0) {
                let (drawn, share) = draws[m][i];
                found.push((i as u32, drawn, share.max(1.0 / SPLIT as f64)));
            }
        }
        Ok(found)
    }

    /// W of the background `[1, N]`, in the graph if a gradient can flow.
    pub fn attached_background(&self, context: &Context) -> Tensor<2> {
        match self {
            Self::Hits(h) => h.row(context, |i| !h.is_hit(i)),
            Self::Shares(w) => w.attached_background(),
        }
    }
}

/// Counts of rays, and of the triangles and surfaces that they met.
#[derive(Clone, Debug, Default)]
pub(crate) struct RayStatistics {
    /// Camera, bounce and shadow rays.
    pub rays: u64,
    /// Triangles tested, ray by ray.
    pub tested: u64,
    /// Rays that looked for their next surface, by bounce.
    pub bounces: Vec<u64>,
    /// Numbers of camera and bounce rays by the number of surfaces that matter to them.
    pub surfaces: Vec<u64>,
}

impl RayStatistics {
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

impl<'a> Tracer<'a> {
    pub(crate) fn new(transport: Transport<'a>) -> Self {
        let counted = transport.settings.diagnostics;
        Self {
            transport,
            statistics: RefCell::default(),
            diagnostics: RefCell::new(counted.then(Diagnostics::default)),
        }
    }

    /// How many triangles rays are paired with, on average; 1 for cones.
    pub(crate) fn pairs_a_ray(&self, rays: &Rays) -> Result<f64> {
        let Sight::Softmax(form, candidates) = self.transport.sight else {
            return Ok(1.0);
        };
        let groups = self.pairs(rays, (form, candidates), &vec![true; rays.len()])?;
        let all = groups
            .list
            .iter()
            .map(|(which, pairs)| which.len() * pairs.rows());
        Ok(all.sum::<usize>() as f64 / rays.len() as f64)
    }

    pub(crate) fn scene(&self) -> &'a Flattened {
        self.transport.scene
    }

    /// Hits of the softmax nearer than this don't count: relative to the scene's size.
    pub(crate) fn t_min(&self) -> f64 {
        match self.transport.sight {
            Sight::Cones(_) => 0.0,
            Sight::Softmax(..) => 1e-5 * self.scene().radius(),
        }
    }

    /// The parameters of Eq. 1.
    fn coverage_settings(&self, form: Softmax) -> CoverageSettings {
        CoverageSettings {
            sigma: form.sigma,
            t_min: self.t_min(),
            start: START * form.sigma,
            arrival_margin: 1e-4,
        }
    }

    /// Rays in groups, paired with the triangles that matter to them. Those that are not needed, and shadow rays that
    /// something opaque ends, are in no group; but without candidates all are paired with all triangles.
    fn pairs(
        &self,
        rays: &Rays,
        (form, candidates): (Softmax, Option<&Candidates>),
        needed: &[bool],
    ) -> Result<Groups<Pairs>> {
        let Flattened {
            context,
            topology,
            triangles,
            ..
        } = self.scene();
        let n = rays.len();
        let mut statistics = self.statistics.borrow_mut();
        let Some(candidates) = candidates else {
            statistics.rays += n as u64;
            statistics.tested += (n * triangles.len()) as u64;
            let list = vec![((0..n as u32).collect(), Pairs::all(triangles.len()))];
            return Ok(Groups { rays: n, list });
        };
        let setting = Setting {
            topology,
            coverage: self.coverage_settings(form),
            form,
            radius: self.scene().radius(),
        };
        let lists = candidates.of(&setting, rays, needed)?;
        statistics.rays += needed.iter().filter(|&&n| n).count() as u64;
        statistics.tested += lists
            .iter()
            .flatten()
            .map(|l| l.triangles.len() as u64)
            .sum::<u64>();
        let group = |which: Vec<u32>| {
            let lists = which.iter().filter_map(|&i| lists[i as usize].as_ref());
            let pairs = Pairs::own(context, &lists.collect::<Vec<&List>>());
            (which, pairs)
        };
        let list = grouped(&lists).into_iter().map(group).collect();
        Ok(Groups { rays: n, list })
    }

    fn coverage(&self, rays: &Rays, pairs: &Pairs, form: Softmax) -> Coverage {
        let Flattened {
            context,
            topology,
            triangles,
            ..
        } = self.scene();
        let settings = self.coverage_settings(form);
        coverage(context, (triangles, topology), rays, pairs, &settings)
    }

    /// The shares of surfaces and the background in each ray.
    pub(crate) fn weights(&self, rays: &Rays) -> Result<RayWeights> {
        let scene = self.scene();
        let sight = match self.transport.sight {
            Sight::Cones(cones) => {
                self.statistics.borrow_mut().rays += rays.len() as u64;
                return Ok(RayWeights::Hits(Box::new(cones.nearest(rays)?)));
            }
            Sight::Softmax(form, candidates) => (form, candidates),
        };
        let groups = self.pairs(rays, sight, &vec![true; rays.len()])?;
        let of = |(which, pairs): (Vec<u32>, Pairs)| {
            let rays = rays.pick(&scene.context, &which);
            let weights = match pairs.is_whole() {
                true => Weights::whole(&scene.context, rays.len()),
                false => self.weights_of(&rays, &pairs, sight.0)?,
            };
            Ok((which, Group::new(rays, pairs, weights)))
        };
        let list = groups.list.into_iter().map(of).collect::<Result<_>>()?;
        let groups = Groups {
            rays: groups.rays,
            list,
        };
        let shares = Shares::new(&scene.context, groups, scene.triangles.len());
        Ok(RayWeights::Shares(shares))
    }

    fn weights_of(&self, rays: &Rays, pairs: &Pairs, form: Softmax) -> Result<Weights> {
        let scene = self.scene();
        let coverage = self.coverage(rays, pairs, form);
        let cosine = coverage.cosine.clone();
        let weights = weights(coverage, DepthRange::new(rays, scene.radius()), form);
        if let Some(d) = self.diagnostics.borrow_mut().as_mut() {
            d.weights(&weights, &cosine, &scene.triangles.valid)?;
        }
        Ok(weights)
    }

    /// The share of light that arrives along shadow rays; 0 of those that are not needed, but where all
    /// triangles are tested in tensors.
    pub(crate) fn transmittance(
        &self,
        rays: &Rays,
        needed: &[bool],
        at: AtBounce,
    ) -> Result<Tensor<2>> {
        let context = &self.scene().context;
        let sight = match self.transport.sight {
            Sight::Cones(cones) => {
                let count = needed.iter().filter(|&&n| n).count() as u64;
                self.statistics.borrow_mut().rays += count;
                return cones.unblocked(context, rays, needed, at);
            }
            Sight::Softmax(form, candidates) => (form, candidates),
        };
        let groups = self.pairs(rays, sight, needed)?;
        Ok(groups.join(context, |which, pairs| {
            if pairs.is_empty() {
                return Tensor::ones([1, which.len()], (&context.device, context.dtype));
            }
            let rays = rays.pick(context, which);
            transmittance(&self.coverage(&rays, pairs, sight.0))
        }))
    }
}
