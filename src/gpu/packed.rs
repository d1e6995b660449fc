//! Views packed into buffers ([`layout`](super::layout)), in groups that the same kernels serve.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use burn::cubecl::prelude::Client;
use rayon::prelude::*;

use super::edge_layout::{SEED_OF_EDGES, SEED_OF_FILM, SEED_OF_SIDES};
use super::layout::{
    BLOCKS, BOUNCES, CAMERA, CONE, DUAL, FILTER, FIRST_SUMS, FLOAT_HEADER, HEADER, HEIGHT, NONE,
    ROULETTE_AFTER, SAMPLES_LOG, SEED, SEED_OF_CONES, TABLES, UNIT, WIDTH,
};
use super::list::List;
use super::packed_scene::PackedScene;
use super::sum_places::Places;
use super::sums::PARTS;
use super::{Derivatives, Features};
use crate::kernel::View;
use crate::model::V3;
use crate::sampling::points;

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
    let pack = |v: usize| (of_view[v] == v).then(|| PackedScene::new(views[v]));
    let scenes: Vec<Option<PackedScene>> = (0..views.len()).into_par_iter().map(pack).collect();
    let scene = |v: usize| {
        scenes[of_view[v]]
            .as_ref()
            .expect("the first view packs it")
    };
    let kernels = |v: usize| {
        let features = Features::of(views[v], scene(v));
        (features, Derivatives::of(views[v]))
    };
    let mut groups = Vec::new();
    let mut first = 0;
    while first < views.len() {
        let (mut past, mut numbers) = (first, 0);
        while past < views.len() && past - first < VIEWS && kernels(past) == kernels(first) {
            if !of_view[first..past].contains(&of_view[past]) {
                numbers += scene(past).floats.len();
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
    /// Packs views, each with the number of its scene.
    fn new(
        views: Vec<(&View, usize, &PackedScene)>,
        features: Features,
        derivatives: Derivatives,
    ) -> Self {
        let mut packed = Self {
            floats: vec![0.0; views.len() * FLOAT_HEADER],
            words: vec![0; views.len() * HEADER],
            views: views.len(),
            features,
            derivatives,
            sums: Places::new(views.iter().map(|&(view, scene, _)| (view, scene))),
            sent: OnceLock::new(),
        };
        let tables = packed.words.len();
        packed.words.extend(points());
        let mut begins = HashMap::new();
        for (v, &(view, number, scene)) in views.iter().enumerate() {
            let [floats, words] = *begins.entry(number).or_insert_with(|| {
                let begin = [packed.floats.len(), packed.words.len()];
                packed.floats.extend(&scene.floats);
                packed.words.extend(&scene.words);
                begin
            });
            let mut header = scene.header;
            for &place in &scene.in_floats {
                header[place] += floats as u32;
            }
            for &place in &scene.in_words {
                header[place] += words as u32;
            }
            header[TABLES] = tables as u32;
            header[FILTER] = packed.floats.len() as u32;
            packed.floats.extend(&view.filter.table);
            header[FIRST_SUMS..FIRST_SUMS + PARTS].copy_from_slice(&packed.sums.first[v]);
            add_settings(view, &mut header);
            packed.words[v * HEADER..][..HEADER].copy_from_slice(&header);
            add_camera(view, &mut packed.floats[v * FLOAT_HEADER..][..FLOAT_HEADER]);
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

fn add_settings(view: &View, words: &mut [u32]) {
    let settings = &view.settings;
    let sampler = &settings.sampler;
    words[WIDTH] = settings.width;
    words[HEIGHT] = settings.height;
    words[BOUNCES] = settings.bounces;
    words[ROULETTE_AFTER] = settings.roulette_after.unwrap_or(NONE);
    words[SAMPLES_LOG] = sampler.samples;
    words[BLOCKS] = sampler.pixels;
    let seeds = [
        (SEED, sampler.seed),
        (SEED_OF_CONES, view.cones.seed),
        (SEED_OF_EDGES, view.edges.seed),
        (SEED_OF_SIDES, view.sides.seed),
        (SEED_OF_FILM, view.film.seed),
    ];
    for (place, seed) in seeds {
        words[place] = seed.low;
        words[place + 1] = seed.high;
    }
}

fn add_camera(view: &View, floats: &mut [f32]) {
    let c = &view.camera;
    let (lens, dual) = (c.lens, c.dual);
    let vectors = [
        c.eye,
        c.across,
        c.upward,
        c.forward,
        lens.first,
        lens.second,
    ];
    let numbers = vectors.into_iter().flat_map(V3::to_array);
    let numbers = numbers.chain([c.per_focus, c.width, c.height, c.filter]);
    floats[CAMERA..]
        .iter_mut()
        .zip(numbers)
        .for_each(|(to, n)| *to = n);
    let rows = [dual.x, dual.y, dual.z].into_iter().flat_map(V3::to_array);
    floats[DUAL..]
        .iter_mut()
        .zip(rows)
        .for_each(|(to, n)| *to = n);
    floats[CONE] = view.cone;
    floats[UNIT] = view.scene.frame.unit as f32;
}
