//! Cameras from a matrix, a calibration, an orbit, or a scene that must be in view.

use burn::tensor::{Tensor, TensorData};
use glam::{DMat3, DMat4, DVec3};

use super::angles::warn_of_radians;
use super::bounds::check_extent;
use super::parameter::{Range, conversions};
use super::{Camera, Parameter, Projection, Scene};
use crate::error::{Error, Result};
use crate::geometry::{host_values, sin_cos};
use softray_kernels::host::Bounds;

/// The margin that [`Camera::framing`] leaves around a scene, as a fraction of the image.
const MARGIN: f64 = 0.05;

/// A square matrix of numbers, row by row, or a tensor `[N, N]`.
///
/// [`Camera::from_matrix`] has an example.
#[derive(Clone, Debug)]
pub enum Matrix<const N: usize> {
    /// Rows of numbers.
    Constant([[f64; N]; N]),
    /// A tensor `[N, N]`.
    Tensor(Tensor<2>),
}

conversions! {
    [const N: usize] [[f64; N]; N] => Matrix<N>: |rows| Self::Constant(rows);
    [const N: usize] [[f32; N]; N] => Matrix<N>: |rows| Self::Constant(rows.map(|r| r.map(f64::from)));
    [const N: usize] Tensor<2> => Matrix<N>: |matrix| Self::Tensor(matrix);
    [] DMat4 => Matrix<4>: |matrix| Self::Constant(matrix.transpose().to_cols_array_2d());
    [] DMat3 => Matrix<3>: |matrix| Self::Constant(matrix.transpose().to_cols_array_2d());
}

impl<const N: usize> Matrix<N> {
    /// Returns the rows on the host. Checks the shape and that all values are finite.
    fn rows(&self, field: &str) -> Result<[[f64; N]; N]> {
        let rows = match self {
            Self::Constant(rows) => *rows,
            Self::Tensor(matrix) => {
                if matrix.dims() != [N, N] {
                    let found = format!("of shape {:?}", matrix.dims());
                    let expected = format!("shape [{N}, {N}]");
                    return Err(Error::invalid("camera", field, found, expected));
                }
                let values = host_values(matrix)?;
                std::array::from_fn(|i| std::array::from_fn(|j| values[N * i + j]))
            }
        };
        if rows.iter().flatten().any(|v| !v.is_finite()) {
            let expected = "finite numbers";
            let shown = format!("{rows:?}");
            return Err(Error::invalid("camera", field, shown, expected));
        }
        Ok(rows)
    }

    /// Returns the values at these rows and columns times a factor, in the graph of the matrix.
    fn pick<const C: usize>(
        &self,
        rows: &[[f64; N]; N],
        places: [[usize; 2]; C],
        factor: f64,
    ) -> Parameter<C> {
        match self {
            Self::Constant(_) => Parameter::Constant(places.map(|[i, j]| factor * rows[i][j])),
            Self::Tensor(m) => {
                let at = |[i, j]: [usize; 2]| m.clone().slice([i..i + 1, j..j + 1]).reshape([1]);
                let picked = places.map(at).into_iter().collect();
                Parameter::Tensor(Tensor::cat(picked, 0) * factor)
            }
        }
    }
}

