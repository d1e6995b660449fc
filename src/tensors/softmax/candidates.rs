//! The triangles that may matter to each ray, from a BVH whose boxes are enlarged by the reach of the blur.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DVec3;
use pulp::Arch;
use rayon::prelude::*;

use super::coverage::CoverageSettings;
use super::pairs::List;
use super::weights::Softmax;
use crate::error::Result;
use crate::geometry::{Topology, Triangles, host_values, host_vectors};
use crate::scene::Flattened;
use crate::tensors::rays::{HostRay, Rays};
use softray_kernels::accel::{Counts, Hierarchy, HostTriangle, LastHierarchy, Reach};

/// The share of the cutoff that each omitted triangle may use: a ray may omit many, and gradients are more sensitive
/// than images.
const SAFETY: f64 = 0.1;

/// The least number of rays in a piece of work.
const PIECE: usize = 512;

/// Lists the triangles that may matter to rays.
pub(crate) struct Candidates {
    hierarchy: Arc<Hierarchy>,
    /// Triangles of smaller opacity are omitted, and so is everything behind an opacity of more than 1 − `cutoff`.
    cutoff: f64,
}

/// The scene and the settings with which softmax rays are traced.
#[derive(Clone, Copy)]
pub(crate) struct Form<'a> {
    pub scene: &'a Flattened,
    pub softmax: Softmax,
    pub coverage: CoverageSettings,
}

impl Candidates {
    pub fn new(hierarchy: Arc<Hierarchy>, cutoff: f64) -> Self {
        Self {
            hierarchy,
            cutoff: SAFETY * cutoff,
        }
    }

    pub fn hierarchy(&self) -> Arc<Hierarchy> {
        self.hierarchy.clone()
    }

    /// Returns the triangles of each ray in ascending order. Returns `None` for a ray that is not needed, and for a
    /// shadow ray (which has an arrival) that is blocked by an opaque surface.
    pub fn of(&self, form: &Form, rays: &Rays, needed: &[bool]) -> Result<Vec<Option<List>>> {
        let arch = Arch::new();
        let host = rays.host()?;
        let all = host.par_iter().zip(needed).with_min_len(PIECE);
        let one =
            |(ray, &needed): (&HostRay, &bool)| needed.then(|| self.of_ray(arch, form, ray))?;
        Ok(all.map(one).collect())
    }

    #[inline(always)]
    fn of_ray(&self, arch: Arch, form: &Form, ray: &HostRay) -> Option<List> {
        let Topology {
            object,
            neighbors,
            visible_side,
            ..
        } = &form.scene.topology;
        let ends = [ray.departure, ray.emitter];
        let counts = |k: u32, cosine: f32| {
            let side = visible_side[k as usize] * f64::from(cosine);
            // Near its end on an emitter, a ray sees the other side of the emitter's object.
            let turns = ray
                .emitter
                .is_some_and(|e| object[e as usize] == object[k as usize]);
            let uncertain = turns || cosine.abs() < 1e-4;
            if ends.contains(&Some(k)) || (side < 0.0 && !uncertain) {
                Counts::Not
            } else if uncertain || ends.iter().flatten().any(|&e| neighbors.are(e, k)) {
                Counts::Perhaps
            } else {
                Counts::Fully
            }
        };
        let way = (ray.origin, ray.direction, ray.time);
        let reach = self.reach(form, ray);
        let mut triangles = self.hierarchy.candidates(arch, way, reach, counts)?;
        triangles.sort_unstable();
        let is_whole = match triangles[..] {
            [k] => self.is_whole(form, ray, &reach, k, counts),
            _ => false,
        };
        Some(List {
            triangles,
            is_whole,
        })
    }

    /// Returns whether the only candidate covers the whole ray: it is hit deep inside, and long before the background
    /// matters.
    fn is_whole(
        &self,
        form: &Form,
        ray: &HostRay,
        reach: &Reach,
        k: u32,
        counts: impl Fn(u32, f32) -> Counts,
    ) -> bool {
        let triangle = &self.hierarchy.triangles[k as usize];
        let origin = ray.origin - triangle.velocity * ray.time;
        let cosine = triangle.normal.dot(ray.direction);
        let t = triangle.normal.dot(triangle.corners[0] - origin) / cosine;
        let CoverageSettings { sigma, start, .. } = form.coverage;
        let nothing = self.nothing();
        let begun = ray.departure.map_or(0.0, |_| (start * nothing).sqrt());
        let inside = triangle.distance_to_lines(origin + ray.direction * t);
        counts(k, cosine as f32) == Counts::Fully
            && inside > (sigma * nothing).sqrt()
            && t > begun.max(reach.range.0)
            // The background counts from this far before the limit.
            && t + 2.0 * reach.behind < reach.range.1
    }

