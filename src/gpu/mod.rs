//! Kernels on GPUs: whole paths, one thread a pixel, in the language of CubeCL. Formulas are those of
//! `model`, so that the host and GPUs share them; what is here finds what they are applied to.

#![allow(unused_assignments)] // Variables of a kernel need a first value.
#![allow(clippy::too_many_arguments)] // Kernels have no globals.
#![allow(
    clippy::collapsible_if,
    clippy::collapsible_else_if,
    clippy::manual_clamp,
    clippy::implicit_saturating_sub,
    clippy::assign_op_pattern,
    reason = "the language of kernels has no other form, or conditions of compilation are nested so"
)]
#![allow(
    clippy::too_many_lines,
    reason = "calls are inlined, so a loop has one place for each"
)]

mod backward;
mod batch;
mod camera;
mod corners;
mod corners_backward;
mod counts;
mod crossing;
mod device;
mod edge_layout;
mod edge_point;
mod edge_search;
mod emitter_choice;
mod film;
mod film_table;
mod finite;
mod gradient;
mod hit;
mod holes;
mod job;
mod jumps;
mod launch;
mod launch_backward;
mod launch_pixels;
mod layout;
mod light;
mod light_backward;
mod light_tree;
mod list;
mod packed;
mod packed_details;
mod packed_scene;
mod passes;
mod path;
mod pieces;
mod pixel_gradients;
mod reading;
mod records;
mod shadow_rays;
mod side_light;
mod sum_places;
mod sums;
mod surface;
mod surface_backward;
mod texture;
mod texture_backward;

use burn::cubecl::{self, prelude::*};

use crate::kernel::{KernelScene, Material, ROOM, View};
use crate::model::bsdf::Models;
use crate::model::sky::Sky;
use crate::sampling::Sequence;
pub(crate) use batch::gradient_of;
use camera::begin;
pub(crate) use counts::counts_of;
pub(crate) use device::check;
pub(crate) use job::Job;
pub(crate) use launch::trace;
use layout::{COUNTED, NONE, UNIT};
pub(crate) use packed::{Packed, pack};
use packed_scene::PackedScene;
use path::{from_camera, path_light};
use pieces::{Piece, pixel_at};
use reading::Scene;
use records::Room;

/// What a kernel is compiled for: what a scene does not need is not in it.
#[derive(Clone, Copy, Debug, Hash, PartialEq, Eq)]
pub(crate) struct Features {
    /// Room for nodes, of a tree that has any.
    pub boxes: bool,
    pub stack: usize,
    pub moves: bool,
    /// Whether lines in which triangles pass through each other move while the shutter is open.
    pub flying_crossings: bool,
    pub lens: bool,
    pub parallel: bool,
    pub smooth: bool,
    pub textured: bool,
    pub tinted: bool,
    pub tilted: bool,
    pub glows: bool,
    pub holes: bool,
    pub glossy: bool,
    pub models: Models,
    pub emitters: bool,
    pub lights: bool,
    /// How emitters are chosen: by the solid angles of all, by a tree, or by sums of fixed probabilities; else by these
    /// probabilities, one after another.
    pub by_solid_angle: bool,
    pub by_tree: bool,
    pub by_sums: bool,
    pub combined: bool,
    pub sky_constant: bool,
    pub sky_map: bool,
    pub sees_sky: bool,
    pub gathers_map: bool,
    pub dark: bool,
    pub cones: bool,
    pub roulette: bool,
    pub sequence: Sequence,
}

impl Features {
    fn of(view: &View, packed: &PackedScene) -> Self {
        let scene = &view.scene;
        Self {
            boxes: packed.boxes,
            stack: packed.stack,
            moves: scene.velocities.is_some(),
            flying_crossings: (view.edge_sets.as_ref()).is_some_and(|e| e.any_apart()),
            lens: view.camera.aperture > 0.0,
            parallel: view.camera.parallel,
            smooth: scene.smooth,
            textured: scene.textured,
            tinted: !scene.colours.values.is_empty(),
            tilted: scene.tilted && !scene.tangents.values.is_empty(),
            glows: scene.materials.iter().any(Material::glows),
            holes: scene.holes.is_some(),
            glossy: scene.glossy,
            models: models_of(scene),
            emitters: !scene.emitters.is_empty(),
            lights: !scene.emitters.lights().is_empty(),
            by_solid_angle: scene.emitters.by_solid_angle(),
            by_tree: scene.emitters.tree().is_some(),
            by_sums: scene.emitters.by_sums(),
            combined: view.combined,
            sky_constant: matches!(scene.sky, Sky::Constant(_)),
            sky_map: scene.sky.map().is_some(),
            sees_sky: view.sees_sky,
            gathers_map: view.gathers_map,
            dark: view.dark,
            cones: view.cone > 0.0,
            roulette: view.settings.roulette_after.is_some(),
            sequence: view.settings.sampler.sequence,
        }
    }
}

/// The models of a scene's materials.
fn models_of(scene: &KernelScene) -> Models {
    let models = scene.materials.iter().map(|m| Models::of(m.kind.bsdf));
    models.reduce(Models::or).unwrap_or_default()
}

