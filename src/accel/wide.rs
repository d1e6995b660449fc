//! Nodes of eight boxes and leaves of eight triangles, met at once in f32: what may matter to a ray is
//! found with a margin for the rounding, and asked exactly afterwards.

use glam::{DVec3, Vec3};
use obvhs::bvh2::Bvh2;

use super::leaf::{LANES, Lanes, Leaf, Ray, bits, larger, smaller};
use super::simd::Machine;
use super::{HostTriangle, Reach};

/// Up to here triangles are asked without boxes.
pub(super) const FEW: usize = 64;

/// Boxes of up to eight children.
pub(super) struct Node {
    pub min: [Lanes; 3],
    pub max: [Lanes; 3],
    /// Twice the index of a node, or of a leaf plus one.
    pub child: [u32; LANES],
    /// How many there are.
    pub count: u32,
}

/// The tree.
pub(super) struct Wide {
    pub nodes: Vec<Node>,
    pub leaves: Vec<Leaf>,
    /// Displacements over the shutter of the triangles of each leaf, if any moves.
    pub velocities: Option<Vec<[Lanes; 3]>>,
    /// The largest distance of a corner from the origin of coordinates.
    extent: f64,
}

/// What boxes are met with.
struct Slabs {
    origin: Vec3,
    inverse: Vec3,
}

impl Wide {
    pub fn new(triangles: &[HostTriangle], tree: Option<&Bvh2>, extent: f64) -> Self {
        let moves = triangles.iter().any(|t| t.velocity != DVec3::ZERO);
        let mut wide = Self {
            nodes: Vec::new(),
            leaves: Vec::new(),
            velocities: moves.then(Vec::new),
            extent,
        };
        match tree {
            Some(tree) => {
                let mut counts = vec![0; tree.nodes.len()];
                count(tree, &mut counts);
                wide.collapse(triangles, tree, &counts, 0);
            }
            None => {
                for k in (0..triangles.len() as u32).step_by(LANES) {
                    let past = (k + LANES as u32).min(triangles.len() as u32);
                    let list: Vec<u32> = (k..past).collect();
                    wide.leaf(triangles, &list);
                }
            }
        }
        wide
    }

    fn leaf(&mut self, triangles: &[HostTriangle], list: &[u32]) -> u32 {
        self.leaves.push(Leaf::new(triangles, list));
        if let Some(velocities) = &mut self.velocities {
            let mut velocity = [[0.0; LANES]; 3];
            for (i, &k) in list.iter().enumerate() {
                for (axis, lanes) in velocity.iter_mut().enumerate() {
                    lanes[i] = triangles[k as usize].velocity[axis] as f32;
                }
            }
            velocities.push(velocity);
        }
        2 * (self.leaves.len() as u32 - 1) + 1
    }

    /// The subtree of a node of a binary tree.
    fn collapse(
        &mut self,
        triangles: &[HostTriangle],
        tree: &Bvh2,
        counts: &[u32],
        root: usize,
    ) -> u32 {
        if counts[root] <= LANES as u32 {
            let mut list = Vec::new();
            gather(tree, root, &mut list);
            return self.leaf(triangles, &list);
        }
        let mut children = vec![root];
        while children.len() < LANES {
            let area = |&i: &usize| tree.nodes[i].aabb().half_area();
            let inner = (0..children.len()).filter(|&c| {
                let i = children[c];
                // A leaf with more triangles than lanes can't be opened.
                !tree.nodes[i].is_leaf() && counts[i] > LANES as u32
            });
            let largest = inner.max_by(|&a, &b| area(&children[a]).total_cmp(&area(&children[b])));
            let Some(c) = largest else {
                break;
            };
            let first = tree.nodes[children[c]].first_index as usize;
            children[c] = first;
            children.push(first + 1);
        }
        let at = self.nodes.len();
        self.nodes.push(Node {
            min: [[0.0; LANES]; 3],
            max: [[0.0; LANES]; 3],
            child: [u32::MAX; LANES],
            count: children.len() as u32,
        });
        for (slot, child) in children.into_iter().enumerate() {
            let aabb = tree.nodes[child].aabb();
            let (min, max) = (aabb.min, aabb.max);
            let index = self.collapse(triangles, tree, counts, child);
            let node = &mut self.nodes[at];
            for axis in 0..3 {
                node.min[axis][slot] = min[axis];
                node.max[axis][slot] = max[axis];
            }
            node.child[slot] = index;
        }
        2 * at as u32
    }

