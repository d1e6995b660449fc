//! Nodes of a tree over edges, which bound eight subtrees, and leaves of eight edges; estimates of what these
//! contribute.

use super::bounds::Bounds;
use super::query::{EdgeList, Jumps, Query8, cross, dot, load as vectors};
use crate::accel::{F8, LANES, Lanes, Machine};
use crate::model::V3;

/// Bounds of up to eight subtrees.
pub(super) struct Node {
    centre: [Lanes; 3],
    radius: Lanes,
    /// A cone of the normals of folds.
    axis: [Lanes; 3],
    cos: Lanes,
    sin: Lanes,
    jumps: Jumps<Lanes>,
    /// Twice the index of a node, or of a leaf plus one.
    pub child: [u32; LANES],
}

impl Node {
    pub fn empty() -> Self {
        let zero = [0.0; LANES];
        Self {
            centre: [zero; 3],
            radius: zero,
            axis: [zero; 3],
            cos: zero,
            sin: zero,
            jumps: Jumps::default(),
            child: [u32::MAX; LANES],
        }
    }

    pub fn set(&mut self, i: usize, b: &Bounds) {
        for (to, x) in self.centre.iter_mut().zip(b.centre().to_array()) {
            to[i] = x;
        }
        for (to, x) in self.axis.iter_mut().zip(b.axis().to_array()) {
            to[i] = x;
        }
        self.radius[i] = b.radius();
        // With a margin for rounding.
        let cos = b.cos() - 1e-5;
        self.cos[i] = cos;
        self.sin[i] = (1.0 - cos * cos).max(0.0).sqrt();
        self.jumps.set(i, &b.jumps);
    }

    /// Estimates of what the subtrees contribute, 0 only if they can't; and those to be entered, one bit
    /// each: they lie in the cone in part, or are seen under an angle whose sine is over `large`.
    #[inline(always)]
    pub fn weights<M: Machine>(&self, machine: M, q: &Query8<M>, large: f32) -> (Lanes, u32) {
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
        let facing = dot(vectors(machine, &self.axis), r).div(distance.max(number(1e-20)));
        // Where normals and directions spread over more than a half-space anything is possible.
        let narrow = zero.less(cos_sum).and(distance.less(radius).not());
        let no_silhouette = narrow.and(sin_sum.less(facing.abs()));
        let fold = load(&self.jumps.fold).div(sin_sum.abs() + number(0.05));
        let fold = no_silhouette.select(zero, fold);
        let hidden = narrow
            .and(sin_sum.less(facing))
            .and(zero.less(load(&self.jumps.closed)));
        let crease = hidden.select(zero, load(&self.jumps.crease) * q.creases);
        let always = self.jumps.always(machine, q);
        let nearest = (along + radius).div(distance + radius).max(zero).min(one);
        let weight = (always + fold + crease) * q.lobe(nearest);
        let weight = weight.div(squared + radius * radius);
        let weight = missed.select(zero, weight);
        let whole = (beside + radius)
            .less(zero)
            .and(sin_seen.less(number(large)));
        (weight.lanes(), !whole.bits())
    }
}

/// Numbers of a lane of a node and of a leaf.
#[cfg(feature = "wgpu")]
pub(super) const NODE_NUMBERS: usize = 14;
#[cfg(feature = "wgpu")]
pub(super) const LEAF_NUMBERS: usize = 21;

#[cfg(feature = "wgpu")]
impl Jumps<Lanes> {
    fn lane(&self, i: usize) -> [f32; 5] {
        [
            self.seen_always[i],
            self.passes_always[i],
            self.fold[i],
            self.crease[i],
            self.closed[i],
        ]
    }
}

#[cfg(feature = "wgpu")]
impl Node {
    /// The numbers of a lane: centre, radius, axis, cosine, sine, jumps.
    pub fn lane(&self, i: usize) -> [f32; NODE_NUMBERS] {
        let mut all = [0.0; NODE_NUMBERS];
        for k in 0..3 {
            all[k] = self.centre[k][i];
            all[4 + k] = self.axis[k][i];
        }
        (all[3], all[7], all[8]) = (self.radius[i], self.cos[i], self.sin[i]);
        all[9..].copy_from_slice(&self.jumps.lane(i));
        all
    }
}

