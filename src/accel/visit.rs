//! The triangles that may matter to a ray of the softmax: they are found in f32, eight at once, with a margin
//! for the rounding, and tested exactly afterwards.

use glam::DVec3;

use super::hierarchy::Hierarchy;
use super::simd::{F8, LANES, Lanes, Machine};
use super::wide::{FEW, Grown, Leaf, Planes8, Ray8, Visitor, Wide};

/// The distance beside a ray within which triangles matter. `most` bounds the distance; and where
/// `distance_penalty` is not 0 a hit counts as farther away by that times the squared distance between it
/// and its triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reach {
    pub most: f64,
    pub distance_penalty: f64,
}

impl Reach {
    /// The distance up to which triangles matter if they are hit no more than `left` before the limit.
    #[inline(always)]
    fn within(self, left: f64) -> f64 {
        if self.distance_penalty > 0.0 {
            self.most
                .min((left.max(0.0) / self.distance_penalty).sqrt())
        } else {
            self.most
        }
    }
}

/// Hits close to a ray's origin are rounded by this share of [`Ray::rounding`].
const NEAR: f32 = 0.4;

/// A ray in f32, from a point near the triangles, since a distant origin would round by more than they are
/// large.
struct Ray<M: Machine> {
    eight: Ray8<M>,
    machine: M,
    /// How far from the origin that point is.
    skipped: f64,
    reach: Reach,
    /// The rounding of coordinates: 33 half units in the last place of the largest.
    rounding: f32,
    /// Hits nearer don't count.
    from: f32,
}

impl<M: Machine> Ray<M> {
    #[inline(always)]
    fn new(
        machine: M,
        (origin, direction, time): (DVec3, DVec3, f64),
        reach: Reach,
        from: f64,
        extent: f64,
    ) -> Self {
        let skipped = (-origin.dot(direction) - 2.0 * extent - reach.most).max(0.0);
        let from_near = origin + direction * skipped;
        let size = extent + from_near.abs().element_sum();
        let (o, d) = (from_near.as_vec3(), direction.as_vec3());
        Self {
            eight: Ray8::new(machine, o, d, time as f32, 0.0),
            machine,
            skipped,
            reach,
            rounding: (2e-6 * size) as f32,
            from: (from - skipped) as f32,
        }
    }

    /// The triangles of a leaf that it may hit before `limit`, one bit each, and distances before which it
    /// doesn't, with what it passes beside them.
    #[inline(always)]
    fn test(&self, leaf: &Leaf, velocity: Option<&[Lanes; 3]>, limit: f32) -> (u32, Lanes) {
        let number = |x: f32| F8::splat(self.machine, x);
        let zero = number(0.0);
        let Planes8 { t, cosine, least } = leaf.planes(self.machine, velocity, &self.eight);
        let inverse = number(1.0).div(cosine).abs();
        let rounding = inverse.mul_add(number(self.rounding), number(self.rounding));
        let beside = (least + rounding).min(zero);
        let penalty = number(self.reach.distance_penalty as f32);
        let counted = (beside * penalty).mul_add(beside, t - rounding);
        // Not a number is kept, and first: the exact test decides.
        let near = counted.max(number(f32::MIN));
        let begun = number(NEAR).mul_add(rounding, t) - number(self.from);
        let between = begun.min(number(limit) - near);
        let room = between.min(beside + number(self.reach.most as f32));
        (room.less(zero).not().bits() & leaf.used, near.lanes())
    }
}

impl Hierarchy {
    /// Calls a function with every triangle that a ray (origin, direction, time in the shutter) may hit
    /// within `reach` of it in a range from … limit; the function returns the limit from there on. Returns how
    /// many triangles were offered.
    #[inline(always)]
    pub(crate) fn visit<M: Machine>(
        &self,
        machine: M,
        ray: (DVec3, DVec3, f64),
        reach: Reach,
        (from, limit): (f64, f64),
        f: impl FnMut(u32) -> f64,
    ) -> u32 {
        let wide = &self.wide;
        let ray = Ray::new(machine, ray, reach, from, wide.extent);
        if wide.nodes.is_empty() {
            return wide.visit_all(&ray, limit, f);
        }
        let mut offers = Offers {
            wide,
            ray: &ray,
            margin: 1e-6 * wide.extent,
            limit,
            offered: 0,
            f,
        };
        wide.traverse(machine, &ray.eight, &mut offers);
        offers.offered
    }
}

/// The triangles that are offered to a function, while a ray goes through the tree.
struct Offers<'a, M: Machine, F> {
    wide: &'a Wide,
    ray: &'a Ray<M>,
    margin: f64,
    limit: f64,
    offered: u32,
    f: F,
}

