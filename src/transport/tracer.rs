//! The visibility that the paths of a tile are traced with: weights of surfaces and transmittances.

use std::cell::RefCell;

use burn::tensor::Tensor;

use super::cones::{AtBounce, Cones, Hits};
use super::diagnostics::Diagnostics;
use super::lights::Lights;
use super::lights::Sky;
use crate::error::Result;
use crate::geometry::Context;
use crate::sampling::Sampler;
use crate::sampling::Sampling;
use crate::scene::Flattened;
use crate::visibility::{
    Coverage, CoverageSettings, DepthRange, Rays, Softmax, Sparse, SparseWeights, Weights,
    coverage, transmittance, weights,
};

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
    /// candidates by a hierarchy; without it all triangles are tested, in tensors.
    Softmax(Softmax, Option<&'a Sparse>),
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

/// The weights of the surfaces of each ray: all of it for the one that it hits, or shares, by all triangles
/// in tensors or by candidates.
pub(crate) enum RayWeights<'a> {
    Hits(Box<Hits>),
    Dense(Box<Weights>),
    Sparse(Box<SparseWeights<'a>>),
}

impl RayWeights<'_> {
    pub(super) fn draw(&self, context: &Context, random: &[f64]) -> Result<Vec<u32>> {
        match self {
            Self::Hits(h) => Ok(h.triangle.clone()),
            Self::Dense(w) => w.draw(context, random),
            Self::Sparse(w) => Ok(w.draw(random)),
        }
    }

    pub(super) fn ratio(&self, context: &Context, drawn: &[u32]) -> Option<Tensor<2>> {
        match self {
            Self::Hits(_) => None,
            Self::Dense(w) => w.ratio(context, drawn),
            Self::Sparse(w) => w.ratio(drawn),
        }
    }

    /// Several surfaces of each ray, (ray, surface, W over the probability of being here): systematic
    /// sampling, in which a surface is taken with probability min(1, 4W). The number of triangles
    /// stands for the background.
    pub(super) fn split(&self, context: &Context, random: &[f64]) -> Result<Vec<(u32, u32, f64)>> {
        let weights = match self {
            Self::Hits(h) => {
                let all = h.triangle.iter().enumerate();
                return Ok(all.map(|(i, &k)| (i as u32, k, 1.0)).collect());
            }
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
    pub fn attached_background(&self, context: &Context) -> Tensor<2> {
        match self {
            Self::Hits(h) => h.row(context, |i| !h.is_hit(i)),
            Self::Dense(w) => w.attached_background(),
            Self::Sparse(w) => w.attached_background(),
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

    fn coverage(&self, rays: &Rays, form: Softmax) -> Coverage {
        let settings = self.coverage_settings(form);
        let scene = self.scene();
        let mut statistics = self.statistics.borrow_mut();
        statistics.tested += (rays.len() * scene.triangles.len()) as u64;
        coverage(
            &scene.context,
            &scene.triangles,
            &scene.topology,
            rays,
            &settings,
        )
    }

    /// The shares of surfaces and the background in each ray.
    pub(crate) fn weights(&self, rays: &Rays) -> Result<RayWeights<'a>> {
        let scene = self.scene();
        self.statistics.borrow_mut().rays += rays.len() as u64;
        let (form, sparse) = match self.transport.sight {
            Sight::Cones(cones) => return Ok(RayWeights::Hits(Box::new(cones.nearest(rays)?))),
            Sight::Softmax(form, sparse) => (form, sparse),
        };
        let range = DepthRange::new(rays, scene.radius());
        let (context, topology) = (&scene.context, &scene.topology);
        if let Some(sparse) = sparse {
            let settings = self.coverage_settings(form);
            let weights = sparse.weights(context, topology, rays, &settings, form, range)?;
            let mut statistics = self.statistics.borrow_mut();
            statistics.tested += weights.offered;
            for count in weights.counts() {
                if statistics.surfaces.len() <= count {
                    statistics.surfaces.resize(count + 1, 0);
                }
                statistics.surfaces[count] += 1;
            }
            return Ok(RayWeights::Sparse(Box::new(weights)));
        }
        let weights = weights(self.coverage(rays, form), range, form);
        if let Some(d) = self.diagnostics.borrow_mut().as_mut() {
            d.weights(&weights, &scene.triangles.valid)?;
        }
        Ok(RayWeights::Dense(Box::new(weights)))
    }

    /// The share of light that arrives along shadow rays; 0 of those that are not needed, but where all
    /// triangles are tested in tensors.
    pub(crate) fn transmittance(
        &self,
        rays: &Rays,
        needed: &[bool],
        at: AtBounce,
    ) -> Result<Tensor<2>> {
        let scene = self.scene();
        let (context, topology) = (&scene.context, &scene.topology);
        let count = needed.iter().filter(|&&n| n).count() as u64;
        let (form, sparse) = match self.transport.sight {
            Sight::Cones(cones) => {
                self.statistics.borrow_mut().rays += count;
                return cones.unblocked(context, rays, needed, at);
            }
            Sight::Softmax(form, sparse) => (form, sparse),
        };
        if let Some(sparse) = sparse {
            let settings = self.coverage_settings(form);
            let (passed, offered) =
                sparse.transmittance(context, topology, rays, &settings, form, needed)?;
            let mut statistics = self.statistics.borrow_mut();
            statistics.tested += offered;
            statistics.rays += count;
            return Ok(passed);
        }
        self.statistics.borrow_mut().rays += rays.len() as u64;
        Ok(transmittance(&self.coverage(rays, form)))
    }
}
