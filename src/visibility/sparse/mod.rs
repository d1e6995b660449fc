//! The same weights and transmittances from the triangles that can matter to each ray only. Values
//! and derivatives are computed on the host, in f64, ray by ray; into the graph goes one linear
//! term: Σ coefficient·(vertex, origin, direction, velocity). The tensor program in the rest of this
//! folder is the specification.

mod forms;
mod terms;
mod weights;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use burn::tensor::Tensor;
use glam::DVec3;
use rayon::prelude::*;

use super::edge::{full_room, grazing};
use super::soft_pairs::SoftRay;
use super::{CoverageSettings, DepthRange, Rays, Visibility};
use crate::accel::{Hierarchy, HierarchyCache};
use crate::error::Result;
use crate::geometry::{Context, Topology, Triangles, Vec3, host_values, host_vectors};
use forms::{layered, softened, softmax, through_all, through_layers};
use terms::Terms;
pub use weights::SparseWeights;

/// Many triangles may be left out of a ray, and gradients are more sensitive than images: each is
/// allowed this share of the cutoff.
const SAFETY: f64 = 0.1;

/// What the rays of a scene are traced with.
pub struct Sparse {
    hierarchy: Arc<Hierarchy>,
    /// Corner coordinates a.x … c.z of each triangle `[T, 9]`, in the graph where they are.
    corners: Tensor<2>,
    /// Velocities `[T, 3]`, if anything moves.
    velocity: Option<Tensor<2>>,
    /// Pairs of ray and triangle whose derivatives went into the graph.
    taped: AtomicU64,
    /// Triangles of smaller opacity, and what lies behind more than 1 − cutoff, are left out.
    cutoff: f64,
}

/// A surface that a ray meets.
#[derive(Clone, Copy, Debug)]
struct Surface {
    triangle: u32,
    /// Twice the object, plus one for the back.
    layer: u32,
    t: f64,
    cosine: f64,
    /// Probability, and its derivatives by logit and t.
    p: f64,
    slope: f64,
    slope_t: f64,
    /// log p, and its derivatives: for the softmax.
    log: [f64; 3],
    /// ∂logit/∂(squared distance).
    sign: f64,
    hit: [f64; 3],
    border: [f64; 3],
    /// Weight, 0 for shadow rays.
    weight: f64,
}

/// Rays on the host.
struct HostRays {
    origin: Vec<DVec3>,
    direction: Vec<DVec3>,
    time: Option<Vec<f64>>,
    arrival: Option<Vec<f64>>,
}

impl HostRays {
    fn new(rays: &Rays) -> Result<Self> {
        Ok(Self {
            origin: host_vectors(&rays.origin)?,
            direction: host_vectors(&rays.direction)?,
            time: rays.time.as_ref().map(host_values).transpose()?,
            arrival: rays
                .arrival
                .as_ref()
                .map(|(_, d)| host_values(d))
                .transpose()?,
        })
    }
}

/// A list for each ray.
#[derive(Clone, Debug, Default)]
struct Lists<T> {
    items: Vec<T>,
    /// Where each ray's begin, and the end.
    starts: Vec<usize>,
}

impl<T> Lists<T> {
    fn of(&self, ray: usize) -> &[T] {
        &self.items[self.starts[ray]..self.starts[ray + 1]]
    }

    fn rays(&self) -> usize {
        self.starts.len() - 1
    }
}

impl Sparse {
    /// Reads the triangles back and builds boxes over them, or fits those of a cache.
    ///
    /// # Errors
    /// If they can't be read back.
    pub fn new(triangles: &Triangles, cutoff: f64, cache: Option<&HierarchyCache>) -> Result<Self> {
        let (corners, velocity) = tables(triangles);
        let host = host_values(&corners)?;
        let moved = velocity.as_ref().map(host_values).transpose()?;
        let valid = host_values(&triangles.valid.clone().float())?;
        let vector = |v: &[f64]| DVec3::new(v[0], v[1], v[2]);
        let list = host
            .par_chunks_exact(9)
            .enumerate()
            .map(|(k, v)| {
                let corners = [vector(v), vector(&v[3..]), vector(&v[6..])];
                let shift = moved.as_ref().map_or(DVec3::ZERO, |m| vector(&m[3 * k..]));
                crate::accel::HostTriangle::new(corners, shift, valid[k] > 0.0)
            })
            .collect();
        Ok(Self {
            hierarchy: match cache {
                Some(cache) => cache.take(list),
                None => Arc::new(Hierarchy::new(list)),
            },
            corners,
            velocity,
            taped: AtomicU64::new(0),
            cutoff: SAFETY * cutoff,
        })
    }

