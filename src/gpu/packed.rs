//! Views packed into two buffers, one of floats and one of words. The views of a group use the same kernels, and each
//! group has its own buffers. The words begin with a header for each view, which stores where the lists of its
//! [`Scene`] begin. Views share lists: each list is stored once.

use std::collections::HashMap;
use std::sync::Arc;

use rayon::prelude::*;

use super::buffers::{Buffers, Made};
use super::edge_nodes::BOUNDS;
use super::placed::{Row, ViewPlaces};
use super::plan::Plan;
use super::sums::Places;
use crate::device::stage;
use softray_kernels::accel::{GpuTree, LANES, OF_NODE, Parts, hit_stride};
use softray_kernels::kernel::{LEAF, NODE, TreeShape, View};
use softray_kernels::model::triangle::NUMBERS;
use softray_kernels::trace::{Derivatives, Features, HEADER, HeaderWord, OF_SLOT, Scene};

/// Number of words of a tree over edges in [`Scene::edge_trees`]: the starts of its leaves and of their edges, the child
/// at which a draw starts, and the number of children at which it starts.
pub(super) const OF_TREE: u32 = 4;

/// Maximum number of views in a group.
const VIEWS: usize = 64;
/// Approximate maximum number of floats of a group with several views.
const OF_GROUP: usize = 1 << 24;

/// A group of views that kernels trace together, in buffers.
pub(crate) struct Packed {
    pub buffers: Arc<Buffers>,
    /// The number of these buffers, also of a group without them.
    number: u64,
    pub views: usize,
    pub features: Features,
    pub derivatives: Derivatives,
    pub sums: Places,
}

/// Packs views in groups that use the same kernels. Returns the indices of the views of each group, and the packed
/// group. The buffers of the last render are reused where possible. The device places tensors of a `row`, if there is
/// one.
pub(crate) fn pack(
    all: &[ViewPlaces],
    row: Option<&Row>,
    mut last: impl Iterator<Item = Buffers>,
) -> Vec<(Vec<usize>, Packed)> {
    let views: Vec<&View> = all.iter().map(|v| v.0).collect();
    let views = &views[..];
    // Views of one scene share the lists of the first such view.
    let mut known = HashMap::new();
    let of_view: Vec<usize> = (0..views.len())
        .map(|v| {
            let edges = views[v].edge_sets.as_ref().map(Arc::as_ptr);
            *known
                .entry((Arc::as_ptr(&views[v].scene), edges))
                .or_insert(v)
        })
        .collect();
    let pack = |v: usize| (of_view[v] == v).then(|| OfScene::new(views[v]));
    let scenes: Vec<Option<OfScene>> = (0..views.len()).into_par_iter().map(pack).collect();
    let slots = stage("edges on films", || -> Vec<Slots> {
        views.par_iter().map(|view| Slots::new(view)).collect()
    });
    let scene = |v: usize| {
        scenes[of_view[v]]
            .as_ref()
            .expect("the first view packs it")
    };
    let kernels = |v: usize| {
        let features = Features {
            // Kernels hold directions to maps, which keeps them short.
            turns_to_map: false,
            boxes: !scene(v).tree.nodes.is_empty(),
            // Rounded up, so that kernels can be reused after the tree has grown. The first place marks the end.
            stack: (scene(v).tree.depth + 1).next_power_of_two().max(64),
            ..views[v].features
        };
        (features, views[v].wanted.of)
    };
    let mut groups = Vec::new();
    for list in alike(views.len(), kernels) {
        let (features, derivatives) = kernels(list[0]);
        let mut list = &list[..];
        while !list.is_empty() {
            let (mut past, mut numbers) = (0, 0);
            while past < list.len().min(VIEWS) {
                let v = list[past];
                if !list[..past].iter().any(|&w| of_view[w] == of_view[v]) {
                    numbers += scene(v).numbers(views[v]);
                }
                if past > 0 && numbers > OF_GROUP {
                    break;
                }
                past += 1;
            }
            let (group, rest) = list.split_at(past);
            let of_group = group.iter();
            let of_group = of_group.map(|&v| (views[v], of_view[v], scene(v), &slots[v]));
            let mut packed = Packed::new(
                of_group.collect(),
                features,
                derivatives,
                last.next().unwrap_or_default(),
            );
            if let Some((row, buffers)) = row.zip(Arc::get_mut(&mut packed.buffers)) {
                let of_group: Vec<ViewPlaces> = group.iter().map(|&v| all[v]).collect();
                buffers.place(row, &of_group);
            }
            groups.push((group.to_vec(), packed));
            list = rest;
        }
    }
    groups
}

/// Returns the numbers below `count`, grouped by key, with the groups in the order of their first numbers.
fn alike<K: PartialEq>(count: usize, key: impl Fn(usize) -> K) -> Vec<Vec<usize>> {
    let mut lists: Vec<Vec<usize>> = Vec::new();
    for v in 0..count {
        match lists.iter_mut().find(|list| key(list[0]) == key(v)) {
            Some(list) => list.push(v),
            None => lists.push(vec![v]),
        }
    }
    lists
}

