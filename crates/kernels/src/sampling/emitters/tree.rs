//! The choice of one of many emitters, by a tree over emitters with a position, beside directional lights.
//! Probabilities are about in proportion to the light that the emitters bring to a point (Conty Estevez and Kulla
//! 2018).

#![allow(
    clippy::collapsible_if,
    clippy::manual_clamp,
    clippy::needless_range_loop,
    reason = "the language of kernels has no other form"
)]

use super::BY_POWER;
use super::fixed::{Chosen, Fixed};
use crate::accel::LANES;
use crate::accel::eights::{NONE, number, sum_of, vector};
use crate::cube::*;
use crate::model::choice::{MAX_UNIFORM, is_positive};
use crate::model::light_bounds::{Axes, Sphere};
use crate::model::lists::first_over;
use crate::model::{V3, v3};

/// A tree over emitters with a position, and directional lights. A share [`BY_POWER`] of choices is by power, at any
/// point.
#[cfg_attr(feature = "gpu", derive(CubeType))]
#[derive(Clone, Copy)]
pub struct LightTree<'a> {
    /// A block for each node, with [`BRANCH`] numbers for each of eight branches. One more block has all emitters as
    /// its first branch.
    pub branches: &'a [f32],
    /// [`OF_NODE`] words for each node: its children (nodes, or the emitters of a leaf), its parent (or [`NONE`]), its
    /// branch of the parent, and whether it is a leaf.
    pub nodes: &'a [u32],
    pub count: u32,
    /// Two words for each emitter: its node and branch, or [`NONE`] and its index among the directional lights.
    pub places: &'a [u32],
    pub distant: &'a [u32],
    pub distant_count: u32,
    /// Running sums of the strengths of directional lights, and moments of the directions towards them.
    pub sums: &'a [f32],
    pub axes: &'a [f32],
    /// Probabilities of emitters that do not depend on the point.
    pub fixed: Fixed<'a>,
}

/// The numbers of a branch: center, radius, axes, power.
pub(super) const BRANCH: usize = 14;
pub(super) const OF_NODE: usize = 11;
pub(super) const PARENT: usize = 8;
pub(super) const IS_LEAF: usize = 10;

#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn sphere(block: &[f32], branch: usize) -> Sphere {
    Sphere {
        center: vector(block, 0, branch),
        radius: number(block, 3, branch),
        axes: Axes {
            mean: vector(block, 4, branch),
            squares: vector(block, 7, branch),
            products: vector(block, 10, branch),
        },
        power: number(block, 13, branch),
    }
}

