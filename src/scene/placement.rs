//! Translation, scaling and rotation of meshes.

use std::sync::Arc;

use burn::tensor::Tensor;

use super::angles::warn_of_radians;
use super::parameter::{Range, conversions, without_tape};
use super::transform::{Mistake, mirrors};
use super::{Mesh, Parameter, Transform};
use crate::error::Error;
use crate::geometry::{Context, sin_cos};

/// The factors of [`Mesh::scaled`]: numbers or a tensor.
/// Numbers, arrays of three numbers and tensors convert into this type.
///
/// [`Mesh::scaled`] has an example.
#[derive(Clone, Debug)]
pub enum Scale {
    /// One factor for all axes.
    Uniform(f64),
    /// A factor for each axis.
    Axes([f64; 3]),
    /// A tensor `[1]` or `[3]`.
    Tensor(Tensor<1>),
}

conversions! {
    [] f64 => Scale: |factor| Self::Uniform(factor);
    [] f32 => Scale: |factor| Self::Uniform(factor.into());
    [] [f64; 3] => Scale: |factors| Self::Axes(factors);
    [] [f32; 3] => Scale: |factors| Self::Axes(factors.map(f64::from));
    [] glam::DVec3 => Scale: |factors| Self::Axes(factors.to_array());
    [] glam::Vec3 => Scale: |factors| factors.to_array().into();
    [] Tensor<1> => Scale: |factors| Self::Tensor(factors);
}

impl Mesh {
    /// Translates the mesh by an offset in scene units: three numbers or a tensor `[3]`.
    ///
    /// A render of the mesh returns an error if a tensor has another shape, device or float type than the vertices
    /// require, or if numbers are not finite.
    ///
    /// ```
    /// use softray::prelude::*;
    /// let device = Device::flex();
    /// let offset = Tensor::<1>::from_floats([0.0, 0.2, 0.0], &device).autodiff().require_grad();
    /// let ball = shapes::icosphere(1, &device).translated([1.0, 0.0, 0.0]).translated(offset);
    /// assert!(ball.vertices.is_tracked());
    /// ```
    pub fn translated(self, offset: impl Into<Parameter<3>>) -> Self {
        match self.like_vertices("translated by", &offset.into()) {
            Ok(offset) => {
                let moved = self.vertices.clone() + offset.reshape([1, 3]);
                self.with_vertices(moved)
            }
            Err(mistake) => self.mistaken(mistake),
        }
    }

    /// Scales the mesh about the origin: by a number, a factor per axis `[f64; 3]`, or a tensor `[1]` or `[3]`.
    ///
    /// Shading normals are scaled by the inverse, so they stay normals of the surface. An odd number of negative
    /// factors mirrors the mesh, which would turn it inside out. Its faces are then wound the other way, so the front
    /// stays the front.
    ///
    /// The factors are read back from their device. A render of the mesh returns an error if a factor is not finite, if
    /// a tensor has another shape, device or float type, or if one of three factors is 0 and the mesh has shading
    /// normals.
    ///
    /// ```
    /// use softray::prelude::*;
    /// let device = Device::flex();
    /// let slab = shapes::cube(&device).scaled([2.0, 0.1, 1.0]).scaled(0.5);
    /// assert!((slab.bounds()?.size()[0] - 2.0).abs() < 1e-6);
    /// let size = Tensor::<1>::from_floats([0.5], &device).autodiff().require_grad();
    /// assert!(slab.scaled(size).vertices.is_tracked());
    /// # Ok::<(), softray::Error>(())
    /// ```
    pub fn scaled(self, scale: impl Into<Scale>) -> Self {
        const BY: &str = "scaled by";
        let read = match scale.into() {
            Scale::Uniform(s) => self.read(BY, &Parameter::Constant([s])).map(one),
            Scale::Axes(s) => self.read(BY, &Parameter::Constant(s)),
            Scale::Tensor(t) => match t.dims() {
                [1] => self.read(BY, &Parameter::Tensor(t)).map(one),
                [3] => self.read(BY, &Parameter::Tensor(t)),
                [n] => Err(Mistake::new(
                    format!("{BY} a tensor of shape [{n}]"),
                    "[1] or [3]",
                )),
            },
        };
        match read {
            Ok((factors, scale)) => self.scaled_by(factors, scale),
            Err(mistake) => self.mistaken(mistake),
        }
    }

    /// Scales by a tensor `[1]` or `[3]` with the values `factors`.
    fn scaled_by(mut self, factors: [f64; 3], scale: Tensor<1>) -> Self {
        let [n] = scale.dims();
        let scale = scale.reshape([1, n]);
        if let Some(normals) = &mut self.normals {
            if n == 3 {
                if factors.contains(&0.0) {
                    let expected = "factors other than 0 for a mesh with shading normals";
                    return self.mistaken(Mistake::new(format!("scaled by {factors:?}"), expected));
                }
                // The length of normals doesn't matter, but it must not overflow or underflow.
                let least = factors.iter().fold(f64::INFINITY, |m, s| m.min(s.abs()));
                normals.values = normals.values.clone() * (scale.clone().recip() * least);
            } else if factors[0] < 0.0 {
                normals.values = normals.values.clone().neg();
            }
        }
        self.turn_tangents(|t| t * scale.clone());
        self.vertices = self.vertices * scale;
        if mirrors(&factors) {
            self.mirrored()
        } else {
            self
        }
    }

