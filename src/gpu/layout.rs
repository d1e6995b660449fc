//! A view as two buffers: floats, and words that say where they lie.
//!
//! Both begin with a header; places in the header's words are where lists begin.

use std::sync::OnceLock;

use burn::cubecl::prelude::Client;

use super::Features;
use super::list::List;
use super::sums::{PARTS, Places};
use crate::accel::GpuTree;
use crate::kernel::View;
use crate::model::V3;
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
const HEADER: usize = 80;

/// Floats of the header: the camera, then the tangent of cones.
pub(super) const CAMERA: usize = 0;
pub(super) const CONE: usize = 24;
/// Scene units in a unit of the kernels.
pub(super) const UNIT: usize = 25;
/// The rows of the inverse of the camera's basis.
pub(super) const DUAL: usize = 32;
const FLOAT_HEADER: usize = 48;

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

/// A view as buffers.
pub(crate) struct Packed {
    pub floats: Vec<f32>,
    pub words: Vec<u32>,
    pub features: Features,
    /// The buffers on the device, once they were sent there.
    sent: OnceLock<[List; 2]>,
}

impl Packed {
    pub fn new(view: &View) -> Self {
        let scene = &view.scene;
        let tree = scene.hierarchy.for_gpu();
        let mut packed = Self {
            floats: vec![0.0; FLOAT_HEADER],
            words: vec![0; HEADER],
            features: Features::of(view, &tree),
            sent: OnceLock::new(),
        };
        packed.add_settings(view);
        packed.add_tree(view, &tree);
        packed.add_surfaces(view);
        packed.add_materials(view);
        packed.add_emitters(view);
        packed.add_sky(view);
        packed.add_edges(view);
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

    /// Begins a list of floats at a place of the header.
    pub(super) fn floats_at(&mut self, place: usize) {
        self.words[place] = self.floats.len() as u32;
    }

    pub(super) fn words_at(&mut self, place: usize) {
        self.words[place] = self.words.len() as u32;
    }

    pub(super) fn vector(&mut self, v: V3) {
        self.floats.extend(v.to_array());
    }

    fn add_settings(&mut self, view: &View) {
        let sampler = &view.settings.sampler;
        let settings = &view.settings;
        let words = &mut self.words;
        words[WIDTH] = settings.width;
        words[HEIGHT] = settings.height;
        words[BOUNCES] = settings.bounces;
        words[ROULETTE_AFTER] = settings.roulette_after.unwrap_or(NONE);
        words[SAMPLES_LOG] = sampler.samples;
        words[BLOCKS] = sampler.pixels;
        for (place, seed) in [(SEED, sampler.seed), (SEED_OF_CONES, view.cones.seed)] {
            words[place] = seed as u32;
            words[place + 1] = (seed >> 32) as u32;
        }
        self.words_at(TABLES);
        let table = &points()[..HEIGHT_OF_TABLE as usize];
        self.words
            .extend(table.iter().flatten().flatten().flatten());
        let c = &view.camera;
        let vectors = [
            c.eye,
            c.across,
            c.upward,
            c.forward,
            c.lens.first,
            c.lens.second,
        ];
        let mut at = CAMERA;
        for number in vectors.into_iter().flat_map(V3::to_array) {
            self.floats[at] = number;
            at += 1;
        }
        for number in [c.per_focus, c.width, c.height] {
            self.floats[at] = number;
            at += 1;
        }
        for (i, row) in [c.dual.x, c.dual.y, c.dual.z].into_iter().enumerate() {
            self.floats[DUAL + 3 * i..][..3].copy_from_slice(&row.to_array());
        }
        self.floats[CONE] = view.cone;
        self.floats[UNIT] = view.scene.frame.unit as f32;
        self.floats_at(FILTER);
        self.floats.extend(&view.filter.table);
    }

    fn add_tree(&mut self, view: &View, tree: &GpuTree) {
        self.words[ROOT] = tree.root;
        self.floats_at(BOXES);
        self.floats.extend(tree.boxes.iter().flatten());
        self.words_at(CHILDREN);
        self.words.extend(tree.children.iter().flatten());
        self.words_at(LEAVES);
        self.words.extend(tree.leaves.iter().flatten());
        self.words_at(HIT_NUMBERS);
        self.words.extend(&tree.triangles);
        self.words[HIT_COUNT] = tree.triangles.len() as u32;
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
        let places = Places::new(scene, &view.wanted);
        self.words[FIRST_SUMS..FIRST_SUMS + PARTS].copy_from_slice(&places.first);
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
                | bit(m.kind.glossy, GLOSSY);
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
        self.words[EMITTER_COUNT] = emitters.all().len() as u32;
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
                self.words[SKY_WIDTH] = width as u32;
                self.words[SKY_HEIGHT] = height as u32;
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
