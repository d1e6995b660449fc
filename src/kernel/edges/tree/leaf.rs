//! Finds an edge at random, in proportion to what it may contribute seen from a point.

use rayon::prelude::*;

use super::edges::{Edge, Kind};
use crate::accel::{F8, LANES, Lanes, Machine, Mask8, Task, dispatch};
use crate::model::V3;

/// From where, in which cone of directions, and for what an edge is looked for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Query {
    pub x: V3,
    pub time: f32,
    pub axis: V3,
    /// Cosine and sine of the half-angle of the cone, at most 90°.
    pub cos: f32,
    pub sin: f32,
    /// What is looked for counts as cosⁿ of the angle to the axis, about.
    pub exponent: f32,
    /// Whether only edges count at which it jumps whether light passes.
    pub shadows: bool,
}

/// Eight edges.
struct Leaf {
    middle: [Lanes; 3],
    along: [Lanes; 3],
    /// Normals of both faces.
    normal: [[Lanes; 3]; 2],
    velocity: Option<[Lanes; 3]>,
    half: Lanes,
    /// 1 where it always jumps: what is seen, and whether light passes.
    seen_always: Lanes,
    passes_always: Lanes,
    /// Of folds.
    fold: Lanes,
    crease: Lanes,
    closed: Lanes,
    edge: [u32; LANES],
}

/// Bounds of up to eight subtrees.
struct Node {
    centre: [Lanes; 3],
    radius: Lanes,
    /// A cone of the normals of folds.
    axis: [Lanes; 3],
    cos: Lanes,
    sin: Lanes,
    /// Lengths, times how much jumps at each edge: always, of what is seen and of what passes; where a
    /// fold is a silhouette, times the angle of the fold; at creases.
    seen_always: Lanes,
    passes_always: Lanes,
    fold: Lanes,
    crease: Lanes,
    /// 1 where all folds are of closed objects.
    closed: Lanes,
    /// Twice the index of a node, or of a leaf plus one.
    child: [u32; LANES],
}

/// Up to so many edges each is asked.
const FEW: usize = 64;
/// From so many on subtrees are built on several threads.
const MANY: usize = 2048;

pub(super) struct EdgeTree {
    nodes: Vec<Node>,
    leaves: Vec<Leaf>,
}

impl EdgeTree {
    const EMPTY: Self = Self {
        nodes: Vec::new(),
        leaves: Vec::new(),
    };

    /// Over some of a list of edges.
    pub fn new(
        edges: &[Edge],
        normals: &(impl Fn(u32) -> V3 + Sync),
        velocities: Option<&[V3]>,
        mut which: Vec<u32>,
    ) -> Self {
        let maker = Maker {
            edges,
            normals,
            velocities,
        };
        if which.len() > FEW {
            return Self::of_many(&maker, &mut which);
        }
        let leaves = which.chunks(LANES).map(|list| maker.leaf(list));
        Self {
            leaves: leaves.collect(),
            ..Self::EMPTY
        }
    }

    /// Subtrees of many edges on several threads, put together.
    fn of_many<F: Fn(u32) -> V3 + Sync>(maker: &Maker<F>, which: &mut [u32]) -> Self {
        let mut tree = Self::EMPTY;
        if which.len() < MANY {
            tree.build(maker, which);
            return tree;
        }
        let parts = maker.parts(which).into_par_iter();
        let parts: Vec<(Bounds, Self)> = parts
            .map(|part| (maker.bounds(part), Self::of_many(maker, part)))
            .collect();
        tree.nodes.push(Node::empty());
        for (slot, (bounds, mut part)) in parts.into_iter().enumerate() {
            // A child is twice an index, plus one for leaves.
            let first = [2 * tree.nodes.len() as u32, 2 * tree.leaves.len() as u32];
            for node in &mut part.nodes {
                for child in node.child.iter_mut().filter(|c| **c != u32::MAX) {
                    *child += first[*child as usize % 2];
                }
            }
            tree.nodes[0].set(slot, &bounds, first[0]);
            tree.nodes.append(&mut part.nodes);
            tree.leaves.append(&mut part.leaves);
        }
        tree
    }

    pub fn is_empty(&self) -> bool {
        self.leaves.is_empty()
    }