    /// Rotates the mesh about an axis through the origin by an angle in degrees.
    ///
    /// The rotation is counter-clockwise seen from the axis's tip. The axis is three numbers or a tensor `[3]` of any
    /// length but 0. The angle is a number or a tensor `[1]`. Both are differentiable. Shading normals and tangents
    /// rotate too.
    ///
    /// Axis and angle are read back from their device. A render of the mesh returns an error if the axis is 0 or not
    /// finite, the angle is not finite, or a tensor has another shape, device or float type.
    ///
    /// ```
    /// use softray::prelude::*;
    /// let device = Device::flex();
    /// let angle = Tensor::<1>::from_floats([20.0], &device).autodiff().require_grad();
    /// let cube = shapes::cube(&device).rotated([0.0, 1.0, 0.0], 45.0);
    /// assert!((cube.bounds()?.max[0] - 2f64.sqrt()).abs() < 1e-6);
    /// assert!(cube.rotated([1.0, 0.0, 0.0], angle).vertices.is_tracked());
    /// # Ok::<(), softray::Error>(())
    /// ```
    pub fn rotated(self, axis: impl Into<Parameter<3>>, degrees: impl Into<Parameter<1>>) -> Self {
        let (axis, degrees) = (axis.into(), degrees.into());
        warn_of_radians("the angle of a rotation", &degrees);
        match self.quaternion(&axis, &degrees) {
            Ok(quaternion) => self.transformed(&Transform::new().with_quaternion(quaternion)),
            Err(mistake) => self.mistaken(mistake),
        }
    }

    fn quaternion(&self, axis: &Parameter<3>, degrees: &Parameter<1>) -> Read<Tensor<1>> {
        let (_, angle) = self.read("rotated by an angle of", degrees)?;
        let about = "rotated about an axis of";
        let (values, axis) = self.read(about, axis)?;
        if values == [0.0; 3] {
            return Err(Mistake::new(
                format!("{about} {values:?}"),
                "one that is not 0",
            ));
        }
        // Squares of the components may overflow or underflow.
        let largest = values.iter().fold(0f64, |m, v| m.max(v.abs()));
        let axis = axis * largest.recip();
        let unit = axis.clone() / (axis.clone() * axis).sum().sqrt();
        let (sin, cos) = sin_cos(angle * 0.5f64.to_radians());
        Ok(Tensor::cat(vec![cos, unit * sin], 0))
    }

    /// Returns the values of a parameter and its tensor from [`Self::like_vertices`].
    fn read<const C: usize>(&self, by: &str, p: &Parameter<C>) -> Read<([f64; C], Tensor<1>)> {
        let tensor = self.like_vertices(by, p)?;
        match p.values() {
            Ok(values) => finite(by, &values).map(|()| (values, tensor)),
            Err(e) => Err(Mistake::new(
                format!("{by} a tensor"),
                format!("one that can be read: {e}"),
            )),
        }
    }

    /// Returns a parameter as a tensor on the device and in the float type of the vertices.
    fn like_vertices<const C: usize>(&self, by: &str, p: &Parameter<C>) -> Read<Tensor<1>> {
        let (device, dtype) = (self.vertices.device().inner(), self.vertices.dtype());
        let tensor = match p {
            Parameter::Constant(values) => {
                finite(by, values)?;
                return Ok(Context { device, dtype }.tensor(values, [C]));
            }
            Parameter::Tensor(tensor) => without_tape(tensor),
        };
        let own = tensor.device().inner();
        let wrong = |found: String, expected: String| {
            Err(Mistake::new(format!("{by} a tensor {found}"), expected))
        };
        if tensor.dims() != [C] {
            wrong(format!("of shape {:?}", tensor.dims()), format!("[{C}]"))
        } else if tensor.dtype() != dtype {
            let found = format!("of dtype {:?}", tensor.dtype());
            wrong(found, format!("{dtype:?} like the vertices"))
        } else if own != device {
            wrong(
                format!("on {own:?}"),
                format!("{device:?} like the vertices"),
            )
        } else {
            Ok(tensor)
        }
    }

    /// Reverses the winding of the faces of the mesh and of its attributes, and the sign of bitangents.
    pub(super) fn mirrored(mut self) -> Self {
        let swapped =
            |faces: &[[u32; 3]]| Arc::new(faces.iter().map(|&[a, b, c]| [a, c, b]).collect());
        let faces: Arc<Vec<[u32; 3]>> = swapped(&self.faces);
        let own = std::mem::replace(&mut self.faces, faces.clone());
        for attribute in self.attributes_mut().into_iter().flatten() {
            attribute.faces = if Arc::ptr_eq(&attribute.faces, &own) {
                faces.clone()
            } else {
                swapped(&attribute.faces)
            };
        }
        if let Some(tangents) = &mut self.tangents {
            tangents.mirror();
        }
        self
    }
}

/// A value that was read, or a mistake.
type Read<T> = Result<T, Mistake>;

fn finite(by: &str, values: &[f64]) -> Read<()> {
    Range::Finite
        .check("mesh", by, values)
        .map_err(|e| match e {
            Error::Invalid {
                value, expected, ..
            } => Mistake::new(format!("{by} {value}"), expected),
            e => Mistake::new(by, e.to_string()),
        })
}

/// Uses one factor for all three axes.
fn one(([factor], tensor): ([f64; 1], Tensor<1>)) -> ([f64; 3], Tensor<1>) {
    ([factor; 3], tensor)
}
