use burn::tensor::Tensor;

use super::Parameter;
use crate::error::{Error, Result};
use crate::geometry::{Context, Vec3, sin_cos};

/// A perspective camera, pinhole or thin lens. Right-handed, pixel (0, 0) top left.
#[derive(Clone)]
pub struct Camera {
    /// Position.
    pub eye: Parameter<3>,
    /// The point looked at.
    pub target: Parameter<3>,
    /// Roughly up.
    pub up: Parameter<3>,
    /// Vertical field of view, degrees.
    pub fov_y: Parameter<1>,
    /// Aperture radius and distance of the focus plane along the view axis.
    pub lens: Option<(Parameter<1>, Parameter<1>)>,
}

/// A camera as `[1, 1]` planes.
pub(crate) struct CameraFrame {
    pub eye: Vec3,
    /// Unit vectors.
    pub forward: Vec3,
    pub right: Vec3,
    pub up: Vec3,
    /// tan(fov_y/2).
    pub half_height: Tensor<2>,
    /// Aperture radius and focus distance.
    pub lens: Option<[Tensor<2>; 2]>,
}

impl Camera {
    /// A pinhole camera with y up and 40° of vertical field of view.
    pub fn look_at(eye: impl Into<Parameter<3>>, target: impl Into<Parameter<3>>) -> Self {
        Self {
            eye: eye.into(),
            target: target.into(),
            up: Parameter::Constant([0.0, 1.0, 0.0]),
            fov_y: Parameter::Constant([40.0]),
            lens: None,
        }
    }

    /// With another up vector.
    pub fn up(mut self, up: impl Into<Parameter<3>>) -> Self {
        self.up = up.into();
        self
    }

    /// With a vertical field of view in degrees, in (0, 180).
    pub fn fov_y(mut self, degrees: impl Into<Parameter<1>>) -> Self {
        self.fov_y = degrees.into();
        self
    }

    /// With a thin lens: aperture radius and focus distance in scene units.
    pub fn thin_lens(
        mut self,
        aperture_radius: impl Into<Parameter<1>>,
        focus_distance: impl Into<Parameter<1>>,
    ) -> Self {
        self.lens = Some((aperture_radius.into(), focus_distance.into()));
        self
    }

    pub(crate) fn check(&self) -> Result<()> {
        let finite = |_| true;
        let eye = glam::DVec3::from(self.eye.check("camera", "eye", "finite numbers", finite)?);
        let target =
            glam::DVec3::from(
                self.target
                    .check("camera", "target", "finite numbers", finite)?,
            );
        let up = glam::DVec3::from(self.up.check("camera", "up", "finite numbers", finite)?);
        self.fov_y
            .check("camera", "fov_y", "degrees in (0, 180)", |f| {
                f > 0.0 && f < 180.0
            })?;
        if let Some((aperture, focus)) = &self.lens {
            aperture.check("camera", "aperture radius", "a number ≥ 0", |a| a >= 0.0)?;
            focus.check("camera", "focus distance", "a number > 0", |f| f > 0.0)?;
        }
        let view = target - eye;
        if view.length() <= 0.0 {
            return Err(Error::invalid(
                "camera",
                "target",
                target,
                "a point other than the eye",
            ));
        }
        if view.normalize().cross(up.normalize_or_zero()).length() < 1e-6 {
            return Err(Error::invalid(
                "camera",
                "up",
                up,
                format!("a vector not along the view {view}"),
            ));
        }
        Ok(())
    }

    /// The camera as `[1, 1]` planes; lengths relative to `centre`, in units of `unit`.
    pub(crate) fn frame(&self, context: &Context, centre: [f64; 3], unit: f64) -> CameraFrame {
        let vector = |p: &Parameter<3>| {
            let [x, y, z] = p.planes(context);
            Vec3::new(x, y, z)
        };
        let per_unit = unit.recip();
        let relative = |p: &Parameter<3>| {
            let v = vector(p).sub(&Vec3::constant(context, centre));
            v.scale_by(per_unit)
        };
        let eye = relative(&self.eye);
        // Their lengths may be too small or large for squares in the scene's float type.
        let host = |p: &Parameter<3>| glam::DVec3::from(p.values().unwrap_or([0.0; 3]));
        let length = (host(&self.target) - host(&self.eye)).length();
        let forward = match (&self.eye, &self.target) {
            (&Parameter::Constant(eye), &Parameter::Constant(target)) => {
                let forward = glam::DVec3::from(target) - glam::DVec3::from(eye);
                Vec3::constant(context, (forward / length).to_array())
            }
            _ => {
                let forward = vector(&self.target).sub(&vector(&self.eye));
                forward.scale_by(length.recip()).normalized()
            }
        };
        let up = vector(&self.up).scale_by(host(&self.up).length().recip());
        let right = forward.cross(&up.normalized()).normalized();
        let up = right.cross(&forward);
        let [fov] = self.fov_y.planes(context);
        let half = fov * (std::f64::consts::PI / 360.0);
        let (sin, cos) = sin_cos(half);
        CameraFrame {
            eye,
            forward,
            right,
            up,
            half_height: sin / cos,
            lens: self.lens.as_ref().map(|(aperture, focus)| {
                let ([aperture], [focus]) = (aperture.planes(context), focus.planes(context));
                [aperture * per_unit, focus * per_unit]
            }),
        }
    }

    /// Rays through film points (rows `[1, N]` in units of the image, (0, 0) top left), from lens
    /// points (rows, on the unit disk). Origins are relative to `centre`, in units of `unit`.
    pub(crate) fn rays(
        &self,
        context: &Context,
        centre: [f64; 3],
        unit: f64,
        aspect: f64,
        film: &[Tensor<2>; 2],
        disk: Option<&[Tensor<2>; 2]>,
    ) -> (Vec3, Vec3) {
        let CameraFrame {
            eye,
            forward,
            right,
            up,
            half_height,
            lens,
        } = self.frame(context, centre, unit);
        let sx = (film[0].clone() * 2.0 - 1.0) * (half_height.clone() * aspect);
        let sy = (film[1].clone() * (-2.0) + 1.0) * half_height;
        let n = film[0].dims()[1];
        let through = right.scale(&sx).add(&up.scale(&sy)).add(&forward);
        match (lens, disk) {
            (Some([aperture, focus]), Some(disk)) => {
                let on_lens = right
                    .scale(&(disk[0].clone() * aperture.clone()))
                    .add(&up.scale(&(disk[1].clone() * aperture)));
                let direction = through.scale(&focus).sub(&on_lens).normalized();
                (eye.add(&on_lens), direction)
            }
            _ => (eye.map(|x| x.expand([1, n])), through.normalized()),
        }
    }

    /// Whether rays need a point on the lens: not for a constant aperture of 0.
    pub(crate) fn has_lens(&self) -> bool {
        !matches!(&self.lens, None | Some((Parameter::Constant([0.0]), _)))
    }

    pub(crate) fn tensors(&self) -> Vec<(&'static str, &Tensor<1>)> {
        let mut all = vec![
            ("eye", self.eye.tensor()),
            ("target", self.target.tensor()),
            ("up", self.up.tensor()),
            ("fov_y", self.fov_y.tensor()),
        ];
        if let Some((a, f)) = &self.lens {
            all.push(("aperture radius", a.tensor()));
            all.push(("focus distance", f.tensor()));
        }
        all.into_iter()
            .filter_map(|(n, t)| t.map(|t| (n, t)))
            .collect()
    }
}