#[cfg(feature = "wgpu")]
impl Leaf {
    /// The numbers of a lane: middle, vector along, both normals, velocity, half the length, jumps.
    pub fn lane(&self, i: usize) -> [f32; LEAF_NUMBERS] {
        let mut all = [0.0; LEAF_NUMBERS];
        for k in 0..3 {
            all[k] = self.middle[k][i];
            all[3 + k] = self.along[k][i];
            all[6 + k] = self.normal[0][k][i];
            all[9 + k] = self.normal[1][k][i];
            all[12 + k] = self.velocity.as_ref().map_or(0.0, |v| v[k][i]);
        }
        all[15] = self.half[i];
        all[16..].copy_from_slice(&self.jumps.lane(i));
        all
    }
}

pub(super) struct Leaf {
    middle: [Lanes; 3],
    along: [Lanes; 3],
    /// Normals of both faces.
    normal: [[Lanes; 3]; 2],
    velocity: Option<[Lanes; 3]>,
    half: Lanes,
    jumps: Jumps<Lanes>,
    pub edge: [u32; LANES],
}

/// Eight edges seen from a point.
struct Seen<M: Machine> {
    /// The vector to the edge's middle, and half the edge's length.
    r: [F8<M>; 3],
    half: F8<M>,
    /// The vector along the edge, and its cross product with r.
    e: [F8<M>; 3],
    c: [F8<M>; 3],
    /// The length of that cross product: |e| times the distance from the edge's line.
    swept: F8<M>,
    /// The distance from the edge.
    near: F8<M>,
    /// The angle under which it is seen, about.
    angle: F8<M>,
    /// The heights of the middle over the plane across the query's axis, and of one end over the middle.
    along: F8<M>,
    rise: F8<M>,
}

impl Leaf {
    pub fn new(source: &EdgeList, list: &[u32]) -> Self {
        let zero = [0.0; LANES];
        let mut leaf = Self {
            middle: [zero; 3],
            along: [zero; 3],
            normal: [[zero; 3]; 2],
            velocity: source.scene.velocities.as_ref().map(|_| [zero; 3]),
            half: zero,
            jumps: Jumps::default(),
            edge: [u32::MAX; LANES],
        };
        for (i, &index) in list.iter().enumerate() {
            let e = &source.edges[index as usize];
            let put = |to: &mut [Lanes; 3], v: V3| {
                for (lanes, x) in to.iter_mut().zip(v.to_array()) {
                    lanes[i] = x;
                }
            };
            put(&mut leaf.middle, source.middle(index));
            put(&mut leaf.along, e.along);
            for (to, normal) in leaf.normal.iter_mut().zip(source.normals(e)) {
                put(to, normal);
            }
            if let Some(velocity) = &mut leaf.velocity {
                put(velocity, source.velocity(e));
            }
            leaf.half[i] = 0.5 * e.along.length();
            leaf.jumps.set(i, &Jumps::of(e));
            leaf.edge[i] = index;
        }
        leaf
    }

    /// Estimates of what the edges contribute; 0 only if they can't.
    #[inline(always)]
    pub fn weights<M: Machine>(&self, machine: M, q: &Query8<M>) -> F8<M> {
        let s = self.seen(machine, q);
        let jump = self.jump(machine, q, &s);
        let weight = if q.narrow {
            s.in_cone(machine, q)
        } else {
            s.over_horizon(machine, q)
        };
        let zero = F8::splat(machine, 0.0);
        // Lanes without an edge are not numbers here.
        zero.less(jump).select(jump * weight, zero)
    }

