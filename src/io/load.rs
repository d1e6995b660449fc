//! Files of scenes by their endings.

use std::path::Path;

use burn::tensor::Device;

use super::whole::ending;
use super::{LoadLimits, build, gltf, obj, ply};
use crate::error::Result;
use crate::scene::{Camera, Scene};

/// The endings of files that hold a scene.
pub(super) const SCENES: [&str; 4] = ["obj", "gltf", "glb", "ply"];

/// A scene and the cameras that its file has: their names, and width over height where the file says.
pub(super) struct Loaded {
    pub scene: Scene,
    pub cameras: Vec<(String, Camera, Option<f64>)>,
}

/// Reads a file that holds a scene.
pub(super) fn load(path: &Path, device: &Device, limits: &LoadLimits) -> Result<Loaded> {
    let description = match ending(path, &SCENES)? {
        "obj" => {
            return Ok(Loaded {
                scene: obj::read(path, device, limits)?,
                cameras: Vec::new(),
            });
        }
        "ply" => ply::read(path, limits)?,
        _ => gltf::read(path, limits)?,
    };
    let cameras = description.cameras.iter();
    let cameras = cameras.map(|c| (c.name.clone(), build::camera(c), c.aspect));
    Ok(Loaded {
        scene: build::scene(&description, path, limits, device)?,
        cameras: cameras.collect(),
    })
}
