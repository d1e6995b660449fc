//! The camera of a photograph.

use burn::tensor::{Device, Tensor};
use glam::{DMat3, DVec3};

use super::Distortion;
use crate::error::{Error, Result};
use crate::scene::{Camera, Projection, Transform};

/// The camera of a photograph: its pose, the matrix K and the distortion of its lens.
///
/// Pixels are counted from the upper left corner of the image, x to the right and y down; the center of the first pixel
/// is at (0.5, 0.5). This is the convention of COLMAP, instant-ngp and nerfstudio. (In that of OpenCV, the center of the
/// first pixel is at (0, 0), and the principal point is less by half a pixel.)
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewCamera {
    /// Rows of the camera-to-world matrix in the axes of OpenGL. The columns are right, up, backward (unit vectors), and
    /// the position in scene units. The camera looks along −z.
    pub to_world: [[f64; 4]; 3],
    /// Focal lengths (f_x, f_y), in pixels.
    pub focal: [f64; 2],
    /// Principal point (c_x, c_y), in pixels from the upper left corner.
    pub principal: [f64; 2],
    /// Columns and rows of the image.
    pub size: [usize; 2],
    /// Distortion of the lens.
    pub distortion: Distortion,
}

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Column and row of the upper left pixel.
    pub start: [usize; 2],
    /// Columns and rows.
    pub size: [usize; 2],
}

impl Window {
    /// Checks that the window has pixels and that all are in an image.
    pub(super) fn check(&self, size: [usize; 2]) -> Result<()> {
        let fits = |i: usize| {
            let end = self.start[i].checked_add(self.size[i]);
            self.size[i] > 0 && end.is_some_and(|end| end <= size[i])
        };
        let ([x, y], [width, height]) = (self.start, self.size);
        Error::unless(
            fits(0) && fits(1),
            "window",
            "rectangle",
            format!("{width} × {height} pixels from ({x}, {y})"),
            &format!("pixels of an image of {} × {}", size[0], size[1]),
        )
    }
}

impl ViewCamera {
    /// Returns the position, in scene units.
    pub fn position(&self) -> [f64; 3] {
        self.to_world.map(|row| row[3])
    }

    /// Returns the unit vector along the view axis.
    pub fn forward(&self) -> [f64; 3] {
        self.to_world.map(|row| -row[2])
    }

    /// Returns the first three rows of the matrix from the world to the camera, in the axes of OpenGL.
    pub fn from_world(&self) -> [[f64; 4]; 3] {
        let m = &self.to_world;
        [0, 1, 2].map(|i| {
            let row = [0, 1, 2].map(|j| m[j][i]);
            let shift: f64 = (0..3).map(|j| row[j] * m[j][3]).sum();
            [row[0], row[1], row[2], -shift]
        })
    }

    /// Returns the rotation from camera to world in the axes of OpenGL.
    fn rotation(&self) -> DMat3 {
        let [x, y, z] = [0, 1, 2].map(|j| DVec3::from(self.to_world.map(|row| row[j])));
        DMat3::from_cols(x, y, z)
    }

    /// Returns the origin and the unit direction of the ray that is seen at a point of the image, in pixels. `None` if
    /// the lens shows no direction there.
    pub fn ray(&self, pixel: [f64; 2]) -> Option<([f64; 3], [f64; 3])> {
        let shown = [0, 1].map(|i| (pixel[i] - self.principal[i]) / self.focal[i]);
        let [x, y] = self.distortion.undistort(shown)?;
        let direction = self.rotation() * DVec3::new(x, -y, -1.0);
        Some((self.position(), direction.normalize().to_array()))
    }

    /// Returns where a point of the scene is seen in the image, in pixels. `None` if it is not in front of the camera or
    /// out of the lens's reach. The result may lie outside of the image.
    pub fn project(&self, point: [f64; 3]) -> Option<[f64; 2]> {
        let offset = DVec3::from(point) - DVec3::from(self.position());
        let local = self.rotation().transpose() * offset;
        let depth = -local.z;
        if depth <= 0.0 {
            return None;
        }
        let direction = [local.x / depth, -local.y / depth];
        if direction[0].hypot(direction[1]) > self.distortion.reach() {
            return None;
        }
        let shown = self.distortion.distort(direction);
        Some([0, 1].map(|i| self.principal[i] + self.focal[i] * shown[i]))
    }

    /// Returns the camera of the same image at another size.
    pub fn scaled_to(&self, size: [usize; 2]) -> Self {
        let factor = [0, 1].map(|i| size[i] as f64 / self.size[i] as f64);
        Self {
            focal: [0, 1].map(|i| self.focal[i] * factor[i]),
            principal: [0, 1].map(|i| self.principal[i] * factor[i]),
            size,
            ..*self
        }
    }

    /// Returns the camera of a part of the image: the principal point is shifted.
    ///
    /// # Errors
    /// If the window has no pixels or some that the image lacks.
    pub fn cropped(&self, window: Window) -> Result<Self> {
        window.check(self.size)?;
        Ok(Self {
            principal: [0, 1].map(|i| self.principal[i] - window.start[i] as f64),
            size: window.size,
            ..*self
        })
    }

    /// Returns the camera without the distortion of its lens.
    pub fn pinhole(&self) -> Self {
        Self {
            distortion: Distortion::None,
            ..*self
        }
    }

    /// The width of a pixel at a point of the scene, in scene units.
    pub fn pixel_width(&self, point: [f64; 3]) -> f64 {
        DVec3::from(self.position()).distance(point.into()) / self.focal[0]
    }

    /// Returns the motion from the world to the camera's own frame ([`ViewCamera::in_own_frame`]).
    pub fn world_to_own_frame(&self, device: &Device) -> Transform {
        let m = self.from_world();
        let column = |j: usize| [0, 1, 2].map(|i| m[i][j] as f32);
        let columns = [column(0), column(1)].concat();
        Transform::new()
            .with_six_d(Tensor::from_floats(columns.as_slice(), device))
            .with_translation(Tensor::from_floats(column(3), device))
    }

    /// Returns the camera in its own frame: at the origin, looking along −z with y up. A mesh that is moved by
    /// [`ViewCamera::world_to_own_frame`] looks the same from it, in a light that turns with the camera.
    pub fn in_own_frame(&self) -> Self {
        let axis = |i: usize| [0, 1, 2, 3].map(|j| if i == j { 1.0 } else { 0.0 });
        Self {
            to_world: [0, 1, 2].map(axis),
            ..*self
        }
    }

    /// Returns the camera with which scenes are rendered, with its eye, target and up vector, and
    /// [`Projection::Intrinsics`]. A render of [`ViewCamera::size`] has the pixels of the photograph.
    ///
    /// # Errors
    /// If the lens has distortion: renders have none, so photographs are loaded without it.
    pub fn to_camera(&self) -> Result<Camera> {
        Error::unless(
            self.distortion.is_none(),
            "camera of a photograph",
            "distortion",
            format!("{:?}", self.distortion),
            "none: a loaded Photograph has a camera without it",
        )?;
        let (eye, forward) = (DVec3::from(self.position()), DVec3::from(self.forward()));
        let mut camera = Camera::look_at(eye.to_array(), (eye + forward).to_array())
            .with_up(self.to_world.map(|row| row[1]));
        camera.projection = Projection::Intrinsics {
            focal: self.focal.into(),
            principal: self.principal.into(),
            size: self.size,
        };
        Ok(camera)
    }
}
