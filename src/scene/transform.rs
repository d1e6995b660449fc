use std::fmt;

use burn::tensor::Tensor;

use crate::debug::tensor;
use crate::geometry::{host_values, sin_cos};

/// A mistake: the value found and the values expected.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "remote", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct Mistake {
    pub found: String,
    pub expected: String,
}

impl Mistake {
    pub fn new(found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self {
            found: found.into(),
            expected: expected.into(),
        }
    }
}

/// A scale, then a rotation, then a translation. Each part is a tensor or absent.
///
/// A part of a wrong shape, or a rotation about an axis 0, is left out. A mesh with such a transform can't be rendered:
/// the error of the render describes the mistake.
///
/// ```
/// use softray::prelude::*;
/// let device = Device::flex();
/// let angle = Tensor::<1>::from_floats([30.0], &device).autodiff().require_grad();
/// let turn = Transform::new().with_axis_angle([0.0, 1.0, 0.0], angle);
/// let cube = shapes::cube(&device).transformed(&turn);
/// assert!(cube.vertices.is_tracked());
/// ```
#[derive(Clone, Default)]
pub struct Transform {
    rotation: Option<Tensor<2>>,
    translation: Option<Tensor<1>>,
    scale: Option<Tensor<1>>,
    /// The mistake that a render reports, if there is one.
    mistake: Option<Mistake>,
}

impl fmt::Debug for Transform {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut all = f.debug_struct("Transform");
        if let Some(r) = &self.rotation {
            all.field("rotation", &tensor(&r.clone().reshape([-1])));
        }
        for (name, part) in [("translation", &self.translation), ("scale", &self.scale)] {
            if let Some(part) = part {
                all.field(name, &tensor(part));
            }
        }
        if let Some(mistake) = &self.mistake {
            all.field("mistake", mistake);
        }
        all.finish()
    }
}

impl Transform {
    /// Creates the identity.
    pub fn new() -> Self {
        Self::default()
    }

    /// Sets the rotation by a quaternion `[4]` in the order (w, x, y, z).
    /// The quaternion is normalized here. So any non-zero tensor is a rotation, and the gradient is defined at every
    /// angle.
    pub fn with_quaternion(mut self, q: Tensor<1>) -> Self {
        if !self.has_length("a quaternion", &q, &[4]) {
            return self;
        }
        let q = q.clone() / (q.clone() * q).sum().sqrt();
        let at = |i: usize| q.clone().slice([i..i + 1]);
        let (w, x, y, z) = (at(0), at(1), at(2), at(3));
        let p = |a: &Tensor<1>, b: &Tensor<1>| a.clone() * b.clone() * 2.0;
        let (xx, yy, zz) = (p(&x, &x), p(&y, &y), p(&z, &z));
        let (xy, xz, yz) = (p(&x, &y), p(&x, &z), p(&y, &z));
        let (wx, wy, wz) = (p(&w, &x), p(&w, &y), p(&w, &z));
        let one_minus = |a: Tensor<1>| a.neg().add_scalar(1.0);
        self.rotation = Some(
            Tensor::cat(
                vec![
                    one_minus(yy.clone() + zz.clone()),
                    xy.clone() - wz.clone(),
                    xz.clone() + wy.clone(),
                    xy + wz,
                    one_minus(xx.clone() + zz),
                    yz.clone() - wx.clone(),
                    xz - wy,
                    yz + wx,
                    one_minus(xx + yy),
                ],
                0,
            )
            .reshape([3, 3]),
        );
        self
    }

    /// Sets the rotation by an angle `[1]` in degrees about an axis of any length but 0.
    pub fn with_axis_angle(mut self, axis: [f64; 3], degrees: Tensor<1>) -> Self {
        if !self.has_length("with_axis_angle of an angle", &degrees, &[1]) {
            return self;
        }
        let Some(axis) = glam::DVec3::from_array(axis).try_normalize() else {
            self.mistake = Some(Mistake::new(
                format!("with_axis_angle about {axis:?}"),
                "a direction",
            ));
            return self;
        };
        let (sin, cos) = sin_cos(degrees * 0.5f64.to_radians());
        let q = vec![
            cos,
            sin.clone() * axis.x,
            sin.clone() * axis.y,
            sin * axis.z,
        ];
        self.with_quaternion(Tensor::cat(q, 0))
    }

