//! The same weights and transmittances from the triangles that can matter to each ray only. Values
//! and derivatives are computed on the host, in f64, ray by ray; into the graph goes one linear
//! term: Σ coefficient·(vertex, origin, direction, velocity). The tensor program in the rest of this
//! folder is the specification.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use burn::tensor::{IndexingUpdateOp, Int, Tensor, TensorData};
use glam::DVec3;
use rayon::prelude::*;

use super::edge::{full_room, grazing};
use super::soft_pairs::{Soft, SoftRay};
use super::{CoverageSettings, DepthRange, Rays, Visibility};
use crate::accel::{Hierarchy, HierarchyCache};
use crate::error::Result;
use crate::geometry::{Context, Topology, Triangles, Vec3, host_values, host_vectors, plain};

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

/// The weights of the surfaces that each ray meets.
pub struct SparseWeights<'a> {
    sparse: &'a Sparse,
    context: Context,
    rays: Rays,
    host: HostRays,
    surfaces: Lists<Surface>,
    background: Vec<f64>,
    form: Visibility,
    range: DepthRange,
    /// 1/(far − near)/γ by ray, for the softmax.
    per_depth: Vec<f64>,
    triangles: u32,
    tracked: bool,
    /// Layers with less room than this are full.
    full: f64,
    /// Candidates offered by the hierarchy.
    pub offered: u64,
}

/// Linear terms of rays: Σ over their surfaces.
#[derive(Default)]
struct Terms {
    /// Ray, triangle, and the nine coefficients.
    ray: Vec<i32>,
    triangle: Vec<i32>,
    corners: Vec<f64>,
    velocity: Vec<f64>,
    /// By ray: coefficients of origin and direction.
    origin: Vec<DVec3>,
    direction: Vec<DVec3>,
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

/// Sets the weights of surfaces in order of depth; returns that of the background.
fn layered(found: &mut [Surface]) -> f64 {
    let mut passed = 1.0;
    for i in 0..found.len() {
        let layer = found[i].layer;
        let before: f64 = found[..i]
            .iter()
            .filter(|s| s.layer == layer)
            .map(|s| s.p)
            .sum();
        let room = (1.0 - before).max(0.0);
        let taken = if room > 0.0 {
            found[i].p.min(room) / room
        } else {
            0.0
        };
        found[i].weight = passed * taken;
        passed *= 1.0 - taken;
    }
    passed
}

/// Surfaces for the soft order, and how many layers they have.
fn softened(found: &[Surface]) -> (Vec<Soft>, usize) {
    let mut layers: Vec<u32> = Vec::new();
    let soft = found.iter().map(|s| {
        let known = layers.iter().position(|&l| l == s.layer);
        let layer = known.unwrap_or_else(|| {
            layers.push(s.layer);
            layers.len() - 1
        });
        Soft {
            layer,
            t: s.t,
            p: s.p,
        }
    });
    let soft = soft.collect();
    (soft, layers.len())
}

/// Drops surfaces whose weights add up to less than `cutoff`, sets those of the rest, and returns that
/// of the background.
fn softmax(
    found: &mut Vec<Surface>,
    score: impl Fn(&Surface) -> f64,
    background: f64,
    cutoff: f64,
) -> f64 {
    let full = |s: &Surface| s.log[0] + score(s);
    let largest = found.iter().map(full).fold(background, f64::max);
    let least = largest - (found.len().max(1) as f64 / cutoff).ln();
    found.retain(|s| full(s) >= least);
    let rest = (background - largest).exp();
    let mut total = rest;
    for s in found.iter_mut() {
        s.weight = (s.log[0] + score(s) - largest).exp();
        total += s.weight;
    }
    found.iter_mut().for_each(|s| s.weight /= total);
    rest / total
}

/// ∏ (1 − p), and its derivatives by each p.
fn through_all(found: &[Surface], by_p: &mut Vec<f64>) -> f64 {
    let passed: f64 = found.iter().map(|s| 1.0 - s.p).product();
    by_p.clear();
    by_p.extend(found.iter().map(|s| -passed / (1.0 - s.p).max(1e-30)));
    passed
}

/// ∏ over layers of 1 − min(1, Σ p), and its derivatives by each p.
fn through_layers(found: &mut [Surface], by_p: &mut Vec<f64>, full: f64) -> f64 {
    by_p.clear();
    found.sort_unstable_by(|a, b| a.layer.cmp(&b.layer).then(a.triangle.cmp(&b.triangle)));
    let mut passed = 1.0;
    for layer in found.chunk_by(|a, b| a.layer == b.layer) {
        let room = (1.0 - layer.iter().map(|s| s.p).sum::<f64>()).max(0.0);
        passed *= room;
        let inverse = if room < full { 0.0 } else { -1.0 / room };
        by_p.extend(layer.iter().map(|_| inverse));
    }
    by_p.iter_mut().for_each(|g| *g *= passed);
    passed
}

impl Terms {
    fn begin_ray(&mut self) {
        self.origin.push(DVec3::ZERO);
        self.direction.push(DVec3::ZERO);
    }

