//! Edges and the trees over them as lists of numbers, for kernels of GPUs.

use super::node::{LEAF_NUMBERS, Leaf, NODE_NUMBERS, Node};
use super::{EdgeSets, EdgeTree, Kind, Moving};
use crate::accel::LANES;

/// All edges and both trees.
#[derive(Default)]
pub(crate) struct FlatEdges {
    /// a and b − a of each edge.
    pub ends: Vec<[f32; 6]>,
    /// Of each edge: four faces, four rows of vertices, the object, and 1 for a crossing, 2 for one whose line moves while
    /// the shutter is open.
    pub numbers: Vec<[u32; 10]>,
    /// A tree over all, then that over those that move, unless that is all.
    pub trees: Vec<FlatTree>,
}

/// A tree over edges, or a list of leaves if it has no nodes.
#[derive(Default)]
pub(crate) struct FlatTree {
    pub nodes: Vec<[f32; NODE_NUMBERS]>,
    /// The child of each lane of a node: twice the index of a node, or of a leaf plus one.
    pub children: Vec<u32>,
    pub leaves: Vec<[f32; LEAF_NUMBERS]>,
    /// The edge of each lane of a leaf.
    pub edges: Vec<u32>,
}

impl FlatTree {
    fn new(tree: &EdgeTree) -> Self {
        Self::of(&tree.nodes, &tree.leaves, 0)
    }

    /// Of some nodes, the children of which are counted from a node on.
    fn of(nodes: &[Node], leaves: &[Leaf], first: u32) -> Self {
        let mut flat = Self::default();
        for node in nodes {
            flat.nodes.extend((0..LANES).map(|i| node.lane(i)));
            let child = |child: u32| match child {
                u32::MAX => child,
                leaf if leaf % 2 == 1 => leaf,
                node => node - 2 * first,
            };
            flat.children.extend(node.child.map(child));
        }
        for leaf in leaves {
            flat.leaves.extend((0..LANES).map(|i| leaf.lane(i)));
            flat.edges.extend(leaf.edge);
        }
        flat
    }
}

impl EdgeSets {
    /// Whether a line of a crossing moves while the shutter is open.
    pub(crate) fn any_apart(&self) -> bool {
        self.edges.iter().any(|e| e.apart)
    }

    pub(crate) fn flat(&self) -> FlatEdges {
        let ends = self.edges.iter().map(|e| {
            let (a, along) = (e.a.to_array(), e.along.to_array());
            [a[0], a[1], a[2], along[0], along[1], along[2]]
        });
        let numbers = self.edges.iter().map(|e| {
            let [f, g, h, i] = e.faces;
            let [[a, b], [c, d]] = e.rows;
            let crossing = u32::from(e.kind == Kind::Crossing) + u32::from(e.apart);
            [f, g, h, i, a, b, c, d, e.object, crossing]
        });
        FlatEdges {
            ends: ends.collect(),
            numbers: numbers.collect(),
            trees: std::iter::once(FlatTree::new(&self.all))
                .chain(self.moving.flat(&self.all))
                .collect(),
        }
    }
}

impl Moving {
    fn flat(&self, all: &EdgeTree) -> Option<FlatTree> {
        match self {
            Self::All => None,
            Self::Own(own) => Some(FlatTree::new(own)),
            Self::Part([nodes, leaves]) => {
                let nodes = &all.nodes[1..1 + nodes];
                Some(FlatTree::of(nodes, &all.leaves[..*leaves], 1))
            }
        }
    }
}