impl Camera {
    /// Creates a camera from its pose, a camera-to-world matrix in the convention of OpenGL, Blender and NeRF.
    /// The columns are right, up, backward and the position, in scene units. The vertical field of view is 40° unless
    /// [`Camera::with_fov_y`] sets another. If the matrix is a tensor `[4, 4]`, gradients flow to it.
    ///
    /// ```
    /// use softray::prelude::*;
    /// let pose = [
    ///     [1.0, 0.0, 0.0, 0.5],
    ///     [0.0, 1.0, 0.0, 1.0],
    ///     [0.0, 0.0, 1.0, 4.0],
    ///     [0.0, 0.0, 0.0, 1.0],
    /// ];
    /// let camera = Camera::from_matrix(pose)?.with_fov_y(35.0);
    /// assert_eq!(camera.eye.values()?, [0.5, 1.0, 4.0]);
    /// assert_eq!(camera.target.values()?, [0.5, 1.0, 3.0]);
    /// # Ok::<(), softray::Error>(())
    /// ```
    ///
    /// # Errors
    /// If the last row is not (0, 0, 0, 1), the axes are left-handed, an axis is 0, a value is not finite, or the
    /// tensor has another shape.
    pub fn from_matrix(camera_to_world: impl Into<Matrix<4>>) -> Result<Self> {
        let matrix = camera_to_world.into();
        let rows = matrix.rows("matrix")?;
        if rows[3] != [0.0, 0.0, 0.0, 1.0] {
            let expected = "(0, 0, 0, 1): translation stands in the last column";
            let (field, shown) = ("last row of the matrix", format!("{:?}", rows[3]));
            return Err(Error::invalid("camera", field, shown, expected));
        }
        let axes = [0, 1, 2].map(|j| DVec3::from([0, 1, 2].map(|i| rows[i][j])));
        right_handed(axes, "matrix")?;
        let column = |j, factor| matrix.pick(&rows, [0, 1, 2].map(|i| [i, j]), factor);
        let (eye, up) = (column(3, 1.0), column(1, 1.0));
        let target = added(&eye, &column(2, -1.0));
        Ok(Self::look_at(eye, target).with_up(up))
    }

    /// Creates a calibrated camera in the convention of OpenCV and COLMAP.
    /// K is in pixels of an image of `size` (columns, rows). Rotation and translation are from world to camera,
    /// x_camera = R·x_world + t. The camera's x points right, y down and z forward. Gradients flow to arguments that
    /// are tensors, `[3, 3]`, `[3, 3]` and `[3]`.
    ///
    /// ```
    /// use softray::prelude::*;
    /// let k = [[500.0, 0.0, 310.0], [0.0, 510.0, 250.0], [0.0, 0.0, 1.0]];
    /// // In front of the origin, looking along −z with y up.
    /// let rotation = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
    /// let camera = Camera::from_intrinsics(k, rotation, [0.0, 0.0, 4.0], [640, 480])?;
    /// assert_eq!(camera.eye.values()?, [0.0, 0.0, 4.0]);
    /// # Ok::<(), softray::Error>(())
    /// ```
    ///
    /// # Errors
    /// If K has skew or is not upper triangular, a focal length is not positive, R is not a rotation, `size` contains
    /// 0, a value is not finite, or a tensor has another shape.
    pub fn from_intrinsics(
        k: impl Into<Matrix<3>>,
        rotation: impl Into<Matrix<3>>,
        translation: impl Into<Parameter<3>>,
        size: [usize; 2],
    ) -> Result<Self> {
        let (k, rotation, translation) = (k.into(), rotation.into(), translation.into());
        let rows = k.rows("K")?;
        let [[_, skew, _], [low, _, _], last] = rows;
        if skew != 0.0 || low != 0.0 || last != [0.0, 0.0, 1.0] {
            let expected = "[[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]]";
            return Err(Error::invalid("camera", "K", format!("{rows:?}"), expected));
        }
        let focal = k.pick(&rows, [[0, 0], [1, 1]], 1.0);
        let principal = k.pick(&rows, [[0, 2], [1, 2]], 1.0);

        let r = rotation.rows("R")?;
        right_handed(r.map(DVec3::from), "R")?;
        let m = DMat3::from_cols_array_2d(&r);
        let apart = (m * m.transpose() - DMat3::IDENTITY).to_cols_array();
        if apart.iter().any(|v| v.abs() > 1e-3) {
            let expected = "a rotation (R·Rᵀ = 1 to 1e-3)";
            return Err(Error::invalid("camera", "R", format!("{r:?}"), expected));
        }
        translation.check("camera", "translation", Range::Finite)?;
        // −Rᵀ·t: the rows of R times the components of t.
        let eye = match (&rotation, &translation) {
            (Matrix::Constant(_), Parameter::Constant(t)) => {
                Parameter::Constant((-(m * DVec3::from(*t))).to_array())
            }
            (Matrix::Tensor(r), t) => turned_back(r.clone(), in_tensor(t, r)),
            (Matrix::Constant(_), Parameter::Tensor(t)) => {
                turned_back(beside(r.as_flattened(), t).reshape([3, 3]), t.clone())
            }
        };
        let row = |i, factor| rotation.pick(&r, [0, 1, 2].map(|j| [i, j]), factor);
        let target = added(&eye, &row(2, 1.0));
        let mut camera = Self::look_at(eye, target).with_up(row(1, -1.0));
        camera.projection = Projection::Intrinsics {
            focal,
            principal,
            size,
        };
        camera.check(None)?;
        Ok(camera)
    }

