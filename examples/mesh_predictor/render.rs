//! The scenes of the example, and renders of batches.

use softray::optim::loss;
use softray::prelude::*;

/// The distance of the camera from the origin, which it looks at, in scene units.
pub const DISTANCE: f64 = 4.2;
const FOV: f64 = 29.0;

/// Half of the view's width at distance 1.
pub fn half_view() -> f64 {
    (0.5 * FOV.to_radians()).tan()
}

/// Returns the angle of a pixel in degrees, of images with `size` rows and columns.
pub fn pixel(size: usize) -> f64 {
    (2.0 * half_view() / size as f64).atan().to_degrees()
}

/// The direction of a camera or lamp from the origin, in radians: the angle about the y axis, from z towards x, and
/// the angle above the horizon.
#[derive(Clone, Copy, Debug)]
pub struct Eye {
    pub azimuth: f64,
    pub elevation: f64,
}

impl Eye {
    /// The camera of all input images, which looks along −z.
    pub const INPUT: Self = Self {
        azimuth: 0.0,
        elevation: 0.0,
    };

    pub fn camera(self) -> Camera {
        Camera::look_at(on_sphere(self, DISTANCE), [0.0; 3]).with_fov_y(FOV)
    }
}

fn on_sphere(eye: Eye, radius: f64) -> [f64; 3] {
    let (sin, cos) = eye.elevation.sin_cos();
    let (x, z) = eye.azimuth.sin_cos();
    [radius * cos * x, radius * sin, radius * cos * z]
}

/// The light for renders of both the data and the predictions: a square lamp above, outside all cameras' views, and a
/// constant environment.
#[derive(Clone, Copy, Debug)]
pub struct Light {
    pub place: Eye,
    /// RGB.
    pub radiance: [f64; 3],
    pub environment: [f64; 3],
}

const LAMP_DISTANCE: f64 = 5.0;
const HALF_LAMP: f64 = 0.8;

impl Light {
    fn lamp(&self, device: &Device) -> Object {
        let center = glam::DVec3::from(on_sphere(self.place, LAMP_DISTANCE));
        let right = glam::DVec3::Y.cross(center).normalize();
        let up = center.normalize().cross(right);
        // Counter-clockwise as viewed from the origin.
        let corner = |x: f64, y: f64| (center + HALF_LAMP * (x * right + y * up)).to_array();
        let [a, b, c, d] =
            [(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)].map(|(x, y)| corner(x, y));
        Object::new(shapes::quad(a, b, c, d, device))
            .with_material(Material::emitter(self.radiance))
    }
}

/// Returns the scene of a body under a light.
pub fn scene(body: Mesh, color: impl Into<softray::scene::ColorTexture>, light: &Light) -> Scene {
    let device = body.vertices.device().inner();
    Scene::new()
        .with_object(Object::new(body).with_material(Material::diffuse(color)))
        .with_object(light.lamp(&device))
        .with_environment(light.environment)
}

/// Returns options for images with `size` rows and columns, direct light only, and `samples` paths per pixel.
pub fn options(size: usize, samples: u32) -> RenderOptions {
    RenderOptions::new(size, size)
        .with_bounces(0)
        .with_samples(samples)
}

/// The images of a batch.
#[derive(Clone)]
pub struct Seen {
    /// `[N, H, W, 3]`.
    pub radiance: Tensor<4>,
    /// `[N, H, W]`.
    pub opacity: Tensor<3>,
    /// The distance along the ray minus the origin's, times opacity, `[N, H, W]`, in scene units, if the options have depth.
    pub depth: Option<Tensor<3>>,
}

impl Seen {
    /// Returns the images with `size` rows and columns: the present number, divided by a power of 2.
    pub fn shrunk(self, size: usize) -> softray::Result<Self> {
        let levels = (self.opacity.dims()[1] / size).ilog2() as usize;
        let level = |images| -> softray::Result<Tensor<4>> {
            Ok(loss::pyramid(images, levels + 1)?.remove(levels))
        };
        let plane = |t: Tensor<3>| -> softray::Result<Tensor<3>> {
            Ok(level(t.unsqueeze_dim(3))?.squeeze_dim(3))
        };
        Ok(Self {
            radiance: level(self.radiance)?,
            opacity: plane(self.opacity)?,
            depth: self.depth.map(plane).transpose()?,
        })
    }
}

/// Renders all views of a batch, with opacity.
pub fn see(batch: &Batch, options: &RenderOptions) -> softray::Result<Seen> {
    let images = render_batch(batch, &options.clone().with_opacity())?;
    let Some(opacity) = images.opacity else {
        unreachable!("opacity is requested")
    };
    let depth = images.depth.map(|d| d - opacity.clone() * DISTANCE);
    Ok(Seen {
        radiance: images.radiance,
        opacity,
        depth,
    })
}
