//! A tree over edges. It is built from the top: each node divides its edges into eight parts of nearby edges.

use std::ops::Range;
use std::sync::Arc;
#[cfg(feature = "gpu")]
use std::sync::OnceLock;

use rayon::prelude::*;

use super::Kind;
use super::blocks::Blocks;
use super::bounds::{Bounds, EdgeList};
use super::draw::{LEAF, NODE, Root, put_edge, put_subtree};
use crate::accel::LANES;
#[cfg(feature = "gpu")]
use crate::accel::Parts;
use crate::accel::eights::{Divide, NONE, Shape};
use crate::model::V3;

/// Up to this many edges form a list, in which the weight of each is computed.
const MAX_LIST_EDGES: usize = 64;

/// A tree over edges, or a list of few edges. A [`Root`] reads it.
#[derive(Default)]
pub(super) struct EdgeTree {
    pub shape: Arc<TreeShape>,
    /// The numbers of nodes and leaves, and their bounds. These are empty for renders on GPUs, which compute them.
    nodes: Vec<f32>,
    leaves: Vec<f32>,
    of_leaves: Vec<Bounds>,
    of_nodes: Vec<Bounds>,
    moves: bool,
}

/// The children and edges of a tree over edges. They stay the same while edges only move.
#[derive(Default)]
pub struct TreeShape {
    /// The children of all nodes. It is empty for a list of edges.
    pub children: Vec<u32>,
    /// The edges of all leaves, or [`NONE`].
    pub edges: Vec<u32>,
    #[cfg(feature = "gpu")]
    parts: OnceLock<Parts>,
}

impl TreeShape {
    /// Returns the shape of a tree with edges in its order: the last one if that is the same.
    fn new((which, shape): &Divided, last: &Arc<Self>) -> Arc<Self> {
        let mut edges = vec![NONE; LANES * shape.leaves.len()];
        let leaves = edges.par_chunks_mut(LANES).zip(&shape.leaves);
        leaves.for_each(|(leaf, list)| leaf[..list.len()].copy_from_slice(&which[list.clone()]));
        let children = shape.nodes.as_flattened();
        if last.children == children && last.edges == edges {
            return last.clone();
        }
        Arc::new(Self {
            children: children.to_vec(),
            edges,
            #[cfg(feature = "gpu")]
            parts: OnceLock::new(),
        })
    }

    /// Returns the parts in which a GPU computes the nodes.
    #[cfg(feature = "gpu")]
    pub fn parts(&self) -> &Parts {
        self.parts.get_or_init(|| {
            let node = |child: u32| (child & 1 == 0).then_some(child as usize / 2);
            Parts::new(self.children.as_chunks::<LANES>().0, node)
        })
    }
}

/// A division of mesh edges into leaves. It can be reused as long as the edges of its leaves stay close together.
#[derive(Default)]
pub(super) struct Division {
    /// The identifiers of the edges ([`Edges::name`](super::Edges)).
    names: Vec<[u32; 2]>,
    /// Their indices in the divided list, in the order of the leaves.
    order: Vec<u32>,
    shape: Shape,
    /// The sum of half the areas of the leaves' boxes when the edges were divided.
    cost: f32,
}

/// An edge of a list that is divided.
#[derive(Clone, Copy)]
struct Item {
    middle: V3,
    place: u32,
}

impl Division {
    fn new(source: &EdgeList, list: &[u32]) -> Self {
        let item = |(place, &i): (usize, &u32)| Item {
            middle: source.middle(i),
            place: place as u32,
        };
        let mut items: Vec<Item> = list.par_iter().enumerate().map(item).collect();
        let shape = Shape::of(0, &mut items, &ByPlace);
        let mut this = Self {
            names: list.par_iter().map(|&i| source.edges.name(i)).collect(),
            order: items.iter().map(|item| item.place).collect(),
            shape,
            ..Self::default()
        };
        this.cost = this.cost_of(source, list);
        this
    }

    /// Divides the list again if its edges are others, or if the areas of the leaves' boxes have grown by half.
    fn update(&mut self, source: &EdgeList, list: &[u32]) {
        let is = |(&i, &name): (&u32, &[u32; 2])| source.edges.name(i) == name;
        let same = self.names.len() == list.len() && list.par_iter().zip(&self.names).all(is);
        let moved = || list.par_iter().any(|&i| source.edges.changed[i as usize]);
        if !same || moved() && self.cost_of(source, list) > 1.5 * self.cost {
            *self = Self::new(source, list);
        }
    }

