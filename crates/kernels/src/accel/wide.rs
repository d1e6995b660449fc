//! A tree of nodes with eight boxes and leaves with eight triangles.

use super::simd::{F8, LANES, Lanes, Machine, Mask8, each_of_three};
use super::triangle::HostTriangle;
use glam::Vec3;
use obvhs::aabb::Aabb;

/// Up to this many triangles are tested without boxes.
pub(super) const MAX_WITHOUT_BOXES: usize = 64;

/// The corners of eight boxes. Missing boxes are never hit.
#[derive(Clone)]
pub(super) struct Boxes {
    pub min: [Lanes; 3],
    pub max: [Lanes; 3],
}

/// Boxes of up to eight children.
#[derive(Clone)]
pub(super) struct Node {
    pub boxes: Boxes,
    /// For each child, 2 × the index of a node, or 2 × the index of a leaf + 1.
    pub child: [u32; LANES],
    /// The number of children.
    pub count: u32,
}

#[derive(Clone)]
pub(super) struct Wide {
    pub nodes: Vec<Node>,
    pub leaves: Vec<Leaf>,
    /// The boxes of the triangles of each leaf, swept over the shutter.
    pub boxes: Vec<Boxes>,
    /// The median size of leaves; infinite if there are no nodes.
    pub grain: f32,
    /// The displacements over the shutter of the triangles of each leaf, if any triangle moves.
    pub velocities: Option<Vec<[Lanes; 3]>>,
    /// The largest distance of a corner from the origin of coordinates.
    pub extent: f64,
}

impl Boxes {
    pub const NONE: Self = Self {
        min: [[f32::INFINITY; LANES]; 3],
        max: [[f32::NEG_INFINITY; LANES]; 3],
    };

    pub fn new(triangles: &[HostTriangle], list: &[u32]) -> Self {
        let mut boxes = Self::NONE;
        for (i, &k) in list.iter().enumerate() {
            boxes.set(i, &triangles[k as usize].swept());
        }
        boxes
    }

    pub fn set(&mut self, i: usize, own: &Aabb) {
        for axis in 0..3 {
            self.min[axis][i] = own.min[axis];
            self.max[axis][i] = own.max[axis];
        }
    }

    /// Returns one of the boxes.
    pub fn one(&self, i: usize) -> Aabb {
        Aabb {
            min: self.min.map(|x| x[i]).into(),
            max: self.max.map(|x| x[i]).into(),
        }
    }

    /// Returns the box around all of them.
    pub fn around(&self) -> Aabb {
        let least = |x: [f32; LANES]| x.into_iter().fold(f32::INFINITY, f32::min);
        let most = |x: [f32; LANES]| x.into_iter().fold(f32::NEG_INFINITY, f32::max);
        Aabb {
            min: self.min.map(least).into(),
            max: self.max.map(most).into(),
        }
    }
}

