//! A camera for a scene that nobody has chosen one for.

use glam::DVec3;

use super::options::RenderOptions;
use super::render;
use crate::error::Result;
use crate::geometry::host_values;
use crate::scene::{Camera, Detach, Scene, visit_scene};

/// Rows and columns of the images that directions are compared by.
const GRID: usize = 24;

/// Another direction has to show so many times as much as the ones before it.
const BETTER: f64 = 1.25;

/// A camera that has the whole of a scene in view from a side where it is open and lit: an open room is seen
/// through its missing wall, an object from the front, a little above. It compares small renders from
/// fourteen directions. A closed room is looked at from inside.
///
/// # Errors
/// If the scene is not valid.
pub fn overview(scene: &Scene) -> Result<Camera> {
    let mut scene = scene.clone();
    visit_scene(&mut scene, &mut Detach);
    let mut best: Option<(f64, Camera)> = None;
    for camera in candidates(&scene)? {
        let shown = shown(&scene, &camera)?;
        if best.as_ref().is_none_or(|(most, _)| shown > BETTER * most) {
            best = Some((shown, camera));
        }
    }
    match best {
        Some((_, camera)) => Ok(camera),
        None => Camera::framing(&scene, [0.0, 0.0, 1.0]),
    }
}

/// The front, slightly above and to the right, comes first.
fn candidates(scene: &Scene) -> Result<Vec<Camera>> {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let mut directions = vec![0.4 * x + 0.4 * y + z, z, -z, x, -x, y, -y];
    for [i, j] in [[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]] {
        directions.push(i * x + 0.6 * y + j * z);
    }
    let mut cameras = Vec::new();
    for direction in &directions {
        cameras.push(Camera::framing(scene, *direction)?);
    }
    // From the middle of a closed room, along its axes.
    let middle = cameras[0].target.values()?;
    for direction in [-z, -x, z] {
        let eye = DVec3::from(middle);
        cameras.push(Camera::look_at(eye - 1e-3 * direction, eye + direction).fov_y(75.0));
    }
    Ok(cameras)
}

/// The share of an image in which something that is lit is seen, as an eye that has adapted sees it: bright parts
/// do not count for more than others.
fn shown(scene: &Scene, camera: &Camera) -> Result<f64> {
    let options = RenderOptions::new(GRID, GRID)
        .samples(4)
        .bounces(2)
        .with_opacity();
    let image = render(scene, camera, &options)?;
    let radiance = host_values(&image.radiance)?;
    let opacity = match &image.opacity {
        Some(plane) => host_values(plane)?,
        None => Vec::new(),
    };
    let brightest = radiance.iter().copied().fold(0.0, f64::max);
    if brightest <= 0.0 {
        return Ok(0.0);
    }
    let pixels = radiance.chunks_exact(3).zip(&opacity);
    let lit = pixels.map(|(rgb, opacity)| {
        let luminance = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
        // Lights are far brighter than what they light: half of full marks for a hundredth of the brightest.
        opacity * luminance / (luminance + 0.01 * brightest)
    });
    Ok(lit.sum::<f64>() / (GRID * GRID) as f64)
}
