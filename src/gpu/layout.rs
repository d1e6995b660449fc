//! Views as two buffers: floats, and words that say where they lie.
//!
//! Both begin with a header for each view; lists of scenes follow, which views of a scene share. Places in a header's
//! words are where lists begin, counted from that header: so a kernel looks at both buffers from its view's header
//! on, and knows nothing of others.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use burn::cubecl::prelude::Client;
use rayon::prelude::*;

use super::edge_layout::{SEED_OF_EDGES, SEED_OF_FILM, SEED_OF_SIDES};
use super::list::List;
use super::sums::{PARTS, Places};
use super::{Derivatives, Features};
use crate::accel::GpuTree;
use crate::kernel::View;
use crate::model::V3;
use crate::model::bsdf::model_of;
use crate::model::sky::Sky;
use crate::model::texture::Texture;
use crate::sampling::points;
use crate::scene::Wrap;

/// Sets of four dimensions in the table of Sobol points.
pub(super) const HEIGHT_OF_TABLE: u32 = 64;

/// Words of the header.
pub(super) const WIDTH: usize = 0;
pub(super) const HEIGHT: usize = 1;
pub(super) const BOUNCES: usize = 2;
pub(super) const ROULETTE_AFTER: usize = 3;
pub(super) const SAMPLES_LOG: usize = 4;
pub(super) const BLOCKS: usize = 5;
pub(super) const SEED: usize = 6;
pub(super) const SEED_OF_CONES: usize = 8;
/// Words: the points of the Sobol sequence.
pub(super) const TABLES: usize = 10;
/// The first node or leaf.
pub(super) const ROOT: usize = 11;
/// Floats: both boxes of nodes, twelve numbers each. Words: both children.
pub(super) const BOXES: usize = 12;
pub(super) const CHILDREN: usize = 13;
/// Floats: triangles as rays meet them, [`HIT_STRIDE`] numbers each, and words: their numbers.
pub(super) const HITS: usize = 14;
pub(super) const HIT_NUMBERS: usize = 15;
/// Words: first and number of the triangles of a leaf.
pub(super) const LEAVES: usize = 16;
/// Floats: triangles as surfaces, [`SURFACE_STRIDE`] numbers each. Words: [`OF_TRIANGLE`] each.
pub(super) const SURFACES: usize = 17;
pub(super) const OF_TRIANGLES: usize = 18;
/// Floats: displacement over the shutter of each object.
pub(super) const VELOCITIES: usize = 19;
pub(super) const UVS: usize = 20;
pub(super) const NORMALS: usize = 21;
/// Floats: constants of materials, four colours each. Words: [`OF_MATERIAL`] each.
pub(super) const MATERIALS: usize = 22;
pub(super) const OF_MATERIALS: usize = 23;
pub(super) const TEXELS: usize = 24;
/// Words: triangles of emitters. Floats: radiance and fixed probability of each.
pub(super) const EMITTERS: usize = 25;
pub(super) const OF_EMITTERS: usize = 26;
pub(super) const EMITTER_COUNT: usize = 27;
/// Floats: texels of the sky, then sums over rows, sums within rows, and probabilities.
pub(super) const SKY: usize = 28;
pub(super) const SKY_WIDTH: usize = 29;
pub(super) const SKY_HEIGHT: usize = 30;
pub(super) const SKY_ROWS: usize = 31;
pub(super) const SKY_COLUMNS: usize = 32;
pub(super) const SKY_CHANCES: usize = 33;
/// Floats: the pixel filter's table.
pub(super) const FILTER: usize = 34;
/// Words: the number of each object among those that are counted.
pub(super) const COUNTED: usize = 35;
/// The number of triangles that are met without boxes.
pub(super) const HIT_COUNT: usize = 36;
/// Words: the vertices of each triangle.
pub(super) const VERTEX_ROWS: usize = 37;
/// Words: whether derivatives by an object are asked for.
pub(super) const WANTED_OBJECTS: usize = 38;
/// The first sum of each part ([`sums`](super::sums)).
pub(super) const FIRST_SUMS: usize = 40;
pub(super) const HEADER: usize = 80;