    /// Adds a·dlogit + b·dt of a surface of the ray begun last, which is the i-th.
    #[allow(clippy::too_many_arguments)] // one place, all of it numbers of one pair
    fn add(
        &mut self,
        sparse: &Sparse,
        rays: &HostRays,
        i: usize,
        s: &Surface,
        a: f64,
        b: f64,
        least: f64,
    ) {
        let matters = b != 0.0 || (a != 0.0 && s.slope >= least);
        if !matters {
            return;
        }
        let triangle = &sparse.hierarchy.triangles[s.triangle as usize];
        let direction = rays.direction[i];
        // d(squared distance) = 2e·(dx − dy) at fixed border weights; x = o + t·d,
        // n·d dt = n·(Σ hit_i dv_i − do − t dd).
        let apart = triangle.point(s.hit) - triangle.point(s.border);
        let f = apart * (2.0 * s.sign * a);
        let m = triangle.normal * ((f.dot(direction) + b) / s.cosine);
        let from_ray = f - m;
        let last = self.origin.len() - 1;
        self.origin[last] += from_ray;
        self.direction[last] += from_ray * s.t;
        self.ray.push(last as i32);
        self.triangle.push(s.triangle as i32);
        for c in 0..3 {
            let v = m * s.hit[c] - f * s.border[c];
            self.corners.extend(v.to_array());
        }
        if let Some(time) = &rays.time {
            self.velocity.extend((from_ray * -time[i]).to_array());
        }
    }

    fn join(&mut self, other: Self) {
        let base = self.origin.len() as i32;
        self.ray.extend(other.ray.into_iter().map(|r| base + r));
        self.triangle.extend(other.triangle);
        self.corners.extend(other.corners);
        self.velocity.extend(other.velocity);
        self.origin.extend(other.origin);
        self.direction.extend(other.direction);
    }

    /// A row that is 0 and has these derivatives; None if nothing is in the graph.
    fn row(self, sparse: &Sparse, context: &Context, rays: &Rays, n: usize) -> Option<Tensor<2>> {
        let pairs = self.ray.len();
        sparse.taped.fetch_add(pairs as u64, Ordering::Relaxed);
        let mut sum: Option<Tensor<2>> = None;
        let mut add = |row: Tensor<2>| {
            sum = Some(match sum.take() {
                Some(sum) => sum + row,
                None => row,
            });
        };
        for (value, coefficients) in [
            (&rays.origin, &self.origin),
            (&rays.direction, &self.direction),
        ] {
            if value.is_tracked() {
                let axis = |k: usize| {
                    let row: Vec<f64> = coefficients.iter().map(|c| c[k]).collect();
                    context.row(&row)
                };
                add(value.dot(&Vec3::new(axis(0), axis(1), axis(2))));
            }
        }
        if pairs > 0 {
            let int = |v: Vec<i32>| {
                let data = TensorData::new(v, [pairs]);
                Tensor::<1, Int>::from_data(data, &context.device)
            };
            let ray = int(self.ray).reshape([1, pairs]);
            let triangle = int(self.triangle);
            let zeros = || Tensor::<2>::zeros([1, n], (&context.device, context.dtype));
            let mut spread = |table: &Tensor<2>, coefficients: &[f64], width: usize| {
                let rows = table.clone().select(0, triangle.clone());
                let rows = rows * context.tensor(coefficients, [pairs, width]);
                let sums = rows.sum_dim(1).reshape([1, pairs]);
                add(zeros().scatter(1, ray.clone(), sums, IndexingUpdateOp::Add));
            };
            if sparse.corners.is_tracked() {
                spread(&sparse.corners, &self.corners, 9);
            }
            if let Some(velocity) = &sparse.velocity
                && velocity.is_tracked()
                && !self.velocity.is_empty()
            {
                spread(velocity, &self.velocity, 3);
            }
        }
        let sum = sum?;
        let value = plain(&sum);
        Some(sum - value)
    }
}

impl SparseWeights<'_> {
    /// How many rays.
    fn len(&self) -> usize {
        self.background.len()
    }