impl Sphere {
    pub(super) fn numbers(&self) -> [f32; BRANCH] {
        let mut all = [self.radius; BRANCH];
        all[..3].copy_from_slice(&self.center.to_array());
        all[4..13].copy_from_slice(&self.axes.numbers());
        all[13] = self.power;
        all
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl<'a> LightTree<'a> {
    /// Computes weights of a node's branches and returns their sum. A weight is an estimate of the point's irradiance.
    /// If all are 0, the weights are the powers.
    #[inline(always)]
    fn weigh(&self, node: u32, x: V3, normal: V3, weights: &mut [u32]) -> f32 {
        let block = self.block(node);
        for i in 0..LANES {
            let branch = sphere(block, i);
            let mut own = 0.0f32;
            if branch.power > 0.0 {
                own = branch.irradiance(x, normal);
            }
            weights[i] = own.to_bits();
        }
        let mut total = sum_of(&weights[..LANES]);
        let known = is_positive(total);
        if !known {
            for i in 0..LANES {
                weights[i] = number(block, 13, i).to_bits();
            }
            total = sum_of(&weights[..LANES]);
        }
        total
    }

    #[inline(always)]
    fn block(&self, node: u32) -> &[f32] {
        let first = LANES * BRANCH * node as usize;
        &self.branches[first..first + LANES * BRANCH]
    }

    /// Returns a word of a node: a child, or one of the words after the children.
    #[inline(always)]
    pub fn word(&self, node: u32, k: usize) -> u32 {
        self.nodes[OF_NODE * node as usize + k]
    }

    /// Returns whether a ray meets the sphere of a branch.
    #[cfg(feature = "gpu")]
    pub fn is_met(&self, node: u32, branch: u32, x: V3, direction: V3) -> bool {
        sphere(self.block(node), branch as usize).is_met(x, direction)
    }

    #[inline(always)]
    pub fn is_leaf(&self, node: u32) -> bool {
        self.word(node, IS_LEAF) != 0
    }

    /// Returns the parent of a node, or [`NONE`].
    #[inline(always)]
    pub fn parent(&self, node: u32) -> u32 {
        self.word(node, PARENT)
    }

    #[inline(always)]
    pub fn branch_of_parent(&self, node: u32) -> u32 {
        self.word(node, PARENT + 1)
    }

    /// Returns the probability of choosing among the directional lights.
    #[inline(always)]
    pub fn share_of_distant(&self, x: V3, normal: V3) -> f32 {
        let mut share = 1.0f32;
        if self.count > 0 {
            share = 0.0f32;
            if self.distant_count > 0 {
                let axes = Axes {
                    mean: v3(self.axes[0], self.axes[1], self.axes[2]),
                    squares: v3(self.axes[3], self.axes[4], self.axes[5]),
                    products: v3(self.axes[6], self.axes[7], self.axes[8]),
                };
                let strength = self.sums[(self.distant_count - 1) as usize];
                let distant = strength * axes.facing(normal, 0.0);
                let near = sphere(self.block(self.count), 0).irradiance(x, normal);
                // Both estimates are 0, so either is possible.
                share = 0.5f32;
                if distant + near > 0.0 {
                    share = distant / (distant + near);
                }
            }
        }
        share
    }

    /// Chooses an emitter with a random number. `share` is the probability of directional lights, and `weights` has
    /// room for eight words.
    #[inline(always)]
    pub fn choose(&self, u: f32, share: f32, x: V3, normal: V3, weights: &mut [u32]) -> Chosen {
        let mut chosen = Chosen {
            emitter: 0u32,
            chance: 1.0f32,
            rest: 0.0f32,
        };
        if u < BY_POWER {
            chosen = self.fixed.choose(min(u / BY_POWER, MAX_UNIFORM));
            chosen.chance = self.chance(chosen.emitter, share, x, normal, weights);
        } else {
            let u = min((u - BY_POWER) / (1.0 - BY_POWER), MAX_UNIFORM);
            if self.count > 0 && u >= share {
                let rest = min((u - share) / (1.0 - share), MAX_UNIFORM);
                chosen = self.choose_near(rest, x, normal, weights);
                chosen.chance *= 1.0 - share;
            } else {
                let place = u / share * self.sums[(self.distant_count - 1) as usize];
                let i = first_over(self.sums, 0u32, self.distant_count, 1u32, place);
                chosen.emitter = self.distant[i as usize];
                chosen.chance = share * self.among_distant(i);
            }
            let fixed = self.fixed.chances[chosen.emitter as usize];
            chosen.chance = (1.0 - BY_POWER) * chosen.chance + BY_POWER * fixed;
        }
        chosen
    }

    /// Chooses an emitter with a position.
    #[inline(always)]
    fn choose_near(&self, u: f32, x: V3, normal: V3, weights: &mut [u32]) -> Chosen {
        let mut rest = u;
        let mut chance = 1.0f32;
        let mut node = 0u32;
        let mut going = true;
        while going {
            let total = self.weigh(node, x, normal, weights);
            let target = rest * total;
            let mut branch = 0usize;
            let mut before = 0.0f32;
            let mut passed = 0.0f32;
            let mut i = 0usize;
            while i < LANES {
                let own = f32::from_bits(weights[i]);
                if own > 0.0 {
                    branch = i;
                    before = passed;
                    passed += own;
                    if target < passed {
                        i = LANES;
                    }
                }
                i += 1;
            }
            let own = f32::from_bits(weights[branch]);
            chance *= own / total;
            rest = min(max((target - before) / own, 0.0), MAX_UNIFORM);
            going = !self.is_leaf(node);
            node = self.word(node, branch);
        }
        Chosen {
            emitter: node,
            chance,
            rest,
        }
    }

    /// Returns the probability of a directional light among the directional lights.
    #[inline(always)]
    fn among_distant(&self, i: u32) -> f32 {
        let mut before = 0.0f32;
        if i > 0 {
            before = self.sums[(i - 1) as usize];
        }
        (self.sums[i as usize] - before) / self.sums[(self.distant_count - 1) as usize]
    }

    /// Returns the probability of an emitter.
    #[inline(always)]
    pub fn chance(&self, k: u32, share: f32, x: V3, normal: V3, weights: &mut [u32]) -> f32 {
        let by_place = self.chance_by_place(k, false, share, x, normal, weights);
        (1.0 - BY_POWER) * by_place + BY_POWER * self.fixed.chances[k as usize]
    }

    /// Returns the probability of an emitter, or of the leaf that contains it, in a choice that is not by power.
    #[inline(always)]
    pub fn chance_by_place(
        &self,
        k: u32,
        of_leaf: bool,
        share: f32,
        x: V3,
        normal: V3,
        weights: &mut [u32],
    ) -> f32 {
        let mut node = self.places[2 * k as usize];
        let mut branch = self.places[2 * k as usize + 1];
        let mut chance = share;
        if node == NONE {
            chance *= self.among_distant(branch);
        } else {
            chance = 1.0 - share;
            let mut skips = of_leaf;
            while node != NONE {
                if !skips {
                    let total = self.weigh(node, x, normal, weights);
                    chance *= f32::from_bits(weights[branch as usize]) / total;
                }
                skips = false;
                branch = self.branch_of_parent(node);
                node = self.parent(node);
            }
        }
        chance
    }
}

impl<'a> LightTree<'a> {
    /// Returns an empty tree, for scenes whose emitters are chosen otherwise.
    #[inline(always)]
    pub fn none(fixed: Fixed<'a>) -> Self {
        Self {
            branches: &[],
            nodes: &[],
            count: 0,
            places: &[],
            distant: &[],
            distant_count: 0,
            sums: &[],
            axes: &[],
            fixed,
        }
    }

    /// Returns which branches of a node a ray meets.
    #[inline(always)]
    pub fn met(&self, node: u32, x: V3, direction: V3) -> [bool; LANES] {
        let block = self.block(node);
        let mut met = [false; LANES];
        for i in 0..LANES {
            met[i] = sphere(block, i).is_met(x, direction);
        }
        met
    }
}
