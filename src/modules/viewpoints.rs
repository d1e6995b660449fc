use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use glam::DVec3;

use super::values::leaf;
use crate::error::{Error, Result};
use crate::geometry::host_values;
use crate::meshing::median;
use crate::scene::{Camera, Projection};

/// The cameras of a set of photographs, each with a small trained turn and shift, and a common factor of their focal
/// lengths. It corrects poses that structure from motion has found only nearly.
///
/// All of these are 0 at the start, where [`ViewpointParams::camera`] returns the given cameras. A shift of all cameras, a
/// turn of all about a point and a scale change nothing that images show if the scene is trained, too: train the scene
/// first.
///
/// ```
/// use softray::modules::ViewpointParams;
/// use softray::prelude::*;
/// let cameras = [0.0, 1.0].map(|x| Camera::look_at([x, 0.0, 4.0], [0.0, 0.0, 0.0]));
/// let params = ViewpointParams::from_cameras(&cameras, 4.0, &Device::flex().autodiff())?;
/// assert_eq!(params.camera(1)?.eye.values()?, [1.0, 0.0, 4.0]);
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module)]
pub struct ViewpointParams {
    /// Turns `[N, 3]` of the N cameras about their own axes: the tangents of the angles by which the view axis turns to the
    /// right and up, and by which the image rolls.
    pub turns: Param<Tensor<2>>,
    /// Shifts `[N, 3]` along the cameras' own axes (right, up, forward), divided by the distance given to
    /// [`ViewpointParams::from_cameras`].
    pub shifts: Param<Tensor<2>>,
    /// The logarithm of the factor of all focal lengths, `[1]`.
    pub log_focal: Param<Tensor<1>>,
    /// Per camera the eye, and the axes right, up and forward as rows, `[N, 4, 3]`.
    frames: Tensor<3>,
    /// Focal lengths, principal point, columns and rows, `[N, 6]`.
    intrinsics: Tensor<2>,
    distance: f64,
}

impl ViewpointParams {
    /// Creates parameters for cameras that are given by a matrix K ([`Projection::Intrinsics`]), in the device's default
    /// float type; a projection by a field of view is converted. `distance` is about that of the cameras from the scene, in
    /// scene units.
    ///
    /// # Errors
    /// If there is no camera, a projection is orthographic, a camera has a lens, a value is out of its range or a tensor
    /// can't be read.
    pub fn from_cameras(cameras: &[Camera], distance: f64, device: &Device) -> Result<Self> {
        let count = cameras.len();
        if count == 0 || !(distance > 0.0 && distance.is_finite()) {
            let value = format!("{count} cameras at a distance of {distance}");
            let expected = "at least one camera, and a distance > 0";
            return Err(Error::invalid("viewpoints", "cameras", value, expected));
        }
        let (mut frames, mut intrinsics) = (Vec::new(), Vec::new());
        for camera in cameras {
            camera.check(None)?;
            frames.extend(frame(camera)?);
            intrinsics.extend(calibration(camera)?);
        }
        Ok(Self {
            turns: leaf(vec![0.0; 3 * count], [count, 3], device),
            shifts: leaf(vec![0.0; 3 * count], [count, 3], device),
            log_focal: leaf(vec![0.0], [1], device),
            frames: leaf(frames, [count, 4, 3], device).val().detach(),
            intrinsics: leaf(intrinsics, [count, 6], device).val().detach(),
            distance,
        })
    }

    /// Returns the number of cameras.
    pub fn count(&self) -> usize {
        self.intrinsics.dims()[0]
    }

