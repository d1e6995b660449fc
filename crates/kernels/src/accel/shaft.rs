//! Bounds of rays of similar direction: boxes that none of them can meet are skipped for all at once.

use super::rays::{Hit, NOTHING, Rays8};
use super::simd::{F8, LANES, Lanes, Machine, each_of_three};
use super::wide::{Boxes, Node, Visitor, Wide, displaced};
use crate::cube::{max, min};

/// The smallest component of directions along the axis of a shaft.
const ALONG: f32 = 0.3;

/// The largest spread of rays across the axis, at a distance of 1.
const SPREAD: f32 = 0.5;

/// The largest distance between rays across the axis, in sizes of leaves.
const APART: f32 = 4.0;

/// Hits are assumed to lie within this distance, in the unit of the scene.
const FAR: f32 = 8.0;

/// The number of groups of eight rays that are bounded together. Mostly these are the rays of a pixel.
pub(super) const EIGHTS: usize = 2;

/// A minimum and a maximum.
type Bounds = [f32; 2];

/// The region that rays of similar direction pass through: where they begin, and how far they move sideways for a step
/// along an axis.
#[derive(Clone, Copy)]
pub(super) struct Shaft<M: Machine> {
    /// The axis, and the two axes across it.
    axes: [usize; 3],
    /// Whether rays go towards larger coordinates. Otherwise all coordinates along the axis are mirrored.
    forward: bool,
    /// Where rays begin along the axis; and (in `range`) how far from there they begin and end.
    start: [F8<M>; 2],
    range: [F8<M>; 2],
    /// Where rays begin across the axis; and (in `slopes`) their slopes.
    across: [[F8<M>; 2]; 2],
    slopes: [[F8<M>; 2]; 2],
    /// Distances along rays for a step along the axis.
    steps: [F8<M>; 2],
}

/// Returns the bounds of a number over all rays.
#[inline(always)]
fn bounds<M: Machine>(machine: M, rays: &[Rays8], of: impl Fn(&Rays8) -> F8<M>) -> Bounds {
    let first = of(&rays[0]);
    let (mut least, mut most) = (first, first);
    for eight in &rays[1..] {
        let own = of(eight);
        (least, most) = (least.min(own), most.max(own));
    }
    let zero = F8::splat(machine, 0.0);
    [least.least(), -(zero - most).least()]
}

impl<M: Machine> Shaft<M> {
    /// Returns the shaft of rays, if they have similar directions and begin near each other.
    #[inline(always)]
    pub fn around(machine: M, rays: &[Rays8], grain: f32) -> Option<Self> {
        let splat = |x| F8::splat(machine, x);
        let load = |lanes: &Lanes| F8::load(machine, lanes);
        let mut longest = (ALONG, None);
        let mut axis = 0;
        while axis < 3 {
            let [least, most] = bounds(machine, rays, |r| load(&r.direction[axis]));
            for (along, forward) in [(least, true), (-most, false)] {
                if along > longest.0 {
                    longest = (along, Some((axis, forward, least, most)));
                }
            }
            axis += 1;
        }
        let (axis, forward, least, most) = longest.1?;
        let [slow, fast] = if forward {
            [least, most]
        } else {
            [-most, -least]
        };
        let axes = [axis, (axis + 1) % 3, (axis + 2) % 3];
        let sign = splat(if forward { 1.0 } else { -1.0 });
        let margin = 4.0 * bounds(machine, rays, |r| load(&r.margin))[1];
        let along = |r: &Rays8| load(&r.direction[axis]).abs();
        let [first, _] = bounds(machine, rays, |r| load(&r.from) * along(r));
        let [_, last] = bounds(machine, rays, |r| load(&r.limit) * along(r));
        let mut starts = [[0.0; 2]; 3];
        let mut slopes = [[0.0; 2]; 2];
        let mut k = 0;
        while k < 3 {
            let sign = if k == 0 { sign } else { splat(1.0) };
            let [low, high] = bounds(machine, rays, |r| load(&r.origin[axes[k]]) * sign);
            starts[k] = [low - margin, high + margin];
            if k > 0 {
                let apart = high - low;
                let slope = |r: &Rays8| load(&r.direction[axes[k]]).div(along(r));
                let [low, high] = bounds(machine, rays, slope);
                let spread = high - low;
                if spread > SPREAD || spread * min(last, FAR) + apart > APART * grain {
                    return None;
                }
                // Slopes are rounded, and so are the values computed from them.
                let rounding = 1e-6 * (1.0 + max(low.abs(), high.abs()));
                slopes[k - 1] = [low - rounding, high + rounding];
            }
            k += 1;
        }
        let both = |x: Bounds| x.map(splat);
        Some(Self {
            axes,
            forward,
            start: both(starts[0]),
            range: both([first - margin, last + margin]),
            across: [both(starts[1]), both(starts[2])],
            slopes: slopes.map(both),
            steps: both([fast.recip(), slow.recip()]),
        })
    }