    /// Sets the rotation by the first two columns of its matrix, `[6]` (x₀ y₀ z₀ x₁ y₁ z₁).
    /// They are made orthonormal here (Zhou et al. 2019). This form is continuous over all rotations, which suits
    /// networks.
    pub fn with_six_d(mut self, columns: Tensor<1>) -> Self {
        if !self.has_length("with_six_d of columns", &columns, &[6]) {
            return self;
        }
        let unit = |v: Tensor<1>| v.clone() / (v.clone() * v).sum().sqrt();
        let first = unit(columns.clone().slice([0..3]));
        let second = columns.slice([3..6]);
        let along = (first.clone() * second.clone()).sum();
        let second = unit(second - first.clone() * along);
        let at = |v: &Tensor<1>, i: usize| v.clone().slice([i..i + 1]);
        let minor =
            |i: usize, j: usize| at(&first, i) * at(&second, j) - at(&first, j) * at(&second, i);
        let third = Tensor::cat(vec![minor(1, 2), minor(2, 0), minor(0, 1)], 0);
        self.rotation = Some(Tensor::stack::<2>(vec![first, second, third], 1));
        self
    }

    /// Sets the translation `[3]`, in scene units.
    pub fn with_translation(mut self, offset: Tensor<1>) -> Self {
        if self.has_length("a translation", &offset, &[3]) {
            self.translation = Some(offset);
        }
        self
    }

    /// Sets the scale: `[1]`, or `[3]` with one factor per axis. It is applied before the rotation.
    pub fn with_scale(mut self, scale: Tensor<1>) -> Self {
        if self.has_length("a scale", &scale, &[1, 3]) {
            self.scale = Some(scale);
        }
        self
    }

    /// Returns whether a part has one of these lengths. If not, it records the mistake.
    fn has_length(&mut self, part: &str, found: &Tensor<1>, expected: &[usize]) -> bool {
        let [length] = found.dims();
        let has = expected.contains(&length);
        if !has {
            let expected: Vec<String> = expected.iter().map(|n| format!("[{n}]")).collect();
            let mistake =
                Mistake::new(format!("{part} of shape [{length}]"), expected.join(" or "));
            self.mistake.get_or_insert(mistake);
        }
        has
    }

    pub(super) fn mistake(&self) -> Option<&Mistake> {
        self.mistake.as_ref()
    }

    /// Transforms points `[V, 3]`. Parts of a wrong shape are left out.
    pub fn apply(&self, points: Tensor<2>) -> Tensor<2> {
        let mut p = self.apply_to_directions(points);
        if let Some(t) = &self.translation {
            p = p + t.clone().reshape([1, 3]);
        }
        p
    }

    /// Transforms directions `[V, 3]`, such as tangents, like differences of points: by scale and rotation.
    pub fn apply_to_directions(&self, directions: Tensor<2>) -> Tensor<2> {
        let mut d = directions;
        if let Some(s) = &self.scale {
            let n = s.dims()[0];
            d = d * s.clone().reshape([1, n]);
        }
        self.rotate(d)
    }

    /// Transforms normals `[V, 3]` by the inverse transpose. Their length changes.
    pub fn apply_to_normals(&self, normals: Tensor<2>) -> Tensor<2> {
        let mut n = normals;
        if let Some(s) = &self.scale {
            let c = s.dims()[0];
            n = n / s.clone().reshape([1, c]);
        }
        self.rotate(n)
    }

    /// Whether the scale turns a mesh inside out.
    pub(super) fn mirrors(&self) -> bool {
        let factors = self.scale.as_ref().map(host_values);
        factors.is_some_and(|f| f.is_ok_and(|f| mirrors(&f)))
    }

    fn rotate(&self, p: Tensor<2>) -> Tensor<2> {
        match &self.rotation {
            Some(r) => {
                // Products are summed explicitly: `matmul` may round to less than f32 on GPUs.
                let n = p.dims()[0];
                let p = p.reshape([n, 1, 3]) * r.clone().reshape([1, 3, 3]);
                p.sum_dim(2).reshape([n, 3])
            }
            None => p,
        }
    }
}

/// Returns whether scaling by one factor, or by one factor per axis, turns a mesh inside out. It does if an odd number
/// of factors is negative.
pub(super) fn mirrors(factors: &[f64]) -> bool {
    factors.iter().filter(|&&s| s < 0.0).count() % 2 == 1
}
