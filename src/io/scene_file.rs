use std::collections::BTreeMap;
use std::path::Path;

use burn::tensor::Device;
use serde::Deserialize;

use super::limits::read_text;
use super::{HostImage, LoadLimits};
use crate::error::{Error, Result, one_of};
use crate::scene::{Camera, Environment, Scene};

/// A scene with a camera and an image size, from a JSON file that names an OBJ file:
///
/// ```json
/// {
///   "obj": "scene.obj",
///   "camera": {
///     "eye": [0, 1, 4], "target": [0, 0, 0], "up": [0, 1, 0],
///     "fov_y_degrees": 40, "width": 64, "height": 64,
///     "aperture_radius": 0.1, "focus_distance": 4
///   },
///   "environment": [0.1, 0.1, 0.1],
///   "velocities": { "ball": [0.5, 0, 0] }
/// }
/// ```
///
/// `environment` is a constant radiance, or the file of an equirectangular map (`"sky.hdr"`). `up`
/// (y), the lens (a pinhole), `environment` (black) and `velocities` (none) may be left out;
/// other fields are ignored. A lens without a focus distance focuses on the target.
#[derive(Clone, Debug)]
pub struct SceneFile {
    /// The scene.
    pub scene: Scene,
    /// The camera.
    pub camera: Camera,
    /// Columns of the image.
    pub width: usize,
    /// Rows of the image.
    pub height: usize,
}

#[derive(Deserialize)]
struct Document {
    obj: String,
    camera: CameraDocument,
    environment: Option<serde_json::Value>,
    #[serde(default)]
    velocities: BTreeMap<String, [f64; 3]>,
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
}

fn y_axis() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

impl SceneFile {
    /// Reads the JSON file and the OBJ file that it names, relative to its own folder.
    ///
    /// # Errors
    /// When a file is missing, malformed, too large, or outside of the JSON file's folder
    /// ([`LoadLimits`]), or a velocity names no object.
    pub fn load(path: impl AsRef<Path>, device: &Device) -> Result<Self> {
        Self::load_within(path, device, &LoadLimits::default())
    }

    /// As [`SceneFile::load`] with given limits.
    ///
    /// # Errors
    /// As [`SceneFile::load`].
    pub fn load_within(
        path: impl AsRef<Path>,
        device: &Device,
        limits: &LoadLimits,
    ) -> Result<Self> {
        let path = path.as_ref();
        let text = read_text(path, limits)?;
        let mut json = serde_json::Deserializer::from_str(&text);
        let document: Document = serde_path_to_error::deserialize(&mut json).map_err(|e| {
            let field = match e.path().to_string() {
                // At the top there is no field to name.
                top if top == "." => String::new(),
                field => field + ": ",
            };
            let ending = path.extension().unwrap_or_default();
            let hint = match ending.eq_ignore_ascii_case("obj") {
                true => "; an OBJ file is read by Scene::from_obj",
                false => "",
            };
            Error::format(path, format!("{field}{}{hint}", e.into_inner()))
        })?;
        json.end().map_err(|e| Error::format(path, e.to_string()))?;
        let camera = document.camera;
        for (field, size) in [("width", camera.width), ("height", camera.height)] {
            if size == 0 {
                let message = format!("camera.{field} is 0, expected at least 1");
                return Err(Error::format(path, message));
            }
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        let named_by = path.display().to_string();
        let obj = folder.join(&document.obj);
        limits.check_place(&obj, folder, &named_by)?;
        let mut scene = Scene::from_obj_within(obj, device, limits)?;
        if let Some(value) = document.environment {
            let map = value.as_str().map(|file| folder.join(file));
            let constant = serde_json::from_value::<[f64; 3]>(value.clone()).ok();
            scene = match (map, constant) {
                (Some(file), _) => {
                    limits.check_place(&file, folder, &named_by)?;
                    let map = HostImage::read_within(file, limits)?.into_tensor(device);
                    scene.environment(Environment::map(map))
                }
                (None, Some(radiance)) => scene.environment(radiance),
                (None, None) => {
                    let message = format!(
                        "environment is {value}, expected three numbers or the name of an image"
                    );
                    return Err(Error::format(path, message));
                }
            };
        }
        for (name, velocity) in document.velocities {
            if scene.object(&name).is_none() {
                let known = one_of(scene.names());
                let message = format!("velocities names the object {name:?}, expected {known}");
                return Err(Error::format(path, message));
            }
            scene = scene.map_object(&name, |o| o.velocity(velocity))?;
        }
        Ok(Self {
            scene,
            width: camera.width,
            height: camera.height,
            camera: camera.build(),
        })
    }
}

impl CameraDocument {
    fn build(self) -> Camera {
        let camera = Camera::look_at(self.eye, self.target)
            .up(self.up)
            .fov_y(self.fov_y_degrees);
        match self.aperture_radius {
            Some(radius) => {
                let target = glam::DVec3::from(self.target);
                let to_target = target.distance(glam::DVec3::from(self.eye));
                camera.thin_lens(radius, self.focus_distance.unwrap_or(to_target))
            }
            None => camera,
        }
    }
}
