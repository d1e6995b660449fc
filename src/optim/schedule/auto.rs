//! A blur schedule from the scene, the camera and the pixel size of a fit.

use burn::tensor::Tensor;

use super::BlurSchedule;
use crate::error::{Error, Result};
use crate::geometry::host_values;
use crate::render::{RenderOptions, render};
use crate::scene::{Bounds, Camera, Detach, Normalization, Scene, visit_tensors};

/// The start of [`BlurSchedule::auto`], as a share of the radius of the smallest object.
const START: f64 = 0.75;
/// The largest start, as a share of the scene's radius or of half the view's height, whichever is smaller.
const START_SEEN: f64 = 0.375;
/// The angle at the end of [`BlurSchedule::auto`], as a share of a pixel's angle.
const END: f64 = 0.5;
/// The share of the steps over which [`BlurSchedule::auto`] decays; the angle is constant after that.
const DECAY: f64 = 0.75;

impl BlurSchedule {
    /// A schedule of cone angles in degrees for a fit of `steps` steps on images of `height` rows, for scenes
    /// without a known suitable blur:
    ///
    /// - The start is the angle of a length at the distance of the visible surfaces: atan(length/distance). The
    ///   length is three quarters of the smallest object's radius (half the diagonal of its bounding box). It
    ///   is at most three eighths of the scene's radius (from the mean of all vertices to the farthest one) and
    ///   at most three eighths of half the image's height at that distance.
    /// - The end is half a pixel's angle, which is also the blur of the default pixel filter. If the start
    ///   would be smaller, the start is the end.
    /// - The angle falls over the first three quarters of the steps and is constant after that.
    ///
    /// The start is a cautious choice. Much wider cones change the lighting of a scene, which pulls objects
    /// away from the target. If a fit requires more, pass your own start to [`BlurSchedule::decay`].
    ///
    /// # Errors
    /// If the scene or the camera is not valid or cannot be rendered, or `height` or `steps` is 0.
    pub fn auto(scene: &Scene, camera: &Camera, height: usize, steps: usize) -> Result<Self> {
        let end = END * pixel_angle(camera, height)?;
        let view = View::new(scene, camera)?;
        let seen = view.radius.min(0.5 * view.height);
        let start = (START * view.smallest).min(START_SEEN * seen);
        let start = (start / view.distance).atan().to_degrees();
        let decay = (DECAY * steps as f64).ceil() as usize;
        Self::decay(start.max(end), end, decay)
    }
}

/// Returns the angle of a pixel in the middle of an image of `height` rows, in degrees:
/// atan(2·tan(fov_y/2)/height). For a camera with parallel rays it is the angle of a pixel at the target, seen
/// from the eye.
///
/// ```
/// use softray::optim::pixel_angle;
/// use softray::prelude::*;
/// let camera = Camera::look_at([0.0, 4.0, 0.0], [0.0; 3]).with_up([0.0, 0.0, 1.0]).with_fov_y(90.0);
/// assert!((pixel_angle(&camera, 16)? - 0.125f64.atan().to_degrees()).abs() < 1e-6);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If a value of the camera is out of range or cannot be read, or `height` is 0.
pub fn pixel_angle(camera: &Camera, height: usize) -> Result<f64> {
    Error::unless(height > 0, "image", "height", height, "at least 1")?;
    Ok((2.0 * camera.half_height()? / height as f64)
        .atan()
        .to_degrees())
}

/// The sizes and the distance of a scene as seen by a camera, in scene units.
struct View {
    /// The distance from the mean of all vertices to the farthest one.
    radius: f64,
    /// Half the diagonal of the bounding box of the smallest object.
    smallest: f64,
    /// The median distance of the visible surfaces along the view axis, and the height of the image there.
    distance: f64,
    height: f64,
}

impl View {
    fn new(scene: &Scene, camera: &Camera) -> Result<Self> {
        let (mut scene, mut camera) = (scene.clone(), camera.clone());
        visit_tensors(&mut scene, &mut camera, &mut Detach);
        camera.lens = None;
        let (host, context) = scene.read_back()?;
        camera.check(Some(&context))?;
        let radius = Normalization::new(&host).radius;
        let mut smallest = f64::INFINITY;
        for object in scene.objects.iter().filter(|o| !o.mesh.faces.is_empty()) {
            let bounds = Bounds::of_points(object.mesh.host_vertices()?);
            smallest = bounds.map_or(smallest, |b| smallest.min(b.radius()));
        }
        let half = camera.half_height()?;
        let options = RenderOptions::new(GRID, GRID)
            .with_samples(1)
            .with_bounces(0)
            .with_depth()
            .quietly();
        let image = render(&scene, &camera, &options)?;
        let values = |plane: Option<Tensor<2>>| plane.map_or(Ok(Vec::new()), |p| host_values(&p));
        let (opacity, depth) = (values(image.opacity)?, values(image.depth)?);
        let on_film = |i: usize| half * (2.0 * (i as f64 + 0.5) / GRID as f64 - 1.0);
        let mut seen: Vec<f64> = (0..depth.len())
            .filter(|&i| opacity[i] > 0.5)
            .map(|i| {
                let [x, y] = [i % GRID, i / GRID].map(on_film);
                depth[i] / opacity[i] / (1.0 + x * x + y * y).sqrt()
            })
            .collect();
        seen.sort_by(f64::total_cmp);
        let distance = match seen.get(seen.len() / 2) {
            Some(&z) if !camera.projection.is_parallel() => z,
            _ => {
                let (eye, target) = (camera.eye.values()?, camera.target.values()?);
                glam::DVec3::from(eye).distance(target.into())
            }
        };
        Ok(Self {
            radius,
            smallest,
            distance,
            height: 2.0 * distance * half,
        })
    }
}

/// Rows and columns of the image from which distances are measured.
const GRID: usize = 16;
