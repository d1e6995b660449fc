//! The tree as GPUs traverse it: nodes of two boxes.

use std::ops::Range;

use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;

use super::hierarchy::Hierarchy;
use super::triangle::HostTriangle;
use super::wide::ROUNDING;

/// A tree of nodes with both children's boxes. A child is a node, or the bit 2³¹ and a leaf.
#[derive(Default)]
pub(crate) struct GpuTree {
    pub root: u32,
    /// Corners of the first and of the second child's box.
    pub boxes: Vec<[f32; 12]>,
    pub children: Vec<[u32; 2]>,
    /// First and number of triangles of each leaf.
    pub leaves: Vec<[u32; 2]>,
    /// Numbers of triangles, leaf by leaf, and how rays meet them.
    pub triangles: Vec<u32>,
    pub hits: Vec<[f32; HIT_STRIDE as usize]>,
    /// Nodes that a traversal has to remember at most.
    pub depth: usize,
}

/// Triangles of a leaf at most: a thread meets them one by one.
const OF_LEAF: usize = 4;
/// A child that is a leaf.
pub(crate) const LEAF: u32 = 1 << 31;
/// Numbers of a triangle as rays meet it.
pub(crate) const HIT_STRIDE: u32 = 20;

impl Hierarchy {
    /// The tree as GPUs traverse it; without nodes where there are few triangles.
    pub(crate) fn for_gpu(&self) -> GpuTree {
        let mut tree = GpuTree::default();
        match &self.built {
            Some(built) => {
                let mut nodes = self.fitted(built);
                tree.triangles = std::mem::take(&mut nodes.primitive_indices);
                tree.root = tree.add(&nodes, &self.triangles, 0, 1);
            }
            None => tree.triangles = (0..self.triangles.len() as u32).collect(),
        }
        let met = |&k: &u32| self.triangles[k as usize].as_met();
        tree.hits = tree.triangles.iter().map(met).collect();
        tree
    }

    /// The binary tree with boxes about the triangles.
    fn fitted(&self, built: &Bvh2) -> Bvh2 {
        let mut nodes = built.clone();
        let primitives = std::mem::take(&mut nodes.primitive_indices);
        for node in nodes.nodes.iter_mut().filter(|n| n.is_leaf()) {
            let first = node.first_index as usize;
            let list = &primitives[first..first + node.prim_count as usize];
            let boxes = list.iter().map(|&k| self.triangles[k as usize].swept());
            node.set_aabb(boxes.fold(Aabb::INVALID, |a, b| a.union(&b)));
        }
        nodes.primitive_indices = primitives;
        nodes.refit_all();
        nodes
    }
}

impl GpuTree {
    fn add(&mut self, nodes: &Bvh2, triangles: &[HostTriangle], at: usize, depth: usize) -> u32 {
        let node = &nodes.nodes[at];
        let first = node.first_index as usize;
        if node.is_leaf() {
            return self.add_leaf(triangles, first..first + node.prim_count as usize, depth);
        }
        let children = [first, first + 1];
        let index = self.add_node(children.map(|child| *nodes.nodes[child].aabb()));
        self.children[index] = children.map(|child| self.add(nodes, triangles, child, depth + 1));
        index as u32
    }

    /// Adds triangles of a leaf, which is divided where it has many.
    fn add_leaf(&mut self, triangles: &[HostTriangle], list: Range<usize>, depth: usize) -> u32 {
        self.depth = self.depth.max(depth);
        if list.len() <= OF_LEAF {
            self.leaves.push([list.start as u32, list.len() as u32]);
            return LEAF | (self.leaves.len() as u32 - 1);
        }
        let of = |k: &u32| triangles[*k as usize].swept();
        let all = &mut self.triangles[list.clone()];
        let centres = all.iter().map(|k| of(k).center());
        let centres = centres.fold(Aabb::INVALID, |mut all, centre| *all.extend(centre));
        let axis = centres.diagonal().max_position();
        all.sort_by(|a, b| of(a).center()[axis].total_cmp(&of(b).center()[axis]));
        let middle = list.start + list.len() / 2;
        let halves = [list.start..middle, middle..list.end];
        let boxes = halves.clone().map(|half| {
            let half = self.triangles[half].iter().map(of);
            half.fold(Aabb::INVALID, |a, b| a.union(&b))
        });
        let index = self.add_node(boxes);
        self.children[index] = halves.map(|half| self.add_leaf(triangles, half, depth + 1));
        index as u32
    }

    /// Adds a node without its children.
    fn add_node(&mut self, boxes: [Aabb; 2]) -> usize {
        let corners = boxes.map(|b| [b.min.to_array(), b.max.to_array()]);
        let numbers = corners.as_flattened().as_flattened();
        self.boxes.push(std::array::from_fn(|i| numbers[i]));
        self.children.push([0; 2]);
        self.boxes.len() - 1
    }
}

impl HostTriangle {
    /// Normal and plane, the lines of the borders as distances that are positive inside, the rounding of
    /// these, and the displacement over the shutter; zeros for a triangle that is never hit.
    fn as_met(&self) -> [f32; HIT_STRIDE as usize] {
        let mut numbers = [0.0; HIT_STRIDE as usize];
        if self.valid {
            let plane = self.normal.dot(self.corners[0]);
            let all = std::iter::once((self.normal, plane)).chain(self.lines_in_space());
            let mut slack = 0.0f32;
            for (i, (across, offset)) in all.enumerate() {
                numbers[4 * i..4 * i + 3].copy_from_slice(&across.as_vec3().to_array());
                numbers[4 * i + 3] = offset as f32;
                if i > 0 {
                    slack = slack.max(ROUNDING * offset.abs() as f32);
                }
            }
            numbers[16] = slack;
            numbers[17..].copy_from_slice(&self.velocity.as_vec3().to_array());
        }
        numbers
    }
}