    /// Creates a camera on a sphere around a target.
    /// `distance` is the radius in scene units. Azimuth and elevation are in degrees. At azimuth 0 the camera looks
    /// along −z, at 90 along −x. Elevation is the angle above the target's horizon. Gradients flow to arguments that
    /// are tensors.
    ///
    /// ```
    /// use softray::prelude::*;
    /// let turntable = (0..36)
    ///     .map(|i| Camera::orbit([0.0; 3], 4.0, 10.0 * f64::from(i), 20.0))
    ///     .collect::<softray::Result<Vec<Camera>>>()?;
    /// # assert_eq!(turntable.len(), 36);
    /// # Ok::<(), softray::Error>(())
    /// ```
    ///
    /// # Errors
    /// If the distance is not positive, the elevation is not in (−90°, 90°), a value is not finite, or a tensor has
    /// another shape.
    pub fn orbit(
        target: impl Into<Parameter<3>>,
        distance: impl Into<Parameter<1>>,
        azimuth: impl Into<Parameter<1>>,
        elevation: impl Into<Parameter<1>>,
    ) -> Result<Self> {
        let (target, distance) = (target.into(), distance.into());
        let (azimuth, elevation) = (azimuth.into(), elevation.into());
        warn_of_radians("the azimuth of a camera", &azimuth);
        warn_of_radians("the elevation of a camera", &elevation);
        let center = target.check("camera", "target", Range::Finite)?;
        let [radius] = distance.check("camera", "distance", Range::Positive)?;
        let [turn] = azimuth.check("camera", "azimuth", Range::Finite)?;
        let [rise] = elevation.check("camera", "elevation", Range::Degrees(-90, 90))?;
        let tensors = [&distance, &azimuth, &elevation];
        let moving = tensors.iter().find_map(|p| p.tensor());
        let Some(like) = moving.or(target.tensor()).cloned() else {
            let (sin, cos) = turn.to_radians().sin_cos();
            let (up, level) = rise.to_radians().sin_cos();
            let away = DVec3::new(level * sin, up, level * cos) * radius;
            return Ok(Self::look_at(DVec3::from(center) + away, target));
        };
        let [distance, azimuth, elevation] = tensors.map(|p| in_tensor(p, &like));
        let (sin, cos) = sin_cos(azimuth * 1f64.to_radians());
        let (up, level) = sin_cos(elevation * 1f64.to_radians());
        let away = Tensor::cat(vec![level.clone() * sin, up, level * cos], 0) * distance;
        Ok(Self::look_at(
            added(&target, &Parameter::Tensor(away)),
            target,
        ))
    }

    /// Creates a camera with a vertical field of view of 40° that has the whole scene in view.
    /// The scene is in view at any time of the shutter, in an image that is at least as wide as high. `direction`
    /// points from the scene to the camera. If it is a tensor `[3]`, gradients flow to it. The distance of the camera
    /// is a constant.
    ///
    /// ```
    /// use softray::prelude::*;
    /// let device = Device::flex();
    /// let scene = Scene::new().with_object(Object::new(shapes::icosphere(1, &device)));
    /// let camera = Camera::framing(&scene, [1.0, 0.5, 1.0])?;
    /// # assert!(camera.eye.values()?[0] > 1.0);
    /// # Ok::<(), softray::Error>(())
    /// ```
    ///
    /// # Errors
    /// If the scene has no bounds ([`Scene::bounds`]), all triangles are in one point, or the direction is 0 or not
    /// finite.
    pub fn framing(scene: &Scene, direction: impl Into<Parameter<3>>) -> Result<Self> {
        Framing::of(scene)?.camera(direction.into())
    }
}

/// The points that cameras must have in view, read back once for many cameras.
pub(crate) struct Framing {
    pub bounds: Bounds,
    points: Vec<DVec3>,
}