    fn cost_of(&self, source: &EdgeList, list: &[u32]) -> f32 {
        let of_leaf = |leaf: &Range<usize>| {
            let places = self.order[leaf.clone()].iter();
            let middles = places.map(|&place| source.middle(list[place as usize]));
            let (low, high) = around(middles);
            let V3 { x, y, z } = high - low;
            x * y + y * z + z * x
        };
        // The order of this sum does not depend on threads.
        let costs: Vec<f32> = self.shape.leaves.par_iter().map(of_leaf).collect();
        costs.iter().sum()
    }
}

/// Returns the corners of a box around points.
fn around(points: impl Iterator<Item = V3>) -> (V3, V3) {
    points.fold(
        (V3::ONE * f32::MAX, V3::ONE * f32::MIN),
        |(low, high), p| (low.min(p), high.max(p)),
    )
}

/// Edges in the order of leaves, and the shape of the tree over them.
type Divided = (Vec<u32>, Shape);

/// Divides edges. Edges of meshes come first, and their last division is reused if possible.
fn divided(source: &EdgeList, list: &[u32], of_meshes: &mut Division) -> Divided {
    let is_of_mesh = |&i: &u32| source.edges.kind(i as usize) != Kind::Crossing;
    let (meshes, crossings) = list.split_at(list.partition_point(is_of_mesh));
    let own = |division: &Division, list: &[u32]| {
        let order = division.order.iter().map(|&place| list[place as usize]);
        (order.collect(), division.shape.clone())
    };
    if meshes.is_empty() {
        return own(&Division::new(source, crossings), crossings);
    }
    of_meshes.update(source, meshes);
    let all = own(of_meshes, meshes);
    if crossings.is_empty() {
        return all;
    }
    joined([all, own(&Division::new(source, crossings), crossings)])
}

fn joined(parts: [Divided; 2]) -> Divided {
    let [(mut all, first), (mut order, mut second)] = parts;
    for leaf in &mut second.leaves {
        *leaf = leaf.start + all.len()..leaf.end + all.len();
    }
    all.append(&mut order);
    (all, Shape::join([first, second]))
}

impl EdgeTree {
    /// Builds a tree over some edges of a list. Data of the last render, and the division of its mesh edges, are reused if
    /// possible.
    pub fn new(source: &EdgeList, which: &[u32], division: &mut Division, last: Self) -> Self {
        if !Self::is_list(which) {
            return Self::shaped(source, &divided(source, which, division), last);
        }
        let leaves = (0..which.len()).step_by(LANES);
        let shape = Shape {
            leaves: leaves.map(|i| i..which.len().min(i + LANES)).collect(),
            ..Shape::default()
        };
        Self::shaped(source, &(which.to_vec(), shape), last)
    }

    /// Returns whether the edges are so few that they form a list and not a tree.
    pub fn is_list(which: &[u32]) -> bool {
        which.len() <= MAX_LIST_EDGES
    }

    /// Builds a tree over two parts of the edges, in which the tree over the first part alone begins at node 1. The
    /// first part must not be a list.
    pub fn joint(source: &EdgeList, parts: [(&[u32], &mut Division); 2], last: Self) -> Self {
        let parts = parts.map(|(which, division)| divided(source, which, division));
        Self::shaped(source, &joined(parts), last)
    }

    /// Builds a tree of a given shape over edges in its order.
    fn shaped(source: &EdgeList, divided: &Divided, last: Self) -> Self {
        let shape = TreeShape::new(divided, &last.shape);
        let moves = source.scene.velocities.is_some();
        if source.for_gpu {
            return Self {
                shape,
                moves,
                ..Self::default()
            };
        }
        let before = last.shape.clone();
        let mut this = Self {
            shape,
            moves,
            ..last
        };
        let new_leaves = this.set_leaves(source, &before);
        this.set_nodes(&before, &new_leaves);
        this
    }

