//! The binary tree over boxes of triangles. Its build time is about linear, however the boxes lie.

use std::collections::HashMap;

use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::PlocBuilder;
use obvhs::{Boundable, BvhBuildParams};

use super::simd::LANES;
use super::triangle::HostTriangle;

/// Boxes count as crowded where a ray through a node's box meets this many of them.
const CROWD: f32 = 1024.0;

/// The number of triangles that stay in the tree out of any number of identical ones.
const COPIES: u32 = 16;

const PARAMETERS: BvhBuildParams = BvhBuildParams {
    max_prims_per_leaf: LANES as u32,
    ..BvhBuildParams::medium_build()
};

/// Returns whether a triangle may be left out if others are identical to it. `None` keeps all.
pub type Spare<'a> = Option<&'a (dyn Fn(usize) -> bool + Sync)>;

struct Swept(Aabb);

impl Boundable for Swept {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

/// Returns a tree over triangles, and whether it contains all of them. If the boxes are crowded, the first [`COPIES`]
/// of identical triangles stay, and the others are left out if they may be: a ray would have to test each.
pub(super) fn tree(triangles: &[HostTriangle], spare: Spare) -> (Bvh2, bool) {
    let boxes: Vec<Swept> = triangles.iter().enumerate().map(apart).collect();
    let tree = cluster(&boxes);
    if !is_crowded(&tree) {
        return (optimized(tree), true);
    }
    let Some(kept) = spare.and_then(|spare| without_copies(triangles, spare)) else {
        // The optimization would compare each of these boxes with all of them.
        return (collapsed(tree), true);
    };
    let boxes: Vec<Swept> = (kept.iter())
        .map(|&k| apart((k as usize, &triangles[k as usize])))
        .collect();
    let tree = cluster(&boxes);
    let mut tree = match is_crowded(&tree) {
        true => collapsed(tree),
        false => optimized(tree),
    };
    for k in &mut tree.primitive_indices {
        *k = kept[*k as usize];
    }
    (tree, false)
}

fn cluster(boxes: &[Swept]) -> Bvh2 {
    PlocBuilder::with_capacity(boxes.len()).build(
        PARAMETERS.ploc_search_distance,
        boxes,
        (0..boxes.len() as u32).collect(),
        PARAMETERS.sort_precision,
        PARAMETERS.search_depth_threshold,
    )
}

fn collapsed(mut tree: Bvh2) -> Bvh2 {
    let (most, cost) = (
        PARAMETERS.max_prims_per_leaf,
        PARAMETERS.collapse_traversal_cost,
    );
    collapse(&mut tree, most, cost);
    tree
}

/// The same steps as `obvhs::bvh2::builder::build_bvh2`.
fn optimized(mut tree: Bvh2) -> Bvh2 {
    let ratio = PARAMETERS.reinsertion_batch_ratio;
    let after = ratio * PARAMETERS.post_collapse_reinsertion_batch_ratio_multiplier;
    let mut optimizer = ReinsertionOptimizer::default();
    optimizer.run(&mut tree, ratio, None);
    let mut tree = collapsed(tree);
    optimizer.run(&mut tree, after, None);
    tree
}

/// Returns whether boxes lie on top of each other anywhere. A ray through a box meets a box inside it with a
/// probability that is the ratio of their areas.
fn is_crowded(tree: &Bvh2) -> bool {
    if (tree.primitive_indices.len() as f32) < CROWD {
        return false;
    }
    // Σ half areas of the boxes of the triangles below each node.
    let mut sums = vec![0.0f32; tree.nodes.len()];
    let mut stack = vec![(0usize, false)];
    while let Some((i, ready)) = stack.pop() {
        let node = &tree.nodes[i];
        let area = node.aabb().half_area();
        if node.is_leaf() {
            sums[i] = area * node.prim_count as f32;
            continue;
        }
        let first = node.first_index as usize;
        if ready {
            sums[i] = sums[first] + sums[first + 1];
            if sums[i] > CROWD * area {
                return true;
            }
        } else {
            stack.extend([(i, true), (first, false), (first + 1, false)]);
        }
    }
    false
}

/// Returns the triangles that remain when copies that may be left out are removed, except the first [`COPIES`]. Returns
/// `None` if all remain.
fn without_copies(triangles: &[HostTriangle], spare: impl Fn(usize) -> bool) -> Option<Vec<u32>> {
    let mut counts: HashMap<[u64; 12], u32> = HashMap::new();
    let stays = |&k: &u32| {
        let t = &triangles[k as usize];
        if !spare(k as usize) {
            return true;
        }
        let corners = t.corners.map(|c| c.to_array().map(f64::to_bits));
        // The key does not depend on which corner comes first. The winding matters, because it defines the front.
        let least = (0..3).min_by_key(|&i| corners[i]).unwrap_or(0);
        let velocity = t.velocity.to_array().map(f64::to_bits);
        let rows = [
            corners[least],
            corners[(least + 1) % 3],
            corners[(least + 2) % 3],
            velocity,
        ];
        let key: [u64; 12] = std::array::from_fn(|i| rows[i / 3][i % 3]);
        let count = counts.entry(key).or_insert(0);
        *count += 1;
        *count <= COPIES
    };
    let kept: Vec<u32> = (0..triangles.len() as u32).filter(stays).collect();
    (kept.len() < triangles.len()).then_some(kept)
}

/// Returns the box of a triangle, enlarged by tiny and different amounts on all sides. Among identical boxes, the
/// builder would join one pair per round.
fn apart((i, t): (usize, &HostTriangle)) -> Swept {
    let own = t.swept();
    let size = own.min.abs().max(own.max.abs()).max_element();
    let most = if size.is_finite() {
        size * 4e-6 + 1e-12
    } else {
        0.0
    };
    let mut state = i as u32;
    let mut random = || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
        ((word >> 22) ^ word) as f32 / 4_294_967_296.0
    };
    let mut by = || Vec3A::new(random(), random(), random()) * most;
    Swept(Aabb::new(own.min - by(), own.max + by()))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn triangle(x: f64, y: f64) -> HostTriangle {
        let at = DVec3::new(x, y, 0.0);
        HostTriangle::new([at, at + DVec3::X, at + DVec3::Y], DVec3::ZERO, true)
    }

