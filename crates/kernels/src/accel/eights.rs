//! Trees whose nodes have eight branches: how items are divided among them, and how the numbers of branches are stored
//! in lists.
//!
//! A list holds blocks of eight branches: the first number of all eight, then the second number of all eight, and so
//! on. So a CPU executes a loop over branches with vector instructions.

use std::ops::Range;

use rayon::prelude::*;

use super::LANES;
#[cfg(feature = "gpu")]
use crate::cube::*;
use crate::model::{V3, v3};

/// Returns a number of a branch in a block.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn number(block: &[f32], k: usize, branch: usize) -> f32 {
    block[LANES * k + branch]
}

/// Returns three numbers of a branch, from number `k` on.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn vector(block: &[f32], k: usize, branch: usize) -> V3 {
    v3(
        number(block, k, branch),
        number(block, k + 1, branch),
        number(block, k + 2, branch),
    )
}

/// Sets the numbers of a branch in a block.
pub fn set<const N: usize>(block: &mut [f32], branch: usize, numbers: [f32; N]) {
    for (k, x) in numbers.into_iter().enumerate() {
        block[LANES * k + branch] = x;
    }
}

/// Returns one of eight weights, which are stored as bits in words.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn weight(weights: &[u32], i: usize) -> f32 {
    f32::from_bits(weights[i])
}

#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn sum_of(weights: &[u32]) -> f32 {
    let a = weight(weights, 0) + weight(weights, 4);
    let b = weight(weights, 2) + weight(weights, 6);
    let c = weight(weights, 1) + weight(weights, 5);
    let d = weight(weights, 3) + weight(weights, 7);
    (a + b) + (c + d)
}

/// The rule by which the items of a tree are divided.
pub trait Divide<T>: Sync {
    fn is_leaf(&self, list: &[T]) -> bool;

    /// Returns the cost of a part. The part with the largest cost is divided next.
    fn cost(&self, list: &[T]) -> f32;

    /// Returns the number of items up to which parts are not divided further among the branches of the list's node.
    fn enough(&self, _list: &[T]) -> usize {
        1
    }

    /// Divides a list of more than `enough` items in two.
    fn split<'a>(&self, list: &'a mut [T], enough: usize) -> [&'a mut [T]; 2];

    /// Divides a part of a list, which begins at the index `first` of the list, into up to eight.
    fn parts<'a>(&self, first: usize, list: &'a mut [T]) -> Vec<(usize, &'a mut [T])> {
        let enough = self.enough(list);
        let (mut costs, mut parts) = (vec![self.cost(list)], vec![(first, list)]);
        while parts.len() < LANES {
            let several = (0..parts.len()).filter(|&i| parts[i].1.len() > enough);
            let Some(worst) = several.max_by(|&a, &b| costs[a].total_cmp(&costs[b])) else {
                break;
            };
            costs.swap_remove(worst);
            let (first, part) = parts.swap_remove(worst);
            let [left, right] = self.split(part, enough);
            costs.extend([self.cost(left), self.cost(right)]);
            let middle = first + left.len();
            parts.extend([(first, left), (middle, right)]);
        }
        parts
    }
}

/// Marks a missing child.
pub const NONE: u32 = u32::MAX;
/// The smallest number of items whose parts are divided on several threads.
const MANY: usize = 2048;

/// The nodes and leaves of a divided list.
#[derive(Clone, Default)]
pub struct Shape {
    /// The children of each node, which come after it: 2 × the index of a node, 2 × the index of a leaf + 1, or
    /// [`NONE`].
    pub nodes: Vec<[u32; LANES]>,
    /// The items of each leaf, as indices in the list.
    pub leaves: Vec<Range<usize>>,
}

impl Shape {
    /// Divides a part of a list, which begins at the index `first` of the list, and sorts it by leaves.
    pub fn of<T: Send>(first: usize, list: &mut [T], by: &impl Divide<T>) -> Self {
        if list.len() < MANY {
            let mut shape = Self::default();
            shape.build(first, list, by);
            return shape;
        }
        let parts = by.parts(first, list).into_par_iter();
        let parts: Vec<Self> = parts.map(|(at, part)| Self::of(at, part, by)).collect();
        Self::join(parts)
    }

    /// Joins up to eight shapes below one node, which becomes the first. Their lists are contiguous.
    pub fn join(parts: impl IntoIterator<Item = Self>) -> Self {
        let mut shape = Self::default();
        shape.nodes.push([NONE; LANES]);
        for (slot, mut part) in parts.into_iter().enumerate() {
            let first = [2 * shape.nodes.len() as u32, 2 * shape.leaves.len() as u32];
            let children = part.nodes.as_flattened_mut().iter_mut();
            for child in children.filter(|c| **c != NONE) {
                *child += first[*child as usize % 2];
            }
            shape.nodes[0][slot] = if part.nodes.is_empty() {
                first[1] + 1
            } else {
                first[0]
            };
            shape.nodes.append(&mut part.nodes);
            shape.leaves.append(&mut part.leaves);
        }
        shape
    }

    fn build<T>(&mut self, first: usize, list: &mut [T], by: &impl Divide<T>) -> u32 {
        if by.is_leaf(list) {
            self.leaves.push(first..first + list.len());
            return 2 * (self.leaves.len() as u32 - 1) + 1;
        }
        let at = self.nodes.len();
        self.nodes.push([NONE; LANES]);
        for (slot, (first, part)) in by.parts(first, list).into_iter().enumerate() {
            self.nodes[at][slot] = self.build(first, part, by);
        }
        2 * at as u32
    }
}
