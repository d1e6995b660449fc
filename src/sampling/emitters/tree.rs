//! A binary tree over many emitters, from which one is drawn in about the proportion of the light that it brings to a
//! point (Conty Estevez and Kulla 2018): where a branch divides, by bounds of its halves' power, place and orientation.

use crate::model::V3;

/// What a tree knows of an emitter.
#[derive(Clone, Copy, Debug)]
pub(super) struct Item {
    pub emitter: u32,
    /// A box around it, over the shutter.
    pub low: V3,
    pub high: V3,
    /// Its normal or direction; light goes up to 90° from there, or in all directions.
    pub axis: V3,
    pub all_round: bool,
    pub power: f32,
    /// Whether it is a leaf of its own.
    pub alone: bool,
}

/// Emitters of a leaf at most.
pub(super) const LEAF: usize = 8;
const NONE: u32 = u32::MAX;
/// Emitters around a point bring about as much light as from this share of their sphere's squared radius: a mean of 1/r²
/// over a box is six times that at the corners.
const INSIDE: f32 = 0.125;

/// Emitters in a sphere.
#[derive(Clone, Copy, Debug)]
struct Node {
    centre: V3,
    radius: f32,
    /// A cone of their axes.
    axis: V3,
    cos: f32,
    sin: f32,
    power: f32,
    parent: u32,
    /// The first of two children, which lie side by side; [`NONE`] for a leaf.
    child: u32,
    /// Of a leaf.
    group: u32,
}

/// Nodes; the children of one lie side by side, the first at an even place.
pub(super) struct LightTree {
    nodes: Vec<Node>,
    /// The node of each group.
    leaves: Vec<u32>,
}

/// The emitters of a leaf, and the sphere around them.
pub(super) struct LeafItems {
    pub emitters: Vec<u32>,
    pub centre: V3,
    pub radius: f32,
}

impl LightTree {
    /// Of at least one emitter; with the leaves, by the numbers of their groups.
    pub fn new(items: &mut [Item]) -> (Self, Vec<LeafItems>) {
        let mut tree = Self {
            nodes: Vec::new(),
            leaves: Vec::new(),
        };
        let mut leaves = Vec::new();
        tree.nodes.push(Node::new(items, NONE));
        // Keeps pairs of children at even places.
        tree.nodes.push(Node::new(items, NONE));
        let mut open = vec![(0usize, items)];
        while let Some((at, items)) = open.pop() {
            let small = items.len() <= LEAF && !items.iter().any(|i| i.alone);
            if items.len() == 1 || small {
                let node = &mut tree.nodes[at];
                node.group = tree.leaves.len() as u32;
                tree.leaves.push(at as u32);
                leaves.push(LeafItems {
                    emitters: items.iter().map(|i| i.emitter).collect(),
                    centre: node.centre,
                    radius: node.radius,
                });
                continue;
            }
            let child = tree.nodes.len();
            tree.nodes[at].child = child as u32;
            let (left, right) = split(items);
            tree.nodes.push(Node::new(left, at as u32));
            tree.nodes.push(Node::new(right, at as u32));
            open.push((child + 1, right));
            open.push((child, left));
        }
        (tree, leaves)
    }

    /// About the irradiance of a point with a normal by all of them.
    #[inline(always)]
    pub fn all(&self, x: V3, normal: V3) -> f32 {
        self.nodes[0].importance(x, normal)
    }

    /// The probability of the first of two children.
    #[inline(always)]
    fn first(&self, child: usize, x: V3, normal: V3) -> f32 {
        let (a, b) = (&self.nodes[child], &self.nodes[child + 1]);
        let (mut first, mut second) = (a.importance(x, normal), b.importance(x, normal));
        let sum = first + second;
        if !(sum > 0.0 && sum.is_finite()) {
            (first, second) = (a.power, b.power);
        }
        first / (first + second)
    }

    /// A group for a random number, its probability, and what is left of the number.
    #[inline(always)]
    pub fn choose(&self, x: V3, normal: V3, mut u: f32) -> (usize, f32, f32) {
        let (mut at, mut chance) = (0, 1.0);
        while self.nodes[at].child != NONE {
            let child = self.nodes[at].child as usize;
            let first = self.first(child, x, normal);
            if u < first {
                (at, u) = (child, u / first);
                chance *= first;
            } else {
                (at, u) = (child + 1, (u - first) / (1.0 - first));
                chance *= 1.0 - first;
            }
            u = u.min(1.0 - f32::EPSILON);
        }
        (self.nodes[at].group as usize, chance, u)
    }

    /// The probability of a group.
    #[inline(always)]
    pub fn chance(&self, group: usize, x: V3, normal: V3) -> f32 {
        let (mut at, mut chance) = (self.leaves[group] as usize, 1.0);
        while self.nodes[at].parent != NONE {
            let first = self.first(at & !1, x, normal);
            chance *= if at & 1 == 0 { first } else { 1.0 - first };
            at = self.nodes[at].parent as usize;
        }
        chance
    }

    /// Visits the groups whose spheres a ray meets.
    #[inline(always)]
    pub fn each_on(&self, x: V3, direction: V3, mut visit: impl FnMut(usize)) {
        // A branch is at most as deep as its emitters are many; those that are left wait here.
        let mut open = vec![0u32];
        while let Some(at) = open.pop() {
            let node = &self.nodes[at as usize];
            let to = node.centre - x;
            let along = to.dot(direction);
            let across = to.length_squared() - along * along;
            if along < -node.radius || across > node.radius * node.radius {
                continue;
            }
            if node.child == NONE {
                visit(node.group as usize);
            } else {
                open.extend([node.child, node.child + 1]);
            }
        }
    }
}