    /// Returns a camera, in the graph of the parameters.
    ///
    /// # Errors
    /// If there is no camera of this index, or a tensor can't be read.
    pub fn camera(&self, index: usize) -> Result<Camera> {
        if index >= self.count() {
            let expected = format!("less than {}", self.count());
            return Err(Error::invalid("viewpoints", "index", index, expected));
        }
        let row = |t: Tensor<2>| t.narrow(0, index, 1).squeeze_dim::<1>(0);
        let (turn, shift) = (row(self.turns.val()), row(self.shifts.val()));
        let of = self.frames.clone().narrow(0, index, 1).squeeze_dim::<2>(0);
        let axis = |k: usize| of.clone().narrow(0, k, 1).squeeze_dim::<1>(0);
        let [eye, right, up, forward] = [0, 1, 2, 3].map(axis);
        let part = |t: &Tensor<1>, k: usize| t.clone().narrow(0, k, 1);
        let shifted = right.clone() * part(&shift, 0)
            + up.clone() * part(&shift, 1)
            + forward.clone() * part(&shift, 2);
        let eye = eye + shifted * self.distance;
        let view = forward + right.clone() * part(&turn, 0) + up.clone() * part(&turn, 1);
        let up = up + right * part(&turn, 2);
        let target = eye.clone() + view * self.distance;
        let known = row(self.intrinsics.clone());
        let factor = self.log_focal.val().clamp(-1.0, 1.0).exp();
        let size = host_values(&known.clone().narrow(0, 4, 2))?;
        let mut camera = Camera::look_at(eye, target).with_up(up);
        camera.projection = Projection::Intrinsics {
            focal: (known.clone().narrow(0, 0, 2) * factor).into(),
            principal: known.narrow(0, 2, 2).into(),
            size: [size[0] as usize, size[1] as usize],
        };
        Ok(camera)
    }

    /// Returns another camera of the same lens with the common factor of the focal lengths, in the graph of the parameters. A
    /// projection that is not given by a matrix K stays as it is.
    ///
    /// # Errors
    /// If the focal lengths can't be read.
    pub fn with_focal(&self, mut camera: Camera) -> Result<Camera> {
        if let Projection::Intrinsics { focal, .. } = &mut camera.projection {
            let factor = self.log_focal.val().clamp(-1.0, 1.0).exp();
            let given = leaf(focal.values()?.to_vec(), [2], &factor.device()).val();
            *focal = (given.detach() * factor).into();
        }
        Ok(camera)
    }

    /// Returns the median over the cameras of the angle by which turn and shift have moved a point on the view axis at the
    /// distance of [`ViewpointParams::from_cameras`] in the image, in degrees. Roll and focal lengths do not count.
    ///
    /// # Errors
    /// If a tensor can't be read.
    pub fn median_move(&self) -> Result<f64> {
        let moved = (self.turns.val() + self.shifts.val()).narrow(1, 0, 2);
        let moved = host_values(&moved.detach().powi_scalar(2).sum_dim(1).sqrt())?;
        Ok(median(&moved).atan().to_degrees())
    }
}

/// Returns the eye and the axes right, up and forward.
fn frame(camera: &Camera) -> Result<Vec<f64>> {
    let eye = DVec3::from(camera.eye.values()?);
    let forward = (DVec3::from(camera.target.values()?) - eye).normalize();
    let right = forward.cross(DVec3::from(camera.up.values()?)).normalize();
    let rows = [eye, right, right.cross(forward), forward];
    Ok(rows.iter().flat_map(DVec3::to_array).collect())
}

