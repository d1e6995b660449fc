//! The triangles that may matter to a ray of the softmax: those that it passes within the reach of the blur. They are
//! computed in f32, eight at once, with a margin for rounding. So there may be too many, but none is missing.

use glam::DVec3;
use pulp::Arch;

use super::hierarchy::Hierarchy;
use super::simd::{F8, LANES, Lanes, Machine, Task, dispatch};
use super::wide::{Node, Planes8, Ray8, Visitor, Wide};

/// Which hits of a ray matter.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    /// Hits count from the first distance up to the second.
    pub range: (f64, f64),
    /// The largest distance from a triangle at which a hit of its plane may matter.
    pub most: f64,
    /// A hit counts as farther away by this factor times the squared distance between it and its triangle. It is 0
    /// where depth does not matter.
    pub penalty: f64,
    /// A hit that lies deeper inside its triangle than `deep`, and not before `begun`, hides everything that counts as
    /// farther away than the hit's distance plus `behind`.
    pub deep: f64,
    pub begun: f64,
    pub behind: f64,
}

/// How a triangle counts for a ray that may hit it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counts {
    Not,
    /// It may count, but may not hide anything.
    Perhaps,
    Fully,
}

/// A triangle that may matter, and a lower bound of the distance at which its hit counts.
type Candidate = (u32, f64);

/// Near a ray's origin, the rounding of hits is this fraction of [`Search::rounding`].
const NEAR: f32 = 0.4;

impl Hierarchy {
    /// Returns the triangles that may matter to a ray (origin, direction, shutter time), in any order. `counts` returns
    /// how a triangle counts, given the cosine at which the ray meets it. Returns `None` if everything is hidden from
    /// the ray's start on (`behind` is −∞).
    pub fn candidates(
        &self,
        arch: Arch,
        ray: (DVec3, DVec3, f64),
        reach: Reach,
        counts: impl Fn(u32, f32) -> Counts,
    ) -> Option<Vec<u32>> {
        let wide = &self.wide;
        let task = Candidates {
            wide,
            ray,
            reach,
            counts: |k: u32, cosine| match self.triangles[k as usize].valid {
                true => counts(k, cosine),
                false => Counts::Not,
            },
        };
        let (mut found, limit) = dispatch(arch, task);
        found.retain(|c| c.1 <= limit);
        let found = found.into_iter().map(|c| c.0);
        (limit > f64::NEG_INFINITY).then(|| found.collect())
    }
}

/// [`Hierarchy::candidates`] as a task.
struct Candidates<'a, F> {
    wide: &'a Wide,
    ray: (DVec3, DVec3, f64),
    reach: Reach,
    counts: F,
}

impl<F: Fn(u32, f32) -> Counts> Task for Candidates<'_, F> {
    type Output = (Vec<Candidate>, f64);

    #[inline(always)]
    fn run<M: Machine>(self, machine: M) -> (Vec<Candidate>, f64) {
        let (wide, reach, (origin, direction, time)) = (self.wide, self.reach, self.ray);
        // For a distant origin, rounding would be larger than triangles, so the ray starts near them.
        let skipped = (-origin.dot(direction) - 2.0 * wide.extent - reach.most).max(0.0);
        let origin = origin + direction * skipped;
        let size = wide.extent + origin.abs().element_sum();
        let (o, d) = (origin.as_vec3(), direction.as_vec3());
        let mut search = Search {
            machine,
            wide,
            eight: Ray8::new(machine, o, d, time as f32, 0.0),
            skipped,
            // 33 half units in the last place of the largest coordinate.
            rounding: (2e-6 * size) as f32,
            reach,
            limit: reach.range.1,
            counts: self.counts,
            candidates: Vec::new(),
        };
        wide.traverse(&mut search);
        (search.candidates, search.limit)
    }
}

/// The triangles found so far while a ray traverses the tree.
struct Search<'a, M: Machine, F> {
    machine: M,
    wide: &'a Wide,
    eight: Ray8<M>,
    /// The distance from the ray's origin to that of `eight`.
    skipped: f64,
    rounding: f32,
    reach: Reach,
    limit: f64,
    counts: F,
    candidates: Vec<Candidate>,
}

