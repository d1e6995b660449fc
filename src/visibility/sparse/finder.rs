//! Finds the surfaces that matter to a ray.

use pulp::Arch;

use super::ray::{HostRay, Surface};
use crate::accel::{Hierarchy, Machine, PlaneHit, Reach, Task, dispatch};
use crate::geometry::{Context, Topology};
use crate::visibility::edge::grazing;
use crate::visibility::{CoverageSettings, Softmax, Span};

/// exp(−60) is nothing beside 1.
const DEEP: f64 = 60.0;

/// The end of a ray, and the distance from which on the back of the emitter's object counts.
struct Ends {
    limit: f64,
    near_end: Option<f64>,
    /// The distance behind something opaque beyond which nothing matters.
    depth_margin: f64,
    /// The distance along the ray that divides a weight by e; 0 for shadow rays.
    depth_falloff: f64,
    reach: Reach,
}

/// [`Finder::intersect`] as a task.
struct Intersect<'a> {
    finder: &'a Finder<'a>,
    ray: &'a HostRay,
    span: Option<Span>,
    found: &'a mut Vec<Surface>,
}

impl Task for Intersect<'_> {
    type Output = u32;

    #[inline(always)]
    fn run<M: Machine>(self, machine: M) -> u32 {
        let (finder, ray) = (self.finder, self.ray);
        let ends = finder.ends(ray, self.span);
        let mut limit = ends.limit;
        finder.hierarchy.visit(
            machine,
            (ray.origin, ray.direction, ray.time),
            ends.reach,
            (finder.settings.t_min, limit),
            #[inline(always)]
            |k| {
                limit = finder.test(ray, &ends, k, limit, self.found);
                limit
            },
        )
    }
}

/// Finds the surfaces that matter to a ray.
pub(crate) struct Finder<'a> {
    arch: Arch,
    hierarchy: &'a Hierarchy,
    topology: &'a Topology,
    settings: CoverageSettings,
    pub(super) form: Softmax,
    grazing: f64,
    /// The squared distance from a triangle up to which it matters, and its root: at its own depth
    /// in the softmax.
    reach: f64,
    root: f64,
    /// 1/σ.
    inverse: f64,
    /// The distance to the border from which on a hit inside is as good as opaque.
    deep_inside: f64,
    /// Triangles of smaller opacity, and what lies behind more than 1 − cutoff, are left out.
    pub(super) cutoff: f64,
    /// A surface that counts e to this power less than something opaque doesn't matter.
    pub(super) log_cutoff: f64,
}

impl<'a> Finder<'a> {
    pub fn new(
        hierarchy: &'a Hierarchy,
        topology: &'a Topology,
        context: &Context,
        settings: &CoverageSettings,
        form: Softmax,
        cutoff: f64,
    ) -> Self {
        let log_cutoff = (1.0 / cutoff).ln();
        Self {
            arch: Arch::new(),
            hierarchy,
            topology,
            settings: *settings,
            form,
            grazing: grazing(context.dtype),
            reach: settings.sigma * log_cutoff,
            root: (settings.sigma * log_cutoff).sqrt(),
            inverse: settings.sigma.recip(),
            deep_inside: (DEEP * settings.sigma).sqrt(),
            cutoff,
            log_cutoff: (10.0 / cutoff).ln(),
        }
    }

    /// The surfaces that a ray meets, unordered, and the number of triangles that were tested. Shadow rays have
    /// no span: light passes them by products, whatever the depth.
    #[inline]
    pub fn intersect(&self, ray: &HostRay, span: Option<Span>, found: &mut Vec<Surface>) -> u32 {
        let task = Intersect {
            finder: self,
            ray,
            span,
            found,
        };
        dispatch(self.arch, task)
    }

    #[inline(always)]
    fn ends(&self, ray: &HostRay, span: Option<Span>) -> Ends {
        let near_end = ray.distance.map(|d| {
            let object = &self.topology.object;
            let same = matches!((ray.departure, ray.emitter), (Some(a), Some(b))
                if object[a as usize] == object[b as usize]);
            if same { 0.5 * d } else { 0.0 }
        });
        let margin = 1.0 - self.settings.arrival_margin;
        let limit = ray.distance.map_or(f64::INFINITY, |d| d * margin);
        let mut ends = Ends {
            limit,
            near_end,
            depth_margin: 0.0,
            depth_falloff: 0.0,
            reach: Reach {
                most: self.root,
                distance_penalty: 0.0,
            },
        };
        if let Some(span) = span {
            // A weight is exp(−(t + penalty·squared distance)/falloff), at most, over that of the best
            // so far: the background, to begin with.
            let [falloff, background] = self.form.falloff(span);
            ends.depth_falloff = falloff;
            ends.depth_margin = falloff * self.log_cutoff;
            let distance_penalty = falloff * self.inverse;
            ends.limit = limit.min(background + ends.depth_margin);
            // A hit before near is as far from every triangle.
            let squared = ((ends.limit - span.near) / distance_penalty).max(0.0);
            let most = if span.near > 0.0 {
                let half = 0.5 / distance_penalty;
                half + (half * half + squared).sqrt()
            } else {
                squared.sqrt()
            };
            ends.reach = Reach {
                most,
                distance_penalty,
            };
        }
        ends
    }

