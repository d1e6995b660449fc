//! A scene as a camera sees it.

use std::ops::{Deref, Range};
use std::sync::{Arc, Once};

use super::edges::{EdgeSets, ROOM};
use super::gradient::Wanted;
use super::scene::KernelScene;
use crate::host::ParameterId;
use crate::model::camera::{Camera, HostCamera};
use crate::model::filter::PixelFilter;
use crate::model::integers::Wide;
use crate::sampling::{EmitterGroup, EmitterLists, Sampler, points};
use crate::trace::{Features, NONE, OF_CONES, OF_PATHS, PURPOSES, RARELY, Scene, emitters_of};
use crate::warning;

/// A scene as a camera sees it, with the settings of a render.
pub struct View {
    pub scene: Arc<KernelScene>,
    pub settings: ViewSettings,
    pub host_camera: HostCamera,
    pub camera: Camera,
    pub filter: Arc<PixelFilter>,
    /// The tangent of the half-angle of the cones of bounce and shadow rays.
    pub cone: f32,
    /// Random numbers for the cone kernels.
    pub cones: Sampler,
    pub arch: pulp::Arch,
    pub features: Features,
    pub wanted: Wanted,
    /// Lists that stages read in addition to those of the scene ([`Scene`]).
    flat: Flat,
    /// The edges at which something can jump.
    pub edge_sets: Option<Arc<EdgeSets>>,
    pub has_edges: bool,
}

/// Up to this many triangles, their edges mostly form a list and not a tree.
const MAX_LIST_TRIANGLES: usize = 21;

/// Lists of a view that stages read.
#[derive(Default)]
struct Flat {
    settings: Vec<f32>,
    of_groups: Vec<[u32; 3]>,
    seeds: [[u32; 2]; PURPOSES],
}

/// A view while its paths are traced, with the lists that stages read.
pub(super) struct Tracer<'a> {
    view: &'a View,
    pub lists: Scene<'a>,
    pub emitters: EmitterLists<'a>,
}

impl Deref for Tracer<'_> {
    type Target = View;

    #[inline(always)]
    fn deref(&self) -> &View {
        self.view
    }
}

/// The settings of a view, besides scene and camera.
#[derive(Clone)]
pub struct ViewSettings {
    pub width: u32,
    pub height: u32,
    /// The tangent of the half-angle of the cones of bounce and shadow rays.
    pub cone: f64,
    pub bounces: u32,
    pub roulette_after: Option<u32>,
    /// The limit of indirect light.
    pub clamp: Option<f32>,
    /// The least roughness of surfaces after a bounce.
    pub least_roughness: Option<f32>,
    /// Whether albedos are an output.
    pub albedo: bool,
    pub multiple_importance: bool,
    pub sampler: Sampler,
    /// Whether gradients contain the interior term, besides the boundary term.
    pub interior: bool,
}

impl ViewSettings {
    /// Returns whether a gradient of a scene has boundary terms. If nothing moves and normals turn, the jumps are in what
    /// sampled directions meet: directions to emitters and to a map do not turn, except those of polished surfaces to a
    /// map.
    pub fn has_jumps(&self, scene: &KernelScene, wanted: &Wanted) -> bool {
        let f = &scene.features;
        let gathers = f.sky_map && self.multiple_importance && self.cone <= 0.0;
        let meets = self.bounces > 0 || f.emitters || f.turns_to_map || !gathers;
        wanted.shifts() || wanted.of.turns && meets
    }
}

impl View {
    pub fn new(
        scene: Arc<KernelScene>,
        camera: HostCamera,
        filter: Arc<PixelFilter>,
        settings: ViewSettings,
        wanted: Wanted,
        edge_sets: Option<Arc<EdgeSets>>,
    ) -> Self {
        let mut model = camera.model(&scene.frame, settings.width, settings.height);
        model.filter = filter.cone_radius();
        let has_edges = |sets: &Arc<EdgeSets>| sets.seen_by(true).count > 0;
        let mut view = Self {
            host_camera: camera,
            camera: model,
            filter,
            cone: settings.cone as f32,
            cones: settings.sampler.of_purpose(OF_CONES as u64),
            arch: pulp::Arch::new(),
            features: Features::default(),
            flat: Flat::default(),
            has_edges: edge_sets.as_ref().is_some_and(has_edges),
            edge_sets,
            wanted,
            scene,
            settings,
        };
        view.features = view.features();
        view.add_derivatives();
        view.flat = view.flat();
        view
    }

    /// Returns this view with other random numbers.
    #[cfg(feature = "gpu")]
    pub fn with_sampler(&self, sampler: Sampler) -> Self {
        let settings = ViewSettings {
            sampler,
            ..self.settings.clone()
        };
        let (scene, filter) = (self.scene.clone(), self.filter.clone());
        let edges = self.edge_sets.clone();
        let wanted = self.wanted.clone();
        Self::new(scene, self.host_camera, filter, settings, wanted, edges)
    }

    fn features(&self) -> Features {
        let settings = &self.settings;
        let of_scene = self.scene.features;
        let gathers_map = of_scene.sky_map && settings.multiple_importance;
        let shines = of_scene.sky_map || of_scene.sky_constant;
        Features {
            lens: self.camera.aperture > 0.0,
            parallel: self.camera.parallel,
            // BSDF sampling also generates points on emitters.
            combined: settings.multiple_importance && !self.scene.emitters.triangles().is_empty(),
            sees_sky: shines && !gathers_map,
            gathers_map,
            turns_to_map: gathers_map && of_scene.turns_to_map && self.cone <= 0.0,
            cones: self.cone > 0.0,
            roulette: settings.roulette_after.is_some(),
            clamp: settings.clamp.is_some(),
            regularized: settings.least_roughness.is_some(),
            albedo: settings.albedo,
            sequence: settings.sampler.sequence,
            ..of_scene
        }
    }