    fn build<F: Fn(u32) -> V3>(&mut self, maker: &Maker<F>, which: &mut [u32]) -> u32 {
        if which.len() <= LANES {
            self.leaves.push(maker.leaf(which));
            return 2 * (self.leaves.len() as u32 - 1) + 1;
        }
        let at = self.nodes.len();
        self.nodes.push(Node::empty());
        for (slot, part) in maker.parts(which).into_iter().enumerate() {
            let bounds = maker.bounds(part);
            let child = self.build(maker, part);
            self.nodes[at].set(slot, &bounds, child);
        }
        2 * at as u32
    }

    /// An edge, drawn in proportion to its weight, and one over its probability. None where there is none.
    ///
    /// Subtrees that are near or lie in the cone in part are entered, all of them; of those that are far
    /// and lie in it whole one is taken at random. Of all edges that are met one stays, so that no list is
    /// kept.
    pub fn sample(&self, arch: pulp::Arch, query: &Query, u: f32) -> Option<(u32, f32)> {
        dispatch(
            arch,
            Sample {
                tree: self,
                query,
                u,
            },
        )
    }

    #[inline(always)]
    fn draw<M: Machine>(&self, machine: M, query: &Query, u: f32) -> Option<(u32, f32)> {
        let query = &Query8::new(machine, query);
        let mut random = Uniform(u);
        let mut kept = Kept {
            total: 0.0,
            leaf: 0,
            weights: [0.0; LANES],
        };
        if self.nodes.is_empty() {
            for (i, leaf) in self.leaves.iter().enumerate() {
                kept.offer(i, leaf.weights(machine, query), 1.0, &mut random);
            }
        } else {
            let mut stack = [(0u32, 1.0f32); 64];
            let mut len = 1;
            let mut budget = BUDGET[usize::from(query.is_of_light)];
            while len > 0 {
                len -= 1;
                let (at, inverse) = stack[len];
                let index = at as usize / 2;
                if at % 2 == 1 {
                    let weights = self.leaves[index].weights(machine, query);
                    kept.offer(index, weights, inverse, &mut random);
                    continue;
                }
                let node = &self.nodes[index];
                let (weights, enter) = node.weights(machine, query);
                budget = budget.saturating_sub(1);
                let all = budget > 0 && len + LANES <= stack.len();
                let mut far = 0.0;
                let mut taken = None;
                #[allow(clippy::needless_range_loop)] // an iterator is not compiled for the machine
                for i in 0..LANES {
                    if weights[i] <= 0.0 {
                        continue;
                    }
                    if all && enter & (1 << i) != 0 {
                        stack[len] = (node.child[i], inverse);
                        len += 1;
                    } else {
                        far += weights[i];
                        if random.decide(weights[i] / far) {
                            taken = Some(i);
                        }
                    }
                }
                if let Some(i) = taken {
                    stack[len] = (node.child[i], inverse * far / weights[i]);
                    len += 1;
                }
            }
        }
        kept.take(&self.leaves, &mut random)
    }
}

/// [`EdgeTree::sample`] as a task.
struct Sample<'a> {
    tree: &'a EdgeTree,
    query: &'a Query,
    u: f32,
}

impl Task for Sample<'_> {
    type Output = Option<(u32, f32)>;

    #[inline(always)]
    fn run<M: Machine>(self, machine: M) -> Self::Output {
        self.tree.draw(machine, self.query, self.u)
    }
}

/// Nodes whose children are all entered, at most, and subtrees that are: those seen under a larger angle
/// (its sine). A light fills a narrow cone, in which few edges lie: they are looked at closely.
const BUDGET: [u32; 2] = [64, 1024];
const LARGE: [f32; 2] = [0.25, 0.015];

/// A uniform number that decides several times: what is left of it after a decision is uniform again.
struct Uniform(f32);

impl Uniform {
    /// Whether something happens that has a probability.
    #[inline(always)]
    fn decide(&mut self, chance: f32) -> bool {
        let happens = self.0 < chance;
        let (from, to) = if happens {
            (0.0, chance)
        } else {
            (chance, 1.0)
        };
        self.0 = ((self.0 - from) / (to - from)).clamp(0.0, 1.0 - f32::EPSILON);
        happens
    }
}

/// The leaf that stays, of all that were met so far.
struct Kept {
    total: f32,
    leaf: usize,
    weights: Lanes,
}

