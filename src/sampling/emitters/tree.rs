//! A tree over many emitters, from which one is drawn in about the proportion of the light that it brings to a point
//! (Conty Estevez and Kulla 2018): where a branch divides in eight, by bounds of their power, place and orientation.

use pulp::Arch;

use super::branches::{Item, Sphere, parts};
use crate::accel::{F8, LANES, Lanes, Machine, Task, dispatch};
use crate::model::{V3, v3};

const NONE: u32 = u32::MAX;
/// How much directions to the points of a sphere that is seen under 90° add to a squared cosine: an emitter that is seen
/// along its surface has then the mean of those around.
const SPREAD: f32 = 0.25;
/// Emitters around a point bring about as much light as from this share of their sphere's squared radius: a mean of 1/r²
/// over a box is six times that at the corners.
const INSIDE: f32 = 0.125;

/// Bounds of up to eight emitters, or of as many branches.
struct Node {
    centre: [Lanes; 3],
    radius: Lanes,
    /// Means of axes, and of their products.
    axis: [Lanes; 3],
    moments: [Lanes; 6],
    /// 0 where there is nothing.
    power: Lanes,
    /// Nodes, or emitters of a leaf.
    child: [u32; LANES],
    parent: Place,
    /// The number of a leaf.
    group: Option<u32>,
}

/// A node and one of its eight.
#[derive(Clone, Copy, Debug)]
struct Place {
    node: u32,
    lane: u32,
}

impl Place {
    const NONE: Self = Self {
        node: u32::MAX,
        lane: 0,
    };
}

/// A tree whose nodes have eight branches. What is called is compiled for the machine.
pub(super) struct LightTree {
    arch: Arch,
    nodes: Vec<Node>,
    /// The node of each leaf.
    leaves: Vec<u32>,
    /// The places of emitters.
    places: Vec<Place>,
    /// The power of all.
    root: Sphere,
}

/// The emitters of a leaf, and the sphere around them.
pub(super) struct LeafItems {
    pub emitters: Vec<u32>,
    pub centre: V3,
    pub radius: f32,
}

/// The emitters whose spheres a ray meets, and nodes that are left to look into.
#[derive(Default)]
pub(crate) struct Met {
    open: Vec<u32>,
    pub emitters: Vec<u32>,
}

/// A choice that was made.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chosen {
    pub emitter: u32,
    pub chance: f32,
    /// What is left of the random number.
    pub rest: f32,
}

impl LightTree {
    /// Of at least one emitter, counted up to `count`; with the leaves, by the numbers of their groups.
    pub fn new(items: &mut [Item], count: usize) -> (Self, Vec<LeafItems>) {
        let mut tree = Self {
            arch: Arch::new(),
            nodes: Vec::new(),
            leaves: Vec::new(),
            places: vec![Place::NONE; count],
            root: Sphere::new(items),
        };
        let mut leaves = Vec::new();
        let mut open = vec![(Place::NONE, items)];
        while let Some((parent, items)) = open.pop() {
            let at = tree.nodes.len() as u32;
            if let Some(node) = tree.nodes.get_mut(parent.node as usize) {
                node.child[parent.lane as usize] = at;
            }
            let mut node = Node::empty(parent);
            let small = items.len() <= LANES && !items.iter().any(|i| i.alone);
            if items.len() == 1 || small {
                let sphere = Sphere::new(items);
                leaves.push(LeafItems {
                    emitters: items.iter().map(|i| i.emitter).collect(),
                    centre: sphere.centre,
                    radius: sphere.radius,
                });
                for (lane, item) in items.iter().enumerate() {
                    node.set(lane, &Sphere::new(std::slice::from_ref(item)));
                    node.child[lane] = item.emitter;
                    tree.places[item.emitter as usize] = Place {
                        node: at,
                        lane: lane as u32,
                    };
                }
                node.group = Some(tree.leaves.len() as u32);
                tree.leaves.push(at);
            } else {
                for (lane, part) in parts(items).into_iter().enumerate() {
                    node.set(lane, &Sphere::new(part));
                    let lane = lane as u32;
                    open.push((Place { node: at, lane }, part));
                }
            }
            tree.nodes.push(node);
        }
        (tree, leaves)
    }

    /// Renames emitters.
    pub fn rename(&mut self, new: &[u32]) {
        let old = self.places.clone();
        for (emitter, place) in old.into_iter().enumerate() {
            self.places[new[emitter] as usize] = place;
        }
        for &leaf in &self.leaves {
            let node = &mut self.nodes[leaf as usize];
            for child in node.child.iter_mut().filter(|c| **c != NONE) {
                *child = new[*child as usize];
            }
        }
    }