    /// How many pairs of ray and triangle went into the graph with their derivatives.
    pub fn taped(&self) -> u64 {
        self.taped.load(Ordering::Relaxed)
    }

    /// The same triangles in another graph.
    pub fn with(triangles: &Triangles, hierarchy: Arc<Hierarchy>, cutoff: f64) -> Self {
        let (corners, velocity) = tables(triangles);
        Self {
            hierarchy,
            corners,
            velocity,
            taped: AtomicU64::new(0),
            cutoff: SAFETY * cutoff,
        }
    }

    /// The triangles and their boxes.
    pub fn hierarchy(&self) -> Arc<Hierarchy> {
        self.hierarchy.clone()
    }

    /// The surfaces that a ray meets, unordered, and how many were asked.
    fn meet(
        &self,
        finder: &Finder,
        rays: &HostRays,
        marked: (Option<u32>, Option<u32>),
        i: usize,
        found: &mut Vec<Surface>,
    ) -> u32 {
        let Finder {
            topology,
            settings,
            form,
            grazing,
            reach,
            depth,
        } = finder;
        let (origin, direction) = (rays.origin[i], rays.direction[i]);
        let time = rays.time.as_ref().map_or(0.0, |t| t[i]);
        let (departure, emitter) = marked;
        let distance = rays.arrival.as_ref().map(|a| a[i]);
        let end = distance.map_or(f64::INFINITY, |d| d * (1.0 - settings.arrival_margin));
        let near_end = distance.map(|d| {
            let same = matches!((departure, emitter), (Some(a), Some(b))
                if topology.object[a as usize] == topology.object[b as usize]);
            if same { 0.5 * d } else { 0.0 }
        });
        let mut limit = end;
        let neighbour = |end: Option<u32>, k: u32| {
            end.is_some_and(|e| topology.neighbours.of(e).binary_search(&k).is_ok())
        };
        self.hierarchy
            .visit(origin, direction, reach.sqrt(), limit, |k| {
                let triangle = &self.hierarchy.triangles[k as usize];
                let o = origin - triangle.velocity * time;
                let range = (settings.t_min, limit);
                let Some(hit) = triangle.meet(o, direction, *grazing, range, *reach) else {
                    return limit;
                };
                if departure == Some(k) || emitter == Some(k) {
                    return limit;
                }
                let at = k as usize;
                let mut side = topology.visible_side[at] * hit.cosine;
                if let (Some(e), Some(from)) = (emitter, near_end)
                    && topology.object[e as usize] == topology.object[at]
                    && hit.t >= from
                {
                    side = -side;
                }
                if side < 0.0 {
                    return limit;
                }
                let softened = neighbour(departure, k) || neighbour(emitter, k);
                let sign = if hit.inside { 1.0 } else { -1.0 } / settings.sigma;
                let logit = hit.squared_distance * sign;
                if softened && (!hit.inside || logit < f64::EPSILON) {
                    return limit;
                }
                let decay = (-logit.abs()).exp();
                let one_plus = 1.0 + decay;
                let edge = if hit.inside { 1.0 } else { decay } / one_plus;
                let mut slope = decay / (one_plus * one_plus);
                let mut p = edge;
                // ∂log p/∂logit is 1 − p.
                let mut log_p = logit.min(0.0) - one_plus.ln();
                let mut log_slope = if hit.inside { decay } else { 1.0 } / one_plus;
                if softened {
                    p = (1.0 - decay) / one_plus;
                    slope *= 2.0;
                    log_p = (1.0 - decay).ln() - one_plus.ln();
                    log_slope = 2.0 * decay / (1.0 - decay * decay).max(1e-6);
                }
                let (mut slope_t, mut log_slope_t) = (0.0, 0.0);
                if departure.is_some() && settings.start > 0.0 {
                    let missing = (-hit.t * hit.t / settings.start).exp();
                    let (share, by_t) = (1.0 - missing, 2.0 * hit.t / settings.start * missing);
                    if share < 1e-30 {
                        return limit;
                    }
                    slope_t = p * by_t;
                    log_slope_t = by_t / share;
                    log_p += share.ln();
                    p *= share;
                    slope *= share;
                }
                found.push(Surface {
                    triangle: k,
                    layer: 2 * topology.object[at] + u32::from(hit.cosine >= 0.0),
                    t: hit.t,
                    cosine: hit.cosine,
                    p,
                    slope,
                    slope_t,
                    log: [log_p, log_slope, log_slope_t],
                    sign,
                    hit: hit.hit,
                    border: hit.border,
                    weight: 0.0,
                });
                // What lies far enough behind something opaque can't matter.
                if p > 1.0 - 0.1 * self.cutoff {
                    let behind = match *form {
                        Visibility::Layered => 0.0,
                        Visibility::Softmax { gamma, .. } | Visibility::LayeredSoft { gamma } => {
                            gamma * depth(i) * (10.0 / self.cutoff).ln()
                        }
                    };
                    limit = limit.min((hit.t + behind) * (1.0 + 1e-6));
                }
                limit
            })
    }