impl Kept {
    /// A leaf that was met with a probability.
    #[inline(always)]
    fn offer<M: Machine>(
        &mut self,
        leaf: usize,
        weights: F8<M>,
        inverse: f32,
        random: &mut Uniform,
    ) {
        let sum = weights.sum();
        if sum <= 0.0 {
            return;
        }
        let share = sum * inverse;
        self.total += share;
        if random.decide(share / self.total) {
            self.leaf = leaf;
            self.weights = weights.lanes();
        }
    }

    #[inline(always)]
    fn take(self, leaves: &[Leaf], random: &mut Uniform) -> Option<(u32, f32)> {
        if !(self.total > 0.0 && self.total.is_finite()) {
            return None;
        }
        let sum: f32 = self.weights.iter().sum();
        let target = random.0 * sum;
        let (mut passed, mut found) = (0.0, None);
        for (i, &w) in self.weights.iter().enumerate() {
            if w > 0.0 {
                found = Some((leaves[self.leaf].edge[i], self.total / w));
                passed += w;
                if target < passed {
                    break;
                }
            }
        }
        found
    }
}

/// What bounds some edges.
struct Bounds {
    centre: V3,
    radius: f32,
    axis: V3,
    cos: f32,
    seen_always: f32,
    passes_always: f32,
    fold: f32,
    crease: f32,
    closed: bool,
}

/// What a tree is made from.
struct Maker<'a, F> {
    edges: &'a [Edge],
    /// The normal of a triangle.
    normals: &'a F,
    velocities: Option<&'a [V3]>,
}

impl<F: Fn(u32) -> V3> Maker<'_, F> {
    fn velocity(&self, e: &Edge) -> V3 {
        self.velocities.map_or(V3::ZERO, |v| v[e.object as usize])
    }

    fn leaf(&self, list: &[u32]) -> Leaf {
        let zero = [0.0; LANES];
        let mut leaf = Leaf {
            middle: [zero; 3],
            along: [zero; 3],
            normal: [[zero; 3]; 2],
            velocity: self.velocities.map(|_| [zero; 3]),
            half: zero,
            seen_always: zero,
            passes_always: zero,
            fold: zero,
            crease: zero,
            closed: zero,
            edge: [u32::MAX; LANES],
        };
        for (i, &index) in list.iter().enumerate() {
            let e = &self.edges[index as usize];
            let middle = e.a + e.along * 0.5;
            let put = |to: &mut [Lanes; 3], v: V3| {
                for (lanes, x) in to.iter_mut().zip(v.to_array()) {
                    lanes[i] = x;
                }
            };
            put(&mut leaf.middle, middle);
            put(&mut leaf.along, e.along);
            for side in 0..2 {
                let face = if e.faces[side] == u32::MAX {
                    e.faces[0]
                } else {
                    e.faces[side]
                };
                put(&mut leaf.normal[side], (self.normals)(face));
            }
            if let Some(velocity) = &mut leaf.velocity {
                put(velocity, self.velocity(e));
            }
            leaf.half[i] = 0.5 * e.along.length();
            match e.kind {
                Kind::Fold => {
                    leaf.fold[i] = 1.0;
                    leaf.crease[i] = e.crease;
                }
                Kind::Border => {
                    leaf.seen_always[i] = 1.0;
                    leaf.passes_always[i] = 1.0;
                }
                Kind::Crossing => leaf.seen_always[i] = 1.0,
            }
            leaf.closed[i] = f32::from(u8::from(e.closed));
            leaf.edge[i] = index;
        }
        leaf
    }

    /// Up to eight parts, each of edges that are near to each other.
    fn parts<'a>(&self, which: &'a mut [u32]) -> Vec<&'a mut [u32]> {
        let mut parts = vec![which];
        while parts.len() < LANES {
            let largest = (0..parts.len())
                .max_by_key(|&i| parts[i].len())
                .unwrap_or(0);
            if parts[largest].len() < 2 {
                break;
            }
            let part = parts.swap_remove(largest);
            let (left, right) = self.split(part);
            parts.push(left);
            parts.push(right);
        }
        parts
    }

    fn middle(&self, index: u32) -> V3 {
        let e = &self.edges[index as usize];
        e.a + e.along * 0.5
    }

    fn split<'a>(&self, part: &'a mut [u32]) -> (&'a mut [u32], &'a mut [u32]) {
        let (mut low, mut high) = (V3::ONE * f32::MAX, V3::ONE * f32::MIN);
        for &i in part.iter() {
            let m = self.middle(i);
            low = V3 {
                x: low.x.min(m.x),
                y: low.y.min(m.y),
                z: low.z.min(m.z),
            };
            high = V3 {
                x: high.x.max(m.x),
                y: high.y.max(m.y),
                z: high.z.max(m.z),
            };
        }
        let size = (high - low).to_array();
        let axis = (0..3)
            .max_by(|&a, &b| size[a].total_cmp(&size[b]))
            .unwrap_or(0);
        let half = part.len() / 2;
        part.select_nth_unstable_by(half, |&a, &b| {
            let (p, q) = (self.middle(a).to_array(), self.middle(b).to_array());
            p[axis].total_cmp(&q[axis]).then(a.cmp(&b))
        });
        part.split_at_mut(half)
    }

    fn bounds(&self, list: &[u32]) -> Bounds {
        let edges = || list.iter().map(|&i| &self.edges[i as usize]);
        let (mut low, mut high) = (V3::ONE * f32::MAX, V3::ONE * f32::MIN);
        let mut sum = V3::ZERO;
        let (mut seen_always, mut passes_always, mut fold, mut crease) = (0.0, 0.0, 0.0, 0.0);
        let mut closed = true;
        for e in edges() {
            let v = self.velocity(e);
            for p in [e.a, e.a + e.along, e.a + v, e.a + e.along + v] {
                low = V3 {
                    x: low.x.min(p.x),
                    y: low.y.min(p.y),
                    z: low.z.min(p.z),
                };
                high = V3 {
                    x: high.x.max(p.x),
                    y: high.y.max(p.y),
                    z: high.z.max(p.z),
                };
            }
            let length = e.along.length();
            match e.kind {
                Kind::Fold => {
                    let (n, m) = ((self.normals)(e.faces[0]), (self.normals)(e.faces[1]));
                    sum += n + m;
                    fold += length * (n - m).length();
                    crease += length * e.crease;
                    closed &= e.closed;
                }
                Kind::Border => {
                    seen_always += length;
                    passes_always += length;
                }
                Kind::Crossing => seen_always += length,
            }
        }
        let centre = (low + high) * 0.5;
        let axis = if sum.length() > 0.0 {
            sum.normalized()
        } else {
            V3 {
                x: 0.0,
                y: 0.0,
                z: 1.0,
            }
        };
        let mut cos: f32 = 1.0;
        for e in edges().filter(|e| e.kind == Kind::Fold) {
            for &face in &e.faces[..2] {
                cos = cos.min((self.normals)(face).dot(axis));
            }
        }
        Bounds {
            centre,
            radius: (high - low).length() * 0.5 * (1.0 + 1e-5),
            axis,
            cos,
            seen_always,
            passes_always,
            fold,
            crease,
            closed,
        }
    }
}

