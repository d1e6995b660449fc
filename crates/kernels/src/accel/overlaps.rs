//! Pairs of triangles whose boxes overlap.

use glam::Vec3;
use obvhs::aabb::Aabb;
use pulp::Arch;

use super::hierarchy::Hierarchy;
use super::simd::{F8, LANES, Machine, Task, dispatch};
use super::triangle::HostTriangle;
use super::wide::{Boxes, Leaf, Node, Wide};

/// The tree whose boxes are compared, and its triangles.
pub struct Overlaps<'a> {
    arch: Arch,
    wide: &'a Wide,
    triangles: &'a [HostTriangle],
    /// For each node, one more than the largest index of a leaf below it, and of those with a triangle that moved.
    past: Vec<[u32; 2]>,
    /// Whether each leaf has a triangle that moved, and whether each triangle did.
    fresh: Vec<bool>,
    moved: Option<&'a [bool]>,
}

/// A corner counts as on a plane if its distance is less than this, times the coordinates. It is smaller than
/// [`TOUCHING`](crate::model::edge::TOUCHING) by more than the rounding of both.
const ON_PLANE: f32 = 2e-6;

/// Returns which of eight triangles at rest have a plane that another triangle passes through, one bit each.
#[inline(always)]
fn pass<M: Machine>(machine: M, leaf: &Leaf, corners: [Vec3; 3]) -> u32 {
    let [a, b, c] = corners;
    let size = a.abs().max(b.abs()).max(c.abs()).max_element();
    let margin = ON_PLANE * size.max(0.1);
    let [x, y, z] = &leaf.normal;
    let x = F8::load(machine, x);
    let y = F8::load(machine, y);
    let z = F8::load(machine, z);
    let plane = F8::load(machine, &leaf.plane);
    let mut low = F8::splat(machine, f32::INFINITY);
    let mut high = F8::splat(machine, f32::NEG_INFINITY);
    for corner in corners {
        let last = z * F8::splat(machine, corner.z) - plane;
        let last = y.mul_add(F8::splat(machine, corner.y), last);
        let above = x.mul_add(F8::splat(machine, corner.x), last);
        low = low.min(above);
        high = high.max(above);
    }
    let below = low.less(F8::splat(machine, -margin));
    below.and(F8::splat(machine, margin).less(high)).bits()
}

/// Returns which of eight boxes overlap a given box, one bit each.
#[inline(always)]
fn overlap<M: Machine>(machine: M, Boxes { min, max }: &Boxes, one: &Aabb) -> u32 {
    let apart = |axis: usize| {
        let below = F8::splat(machine, one.max[axis]).less(F8::load(machine, &min[axis]));
        let above = F8::load(machine, &max[axis]).less(F8::splat(machine, one.min[axis]));
        below.or(above)
    };
    apart(0).or(apart(1)).or(apart(2)).not().bits() & 0xff
}

impl<'a> Overlaps<'a> {
    /// With a list of which triangles `moved`, only pairs with such a triangle are found.
    pub fn new(hierarchy: &'a Hierarchy, moved: Option<&'a [bool]>) -> Self {
        let wide = &hierarchy.wide;
        let is_fresh =
            |leaf: &Leaf| moved.is_none_or(|moved| leaf.list().iter().any(|&k| moved[k as usize]));
        let fresh: Vec<bool> = wide.leaves.iter().map(is_fresh).collect();
        let mut past = vec![[0; 2]; wide.nodes.len()];
        // Children come after their parents.
        for (at, node) in wide.nodes.iter().enumerate().rev() {
            for &child in &node.child[..node.count as usize] {
                let index = child as usize / 2;
                let of_child = match child % 2 {
                    1 => [
                        index as u32 + 1,
                        if fresh[index] { index as u32 + 1 } else { 0 },
                    ],
                    _ => past[index],
                };
                for (all, own) in past[at].iter_mut().zip(of_child) {
                    *all = own.max(*all);
                }
            }
        }
        Self {
            arch: Arch::new(),
            wide,
            triangles: &hierarchy.triangles,
            past,
            fresh,
            moved,
        }
    }