impl<M: Machine, F: Fn(u32, f32) -> Counts> Visitor for Search<'_, M, F> {
    #[inline(always)]
    fn limit(&self) -> f32 {
        (self.limit - self.skipped) as f32
    }

    #[inline(always)]
    fn enter(&self, node: &Node, near: f32) -> (u32, Lanes) {
        let Reach { most, penalty, .. } = self.reach;
        let margin = 1e-6 * self.wide.extent;
        // A hit that is no nearer than this reaches the limit at a smaller distance from its triangle.
        let left = self.limit - self.skipped - f64::from(near.max(0.0)) + margin;
        let within = match penalty > 0.0 {
            true => most.min((left.max(0.0) / penalty).sqrt()),
            false => most,
        };
        let grown = self.eight.grown(self.machine, (within + margin) as f32);
        self.eight.enter(self.machine, node, &grown, self.limit())
    }

    #[inline(always)]
    fn leaf(&mut self, index: usize) -> bool {
        let (leaf, reach) = (&self.wide.leaves[index], self.reach);
        let number = |x: f32| F8::splat(self.machine, x);
        let (zero, rounding) = (number(0.0), number(self.rounding));
        let velocity = self.wide.velocity(index);
        let Planes8 { t, cosine, least } = leaf.planes(self.machine, velocity, &self.eight);
        let rounding = number(1.0).div(cosine).abs().mul_add(rounding, rounding);
        let beside = (least + rounding).min(zero);
        let counted = (beside * number(reach.penalty as f32)).mul_add(beside, t - rounding);
        // NaN is kept, as the nearest.
        let counted = counted.max(number(f32::MIN));
        let begun =
            number(NEAR).mul_add(rounding, t) - number((reach.range.0 - self.skipped) as f32);
        let room = begun.min(number(self.limit()) - counted);
        let room = room.min(beside + number(reach.most as f32));
        let mut mask = room.less(zero).not().bits() & leaf.used;
        if mask == 0 {
            return true;
        }
        // Hits that are certain despite rounding.
        let inside = number(reach.deep as f32).less(least - rounding);
        let after = number((reach.begun - self.skipped) as f32).less(t - rounding);
        let before = (t + rounding).less(number(self.limit()));
        let certain = inside.and(after).and(before).bits();
        let (far, counted) = ((t + rounding).lanes(), counted.lanes());
        let cosine = cosine.lanes();
        while mask != 0 {
            let i = mask.trailing_zeros() as usize % LANES;
            mask &= mask - 1;
            let counts = (self.counts)(leaf.triangle[i], cosine[i]);
            if counts == Counts::Not {
                continue;
            }
            self.candidates
                .push((leaf.triangle[i], f64::from(counted[i]) + self.skipped));
            if counts == Counts::Fully && certain >> i & 1 == 1 {
                let hidden = f64::from(far[i]) + self.skipped + reach.behind;
                self.limit = self.limit.min(hidden);
            }
        }
        self.limit > f64::NEG_INFINITY
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::accel::HostTriangle;

    /// Rows of squares of a ball.
    const ROWS: u32 = 72;

    /// Every triangle that a ray hits is a candidate, however far away the ray starts. Boxes are in f32, and for a
    /// distant origin rounding is larger than a face.
    #[test]
    fn what_distant_rays_hit_is_found() {
        let corner = |row: u32, column: u32| {
            let [down, around] = [row, column].map(|k| f64::from(k) * PI / f64::from(ROWS));
            DVec3::new(
                around.cos() * down.sin(),
                down.cos(),
                -around.sin() * down.sin(),
            )
        };
        let square = |k: u32| {
            let (i, j) = (k / (2 * ROWS), k % (2 * ROWS));
            let [a, b, c, d] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
            [[a, b, c], [a, c, d]]
        };
        let faces: Vec<_> = (0..2 * ROWS * ROWS).flat_map(square).collect();
        let triangle = |f: &[(u32, u32); 3]| {
            HostTriangle::new(f.map(|(i, j)| corner(i, j)), DVec3::ZERO, true)
        };
        let hierarchy = Hierarchy::new(faces.iter().map(triangle).collect(), None);
        let reach = Reach {
            range: (0.0, f64::INFINITY),
            most: 1e-6,
            penalty: 0.0,
            deep: f64::INFINITY,
            begun: 0.0,
            behind: f64::INFINITY,
        };
        let mut hits = 0;
        for distance in [3.0, 1e2, 1e4, 1e6] {
            for i in 0..200 {
                let turn = f64::from(i) * 2.399_963;
                let towards = DVec3::new(turn.cos(), (0.37 * turn).sin(), turn.sin()) * 0.7;
                let origin = DVec3::new(0.6, 0.5, 0.62).normalize() * distance;
                let direction = (towards - origin).normalize();
                let is_hit = |k: u32| {
                    let t = &hierarchy.triangles[k as usize];
                    let along = t.normal.dot(t.corners[0] - origin) / t.normal.dot(direction);
                    let weights = t.weights(origin + direction * along);
                    along > 0.0 && weights.iter().all(|&w| w >= 0.0)
                };
                let ray = (origin, direction, 0.0);
                let found = hierarchy.candidates(Arch::new(), ray, reach, |_, _| Counts::Fully);
                let found = found.expect("nothing hides all");
                for k in (0..faces.len() as u32).filter(|&k| is_hit(k)) {
                    hits += 1;
                    assert!(found.contains(&k), "triangle {k} from {distance:e}");
                }
            }
        }
        // A line through a ball meets two faces, or passes between faces.
        assert!(hits > 1500, "{hits}");
    }
}
