//! A tree over many emitters, from which one is drawn in about the proportion of the light that it brings to a point
//! (Conty Estevez and Kulla 2018): where a branch divides in eight, by bounds of their power, place and orientation.

use pulp::Arch;

use super::branches::{Item, Sphere, parts};
use super::node::{INSIDE, NONE, Node, Place, Query, SPREAD};
use crate::accel::{LANES, Machine, Task, dispatch};
use crate::model::V3;

/// A tree whose nodes have eight branches. What is called is compiled for the machine.
pub(super) struct LightTree {
    arch: Arch,
    pub(super) nodes: Vec<Node>,
    /// The node of each leaf.
    leaves: Vec<u32>,
    /// The places of emitters.
    pub(super) places: Vec<Place>,
    /// The power of all.
    pub(super) root: Sphere,
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