    /// The hit of a ray on a triangle that counts before `limit`: with the sign of its logit over σ and the
    /// logit.
    #[inline(always)]
    fn counted(
        &self,
        ray: &HostRay,
        ends: &Ends,
        k: u32,
        limit: f64,
    ) -> Option<(PlaneHit, f64, f64)> {
        let Self {
            topology, settings, ..
        } = self;
        let logs = ends.depth_falloff > 0.0;
        let triangle = &self.hierarchy.triangles[k as usize];
        let o = ray.origin - triangle.velocity * ray.time;
        let range = (settings.t_min, limit);
        let reach = if logs { f64::INFINITY } else { self.reach };
        let reach = (reach, self.deep_inside);
        let hit = triangle.intersect(o, ray.direction, self.grazing, range, reach)?;
        if logs && !hit.inside && hit.t + ends.reach.distance_penalty * hit.squared_distance > limit
        {
            return None;
        }
        // Two tests at once, which is one jump.
        let at_end = |end: Option<u32>| end.unwrap_or(u32::MAX) == k;
        if at_end(ray.departure) | at_end(ray.emitter) {
            return None;
        }
        let at = k as usize;
        let mut side = topology.visible_side[at] * hit.cosine;
        if let (Some(e), Some(from)) = (ray.emitter, ends.near_end)
            && topology.object[e as usize] == topology.object[at]
            && hit.t >= from
        {
            side = -side;
        }
        if side < 0.0 {
            return None;
        }
        let sign = if hit.inside {
            self.inverse
        } else {
            -self.inverse
        };
        Some((hit, sign, hit.squared_distance * sign))
    }

    /// Adds a triangle to those that a ray meets before `limit`, if it does so; returns the limit from
    /// there on.
    #[inline(always)]
    fn test(
        &self,
        ray: &HostRay,
        ends: &Ends,
        k: u32,
        limit: f64,
        found: &mut Vec<Surface>,
    ) -> f64 {
        let logs = ends.depth_falloff > 0.0;
        let Some((hit, sign, logit)) = self.counted(ray, ends, k, limit) else {
            return limit;
        };
        let beside = |end: Option<u32>| end.is_some_and(|e| self.topology.neighbours.are(e, k));
        // Deep inside both are 1.
        let softened = logit <= DEEP && (beside(ray.departure) || beside(ray.emitter));
        if softened && (!hit.inside || logit < f64::EPSILON) {
            return limit;
        }
        // Shadow rays don't test far outside, the others use the logarithm.
        let decay = if logit > DEEP || (logs && logit < -DEEP) {
            0.0
        } else {
            (-logit.abs()).exp()
        };
        let one_plus = 1.0 + decay;
        let mut p = if hit.inside { 1.0 } else { decay } / one_plus;
        let mut slope = decay / (one_plus * one_plus);
        // ∂log p/∂logit is 1 − p. Only the softmax needs it.
        let mut log_p = match (logs, decay) {
            (false, _) => 0.0,
            (true, 0.0) => logit.min(0.0),
            (true, _) => logit.min(0.0) - one_plus.ln(),
        };
        let mut log_slope = if hit.inside { decay } else { 1.0 } / one_plus;
        if softened {
            p = (1.0 - decay) / one_plus;
            slope *= 2.0;
            if logs {
                log_p = (1.0 - decay).ln() - one_plus.ln();
            }
            log_slope = 2.0 * decay / (1.0 - decay * decay).max(1e-6);
        }
        let (mut slope_t, mut log_slope_t) = (0.0, 0.0);
        let start = self.settings.start;
        if start > 0.0 && ray.departure.is_some() {
            let begun = hit.t * hit.t / start;
            let missing = if begun > 60.0 { 0.0 } else { (-begun).exp() };
            let (share, by_t) = (1.0 - missing, 2.0 * hit.t / start * missing);
            if share < 1e-30 {
                return limit;
            }
            slope_t = p * by_t;
            log_slope_t = by_t / share;
            if logs && missing > 0.0 {
                log_p += share.ln();
            }
            p *= share;
            slope *= share;
        }
        found.push(Surface {
            triangle: k,
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
        if logs {
            // It may be the best so far.
            return limit.min(hit.t - log_p * ends.depth_falloff + ends.depth_margin);
        }
        // Nothing arrives behind something opaque.
        let opaque = p > 1.0 - 0.1 * self.cutoff;
        if opaque { f64::NEG_INFINITY } else { limit }
    }
}
