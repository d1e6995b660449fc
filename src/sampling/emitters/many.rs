//! The choice of one of many emitters, by a tree over those that are somewhere, beside directional lights.

use super::branches::{Axes, Item};
use super::powers::{mean, running_sums};
use super::tree::{LightTree, Met};
use super::{BY_POWER, Emitter, EmitterGroup, Emitters, Receiver};
use crate::model::V3;

/// A tree over emitters, and directional lights. A share of [`BY_POWER`] is chosen by power, whatever the point.
pub(super) struct ManyEmitters {
    /// None if all are directional.
    pub(super) tree: Option<LightTree>,
    /// Directional lights, and the sums of their strengths up to each.
    pub(super) distant: Vec<u32>,
    pub(super) sums: Vec<f32>,
    /// The directions to them.
    pub(super) axes: Axes,
}

/// The greatest part of a number under 1.
const MOST: f32 = 1.0 - f32::EPSILON;

/// A triangle as an item of the tree.
fn item(k: usize, e: &Emitter) -> Item {
    let ends = e.corners.map(|c| [c, c + e.velocity]);
    let ends = ends.as_flattened();
    Item {
        emitter: k as u32,
        low: ends.iter().fold(ends[0], |low, &c| low.min(c)),
        high: ends.iter().fold(ends[0], |high, &c| high.max(c)),
        axis: e.normal,
        all_round: false,
        power: (e.area * e.radiance).clamp(1e-30, 1e30),
        alone: false,
    }
}

impl ManyEmitters {
    /// Of emitters whose fixed probabilities are those by power, with their groups: the tree's leaves, then
    /// directional lights one by one. The list of emitters is put into the order of the leaves.
    pub fn new(all: &mut Emitters) -> (Self, Vec<EmitterGroup>) {
        let triangles = all.list.len();
        let items = all.list.iter().enumerate();
        let mut items: Vec<Item> = items.map(|(k, e)| item(k, e)).collect();
        let mut distant = Vec::new();
        for (i, light) in all.lights.iter().enumerate() {
            if light.directional {
                distant.push((triangles + i) as u32);
                continue;
            }
            items.push(Item {
                emitter: (triangles + i) as u32,
                low: light.position,
                high: light.position,
                axis: light.axis,
                all_round: !light.spot,
                power: mean(light.strength).clamp(1e-30, 1e30),
                alone: true,
            });
        }
        let count = triangles + all.lights.len();
        let (mut tree, leaves) = match items.is_empty() {
            true => (None, Vec::new()),
            false => {
                let (tree, leaves) = LightTree::new(&mut items, count);
                (Some(tree), leaves)
            }
        };
        let old = all.list.clone();
        let old_chances = all.fixed.clone();
        let mut next = 0;
        let mut new: Vec<u32> = (0..count as u32).collect();
        let mut groups = Vec::with_capacity(leaves.len() + distant.len());
        for leaf in leaves {
            let mut group = EmitterGroup {
                centre: leaf.centre,
                radius: leaf.radius,
                ..EmitterGroup::default()
            };
            for k in leaf.emitters {
                if (k as usize) < triangles {
                    all.list[next] = old[k as usize];
                    all.fixed[next] = old_chances[k as usize];
                    group.members.push(next as u32);
                    new[k as usize] = next as u32;
                    next += 1;
                } else {
                    group.members.push(k);
                }
            }
            groups.push(group);
        }
        if let Some(tree) = &mut tree {
            tree.rename(&new);
        }
        groups.extend(distant.iter().map(|&k| EmitterGroup {
            members: vec![k],
            ..EmitterGroup::default()
        }));
        let strength =
            |&k: &u32| mean(all.lights[k as usize - triangles].strength).clamp(1e-30, 1e30);
        let sums: Vec<f32> = running_sums(distant.iter().map(strength));
        let total = sums.last().copied().unwrap_or(1.0);
        let axis = |&k: &u32| {
            let light = &all.lights[k as usize - triangles];
            (Some(light.axis * -1.0), strength(&k) / total)
        };
        let axes = Axes::new(distant.iter().map(axis));
        let many = Self {
            tree,
            distant,
            sums,
            axes,
        };
        (many, groups)
    }