/// The cosine of an angle less another, both given by cosine and sine; 1 where that is negative.
#[inline(always)]
fn less(cos: f32, sin: f32, by_cos: f32, by_sin: f32) -> f32 {
    if cos > by_cos {
        1.0
    } else {
        cos * by_cos + sin * by_sin
    }
}

#[inline(always)]
fn sine(cos: f32) -> f32 {
    (1.0 - cos * cos).max(0.0).sqrt()
}

impl Node {
    fn new(items: &[Item], parent: u32) -> Self {
        let (low, high) = bounds(items);
        let sum = items.iter().fold(V3::ZERO, |sum, i| sum + i.axis * i.power);
        let axis = sum * (1.0 / sum.length().max(f32::MIN_POSITIVE));
        let mut cos: f32 = 1.0;
        for item in items {
            cos = cos.min(if item.all_round {
                -1.0
            } else {
                item.axis.dot(axis)
            });
        }
        // With a margin for rounding.
        let cos = (cos - 1e-5).max(-1.0);
        Self {
            centre: (low + high) * 0.5,
            radius: (high - low).length() * (0.5 * (1.0 + 1e-5)),
            axis,
            cos,
            sin: sine(cos),
            power: items.iter().map(|i| i.power).sum(),
            parent,
            child: NONE,
            group: NONE,
        }
    }

    /// About the irradiance of a point with a normal; 0 only if there is none.
    #[inline(always)]
    fn importance(&self, x: V3, normal: V3) -> f32 {
        let to = self.centre - x;
        let squared = to.length_squared();
        let of_radius = self.radius * self.radius;
        if squared <= of_radius {
            return self.power / squared.max(INSIDE * of_radius).max(1e-37);
        }
        let inverse = 1.0 / squared.sqrt();
        // The angle under which the sphere is seen.
        let sin_seen = self.radius * inverse;
        let cos_seen = sine(sin_seen);
        let from_axis = -to.dot(self.axis) * inverse;
        let off = less(from_axis, sine(from_axis), self.cos, self.sin);
        let emits = less(off, sine(off), cos_seen, sin_seen);
        let incident = to.dot(normal) * inverse;
        let receives = less(incident, sine(incident), cos_seen, sin_seen);
        self.power * emits.max(0.0) * receives.max(0.0) / squared
    }
}

fn bounds(items: &[Item]) -> (V3, V3) {
    let (mut low, mut high) = (V3::ONE * f32::MAX, V3::ONE * f32::MIN);
    for item in items {
        low = low.min(item.low);
        high = high.max(item.high);
    }
    (low, high)
}

/// Parts that a branch may be divided between.
const BINS: usize = 12;

/// Some emitters: a box, their power, and the sum of their axes times it.
#[derive(Clone, Copy, Debug)]
struct Bin {
    low: V3,
    high: V3,
    axis: V3,
    power: f32,
}

impl Bin {
    const EMPTY: Self = Self {
        low: V3 {
            x: f32::MAX,
            y: f32::MAX,
            z: f32::MAX,
        },
        high: V3 {
            x: f32::MIN,
            y: f32::MIN,
            z: f32::MIN,
        },
        axis: V3::ZERO,
        power: 0.0,
    };

    fn and(&self, o: &Self) -> Self {
        Self {
            low: self.low.min(o.low),
            high: self.high.max(o.high),
            axis: self.axis + o.axis,
            power: self.power + o.power,
        }
    }

    /// Power times surface times a measure of how much axes spread: what makes estimates wrong.
    fn cost(&self) -> f32 {
        if self.power <= 0.0 {
            return 0.0;
        }
        let size = (self.high - self.low).max(V3::ZERO);
        let surface = size.x * size.y + size.y * size.z + size.z * size.x;
        let spread = 1.0 - self.axis.length() / self.power;
        self.power * surface * (0.25 + spread)
    }
}

/// Divides emitters in two where estimates of both halves are best.
fn split(items: &mut [Item]) -> (&mut [Item], &mut [Item]) {
    let middle = |item: &Item| ((item.low + item.high) * 0.5).to_array();
    let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
    for item in items.iter() {
        for (axis, m) in middle(item).into_iter().enumerate() {
            low[axis] = low[axis].min(m);
            high[axis] = high[axis].max(m);
        }
    }
    let bin_of = |item: &Item, axis: usize| {
        let place = (middle(item)[axis] - low[axis]) / (high[axis] - low[axis]);
        ((place * BINS as f32) as usize).min(BINS - 1)
    };
    let mut best = (f32::INFINITY, 0, 0);
    for axis in 0..3 {
        if high[axis] <= low[axis] {
            continue;
        }
        let mut bins = [Bin::EMPTY; BINS];
        for item in items.iter() {
            let bin = &mut bins[bin_of(item, axis)];
            *bin = bin.and(&Bin {
                low: item.low,
                high: item.high,
                axis: if item.all_round {
                    V3::ZERO
                } else {
                    item.axis * item.power
                },
                power: item.power,
            });
        }
        let mut after = [0.0; BINS];
        let mut sum = Bin::EMPTY;
        for i in (1..BINS).rev() {
            sum = sum.and(&bins[i]);
            after[i] = sum.cost();
        }
        let mut sum = Bin::EMPTY;
        for i in 1..BINS {
            sum = sum.and(&bins[i - 1]);
            let cost = sum.cost() + after[i];
            if cost < best.0 {
                best = (cost, axis, i);
            }
        }
    }
    let (_, axis, bin) = best;
    let mut count = 0;
    if bin > 0 {
        items.sort_by_key(|item| bin_of(item, axis) >= bin);
        count = items.iter().filter(|item| bin_of(item, axis) < bin).count();
    }
    if count == 0 || count == items.len() {
        count = items.len() / 2;
    }
    items.split_at_mut(count)
}
