use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use burn::tensor::Device;
use serde::Deserialize;
use serde::de::IgnoredAny;

use super::files::{Files, MemoryFiles, Place};
use super::limits::parse_json;
use super::load::{SCENES, load};
use super::scene_materials::MaterialDocument;
use super::whole::ending;
use super::{HostImage, LoadLimits};
use crate::error::{Error, Result, one_of};
use crate::scene::{Camera, Environment, Light, Scene};
use softray_kernels::warning;

/// A scene with a camera and an image size, loaded from a file.
///
/// - glTF (`.gltf`, `.glb`): the first camera of the file, and 256 rows at its aspect ratio.
/// - OBJ, PLY, or glTF without a camera: [`Camera::framing`] from the front, and 256 × 256 pixels.
/// - JSON that refers to one of these files and sets the camera:
///
/// ```json
/// {
///   "scene": "scene.obj",
///   "camera": {
///     "eye": [0, 1, 4], "target": [0, 0, 0], "up": [0, 1, 0],
///     "fov_y_degrees": 40, "width": 64, "height": 64,
///     "aperture_radius": 0.1, "focus_distance": 4
///   },
///   "environment": [0.1, 0.1, 0.1],
///   "lights": [
///     { "kind": "point", "position": [1, 3, 1], "intensity": [20, 18, 15] },
///     { "kind": "spot", "position": [0, 3, 0], "direction": [0, -1, 0], "intensity": [9, 9, 9],
///       "inner_degrees": 10, "outer_degrees": 30 },
///     { "kind": "directional", "direction": [0, -1, 0.3], "irradiance": [1, 1, 1] }
///   ],
///   "velocities": { "ball": [0.5, 0, 0] },
///   "materials": {
///     "ball": { "bsdf": "dielectric", "ior": 1.5, "roughness": 0.1 },
///     "ring": { "bsdf": "conductor", "eta": [0.14, 0.37, 1.44], "extinction": [3.98, 2.39, 1.6], "roughness": 0.2 },
///     "floor": { "bsdf": "metallic_roughness", "base_color": "wood.png", "metallic": 0, "roughness": "rough.png" }
///   }
/// }
/// ```
///
/// `obj` is an alias of `scene`. `environment` is a constant radiance, or the file of an equirectangular map
/// (`"sky.hdr"`). Optional fields are `up` (default: y), the lens (a pinhole), `environment` (black), `lights`
/// (none), `velocities` and `materials` (those of the scene). A lens without a focus distance is focused on the
/// target. `lights` are added to the lights of the file, in the units of [`Light`]. A material replaces the material
/// of an object. Its `base_color` (white), `roughness` (1), `metallic` (0) and `ior` (1.5) may be images. Of these,
/// the roughness is the green channel, `metallic` the blue and `ior` the red channel, without color conversion. With
/// `"compensated": false` no light is added back ([`Material::with_compensated`](crate::scene::Material::with_compensated)). A
/// warning lists unknown fields; in a material, they are an error.
#[derive(Clone, Debug)]
pub struct SceneFile {
    /// The scene.
    pub scene: Scene,
    /// The camera.
    pub camera: Camera,
    /// All cameras of the file with their names. Empty if the file has no camera.
    pub cameras: Vec<(String, Camera)>,
    /// Columns of the image.
    pub width: usize,
    /// Rows of the image.
    pub height: usize,
}

/// Rows of the image if the file does not set its size.
const ROWS: usize = 256;

/// The largest number of columns of such an image.
const MAX_COLUMNS: f64 = 4096.0;

/// Returns whether a file is JSON. An extension that is not supported is an error.
pub(super) fn is_json(path: &Path) -> Result<bool> {
    let known = [&SCENES[..], &["json"]].concat();
    Ok(ending(path, &known)? == "json")
}

/// Unknown fields by their names.
type Unknown = BTreeMap<String, IgnoredAny>;

