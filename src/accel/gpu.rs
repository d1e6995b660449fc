//! The tree as GPUs traverse it: nodes of two boxes.

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
                let nodes = self.fitted(built);
                tree.root = tree.add(&nodes, 0, 1);
                tree.triangles = nodes.primitive_indices;
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
    fn add(&mut self, nodes: &Bvh2, at: usize, depth: usize) -> u32 {
        let node = &nodes.nodes[at];
        self.depth = self.depth.max(depth);
        if node.is_leaf() {
            self.leaves.push([node.first_index, node.prim_count]);
            return LEAF | (self.leaves.len() as u32 - 1);
        }
        let first = node.first_index as usize;
        let mut boxes = [0.0; 12];
        for (side, child) in [first, first + 1].into_iter().enumerate() {
            let aabb = nodes.nodes[child].aabb();
            boxes[6 * side..6 * side + 3].copy_from_slice(&aabb.min.to_array());
            boxes[6 * side + 3..6 * side + 6].copy_from_slice(&aabb.max.to_array());
        }
        let index = self.boxes.len();
        self.boxes.push(boxes);
        self.children.push([0; 2]);
        let children = [first, first + 1].map(|child| self.add(nodes, child, depth + 1));
        self.children[index] = children;
        index as u32
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
