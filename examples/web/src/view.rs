//! The view of a scene that the visitor brings.

use glam::{DQuat, DVec3};
use softray::prelude::*;
use wasm_bindgen::prelude::*;

use crate::{Refined, rgba};

/// The memory that the scene of a file may take.
const MEMORY: u64 = 1 << 30;

/// A scene and a camera that turns about it.
#[wasm_bindgen]
pub struct View {
    scene: Scene,
    camera: Camera,
    refined: Refined,
    cache: HierarchyCache,
    /// Exposure in stops, chosen by the first picture.
    stops: Option<f64>,
    note: String,
    /// The distance of the camera from its target at first.
    reach: Option<f64>,
}

/// Files by their names.
#[wasm_bindgen]
#[derive(Default)]
pub struct Files(Vec<(String, Vec<u8>)>);

#[wasm_bindgen]
impl Files {
    #[wasm_bindgen(constructor)]
    pub fn new() -> Self {
        Self::default()
    }

    pub fn add(&mut self, name: String, bytes: Vec<u8>) {
        self.0.push((name, bytes));
    }
}

#[wasm_bindgen]
impl View {
    /// Returns the Cornell box.
    #[wasm_bindgen(constructor)]
    #[expect(
        clippy::new_without_default,
        reason = "it is a constructor of JavaScript"
    )]
    pub fn new() -> Self {
        let (scene, camera) = cornell_box(&Device::flex());
        Self::of(scene, camera, String::new())
    }

    fn of(scene: Scene, camera: Camera, note: String) -> Self {
        Self {
            scene,
            camera,
            refined: Refined::default(),
            cache: HierarchyCache::new(),
            stops: None,
            note,
            reach: None,
        }
    }

    /// Opens the file of a name, with the files that it refers to.
    pub fn open(name: &str, files: Files) -> Result<View, JsError> {
        let device = Device::flex();
        let limits = LoadLimits::default().with_memory(MEMORY);
        let SceneFile {
            scene,
            camera,
            cameras,
            ..
        } = SceneFile::from_bytes(name, files.0, &device, &limits)?;
        let (scene, note) = match scene.has_light() {
            true => (scene, ""),
            false => (
                scene.with_environment([1.0; 3]),
                "no light in the file: a white environment",
            ),
        };
        let camera = match cameras.is_empty() {
            true => overview(&scene)?,
            false => camera,
        };
        Ok(Self::of(scene, camera, note.into()))
    }

    /// What was added to the scene.
    pub fn note(&self) -> String {
        self.note.clone()
    }

    /// Turns the camera about its target by degrees, and multiplies the distance.
    pub fn turn(&mut self, right: f64, up: f64, nearer: f64) -> Result<(), JsError> {
        let [eye, target, axis] = [&self.camera.eye, &self.camera.target, &self.camera.up];
        let (eye, target) = (DVec3::from(eye.values()?), DVec3::from(target.values()?));
        let axis = DVec3::from(axis.values()?).normalize_or(DVec3::Y);
        let away = DQuat::from_axis_angle(axis, -right.to_radians()) * (eye - target);
        // The camera stays clear of the axis.
        let now = 90.0 - away.angle_between(axis).to_degrees();
        let rise = (now + up).clamp(-85.0, 85.0) - now;
        let across = axis.cross(away).normalize_or_zero();
        let away = DQuat::from_axis_angle(across, -rise.to_radians()) * away;
        let reach = *self.reach.get_or_insert(away.length());
        let distance = (away.length() * nearer).clamp(1e-3 * reach, 1e2 * reach);
        self.camera.eye = (target + away.normalize_or(axis) * distance)
            .to_array()
            .into();
        self.refined = Refined::default();
        Ok(())
    }

    fn options(&self, width: usize, height: usize, bounces: u32) -> RenderOptions {
        RenderOptions::new(width, height)
            .with_bounces(bounces)
            .with_cache(&self.cache)
    }

    /// Refines the image by a pass. Returns it, or nothing once all passes are done.
    pub fn refine(&mut self, width: usize, height: usize) -> Result<Option<Vec<u8>>, JsError> {
        let options = self.options(width, height, 3);
        let image = (self.refined).refine(&self.scene, &self.camera, &options)?;
        Ok(image.map(|image| {
            let stops = *self.stops.get_or_insert_with(|| image.automatic_exposure());
            rgba(&image.exposed(stops))
        }))
    }

    /// Returns the linear RGB of an image of its own.
    pub fn radiance(
        &self,
        width: usize,
        height: usize,
        samples: u32,
        bounces: u32,
    ) -> Result<Vec<f32>, JsError> {
        let options = self.options(width, height, bounces).with_samples(samples);
        let image = render(&self.scene, &self.camera, &options)?;
        Ok(HostImage::from_tensor(&image.radiance)?.pixels)
    }
}