    /// Computes leaves and returns which are new. Leaves of the last render are kept if they have the same edges and none
    /// has changed.
    fn set_leaves(&mut self, source: &EdgeList, before: &TreeShape) -> Vec<bool> {
        let (count, numbers) = (self.shape.edges.len() / LANES, LANES * LEAF);
        let mut known = &before.edges[..];
        if self.of_leaves.len() != count {
            self.leaves = vec![0.0; numbers * count];
            self.of_leaves = vec![Bounds::none(); count];
            known = &[];
        }
        let blocks = self.leaves.par_chunks_mut(numbers).zip(&mut self.of_leaves);
        let blocks = blocks.zip(self.shape.edges.par_chunks(LANES));
        let new_leaves = blocks.enumerate().map(|(leaf, ((block, bounds), edges))| {
            let list = || edges.iter().copied().filter(|&i| i != NONE);
            let last = known.get(LANES * leaf..LANES * (leaf + 1));
            if last == Some(edges) && !list().any(|i| source.edges.changed[i as usize]) {
                return false;
            }
            block.fill(0.0);
            let mut all = Bounds::none();
            for (lane, i) in list().enumerate() {
                let (edge, velocity) = source.seen(i);
                put_edge(block, lane, &edge, velocity);
                all.add_edge(&edge, velocity);
            }
            *bounds = all.over_leaf(block, 0, 1);
            true
        });
        new_leaves.collect()
    }

    /// Computes the nodes above leaves that are new, or all nodes if they have other children than before.
    fn set_nodes(&mut self, before: &TreeShape, new_leaves: &[bool]) {
        let shape = &self.shape;
        let children = shape.children.as_chunks::<LANES>().0;
        let count = children.len();
        let mut new_nodes = vec![false; count];
        if self.of_nodes.len() != count || before.children != shape.children {
            self.nodes = vec![0.0; LANES * NODE * count];
            self.of_nodes = vec![Bounds::none(); count];
            new_nodes.fill(true);
        }
        let mut parts = Vec::with_capacity(LANES);
        // Children come after their parents.
        let blocks = self.nodes.chunks_mut(LANES * NODE).zip(children);
        for (at, (block, children)) in blocks.enumerate().rev() {
            let children = children.iter().enumerate().filter(|(_, c)| **c != NONE);
            let is_new = |(_, &child): (usize, &u32)| {
                [&new_nodes[..], new_leaves][child as usize % 2][child as usize / 2]
            };
            if !new_nodes[at] && !children.clone().any(is_new) {
                continue;
            }
            new_nodes[at] = true;
            parts.clear();
            for (i, &child) in children {
                let list = [&self.of_nodes, &self.of_leaves][child as usize % 2];
                let own = list[child as usize / 2];
                put_subtree(block, i, &own.subtree());
                parts.push(own);
            }
            self.of_nodes[at] = Bounds::joined(&parts);
        }
    }

    /// Returns the part of the tree below a node, or the whole list.
    pub fn root(&self, node: u32) -> Root<'_> {
        let is_list = self.shape.children.is_empty();
        Root {
            nodes: Blocks::new(&self.nodes),
            children: &self.shape.children,
            leaves: Blocks::new(&self.leaves),
            edges: &self.shape.edges,
            start: if is_list { 1 } else { 2 * node },
            count: if is_list {
                (self.shape.edges.len() / LANES) as u32
            } else {
                1
            },
            has_nodes: !is_list,
            moves: self.moves,
        }
    }
}

/// Divides edges by position so that all leaves but one are full.
struct ByPlace;

impl Divide<Item> for ByPlace {
    fn is_leaf(&self, list: &[Item]) -> bool {
        list.len() <= LANES
    }

    fn cost(&self, list: &[Item]) -> f32 {
        list.len() as f32
    }

    /// Returns the number of edges of the smallest full subtree of which eight hold the whole list.
    fn enough(&self, list: &[Item]) -> usize {
        let mut most = LANES;
        while most * LANES < list.len() {
            most *= LANES;
        }
        most
    }

    /// Splits edges along the axis on which their middles have the largest extent. The first part is half of them,
    /// rounded up to a multiple of `enough`.
    fn split<'a>(&self, part: &'a mut [Item], enough: usize) -> [&'a mut [Item]; 2] {
        let (low, high) = around(part.iter().map(|item| item.middle));
        let size = (high - low).to_array();
        let axis = (0..3)
            .max_by(|&a, &b| size[a].total_cmp(&size[b]))
            .unwrap_or(0);
        let half = (part.len() / 2).next_multiple_of(enough);
        part.select_nth_unstable_by(half, |a, b| {
            let along = |item: &Item| item.middle.to_array()[axis];
            along(a).total_cmp(&along(b)).then(a.place.cmp(&b.place))
        });
        part.split_at_mut(half).into()
    }
}