impl<M: Machine, F: FnMut(u32) -> f64> Visitor<M> for Offers<'_, M, F> {
    #[inline(always)]
    fn limit(&self) -> f32 {
        (self.limit - self.ray.skipped) as f32
    }

    #[inline(always)]
    fn grown(&self, near: f32) -> Grown<M> {
        let left = self.limit - self.ray.skipped - f64::from(near.max(0.0)) + self.margin;
        let margin = (self.ray.reach.within(left) + self.margin) as f32;
        self.ray.eight.grown(self.ray.machine, margin)
    }

    #[inline(always)]
    fn leaf(&mut self, index: usize) -> bool {
        let leaf = &self.wide.leaves[index];
        let velocity = self.wide.velocity(index);
        let (mut mask, nears) = self.ray.test(leaf, velocity, self.limit());
        while mask != 0 {
            let i = mask.trailing_zeros() as usize % LANES;
            mask &= mask - 1;
            if f64::from(nears[i]) + self.ray.skipped <= self.limit {
                self.offered += 1;
                self.limit = (self.f)(leaf.triangle[i]);
            }
        }
        true
    }
}

impl Wide {
    /// The same without boxes: of all triangles those that may be hit, from near to far.
    #[inline(always)]
    fn visit_all<M: Machine>(
        &self,
        ray: &Ray<M>,
        mut limit: f64,
        mut f: impl FnMut(u32) -> f64,
    ) -> u32 {
        let end = (limit - ray.skipped) as f32;
        let mut nears = [[0.0; LANES]; FEW / LANES];
        let mut left = 0;
        for (slot, (leaf, nears)) in self.leaves.iter().zip(&mut nears).enumerate() {
            let (mask, found) = ray.test(leaf, self.velocity(slot), end);
            *nears = found;
            left |= u64::from(mask) << (slot * LANES);
        }
        let near = |i: usize| nears[i / LANES % nears.len()][i % LANES];
        let mut offered = 0;
        while left != 0 {
            let mut nearest = left.trailing_zeros() as usize;
            let mut least = near(nearest);
            let mut others = left & (left - 1);
            while others != 0 {
                let i = others.trailing_zeros() as usize;
                others &= others - 1;
                let less = near(i) < least;
                nearest = if less { i } else { nearest };
                least = if less { near(i) } else { least };
            }
            if f64::from(least) + ray.skipped > limit {
                break;
            }
            offered += 1;
            limit = f(nearest as u32);
            left &= !(1 << nearest);
        }
        offered
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::{HostTriangle, Task, dispatch};
    use crate::scene::shapes;

    /// [`Hierarchy::visit`] of all that a ray may hit, as a task.
    struct Visit<'a>(&'a Hierarchy, (DVec3, DVec3, f64));

    impl Task for Visit<'_> {
        type Output = Vec<u32>;

        fn run<M: Machine>(self, machine: M) -> Vec<u32> {
            let reach = Reach {
                most: 1e-6,
                distance_penalty: 0.0,
            };
            let mut offered = Vec::new();
            self.0
                .visit(machine, self.1, reach, (0.0, f64::INFINITY), |k| {
                    offered.push(k);
                    f64::INFINITY
                });
            offered
        }
    }

    /// Boxes offer every triangle that a ray hits, however far away it starts: boxes are in f32, and a
    /// distant origin rounds by more than a face is large.
    #[test]
    fn boxes_offer_what_distant_rays_hit() {
        let mesh = shapes::icosphere(5, &burn::tensor::Device::flex());
        let vertices = mesh.host_vertices().expect("vertices");
        let corner = |i: u32| DVec3::from(vertices[i as usize]);
        let triangle = |f: &[u32; 3]| HostTriangle::new(f.map(corner), DVec3::ZERO, true);
        let hierarchy = Hierarchy::new(mesh.faces.iter().map(triangle).collect(), None);
        for distance in [3.0, 1e2, 1e4, 1e6] {
            for i in 0..200 {
                let turn = f64::from(i) * 2.399_963;
                let towards = DVec3::new(turn.cos(), (0.37 * turn).sin(), turn.sin()) * 0.7;
                let origin = DVec3::new(0.6, 0.5, 0.62).normalize() * distance;
                let direction = (towards - origin).normalize();
                let is_hit = |k: u32| {
                    let (range, reach) = ((0.0, f64::INFINITY), (1e-12, f64::INFINITY));
                    let t = &hierarchy.triangles[k as usize];
                    t.intersect(origin, direction, 1e-9, range, reach).is_some()
                };
                let offered = dispatch(
                    pulp::Arch::new(),
                    Visit(&hierarchy, (origin, direction, 0.0)),
                );
                for k in (0..mesh.faces.len() as u32).filter(|&k| is_hit(k)) {
                    assert!(offered.contains(&k), "triangle {k} from {distance:e}");
                }
            }
        }
    }
}