/// The derivatives that are asked for ([`Wanted`](crate::kernel::Wanted)).
#[derive(Clone, Copy, Debug, Hash, PartialEq, Eq)]
pub(crate) struct Derivatives {
    pub rays: bool,
    pub objects: bool,
    pub velocities: bool,
    pub uvs: bool,
    pub normals: bool,
    pub colours: bool,
    pub tangents: bool,
    pub materials: bool,
    pub emission: bool,
    pub lights: bool,
    pub sky: bool,
    pub camera: bool,
    /// Whether directions that are drawn turn while surfaces stand still.
    pub turns: bool,
    /// Whether jumps at edges that points of paths see are added, whether trees over edges have nodes, whether
    /// emitters are in several groups, and room for drawing an edge.
    pub jumps: bool,
    pub edge_nodes: bool,
    pub grouped: bool,
    pub edge_room: usize,
}

impl Derivatives {
    fn of(view: &View) -> Self {
        let wanted = &view.wanted;
        let jumps = view.has_edges && !view.dark;
        Self {
            turns: wanted.turns(),
            jumps,
            edge_nodes: (view.edge_sets.as_ref()).is_some_and(|e| e.seen_by(true).has_nodes),
            grouped: view.scene.emitters.groups.len() > 1,
            edge_room: if jumps { ROOM } else { 1 },
            rays: wanted.rays,
            objects: wanted.objects.contains(&true),
            velocities: wanted.velocities,
            uvs: wanted.uvs,
            normals: wanted.normals,
            colours: wanted.colours,
            tangents: wanted.tangents,
            lights: wanted.lights.contains(&true),
            materials: wanted.materials,
            emission: wanted.emission,
            sky: wanted.sky,
            camera: wanted.camera,
        }
    }
}

/// The rows of an image that are asked for beside radiance.
#[derive(Clone, Copy, Debug, Hash, PartialEq, Eq)]
pub(crate) struct Outputs {
    pub opacity: bool,
    pub depth: bool,
    pub normals: bool,
    /// Rows of shares of objects, the background's with them; 0 if they are not asked for.
    pub objects: usize,
}

impl Outputs {
    fn rows(self) -> usize {
        3 + usize::from(self.opacity)
            + usize::from(self.depth)
            + if self.normals { 3 } else { 0 }
            + self.objects
    }
}

/// Adds the means over some samples of pixels to rows, from a first row on; or sets rows to them, where they are
/// `fresh`. Threads of a pixel have `each` of its samples, in rows of their own.
#[cube(launch)]
fn render_pixels(
    floats: &[f32],
    words: &[u32],
    pixels: &[u32],
    image: &mut [f32],
    piece: Piece,
    row: u32,
    each: u32,
    fresh: u32,
    scale: f32,
    #[comptime] listed: bool,
    #[comptime] outputs: Outputs,
    #[comptime] features: Features,
) {
    let chunks = (piece.past - piece.from).div_ceil(each);
    if ABSOLUTE_POS < (piece.count * chunks) as usize {
        let thread = ABSOLUTE_POS as u32;
        let which = pixel_at(pixels, piece, thread % piece.count, listed);
        let scene = Scene::new(floats, words, which.view, features);
        let mut room = Array::<u32>::new(scene.features.stack);
        let stack = room.as_mut_slice();
        let rows = comptime!(outputs.rows());
        let own = (row + thread) as usize * rows;
        if fresh == 1 {
            let mut k = 0usize;
            while k < rows {
                image[own + k] = 0.0;
                k += 1;
            }
        }
        let mut sample = piece.from + thread / piece.count * each;
        let past = (sample + each).min(piece.past);
        while sample < past {
            let path = begin(&scene, which.pixel, sample);
            // Nothing is kept.
            let mut records = Array::<u32>::new(1usize);
            let room = Room {
                thread: 0u32,
                threads: 1u32,
            };
            let none = records.as_mut_slice();
            let seen = path_light(&scene, stack, none, room, path, from_camera(), false, false);
            image[own] += seen.radiance.x * scale;
            image[own + 1] += seen.radiance.y * scale;
            image[own + 2] += seen.radiance.z * scale;
            let mut at = own + 3;
            if comptime!(outputs.opacity) {
                image[at] += seen.opacity * scale;
                at += 1;
            }
            if comptime!(outputs.depth) {
                image[at] += seen.depth * scale * scene.settings[UNIT];
                at += 1;
            }
            if comptime!(outputs.normals) {
                image[at] += seen.normal.x * scale;
                image[at + 1] += seen.normal.y * scale;
                image[at + 2] += seen.normal.z * scale;
                at += 3;
            }
            if comptime!(outputs.objects > 0) {
                let mut object = comptime!(outputs.objects as u32 - 1).runtime();
                if seen.object != NONE {
                    object = scene.words[(scene.header[COUNTED] + seen.object) as usize];
                }
                image[at + object as usize] += scale;
            }
            sample += 1;
        }
    }
}

/// Adds rows of chunks of samples to those of an image, in order, or sets these to them.
#[cube(launch)]
fn add_chunks(
    partial: &[f32],
    image: &mut [f32],
    first: u32,
    length: u32,
    chunks: u32,
    fresh: u32,
) {
    if ABSOLUTE_POS < length as usize {
        let thread = ABSOLUTE_POS as u32;
        let own = (first + thread) as usize;
        let mut sum = 0.0f32;
        if fresh == 0 {
            sum = image[own];
        }
        let mut chunk = 0u32;
        while chunk < chunks {
            sum += partial[(chunk * length + thread) as usize];
            chunk += 1;
        }
        image[own] = sum;
    }
}