/// Floats of the header: the camera, then the tangent of cones.
pub(super) const CAMERA: usize = 0;
pub(super) const CONE: usize = 24;
/// Scene units in a unit of the kernels.
pub(super) const UNIT: usize = 25;
/// The rows of the inverse of the camera's basis.
pub(super) const DUAL: usize = 32;
pub(super) const FLOAT_HEADER: usize = 48;

pub(super) const HIT_STRIDE: usize = 20;
pub(super) const SURFACE_STRIDE: usize = 16;
pub(super) const OF_TRIANGLE: usize = 8;
pub(super) const OF_MATERIAL: usize = 20;
/// A child that is a leaf.
pub(super) const LEAF: u32 = 1 << 31;
pub(super) const NONE: u32 = u32::MAX;
/// Bits of a material.
pub(super) const EMITS: u32 = 1;
pub(super) const REFLECTS: u32 = 2;
pub(super) const GLOSSY: u32 = 4;
pub(super) const COMPENSATED: u32 = 8;
/// What the number of its BSDF is multiplied by.
pub(super) const MODEL: u32 = 16;

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

/// A scene as lists, and its part of a header.
pub(super) struct PackedScene {
    pub floats: Vec<f32>,
    pub words: Vec<u32>,
    pub header: [u32; HEADER],
    /// Words of the header that are places in floats, and those that are places in words.
    in_floats: Vec<usize>,
    in_words: Vec<usize>,
    /// Whether there are boxes, and room for a stack of them.
    pub boxes: bool,
    pub stack: usize,
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
        (features, Derivatives::of(views[v], scene(v)))
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
        let table = &points()[..HEIGHT_OF_TABLE as usize];
        let tables = packed.words.len();
        let of_table = table.iter().flatten().flatten().flatten();
        packed.words.extend(of_table);
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
                header[place] += (floats - v * FLOAT_HEADER) as u32;
            }
            for &place in &scene.in_words {
                header[place] += (words - v * HEADER) as u32;
            }
            header[TABLES] = (tables - v * HEADER) as u32;
            header[FILTER] = (packed.floats.len() - v * FLOAT_HEADER) as u32;
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
        words[place] = seed as u32;
        words[place + 1] = (seed >> 32) as u32;
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
    let numbers = numbers.chain([c.per_focus, c.width, c.height]);
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

impl PackedScene {
    fn new(view: &View) -> Self {
        let tree = view.scene.hierarchy.for_gpu();
        let mut packed = Self {
            floats: Vec::new(),
            words: Vec::new(),
            header: [0; HEADER],
            in_floats: Vec::new(),
            in_words: Vec::new(),
            boxes: !tree.boxes.is_empty(),
            stack: tree.depth.next_multiple_of(16).max(16),
        };
        packed.add_tree(view, &tree);
        packed.add_surfaces(view);
        packed.add_materials(view);
        packed.add_emitters(view);
        packed.add_sky(view);
        packed.add_edges(view);
        packed
    }

    /// Begins a list of floats at a place of the header.
    pub(super) fn floats_at(&mut self, place: usize) {
        self.header[place] = self.floats.len() as u32;
        self.in_floats.push(place);
    }

    pub(super) fn words_at(&mut self, place: usize) {
        self.header[place] = self.words.len() as u32;
        self.in_words.push(place);
    }

    /// Repeats words of the header behind them.
    pub(super) fn repeat(&mut self, of: Range<usize>) {
        for places in [&mut self.in_floats, &mut self.in_words] {
            let again: Vec<usize> = places
                .iter()
                .filter(|p| of.contains(p))
                .map(|p| p + of.len())
                .collect();
            places.extend(again);
        }
        self.header.copy_within(of.clone(), of.end);
    }

    pub(super) fn vector(&mut self, v: V3) {
        self.floats.extend(v.to_array());
    }

    fn add_tree(&mut self, view: &View, tree: &GpuTree) {
        self.header[ROOT] = tree.root;
        self.floats_at(BOXES);
        self.floats.extend(tree.boxes.iter().flatten());
        self.words_at(CHILDREN);
        self.words.extend(tree.children.iter().flatten());
        self.words_at(LEAVES);
        self.words.extend(tree.leaves.iter().flatten());
        self.words_at(HIT_NUMBERS);
        self.words.extend(&tree.triangles);
        self.header[HIT_COUNT] = tree.triangles.len() as u32;
        self.floats_at(HITS);
        for &k in &tree.triangles {
            let triangle = &view.scene.hierarchy.triangles[k as usize];
            self.floats.extend(triangle.as_met());
        }
    }

