//! Views packed into two buffers, floats and words, in groups that the same kernels serve. The words begin with a header
//! for each view, which says where the lists of its [`Scene`](crate::trace::Scene) lie; views share what is the same.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use burn::cubecl::prelude::Client;
use rayon::prelude::*;

use super::list::List;
use super::of_scene::OfScene;
use super::sum_places::Places;
use crate::kernel::View;
use crate::sampling::points;
use crate::trace::{Derivatives, Features, HEADER};

/// Views of a group at most.
const VIEWS: usize = 64;
/// Numbers of a group's scenes, about, where it has several.
const NUMBERS: usize = 1 << 24;

/// Views that kernels trace together, as buffers.
pub(crate) struct Packed {
    pub floats: Vec<f32>,
    pub words: Vec<u32>,
    pub views: usize,
    pub features: Features,
    pub derivatives: Derivatives,
    pub sums: Places,
    /// The buffers on the device, once they were sent there.
    sent: OnceLock<[List; 2]>,
}

/// Views in groups of such as follow each other and have the same kernels.
pub(crate) fn pack(views: &[&View]) -> Vec<(Range<usize>, Packed)> {
    // Views of one scene share its lists: those of the first.
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
    let scene = |v: usize| {
        scenes[of_view[v]]
            .as_ref()
            .expect("the first view packs it")
    };
    let kernels = |v: usize| {
        let features = Features {
            boxes: !scene(v).tree.boxes.is_empty(),
            stack: scene(v).tree.depth.next_multiple_of(16).max(16),
            ..views[v].features
        };
        (features, views[v].wanted.of)
    };
    let mut groups = Vec::new();
    let mut first = 0;
    while first < views.len() {
        let (mut past, mut numbers) = (first, 0);
        while past < views.len() && past - first < VIEWS && kernels(past) == kernels(first) {
            if !of_view[first..past].contains(&of_view[past]) {
                numbers += scene(past).numbers(views[past]);
            }
            if past > first && numbers > NUMBERS {
                break;
            }
            past += 1;
        }
        let (features, derivatives) = kernels(first);
        let of_group = (first..past).map(|v| (views[v], of_view[v], scene(v)));
        let packed = Packed::new(of_group.collect(), features, derivatives);
        groups.push((first..past, packed));
        first = past;
    }
    groups
}

impl Packed {
    /// Packs views, each with the number of its scene and its own lists.
    fn new(
        views: Vec<(&View, usize, &OfScene)>,
        features: Features,
        derivatives: Derivatives,
    ) -> Self {
        let sums = Places::new(views.iter().map(|&(view, scene, _)| (view, scene)));
        let mut packed = Self {
            floats: Vec::new(),
            words: vec![0; views.len() * HEADER],
            views: views.len(),
            features,
            derivatives,
            sums,
            sent: OnceLock::new(),
        };
        // Where lists begin that are in the buffers.
        let (mut floats, mut words) = (HashMap::new(), HashMap::new());
        let sums = packed.sums.first.clone();
        let table = points();
        for (v, &(view, _, of_scene)) in views.iter().enumerate() {
            let mut scene = of_scene.add_to(view.lists());
            (scene.first_sums, scene.points) = (&sums[v], &table);
            let mut header = [0; HEADER];
            for (place, list) in scene.float_lists() {
                let first = packed.floats.len() as u32;
                let at = *floats
                    .entry((list.as_ptr(), list.len()))
                    .or_insert_with(|| {
                        packed.floats.extend(list);
                        first
                    });
                header[place as usize] = at;
            }
            for (place, list) in scene.word_lists() {
                let first = packed.words.len() as u32;
                let at = *words.entry((list.as_ptr(), list.len())).or_insert_with(|| {
                    packed.words.extend(list);
                    first
                });
                header[place as usize] = at;
            }
            for (place, number) in scene.numbers() {
                header[place as usize] = number;
            }
            packed.words[v * HEADER..][..HEADER].copy_from_slice(&header);
        }
        packed
    }

    /// The buffers on the device, which are sent there once.
    pub(super) fn on_device(&self, client: &Client) -> [List; 2] {
        let send = || {
            [
                List::new(client, &self.floats),
                List::new(client, &self.words),
            ]
        };
        self.sent.get_or_init(send).clone()
    }
}