    /// Calls a function with every triangle that a ray may meet within reach of it between `from`
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
            self.ask_all(machine, ray, reach, range, f)
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
            price: reach.price as f32,
            rounding: (2e-6 * size) as f32,
            from: (from - skipped) as f32,
        };
        (ray, skipped)
    }

    /// All triangles; those that may be met from near to far.
    #[inline(always)]
    fn ask_all<M: Machine>(
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
        // A loop of its own for what doesn't move, so that it isn't asked of every leaf.
        let moves = self.velocities.as_deref();
        let mut left = if moves.is_none() {
            self.meet_all(machine, |_| None, &ray, end, &mut nears)
        } else {
            let of_leaf = |i| moves.and_then(|v| v.get(i));
            self.meet_all(machine, of_leaf, &ray, end, &mut nears)
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

    /// Which triangles may be met, of all, one bit each, and from where on.
    #[inline(always)]
    fn meet_all<'a, M: Machine>(
        &self,
        machine: M,
        of_leaf: impl Fn(usize) -> Option<&'a [Lanes; 3]>,
        ray: &Ray,
        end: f32,
        nears: &mut [Lanes; FEW / LANES],
    ) -> u64 {
        let mut all = 0;
        for (slot, (leaf, nears)) in self.leaves.iter().zip(nears).enumerate() {
            let (mask, found) = leaf.meet(machine, of_leaf(slot), ray, end);
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
                let (mut mask, nears) = leaf.meet(machine, self.velocity(at), &ray, end);
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

impl Node {
    /// Puts some children (one bit each, at least one) on a stack with room for them: the nearest on top,
    /// the others below it in any order. Without jumps.
    #[inline(always)]
    pub fn stack_children(
        &self,
        mut mask: u32,
        nears: &Lanes,
        stack: &mut [(u32, f32)],
        len: &mut usize,
    ) {
        let child = |i: u32| {
            let i = i as usize % LANES;
            (self.child[i], nears[i])
        };
        let mut nearest = child(mask.trailing_zeros());
        mask &= mask - 1;
        while mask != 0 {
            let other = child(mask.trailing_zeros());
            mask &= mask - 1;
            let less = other.1 < nearest.1;
            stack[*len] = if less { nearest } else { other };
            nearest = if less { other } else { nearest };
            *len += 1;
        }
        stack[*len] = nearest;
        *len += 1;
    }
}

#[inline(always)]
pub(super) fn safe_inverse(d: f64) -> f32 {
    let d = if d.abs() < 1e-12 {
        1e-12f64.copysign(d)
    } else {
        d
    };
    1.0 / d as f32
}

/// Triangles under each node.
fn count(tree: &Bvh2, counts: &mut [u32]) {
    // Children come after their parents or not: by hand, from a stack.
    let mut stack = vec![(0usize, false)];
    while let Some((i, ready)) = stack.pop() {
        let node = &tree.nodes[i];
        if node.is_leaf() {
            counts[i] = node.prim_count;
            continue;
        }
        let first = node.first_index as usize;
        if ready {
            counts[i] = counts[first] + counts[first + 1];
        } else {
            stack.extend([(i, true), (first, false), (first + 1, false)]);
        }
    }
}

/// The triangles under a node.
fn gather(tree: &Bvh2, root: usize, list: &mut Vec<u32>) {
    let node = &tree.nodes[root];
    let first = node.first_index as usize;
    if node.is_leaf() {
        list.extend(&tree.primitive_indices[first..first + node.prim_count as usize]);
    } else {
        gather(tree, first, list);
        gather(tree, first + 1, list);
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
