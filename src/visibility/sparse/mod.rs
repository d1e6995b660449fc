//! The same weights and transmittances from the triangles that can matter to each ray only. Values
//! and derivatives are computed on the host, in f64, ray by ray; into the graph goes one linear
//! term: Σ coefficient·(vertex, origin, direction, velocity). The tensor program in the rest of this
//! folder is the specification.

mod finder;
mod ray;
mod terms;
mod weighed;
mod weights;

use std::sync::Arc;

use burn::tensor::Tensor;
use glam::DVec3;
use rayon::prelude::*;

use super::{CoverageSettings, DepthRange, Rays, Softmax};
use crate::accel::{Hierarchy, HierarchyCache, HostTriangle};
use crate::error::Result;
use crate::geometry::{Context, Topology, Triangles, Vec3, host_values, host_vectors};
use finder::Finder;
use ray::{HostRay, Span, Surface};
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
    /// Triangles of smaller opacity, and what lies behind more than 1 − cutoff, are left out.
    cutoff: f64,
}

/// Reads triangles back.
///
/// # Errors
/// If they can't be read.
fn host_triangles(triangles: &Triangles) -> Result<Vec<HostTriangle>> {
    let (corners, velocity) = tables(triangles);
    let host = host_values(&corners)?;
    let moved = velocity.as_ref().map(host_values).transpose()?;
    let valid = host_values(&triangles.valid.clone().float())?;
    let vector = |v: &[f64]| DVec3::new(v[0], v[1], v[2]);
    let of_row = |(k, v): (usize, &[f64])| {
        let corners = [vector(v), vector(&v[3..]), vector(&v[6..])];
        let shift = moved.as_ref().map_or(DVec3::ZERO, |m| vector(&m[3 * k..]));
        HostTriangle::new(corners, shift, valid[k] > 0.0)
    };
    Ok(host.par_chunks_exact(9).enumerate().map(of_row).collect())
}

/// Boxes over triangles that are read back, or those of a cache fitted to them.
///
/// # Errors
/// If they can't be read.
pub(crate) fn hierarchy_of(
    triangles: &Triangles,
    cache: Option<&HierarchyCache>,
) -> Result<Arc<Hierarchy>> {
    let list = host_triangles(triangles)?;
    Ok(match cache {
        Some(cache) => cache.take(list),
        None => Arc::new(Hierarchy::new(list)),
    })
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

    fn ray(&self, rays: &Rays, i: usize) -> HostRay {
        let emitter = rays.arrival.as_ref().and_then(|(e, _)| e.get(i).copied());
        HostRay {
            origin: self.origin[i],
            direction: self.direction[i],
            time: self.time.as_ref().map_or(0.0, |t| t[i]),
            departure: rays.departure.as_ref().map(|d| d[i]),
            emitter,
            distance: self.arrival.as_ref().map(|a| a[i]),
        }
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
    /// With boxes over the triangles.
    pub fn new(triangles: &Triangles, hierarchy: Arc<Hierarchy>, cutoff: f64) -> Self {
        let (corners, velocity) = tables(triangles);
        Self {
            hierarchy,
            corners,
            velocity,
            cutoff: SAFETY * cutoff,
        }
    }

    /// The triangles and their boxes.
    pub fn hierarchy(&self) -> Arc<Hierarchy> {
        self.hierarchy.clone()
    }

    fn finder<'a>(
        &'a self,
        context: &Context,
        topology: &'a Topology,
        settings: &CoverageSettings,
        form: Softmax,
    ) -> Finder<'a> {
        Finder::new(
            &self.hierarchy,
            topology,
            context,
            settings,
            form,
            self.cutoff,
        )
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
        form: Softmax,
        range: DepthRange,
    ) -> Result<SparseWeights<'_>> {
        let host = HostRays::new(rays)?;
        let near = host_values(&range.near)?;
        let far = host_values(&range.far)?;
        let finder = self.finder(context, topology, settings, form);
        let n = host.origin.len();
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
                    let ray = host.ray(rays, i);
                    let span = Span {
                        near: near[i],
                        far: far[i],
                    };
                    offered += u64::from(finder.meet(&ray, span, &mut found));
                    background.push(finder.weigh(span, &mut found));
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
        let depth = far.iter().zip(&near).map(|(f, n)| f - n).collect();
        Ok(SparseWeights {
            sparse: self,
            context: context.clone(),
            tracked: self.is_tracked(rays),
            rays: rays.clone(),
            host,
            surfaces,
            background,
            form,
            range,
            depth,
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
        form: Softmax,
        needed: &[bool],
    ) -> Result<(Tensor<2>, u64)> {
        let host = HostRays::new(rays)?;
        let n = host.origin.len();
        let tracked = self.is_tracked(rays);
        let finder = self.finder(context, topology, settings, form).of_shadows();
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
                    let ray = host.ray(rays, i);
                    offered += u64::from(finder.meet(&ray, Span::NONE, &mut found));
                    let value = weighed::passed(&found, &mut by_p);
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

/// Rays in pieces for the cores: as many whatever the machine, so that sums come out the same.
fn chunks(n: usize) -> Vec<std::ops::Range<usize>> {
    (0..n.div_ceil(RAYS_A_PIECE))
        .map(|i| i * RAYS_A_PIECE..((i + 1) * RAYS_A_PIECE).min(n))
        .collect()
}

const RAYS_A_PIECE: usize = 512;
