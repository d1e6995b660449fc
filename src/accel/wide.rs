//! Nodes of eight boxes and leaves of eight triangles, met at once in f32: what may matter to a ray is
//! found with a margin for the rounding, and asked exactly afterwards.

use glam::{DVec3, Vec3};
use obvhs::bvh2::Bvh2;
use pulp::Arch;

use super::HostTriangle;

/// Boxes of a node and triangles of a leaf, at most.
pub(super) const LANES: usize = 8;

type Lanes = [f32; LANES];

/// Boxes of up to eight children.
struct Node {
    min: [Lanes; 3],
    max: [Lanes; 3],
    /// Twice the index of a node, or of a leaf plus one.
    child: [u32; LANES],
    /// How many there are.
    count: u32,
}

/// Up to eight triangles: planes, and in each plane the lines of the borders as distances, positive
/// inside.
struct Leaf {
    normal: [Lanes; 3],
    plane: Lanes,
    u: [Lanes; 3],
    v: [Lanes; 3],
    at: [Lanes; 2],
    /// b → c: across, and where.
    bc: [Lanes; 3],
    /// c → a.
    ca: [Lanes; 2],
    triangle: [u32; LANES],
    /// How many there are.
    count: u32,
}

/// The tree.
pub(super) struct Wide {
    arch: Arch,
    nodes: Vec<Node>,
    leaves: Vec<Leaf>,
    /// Displacements over the shutter of the triangles of each leaf, if any moves.
    velocities: Option<Vec<[Lanes; 3]>>,
    /// The largest distance of a corner from the origin of coordinates.
    extent: f64,
}

/// A ray in f32, from a point near the triangles.
struct Ray {
    origin: Vec3,
    direction: Vec3,
    inverse: Vec3,
    time: f32,
    /// What boxes are grown by.
    grown: f32,
    reach: f32,
    /// What coordinates are rounded by.
    rounding: f32,
    /// Hits nearer don't count.
    from: f32,
}