    fn add_surfaces(&mut self, view: &View) {
        let scene = &view.scene;
        self.floats_at(SURFACES);
        for t in &scene.triangles {
            for v in t.corners.into_iter().chain([t.normal]) {
                self.vector(v);
            }
            self.floats.extend([t.plane, t.area, 0.0, 0.0]);
        }
        self.words_at(OF_TRIANGLES);
        for (k, t) in scene.triangles.iter().enumerate() {
            self.words.extend([t.material, t.object]);
            self.words.extend(scene.uv_rows[k]);
            self.words.extend(scene.normal_rows[k]);
        }
        self.words_at(VERTEX_ROWS);
        self.words.extend(scene.vertex_rows.iter().flatten());
        self.words_at(WANTED_OBJECTS);
        let wanted = view.wanted.objects.iter().map(|&w| u32::from(w));
        self.words.extend(wanted);
        self.floats_at(VELOCITIES);
        for v in scene.velocities.iter().flatten() {
            self.vector(*v);
        }
        self.floats_at(UVS);
        self.floats.extend(scene.uvs.iter().flatten());
        self.floats_at(NORMALS);
        for n in &scene.normals {
            self.vector(*n);
        }
        self.words_at(COUNTED);
        let background = scene.counted.len();
        let numbers = (0..scene.objects.len()).map(|o| {
            let place = scene.counted.binary_search(&o);
            place.unwrap_or(background) as u32
        });
        self.words.extend(numbers);
    }

    fn add_materials(&mut self, view: &View) {
        let scene = &view.scene;
        self.floats_at(MATERIALS);
        for m in &scene.materials {
            m.channels.iter().for_each(|c| self.vector(c.constant));
        }
        self.words_at(OF_MATERIALS);
        for m in &scene.materials {
            let bit = |is: bool, bit: u32| if is { bit } else { 0 };
            let bits = bit(m.kind.emits, EMITS)
                | bit(m.kind.reflects, REFLECTS)
                | bit(m.kind.glossy, GLOSSY)
                | bit(m.kind.compensated, COMPENSATED)
                | (MODEL * model_of(m.kind.bsdf));
            let end = self.words.len() + OF_MATERIAL;
            self.words.push(bits);
            for c in &m.channels {
                self.words.extend(match c.texture {
                    None => [NONE; 4],
                    Some(Texture {
                        offset,
                        width,
                        height,
                        wrap,
                    }) => [offset as u32, width as u32, height as u32, number_of(wrap)],
                });
            }
            self.words.resize(end, 0);
        }
        self.floats_at(TEXELS);
        self.floats.extend(&scene.texels.0);
    }

    fn add_emitters(&mut self, view: &View) {
        let emitters = &view.scene.emitters;
        self.header[EMITTER_COUNT] = emitters.all().len() as u32;
        self.words_at(OF_EMITTERS);
        let triangles = emitters.all().map(|k| emitters.get(k).triangle);
        self.words.extend(triangles);
        self.floats_at(EMITTERS);
        for k in emitters.all() {
            let numbers = [emitters.get(k).radiance, emitters.fixed[k]];
            self.floats.extend(numbers);
        }
    }

    fn add_sky(&mut self, view: &View) {
        self.floats_at(SKY);
        match &view.scene.sky {
            Sky::Black => {}
            Sky::Constant(radiance) => self.vector(*radiance),
            Sky::Map(map) => {
                let (width, height) = (map.width, map.height);
                self.header[SKY_WIDTH] = width as u32;
                self.header[SKY_HEIGHT] = height as u32;
                self.floats.extend(&map.texels.0);
                let (rows, columns, chances) =
                    (&map.drawn.rows, &map.drawn.columns, &map.drawn.chance);
                self.floats_at(SKY_ROWS);
                self.floats.extend(rows);
                self.floats_at(SKY_COLUMNS);
                self.floats.extend(columns);
                self.floats_at(SKY_CHANCES);
                self.floats.extend(chances);
            }
        }
    }
}

/// A way to go on outside of a texture, as kernels know it.
fn number_of(wrap: Wrap) -> u32 {
    match wrap {
        Wrap::Repeat => 0,
        Wrap::Clamp => 1,
        Wrap::Mirror => 2,
    }
}
