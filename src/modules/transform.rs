use burn::config::Config;
use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};

use super::values::{leaf, positive, set};
use crate::error::{Error, Result};
use crate::scene::{Mesh, Parameter, Range, Transform, warn_of_radians};

const OBJECT: &str = "rigid transform";
const ANGLE: &str = "the angle of a rigid transform";

/// The parameterization of a rotation.
///
/// [`RigidTransform`] has an example.
#[derive(Config, Debug, Copy, PartialEq, Eq)]
pub enum RotationForm {
    /// The first two columns of the rotation matrix `[6]`, made orthonormal (Zhou et al. 2019). This form
    /// is continuous over all rotations, which suits optimizers and networks.
    SixD,
    /// A quaternion `[4]` in the order (w, x, y, z), normalized.
    Quaternion,
}

/// The configuration of a [`RigidTransform`]. By default it starts as the identity.
///
/// [`RigidTransform`] has an example.
#[derive(Config, Debug)]
pub struct RigidTransformConfig {
    /// The parameterization of the rotation; [`RotationForm::SixD`] by default.
    #[config(default = "RotationForm::SixD")]
    pub rotation: RotationForm,
    /// The initial translation, scene units; 0 by default.
    #[config(default = "[0.0; 3]")]
    pub translation: [f64; 3],
    /// The initial uniform scale, > 0; by default the transform has no scale.
    pub scale: Option<f64>,
}

impl RigidTransformConfig {
    /// Creates the transform without a rotation, in the device's default float type.
    ///
    /// # Errors
    /// If a number is not finite, or the scale is not > 0.
    pub fn init(&self, device: &Device) -> Result<RigidTransform> {
        Range::Finite.check(OBJECT, "translation", &self.translation)?;
        Range::Positive.check(OBJECT, "scale", self.scale.as_slice())?;
        let rotation = match self.rotation {
            RotationForm::SixD => vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            RotationForm::Quaternion => vec![1.0, 0.0, 0.0, 0.0],
        };
        let numbers = rotation.len();
        Ok(RigidTransform {
            rotation: leaf(rotation, [numbers], device),
            translation: leaf(self.translation.to_vec(), [3], device),
            log_scale: self.scale.map(|s| leaf(vec![s.ln()], [1], device)),
        })
    }
}

/// A rotation about the origin, then a translation, with an optional uniform scale before both.
///
/// ```
/// use softray::modules::{RigidTransformConfig, RotationForm};
/// use softray::prelude::*;
/// let device = Device::flex().autodiff();
/// let pose = RigidTransformConfig::new()
///     .with_rotation(RotationForm::Quaternion)
///     .with_translation([0.0, 0.2, 0.0])
///     .with_scale(Some(0.7))
///     .init(&device)?
///     .with_axis_angle([0.0, 1.0, 0.0], 30.0)?;
/// assert_eq!(pose.form(), RotationForm::Quaternion);
/// let cube = pose.forward(shapes::cube(&Device::flex()));
/// assert!(cube.vertices.is_tracked());
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module)]
pub struct RigidTransform {
    /// Six numbers or a quaternion, see [`RotationForm`]. Their length has no effect on the rotation.
    pub rotation: Param<Tensor<1>>,
    /// The translation `[3]`, scene units.
    pub translation: Param<Tensor<1>>,
    /// ln of the scale, `[1]`. Values beyond ±30 count as ±30.
    pub log_scale: Option<Param<Tensor<1>>>,
}

impl RigidTransform {
    /// Returns the parameterization of the rotation.
    pub fn form(&self) -> RotationForm {
        if self.rotation.lazy_shape().num_elements() == 4 {
            RotationForm::Quaternion
        } else {
            RotationForm::SixD
        }
    }

    /// Sets the rotation to an angle in degrees about an axis of any length except 0.
    ///
    /// # Errors
    /// If the axis is 0, or a number is not finite.
    pub fn with_axis_angle(self, axis: [f64; 3], degrees: f64) -> Result<Self> {
        Range::Finite.check(OBJECT, "angle", &[degrees])?;
        warn_of_radians(ANGLE, &Parameter::Constant([degrees]));
        let Some(axis) = glam::DVec3::from_array(axis).try_normalize() else {
            let found = format!("{axis:?}");
            return Err(Error::invalid(OBJECT, "axis", found, "a direction"));
        };
        Ok(self.rotated(glam::DQuat::from_axis_angle(axis, degrees.to_radians())))
    }

    /// Sets the rotation to angles in degrees about the axes x, y and z of the scene, applied in that order.
    ///
    /// # Errors
    /// If an angle is not finite.
    pub fn with_euler(self, degrees: [f64; 3]) -> Result<Self> {
        Range::Finite.check(OBJECT, "angles", &degrees)?;
        for angle in degrees {
            warn_of_radians(ANGLE, &Parameter::Constant([angle]));
        }
        let [x, y, z] = degrees.map(f64::to_radians);
        let rotation = glam::DQuat::from_euler(glam::EulerRot::ZYX, z, y, x);
        Ok(self.rotated(rotation))
    }

    /// Sets the rotation to a matrix, given by its rows.
    ///
    /// # Errors
    /// If its rows are not orthonormal to 1e-4, or the matrix mirrors.
    pub fn with_matrix(self, rows: [[f64; 3]; 3]) -> Result<Self> {
        let matrix = glam::DMat3::from_cols_array_2d(&rows).transpose();
        let off = (matrix * matrix.transpose() - glam::DMat3::IDENTITY).to_cols_array();
        let orthonormal = off.iter().all(|x| x.abs() < 1e-4);
        if orthonormal && matrix.determinant() > 0.0 {
            return Ok(self.rotated(glam::DQuat::from_mat3(&matrix)));
        }
        let expected = "orthonormal rows and a determinant of 1";
        Err(Error::invalid(
            OBJECT,
            "matrix",
            format!("{rows:?}"),
            expected,
        ))
    }

    fn rotated(mut self, q: glam::DQuat) -> Self {
        let numbers = match self.form() {
            RotationForm::Quaternion => vec![q.w, q.x, q.y, q.z],
            RotationForm::SixD => [q * glam::DVec3::X, q * glam::DVec3::Y]
                .iter()
                .flat_map(|column| column.to_array())
                .collect(),
        };
        self.rotation = set(self.rotation, numbers);
        self
    }

    /// Returns the transform, in the graph of its parameters.
    pub fn transform(&self) -> Transform {
        let transform = Transform::new().with_translation(self.translation.val());
        let transform = match self.form() {
            RotationForm::SixD => transform.with_six_d(self.rotation.val()),
            RotationForm::Quaternion => transform.with_quaternion(self.rotation.val()),
        };
        match &self.log_scale {
            Some(log) => transform.with_scale(positive(log.val())),
            None => transform,
        }
    }

    /// Applies the transform to a mesh and returns the result.
    pub fn forward(&self, mesh: Mesh) -> Mesh {
        mesh.transformed(&self.transform())
    }
}
