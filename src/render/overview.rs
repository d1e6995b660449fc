//! A camera for a scene that nobody has chosen one for.

use glam::DVec3;

use super::options::RenderOptions;
use super::render;
use crate::error::Result;
use crate::geometry::host_values;
use crate::scene::{Camera, Detach, Scene, visit_scene};

/// Rows and columns of the images that directions are compared by.
const GRID: usize = 24;

/// A scene that shows less from everywhere is closed.
const DARK: f64 = 0.02;

/// A direction that shows this share of the best one will do.
const NEARLY: f64 = 0.5;

/// A camera that has the whole of a scene in view from a side where it is open and lit: an open room is seen
/// through its missing wall, an object from the front, a little above. It compares small renders from
/// eleven directions. A closed room is seen from inside.
///
/// ```
/// use softray::prelude::*;
/// let device = Device::flex();
/// let scene = Scene::new()
///     .with(Object::new(shapes::icosphere(1, &device)))
///     .environment([1.0; 3]);
/// let camera = overview(&scene)?;
/// assert!(camera.eye.values()?[2] > 1.0);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If the scene is not valid.
pub fn overview(scene: &Scene) -> Result<Camera> {
    let mut scene = scene.clone();
    visit_scene(&mut scene, &mut Detach);
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    // The first one is that of an object.
    let mut directions = vec![0.4 * x + 0.4 * y + z, z, -z, x, -x, y, -y];
    for [i, j] in [[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]] {
        directions.push(i * x + 0.6 * y + j * z);
    }
    let outside = directions.into_iter().map(|d| Camera::framing(&scene, d));
    let (shown, camera) = best(&scene, outside)?;
    if shown > DARK {
        return Ok(camera);
    }
    // From one side of a closed room to the other.
    let bounds = scene.bounds()?;
    let (center, size) = (DVec3::from(bounds.center()), DVec3::from(bounds.size()));
    let inside = [z, x, -z, -x].into_iter().map(|d| {
        let eye = center + 0.45 * size * d;
        Ok(Camera::look_at(eye, center - 0.45 * size * d).fov_y(75.0))
    });
    let (more, view) = best(&scene, inside)?;
    Ok(if more > shown { view } else { camera })
}

/// The first camera that shows nearly as much as any.
fn best(scene: &Scene, cameras: impl Iterator<Item = Result<Camera>>) -> Result<(f64, Camera)> {
    let mut all = Vec::new();
    for camera in cameras {
        let camera = camera?;
        all.push((shown(scene, &camera)?, camera));
    }
    let most = all.iter().map(|c| c.0).fold(0.0, f64::max);
    match all.into_iter().find(|c| c.0 >= NEARLY * most) {
        Some(best) => Ok(best),
        None => Ok((0.0, Camera::framing(scene, DVec3::Z)?)),
    }
}

/// The share of the pixels with surfaces in which they are lit, as an eye that has adapted sees it: bright parts do
/// not count for more than others.
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
    let covered: f64 = opacity.iter().sum();
    let pixels = radiance.chunks_exact(3).zip(&opacity);
    let lit = pixels.map(|(rgb, opacity)| {
        let luminance = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
        // Lights are far brighter than what they light: half of full marks for a hundredth of the brightest.
        opacity * luminance / (luminance + 0.01 * brightest)
    });
    Ok(lit.sum::<f64>() / covered.max(1.0))
}