    /// Returns the triangles of a tree's leaves, sorted.
    fn triangles_of_leaves(tree: &Bvh2) -> Vec<u32> {
        let leaves = tree.nodes.iter().filter(|n| n.is_leaf());
        let of_leaf = |n: &obvhs::bvh2::node::Bvh2Node| {
            let first = n.first_index as usize;
            tree.primitive_indices[first..first + n.prim_count as usize].to_vec()
        };
        let mut all: Vec<u32> = leaves.flat_map(of_leaf).collect();
        all.sort_unstable();
        all
    }

    #[test]
    fn copies_are_left_out_where_they_may_be() {
        let grid = (0..900).map(|i| triangle(f64::from(i % 30), f64::from(i / 30)));
        let all: Vec<HostTriangle> = grid
            .clone()
            .chain((0..5000).map(|_| triangle(3.0, 4.0)))
            .collect();
        // Every second one must stay.
        let spare = |k: usize| k.is_multiple_of(2);
        let (kept, complete) = tree(&all, Some(&spare));
        assert!(!complete);
        // Of the triangles at one place, the one of the grid is the first.
        let copies = (0..all.len() as u32).filter(|&k| k >= 900 || k == 4 * 30 + 3);
        let (free, bound): (Vec<u32>, Vec<u32>) = copies.partition(|&k| spare(k as usize));
        let mut wanted: Vec<u32> = (0..900).filter(|&k| k != 4 * 30 + 3).collect();
        wanted.extend(free.into_iter().take(COPIES as usize).chain(bound));
        wanted.sort_unstable();
        assert!(
            triangles_of_leaves(&kept) == wanted,
            "{}",
            triangles_of_leaves(&kept).len()
        );
        // All stay without `spare`, and so do triangles that lie side by side.
        let (whole, complete) = tree(&all, None);
        assert!(complete && triangles_of_leaves(&whole).len() == all.len());
        let side: Vec<HostTriangle> = (0..5000).map(|i| triangle(f64::from(i), 0.0)).collect();
        let (whole, complete) = tree(&side, Some(&spare));
        assert!(complete && triangles_of_leaves(&whole).len() == side.len());
    }
}