impl Node {
    /// Pushes children (one bit each, at least one) on a stack with room for them: the nearest on top, the others below
    /// it in any order. It has no branches.
    #[inline(always)]
    fn stack_children(
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

/// Up to eight triangles: their planes, and in each plane the border lines as distances, positive inside.
#[derive(Clone)]
pub(super) struct Leaf {
    pub(super) normal: [Lanes; 3],
    pub(super) plane: Lanes,
    /// a → b, b → c, c → a: directions, and (in `offsets`) the constants to add.
    pub(super) lines: [[Lanes; 3]; 3],
    pub(super) offsets: [Lanes; 3],
    pub triangle: [u32; LANES],
    /// The rounding of the lines, in addition to the rounding of points.
    pub(super) slack: Lanes,
    /// The triangles that exist, one bit each.
    pub(super) used: u32,
}

/// Triangles are enlarged by this fraction of the largest coordinate near the ray.
pub const ROUNDING: f32 = 4e-7;

impl Leaf {
    pub fn new(triangles: &[HostTriangle], list: &[u32]) -> Self {
        let mut leaf = Self {
            normal: [[0.0; LANES]; 3],
            plane: [0.0; LANES],
            lines: [[[0.0; LANES]; 3]; 3],
            offsets: [[0.0; LANES]; 3],
            triangle: [u32::MAX; LANES],
            slack: [0.0; LANES],
            used: (1 << list.len()) - 1,
        };
        for (i, &k) in list.iter().enumerate() {
            let t = &triangles[k as usize];
            leaf.plane[i] = t.normal.dot(t.corners[0]) as f32;
            for (axis, lanes) in leaf.normal.iter_mut().enumerate() {
                lanes[i] = t.normal[axis] as f32;
            }
            for (line, (across, offset)) in t.lines_in_space().into_iter().enumerate() {
                leaf.offsets[line][i] = offset as f32;
                leaf.slack[i] = leaf.slack[i].max(ROUNDING * offset.abs() as f32);
                for (axis, lanes) in leaf.lines[line].iter_mut().enumerate() {
                    lanes[i] = across[axis] as f32;
                }
            }
            leaf.triangle[i] = k;
        }
        leaf
    }

    /// Returns the indices of its triangles.
    pub fn list(&self) -> &[u32] {
        &self.triangle[..self.used.count_ones() as usize]
    }

    /// Computes where a ray meets the planes of the triangles.
    #[inline(always)]
    pub fn planes<M: Machine>(
        &self,
        machine: M,
        velocity: Option<&[Lanes; 3]>,
        ray: &Ray8<M>,
    ) -> Planes8<M> {
        let load = |lanes: &Lanes| F8::load(machine, lanes);
        let origin = match velocity {
            Some(velocity) => {
                let velocity = each_of_three!(|x| load(x), velocity);
                displaced(&ray.origin, velocity, ray.less_time)
            }
            None => ray.origin,
        };
        self.meet(load, &origin, &ray.direction)
    }

    /// Computes where rays meet the planes of triangles. `of` makes numbers from lanes: those of eight triangles, or of
    /// one.
    #[inline(always)]
    pub fn meet<M: Machine>(
        &self,
        of: impl Fn(&Lanes) -> F8<M>,
        o: &[F8<M>; 3],
        d: &[F8<M>; 3],
    ) -> Planes8<M> {
        let dot = |n: &[Lanes; 3], v: &[F8<M>; 3]| {
            let [x, y, z] = n;
            of(x).mul_add(v[0], of(y).mul_add(v[1], of(z) * v[2]))
        };
        let line = |n: &[Lanes; 3], v: &[F8<M>; 3], last: &Lanes| {
            let [x, y, z] = n;
            of(x).mul_add(v[0], of(y).mul_add(v[1], of(z).mul_add(v[2], of(last))))
        };
        let cosine = dot(&self.normal, d);
        let above = of(&self.plane) - dot(&self.normal, o);
        let t = above.div(cosine);
        let p = [
            t.mul_add(d[0], o[0]),
            t.mul_add(d[1], o[1]),
            t.mul_add(d[2], o[2]),
        ];
        let [ab, bc, ca] = &self.lines;
        let [a, b, c] = &self.offsets;
        let least = line(ab, &p, a).min(line(bc, &p, b).min(line(ca, &p, c)));
        Planes8 { t, cosine, least }
    }
}

/// The places where a ray meets the planes of eight triangles.
pub(super) struct Planes8<M: Machine> {
    pub t: F8<M>,
    pub cosine: F8<M>,
    /// The distance from the nearest border, positive inside.
    pub least: F8<M>,
}

impl<M: Machine> Planes8<M> {
    /// Returns which triangles are hit between two distances. Triangles are enlarged by −`below` and by their own
    /// slack.
    #[inline(always)]
    pub fn hit(&self, below: F8<M>, slack: F8<M>, from: F8<M>, limit: F8<M>) -> Mask8<M> {
        // NaN counts as no hit, because all comparisons with it are false.
        let inside = (below - slack).less(self.least);
        inside.and(from.less(self.t)).and(self.t.less(limit))
    }
}

/// A ray, with each of its numbers in all eight lanes.
#[derive(Clone, Copy)]
pub(super) struct Ray8<M: Machine> {
    pub origin: [F8<M>; 3],
    pub direction: [F8<M>; 3],
    pub inverse: [F8<M>; 3],
    pub less_time: F8<M>,
    /// The distance at which it begins.
    pub from: F8<M>,
}

impl<M: Machine> Ray8<M> {
    #[inline(always)]
    pub fn new(machine: M, origin: Vec3, direction: Vec3, time: f32, from: f32) -> Self {
        let splat = |x| F8::splat(machine, x);
        let direction = each_of_three!(|x| splat(x), direction.to_array());
        Self {
            origin: each_of_three!(|x| splat(x), origin.to_array()),
            direction,
            inverse: each_of_three!(|d| inverse(machine, d), direction),
            less_time: splat(-time),
            from: splat(from),
        }
    }

    /// Returns its origin for boxes that are enlarged by a margin on both sides.
    #[inline(always)]
    pub fn grown(&self, machine: M, margin: f32) -> Grown<M> {
        let margin = F8::splat(machine, margin);
        let [x, y, z] = self.origin;
        Grown {
            low: [x + margin, y + margin, z + margin],
            high: [x - margin, y - margin, z - margin],
        }
    }

    /// Returns the children of a node whose enlarged boxes it enters before a limit, one bit each, and the distances.
    #[inline(always)]
    pub fn enter(&self, machine: M, node: &Node, grown: &Grown<M>, limit: f32) -> (u32, Lanes) {
        let Boxes { min, max } = &node.boxes;
        let (mut near, mut far) = (self.from, F8::splat(machine, limit));
        for axis in 0..3 {
            let t0 = (F8::load(machine, &min[axis]) - grown.low[axis]) * self.inverse[axis];
            let t1 = (F8::load(machine, &max[axis]) - grown.high[axis]) * self.inverse[axis];
            near = near.max(t0.min(t1));
            far = far.min(t0.max(t1));
        }
        let missed = far.less(near).bits();
        (!missed & ((1 << node.count) - 1), near.lanes())
    }
}

/// Returns origins of rays in the frame of triangles that are displaced with time.
#[inline(always)]
pub(super) fn displaced<M: Machine>(
    origin: &[F8<M>; 3],
    velocity: [F8<M>; 3],
    less_time: F8<M>,
) -> [F8<M>; 3] {
    let ([x, y, z], [u, v, w]) = (origin, velocity);
    [
        u.mul_add(less_time, *x),
        v.mul_add(less_time, *y),
        w.mul_add(less_time, *z),
    ]
}

/// Returns 1 over directions. It is finite, so that products with differences are not NaN.
#[inline(always)]
pub(super) fn inverse<M: Machine>(machine: M, d: F8<M>) -> F8<M> {
    let (zero, least) = (F8::splat(machine, 0.0), F8::splat(machine, 1e-12));
    let tiny = d.less(zero).select(zero - least, least);
    let d = d.abs().less(least).select(tiny, d);
    F8::splat(machine, 1.0).div(d)
}

/// A ray's origin for the lower and the upper corners of boxes.
#[derive(Clone, Copy)]
pub(super) struct Grown<M: Machine> {
    low: [F8<M>; 3],
    high: [F8<M>; 3],
}

/// The actions during the traversal of the tree by a ray, or by several rays together.
pub(super) trait Visitor {
    /// Returns the distance beyond which nothing matters.
    fn limit(&self) -> f32;

    /// Returns the children of a node that are entered before the limit, one bit each, and the distances. `near` is the
    /// distance at which the node is entered.
    fn enter(&self, node: &Node, near: f32) -> (u32, Lanes);

    /// Tests the triangles of a leaf. Returns whether the traversal continues.
    fn leaf(&mut self, index: usize) -> bool;
}

impl Wide {
    /// Visits all leaves that the visitor's rays may hit, the nearest child of a node first.
    #[inline(always)]
    pub fn traverse(&self, visitor: &mut impl Visitor) {
        let mut stack = [(0, f32::NEG_INFINITY); 64];
        let mut spilled: Vec<(u32, f32)> = Vec::new();
        let mut len = 1;
        if self.nodes.is_empty() {
            // There are few leaves; the first is on top.
            len = self.leaves.len();
            for (i, top) in stack[..len].iter_mut().enumerate() {
                top.0 = 2 * (len - 1 - i) as u32 + 1;
            }
        }
        loop {
            let (index, near) = if len > 0 {
                len -= 1;
                stack[len]
            } else if let Some(top) = spilled.pop() {
                top
            } else {
                return;
            };
            if near > visitor.limit() {
                continue;
            }
            let at = index as usize / 2;
            if index % 2 == 1 {
                if !visitor.leaf(at) {
                    return;
                }
                continue;
            }
            let node = &self.nodes[at];
            let (mask, nears) = visitor.enter(node, near);
            if mask == 0 {
                continue;
            }
            if len + LANES > stack.len() {
                // Deep trees continue in memory. The contents of the stack are processed later.
                spilled.extend_from_slice(&stack[..len]);
                len = 0;
            }
            node.stack_children(mask, &nears, &mut stack, &mut len);
        }
    }

    /// Returns the displacements of the triangles of a leaf, if any triangle moves.
    #[inline(always)]
    pub fn velocity(&self, leaf: usize) -> Option<&[Lanes; 3]> {
        self.velocities.as_ref().map(|v| &v[leaf])
    }
}