#[derive(Deserialize)]
struct Document {
    #[serde(alias = "obj")]
    scene: String,
    camera: CameraDocument,
    environment: Option<serde_json::Value>,
    #[serde(default)]
    lights: Vec<LightDocument>,
    #[serde(default)]
    velocities: BTreeMap<String, [f64; 3]>,
    #[serde(default)]
    materials: BTreeMap<String, MaterialDocument>,
    #[serde(flatten)]
    unknown: Unknown,
}

impl Document {
    /// Returns the paths of the unknown fields.
    fn unknown(&self) -> Vec<String> {
        let lights = self.lights.iter().enumerate();
        let lights = lights.map(|(i, light)| (format!("lights[{i}]."), light.unknown()));
        let all = [
            (String::new(), &self.unknown),
            ("camera.".into(), &self.camera.unknown),
        ];
        let names = |(place, fields): (String, &Unknown)| {
            let names: Vec<String> = fields.keys().map(|name| format!("{place}{name}")).collect();
            names
        };
        all.into_iter().chain(lights).flat_map(names).collect()
    }
}

#[derive(Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
enum LightDocument {
    Point {
        position: [f64; 3],
        intensity: [f64; 3],
        #[serde(flatten)]
        unknown: Unknown,
    },
    Spot {
        position: [f64; 3],
        direction: [f64; 3],
        intensity: [f64; 3],
        inner_degrees: f64,
        outer_degrees: f64,
        #[serde(flatten)]
        unknown: Unknown,
    },
    Directional {
        direction: [f64; 3],
        irradiance: [f64; 3],
        #[serde(flatten)]
        unknown: Unknown,
    },
}

#[derive(Deserialize)]
struct CameraDocument {
    eye: [f64; 3],
    target: [f64; 3],
    #[serde(default = "y_axis")]
    up: [f64; 3],
    fov_y_degrees: f64,
    width: usize,
    height: usize,
    aperture_radius: Option<f64>,
    focus_distance: Option<f64>,
    #[serde(flatten)]
    unknown: Unknown,
}

fn y_axis() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

impl SceneFile {
    /// Reads a scene with its camera from a file; see [`SceneFile`] and [`Scene::load`].
    ///
    /// # Errors
    /// If a file is missing, malformed, too large, or outside the first file's folder ([`LoadLimits`]), or if a
    /// velocity or material refers to an object that does not exist.
    pub fn load(path: impl AsRef<Path>, device: &Device) -> Result<Self> {
        Self::load_within(path, device, &LoadLimits::default())
    }

    /// Reads a file like [`SceneFile::load`], with the given limits.
    ///
    /// # Errors
    /// As [`SceneFile::load`].
    pub fn load_within(
        path: impl AsRef<Path>,
        device: &Device,
        limits: &LoadLimits,
    ) -> Result<Self> {
        Self::load_from(path.as_ref(), device, Files::of_system(limits))
    }

    /// Reads a scene with its camera from files in memory; see [`Scene::from_bytes`] and [`SceneFile::load`].
    ///
    /// # Errors
    /// As [`SceneFile::load`], and if two files have the same name.
    pub fn from_bytes<N: Into<PathBuf>, B: Into<Vec<u8>>>(
        path: impl AsRef<Path>,
        files: impl IntoIterator<Item = (N, B)>,
        device: &Device,
        limits: &LoadLimits,
    ) -> Result<Self> {
        let files = MemoryFiles::new(files)?;
        Self::load_from(path.as_ref(), device, Files::in_memory(&files, limits))
    }

    fn load_from(path: &Path, device: &Device, files: Files) -> Result<Self> {
        if is_json(path)? {
            return Self::from_json(path, device, files);
        }
        let (scene, cameras) = load(path, device, files)?;
        let (camera, aspect) = match cameras.first() {
            Some((_, camera, aspect)) => (camera.clone(), aspect.unwrap_or(1.0)),
            None => (Camera::framing(&scene, [0.4, 0.4, 1.0])?, 1.0),
        };
        let width = (ROWS as f64 * aspect).round().clamp(1.0, MAX_COLUMNS);
        Ok(Self {
            scene,
            camera,
            cameras: cameras.into_iter().map(|(name, c, _)| (name, c)).collect(),
            width: width as usize,
            height: ROWS,
        })
    }

