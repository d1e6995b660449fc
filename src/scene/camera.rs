use burn::tensor::Tensor;

use super::Parameter;
use super::lens::ThinLens;
use crate::error::{Error, Result};
use crate::geometry::{Context, Vec3, detached};
use softray_kernels::host::HostProjection;
use softray_kernels::model::camera::HostCamera;

/// A camera in right-handed coordinates.
/// Pixel (0, 0) is at the upper left. By default the camera is a pinhole with a perspective projection.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "remote", derive(serde::Serialize, serde::Deserialize))]
pub struct Camera {
    /// Position, in scene units.
    pub eye: Parameter<3>,
    /// A point on the view axis in front of the eye, in scene units.
    pub target: Parameter<3>,
    /// A direction that points up in the image, of any length but 0, at any angle to the view axis but 0° and 180°.
    pub up: Parameter<3>,
    /// The projection of points of the scene onto the image.
    pub projection: Projection,
    /// A thin lens, or None for a pinhole.
    pub lens: Option<ThinLens>,
}

/// The projection of a camera. [`CameraParams`](crate::modules::CameraParams) has an example.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "remote", derive(serde::Serialize, serde::Deserialize))]
pub enum Projection {
    /// Perspective about the middle of the image, with square pixels.
    Perspective {
        /// Vertical field of view, in degrees in (0, 180).
        fov_y: Parameter<1>,
    },
    /// Perspective by the matrix K of a camera that was calibrated for images of a given size.
    /// A render of another size shows the same view.
    Intrinsics {
        /// Focal lengths (f_x, f_y), in pixels, > 0.
        focal: Parameter<2>,
        /// Principal point (c_x, c_y), where the view axis meets the image, in pixels from the upper left corner.
        principal: Parameter<2>,
        /// Columns and rows of the images that K was calibrated for.
        size: [usize; 2],
    },
    /// Parallel rays along the view axis that start at the plane of the eye, with square pixels.
    /// Points behind the eye are not visible.
    Orthographic {
        /// Height of the image, in scene units, > 0.
        height: Parameter<1>,
    },
}

impl Camera {
    /// Creates a pinhole camera with up vector (0, 1, 0) and a vertical field of view of 40°.
    pub fn look_at(eye: impl Into<Parameter<3>>, target: impl Into<Parameter<3>>) -> Self {
        Self {
            eye: eye.into(),
            target: target.into(),
            up: Parameter::Constant([0.0, 1.0, 0.0]),
            projection: Projection::Perspective {
                fov_y: Parameter::Constant([40.0]),
            },
            lens: None,
        }
    }

    /// Sets the up vector.
    pub fn with_up(mut self, up: impl Into<Parameter<3>>) -> Self {
        self.up = up.into();
        self
    }

    /// Sets a perspective projection with a vertical field of view in degrees, in (0, 180).
    pub fn with_fov_y(mut self, degrees: impl Into<Parameter<1>>) -> Self {
        self.projection = Projection::Perspective {
            fov_y: degrees.into(),
        };
        self
    }

    /// Sets an orthographic projection (parallel rays). `height` is the height of the image in scene units.
    ///
    /// ```
    /// use softray::prelude::*;
    /// // A plan: a square of 2 × 2 scene units, seen from above.
    /// let camera = Camera::look_at([0.0, 5.0, 0.0], [0.0, 0.0, 0.0])
    ///     .with_up([0.0, 0.0, -1.0])
    ///     .with_orthographic(2.0);
    /// # let _ = camera;
    /// ```
    pub fn with_orthographic(mut self, height: impl Into<Parameter<1>>) -> Self {
        self.projection = Projection::Orthographic {
            height: height.into(),
        };
        self
    }

    /// Sets a thin lens. The aperture radius (≥ 0) and the focus distance (> 0) are in scene units.
    pub fn with_thin_lens(
        mut self,
        aperture_radius: impl Into<Parameter<1>>,
        focus_distance: impl Into<Parameter<1>>,
    ) -> Self {
        self.lens = Some(ThinLens {
            aperture_radius: aperture_radius.into(),
            focus_distance: focus_distance.into(),
        });
        self
    }