    /// About the irradiance of a point with a normal by all of them.
    #[inline(always)]
    pub fn all(&self, x: V3, normal: V3) -> f32 {
        let Sphere { radius, axes, .. } = &self.root;
        let to = self.root.centre - x;
        let squared = to.length_squared().max(1e-30);
        let inverse = 1.0 / squared.sqrt();
        let seen = (radius * inverse).clamp(1e-6, 1.0);
        let emits = axes.facing(to * -inverse, SPREAD * seen * seen);
        let incident = to.dot(normal) * inverse;
        let above = (incident + seen).max(0.0);
        let receives = if incident < seen {
            above * above / (4.0 * seen)
        } else {
            incident
        };
        self.root.power * emits * receives / squared.max(INSIDE * radius * radius)
    }

    /// An emitter for a random number.
    pub fn choose(&self, x: V3, normal: V3, u: f32) -> Chosen {
        dispatch(
            self.arch,
            Choose {
                tree: self,
                x,
                normal,
                u,
            },
        )
    }

    /// The probability of an emitter.
    pub fn chance(&self, emitter: usize, x: V3, normal: V3) -> f32 {
        self.chance_at(self.places[emitter], x, normal)
    }

    /// The probability of a leaf.
    pub fn chance_of_leaf(&self, leaf: usize, x: V3, normal: V3) -> f32 {
        self.chance_at(self.nodes[self.leaves[leaf] as usize].parent, x, normal)
    }

    fn chance_at(&self, place: Place, x: V3, normal: V3) -> f32 {
        dispatch(
            self.arch,
            Chance {
                tree: self,
                place,
                x,
                normal,
            },
        )
    }

    /// Finds the emitters whose spheres a ray meets.
    pub fn meet(&self, x: V3, direction: V3, met: &mut Met) {
        dispatch(
            self.arch,
            Meet {
                tree: self,
                x,
                direction,
                met,
            },
        );
    }
}

/// [`LightTree::choose`] as a task.
struct Choose<'a> {
    tree: &'a LightTree,
    x: V3,
    normal: V3,
    u: f32,
}

impl Task for Choose<'_> {
    type Output = Chosen;

    #[inline(always)]
    fn run<M: Machine>(self, machine: M) -> Chosen {
        let query = Query::new(machine, self.x, self.normal);
        let (mut at, mut chance, mut u) = (0, 1.0, self.u);
        loop {
            let node = &self.tree.nodes[at];
            let (weights, total) = node.weights(machine, &query);
            let target = u * total;
            let (mut lane, mut before, mut passed) = (0, 0.0, 0.0);
            let mut i = 0;
            while i < LANES {
                if weights[i] > 0.0 {
                    (lane, before) = (i, passed);
                    passed += weights[i];
                    if target < passed {
                        break;
                    }
                }
                i += 1;
            }
            chance *= weights[lane] / total;
            u = ((target - before) / weights[lane]).clamp(0.0, 1.0 - f32::EPSILON);
            if node.group.is_some() {
                return Chosen {
                    emitter: node.child[lane],
                    chance,
                    rest: u,
                };
            }
            at = node.child[lane] as usize;
        }
    }
}

/// [`LightTree::chance`] as a task.
struct Chance<'a> {
    tree: &'a LightTree,
    place: Place,
    x: V3,
    normal: V3,
}

impl Task for Chance<'_> {
    type Output = f32;

    #[inline(always)]
    fn run<M: Machine>(self, machine: M) -> f32 {
        let query = Query::new(machine, self.x, self.normal);
        let (mut place, mut chance) = (self.place, 1.0);
        while place.node != u32::MAX {
            let node = &self.tree.nodes[place.node as usize];
            let (weights, total) = node.weights(machine, &query);
            chance *= weights[place.lane as usize] / total;
            place = node.parent;
        }
        chance
    }
}

/// [`LightTree::meet`] as a task.
struct Meet<'a> {
    tree: &'a LightTree,
    x: V3,
    direction: V3,
    met: &'a mut Met,
}

impl Task for Meet<'_> {
    type Output = ();

    #[inline(always)]
    fn run<M: Machine>(self, machine: M) {
        let ray = Query::new(machine, self.x, self.direction);
        let Met { open, emitters } = self.met;
        emitters.clear();
        open.clear();
        open.push(0);
        while let Some(at) = open.pop() {
            let node = &self.tree.nodes[at as usize];
            let to = if node.group.is_some() {
                &mut *emitters
            } else {
                &mut *open
            };
            let mut met = node.met_by(machine, &ray);
            while met != 0 {
                to.push(node.child[met.trailing_zeros() as usize]);
                met &= met - 1;
            }
        }
    }
}

