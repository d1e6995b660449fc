//! Kernels on GPUs: whole paths, one thread a pixel, in the language of CubeCL. Formulas are those of
//! `model`, so that the host and GPUs share them; what is here finds what they are applied to.

#![allow(unused_assignments)] // Variables of a kernel need a first value.
#![allow(clippy::too_many_arguments)] // Kernels have no globals.
#![allow(
    clippy::too_many_lines,
    reason = "calls are inlined, so a loop has one place for each"
)]

mod backward;
mod camera;
mod edge_layout;
mod edge_point;
mod edge_search;
mod edge_tree;
mod edge_weights;
mod film;
mod hit;
mod integers;
mod jumps;
mod launch;
mod layout;
mod light;
mod list;
mod numbers;
mod passes;
mod path;
mod records;
mod shadow_rays;
mod side_light;
mod sums;
mod surface;
mod surface_backward;

use burn::cubecl::{self, prelude::*};

use crate::accel::GpuTree;
use crate::kernel::View;
use crate::model::sky::Sky;
use crate::sampling::Sequence;
use camera::begin;
use edge_layout::{EDGE_TREES, NODE_COUNT};
use edge_tree::ROOM;
pub(crate) use launch::{FilmJob, Job, sums_of, sums_of_film, trace};
pub(crate) use layout::Packed;
use layout::{COUNTED, NONE, UNIT};
use path::{from_camera, path_light};
use records::Room;

/// What a kernel is compiled for: what a scene does not need is not in it.
#[derive(Clone, Copy, Debug, Hash, PartialEq, Eq)]
pub(crate) struct Features {
    /// Room for nodes, of a tree that has any.
    pub boxes: bool,
    pub stack: usize,
    pub moves: bool,
    pub lens: bool,
    pub parallel: bool,
    pub smooth: bool,
    pub textured: bool,
    pub glossy: bool,
    pub emitters: bool,
    pub by_solid_angle: bool,
    pub combined: bool,
    pub sky_constant: bool,
    pub sky_map: bool,
    pub sees_sky: bool,
    pub gathers_map: bool,
    pub dark: bool,
    pub cones: bool,
    pub roulette: bool,
    pub sobol: bool,
}

impl Features {
    fn of(view: &View, tree: &GpuTree) -> Self {
        let scene = &view.scene;
        Self {
            boxes: !tree.boxes.is_empty(),
            stack: tree.depth.next_multiple_of(16).max(16),
            moves: scene.velocities.is_some(),
            lens: view.camera.aperture > 0.0,
            parallel: view.camera.parallel,
            smooth: scene.smooth,
            textured: scene.textured,
            glossy: scene.glossy,
            emitters: !scene.emitters.is_empty(),
            by_solid_angle: scene.emitters.depends_on_position(),
            combined: view.combined,
            sky_constant: matches!(scene.sky, Sky::Constant(_)),
            sky_map: scene.sky.map().is_some(),
            sees_sky: view.sees_sky,
            gathers_map: view.gathers_map,
            dark: view.dark,
            cones: view.cone > 0.0,
            roulette: view.settings.roulette_after.is_some(),
            sobol: view.settings.sampler.sequence == Sequence::Sobol,
        }
    }
}

/// The derivatives that are asked for ([`Wanted`](crate::kernel::Wanted)).
#[derive(Clone, Copy, Debug, Hash, PartialEq, Eq)]
pub(crate) struct Derivatives {
    pub rays: bool,
    pub objects: bool,
    pub velocities: bool,
    pub uvs: bool,
    pub normals: bool,
    pub materials: bool,
    pub emission: bool,
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
    fn of(view: &View, words: &[u32]) -> Self {
        let wanted = &view.wanted;
        let jumps = adds_jumps(view) && !view.dark;
        Self {
            turns: wanted.turns(),
            jumps,
            edge_nodes: words[EDGE_TREES + NODE_COUNT] > 0,
            grouped: view.scene.emitters.groups.len() > 1,
            edge_room: if jumps { ROOM } else { 1 },
            rays: wanted.rays,
            objects: wanted.objects.contains(&true),
            velocities: wanted.velocities,
            uvs: wanted.uvs,
            normals: wanted.normals,
            materials: wanted.materials,
            emission: wanted.emission,
            sky: wanted.sky,
            camera: wanted.camera,
        }
    }
}

/// Whether kernels of a GPU know all that a scene has; one with colours at corners, normal maps or holes is rendered
/// by those of the host.
pub(crate) fn knows(view: &View) -> bool {
    let scene = &view.scene;
    scene.colours.values.is_empty() && !scene.tilted && scene.holes.is_none()
}

/// Whether kernels of a GPU add the jumps at edges that points of paths see. Lines of crossings that move while the
/// shutter is open are found anew at each time, which takes f64: these are for the host.
pub(crate) fn adds_jumps(view: &View) -> bool {
    view.has_edges && view.edge_sets.as_ref().is_some_and(|e| !e.any_apart())
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

/// Adds the means over some samples of pixels from a first one on to their rows.
#[cube(launch)]
fn render_pixels(
    floats: &[f32],
    words: &[u32],
    pixels: &[u32],
    image: &mut [f32],
    first: u32,
    count: u32,
    from: u32,
    past: u32,
    scale: f32,
    #[comptime] listed: bool,
    #[comptime] outputs: Outputs,
    #[comptime] features: Features,
) {
    if ABSOLUTE_POS < count as usize {
        let i = first + ABSOLUTE_POS as u32;
        let mut pixel = i;
        if listed {
            pixel = pixels[i as usize];
        }
        let mut room = Array::<u32>::new(features.stack);
        let stack = room.as_mut_slice();
        let rows = comptime!(outputs.rows());
        let own = i as usize * rows;
        let mut sample = from;
        while sample < past {
            let path = begin(floats, words, pixel, sample, features);
            // Nothing is kept.
            let mut records = Array::<u32>::new(1usize);
            let room = Room {
                thread: 0u32,
                threads: 1u32,
            };
            let none = records.as_mut_slice();
            let seen = path_light(
                floats,
                words,
                stack,
                none,
                room,
                path,
                from_camera(),
                false,
                false,
                features,
            );
            image[own] += seen.radiance.x * scale;
            image[own + 1] += seen.radiance.y * scale;
            image[own + 2] += seen.radiance.z * scale;
            let mut at = own + 3;
            if comptime!(outputs.opacity) {
                image[at] += seen.opacity * scale;
                at += 1;
            }
            if comptime!(outputs.depth) {
                image[at] += seen.depth * scale * floats[UNIT];
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
                    object = words[(words[COUNTED] + seen.object) as usize];
                }
                image[at + object as usize] += scale;
            }
            sample += 1;
        }
    }
}