    /// Returns n such that a factor e⁻ⁿ relative to something opaque is negligible.
    fn nothing(&self) -> f64 {
        (10.0 / self.cutoff).ln()
    }

    fn reach(&self, form: &Form, ray: &HostRay) -> Reach {
        let CoverageSettings {
            sigma,
            t_min,
            start,
            arrival_margin,
        } = form.coverage;
        let far_outside = (1.0 / self.cutoff).ln();
        let nothing = self.nothing();
        // From this distance on, a hit is past the blurred start of its ray, except for a share of e⁻⁴.
        let begun = match ray.departure {
            Some(_) => t_min.max(2.0 * start.sqrt()),
            None => t_min,
        };
        if let Some(distance) = ray.distance {
            let limit = distance * (1.0 - arrival_margin);
            return Reach {
                range: (t_min, limit),
                most: (sigma * far_outside).sqrt(),
                penalty: 0.0,
                // Behind something opaque, no light arrives. The blurred start passes less than the cutoff.
                deep: (sigma * nothing).sqrt(),
                begun: begun.max((start * nothing).sqrt()),
                behind: f64::NEG_INFINITY,
            };
        }
        // A weight is at most exp(−(t + penalty·squared distance)/falloff) relative to the weight of the background, or
        // of a hit inside a triangle, past the start (p > 1/2 there). In front of these, the least falloff applies;
        // behind them, the largest.
        let (distance, radius) = (ray.origin.length(), form.scene.radius());
        let (near, far) = ((distance - radius).max(0.0), distance + radius);
        let [least, most, background] = form.softmax.falloff(near, far);
        let (penalty, limit) = (least / sigma, background + most * nothing);
        // A hit at t < near is at least near − t away from every triangle.
        let half = 0.5 / penalty;
        Reach {
            range: (t_min, limit),
            most: half + (half * half + ((limit - near) / penalty).max(0.0)).sqrt(),
            penalty,
            deep: 0.0,
            begun,
            behind: most * (nothing + 1.0),
        }
    }
}

/// The cost of a group of rays, in pairs.
const GROUP: usize = 2000;

/// Groups rays with about equally many candidates: rays without candidates, rays that one candidate covers, and the
/// others. A small group of the others joins the group of the next larger number.
pub(crate) fn grouped(lists: &[Option<List>]) -> Vec<Vec<u32>> {
    let mut groups: BTreeMap<(bool, usize), Vec<u32>> = BTreeMap::new();
    for (i, list) in lists.iter().enumerate() {
        if let Some(list) = list {
            let (count, is_whole) = (list.triangles.len(), list.is_whole);
            let key = match count {
                1.. if !is_whole => (true, count.next_power_of_two()),
                _ => (false, count),
            };
            groups.entry(key).or_default().push(i as u32);
        }
    }
    let (mut found, mut few): (Vec<Vec<u32>>, Vec<u32>) = Default::default();
    let mut groups = groups.into_iter().peekable();
    while let Some(((is_open, size), mut group)) = groups.next() {
        group.append(&mut few);
        match groups.peek() {
            Some(((_, next), _)) if is_open && group.len() * (next - size) < GROUP => few = group,
            _ => found.push(group),
        }
    }
    found
}

/// Reads triangles back and builds their BVH, or refits the BVH of a cache to them.
pub(crate) fn hierarchy_of(triangles: &Triangles, cache: &LastHierarchy) -> Result<Arc<Hierarchy>> {
    let corners = &triangles.corners;
    let (a, b) = (host_vectors(&corners.a)?, host_vectors(&corners.b)?);
    let c = host_vectors(&corners.c)?;
    let velocity = triangles.velocity.as_ref().map(host_vectors).transpose()?;
    let valid = host_values(&triangles.valid.clone().float())?;
    let triangle = |k: usize| {
        let shift = velocity.as_ref().map_or(DVec3::ZERO, |v| v[k]);
        HostTriangle::new([a[k], b[k], c[k]], shift, valid[k] > 0.0)
    };
    let list = (0..a.len()).into_par_iter().map(triangle);
    Ok(cache.take(None, list, None))
}
