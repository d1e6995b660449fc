//! What few scenes have, packed into lists ([`layout`](super::layout)): colours and tangents at corners, masks, and
//! lights without extent.

use std::collections::HashMap;
use std::sync::Arc;

use super::layout::{
    ALPHAS, COLOUR_ROWS, COLOURS, DIRECTIONAL, DISTANT, DISTANT_AXES, DISTANT_COUNT, DISTANT_SUMS,
    FIXED_SUMS, LIGHT_BITS, LIGHT_BRANCHES, LIGHT_NODE_COUNT, LIGHT_NODES, LIGHT_PLACES, LIGHTS,
    MASKED, MASKED_UVS, MASKS, SPOT, TANGENT_ROWS, TANGENTS, WANTED,
};
use super::packed_scene::PackedScene;
use crate::kernel::View;

impl PackedScene {
    pub(super) fn add_corners(&mut self, view: &View) {
        let scene = &view.scene;
        self.floats_at(COLOURS);
        for colour in &scene.colours.values {
            self.vector(*colour);
        }
        self.words_at(COLOUR_ROWS);
        for (rows, t) in scene.colours.rows.iter().zip(&scene.triangles) {
            let tinted = scene.materials[t.material as usize].kind.bsdf.is_tinted();
            self.words
                .extend(if tinted { *rows } else { [u32::MAX; 3] });
        }
        self.floats_at(TANGENTS);
        for (tangent, side) in scene.tangents.values.iter().zip(&scene.tangent_sides) {
            self.vector(*tangent);
            self.floats.push(*side);
        }
        self.words_at(TANGENT_ROWS);
        self.words.extend(scene.tangents.rows.iter().flatten());
    }

    pub(super) fn add_masks(&mut self, view: &View) {
        let Some(holes) = &view.scene.holes else {
            return;
        };
        self.words_at(MASKED);
        self.words.extend(&holes.of_triangle);
        self.floats_at(ALPHAS);
        let mut masks = Vec::with_capacity(holes.masks.len());
        let mut known: HashMap<*const Vec<f32>, u32> = HashMap::new();
        for mask in &holes.masks {
            let next = self.floats.len() as u32 - self.header[ALPHAS];
            let offset = *known.entry(Arc::as_ptr(&mask.alpha)).or_insert(next);
            let [_, size @ ..] = mask.image().words();
            masks.push([offset, size[0], size[1], size[2]]);
            if offset == next {
                self.floats.extend(mask.alpha.iter());
            }
        }
        self.words_at(MASKS);
        for triangle in &holes.triangles {
            self.words.extend(masks[triangle.mask as usize]);
        }
        self.floats_at(MASKED_UVS);
        for triangle in &holes.triangles {
            let cutoff = holes.masks[triangle.mask as usize].cutoff;
            self.floats.extend(triangle.uvs.iter().flatten());
            self.floats.extend([cutoff, 0.0]);
        }
    }

    pub(super) fn add_lights(&mut self, view: &View) {
        let emitters = &view.scene.emitters;
        self.floats_at(LIGHTS);
        for light in emitters.lights() {
            for v in [light.position, light.axis, light.strength] {
                self.vector(v);
            }
            self.floats.extend([light.cos_inner, light.cos_outer]);
        }
        if emitters.by_sums() {
            self.floats_at(FIXED_SUMS);
            self.floats.extend(emitters.by_power().sums);
        }
        if let Some(tree) = emitters.tree() {
            self.floats_at(LIGHT_BRANCHES);
            self.floats.extend(tree.branches);
            self.header[LIGHT_NODE_COUNT] = tree.count;
            self.words_at(LIGHT_NODES);
            self.words.extend(tree.nodes);
            self.words_at(LIGHT_PLACES);
            self.words.extend(tree.places);
            self.header[DISTANT_COUNT] = tree.distant_count;
            self.words_at(DISTANT);
            self.words.extend(tree.distant);
            self.floats_at(DISTANT_SUMS);
            self.floats.extend(tree.sums);
            self.floats_at(DISTANT_AXES);
            self.floats.extend(tree.axes);
        }
        self.words_at(LIGHT_BITS);
        let wanted = &view.wanted.lights;
        for (i, light) in emitters.lights().iter().enumerate() {
            let bit = |is: bool, bit: u32| if is { bit } else { 0 };
            self.words.push(
                bit(light.directional, DIRECTIONAL)
                    | bit(light.spot, SPOT)
                    | bit(wanted[i], WANTED),
            );
        }
    }
}