    /// Checks that values which are each in their range define a view together.
    pub(super) fn check_view(&self) -> Result<()> {
        let wrong = |field: &str, found: String, expected: &str| {
            Err(Error::invalid("camera", field, found, expected))
        };
        if let Projection::Intrinsics { size: [w, h], .. } = self.projection
            && (w == 0 || h == 0)
        {
            let expected = "at least one column and row";
            return wrong("size of K's image", format!("{w} × {h}"), expected);
        }
        if self.lens.is_some() && self.projection.is_parallel() {
            let expected = "a perspective projection, or no lens";
            return wrong("lens", "with parallel rays".into(), expected);
        }
        let vector = |p: &Parameter<3>| p.values().map(glam::DVec3::from);
        let (target, up) = (vector(&self.target)?, vector(&self.up)?);
        let view = target - vector(&self.eye)?;
        if view.length() <= 0.0 {
            let expected = "a point other than the eye";
            return wrong("target", target.to_string(), expected);
        }
        if view.normalize().cross(up.normalize_or_zero()).length() < 1e-6 {
            let expected = format!("a vector not along the view {view}");
            return wrong("up", up.to_string(), &expected);
        }
        Ok(())
    }

    /// Returns the unit vectors forward, right and up, as planes `[1, 1]`.
    pub(super) fn axes(&self, context: &Context) -> [Vec3; 3] {
        // The vectors are scaled first: their squares may overflow or underflow in the scene's float type.
        let host = |p: &Parameter<3>| glam::DVec3::from(p.values().unwrap_or([0.0; 3]));
        let length = (host(&self.target) - host(&self.eye)).length();
        let forward = match (&self.eye, &self.target) {
            (&Parameter::Constant(eye), &Parameter::Constant(target)) => {
                let forward = glam::DVec3::from(target) - glam::DVec3::from(eye);
                Vec3::constant(context, (forward / length).to_array())
            }
            _ => {
                let forward = self.target.vector(context).sub(&self.eye.vector(context));
                forward.scale_by(length.recip()).normalized()
            }
        };
        let up = self
            .up
            .vector(context)
            .scale_by(host(&self.up).length().recip());
        let right = forward.cross(&up.normalized()).normalized();
        let up = right.cross(&forward);
        [forward, right, up]
    }

    /// Returns 0 with the relative derivative of 1/[`half_height`](Self::half_height).
    fn growth(&self, context: &Context, high: &Tensor<2>) -> Tensor<2> {
        let growth = (high.clone().detach() - high.clone()) / high.clone().detach();
        if !self.projection.is_parallel() {
            return growth;
        }
        // Scaled to length 1, so that its square is in range.
        let host = |p: &Parameter<3>| glam::DVec3::from(p.values().unwrap_or([0.0; 3]));
        let length = (host(&self.target) - host(&self.eye)).length();
        let view = self.target.vector(context).sub(&self.eye.vector(context));
        let view = view.scale_by(length.recip());
        let square = view.dot(&view);
        growth + (square.clone() - square.detach()) * 0.5
    }

    /// Returns origins and directions of rays through film points. `film` has rows `[1, N]` in units of the image, with
    /// (0, 0) at the top left. `disk` has lens points on the unit disk, as rows. Origins are relative to `center`, in
    /// units of `unit`. `spread` has the offsets of film points from their pixels, if these are proportional to
    /// 1/[`half_height`](Self::half_height), as rows. It adds their derivative to the graph.
    ///
    /// # Errors
    /// If a tensor can't be read.
    pub(crate) fn rays(
        &self,
        context: &Context,
        (center, unit): ([f64; 3], f64),
        aspect: f64,
        film: &[Tensor<2>; 2],
        spread: Option<&[Tensor<2>; 2]>,
        disk: Option<&[Tensor<2>; 2]>,
    ) -> Result<(Vec3, Vec3)> {
        let per_unit = unit.recip();
        let eye = self.eye.vector(context);
        let eye = eye.sub(&Vec3::constant(context, center));
        let eye = eye.scale_by(per_unit);
        let [forward, right, up] = self.axes(context);
        let [wide, high, to_right, upwards] = self.projection.planes(context, unit, aspect)?;
        let [mut x, mut y] = film.clone();
        if let Some([by_x, by_y]) = spread {
            let growth = self.growth(context, &high);
            x = x + by_x.clone() * growth.clone();
            y = y + by_y.clone() * growth;
        }
        let sx = (x * 2.0 - 1.0) * (wide * aspect) + to_right;
        let sy = (y * (-2.0) + 1.0) * high + upwards;
        let n = film[0].dims()[1];
        let beside = right.scale(&sx).add(&up.scale(&sy));
        if self.projection.is_parallel() {
            return Ok((eye.add(&beside), forward.map(|x| x.expand([1, n]))));
        }
        let through = beside.add(&forward);
        Ok(match (&self.lens, disk) {
            (Some(lens), Some(disk)) => {
                let [aperture] = lens.aperture_radius.planes(context).map(|a| a * per_unit);
                let [focus] = lens.focus_distance.planes(context).map(|f| f * per_unit);
                let on_lens = right
                    .scale(&(disk[0].clone() * aperture.clone()))
                    .add(&up.scale(&(disk[1].clone() * aperture)));
                let direction = through.scale(&focus).sub(&on_lens).normalized();
                (eye.add(&on_lens), direction)
            }
            _ => (eye.map(|x| x.expand([1, n])), through.normalized()),
        })
    }