    /// Returns whether pairs of triangles of two leaves are searched for.
    fn compares(&self, leaf: usize, other: usize) -> bool {
        self.fresh[leaf] || self.fresh[other]
    }

    pub fn leaves(&self) -> usize {
        self.wide.leaves.len()
    }

    /// Adds the pairs of a triangle of a leaf and a triangle of the same or a later leaf, the smaller index first. Each
    /// leaf and each pair takes one from the budget `left`. Returns false if the budget did not suffice. If nothing
    /// moves, pairs that lie no more than [`ON_PLANE`] on both sides of one of their planes may be left out.
    pub fn add_pairs(&self, leaf: usize, left: &mut usize, pairs: &mut Vec<[u32; 2]>) -> bool {
        dispatch(
            self.arch,
            AddPairs {
                overlaps: self,
                leaf,
                left,
                pairs,
            },
        )
    }
}

/// [`Overlaps::add_pairs`] as a task.
struct AddPairs<'a> {
    overlaps: &'a Overlaps<'a>,
    leaf: usize,
    left: &'a mut usize,
    pairs: &'a mut Vec<[u32; 2]>,
}

impl Task for AddPairs<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<M: Machine>(mut self, machine: M) -> bool {
        let wide = self.overlaps.wide;
        let mut corners = [[Vec3::ZERO; 3]; LANES];
        if wide.velocities.is_none() {
            for (i, &k) in wide.leaves[self.leaf].list().iter().enumerate() {
                let [a, b, c] = &self.overlaps.triangles[k as usize].corners;
                corners[i] = [a.as_vec3(), b.as_vec3(), c.as_vec3()];
            }
        }
        if wide.nodes.is_empty() {
            let mut other = self.leaf;
            while other < wide.leaves.len() {
                if self.overlaps.compares(self.leaf, other)
                    && !self.add(machine, other, &wide.boxes[other].around(), &corners)
                {
                    return false;
                }
                other += 1;
            }
            return true;
        }
        let around = wide.boxes[self.leaf].around();
        let only_fresh = usize::from(!self.overlaps.fresh[self.leaf]);
        let mut open = Vec::with_capacity(64);
        open.push(0u32);
        while let Some(at) = open.pop() {
            let node: &Node = &wide.nodes[at as usize / 2];
            let mut met = overlap(machine, &node.boxes, &around) & ((1 << node.count) - 1);
            while met != 0 {
                let slot = met.trailing_zeros() as usize;
                met &= met - 1;
                let child = node.child[slot];
                let other = child as usize / 2;
                if child.is_multiple_of(2) {
                    if self.overlaps.past[other][only_fresh] as usize > self.leaf {
                        open.push(child);
                    }
                } else if other >= self.leaf
                    && self.overlaps.compares(self.leaf, other)
                    && !self.add(machine, other, &node.boxes.one(slot), &corners)
                {
                    return false;
                }
            }
        }
        true
    }
}