/// A point and a direction, such as a normal, each of their numbers eight times.
struct Query<M: Machine> {
    x: [F8<M>; 3],
    direction: [F8<M>; 3],
}

impl<M: Machine> Query<M> {
    #[inline(always)]
    fn new(machine: M, x: V3, direction: V3) -> Self {
        let splat = |v: V3| {
            [
                F8::splat(machine, v.x),
                F8::splat(machine, v.y),
                F8::splat(machine, v.z),
            ]
        };
        Self {
            x: splat(x),
            direction: splat(direction),
        }
    }
}

#[inline(always)]
fn dot<M: Machine>(a: [F8<M>; 3], b: [F8<M>; 3]) -> F8<M> {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
}

impl Node {
    fn empty(parent: Place) -> Self {
        let zero = [0.0; LANES];
        Self {
            centre: [zero; 3],
            radius: zero,
            axis: [zero; 3],
            moments: [zero; 6],
            power: zero,
            child: [NONE; LANES],
            parent,
            group: None,
        }
    }

    fn set(&mut self, lane: usize, sphere: &Sphere) {
        for (to, x) in self.centre.iter_mut().zip(sphere.centre.to_array()) {
            to[lane] = x;
        }
        for (to, x) in self.axis.iter_mut().zip(sphere.axes.mean.to_array()) {
            to[lane] = x;
        }
        for (to, x) in self.moments.iter_mut().zip(sphere.axes.moments) {
            to[lane] = x;
        }
        self.radius[lane] = sphere.radius;
        self.power[lane] = sphere.power;
    }

    /// The bits of those whose spheres a ray meets.
    #[inline(always)]
    fn met_by<M: Machine>(&self, machine: M, ray: &Query<M>) -> u32 {
        let load = |lanes: &Lanes| F8::load(machine, lanes);
        let zero = F8::splat(machine, 0.0);
        let [cx, cy, cz] = self.centre.each_ref().map(load);
        let to = [cx - ray.x[0], cy - ray.x[1], cz - ray.x[2]];
        let radius = load(&self.radius);
        let along = dot(to, ray.direction);
        let [x, y, z] = ray.direction.map(|d| along * d);
        let across = [to[0] - x, to[1] - y, to[2] - z];
        // With a margin for rounding far away.
        let reach = along.abs().mul_add(F8::splat(machine, 1e-6), radius);
        let near = dot(across, across).less(reach * reach);
        let ahead = zero.less(along + reach);
        let any = zero.less(load(&self.power));
        near.and(ahead).and(any).bits()
    }

    /// About the irradiance of a point by each, as [`LightTree::all`], or power where all are 0; with their sum.
    #[inline(always)]
    fn weights<M: Machine>(&self, machine: M, query: &Query<M>) -> (Lanes, f32) {
        let load = |lanes: &Lanes| F8::load(machine, lanes);
        let number = |x: f32| F8::splat(machine, x);
        let (zero, one) = (number(0.0), number(1.0));
        let [cx, cy, cz] = self.centre.each_ref().map(load);
        let to = [cx - query.x[0], cy - query.x[1], cz - query.x[2]];
        let (radius, power) = (load(&self.radius), load(&self.power));
        let squared = dot(to, to).max(number(1e-30));
        let inverse = one.div(squared.sqrt());
        // The sine of the angle under which the sphere is seen.
        let seen = (radius * inverse).min(one).max(number(1e-6));
        let [x, y, z] = to.map(|c| (zero - c) * inverse);
        let [xx, yy, zz, xy, xz, yz] = self.moments.each_ref().map(load);
        let products = dot([xx, yy, zz], [x * x, y * y, z * z]);
        let crossed = dot([xy, xz, yz], [x * y, x * z, y * z]);
        let spread = crossed.mul_add(number(2.0), number(SPREAD) * seen * seen);
        let emits =
            dot([x, y, z], self.axis.each_ref().map(load)) + (products + spread).max(zero).sqrt();
        // The mean of cosines over the sphere, where the horizon divides it.
        let incident = dot(to, query.direction) * inverse;
        let above = (incident + seen).max(zero);
        let receives = incident
            .less(seen)
            .select((above * above).div(number(4.0) * seen), incident);
        let squared = squared.max(number(INSIDE) * radius * radius);
        let weight = (number(0.5) * power * emits.max(zero) * receives).div(squared);
        let weight = zero.less(power).select(weight, zero);
        let total = weight.sum();
        if total > 0.0 && total.is_finite() {
            (weight.lanes(), total)
        } else {
            (self.power, power.sum())
        }
    }
}