    /// Returns whether rays need a point on the lens. They need none if the aperture radius is a constant 0.
    pub(crate) fn has_lens(&self) -> bool {
        self.lens
            .as_ref()
            .is_some_and(|l| !matches!(l.aperture_radius, Parameter::Constant([0.0])))
    }

    /// Returns half the view's height divided by the eye's distance (for parallel rays, the distance to the target).
    ///
    /// # Errors
    /// If a value is out of range or can't be read.
    pub(crate) fn half_height(&self) -> Result<f64> {
        self.check(None)?;
        let [_, half, ..] = self.projection.host()?.film(1.0, 1.0);
        if !self.projection.is_parallel() {
            return Ok(half);
        }
        let (eye, target) = (self.eye.values()?, self.target.values()?);
        Ok(half / glam::DVec3::from(eye).distance(target.into()))
    }

    /// Reads the values of a validated camera back to the host.
    ///
    /// # Errors
    /// If a tensor can't be read.
    pub(crate) fn host(&self) -> Result<HostCamera> {
        let lens = match &self.lens {
            Some(lens) if self.has_lens() => {
                let [aperture] = lens.aperture_radius.values()?;
                let [focus] = lens.focus_distance.values()?;
                Some([aperture, focus])
            }
            _ => None,
        };
        Ok(HostCamera {
            eye: self.eye.values()?.into(),
            target: self.target.values()?.into(),
            up: self.up.values()?.into(),
            projection: self.projection.host()?,
            lens,
            half_height: self.half_height()?,
        })
    }
}

impl Projection {
    pub(crate) fn is_parallel(&self) -> bool {
        matches!(self, Self::Orthographic { .. })
    }

    /// Reads the values back to the host.
    ///
    /// # Errors
    /// If a tensor can't be read.
    pub(crate) fn host(&self) -> Result<HostProjection> {
        Ok(match self {
            Self::Perspective { fov_y } => HostProjection::Perspective {
                fov_y: fov_y.values()?[0],
            },
            Self::Intrinsics {
                focal,
                principal,
                size,
            } => HostProjection::Intrinsics {
                focal: focal.values()?,
                principal: principal.values()?,
                size: size.map(|n| n as f64),
            },
            Self::Orthographic { height } => HostProjection::Orthographic {
                height: height.values()?[0],
            },
        })
    }

    /// Returns [`HostProjection::film`] as planes `[1, 1]`, with [`HostProjection::slopes`] as their derivatives.
    fn planes(&self, context: &Context, unit: f64, aspect: f64) -> Result<[Tensor<2>; 4]> {
        let host = self.host()?;
        let mut planes = host.film(unit, aspect).map(|x| context.row(&[x]));
        let numbers: Vec<Tensor<2>> = match self {
            Self::Perspective { fov_y } => fov_y.planes(context).into(),
            Self::Intrinsics {
                focal, principal, ..
            } => [focal.planes(context), principal.planes(context)].concat(),
            Self::Orthographic { height } => height.planes(context).into(),
        };
        for (p, slopes) in numbers.iter().zip(host.slopes(unit, aspect)) {
            let change = p.clone() - detached(p);
            for (plane, slope) in planes.iter_mut().zip(slopes) {
                *plane = plane.clone() + change.clone() * slope;
            }
        }
        Ok(planes)
    }
}