    /// The probability of directional lights.
    #[inline(always)]
    fn of_distant(&self, at: &Receiver) -> f32 {
        match (&self.tree, self.sums.last()) {
            (None, _) => 1.0,
            (_, None) => 0.0,
            (Some(tree), Some(&strength)) => {
                let distant = strength * self.axes.facing(at.normal, 0.0);
                let near = tree.all(at.position, at.normal);
                // Neither, as far as this sees: then any.
                if distant + near > 0.0 {
                    distant / (distant + near)
                } else {
                    0.5
                }
            }
        }
    }

    /// The probability of a directional light among these.
    fn among_distant(&self, emitter: usize) -> f32 {
        let i = self.distant.partition_point(|&k| (k as usize) < emitter);
        let before = if i == 0 { 0.0 } else { self.sums[i - 1] };
        (self.sums[i] - before) / self.sums[self.sums.len() - 1]
    }

    /// An emitter for a random number, its probability, and what is left of the number.
    #[inline(never)]
    pub fn choose(&self, all: &Emitters, at: &Receiver, u: f32) -> (usize, f32, f32) {
        if u < BY_POWER {
            let (k, _, rest) = all.by_sums((u / BY_POWER).min(MOST));
            return (k, self.chance(all, at, k), rest);
        }
        let u = ((u - BY_POWER) / (1.0 - BY_POWER)).min(MOST);
        let distant = self.of_distant(at);
        let (k, chance, rest) = match &self.tree {
            Some(tree) if u >= distant => {
                let u = ((u - distant) / (1.0 - distant)).min(MOST);
                let chosen = tree.choose(at.position, at.normal, u);
                let chance = (1.0 - distant) * chosen.chance;
                (chosen.emitter as usize, chance, chosen.rest)
            }
            _ => {
                let total = self.sums[self.sums.len() - 1];
                let place = u / distant * total;
                let i = self.sums.partition_point(|&sum| sum <= place);
                let k = self.distant[i.min(self.distant.len() - 1)] as usize;
                (k, distant * self.among_distant(k), 0.0)
            }
        };
        let chance = (1.0 - BY_POWER) * chance + BY_POWER * all.fixed[k];
        (k, chance, rest)
    }

    /// The probability of an emitter.
    #[inline(never)]
    pub fn chance(&self, all: &Emitters, at: &Receiver, emitter: usize) -> f32 {
        let distant = self.of_distant(at);
        let chance = match &self.tree {
            Some(tree) if !self.is_distant(emitter) => {
                (1.0 - distant) * tree.chance(emitter, at.position, at.normal)
            }
            _ => distant * self.among_distant(emitter),
        };
        (1.0 - BY_POWER) * chance + BY_POWER * all.fixed[emitter]
    }

    fn is_distant(&self, emitter: usize) -> bool {
        self.distant.binary_search(&(emitter as u32)).is_ok()
    }

    /// The probability of a group.
    pub fn chance_of_group(&self, all: &Emitters, at: &Receiver, group: usize) -> f32 {
        let fixed: f32 = all.members(group).map(|k| all.fixed[k]).sum();
        let leaves = all.groups.len() - self.distant.len();
        let distant = self.of_distant(at);
        let chance = match &self.tree {
            Some(tree) if group < leaves => {
                (1.0 - distant) * tree.chance_of_leaf(group, at.position, at.normal)
            }
            _ => distant * self.among_distant(all.groups[group].members[0] as usize),
        };
        (1.0 - BY_POWER) * chance + BY_POWER * fixed
    }

    /// Finds the emitters that are somewhere whose spheres a ray meets.
    #[inline(always)]
    pub fn meet(&self, x: V3, direction: V3, met: &mut Met) {
        match &self.tree {
            Some(tree) => tree.meet(x, direction, met),
            None => met.emitters.clear(),
        }
    }
}
