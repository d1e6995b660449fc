//! Scenes packed into lists ([`layout`](super::layout)).

use std::ops::Range;

use super::layout::{
    BOXES, CHILDREN, COMPENSATED, COUNTED, EMISSIVE_COUNT, EMITS, EMITTER_COUNT, EMITTERS, FIXED,
    GLOSSY, HEADER, HIT_COUNT, HIT_NUMBERS, HITS, LEAVES, MATERIALS, MODEL, NONE, NORMALS,
    OF_EMITTERS, OF_MATERIAL, OF_MATERIALS, OF_TRIANGLES, REFLECTS, ROOT, SKY, SKY_CHANCES,
    SKY_COLUMNS, SKY_HEIGHT, SKY_ROWS, SKY_WIDTH, SURFACES, TEXELS, UVS, VELOCITIES,
    VERTEX_CORNERS, VERTEX_ROWS, VERTEX_STARTS, WANTED_OBJECTS,
};
use crate::accel::GpuTree;
use crate::kernel::View;
use crate::model::V3;
use crate::model::bsdf::model_of;
use crate::model::sky::{Map, Sky};

/// A scene as lists, and its part of a header.
pub(super) struct PackedScene {
    pub floats: Vec<f32>,
    pub words: Vec<u32>,
    pub header: [u32; HEADER],
    /// Words of the header that are places in floats, and those that are places in words.
    pub in_floats: Vec<usize>,
    pub in_words: Vec<usize>,
    /// Whether there are boxes, and room for a stack of them.
    pub boxes: bool,
    pub stack: usize,
}

impl PackedScene {
    pub fn new(view: &View) -> Self {
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
        packed.add_corners(view);
        packed.add_masks(view);
        packed.add_materials(view);
        packed.add_emitters(view);
        packed.add_lights(view);
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
        if view.wanted.objects.contains(&true) {
            self.add_vertex_corners(view);
        }
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

    /// The corners of triangles at each vertex.
    fn add_vertex_corners(&mut self, view: &View) {
        let rows = view.scene.vertex_rows.as_flattened();
        let last = view.scene.objects.last();
        let count = last.map_or(0, |o| o.first_vertex + o.vertices);
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
        self.words_at(VERTEX_STARTS);
        self.words.extend(starts);
        self.words_at(VERTEX_CORNERS);
        self.words.extend(corners);
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
            let textures = m.channels.iter().map(|c| c.texture);
            for texture in textures.chain([m.normal_map]) {
                self.words.extend(match texture {
                    None => [NONE; 4],
                    Some(t) => t.words(),
                });
            }
            self.words.resize(end, 0);
        }
        self.floats_at(TEXELS);
        self.floats.extend(&scene.texels.0);
    }

    fn add_emitters(&mut self, view: &View) {
        let emitters = &view.scene.emitters;
        let count = emitters.all().len() + emitters.lights().len();
        self.header[EMITTER_COUNT] = count as u32;
        self.header[EMISSIVE_COUNT] = emitters.all().len() as u32;
        self.words_at(OF_EMITTERS);
        let triangles = emitters.all().map(|k| emitters.get(k).triangle);
        self.words.extend(triangles);
        self.floats_at(EMITTERS);
        self.floats
            .extend((0..count).map(|k| emitters.brightness(k)));
        self.floats_at(FIXED);
        self.floats.extend(&emitters.fixed);
    }

    fn add_sky(&mut self, view: &View) {
        self.floats_at(SKY);
        match &view.scene.sky {
            Sky::Black => {}
            Sky::Constant(radiance) => self.vector(*radiance),
            Sky::Map(map) => {
                self.floats.extend(&map.texels.0);
                let Map { width, height, .. } = map.drawn.map;
                self.header[SKY_WIDTH] = width;
                self.header[SKY_HEIGHT] = height;
                for (place, first) in [
                    (SKY_ROWS, map.drawn.map.rows),
                    (SKY_COLUMNS, map.drawn.map.columns),
                    (SKY_CHANCES, map.drawn.map.chances),
                ] {
                    self.floats_at(place);
                    self.header[place] += first;
                }
                self.floats.extend(&map.drawn.list);
            }
        }
    }
}