    fn finder<'a>(
        &self,
        context: &Context,
        topology: &'a Topology,
        settings: &CoverageSettings,
        form: Visibility,
        shadow: bool,
        depth: &'a (dyn Fn(usize) -> f64 + Sync),
    ) -> Finder<'a> {
        let nats = match form {
            // A nearer surface gains up to exp(1/γ) over one behind it.
            Visibility::Softmax { gamma, .. } if !shadow => (1.0 / self.cutoff).ln() + 1.0 / gamma,
            _ => (1.0 / self.cutoff).ln(),
        };
        Finder {
            topology,
            settings: *settings,
            // Shadow rays pass by products and layers: hard whatever the form.
            form: if shadow { Visibility::Layered } else { form },
            grazing: grazing(context.dtype),
            reach: settings.sigma * nats,
            depth,
        }
    }

    /// The weights of all surfaces of each ray.
    ///
    /// # Errors
    /// If rays can't be read back.
    pub fn weights(
        &self,
        context: &Context,
        topology: &Topology,
        rays: &Rays,
        settings: &CoverageSettings,
        form: Visibility,
        range: DepthRange,
    ) -> Result<SparseWeights<'_>> {
        let host = HostRays::new(rays)?;
        let near = host_values(&range.near)?;
        let far = host_values(&range.far)?;
        let depth = |i: usize| far[i] - near[i];
        let finder = self.finder(context, topology, settings, form, false, &depth);
        let n = host.origin.len();
        let full = full_room(context.epsilon(), settings.sigma);
        let parts: Vec<(Lists<Surface>, Vec<f64>, u64)> = chunks(n)
            .into_par_iter()
            .map(|range| {
                let mut lists = Lists {
                    items: Vec::new(),
                    starts: vec![0],
                };
                let (mut background, mut offered) = (Vec::new(), 0);
                let mut found = Vec::new();
                for i in range {
                    found.clear();
                    let departure = rays.departure.as_ref().map(|d| d[i]);
                    offered +=
                        u64::from(self.meet(&finder, &host, (departure, None), i, &mut found));
                    found.sort_unstable_by(|a, b| {
                        a.t.total_cmp(&b.t).then(a.triangle.cmp(&b.triangle))
                    });
                    background.push(match form {
                        Visibility::Softmax { gamma, epsilon } => {
                            let score = |s: &Surface| (far[i] - s.t) / depth(i) / gamma;
                            softmax(&mut found, score, epsilon / gamma, self.cutoff)
                        }
                        Visibility::LayeredSoft { gamma } => {
                            let soft = softened(&found);
                            let ray = SoftRay::new(&soft.0, soft.1, 1.0 / depth(i) / gamma, full);
                            let weights: Vec<f64> = ray.weights().collect();
                            for (s, weight) in found.iter_mut().zip(weights) {
                                s.weight = weight;
                            }
                            ray.background
                        }
                        Visibility::Layered => layered(&mut found),
                    });
                    lists.items.extend_from_slice(&found);
                    lists.starts.push(lists.items.len());
                }
                (lists, background, offered)
            })
            .collect();
        let mut surfaces = Lists {
            items: Vec::new(),
            starts: vec![0],
        };
        let (mut background, mut offered) = (Vec::with_capacity(n), 0);
        for (part, b, o) in parts {
            let base = surfaces.items.len();
            surfaces.items.extend(part.items);
            surfaces
                .starts
                .extend(part.starts[1..].iter().map(|s| base + s));
            background.extend(b);
            offered += o;
        }
        let gamma = match form {
            Visibility::Softmax { gamma, .. } | Visibility::LayeredSoft { gamma } => gamma,
            Visibility::Layered => 1.0,
        };
        let per_depth = (0..n).map(|i| 1.0 / depth(i) / gamma).collect();
        Ok(SparseWeights {
            sparse: self,
            context: context.clone(),
            full,
            tracked: self.is_tracked(rays),
            rays: rays.clone(),
            host,
            surfaces,
            background,
            form,
            range,
            per_depth,
            triangles: topology.object.len() as u32,
            offered,
        })
    }

    fn is_tracked(&self, rays: &Rays) -> bool {
        self.corners.is_tracked()
            || self.velocity.as_ref().is_some_and(Tensor::is_tracked)
            || rays.origin.is_tracked()
            || rays.direction.is_tracked()
    }

    /// The share of light that arrives along shadow rays `[1, N]`, in the graph if a gradient can
    /// flow; and how many candidates the hierarchy offered. Rays that are not needed are not traced:
    /// 0.
    ///
    /// # Errors
    /// If rays can't be read back.
    pub fn transmittance(
        &self,
        context: &Context,
        topology: &Topology,
        rays: &Rays,
        settings: &CoverageSettings,
        form: Visibility,
        needed: &[bool],
    ) -> Result<(Tensor<2>, u64)> {
        let host = HostRays::new(rays)?;
        let n = host.origin.len();
        let tracked = self.is_tracked(rays);
        let finder = self.finder(context, topology, settings, form, true, &|_| 0.0);
        let full = full_room(context.epsilon(), settings.sigma);
        let product = matches!(form, Visibility::Softmax { .. });
        let parts: Vec<(Vec<f64>, Terms, u64)> = chunks(n)
            .into_par_iter()
            .map(|range| {
                let (mut values, mut terms, mut offered) = (Vec::new(), Terms::default(), 0);
                let mut found = Vec::new();
                let mut by_p = Vec::new();
                for i in range {
                    found.clear();
                    if tracked {
                        terms.begin_ray();
                    }
                    if !needed[i] {
                        values.push(0.0);
                        continue;
                    }
                    let at = |list: &Option<Vec<u32>>| list.as_ref().map(|d| d[i]);
                    let emitter = rays.arrival.as_ref().and_then(|(e, _)| e.get(i).copied());
                    let marked = (at(&rays.departure), emitter);
                    offered += u64::from(self.meet(&finder, &host, marked, i, &mut found));
                    let value = if product {
                        through_all(&found, &mut by_p)
                    } else {
                        through_layers(&mut found, &mut by_p, full)
                    };
                    values.push(value);
                    if tracked {
                        for (s, g) in found.iter().zip(&by_p) {
                            terms.add(self, &host, i, s, g * s.slope, g * s.slope_t, self.cutoff);
                        }
                    }
                }
                (values, terms, offered)
            })
            .collect();
        let mut values = Vec::with_capacity(n);
        let (mut terms, mut offered) = (Terms::default(), 0);
        for (v, t, o) in parts {
            values.extend(v);
            terms.join(t);
            offered += o;
        }
        let value = context.row(&values);
        let value = match terms.row(self, context, rays, n) {
            Some(change) if tracked => value + change,
            _ => value,
        };
        Ok((value, offered))
    }
}

/// Corner coordinates `[T, 9]` and velocities `[T, 3]`.
fn tables(triangles: &Triangles) -> (Tensor<2>, Option<Tensor<2>>) {
    let c = &triangles.corners;
    let columns = [&c.a, &c.b, &c.c].map(Vec3::columns);
    let velocity = triangles.velocity.as_ref().map(Vec3::columns);
    (Tensor::cat(columns.to_vec(), 1), velocity)
}

/// What `meet` needs beside a ray.
struct Finder<'a> {
    topology: &'a Topology,
    settings: CoverageSettings,
    form: Visibility,
    grazing: f64,
    /// The squared distance from a triangle up to which it matters.
    reach: f64,
    /// far − near of each ray.
    depth: &'a (dyn Fn(usize) -> f64 + Sync),
}

/// Rays in pieces for the cores: as many whatever the machine, so that sums come out the same.
fn chunks(n: usize) -> Vec<std::ops::Range<usize>> {
    (0..n.div_ceil(RAYS_A_PIECE))
        .map(|i| i * RAYS_A_PIECE..((i + 1) * RAYS_A_PIECE).min(n))
        .collect()
}

const RAYS_A_PIECE: usize = 512;
