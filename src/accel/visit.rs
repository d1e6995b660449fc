//! The triangles that may matter to a ray of the softmax: they are found in f32, eight at once, with a margin
//! for the rounding, and tested exactly afterwards.

use glam::{DVec3, Vec3};

use super::simd::{LANES, Lanes, Machine, bits};
use super::wide::{FEW, Node, Wide, safe_inverse};
use super::wide::{Ray, larger, smaller};

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

/// A ray as boxes are intersected with it.
struct Slabs {
    origin: Vec3,
    inverse: Vec3,
}

impl Wide {
    /// Calls a function with every triangle that a ray may hit within reach of it between `from`
    /// and `limit`; the function returns the limit from there on. Returns how many triangles it was
    /// called with.
    #[inline(always)]
    pub fn visit<M: Machine>(
        &self,
        machine: M,
        ray: (DVec3, DVec3, f64),
        reach: Reach,
        range: (f64, f64),
        f: impl FnMut(u32) -> f64,
    ) -> u32 {
        if self.nodes.is_empty() {
            self.visit_all(machine, ray, reach, range, f)
        } else {
            self.traverse(machine, ray, reach, range, f)
        }
    }

    /// A ray from a point near the triangles, since a distant origin would round by more than they are
    /// large; and how far from its origin that is.
    #[inline(always)]
    fn near_ray(
        &self,
        (origin, direction, time): (DVec3, DVec3, f64),
        reach: Reach,
        from: f64,
    ) -> (Ray, f64) {
        let skipped = (-origin.dot(direction) - 2.0 * self.extent - reach.most).max(0.0);
        let from_near = origin + direction * skipped;
        let size = self.extent + from_near.abs().element_sum();
        let ray = Ray {
            origin: from_near.as_vec3(),
            direction: direction.as_vec3(),
            time: time as f32,
            reach: reach.most as f32,
            distance_penalty: reach.distance_penalty as f32,
            rounding: (2e-6 * size) as f32,
            from: (from - skipped) as f32,
        };
        (ray, skipped)
    }

    /// The same without boxes: of all triangles those that may be hit, from near to far.
    #[inline(always)]
    fn visit_all<M: Machine>(
        &self,
        machine: M,
        ray: (DVec3, DVec3, f64),
        reach: Reach,
        (from, mut limit): (f64, f64),
        mut f: impl FnMut(u32) -> f64,
    ) -> u32 {
        let (ray, skipped) = self.near_ray(ray, reach, from);
        let end = (limit - skipped) as f32;
        let mut nears = [[0.0; LANES]; FEW / LANES];
        // A loop of its own for what doesn't move, so that no leaf is tested for it.
        let moves = self.velocities.as_deref();
        let mut left = if moves.is_none() {
            self.test_all(machine, |_| None, &ray, end, &mut nears)
        } else {
            let of_leaf = |i| moves.and_then(|v| v.get(i));
            self.test_all(machine, of_leaf, &ray, end, &mut nears)
        };
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
            if f64::from(least) + skipped > limit {
                break;
            }
            offered += 1;
            limit = f(nearest as u32);
            left &= !(1 << nearest);
        }
        offered
    }

    /// The triangles that may be hit, one bit each, and the distances that they begin at.
    #[inline(always)]
    fn test_all<'a, M: Machine>(
        &self,
        machine: M,
        of_leaf: impl Fn(usize) -> Option<&'a [Lanes; 3]>,
        ray: &Ray,
        end: f32,
        nears: &mut [Lanes; FEW / LANES],
    ) -> u64 {
        let mut all = 0;
        for (slot, (leaf, nears)) in self.leaves.iter().zip(nears).enumerate() {
            let (mask, found) = leaf.test(machine, of_leaf(slot), ray, end);
            *nears = found;
            all |= u64::from(mask) << (slot * LANES);
        }
        all
    }

    #[inline(always)]
    fn traverse<M: Machine>(
        &self,
        machine: M,
        (origin, direction, time): (DVec3, DVec3, f64),
        reach: Reach,
        (from, mut limit): (f64, f64),
        mut f: impl FnMut(u32) -> f64,
    ) -> u32 {
        let (ray, skipped) = self.near_ray((origin, direction, time), reach, from);
        let slabs = Slabs {
            origin: ray.origin,
            inverse: Vec3::new(
                safe_inverse(direction.x),
                safe_inverse(direction.y),
                safe_inverse(direction.z),
            ),
        };
        let margin = 1e-6 * self.extent;
        let mut offered = 0;
        let mut stack = [(0u32, 0f32); 32];
        let mut spilled: Vec<(u32, f32)> = Vec::new();
        let mut len = 1;
        loop {
            let (index, near) = if len > 0 {
                len -= 1;
                stack[len]
            } else if let Some(top) = spilled.pop() {
                top
            } else {
                break;
            };
            if f64::from(near) + skipped > limit {
                continue;
            }
            let at = index as usize / 2;
            if index % 2 == 1 {
                let leaf = &self.leaves[at];
                let end = (limit - skipped) as f32;
                let (mut mask, nears) = leaf.test(machine, self.velocity(at), &ray, end);
                while mask != 0 {
                    let i = mask.trailing_zeros() as usize % LANES;
                    mask &= mask - 1;
                    if f64::from(nears[i]) + skipped > limit {
                        continue;
                    }
                    offered += 1;
                    limit = f(leaf.triangle[i]);
                }
                continue;
            }
            let node = &self.nodes[at];
            let left = limit - skipped - f64::from(near) + margin;
            let grown = (reach.within(left) + margin) as f32;
            let (mask, nears) = enter(node, &slabs, grown, (limit - skipped) as f32);
            if len + LANES > stack.len() {
                // Deep trees go on in memory; what was on the stack is taken later.
                spilled.extend_from_slice(&stack[..len]);
                len = 0;
            }
            if mask == 0 {
                continue;
            }
            node.stack_children(mask, &nears, &mut stack, &mut len);
        }
        offered
    }

    #[inline(always)]
    fn velocity(&self, leaf: usize) -> Option<&[Lanes; 3]> {
        self.velocities.as_ref().map(|v| &v[leaf])
    }
}

/// The children that a ray enters before a limit, one bit each, and where.
#[inline(always)]
fn enter(node: &Node, slabs: &Slabs, grown: f32, limit: f32) -> (u32, Lanes) {
    let (mut near, mut far) = ([0.0; LANES], [limit; LANES]);
    let (o, inverse) = (slabs.origin.to_array(), slabs.inverse.to_array());
    for axis in 0..3 {
        let (low, high) = (o[axis] + grown, o[axis] - grown);
        for i in 0..LANES {
            let t0 = (node.min[axis][i] - low) * inverse[axis];
            let t1 = (node.max[axis][i] - high) * inverse[axis];
            near[i] = larger(near[i], smaller(t0, t1));
            far[i] = smaller(far[i], larger(t0, t1));
        }
    }
    let mut hit = [false; LANES];
    for i in 0..LANES {
        hit[i] = near[i] <= far[i];
    }
    (bits(hit) & ((1 << node.count) - 1), near)
}