impl Node {
    fn empty() -> Self {
        let zero = [0.0; LANES];
        Self {
            centre: [zero; 3],
            radius: zero,
            axis: [zero; 3],
            cos: zero,
            sin: zero,
            seen_always: zero,
            passes_always: zero,
            fold: zero,
            crease: zero,
            closed: zero,
            child: [u32::MAX; LANES],
        }
    }

    fn set(&mut self, i: usize, b: &Bounds, child: u32) {
        for (to, x) in self.centre.iter_mut().zip(b.centre.to_array()) {
            to[i] = x;
        }
        for (to, x) in self.axis.iter_mut().zip(b.axis.to_array()) {
            to[i] = x;
        }
        self.radius[i] = b.radius;
        // With a margin for rounding.
        let cos = b.cos - 1e-5;
        self.cos[i] = cos;
        self.sin[i] = (1.0 - cos * cos).max(0.0).sqrt();
        self.seen_always[i] = b.seen_always;
        self.passes_always[i] = b.passes_always;
        self.fold[i] = b.fold;
        self.crease[i] = b.crease;
        self.closed[i] = f32::from(u8::from(b.closed));
        self.child[i] = child;
    }

    /// How much the subtrees may contribute, about; 0 only if they can't. And which are to be entered, one
    /// bit each.
    #[inline(always)]
    fn weights<M: Machine>(&self, machine: M, q: &Query8<M>) -> (Lanes, u32) {
        let load = |lanes: &Lanes| F8::load(machine, lanes);
        let number = |x: f32| F8::splat(machine, x);
        let (zero, one) = (number(0.0), number(1.0));
        let r = q.to(&self.centre);
        let radius = load(&self.radius);
        let squared = dot(r, r);
        let distance = squared.sqrt();
        let along = dot(r, q.axis);
        let across = (squared - along * along).max(zero).sqrt();
        let beside = across * q.cos - along * q.sin;
        let missed = radius.less(beside);
        // The angle under which the sphere is seen.
        let sin_seen = radius.div(distance.max(number(1e-20))).min(one);
        let cos_seen = (one - sin_seen * sin_seen).max(zero).sqrt();
        let (sin, cos) = (load(&self.sin), load(&self.cos));
        let sin_sum = sin * cos_seen + cos * sin_seen;
        let cos_sum = cos * cos_seen - sin * sin_seen;
        let axis = [
            load(&self.axis[0]),
            load(&self.axis[1]),
            load(&self.axis[2]),
        ];
        let facing = dot(axis, r).div(distance.max(number(1e-20)));
        // Where normals and directions spread over more than a half-space anything is possible.
        let narrow = zero.less(cos_sum).and(distance.less(radius).not());
        let no_silhouette = narrow.and(sin_sum.less(facing.abs()));
        let fold = load(&self.fold).div(sin_sum.abs() + number(0.05));
        let fold = no_silhouette.select(zero, fold);
        let hidden = narrow
            .and(sin_sum.less(facing))
            .and(zero.less(load(&self.closed)));
        let crease = hidden.select(zero, load(&self.crease) * q.creases);
        let always = q
            .shadows
            .select(load(&self.passes_always), load(&self.seen_always));
        let nearest = (along + radius).div(distance + radius).max(zero).min(one);
        let weight = (always + fold + crease) * q.lobe(nearest);
        let weight = weight.div(squared + radius * radius);
        let weight = missed.select(zero, weight);
        let whole = (beside + radius)
            .less(zero)
            .and(sin_seen.less(number(LARGE[usize::from(q.is_of_light)])));
        (weight.lanes(), !whole.bits())
    }
}