    /// Returns which of eight boxes rays may enter before a limit, one bit each, and the smallest distance at which
    /// they may enter each.
    #[inline(always)]
    pub fn enter(&self, machine: M, boxes: &Boxes, limit: f32) -> (u32, Lanes) {
        let zero = F8::splat(machine, 0.0);
        let sides = |axis: usize| {
            let (min, max) = (&boxes.min[axis], &boxes.max[axis]);
            (F8::load(machine, min), F8::load(machine, max))
        };
        let [axis, u, v] = self.axes;
        let (min, max) = sides(axis);
        let (low, high) = if self.forward {
            (min, max)
        } else {
            (zero - max, zero - min)
        };
        let first = (low - self.start[1]).max(self.range[0]);
        let last = (high - self.start[0]).min(self.range[1]);
        let mut missed = last.less(first);
        for (k, axis) in [u, v].into_iter().enumerate() {
            let (low, high) = sides(axis);
            let ([gentle, steep], [left, right]) = (self.slopes[k], self.across[k]);
            let [a, b, c, d] = [gentle * first, gentle * last, steep * first, steep * last];
            let least = a.min(b).min(c.min(d)) + left;
            let most = a.max(b).max(c.max(d)) + right;
            missed = missed.or(high.less(least)).or(most.less(low));
        }
        let near = (first * self.steps[0]).min(first * self.steps[1]);
        missed = missed.or(F8::splat(machine, limit).less(near));
        (!missed.bits() & ((1 << LANES) - 1), near.lanes())
    }
}

impl Wide {
    /// Computes the hits of rays within a shaft.
    #[inline(always)]
    pub fn hits_in<M: Machine, const ANY: bool>(
        &self,
        machine: M,
        shaft: Shaft<M>,
        rays: &mut [Rays8],
        hits: &mut [Hit],
    ) {
        let mut triangles = [[0.0; LANES]; EIGHTS];
        let none = F8::splat(machine, f32::from_bits(NOTHING)).lanes();
        for (triangle, _) in triangles.iter_mut().zip(&*rays) {
            *triangle = none;
        }
        let mut search = InShaft::<M, ANY> {
            wide: self,
            machine,
            shaft,
            limit: 0.0,
            rays,
            triangles: &mut triangles,
        };
        search.limit = search.farthest();
        self.traverse(&mut search);
        for (k, hit) in hits.iter_mut().enumerate() {
            let (eight, i) = (&rays[k / LANES], k % LANES);
            *hit = Hit {
                t: eight.limit[i] + eight.skipped[i],
                triangle: triangles[k / LANES][i].to_bits(),
            };
        }
    }
}

/// The nearest hits so far of rays within a shaft. The limit of a ray is the distance of its hit, or `f32::MIN` with
/// `ANY`.
struct InShaft<'a, M: Machine, const ANY: bool> {
    wide: &'a Wide,
    machine: M,
    shaft: Shaft<M>,
    /// The largest limit of all rays.
    limit: f32,
    rays: &'a mut [Rays8],
    /// The triangles that rays hit, as bits.
    triangles: &'a mut [Lanes],
}

impl<M: Machine, const ANY: bool> InShaft<'_, M, ANY> {
    #[inline(always)]
    fn farthest(&self) -> f32 {
        let zero = F8::splat(self.machine, 0.0);
        let mut limit = F8::splat(self.machine, f32::MIN);
        for eight in &*self.rays {
            limit = limit.max(F8::load(self.machine, &eight.limit));
        }
        -(zero - limit).least()
    }
}