impl Packed {
    /// Returns the group without its buffers.
    pub fn without_buffers(&self) -> Self {
        Self {
            buffers: Arc::default(),
            sums: self.sums.clone(),
            ..*self
        }
    }

    /// Returns the group in the buffers of the last render, for views that differ only in their random numbers and in
    /// tensors of a row, which the device places. Returns `None` if these are not its buffers, or not on the device.
    pub fn again(&self, views: &[ViewPlaces], row: &Row, last: Buffers) -> Option<Self> {
        let seeds: Vec<&[u32]> = views.iter().map(|v| v.0.lists().seeds).collect();
        let headers = last.header().chunks(HEADER);
        let places = headers.map(|header| header[HeaderWord::seeds as usize]);
        let seeds: Vec<(u32, &[u32])> = places.zip(seeds).collect();
        let buffers = last.again(self.number, row, views, &seeds)?;
        Some(Self {
            number: buffers.number(),
            buffers: Arc::new(buffers),
            ..self.without_buffers()
        })
    }

    /// Packs views, each given with the index of its scene, the lists that only GPUs need, and its slots.
    fn new(
        views: Vec<(&View, usize, &OfScene, &Slots)>,
        features: Features,
        derivatives: Derivatives,
        last: Buffers,
    ) -> Self {
        let sums = Places::new(views.iter().map(|&(view, scene, ..)| (view, scene)));
        let (mut floats, mut words) = (Plan::default(), Plan::after(views.len() * HEADER));
        let mut headers = vec![[0; HEADER]; views.len()];
        let scenes = views.iter().zip(&sums.first);
        let scenes = scenes.map(|(&(view, _, of_scene, slots), first_sums)| Scene {
            first_sums,
            slots: slots.words.as_flattened(),
            slot_count: slots.count,
            ..of_scene.add_to(view.lists())
        });
        let scenes: Vec<Scene> = scenes.collect();
        for (scene, header) in scenes.iter().zip(&mut headers) {
            for (place, list) in scene.float_lists() {
                header[place as usize] = floats.place(list, place.shapes());
            }
            for (place, list) in scene.word_lists() {
                header[place as usize] = words.place(list, place.shapes());
            }
            for (place, number) in scene.numbers() {
                header[place as usize] = number;
            }
        }
        let mut made = Made {
            moves: features.moves,
            ..Made::default()
        };
        let mut table = Vec::new();
        let mut known = HashMap::new();
        for (v, &(_, number, of_scene, _)) in views.iter().enumerate() {
            let rooms = *known.entry(number).or_insert_with(|| {
                let [faces, hits, edges, _, leaves, _, parts] = of_scene.made;
                let tree = &of_scene.tree;
                table.extend([made.threads, v as u32]);
                table.extend(of_scene.made);
                table.push(words.place(tree.nodes.as_flattened(), true));
                for parts in of_scene.parts() {
                    table.extend([
                        words.place(&parts.nodes, true),
                        words.place(&parts.starts, true),
                        words.place(&parts.levels, true),
                        parts.levels.len() as u32 - 1,
                    ]);
                }
                made.scenes += 1;
                made.threads += faces + hits + edges + leaves + parts;
                made.add_levels(of_scene.parts());
                of_scene
                    .made_numbers(features.moves)
                    .map(|numbers| floats.room(numbers))
            });
            let lists: [HeaderWord; 6] = [
                HeaderWord::surfaces,
                HeaderWord::hits,
                HeaderWord::edges,
                HeaderWord::edge_leaves,
                HeaderWord::nodes,
                HeaderWord::edge_nodes,
            ];
            for (list, room) in lists.into_iter().zip(rooms) {
                headers[v][list as usize] = room;
            }
        }
        made.table = words.place(&table, true);
        let buffers = Buffers::new(floats, words, headers.as_flattened(), made, last);
        Self {
            number: buffers.number(),
            buffers: Arc::new(buffers),
            views: views.len(),
            features,
            derivatives,
            sums,
        }
    }
}

/// The slots for pieces of edges on a view's film. Room is left behind them, so that lists rarely change in size.
struct Slots {
    words: Vec<[u32; OF_SLOT]>,
    count: u32,
}

impl Slots {
    fn new(view: &View) -> Self {
        let mut words = view.film_slots(|slot, _| Some(slot));
        let count = words.len();
        words.resize(count.next_power_of_two(), [0; OF_SLOT]);
        Self {
            words,
            count: count as u32,
        }
    }
}

/// The lists of a scene that only GPUs need, beside the lists of the host.
#[derive(Default)]
pub(super) struct OfScene {
    pub tree: Arc<GpuTree>,
    counted: Vec<u32>,
    vertex_starts: Vec<u32>,
    vertex_corners: Vec<u32>,
    /// The shape of the tree over all edges. A tree over moving edges that is no part of it is a list of edges, behind
    /// those of this tree.
    edge_shape: Arc<TreeShape>,
    edges_of_leaves: Vec<u32>,
    edge_trees: Vec<[u32; OF_TREE as usize]>,
    vertices: Vec<[[f32; 3]; 2]>,
    /// The numbers of items that the device makes: triangles, triangles for rays, edges, edges of meshes among these,
    /// leaves of trees over edges, those below nodes among these, and parts of the first level of the tree over
    /// triangles.
    made: [u32; 7],
}

