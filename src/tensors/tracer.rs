//! Visibility for the paths of a tile: weights of surfaces and transmittances.

use std::cell::RefCell;

use burn::tensor::Tensor;

use super::Sampling;
use super::cones::{AtBounce, Cones};
use super::diagnostics::Diagnostics;
use super::lights::Lights;
use super::lights::Sky;
use super::rays::Rays;
use super::softmax::{
    Candidates, Coverage, CoverageSettings, Form, Group, Groups, List, Pairs, Shares, Softmax,
    Weights, coverage, grouped, transmittance, weights,
};
use crate::error::Result;
use crate::scene::Flattened;
use softray_kernels::sampling::Sampler;

#[derive(Clone, Copy, Debug)]
pub(crate) struct PathSettings {
    /// The number of bounces after the first visible surface; 0 is direct light only.
    pub bounces: u32,
    /// Whether to count degenerate cases.
    pub diagnostics: bool,
    /// The bounce from which Russian roulette may end paths.
    pub roulette_after: Option<u32>,
    /// The limit of indirect light.
    pub indirect_clamp: Option<f64>,
    /// The least roughness after the first surface.
    pub least_roughness: Option<f64>,
    /// Whether albedos are an output.
    pub albedo: bool,
    /// The sampling strategies.
    pub sampling: Sampling,
}

/// The blurred start of rays that leave a surface (`CoverageSettings::start`), over σ.
const START: f64 = 0.25;

/// The visibility of a render.
pub(crate) enum Sight {
    /// Hard surfaces, hit by rays of cones.
    Cones(Cones),
    /// The paper's form, with lengths in units of the flattened scene, and the candidates of each ray from a BVH.
    /// Without candidates, each ray is paired with all triangles.
    Softmax(Softmax, Option<Candidates>),
}

/// A scene with the settings and random numbers of a render.
#[derive(Clone, Copy)]
pub(crate) struct Transport<'a> {
    pub scene: &'a Flattened,
    pub settings: &'a PathSettings,
    pub sampler: &'a Sampler,
    pub lights: &'a Lights,
    pub sky: Option<&'a Sky>,
    pub sight: &'a Sight,
}

/// The tracer of a tile's paths.
pub(crate) struct Tracer<'a> {
    pub transport: Transport<'a>,
    pub statistics: RefCell<RayStatistics>,
    /// Counts of degenerate cases, if requested.
    pub diagnostics: RefCell<Option<Diagnostics>>,
}

/// Counts of rays, of tested triangles, and of surfaces that may matter.
#[derive(Clone, Debug, Default)]
pub(crate) struct RayStatistics {
    /// Primary, bounce and shadow rays.
    pub rays: u64,
    /// Triangles tested, summed over rays.
    pub tested: u64,
    /// The number of rays that are traced to their next surface, by bounce.
    pub bounces: Vec<u64>,
    /// The number of primary and bounce rays, by the number of surfaces that may matter to them.
    pub surfaces: Vec<u64>,
}

impl RayStatistics {
    /// Counts the candidates of rays.
    fn met(&mut self, lists: &[Option<List>], are_shadow_rays: bool) {
        for list in lists.iter().flatten() {
            let count = list.triangles.len();
            self.tested += count as u64;
            if !are_shadow_rays {
                let most = self.surfaces.len().max(count + 1);
                self.surfaces.resize(most, 0);
                self.surfaces[count] += 1;
            }
        }
    }

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

    /// Returns the mean number of triangles with which a ray is paired.
    pub(crate) fn pairs_a_ray(&self, rays: &Rays) -> Result<f64> {
        let pairs = self.pairs(rays, &vec![true; rays.len()])?;
        let all = pairs.list.iter().map(|(which, p)| which.len() * p.rows());
        Ok(all.sum::<usize>() as f64 / rays.len() as f64)
    }