    /// Several surfaces of each ray, (ray, surface, W over its probability): systematic sampling with
    /// `draws` draws, in the order of triangles.
    pub fn split(&self, random: &[f64], draws: usize) -> Vec<(u32, u32, f64)> {
        let least = 1.0 / draws as f64;
        let mut found = Vec::with_capacity(self.len());
        let mut order: Vec<(u32, f64)> = Vec::new();
        for (i, u) in random.iter().enumerate() {
            let surfaces = self.surfaces.of(i);
            if let ([s], true) = (surfaces, self.background[i] <= 0.0) {
                found.push((i as u32, s.triangle, s.weight));
                continue;
            }
            order.clear();
            order.extend(surfaces.iter().map(|s| (s.triangle, s.weight)));
            order.sort_unstable_by_key(|s| s.0);
            order.push((self.triangles, self.background[i]));
            let total: f64 = order.iter().map(|s| s.1).sum();
            // The next number of the comb u, u + 1, … over cumulative weights in units of 1/draws.
            let (mut passed, mut next) = (0.0, total * u * least);
            for &(k, weight) in &order {
                passed += weight;
                if passed > next {
                    found.push((i as u32, k, weight.max(least)));
                    while passed > next {
                        next += total * least;
                    }
                }
            }
        }
        found
    }

    /// Draws one surface a ray: as the tensor program does, in the order of triangles.
    pub fn draw(&self, random: &[f64]) -> Vec<u32> {
        let one = |order: &mut Vec<(u32, f64)>, i: usize| {
            if let ([s], true) = (self.surfaces.of(i), self.background[i] <= 0.0) {
                return s.triangle;
            }
            order.clear();
            let surfaces = self.surfaces.of(i).iter();
            order.extend(surfaces.map(|s| (s.triangle, s.weight)));
            order.sort_unstable_by_key(|s| s.0);
            let total: f64 = order.iter().map(|s| s.1).sum::<f64>() + self.background[i];
            let threshold = total * random[i];
            let mut passed = 0.0;
            for &mut (triangle, weight) in order {
                passed += weight;
                if passed > threshold {
                    return triangle;
                }
            }
            self.triangles
        };
        (0..self.len())
            .into_par_iter()
            .with_min_len(RAYS_A_PIECE)
            .map_init(Vec::new, one)
            .collect()
    }

    /// W/stop(W) of the drawn surfaces `[1, N]`; None if no gradient can flow.
    pub fn ratio(&self, drawn: &[u32]) -> Option<Tensor<2>> {
        let change = self.change(|i, k, s| {
            let is = |k: u32| if drawn[i] == k { 1.0 } else { 0.0 };
            match s {
                Some(s) if s.weight > 0.0 => is(k) / s.weight,
                Some(_) => 0.0,
                None if self.background[i] > 0.0 => is(k) / self.background[i],
                None => 0.0,
            }
        })?;
        Some(change + 1.0)
    }