impl Framing {
    /// Reads the points of a scene.
    ///
    /// # Errors
    /// If the scene has no bounds, or all triangles are in one point.
    pub fn of(scene: &Scene) -> Result<Self> {
        let bounds = scene.bounds()?;
        check_extent(&bounds)?;
        Ok(Self {
            bounds,
            points: scene.host_points()?,
        })
    }

    /// Creates a camera as [`Camera::framing`] does.
    pub fn camera(&self, direction: Parameter<3>) -> Result<Camera> {
        let towards = direction.check("camera", "direction", Range::Finite)?;
        let towards = DVec3::from(towards);
        if towards == DVec3::ZERO {
            let expected = "a vector that is not 0";
            return Err(Error::invalid("camera", "direction", towards, expected));
        }
        let center = DVec3::from(self.bounds.center());
        let length = towards.length();
        let backward = towards / length;
        let mut up = DVec3::Y;
        if backward.cross(up).length() < 1e-3 {
            up = DVec3::NEG_Z * backward.y.signum();
        }
        let right = up.cross(backward).normalize();
        let above = backward.cross(right);
        // A point is in view from a distance d if its distance from the axis is at most (d − its coordinate along the
        // axis)·tan.
        let half = 20f64.to_radians().tan() * (1.0 - MARGIN);
        let mut distance = 0.0f64;
        for p in &self.points {
            let r = *p - center;
            let wide = r.dot(right).abs().max(r.dot(above).abs());
            distance = distance.max(r.dot(backward) + wide / half);
        }
        let eye = match &direction {
            Parameter::Constant(_) => Parameter::from(center + backward * distance),
            Parameter::Tensor(t) => {
                let t = t.clone() * length.recip();
                let norm = (t.clone() * t.clone()).sum().sqrt();
                let away = t / norm * distance;
                added(&center.into(), &Parameter::Tensor(away))
            }
        };
        Ok(Camera::look_at(eye, center).with_up(up))
    }
}

impl Scene {
    /// Returns the corners of all faces, at the start and the end of the shutter.
    fn host_points(&self) -> Result<Vec<DVec3>> {
        let mut points = Vec::new();
        for object in &self.objects {
            let first = points.len();
            let vertices = object.mesh.host_vertices()?;
            let corners = object.mesh.faces.iter().flatten();
            points.extend(corners.map(|&v| DVec3::from(vertices[v as usize])));
            if let Some(velocity) = &object.velocity {
                let velocity = DVec3::from(velocity.values()?);
                for i in first..points.len() {
                    points.push(points[i] + velocity);
                }
            }
        }
        Ok(points)
    }
}

fn right_handed([x, y, z]: [DVec3; 3], field: &str) -> Result<()> {
    let unit = [x, y, z].map(DVec3::normalize_or_zero);
    if unit[0].cross(unit[1]).dot(unit[2]) > 1e-6 {
        return Ok(());
    }
    let shown = format!("with axes {x}, {y}, {z}");
    let expected = "right-handed axes, none of them 0";
    Err(Error::invalid("camera", field, shown, expected))
}

/// −Rᵀ·t.
fn turned_back(r: Tensor<2>, t: Tensor<1>) -> Parameter<3> {
    Parameter::Tensor((r * t.reshape([3, 1])).sum_dim(0).reshape([3]) * (-1.0))
}

/// Creates a constant tensor on the device and in the float type of `like`.
fn beside<const D: usize>(values: &[f64], like: &Tensor<D>) -> Tensor<1> {
    let data = TensorData::new(values.to_vec(), [values.len()]);
    Tensor::from_data(data, (&like.device().inner(), like.dtype()))
}

fn in_tensor<const C: usize, const D: usize>(p: &Parameter<C>, like: &Tensor<D>) -> Tensor<1> {
    match p {
        Parameter::Constant(v) => beside(v, like),
        Parameter::Tensor(t) => t.clone(),
    }
}

fn added(a: &Parameter<3>, b: &Parameter<3>) -> Parameter<3> {
    match (a, b) {
        (Parameter::Constant(a), Parameter::Constant(b)) => {
            Parameter::Constant(std::array::from_fn(|i| a[i] + b[i]))
        }
        (Parameter::Tensor(t), _) | (_, Parameter::Tensor(t)) => {
            Parameter::Tensor(in_tensor(a, t) + in_tensor(b, t))
        }
    }
}