/// A query, each of its numbers eight times.
struct Query8<M: Machine> {
    machine: M,
    x: [F8<M>; 3],
    time: f32,
    axis: [F8<M>; 3],
    cos: F8<M>,
    sin: F8<M>,
    exponent: f32,
    narrow: bool,
    /// 1 where creases count.
    creases: F8<M>,
    /// Whether it is asked for what passes.
    shadows: Mask8<M>,
    is_of_light: bool,
}

impl<M: Machine> Query8<M> {
    #[inline(always)]
    fn new(machine: M, q: &Query) -> Self {
        let splat = |x| F8::splat(machine, x);
        let creases = splat(if q.shadows { 0.0 } else { 1.0 });
        Self {
            machine,
            x: q.x.to_array().map(splat),
            time: q.time,
            axis: q.axis.to_array().map(splat),
            cos: splat(q.cos),
            sin: splat(q.sin),
            exponent: q.exponent,
            narrow: q.cos > 0.0,
            creases,
            shadows: creases.less(splat(0.5)),
            is_of_light: q.shadows,
        }
    }

    /// From where it is looked to points.
    #[inline(always)]
    fn to(&self, points: &[Lanes; 3]) -> [F8<M>; 3] {
        let [x, y, z] = points;
        [
            F8::load(self.machine, x) - self.x[0],
            F8::load(self.machine, y) - self.x[1],
            F8::load(self.machine, z) - self.x[2],
        ]
    }

    /// About cosⁿ of the angle to the axis.
    #[inline(always)]
    fn lobe(&self, cosine: F8<M>) -> F8<M> {
        let number = |x: f32| F8::splat(self.machine, x);
        if self.exponent == 0.0 {
            return number(1.0);
        }
        let sharp = number((self.exponent - 1.0).max(0.0));
        let s = (number(1.0) - cosine).mul_add(sharp, number(1.0));
        (cosine + number(1e-3)).div(s * s)
    }
}

#[inline(always)]
fn dot<M: Machine>(a: [F8<M>; 3], b: [F8<M>; 3]) -> F8<M> {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
}

