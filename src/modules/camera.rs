use burn::config::Config;
use burn::module::{Module, Param};
use burn::tensor::activation::sigmoid;
use burn::tensor::{Device, Tensor};

use super::values::{leaf, logit, positive};
use crate::error::{Error, Result};
use crate::scene::{Camera, Parameter, Projection, Range, warn_of_narrow_view};

/// The bounds of the vertical field of view, degrees.
const FOV: [f64; 2] = [1.0, 170.0];

/// The form of the parameters of a camera's direction.
///
/// [`CameraParams`] has an example.
#[derive(Config, Debug, Copy, PartialEq, Eq)]
pub enum AimForm {
    /// A point. The camera looks at it from any position.
    Target,
    /// A direction. It does not change when the camera moves.
    Direction,
}

/// The configuration of a [`CameraParams`].
///
/// [`CameraParams`] has an example.
#[derive(Config, Debug)]
pub struct CameraParamsConfig {
    /// Position, scene units.
    pub eye: [f64; 3],
    /// The point that the camera looks at, scene units.
    pub target: [f64; 3],
    /// A direction that points up in the image, not along the view axis; +y by default.
    #[config(default = "[0.0, 1.0, 0.0]")]
    pub up: [f64; 3],
    /// Vertical field of view, degrees in (1, 170); 40 by default.
    #[config(default = 40.0)]
    pub fov_y: f64,
    /// Aperture radius and focus distance of a thin lens, scene units, both > 0; a pinhole by default.
    pub lens: Option<[f64; 2]>,
    /// Whether the aim is a point or a direction; a point by default.
    #[config(default = "AimForm::Target")]
    pub aim: AimForm,
}

impl CameraParamsConfig {
    /// Creates the parameters, in the device's default float type.
    ///
    /// # Errors
    /// If a value is out of its range, `eye` and `target` are the same, or `up` is along the view axis.
    pub fn init(&self, device: &Device) -> Result<CameraParams> {
        Range::Degrees(1, 170).check("camera", "fov_y", &[self.fov_y])?;
        warn_of_narrow_view("fov_y of camera parameters", self.fov_y);
        Camera::look_at(self.eye, self.target)
            .with_up(self.up)
            .check(None)?;
        if let Some([aperture, focus]) = self.lens {
            Range::Positive.check("camera", "aperture radius", &[aperture])?;
            Range::Positive.check("camera", "focus distance", &[focus])?;
        }
        let three = |v: [f64; 3]| leaf(v.to_vec(), [3], device);
        let view = std::array::from_fn(|i| self.target[i] - self.eye[i]);
        let share = (self.fov_y - FOV[0]) / (FOV[1] - FOV[0]);
        Ok(CameraParams {
            eye: three(self.eye),
            aim: match self.aim {
                AimForm::Target => Aim::Target(three(self.target)),
                AimForm::Direction => Aim::Direction(three(view)),
            },
            up: three(self.up).set_require_grad(false),
            logit_fov: leaf(vec![logit(share)], [1], device),
            lens: self.lens.map(|[aperture, focus]| LensParams {
                log_aperture: leaf(vec![aperture.ln()], [1], device),
                log_focus: leaf(vec![focus.ln()], [1], device),
            }),
        })
    }
}

/// The parameters of a camera's direction.
///
/// [`CameraParams`] has an example.
#[derive(Module, Debug)]
pub enum Aim {
    /// The point that the camera looks at, `[3]`, scene units.
    Target(Param<Tensor<1>>),
    /// The direction `[3]`, of any length except 0. With a trained `up`, both form the six numbers of a
    /// rotation (Zhou et al. 2019).
    Direction(Param<Tensor<1>>),
}

/// The parameters of a thin lens. Logarithms beyond ±30 count as ±30.
///
/// [`CameraParams`] has an example.
#[derive(Module)]
pub struct LensParams {
    /// ln of the aperture radius in scene units, `[1]`.
    pub log_aperture: Param<Tensor<1>>,
    /// ln of the focus distance in scene units, `[1]`.
    pub log_focus: Param<Tensor<1>>,
}