    /// Adds to the required derivatives the flags and sizes that follow from the edges.
    fn add_derivatives(&mut self) {
        let has_nodes = |sets: &Arc<EdgeSets>| sets.seen_by(true).has_nodes;
        let of = &mut self.wanted.of;
        of.jumps = self.has_edges && !self.features.dark;
        // With many triangles this is always set, so that compiled kernels still fit when crossings change.
        let many = self.scene.lists.triangles.len() > MAX_LIST_TRIANGLES;
        of.edge_nodes = many || self.edge_sets.as_ref().is_some_and(has_nodes);
        of.grouped = self.scene.emitters.groups.len() > 1;
        of.edge_room = if of.jumps { ROOM } else { 1 };
    }

    /// Returns whether any material that camera rays may follow has derivatives, or the camera.
    fn sees_followed_move(&self) -> bool {
        let mut triangles = self.scene.lists.triangles.iter();
        let moves = |words: &[u32; _]| {
            let (material, object) = (words[0] as usize, words[1] as usize);
            self.wanted.objects[object] != 0 && self.scene.materials[material].is_followed()
        };
        self.wanted.of.camera || (self.features.follows_on_film() && triangles.any(moves))
    }

    fn flat(&self) -> Flat {
        let mut settings = self.camera.numbers().to_vec();
        let clamp = self.settings.clamp.unwrap_or(f32::INFINITY);
        let least = self.settings.least_roughness.unwrap_or(0.0);
        let following = match (&self.edge_sets, self.settings.interior) {
            (Some(sets), true) => sets.following,
            _ => -1.0,
        };
        let filter = match self.camera.filter > 0.0 || !self.sees_followed_move() {
            true => 0.0,
            false => self.filter.radius(),
        };
        let unit = self.scene.frame.unit as f32;
        let resting = if self.wanted.of.camera { 1.0 } else { RARELY };
        settings.extend([self.cone, unit, clamp, least, following, filter, resting]);
        let emitters = &self.scene.emitters;
        let group = |g: &EmitterGroup| {
            // The members of a group have consecutive numbers.
            let moves = g.members.iter().any(|&k| match emitters.light(k as usize) {
                None => self.wanted.objects[emitters.get(k as usize).object as usize] != 0,
                Some(light) => self.wanted.moving_lights[light],
            });
            [g.members[0], g.members.len() as u32, u32::from(moves)]
        };
        let paths = &self.settings.sampler;
        let seed = |purpose: usize| match purpose {
            OF_PATHS => paths.seed,
            _ => paths.of_purpose(purpose as u64).seed,
        };
        Flat {
            settings,
            of_groups: emitters.groups.iter().map(group).collect(),
            seeds: std::array::from_fn(seed).map(|seed: Wide| [seed.low, seed.high]),
        }
    }

    /// Returns this view with the lists that stages read.
    pub(super) fn tracer(&self) -> Tracer<'_> {
        let lists = self.lists();
        Tracer {
            view: self,
            lists,
            emitters: emitters_of(&lists),
        }
    }

    /// Returns the lists of the scene together with those of the view.
    pub fn lists(&self) -> Scene<'_> {
        let (settings, flat) = (&self.settings, &self.flat);
        let mut scene = Scene {
            features: self.features,
            filter: &self.filter.table,
            settings: &flat.settings,
            of_groups: flat.of_groups.as_flattened(),
            wanted_objects: &self.wanted.objects,
            wanted_lights: &self.wanted.lights,
            points: points(),
            seeds: flat.seeds.as_flattened(),
            width: settings.width,
            height: settings.height,
            bounces: settings.bounces,
            roulette_after: settings.roulette_after.unwrap_or(NONE),
            samples_log: settings.sampler.samples,
            sample_blocks: settings.sampler.pixels,
            ..self.scene.scene()
        };
        if let Some(sets) = &self.edge_sets {
            sets.add_to(&mut scene);
        }
        scene
    }

    /// Adds the derivatives with respect to parameters of the camera at their places in `all`.
    pub fn write_camera(
        &self,
        sums: &[f64],
        places: &[(ParameterId, Range<usize>)],
        all: &mut [f64],
    ) {
        let aspect = f64::from(self.settings.width) / f64::from(self.settings.height);
        let unit = self.scene.frame.unit;
        let filter = f64::from(self.camera.filter);
        self.host_camera
            .backward(sums, unit, (aspect, filter), places, all);
    }

    /// Logs a warning, once, if shadows of delta lights have hard edges, whose derivative is left out.
    pub fn warn_of_hard_shadows(&self) {
        static ONCE: Once = Once::new();
        let turns = self.wanted.of.turns && self.settings.bounces > 0;
        let seen = !self.scene.emitters.lights().is_empty() && (self.wanted.shifts() || turns);
        if self.cone == 0.0 && seen {
            ONCE.call_once(|| {
                warning!(
                    "the shadows of point, spot and directional lights have hard edges without cones, and \
                     gradients leave out that these move: render with an angle (RenderOptions::with_visibility, \
                     Visibility::cone)"
                );
            });
        }
    }
}