impl AddPairs<'_> {
    /// Adds the pairs with triangles of another leaf, which lie in the box `around`, or the pairs within this leaf,
    /// whose triangles at rest have these `corners`.
    #[inline(always)]
    fn add<M: Machine>(
        &mut self,
        machine: M,
        other: usize,
        around: &Aabb,
        corners: &[[Vec3; 3]; LANES],
    ) -> bool {
        if *self.left == 0 {
            return false;
        }
        *self.left -= 1;
        let (own, boxes) = (
            &self.overlaps.wide.boxes[self.leaf],
            &self.overlaps.wide.boxes[other],
        );
        let (list, others) = (
            &self.overlaps.wide.leaves[self.leaf],
            &self.overlaps.wide.leaves[other],
        );
        let mut near = overlap(machine, own, around) & list.used;
        while near != 0 {
            let i = near.trailing_zeros() as usize;
            near &= near - 1;
            let mut met = overlap(machine, boxes, &own.one(i));
            if other == self.leaf {
                met &= !((2 << i) - 1);
            }
            if met != 0 && self.overlaps.wide.velocities.is_none() {
                met &= pass(machine, others, corners[i]);
            }
            while met != 0 {
                let (k, l) = (
                    list.triangle[i],
                    others.triangle[met.trailing_zeros() as usize],
                );
                met &= met - 1;
                if self
                    .overlaps
                    .moved
                    .is_some_and(|moved| !moved[k as usize] && !moved[l as usize])
                {
                    continue;
                }
                if *self.left == 0 {
                    return false;
                }
                *self.left -= 1;
                self.pairs.push([k.min(l), k.max(l)]);
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    /// The pairs of a tree's leaves are the pairs of all overlapping boxes, each once. Triangles at rest that do not
    /// pass through each other may be missing. An exhausted budget is reported.
    #[test]
    fn pairs_are_those_of_all_boxes() {
        let mut seed = 1u32;
        let mut random = || {
            seed = seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            f64::from(seed >> 8) / f64::from(1 << 24)
        };
        for (count, speed) in [(40, 0.1), (500, 0.1), (500, 0.0)] {
            let mut vector = |size: f64| (DVec3::new(random(), random(), random()) - 0.5) * size;
            let triangle = |_| {
                let place = vector(2.0);
                let corners = [0; 3].map(|_| place + vector(0.5));
                HostTriangle::new(corners, vector(speed), true)
            };
            let hierarchy = Hierarchy::new((0..count).map(triangle).collect(), None);
            let overlaps = Overlaps::new(&hierarchy, None);
            let of_all = |overlaps: &Overlaps| {
                let (mut found, mut left) = (Vec::new(), 1 << 20);
                for leaf in 0..overlaps.leaves() {
                    assert!(overlaps.add_pairs(leaf, &mut left, &mut found));
                }
                found
            };
            let mut found = of_all(&overlaps);
            // With few that moved, those pairs that have one of them.
            let moved: Vec<bool> = (0..count).map(|k| k % 31 == 5).collect();
            let of_moved = of_all(&Overlaps::new(&hierarchy, Some(&moved)));
            let is_of_moved = |pair: &&[u32; 2]| pair.iter().any(|&k| moved[k as usize]);
            let sorted = |mut pairs: Vec<[u32; 2]>| {
                pairs.sort_unstable();
                pairs
            };
            let wanted = found.iter().filter(is_of_moved).copied().collect();
            assert_eq!(sorted(of_moved), sorted(wanted));
            let passes = |plane: &HostTriangle, other: &HostTriangle| {
                let above = |c: DVec3| plane.normal.dot(c - plane.corners[0]) > 0.0;
                let above = other.corners.map(above);
                above.contains(&true) && above.contains(&false)
            };
            let all = &hierarchy.triangles;
            let (mut of_boxes, mut passing) = (Vec::new(), Vec::new());
            for (k, t) in all.iter().enumerate() {
                for (l, s) in all.iter().enumerate().skip(k + 1) {
                    let (a, b) = (t.swept(), s.swept());
                    if a.min.cmple(b.max).all() && b.min.cmple(a.max).all() {
                        of_boxes.push([k as u32, l as u32]);
                        if passes(t, s) && passes(s, t) {
                            passing.push([k as u32, l as u32]);
                        }
                    }
                }
            }
            found.sort_unstable();
            if speed > 0.0 {
                assert!(found == of_boxes, "{} of {}", found.len(), of_boxes.len());
            }
            assert!(found.windows(2).all(|pair| pair[0] != pair[1]));
            assert!(found.iter().all(|pair| of_boxes.contains(pair)));
            assert!(passing.iter().all(|pair| found.contains(pair)));
            let mut few = 3;
            let mut some = Vec::new();
            let mut leaves = 0..overlaps.leaves();
            assert!(!leaves.all(|leaf| overlaps.add_pairs(leaf, &mut few, &mut some)));
        }
    }
}