    pub(crate) fn scene(&self) -> &'a Flattened {
        self.transport.scene
    }

    /// Returns the distance below which softmax hits do not count, in proportion to the scene's size.
    pub(crate) fn t_min(&self) -> f64 {
        match self.transport.sight {
            Sight::Cones(_) => 0.0,
            Sight::Softmax(..) => 1e-5 * self.scene().radius(),
        }
    }

    fn form(&self, softmax: Softmax) -> Form<'a> {
        Form {
            scene: self.scene(),
            softmax,
            coverage: CoverageSettings {
                sigma: softmax.sigma,
                t_min: self.t_min(),
                start: START * softmax.sigma,
                arrival_margin: 1e-4,
            },
        }
    }

    /// Pairs rays, in groups, with the triangles that matter to them. Rays of cones are paired with the triangle that
    /// they hit; their shadow rays are not handled here. Rays that are not needed, and shadow rays that something
    /// opaque blocks, are in no group. Without candidates, all rays are paired with all triangles.
    fn pairs(&self, rays: &Rays, needed: &[bool]) -> Result<Groups<Pairs>> {
        let (context, triangles) = (&self.scene().context, self.scene().triangles.len());
        let n = rays.len();
        let mut statistics = self.statistics.borrow_mut();
        let lists = match self.transport.sight {
            Sight::Softmax(_, None) => {
                statistics.rays += n as u64;
                statistics.tested += (n * triangles) as u64;
                let list = vec![((0..n as u32).collect(), Pairs::with_all(triangles))];
                return Ok(Groups { rays: n, list });
            }
            Sight::Softmax(softmax, Some(candidates)) => {
                let lists = candidates.of(&self.form(*softmax), rays, needed)?;
                statistics.met(&lists, rays.arrival.is_some());
                lists
            }
            Sight::Cones(cones) => cones.nearest(rays)?,
        };
        statistics.rays += needed.iter().filter(|&&n| n).count() as u64;
        let group = |which: Vec<u32>| {
            let lists = which.iter().filter_map(|&i| lists[i as usize].as_ref());
            let pairs = Pairs::with_candidates(context, &lists.collect::<Vec<&List>>());
            (which, pairs)
        };
        let list = grouped(&lists).into_iter().map(group).collect();
        Ok(Groups { rays: n, list })
    }

    fn coverage(&self, rays: &Rays, pairs: &Pairs, softmax: Softmax) -> Coverage {
        let Form {
            scene,
            coverage: settings,
            ..
        } = self.form(softmax);
        let surfaces = (&scene.triangles, &scene.topology);
        coverage(&scene.context, surfaces, rays, pairs, &settings)
    }

    /// Returns the shares of the surfaces and the background in each ray.
    pub(crate) fn weights(&self, rays: &Rays) -> Result<Shares> {
        let scene = self.scene();
        let Groups { rays: n, list } = self.pairs(rays, &vec![true; rays.len()])?;
        let of = |(which, pairs): (Vec<u32>, Pairs)| {
            let rays = rays.pick(&scene.context, &which);
            let weights = match self.transport.sight {
                Sight::Softmax(softmax, _) if !(pairs.is_empty() || pairs.is_whole()) => {
                    self.weights_of(&rays, &pairs, *softmax)?
                }
                _ => Weights::certain(&scene.context, rays.len(), !pairs.is_empty()),
            };
            Ok((
                which,
                Group {
                    rays,
                    pairs,
                    weights,
                },
            ))
        };
        let list = list.into_iter().map(of).collect::<Result<_>>()?;
        let groups = Groups { rays: n, list };
        Ok(Shares::new(&scene.context, groups, scene.triangles.len()))
    }

    fn weights_of(&self, rays: &Rays, pairs: &Pairs, softmax: Softmax) -> Result<Weights> {
        let scene = self.scene();
        let coverage = self.coverage(rays, pairs, softmax);
        let weights = weights(&coverage, &rays.origin, scene.radius(), softmax);
        if let Some(d) = self.diagnostics.borrow_mut().as_mut() {
            d.weights(&weights, &coverage.cosine, &scene.triangles.valid)?;
        }
        Ok(weights)
    }

    /// Returns the fraction of light that arrives along shadow rays. It is 0 for rays that are not needed, except where
    /// rays are paired with all triangles.
    pub(crate) fn transmittance(
        &self,
        rays: &Rays,
        needed: &[bool],
        at: AtBounce,
    ) -> Result<Tensor<2>> {
        let context = &self.scene().context;
        let softmax = match self.transport.sight {
            Sight::Cones(cones) => {
                let count = needed.iter().filter(|&&n| n).count() as u64;
                self.statistics.borrow_mut().rays += count;
                return cones.unblocked(context, rays, needed, at);
            }
            Sight::Softmax(softmax, _) => *softmax,
        };
        let groups = self.pairs(rays, needed)?;
        Ok(groups.join(context, |which, pairs| {
            if pairs.is_empty() {
                return Tensor::ones([1, which.len()], (&context.device, context.dtype));
            }
            let rays = rays.pick(context, which);
            transmittance(&self.coverage(&rays, pairs, softmax))
        }))
    }
}