impl Wide {
    pub fn new(triangles: &[HostTriangle], tree: Option<&Bvh2>, extent: f64) -> Self {
        let moves = triangles.iter().any(|t| t.velocity != DVec3::ZERO);
        let mut wide = Self {
            arch: Arch::new(),
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
        let mut leaf = Leaf {
            normal: [[0.0; LANES]; 3],
            plane: [0.0; LANES],
            u: [[0.0; LANES]; 3],
            v: [[0.0; LANES]; 3],
            at: [[0.0; LANES]; 2],
            bc: [[0.0; LANES]; 3],
            ca: [[0.0; LANES]; 2],
            triangle: [u32::MAX; LANES],
            count: list.len() as u32,
        };
        let mut velocity = [[0.0; LANES]; 3];
        for (i, &k) in list.iter().enumerate() {
            let t = &triangles[k as usize];
            let (u, v) = t.axes();
            let a = t.corners[0];
            for axis in 0..3 {
                leaf.normal[axis][i] = t.normal[axis] as f32;
                leaf.u[axis][i] = u[axis] as f32;
                leaf.v[axis][i] = v[axis] as f32;
                velocity[axis][i] = t.velocity[axis] as f32;
            }
            leaf.plane[i] = t.normal.dot(a) as f32;
            leaf.at[0][i] = u.dot(a) as f32;
            leaf.at[1][i] = v.dot(a) as f32;
            let (bc, ca) = t.borders();
            for (lanes, value) in leaf.bc.iter_mut().zip(bc) {
                lanes[i] = value as f32;
            }
            for (lanes, value) in leaf.ca.iter_mut().zip(ca) {
                lanes[i] = value as f32;
            }
            leaf.triangle[i] = k;
        }
        self.leaves.push(leaf);
        if let Some(velocities) = &mut self.velocities {
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

    /// Calls a function with every triangle that a ray may meet within `reach` of it between `from`
    /// and `limit`; the function returns the limit from there on. Returns how many triangles it was
    /// called with.
    #[inline]
    pub fn visit(
        &self,
        ray: (DVec3, DVec3, f64),
        reach: f64,
        range: (f64, f64),
        f: impl FnMut(u32) -> f64,
    ) -> u32 {
        // Once a ray, with all that it does inlined: compiled for what the machine has.
        self.arch.dispatch(
            #[inline(always)]
            || self.traverse(ray, reach, range, f),
        )
    }

    #[inline(always)]
    fn traverse(
        &self,
        (origin, direction, time): (DVec3, DVec3, f64),
        reach: f64,
        (from, mut limit): (f64, f64),
        mut f: impl FnMut(u32) -> f64,
    ) -> u32 {
        // Met from a point of the ray near the triangles, since a distant origin would round by more
        // than they are large.
        let skipped = (-origin.dot(direction) - 2.0 * self.extent).max(0.0);
        let from_near = origin + direction * skipped;
        let ray = Ray {
            origin: from_near.as_vec3(),
            direction: direction.as_vec3(),
            inverse: Vec3::new(
                safe_inverse(direction.x),
                safe_inverse(direction.y),
                safe_inverse(direction.z),
            ),
            time: time as f32,
            grown: (reach + 1e-6 * self.extent) as f32,
            reach: reach as f32,
            rounding: (2e-6 * (self.extent + from_near.abs().element_sum())) as f32,
            from: (from - skipped) as f32,
        };
        let mut offered = 0;
        let mut stack = [(1u32, 0f32); 32];
        let mut spilled: Vec<(u32, f32)> = Vec::new();
        let mut len = usize::from(!self.nodes.is_empty());
        // Without boxes leaf after leaf.
        let mut leaves = if self.nodes.is_empty() {
            0..self.leaves.len() as u32
        } else {
            stack[0].0 = 0;
            0..0
        };
        loop {
            let (index, near) = if len > 0 {
                len -= 1;
                stack[len]
            } else if let Some(top) = spilled.pop() {
                top
            } else if let Some(leaf) = leaves.next() {
                (2 * leaf + 1, 0.0)
            } else {
                break;
            };
            if f64::from(near) + skipped > limit {
                continue;
            }
            let at = index as usize / 2;
            if index % 2 == 1 {
                let velocity = self.velocities.as_ref().map(|v| &v[at]);
                let leaf = &self.leaves[at];
                let mut mask = meet(leaf, velocity, &ray, (limit - skipped) as f32);
                while mask != 0 {
                    let i = mask.trailing_zeros() as usize;
                    mask &= mask - 1;
                    offered += 1;
                    limit = f(leaf.triangle[i % LANES]);
                }
                continue;
            }
            let node = &self.nodes[at];
            let (mut mask, nears) = enter(node, &ray);
            if len + LANES > stack.len() {
                // Deep trees go on in memory; what was on the stack is taken later.
                spilled.extend_from_slice(&stack[..len]);
                len = 0;
            }
            let first = len;
            while mask != 0 {
                let i = mask.trailing_zeros() as usize % LANES;
                mask &= mask - 1;
                // The nearest on top.
                let near = nears[i];
                let mut at = len;
                while at > first && stack[at - 1].1 < near {
                    stack[at] = stack[at - 1];
                    at -= 1;
                }
                stack[at] = (node.child[i], near);
                len += 1;
            }
        }
        offered
    }
}

#[inline(always)]
fn safe_inverse(d: f64) -> f32 {
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

#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn bits(of: [bool; LANES]) -> u32 {
    let mut mask = 0;
    for (i, &bit) in of.iter().enumerate() {
        mask |= u32::from(bit) << i;
    }
    mask
}

#[inline(always)]
fn enter(node: &Node, ray: &Ray) -> (u32, Lanes) {
    let (mut near, mut far) = ([0.0; LANES], [f32::INFINITY; LANES]);
    let (o, inverse) = (ray.origin.to_array(), ray.inverse.to_array());
    for axis in 0..3 {
        let (low, high) = (o[axis] + ray.grown, o[axis] - ray.grown);
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

#[inline(always)]
fn meet(leaf: &Leaf, velocity: Option<&[Lanes; 3]>, ray: &Ray, limit: f32) -> u32 {
    let d = ray.direction.to_array();
    let mut o = ray.origin.to_array().map(|x| [x; LANES]);
    if let Some(velocity) = velocity {
        for (o, v) in o.iter_mut().zip(velocity) {
            for i in 0..LANES {
                o[i] -= v[i] * ray.time;
            }
        }
    }
    let mut kept = [false; LANES];
    for i in 0..LANES {
        let n = [leaf.normal[0][i], leaf.normal[1][i], leaf.normal[2][i]];
        let cosine = n[0] * d[0] + n[1] * d[1] + n[2] * d[2];
        let inverse = 1.0 / cosine;
        let t = (leaf.plane[i] - n[0] * o[0][i] - n[1] * o[1][i] - n[2] * o[2][i]) * inverse;
        let p = [o[0][i] + t * d[0], o[1][i] + t * d[1], o[2][i] + t * d[2]];
        let x = leaf.u[0][i] * p[0] + leaf.u[1][i] * p[1] + leaf.u[2][i] * p[2] - leaf.at[0][i];
        let y = leaf.v[0][i] * p[0] + leaf.v[1][i] * p[1] + leaf.v[2][i] * p[2] - leaf.at[1][i];
        let bc = leaf.bc[0][i] * x + leaf.bc[1][i] * y + leaf.bc[2][i];
        let ca = leaf.ca[0][i] * x + leaf.ca[1][i] * y;
        let least = smaller(y, smaller(bc, ca));
        let rounding = ray.rounding * (1.0 + inverse.abs());
        // Not a number is kept: the exact test decides.
        let left_out =
            (t < ray.from - rounding) | (t > limit + rounding) | (least < -(ray.reach + rounding));
        kept[i] = !left_out;
    }
    bits(kept) & ((1 << leaf.count) - 1)
}
