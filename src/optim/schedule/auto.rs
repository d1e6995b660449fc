//! Blur by the scene, the camera and the pixels of a fit.

use burn::tensor::Tensor;

use super::BlurSchedule;
use crate::error::{Error, Result};
use crate::geometry::host_values;
use crate::render::{RenderOptions, render};
use crate::scene::{Camera, Detach, Flattened, Scene, visit_tensors};

/// √σ at the start of [`BlurSchedule::auto`], as a share of the radius of the smallest object.
const START: f64 = 0.25;
/// The most of it, as a share of the radius of what the camera sees.
const START_SEEN: f64 = 0.125;
/// √σ at the end of [`BlurSchedule::auto`], as a share of a pixel's footprint.
const END: f64 = 0.5;
/// The share of the steps over which [`BlurSchedule::auto`] decays; then it stays at the end.
const DECAY: f64 = 0.75;
/// √σ of [`BlurSchedule::sharp_sigma`], as a share of a pixel's footprint.
const SHARP: f64 = 0.02;

impl BlurSchedule {
    /// For a fit of `steps` steps on images of `height` rows, when nothing is known of the scene:
    ///
    /// - √σ starts at a quarter of the radius of the smallest object (half the diagonal of its
    ///   box), but not above an eighth of the radius of what is seen: of the scene, or of half the
    ///   image's height at the distance that [`pixel_footprint`] takes, whichever is smaller;
    /// - √σ ends at half a pixel's footprint (and starts there where the above is smaller);
    /// - it falls over the first three quarters of the steps and stays at the end for the rest.
    ///
    /// The start is a cautious one: much wider blur lights a scene differently, which draws objects
    /// away. It finds what is up to about 3√σ further off than without blur; where more is needed,
    /// give a start of one's own to [`BlurSchedule::decay`]. A ray costs as much as it meets
    /// surfaces: on meshes with edges much shorter than √σ, start smaller.
    ///
    /// # Errors
    /// If the scene or the camera is not valid, or `height` or `steps` is 0.
    pub fn auto(scene: &Scene, camera: &Camera, height: usize, steps: usize) -> Result<Self> {
        let view = View::new(scene, camera)?;
        let end = (END * view.footprint(height)?).powi(2);
        let seen = view.radius.min(0.5 * view.height);
        let start = (START * view.smallest).min(START_SEEN * seen).powi(2);
        let decay = (DECAY * steps as f64).ceil() as usize;
        Self::decay(start.max(end), end, decay)
    }

    /// The σ, in scene units squared, at which the layered form renders as accurately as a path
    /// tracer without blur: √σ is 0.02 of a pixel's footprint in images of `height` rows. Gradients
    /// remain unbiased there, only noisier.
    ///
    /// # Errors
    /// Like [`pixel_footprint`].
    pub fn sharp_sigma(scene: &Scene, camera: &Camera, height: usize) -> Result<f64> {
        Ok((SHARP * pixel_footprint(scene, camera, height)?).powi(2))
    }
}

/// The side of a pixel in scene units, in an image of `height` rows, at the distance of what the
/// camera sees: 2·z·tan(fov_y/2)/height. z is the median over the pixels of a small square image of
/// the distance along the view axis, or that of the point looked at where the camera sees nothing.
///
/// ```
/// use softray::optim::pixel_footprint;
/// use softray::prelude::*;
/// let wall = shapes::plane_grid(20.0, 20.0, 1, 1, &Device::flex());
/// let scene = Scene::new().with(Object::new(wall));
/// let camera = Camera::look_at([0.0, 4.0, 0.0], [0.0; 3]).up([0.0, 0.0, 1.0]).fov_y(90.0);
/// assert!((pixel_footprint(&scene, &camera, 16)? - 0.5).abs() < 1e-3);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If the scene or the camera is not valid, or `height` is 0.
pub fn pixel_footprint(scene: &Scene, camera: &Camera, height: usize) -> Result<f64> {
    View::new(scene, camera)?.footprint(height)
}

/// What a camera sees of a scene, in scene units.
struct View {
    /// The radius of the scene's bounds.
    radius: f64,
    /// Half the diagonal of the box around the smallest object.
    smallest: f64,
    /// The height of the image at the distance of what is seen.
    height: f64,
}

impl View {
    fn new(scene: &Scene, camera: &Camera) -> Result<Self> {
        let (mut scene, mut camera) = (scene.clone(), camera.clone());
        visit_tensors(&mut scene, &mut camera, &mut Detach);
        camera.lens = None;
        let radius = Flattened::new(&scene, &camera, None)?.bounds.radius;
        let mut smallest = f64::INFINITY;
        for object in scene.objects.iter().filter(|o| !o.mesh.faces.is_empty()) {
            let vertices = object.mesh.host_vertices()?;
            let corner = |pick: fn(glam::DVec3, glam::DVec3) -> glam::DVec3| {
                vertices.iter().map(|&v| v.into()).reduce(pick)
            };
            if let (Some(low), Some(high)) = (corner(glam::DVec3::min), corner(glam::DVec3::max)) {
                smallest = smallest.min(0.5 * low.distance(high));
            }
        }
        let [fov] = camera.fov_y.values()?;
        let half = (0.5 * fov).to_radians().tan();
        let options = RenderOptions::new(GRID, GRID)
            .samples(1)
            .bounces(0)
            .sigma((1e-4 * radius).powi(2))
            .with_opacity()
            .with_depth();
        let image = render(&scene, &camera, &options)?;
        let values = |plane: Option<Tensor<2>>| plane.map_or(Ok(Vec::new()), |p| host_values(&p));
        let (opacity, depth) = (values(image.opacity)?, values(image.depth)?);
        let on_film = |i: usize| half * (2.0 * (i as f64 + 0.5) / GRID as f64 - 1.0);
        let mut seen: Vec<f64> = (0..depth.len())
            .filter(|&i| opacity[i] > 0.5)
            .map(|i| {
                let [x, y] = [i % GRID, i / GRID].map(on_film);
                depth[i] / (1.0 + x * x + y * y).sqrt()
            })
            .collect();
        seen.sort_by(f64::total_cmp);
        let distance = match seen.get(seen.len() / 2) {
            Some(&z) => z,
            None => {
                let (eye, target) = (camera.eye.values()?, camera.target.values()?);
                glam::DVec3::from(eye).distance(target.into())
            }
        };
        Ok(Self {
            radius,
            smallest,
            height: 2.0 * distance * half,
        })
    }

    fn footprint(&self, rows: usize) -> Result<f64> {
        if rows == 0 {
            return Err(Error::invalid("image", "height", rows, "at least 1"));
        }
        Ok(self.height / rows as f64)
    }
}

/// Rows and columns of the image that distances are taken from.
const GRID: usize = 16;