    /// A row that is 0 and has the derivative of Σ v·W over surfaces and background (the triangle
    /// past the last, without a surface); None if no gradient can flow.
    fn change(&self, v: impl Fn(usize, u32, Option<&Surface>) -> f64 + Sync) -> Option<Tensor<2>> {
        if !self.tracked {
            return None;
        }
        let softmax = matches!(self.form, Visibility::Softmax { .. });
        let soft = matches!(self.form, Visibility::LayeredSoft { .. });
        let full = self.full;
        let parts: Vec<(Terms, Vec<f64>)> = chunks(self.len())
            .into_par_iter()
            .map(|range| {
                let mut terms = Terms::default();
                let (mut values, mut by_p, mut by_far) = (Vec::new(), Vec::new(), Vec::new());
                let (mut scratch, mut by_t) = (Vec::new(), Vec::new());
                for i in range {
                    terms.begin_ray();
                    let surfaces = self.surfaces.of(i);
                    values.clear();
                    values.extend(surfaces.iter().map(|s| v(i, s.triangle, Some(s))));
                    let background = v(i, self.triangles, None);
                    if softmax {
                        let weighted = surfaces.iter().zip(&values).map(|(s, v)| s.weight * v);
                        let mean = weighted.sum::<f64>() + self.background[i] * background;
                        let mut far = 0.0;
                        for (s, v) in surfaces.iter().zip(&values) {
                            let share = (v - mean) * s.weight;
                            let [_, by_logit, by_t] = s.log;
                            let b = share * (by_t - self.per_depth[i]);
                            if share.abs() > 1e-12 {
                                terms.add(self.sparse, &self.host, i, s, share * by_logit, b, 0.0);
                            }
                            far += share * self.by_far(i, s.t);
                        }
                        by_far.push(far);
                    } else if soft {
                        let list = softened(surfaces);
                        let ray = SoftRay::new(&list.0, list.1, self.per_depth[i], full);
                        let by_depth = ray.pull(&values, background, &mut by_p, &mut by_t);
                        for (k, s) in surfaces.iter().enumerate() {
                            let (a, b) = (by_p[k] * s.slope, by_p[k] * s.slope_t + by_t[k]);
                            if a.abs() + b.abs() > 1e-12 {
                                terms.add(self.sparse, &self.host, i, s, a, b, 0.0);
                            }
                        }
                        // Only inside of the bounds does far − near move, with far.
                        by_far.push(if self.is_inside(i) {
                            -by_depth / self.depth(i)
                        } else {
                            0.0
                        });
                    } else {
                        let background = (background, self.background[i]);
                        pull(surfaces, &values, background, full, &mut by_p, &mut scratch);
                        for (s, g) in surfaces.iter().zip(&by_p) {
                            let (a, b) = (g * s.slope, g * s.slope_t);
                            terms.add(self.sparse, &self.host, i, s, a, b, self.sparse.cutoff);
                        }
                    }
                }
                (terms, by_far)
            })
            .collect();
        let (mut terms, mut by_far) = (Terms::default(), Vec::new());
        for (t, f) in parts {
            terms.join(t);
            by_far.extend(f);
        }
        let row = terms.row(self.sparse, &self.context, &self.rays, self.len());
        let far = match (&self.range.change, softmax || soft) {
            (Some(change), true) => Some(change.clone() * self.context.row(&by_far)),
            _ => None,
        };
        match (row, far) {
            (Some(a), Some(b)) => Some(a + b),
            (a, b) => a.or(b),
        }
    }

    /// far − near.
    fn depth(&self, i: usize) -> f64 {
        let gamma = match self.form {
            Visibility::Softmax { gamma, .. } | Visibility::LayeredSoft { gamma } => gamma,
            Visibility::Layered => 1.0,
        };
        1.0 / (self.per_depth[i] * gamma)
    }

    /// Whether a ray starts inside of the bounds: near = max(|o| − ρ, 0) is 0 and far = |o| + ρ.
    fn is_inside(&self, i: usize) -> bool {
        2.0 * self.host.origin[i].length() <= self.depth(i)
    }

    /// ∂z/∂far/γ: outside of the bounds only far − t depends on far, inside its divisor does too.
    fn by_far(&self, i: usize, t: f64) -> f64 {
        let kept = if self.is_inside(i) {
            t / self.depth(i)
        } else {
            1.0
        };
        kept * self.per_depth[i]
    }

    /// Σ W·v of a host quantity: a row `[1, N]`, in the graph through the weights.
    pub fn mean(
        &self,
        v: impl Fn(usize, u32, bool) -> f64 + Sync,
        background: impl Fn(usize) -> f64 + Sync,
    ) -> Tensor<2> {
        let of = |i: usize, k: u32, s: Option<&Surface>| match s {
            Some(s) => v(i, k, s.cosine < 0.0),
            None => background(i),
        };
        let values: Vec<f64> = (0..self.len())
            .map(|i| {
                let surfaces = self.surfaces.of(i).iter();
                surfaces
                    .map(|s| s.weight * of(i, s.triangle, Some(s)))
                    .sum::<f64>()
                    + self.background[i] * of(i, self.triangles, None)
            })
            .collect();
        let value = self.context.row(&values);
        match self.change(of) {
            Some(change) => value + change,
            None => value,
        }
    }