impl OfScene {
    pub fn new(view: &View) -> Self {
        let lists = &view.scene.lists;
        let background = lists.counted.len();
        let number = |o: usize| lists.counted.binary_search(&o).unwrap_or(background) as u32;
        let mut this = Self {
            tree: view.scene.hierarchy.for_gpu(),
            counted: (0..lists.objects.len()).map(number).collect(),
            ..Self::default()
        };
        if view.wanted.of.objects {
            this.add_vertex_corners(view);
        }
        if let Some(sets) = &view.edge_sets {
            let shapes = sets.shapes();
            this.edge_shape = shapes[0].clone();
            for (shape, rays_move) in shapes.into_iter().zip([true, false]) {
                let mut first = 0;
                if this.edge_trees.is_empty() {
                    this.edges_of_leaves = shape.edges.clone();
                } else if !Arc::ptr_eq(shape, &this.edge_shape) {
                    first = this.edges_of_leaves.len() as u32;
                    this.edges_of_leaves.extend(&shape.edges);
                }
                let root = sets.seen_by(rays_move);
                let leaves = LEAF as u32 * first;
                (this.edge_trees).push([leaves, first, root.start, root.count]);
            }
            this.made[2..4].copy_from_slice(&sets.counts());
        }
        let triangles = lists.triangles.len();
        let hits = this.tree.triangles.len();
        this.made[..2].copy_from_slice(&[triangles as u32, hits as u32]);
        this.made[4] = (this.edges_of_leaves.len() / LANES) as u32;
        if !this.edge_shape.children.is_empty() {
            this.made[5] = (this.edge_shape.edges.len() / LANES) as u32;
        }
        this.made[6] = this.tree.parts.levels.get(1).copied().unwrap_or(0);
        this.vertices = lists.in_two_parts();
        this
    }

    /// Returns the parts of the tree over triangles, and those of the tree over edges.
    fn parts(&self) -> [&Parts; 2] {
        [&self.tree.parts, self.edge_shape.parts()]
    }

    /// Lists the triangle corners at each vertex.
    fn add_vertex_corners(&mut self, view: &View) {
        let rows = view.scene.lists.vertex_rows.as_flattened();
        let count = view.scene.vertices();
        let mut starts = vec![0; count + 1];
        for &v in rows {
            starts[v as usize + 1] += 1;
        }
        for v in 0..count {
            starts[v + 1] += starts[v];
        }
        let mut next = starts.clone();
        let mut corners = vec![0; rows.len()];
        for (corner, &v) in rows.iter().enumerate() {
            let to: &mut u32 = &mut next[v as usize];
            corners[*to as usize] = corner as u32;
            *to += 1;
        }
        (self.vertex_starts, self.vertex_corners) = (starts, corners);
    }

    /// Returns the lists of a view together with these lists.
    pub fn add_to<'a>(&'a self, scene: Scene<'a>) -> Scene<'a> {
        Scene {
            nodes: &[],
            hit_numbers: &self.tree.triangles,
            hit_count: self.tree.triangles.len() as u32,
            counted: &self.counted,
            vertex_starts: &self.vertex_starts,
            vertex_corners: &self.vertex_corners,
            edge_children: &self.edge_shape.children,
            edges_of_leaves: &self.edges_of_leaves,
            vertices: self.vertices.as_flattened().as_flattened(),
            crossings: &scene.edges[6 * self.made[3] as usize..],
            surfaces: &[],
            edges: &[],
            edge_trees: self.edge_trees.as_flattened(),
            ..scene
        }
    }

    /// Returns the total length of all lists of floats, including those that the device makes.
    pub fn numbers(&self, view: &View) -> usize {
        let lists = self.add_to(view.lists());
        let sent: usize = lists.float_lists().iter().map(|(_, list)| list.len()).sum();
        sent + self.made_numbers(view.features.moves).iter().sum::<usize>()
    }

    /// Returns the lengths of the lists that the device makes: triangles, triangles for rays, edges, leaves of edges with
    /// the bounds of leaves and nodes behind them, nodes of the tree over triangles, and those of the tree over edges.
    fn made_numbers(&self, moves: bool) -> [usize; 6] {
        let [faces, hits, edges, _, leaves, bounded, _] = self.made.map(|n| n as usize);
        let edge_nodes = self.edge_shape.children.len() / LANES;
        [
            NUMBERS * faces,
            hit_stride(moves) as usize * hits,
            6 * edges,
            LANES * LEAF * leaves + BOUNDS as usize * (bounded + edge_nodes),
            OF_NODE as usize * self.tree.nodes.len(),
            LANES * NODE * edge_nodes,
        ]
    }
}
