//! Finds the surfaces that matter to a ray.

use pulp::Arch;

use super::ray::{HostRay, Span, Surface};
use crate::accel::{Hierarchy, Machine, Reach, Task, dispatch};
use crate::geometry::{Context, Topology};
use crate::visibility::edge::grazing;
use crate::visibility::{CoverageSettings, Softmax};

/// exp(−60) is nothing beside 1.
const DEEP: f64 = 60.0;

/// How far a ray goes, and from where on the back of the emitter's object counts.
struct Ends {
    limit: f64,
    near_end: Option<f64>,
    /// What lies this far behind something opaque doesn't matter.
    behind: f64,
    /// The distance along the ray that divides a weight by e; 0 for shadow rays.
    fall: f64,
    reach: Reach,
}

/// [`Finder::meet`] as a task.
struct Meeting<'a> {
    finder: &'a Finder<'a>,
    ray: &'a HostRay,
    span: Span,
    found: &'a mut Vec<Surface>,
}

impl Task for Meeting<'_> {
    type Output = u32;

    #[inline(always)]
    fn run<M: Machine>(self, machine: M) -> u32 {
        let Self {
            finder,
            ray,
            span,
            found,
        } = self;
        finder.meet_on(machine, ray, span, found)
    }
}

/// Finds the surfaces that matter to a ray.
pub(crate) struct Finder<'a> {
    arch: Arch,
    hierarchy: &'a Hierarchy,
    topology: &'a Topology,
    settings: CoverageSettings,
    pub(super) form: Softmax,
    /// Shadow rays pass by products, whatever the depth.
    shadow: bool,
    grazing: f64,
    /// The squared distance from a triangle up to which it matters, and its root: at its own depth
    /// in the softmax.
    reach: f64,
    root: f64,
    /// 1/σ.
    inverse: f64,
    /// How far inside a hit is as good as opaque, whatever its distance to the border.
    deep: f64,
    /// Triangles of smaller opacity, and what lies behind more than 1 − cutoff, are left out.
    pub(super) cutoff: f64,
    /// What is e to this power less than something opaque doesn't matter.
    pub(super) nats: f64,
}

impl<'a> Finder<'a> {
    /// For camera and bounce rays.
    pub fn new(
        hierarchy: &'a Hierarchy,
        topology: &'a Topology,
        context: &Context,
        settings: &CoverageSettings,
        form: Softmax,
        cutoff: f64,
    ) -> Self {
        let nats = (1.0 / cutoff).ln();
        Self {
            arch: Arch::new(),
            hierarchy,
            topology,
            settings: *settings,
            form,
            shadow: false,
            grazing: grazing(context.dtype),
            reach: settings.sigma * nats,
            root: (settings.sigma * nats).sqrt(),
            inverse: settings.sigma.recip(),
            deep: (DEEP * settings.sigma).sqrt(),
            cutoff,
            nats: (10.0 / cutoff).ln(),
        }
    }

    /// For shadow rays.
    pub fn of_shadows(self) -> Self {
        Self {
            shadow: true,
            ..self
        }
    }

    /// The surfaces that a ray meets, unordered, and how many were asked.
    #[inline]
    pub fn meet(&self, ray: &HostRay, span: Span, found: &mut Vec<Surface>) -> u32 {
        let task = Meeting {
            finder: self,
            ray,
            span,
            found,
        };
        dispatch(self.arch, task)
    }

    #[inline(always)]
    fn meet_on<M: Machine>(
        &self,
        machine: M,
        ray: &HostRay,
        span: Span,
        found: &mut Vec<Surface>,
    ) -> u32 {
        let ends = self.ends(ray, span);
        let mut limit = ends.limit;
        self.hierarchy.visit_on(
            machine,
            (ray.origin, ray.direction, ray.time),
            ends.reach,
            (self.settings.t_min, limit),
            #[inline(always)]
            |k| {
                limit = self.ask(ray, &ends, k, limit, found);
                limit
            },
        )
    }

    #[inline(always)]
    fn ends(&self, ray: &HostRay, span: Span) -> Ends {
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
            behind: 0.0,
            fall: 0.0,
            reach: Reach {
                most: self.root,
                price: 0.0,
            },
        };
        if !self.shadow {
            let Softmax { gamma, epsilon, .. } = self.form;
            // A weight is exp(−(t + price·squared distance)/fall), at most, over that of the best so far:
            // the background, to begin with.
            ends.fall = gamma * span.depth();
            ends.behind = ends.fall * self.nats;
            let price = ends.fall * self.inverse;
            let background = span.far - epsilon * span.depth();
            ends.limit = limit.min(background + ends.behind);
            // A hit before near is as far from every triangle.
            let squared = ((ends.limit - span.near) / price).max(0.0);
            let most = if span.near > 0.0 {
                let half = 0.5 / price;
                half + (half * half + squared).sqrt()
            } else {
                squared.sqrt()
            };
            ends.reach = Reach { most, price };
        }
        ends
    }

    /// Adds a triangle to those that a ray meets before `limit`, if it does; returns the limit from
    /// there on.
    #[inline(always)]
    fn ask(&self, ray: &HostRay, ends: &Ends, k: u32, limit: f64, found: &mut Vec<Surface>) -> f64 {
        let Self {
            topology, settings, ..
        } = self;
        let HostRay {
            origin,
            direction,
            time,
            departure,
            emitter,
            ..
        } = *ray;
        let near_end = ends.near_end;
        let neighbour =
            |end: Option<u32>, k: u32| end.is_some_and(|e| topology.neighbours.are(e, k));
        let logs = ends.fall > 0.0;
        let triangle = &self.hierarchy.triangles[k as usize];
        let o = origin - triangle.velocity * time;
        let range = (settings.t_min, limit);
        let reach = if logs { f64::INFINITY } else { self.reach };
        let Some(hit) = triangle.meet(o, direction, self.grazing, range, (reach, self.deep)) else {
            return limit;
        };
        if logs && !hit.inside && hit.t + ends.reach.price * hit.squared_distance > limit {
            return limit;
        }
        // Two tests at once, which is one jump.
        let at_end = |end: Option<u32>| end.unwrap_or(u32::MAX) == k;
        if at_end(departure) | at_end(emitter) {
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
        let sign = if hit.inside {
            self.inverse
        } else {
            -self.inverse
        };
        let logit = hit.squared_distance * sign;
        // Deep inside both are 1.
        let softened = logit <= DEEP && (neighbour(departure, k) || neighbour(emitter, k));
        if softened && (!hit.inside || logit < f64::EPSILON) {
            return limit;
        }
        // Shadow rays don't ask far outside, the others by the logarithm.
        let decay = if logit > DEEP || (logs && logit < -DEEP) {
            0.0
        } else {
            (-logit.abs()).exp()
        };
        let one_plus = 1.0 + decay;
        let edge = if hit.inside { 1.0 } else { decay } / one_plus;
        let mut slope = decay / (one_plus * one_plus);
        let mut p = edge;
        // ∂log p/∂logit is 1 − p. Only the softmax asks for it.
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
        if settings.start > 0.0 && departure.is_some() {
            let begun = hit.t * hit.t / settings.start;
            let missing = if begun > 60.0 { 0.0 } else { (-begun).exp() };
            let (share, by_t) = (1.0 - missing, 2.0 * hit.t / settings.start * missing);
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
            return limit.min(hit.t - log_p * ends.fall + ends.behind);
        }
        // Nothing arrives behind something opaque.
        if p > 1.0 - 0.1 * self.cutoff {
            return f64::NEG_INFINITY;
        }
        limit
    }
}