    /// W of the background `[1, N]`, in the graph if a gradient can flow.
    pub fn attached_background(&self) -> Tensor<2> {
        self.mean(|_, _, _| 0.0, |_| 1.0)
    }

    /// Σ W·v of a column `[T, 1]` or `[M, 1]`, in the graph through it alone; `row` says which entry
    /// belongs to a surface, with a factor.
    pub fn spread(
        &self,
        column: &Tensor<2>,
        row: impl Fn(u32, bool) -> Option<(u32, f64)>,
    ) -> Option<Tensor<2>> {
        let (mut rays, mut rows, mut factors) = (Vec::new(), Vec::new(), Vec::new());
        for i in 0..self.surfaces.rays() {
            for s in self.surfaces.of(i) {
                if let Some((r, factor)) = row(s.triangle, s.cosine < 0.0)
                    && s.weight > 0.0
                {
                    rays.push(i as u32);
                    rows.push(r);
                    factors.push(factor * s.weight);
                }
            }
        }
        if rays.is_empty() {
            return None;
        }
        let context = &self.context;
        let values = crate::geometry::gather_row(column.clone(), &context.index_row(&rows));
        let values = values * context.row(&factors);
        let zeros = Tensor::<2>::zeros([1, self.len()], (&context.device, context.dtype));
        Some(zeros.scatter(1, context.index_row(&rays), values, IndexingUpdateOp::Add))
    }

    /// Σ W·t: the mean distance `[1, N]`, in the graph through weights and distances.
    pub fn mean_distance(&self) -> Tensor<2> {
        let values: Vec<f64> = (0..self.len())
            .map(|i| self.surfaces.of(i).iter().map(|s| s.weight * s.t).sum())
            .collect();
        let value = self.context.row(&values);
        if !self.tracked {
            return value;
        }
        let mut terms = Terms::default();
        for i in 0..self.len() {
            terms.begin_ray();
            for s in self.surfaces.of(i) {
                terms.add(self.sparse, &self.host, i, s, 0.0, s.weight, 0.0);
            }
        }
        let by_distance = terms.row(self.sparse, &self.context, &self.rays, self.len());
        let by_weight = self.change(|_, _, s| s.map_or(0.0, |s| s.t));
        [by_distance, by_weight]
            .into_iter()
            .flatten()
            .fold(value, |sum, term| sum + term)
    }

    /// Weights by object `[O, N]`, and of the background `[1, N]`, without tape.
    pub fn by_object(&self, object: &[u32], objects: usize) -> (Tensor<2>, Tensor<2>) {
        let n = self.len();
        let mut sums = vec![0.0; objects * n];
        for i in 0..n {
            for s in self.surfaces.of(i) {
                sums[object[s.triangle as usize] as usize * n + i] += s.weight;
            }
        }
        let background = self.context.row(&self.background);
        (self.context.tensor(&sums, [objects, n]), background)
    }

    /// How many surfaces share each ray.
    pub fn counts(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.len()).map(|i| self.surfaces.of(i).len())
    }
}

/// ∂(Σ v_k·W_k + v·W_background)/∂p of surfaces in order of depth.
fn pull(
    surfaces: &[Surface],
    values: &[f64],
    (background, passed): (f64, f64),
    full: f64,
    by_p: &mut Vec<f64>,
    scratch: &mut Vec<(u32, f64, f64)>,
) {
    let n = surfaces.len();
    by_p.clear();
    by_p.resize(n, 0.0);
    // By layer: Σ p so far, and Σ step·T/(1 − C) over later slots.
    scratch.clear();
    for s in surfaces {
        match scratch.iter_mut().find(|l| l.0 == s.layer) {
            Some(l) => l.1 += s.p,
            None => scratch.push((s.layer, s.p, 0.0)),
        }
    }
    let mut after = passed;
    for k in (0..n).rev() {
        let next = if k + 1 < n { values[k + 1] } else { background };
        let step = (next - values[k]) * after;
        for l in scratch.iter_mut() {
            let room = 1.0 - l.1;
            if room >= full {
                l.2 += step / room;
            }
        }
        let s = &surfaces[k];
        if let Some(l) = scratch.iter_mut().find(|l| l.0 == s.layer) {
            by_p[k] = -l.2;
            l.1 -= s.p;
        }
        after += s.weight;
    }
}