#[inline(always)]
fn cross<M: Machine>(a: [F8<M>; 3], b: [F8<M>; 3]) -> [F8<M>; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

impl Leaf {
    /// How much the edges may contribute, about; 0 only if they can't.
    #[inline(always)]
    fn weights<M: Machine>(&self, machine: M, q: &Query8<M>) -> F8<M> {
        let load = |lanes: &Lanes| F8::load(machine, lanes);
        let number = |x: f32| F8::splat(machine, x);
        let zero = number(0.0);
        let tiny = number(1e-30);
        let mut r = q.to(&self.middle);
        if let Some(velocity) = &self.velocity {
            let time = number(q.time);
            for (r, v) in r.iter_mut().zip(velocity) {
                *r = load(v).mul_add(time, *r);
            }
        }
        let e = [
            load(&self.along[0]),
            load(&self.along[1]),
            load(&self.along[2]),
        ];
        let half = load(&self.half);
        let length = (half + half).max(tiny);
        // How far the point lies above both faces: r leads from it to the edge's middle, which lies in
        // both.
        let above = |n: &[Lanes; 3]| zero - dot([load(&n[0]), load(&n[1]), load(&n[2])], r);
        let (front, back) = (above(&self.normal[0]), above(&self.normal[1]));
        let silhouette = (front * back).less(zero);
        let hidden = zero
            .less(load(&self.closed))
            .and(zero.less(front).not())
            .and(zero.less(back).not());
        let crease = hidden.select(zero, load(&self.crease) * q.creases);
        let fold = silhouette.select(load(&self.fold), crease);
        // Edges of a plane that the point lies in are seen from the side alone.
        let away = r[0].abs() + r[1].abs() + r[2].abs() + half;
        let in_plane = front.abs().min(back.abs()).less(away * number(1e-6));
        let fold = in_plane.select(zero, fold);
        let always = q
            .shadows
            .select(load(&self.passes_always), load(&self.seen_always));
        let jump = always + fold;
        let c = cross(e, r);
        // |e| times the distance from the edge's line, and the distance from the edge.
        let swept = dot(c, c).sqrt();
        let line = swept.div(length);
        let beyond = (dot(e, r).abs().div(length) - half).max(zero);
        let near = line.mul_add(line, beyond * beyond).sqrt() + number(1e-20);
        // The angle under which it is seen, about.
        let angle = swept.div(near * (near + length));
        let along = dot(r, q.axis);
        let rise = dot(e, q.axis) * number(0.5);
        let weight = if q.narrow {
            let h = number(0.5);
            let a = [r[0] - h * e[0], r[1] - h * e[1], r[2] - h * e[2]];
            let b = [r[0] + h * e[0], r[1] + h * e[1], r[2] + h * e[2]];
            let (far_a, far_b) = (dot(a, a).sqrt() + tiny, dot(b, b).sqrt() + tiny);
            let (cos_a, cos_b) = ((along - rise).div(far_a), (along + rise).div(far_b));
            // The sine of the angle between the axis and the plane of the edge, and whether the axis lies
            // between its ends.
            let sine = dot(q.axis, c).div(swept + tiny);
            let outside = zero.less(dot(cross(a, q.axis), c));
            let outside = outside.or(zero.less(dot(cross(q.axis, b), c)));
            let by_ends = cos_a.max(cos_b);
            let met_by_ends = by_ends.less(q.cos).not();
            let met = met_by_ends.or(outside.not().and(q.sin.less(sine.abs()).not()));
            let chord = (q.sin * q.sin - sine * sine).max(number(1e-12)).sqrt();
            let part = angle.min(chord + chord);
            let by_end = cos_a.less(cos_b).select(far_b, far_a);
            let turned = cross(e, q.axis);
            let middle = (swept * swept).div(dot(turned, c).abs() + tiny);
            let distance = outside.select(by_end, middle);
            let between = (number(1.0) - sine * sine).max(zero).sqrt();
            let cosine = outside.select(by_ends, between);
            let weight = part.div(distance + tiny) * q.lobe(cosine.max(zero));
            met.select(weight, zero)
        } else {
            // How high its ends are over the horizon.
            let height = (along + rise).max(zero) + (along - rise).max(zero);
            let weight = angle.div(near);
            let lobe = height.div(away + away);
            let matt = if q.exponent > 0.0 {
                weight * lobe
            } else {
                weight
            };
            zero.less(height).select(matt, zero)
        };
        // Lanes without an edge are not numbers here.
        zero.less(jump).select(jump * weight, zero)
    }
}