impl<M: Machine, const ANY: bool> Visitor for InShaft<'_, M, ANY> {
    #[inline(always)]
    fn limit(&self) -> f32 {
        self.limit
    }

    #[inline(always)]
    fn enter(&self, node: &Node, _near: f32) -> (u32, Lanes) {
        let (mask, nears) = self.shaft.enter(self.machine, &node.boxes, self.limit);
        (mask & ((1 << node.count) - 1), nears)
    }

    #[inline(always)]
    fn leaf(&mut self, index: usize) -> bool {
        let (machine, leaf) = (self.machine, &self.wide.leaves[index]);
        let boxes = &self.wide.boxes[index];
        let met = self.shaft.enter(machine, boxes, self.limit).0 & leaf.used;
        if met == 0 {
            return true;
        }
        let velocity = self.wide.velocity(index);
        let splat = |x| F8::splat(machine, x);
        for (eight, triangles) in self.rays.iter_mut().zip(&mut *self.triangles) {
            let load = |lanes: &Lanes| F8::load(machine, lanes);
            let at_rest = each_of_three!(|x| load(x), &eight.origin);
            let direction = each_of_three!(|x| load(x), &eight.direction);
            let (less_time, from) = (load(&eight.less_time), load(&eight.from));
            let below = splat(0.0) - load(&eight.margin);
            let (mut limit, mut which) = (load(&eight.limit), load(triangles));
            let mut left = met;
            while left != 0 {
                let i = left.trailing_zeros() as usize % LANES;
                left &= left - 1;
                let one = |lanes: &Lanes| splat(lanes[i]);
                let origin = match velocity {
                    Some(velocity) => {
                        let velocity = each_of_three!(|x| one(x), velocity);
                        displaced(&at_rest, velocity, less_time)
                    }
                    None => at_rest,
                };
                let planes = leaf.meet(one, &origin, &direction);
                let hit = planes.hit(below, one(&leaf.slack), from, limit);
                let past = if ANY { splat(f32::MIN) } else { planes.t };
                limit = hit.select(past, limit);
                which = hit.select(splat(f32::from_bits(leaf.triangle[i])), which);
            }
            eight.limit = limit.lanes();
            *triangles = which.lanes();
        }
        self.limit = self.farthest();
        self.limit > f32::MIN
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::{NOTHING, Rays8, Shaft};
    use crate::accel::hierarchy::Hierarchy;
    use crate::accel::simd::Plain;
    use crate::accel::{HitRay, HostTriangle};

    /// Rays that are traced together hit the same triangles as each alone, for any direction and motion.
    #[test]
    fn rays_hit_the_same_together_and_alone() {
        let mut seed = 1u32;
        let mut random = || {
            seed = seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            f64::from(seed >> 8) / f64::from(1 << 24)
        };
        let arch = pulp::Arch::new();
        let (mut hit, mut bounded) = (0, 0);
        for (count, speed) in [(40, 0.0), (3000, 0.0), (3000, 0.2)] {
            let mut vector = |size: f64| (DVec3::new(random(), random(), random()) - 0.5) * size;
            let triangle = |_| {
                let place = vector(2.0);
                let corners = [0; 3].map(|_| place + vector(0.2));
                HostTriangle::new(corners, vector(speed), true)
            };
            let hierarchy = Hierarchy::new((0..count).map(triangle).collect(), None);
            for batch in 0..200 {
                let wide = if batch % 3 == 0 { 0.3 } else { 0.02 };
                let (eye, target) = (vector(if batch % 2 == 0 { 1.0 } else { 80.0 }), vector(1.0));
                let ray = |_| {
                    let begin = eye + vector(wide);
                    let direction = (target + vector(wide) - begin).normalize().as_vec3();
                    let begin: Vec3 = begin.as_vec3();
                    let limit = if batch % 5 == 0 { 0.7 } else { f32::INFINITY };
                    HitRay::new(begin, direction, vector(1.0).x as f32 + 0.5, limit)
                };
                let rays: Vec<HitRay> = (0..37).map(ray).collect();
                let (mut together, mut alone) = (Vec::new(), Vec::new());
                hierarchy.hits::<false, false>(arch, None, &rays, &mut together);
                let mut any = Vec::new();
                hierarchy.hits::<true, false>(arch, None, &rays, &mut any);
                for (k, ray) in rays.iter().enumerate() {
                    hierarchy.hits::<false, false>(arch, None, &[*ray], &mut alone);
                    let (a, b) = (together[k], alone[0]);
                    let is_hit = b.triangle != NOTHING;
                    assert_eq!(is_hit, a.triangle != NOTHING, "{ray:?}");
                    assert_eq!(is_hit, any[k].triangle != NOTHING, "{ray:?}");
                    if is_hit {
                        assert!(a.t == b.t, "{ray:?}: {a:?}, {b:?}");
                        hit += 1;
                    }
                }
                let mut eights = [Rays8::NONE; 2];
                for (k, eight) in eights.iter_mut().enumerate() {
                    eight.fill(Plain::<false>, &rays[8 * k..][..8]);
                }
                let shaft = Shaft::around(Plain::<false>, &eights, hierarchy.wide.grain);
                bounded += usize::from(shaft.is_some());
            }
        }
        assert!(hit > 5000 && bounded > 200, "{hit} hits, {bounded} shafts");
    }
}