    #[inline(always)]
    fn seen<M: Machine>(&self, machine: M, q: &Query8<M>) -> Seen<M> {
        let number = |x: f32| F8::splat(machine, x);
        let mut r = q.to(&self.middle);
        if let Some(velocity) = &self.velocity {
            let time = number(q.time);
            for (r, v) in r.iter_mut().zip(velocity) {
                *r = F8::load(machine, v).mul_add(time, *r);
            }
        }
        let e = vectors(machine, &self.along);
        let half = F8::load(machine, &self.half);
        let length = (half + half).max(number(TINY));
        let c = cross(e, r);
        let swept = dot(c, c).sqrt();
        let line = swept.div(length);
        let beyond = (dot(e, r).abs().div(length) - half).max(number(0.0));
        let near = line.mul_add(line, beyond * beyond).sqrt() + number(1e-20);
        Seen {
            r,
            half,
            e,
            c,
            swept,
            near,
            angle: swept.div(near * (near + length)),
            along: dot(r, q.axis),
            rise: dot(e, q.axis) * number(0.5),
        }
    }

    /// The most that may jump at the edges.
    #[inline(always)]
    fn jump<M: Machine>(&self, machine: M, q: &Query8<M>, s: &Seen<M>) -> F8<M> {
        let load = |lanes: &Lanes| F8::load(machine, lanes);
        let zero = F8::splat(machine, 0.0);
        // The point's height over both faces: r leads from it to the edge's middle, which lies in both.
        let above = |n: &[Lanes; 3]| zero - dot(vectors(machine, n), s.r);
        let (front, back) = (above(&self.normal[0]), above(&self.normal[1]));
        let silhouette = (front * back).less(zero);
        let hidden = zero
            .less(load(&self.jumps.closed))
            .and(zero.less(front).not())
            .and(zero.less(back).not());
        let crease = hidden.select(zero, load(&self.jumps.crease) * q.creases);
        let fold = silhouette.select(load(&self.jumps.fold), crease);
        // Edges of a plane that the point lies in are seen from the side alone.
        let rounding = s.away() * F8::splat(machine, 1e-6);
        let in_plane = front.abs().min(back.abs()).less(rounding);
        self.jumps.always(machine, q) + in_plane.select(zero, fold)
    }
}

/// Lengths that are divided by are at least this.
const TINY: f32 = 1e-30;

impl<M: Machine> Seen<M> {
    /// A length that is not less than the distance to any point of the edge.
    #[inline(always)]
    fn away(&self) -> F8<M> {
        self.r[0].abs() + self.r[1].abs() + self.r[2].abs() + self.half
    }

    /// Angle over distance times lobe, of the part of the edge in the query's cone.
    #[inline(always)]
    fn in_cone(&self, machine: M, q: &Query8<M>) -> F8<M> {
        let Self { r, e, c, .. } = *self;
        let (along, rise, swept) = (self.along, self.rise, self.swept);
        let number = |x: f32| F8::splat(machine, x);
        let (zero, tiny, h) = (number(0.0), number(TINY), number(0.5));
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
        let ends_within = by_ends.less(q.cos).not();
        let within = ends_within.or(outside.not().and(q.sin.less(sine.abs()).not()));
        let chord = (q.sin * q.sin - sine * sine).max(number(1e-12)).sqrt();
        let part = self.angle.min(chord + chord);
        let by_end = cos_a.less(cos_b).select(far_b, far_a);
        let turned = cross(e, q.axis);
        let middle = (swept * swept).div(dot(turned, c).abs() + tiny);
        let distance = outside.select(by_end, middle);
        let between = (number(1.0) - sine * sine).max(zero).sqrt();
        let cosine = outside.select(by_ends, between);
        let weight = part.div(distance + tiny) * q.lobe(cosine.max(zero));
        within.select(weight, zero)
    }

    /// Angle over distance, times about cos θ where the query has a lobe, of edges over the horizon.
    #[inline(always)]
    fn over_horizon(&self, machine: M, q: &Query8<M>) -> F8<M> {
        let zero = F8::splat(machine, 0.0);
        // The sum of the heights of both ends.
        let height = (self.along + self.rise).max(zero) + (self.along - self.rise).max(zero);
        let weight = self.angle.div(self.near);
        let away = self.away();
        let lobe = height.div(away + away);
        let matt = if q.exponent > 0.0 {
            weight * lobe
        } else {
            weight
        };
        zero.less(height).select(matt, zero)
    }
}