    pub(super) fn from_json(path: &Path, device: &Device, files: Files) -> Result<Self> {
        let document: Document = parse_json(path, files.read_text(path)?.as_bytes())?;
        let unknown = document.unknown();
        if !unknown.is_empty() {
            let (file, list) = (path.display(), unknown.join(", "));
            warning!("{file}: these fields are not known: {list}");
        }
        let camera = document.camera;
        for (field, size) in [("width", camera.width), ("height", camera.height)] {
            if size == 0 {
                let message = format!("camera.{field} is 0, expected at least 1");
                return Err(Error::format(path, message));
            }
        }
        let file = files.beside(path, &document.scene)?;
        let named_by = path.display().to_string();
        let (mut scene, _) = load(&file, device, files).map_err(|e| match &e {
            Error::Io { path, .. } if *path == file => e.named_by(&named_by),
            _ => e,
        })?;
        if let Some(value) = document.environment {
            let constant = serde_json::from_value::<[f64; 3]>(value.clone()).ok();
            scene = match (value.as_str(), constant) {
                (Some(file), _) => {
                    let file = files.beside(path, file)?;
                    let map = HostImage::read_from(&file, files);
                    let map = map.map_err(|e| e.named_by(&named_by))?;
                    scene.with_environment(Environment::map(map.into_tensor(device)))
                }
                (None, Some(radiance)) => scene.with_environment(radiance),
                (None, None) => {
                    let message = format!(
                        "environment is {value}, expected three numbers or the name of an image"
                    );
                    return Err(Error::format(path, message));
                }
            };
        }
        for light in document.lights {
            scene = scene.with_light(light.build());
        }
        let known = |scene: &Scene, field: &str, name: &str| {
            if scene.object(name).is_some() {
                return Ok(());
            }
            let known = one_of(scene.names());
            let message = format!("{field} names the object {name:?}, expected {known}");
            Err(Error::format(path, message))
        };
        for (name, velocity) in document.velocities {
            known(&scene, "velocities", &name)?;
            scene = scene.map_object(&name, |o| o.with_velocity(velocity))?;
        }
        let place = Place {
            path,
            files,
            device,
        };
        for (name, material) in document.materials {
            known(&scene, "materials", &name)?;
            let material = material.build(&name, &place)?;
            scene = scene.map_object(&name, |o| o.with_material(material.clone()))?;
        }
        let (width, height) = (camera.width, camera.height);
        let camera = camera.build();
        Ok(Self {
            scene,
            cameras: vec![("camera".into(), camera.clone())],
            camera,
            width,
            height,
        })
    }
}

impl LightDocument {
    fn unknown(&self) -> &Unknown {
        match self {
            Self::Point { unknown, .. }
            | Self::Spot { unknown, .. }
            | Self::Directional { unknown, .. } => unknown,
        }
    }

    fn build(self) -> Light {
        match self {
            Self::Point {
                position,
                intensity,
                ..
            } => Light::point(position, intensity),
            Self::Spot {
                position,
                direction,
                intensity,
                inner_degrees,
                outer_degrees,
                ..
            } => {
                let [inner, outer] = [inner_degrees, outer_degrees];
                Light::spot(position, direction, intensity, inner, outer)
            }
            Self::Directional {
                direction,
                irradiance,
                ..
            } => Light::directional(direction, irradiance),
        }
    }
}

impl CameraDocument {
    fn build(self) -> Camera {
        let camera = Camera::look_at(self.eye, self.target)
            .with_up(self.up)
            .with_fov_y(self.fov_y_degrees);
        match self.aperture_radius {
            Some(radius) => {
                let target = glam::DVec3::from(self.target);
                let to_target = target.distance(glam::DVec3::from(self.eye));
                camera.with_thin_lens(radius, self.focus_distance.unwrap_or(to_target))
            }
            None => camera,
        }
    }
}