/// The parameters of a camera.
///
/// All parameters except `up` are trained, unless they are frozen. No optimizer changes a frozen parameter; it
/// is saved and loaded like the others.
///
/// ```
/// use softray::modules::{Aim, AimForm, CameraParamsConfig};
/// use softray::prelude::*;
/// let device = Device::flex().autodiff();
/// let params = CameraParamsConfig::new([0.0, 1.0, 4.0], [0.0, 0.0, 0.0])
///     .with_lens(Some([0.05, 4.0]))
///     .with_aim(AimForm::Direction)
///     .init(&device)?
///     .freeze_fov()
///     .freeze_lens();
/// let camera = params.camera();
/// assert!(camera.eye.is_tracked() && !params.logit_fov.is_require_grad());
/// assert!(matches!(camera.projection, Projection::Perspective { .. }));
/// assert!(matches!(params.aim, Aim::Direction(_)));
/// let thin_lens = camera.lens.expect("a lens");
/// assert!((thin_lens.focus_distance.values()?[0] - 4.0).abs() < 1e-4);
/// let lens = params.lens.expect("a lens");
/// assert!(!lens.log_focus.is_require_grad());
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module)]
pub struct CameraParams {
    /// Position `[3]`, scene units.
    pub eye: Param<Tensor<1>>,
    /// The point that the camera looks at, or its direction.
    pub aim: Aim,
    /// A direction that points up in the image, `[3]`; frozen by default.
    pub up: Param<Tensor<1>>,
    /// The logit of (fov_y − 1°)/(170° − 1°), where fov_y is the vertical field of view, `[1]`.
    pub logit_fov: Param<Tensor<1>>,
    /// The thin lens; absent for a pinhole camera.
    pub lens: Option<LensParams>,
}

impl CameraParams {
    /// Creates parameters with the values of a camera, in the device's default float type. The aim is a point.
    ///
    /// # Errors
    /// Like [`CameraParamsConfig::init`], or if the projection is not [`Projection::Perspective`] or a tensor
    /// cannot be read.
    pub fn from_camera(camera: &Camera, device: &Device) -> Result<Self> {
        let one = |p: &Parameter<1>| p.values().map(|[v]| v);
        let lens = match &camera.lens {
            Some(lens) => Some([one(&lens.aperture_radius)?, one(&lens.focus_distance)?]),
            None => None,
        };
        let Projection::Perspective { fov_y } = &camera.projection else {
            let expected = "a perspective projection by a field of view";
            let other = "another projection";
            return Err(Error::invalid("camera", "projection", other, expected));
        };
        CameraParamsConfig::new(camera.eye.values()?, camera.target.values()?)
            .with_up(camera.up.values()?)
            .with_fov_y(one(fov_y)?)
            .with_lens(lens)
            .init(device)
    }

    /// Freezes the position, so that it is not trained.
    pub fn freeze_eye(mut self) -> Self {
        self.eye = self.eye.set_require_grad(false);
        self
    }

    /// Freezes the point or direction of the aim, so that it is not trained.
    pub fn freeze_aim(mut self) -> Self {
        self.aim = self.aim.no_grad();
        self
    }

    /// Freezes the field of view, so that it is not trained.
    pub fn freeze_fov(mut self) -> Self {
        self.logit_fov = self.logit_fov.set_require_grad(false);
        self
    }

    /// Freezes the lens, so that it is not trained.
    pub fn freeze_lens(mut self) -> Self {
        self.lens = self.lens.map(Module::no_grad);
        self
    }

    /// Trains the up vector, so that the camera may roll.
    pub fn train_up(mut self) -> Self {
        self.up = self.up.set_require_grad(true);
        self
    }

    /// Returns the camera, in the graph of the trained parameters.
    pub fn camera(&self) -> Camera {
        let eye = self.eye.val();
        let target = match &self.aim {
            Aim::Target(point) => point.val(),
            Aim::Direction(direction) => eye.clone() + direction.val(),
        };
        let fov = sigmoid(self.logit_fov.val()) * (FOV[1] - FOV[0]) + FOV[0];
        let camera = Camera::look_at(eye, target)
            .with_up(self.up.val())
            .with_fov_y(fov);
        match &self.lens {
            Some(lens) => camera.with_thin_lens(
                positive(lens.log_aperture.val()),
                positive(lens.log_focus.val()),
            ),
            None => camera,
        }
    }
}
