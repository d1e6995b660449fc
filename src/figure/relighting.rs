use burn::tensor::Tensor;
use glam::{DQuat, DVec3};

use super::Figure;
use crate::error::Result;
use crate::io::Animation;
use crate::render::RenderOptions;
use crate::scene::{Camera, Environment, Object, Scene};

/// The field of view of the pictures in degrees, and the distance of the eye, in radii of the object about
/// the center of its bounds.
const VIEW: (f64, f64) = (30.0, 4.2);
/// The elevation of the eye, in degrees.
const ELEVATION: f64 = 15.0;
/// The rows and columns of the skies, and the number of upper rows with the first color.
const SKY: [usize; 3] = [16, 32, 6];

/// Pictures of an object alone, in other light than that in which it was seen: they show what of its colors is light or shadow.
///
/// ```no_run
/// use softray::figure::Relighting;
/// use softray::prelude::*;
/// let object = Object::new(shapes::icosphere(3, &Device::flex()));
/// let relighting = Relighting::new(&object, [0.0, 1.0, 0.0])?;
/// relighting.figure(256)?.write("relit.png")?;
/// relighting.turntable(256)?.write("turntable.gif")?;
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Relighting {
    skies: [(&'static str, Scene); 2],
    radius: f64,
}

impl Relighting {
    /// Puts an object, for which `up` is up, under a bluish sky, and above a bright orange floor.
    ///
    /// # Errors
    /// If the object has no bounds, or `up` is not a unit vector.
    pub fn new(object: &Object, up: [f64; 3]) -> Result<Self> {
        let mut object = object.clone();
        let unit = (DVec3::from(up).length() - 1.0).abs() < 1e-6;
        crate::Error::unless(unit, "relighting", "up", format!("{up:?}"), "a unit vector")?;
        let (axis, angle) = DQuat::from_rotation_arc(up.into(), DVec3::Y).to_axis_angle();
        object.mesh = object.mesh.rotated(axis.to_array(), angle.to_degrees());
        let bounds = object.mesh.bounds()?;
        object.mesh = object.mesh.translated(bounds.center().map(|x| -x));
        let vertices = object.mesh.host_vertices()?;
        let lengths = vertices.iter().map(|v| DVec3::from(*v).length());
        let device = object.mesh.vertices.device();
        let [rows, columns, above] = SKY;
        let under = |top: [f32; 3], bottom: [f32; 3]| {
            let texels = [
                top.repeat(above * columns),
                bottom.repeat((rows - above) * columns),
            ];
            let texels = Tensor::<1>::from_floats(texels.concat().as_slice(), &device);
            let sky = Environment::map(texels.reshape([rows, columns, 3]));
            Scene::new()
                .with_object(object.clone())
                .with_environment(sky)
        };
        Ok(Self {
            skies: [
                ("cool sky", under([1.3, 1.6, 2.0], [0.25, 0.22, 0.2])),
                ("warm floor", under([0.15, 0.15, 0.2], [1.5, 1.0, 0.6])),
            ],
            radius: lengths.fold(0.0, f64::max),
        })
    }

    /// Renders the object from four sides in both lights, in squares of `side` pixels.
    ///
    /// # Errors
    /// If a render fails.
    pub fn figure(&self, side: usize) -> Result<Figure> {
        let mut figure = Figure::new("In two other lights");
        for (name, scene) in &self.skies {
            let images = self.around(scene, 4, side, 64)?;
            figure = figure.with_row(images.frames().iter().map(|image| (*name, image)));
        }
        Ok(figure)
    }

    /// Renders the object from all sides under the sky, in 36 squares of `side` pixels.
    ///
    /// # Errors
    /// If a render fails.
    pub fn turntable(&self, side: usize) -> Result<Animation> {
        let frames = self.around(&self.skies[0].1, 36, side, 16)?;
        Ok(frames.with_frames_per_second(12.0))
    }

    fn around(&self, scene: &Scene, frames: u32, side: usize, samples: u32) -> Result<Animation> {
        let (fov, distance) = (VIEW.0, VIEW.1 * self.radius);
        let turned = |k| {
            let azimuth = f64::from(360 * k / frames);
            let camera = Camera::orbit([0.0; 3], distance, azimuth, ELEVATION)?;
            Ok(camera.with_fov_y(fov))
        };
        let cameras = (0..frames).map(turned).collect::<Result<Vec<_>>>()?;
        let options = RenderOptions::new(side, side).with_samples(samples);
        Animation::render(scene, cameras, &options.with_bounces(1))
    }
}
