//! The choice of one of many emitters, by a tree over emitters with a position, beside directional lights.

use pulp::Arch;

use super::branches::{Item, Lists};
use super::powers::running_sums;
use super::tree::{LightTree, OF_NODE};
use super::{Emitter, EmitterGroup, Emitters, Fixed, Receiver};
use crate::accel::eights::NONE;
use crate::accel::{Machine, Task, dispatch};
use crate::model::V3;
use crate::model::light_bounds::{Axes, Sphere};

/// A tree over emitters with a position, and directional lights: the data of a [`LightTree`]. `meet` is compiled for
/// the machine's vector instructions.
pub(super) struct ManyEmitters {
    arch: Arch,
    tree: Lists,
    distant: Vec<u32>,
    sums: Vec<f32>,
    axes: [f32; 9],
}

/// Makes an item of the tree from a triangle.
fn item(k: usize, e: &Emitter) -> Item {
    let ends = e.corners.map(|c| [c, c + e.velocity]);
    let ends = ends.as_flattened();
    Item {
        emitter: k as u32,
        low: ends.iter().fold(ends[0], |low, &c| low.min(c)),
        high: ends.iter().fold(ends[0], |high, &c| high.max(c)),
        axis: e.normal,
        is_isotropic: false,
        power: (e.area * e.radiance).clamp(1e-30, 1e30),
        alone: false,
    }
}

impl ManyEmitters {
    /// Builds the tree, and the groups of emitters: the tree's leaves, then directional lights one by one. The fixed
    /// probabilities of the emitters must be by power. The list of triangles is sorted by leaf.
    pub fn new(all: &mut Emitters) -> (Self, Vec<EmitterGroup>) {
        let triangles = all.list.len();
        let items = all.list.iter().enumerate();
        let mut items: Vec<Item> = items.map(|(k, e)| item(k, e)).collect();
        let mut distant = Vec::new();
        for (i, light) in all.lights.iter().enumerate() {
            if light.is_directional() {
                distant.push((triangles + i) as u32);
                continue;
            }
            items.push(Item {
                emitter: (triangles + i) as u32,
                low: light.position,
                high: light.position,
                axis: light.axis,
                is_isotropic: light.is_isotropic(),
                power: light.mean().clamp(1e-30, 1e30),
                alone: true,
            });
        }
        let count = triangles + all.lights.len();
        let shape = Lists::shape(&mut items);
        let old = all.list.clone();
        let old_chances = all.fixed.clone();
        let mut next = 0;
        let mut groups = Vec::with_capacity(shape.leaves.len() + distant.len());
        for leaf in shape.leaves.iter().rev() {
            let items = &mut items[leaf.clone()];
            let sphere = Sphere::new(items);
            for item in items
                .iter_mut()
                .filter(|i| (i.emitter as usize) < triangles)
            {
                let k = item.emitter as usize;
                (all.list[next], all.fixed[next]) = (old[k], old_chances[k]);
                item.emitter = next as u32;
                next += 1;
            }
            groups.push(EmitterGroup {
                members: items.iter().map(|i| i.emitter).collect(),
                center: sphere.center,
                radius: sphere.radius,
                ..EmitterGroup::default()
            });
        }
        let mut tree = match items.is_empty() {
            true => Lists::default(),
            false => Lists::new(&shape, &items, count),
        };
        tree.places.resize(count, [NONE, 0]);
        for (i, &k) in distant.iter().enumerate() {
            tree.places[k as usize] = [NONE, i as u32];
        }
        groups.extend(distant.iter().map(|&k| EmitterGroup {
            members: vec![k],
            ..EmitterGroup::default()
        }));
        let strength = |&k: &u32| all.lights[k as usize - triangles].mean().clamp(1e-30, 1e30);
        let sums: Vec<f32> = running_sums(distant.iter().map(strength));
        let total = sums.last().copied().unwrap_or(1.0);
        let axis = |&k: &u32| {
            let light = &all.lights[k as usize - triangles];
            (Some(light.axis * -1.0), strength(&k) / total)
        };
        let many = Self {
            arch: Arch::new(),
            tree,
            axes: Axes::new(distant.iter().map(axis)).numbers(),
            distant,
            sums,
        };
        (many, groups)
    }

    /// Returns the lists for choosing one of all emitters.
    #[inline(always)]
    pub fn tree<'a>(&'a self, fixed: Fixed<'a>) -> LightTree<'a> {
        LightTree {
            branches: &self.tree.branches,
            nodes: &self.tree.nodes,
            count: (self.tree.nodes.len() / OF_NODE) as u32,
            places: self.tree.places.as_flattened(),
            distant: &self.distant,
            distant_count: self.distant.len() as u32,
            sums: &self.sums,
            axes: &self.axes,
            fixed,
        }
    }

    /// Collects the emitters with a position whose spheres a ray meets.
    pub fn meet(&self, all: &Emitters, at: &Receiver, direction: V3, met: &mut Met) {
        let task = Meet {
            tree: all.lists().tree,
            at,
            direction,
            met,
        };
        dispatch(self.arch, task);
    }
}

/// The emitters whose spheres a ray meets, and the nodes that are not visited yet.
#[derive(Default)]
pub struct Met {
    open: Vec<u32>,
    pub emitters: Vec<u32>,
}

/// Collects the emitters whose spheres a ray meets.
struct Meet<'a> {
    tree: LightTree<'a>,
    at: &'a Receiver,
    direction: V3,
    met: &'a mut Met,
}

impl Task for Meet<'_> {
    type Output = ();

    #[inline(always)]
    fn run<M: Machine>(self, _: M) {
        let Met { open, emitters } = self.met;
        emitters.clear();
        open.clear();
        if self.tree.count > 0 {
            open.push(0);
        }
        while let Some(node) = open.pop() {
            let to = if self.tree.is_leaf(node) {
                &mut *emitters
            } else {
                &mut *open
            };
            let met = self.tree.met(node, self.at.position, self.direction);
            for (i, is_met) in met.into_iter().enumerate() {
                if is_met {
                    to.push(self.tree.word(node, i));
                }
            }
        }
    }
}