/// Returns the focal lengths, principal point, columns and rows of a camera's images; of a square image for a projection by a
/// field of view.
fn calibration(camera: &Camera) -> Result<Vec<f64>> {
    let invalid = |found: &str| {
        let expected = "a perspective projection without a lens";
        Err(Error::invalid("viewpoints", "camera", found, expected))
    };
    if camera.lens.is_some() {
        return invalid("a camera with a lens");
    }
    match &camera.projection {
        Projection::Perspective { fov_y } => {
            let [fov] = fov_y.values()?;
            let side = 1024.0;
            let focal = 0.5 * side / (0.5 * fov).to_radians().tan();
            Ok(vec![focal, focal, 0.5 * side, 0.5 * side, side, side])
        }
        Projection::Intrinsics {
            focal,
            principal,
            size: [width, height],
        } => {
            let [fx, fy] = focal.values()?;
            let [cx, cy] = principal.values()?;
            Ok(vec![fx, fy, cx, cy, *width as f64, *height as f64])
        }
        Projection::Orthographic { .. } => invalid("an orthographic projection"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{RenderOptions, render};
    use crate::scene::{Object, Scene, shapes};

    fn cameras() -> Vec<Camera> {
        let at = |x: f64| {
            let mut camera =
                Camera::look_at([x, 0.4, 4.0], [0.1, 0.0, 0.0]).with_up([0.2, 1.0, 0.1]);
            camera.projection = Projection::Intrinsics {
                focal: [30.0, 31.0].into(),
                principal: [9.0, 7.5].into(),
                size: [16, 16],
            };
            camera
        };
        vec![at(-1.0), at(1.5)]
    }

    /// The image from each camera is that from the given one, and its derivatives with respect to all parameters are those
    /// of central differences.
    #[test]
    fn images_and_derivatives() -> Result<()> {
        let d = Device::flex();
        let params = ViewpointParams::from_cameras(&cameras(), 4.0, &d.clone().autodiff())?;
        let ball = Object::new(shapes::icosphere(2, &d));
        let scene = Scene::new()
            .with_object(ball)
            .with_environment([1.0, 0.5, 0.2]);
        let options = RenderOptions::new(16, 16)
            .with_samples(1024)
            .with_bounces(0);
        let weights: Vec<f32> = (0..768)
            .map(|i| (0.2 * (i / 3 % 16) as f32).sin() + (0.15 * (i / 48) as f32).cos())
            .collect();
        let weights = Tensor::<1>::from_floats(weights.as_slice(), &d).reshape([16, 16, 3]);
        let loss = |camera: &Camera| -> Result<Tensor<1>> {
            Ok((render(&scene, camera, &options)?.radiance * weights.clone()).sum())
        };
        let given = loss(&cameras()[1])?.into_scalar::<f64>();
        let own = loss(&params.camera(1)?)?;
        assert!((own.clone().into_scalar::<f64>() - given).abs() < 1e-3);
        let gradients = own.backward();
        let of = |p: &Tensor<2>| p.grad(&gradients).map(|g| host_values(&g)).transpose();
        let turns = of(&params.turns.val())?.expect("a gradient");
        let shifts = of(&params.shifts.val())?.expect("a gradient");
        let focal = params.log_focal.val().grad(&gradients).expect("a gradient");
        assert!(turns[..3].iter().chain(&shifts[..3]).all(|&g| g == 0.0));
        let step = 0.004;
        let mut found = Vec::new();
        for k in 0..7 {
            let at = |by: f64| -> Result<f64> {
                let mut other = ViewpointParams::from_cameras(&cameras(), 4.0, &d)?;
                let mut row = vec![0.0; 6];
                row[3 + k % 3] = by;
                match k / 3 {
                    0 => other.turns = leaf(row, [2, 3], &d),
                    1 => other.shifts = leaf(row, [2, 3], &d),
                    _ => other.log_focal = leaf(vec![by], [1], &d),
                }
                Ok(loss(&other.camera(1)?)?.into_scalar::<f64>())
            };
            let difference = (at(step)? - at(-step)?) / (2.0 * step);
            let gradient = match k / 3 {
                0 => turns[3 + k],
                1 => shifts[k],
                _ => focal.clone().into_scalar::<f64>(),
            };
            found.push((gradient, difference));
        }
        let largest = found.iter().map(|(_, d)| d.abs()).fold(0.0, f64::max);
        for (gradient, difference) in &found {
            assert!((gradient - difference).abs() < 0.04 * largest, "{found:?}");
        }
        Ok(())
    }

    #[test]
    fn errors_for_cameras_that_cannot_be_refined() {
        let d = Device::flex();
        assert!(ViewpointParams::from_cameras(&[], 4.0, &d).is_err());
        let lens = cameras().remove(0).with_thin_lens(0.1, 4.0);
        assert!(ViewpointParams::from_cameras(&[lens], 4.0, &d).is_err());
        let flat = cameras().remove(0).with_orthographic(2.0);
        assert!(ViewpointParams::from_cameras(&[flat], 4.0, &d).is_err());
        let params = ViewpointParams::from_cameras(&cameras(), 4.0, &d).expect("cameras");
        assert!(params.camera(2).is_err());
    }
}
