//! Chooses a camera for a scene.

use glam::DVec3;

use super::batch::Batch;
use super::options::RenderOptions;
use super::render_batch;
use crate::error::Result;
use crate::geometry::host_values;
use crate::scene::{Camera, Detach, Framing, Scene, visit_scene};

/// The width and height in pixels of the images that compare directions.
const GRID: usize = 24;

/// A scene that shows less than this from every direction is closed.
const DARK: f64 = 0.02;

/// The first direction that shows at least this fraction of the best one is chosen.
const NEARLY: f64 = 0.5;

/// Returns a camera that shows the whole scene from a side where it is open and lit.
///
/// The function compares small renders from eleven directions. The camera looks at an object from the front and a
/// little above, into an open room through its missing wall, and at a closed room from inside.
///
/// ```
/// use softray::prelude::*;
/// let device = Device::flex();
/// let scene = Scene::new()
///     .with_object(Object::new(shapes::icosphere(1, &device)))
///     .with_environment([1.0; 3]);
/// let camera = overview(&scene)?;
/// assert!(camera.eye.values()?[2] > 1.0);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If the scene is not valid.
pub fn overview(scene: &Scene) -> Result<Camera> {
    let mut scene = scene.clone();
    if scene.is_tracked() {
        visit_scene(&mut scene, &mut Detach);
    }
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    // The first direction suits objects.
    let mut directions = vec![0.4 * x + 0.4 * y + z, z, -z, x, -x, y, -y];
    for [i, j] in [[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]] {
        directions.push(i * x + 0.6 * y + j * z);
    }
    let framing = Framing::of(&scene)?;
    let outside = directions.into_iter().map(|d| framing.camera(d.into()));
    let (shown, camera) = best(&scene, outside.collect::<Result<_>>()?)?;
    if shown > DARK {
        return Ok(camera);
    }
    // From one side of a closed room to the other.
    let bounds = framing.bounds;
    let (center, size) = (DVec3::from(bounds.center()), DVec3::from(bounds.size()));
    let wide = |d: &DVec3| (size * *d).length() > 0.0;
    let inside = [z, x, -z, -x].into_iter().filter(wide).map(|d| {
        let eye = center + 0.45 * size * d;
        Camera::look_at(eye, center - 0.45 * size * d).with_fov_y(75.0)
    });
    let (more, view) = best(&scene, inside.collect())?;
    Ok(if more > shown { view } else { camera })
}

/// Returns the first camera that shows nearly as much as the best one.
fn best(scene: &Scene, cameras: Vec<Camera>) -> Result<(f64, Camera)> {
    let all = shown(scene, &cameras)?;
    let most = all.iter().copied().fold(0.0, f64::max);
    let mut all = all.into_iter().zip(cameras);
    match all.find(|c| c.0 >= NEARLY * most) {
        Some(best) => Ok(best),
        None => Ok((0.0, Camera::framing(scene, DVec3::Z)?)),
    }
}

/// Returns [`lit`] for each camera.
fn shown(scene: &Scene, cameras: &[Camera]) -> Result<Vec<f64>> {
    if cameras.is_empty() {
        return Ok(Vec::new());
    }
    let options = RenderOptions::new(GRID, GRID)
        .with_samples(4)
        .with_bounces(2)
        .with_opacity()
        .quietly();
    // One batch packs the scene once.
    let batch = Batch::product(vec![scene.clone()], cameras)?;
    let images = render_batch(&batch, &options)?;
    let radiance = host_values(&images.radiance)?;
    let opacity = match &images.opacity {
        Some(planes) => host_values(planes)?,
        None => Vec::new(),
    };
    let pixels = GRID * GRID;
    let views = radiance
        .chunks_exact(3 * pixels)
        .zip(opacity.chunks_exact(pixels));
    Ok(views
        .map(|(radiance, opacity)| lit(radiance, opacity))
        .collect())
}

/// The fraction of the covered pixels that is lit. Luminance is compressed as by an adapted eye, so that bright parts
/// do not count more than others.
fn lit(radiance: &[f64], opacity: &[f64]) -> f64 {
    let brightest = radiance.iter().copied().fold(0.0, f64::max);
    if brightest <= 0.0 {
        return 0.0;
    }
    let covered: f64 = opacity.iter().sum();
    let pixels = radiance.chunks_exact(3).zip(opacity);
    let lit = pixels.map(|(rgb, opacity)| {
        let luminance = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
        // Lights are far brighter than lit surfaces, so a hundredth of the maximum already has weight ½.
        opacity * luminance / (luminance + 0.01 * brightest)
    });
    lit.sum::<f64>() / covered.max(1.0)
}
