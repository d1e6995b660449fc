//! Loads scene files by their extensions.

use std::path::Path;

use burn::tensor::Device;

use super::description::NamedCamera;
use super::files::{Files, Place};
use super::whole::ending;
use super::{build, gltf, obj, ply};
use crate::error::Result;
use crate::scene::Scene;

/// The extensions of files that hold a scene.
pub(super) const SCENES: [&str; 4] = ["obj", "gltf", "glb", "ply"];

/// Reads a file that holds a scene, and returns the scene and the cameras of the file.
pub(super) fn load(
    path: &Path,
    device: &Device,
    files: Files,
) -> Result<(Scene, Vec<NamedCamera>)> {
    let description = match ending(path, &SCENES)? {
        "obj" => obj::read(path, files)?,
        "ply" => ply::read(path, files)?,
        _ => gltf::read(path, files)?,
    };
    let place = Place {
        path,
        files,
        device,
    };
    let scene = build::scene(&description, place)?;
    description.notes.warn(path);
    Ok((scene, description.cameras))
}
