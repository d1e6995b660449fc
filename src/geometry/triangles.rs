//! Triangles as planes, each with a frame.

use burn::tensor::{Bool, Tensor};

use super::context::{Context, detached};
use super::vec3::Vec3;

/// Data of the triangles' corners: three vectors of planes `[T, 1]`.
#[derive(Clone, Debug)]
pub struct VertexData {
    pub a: Vec3,
    pub b: Vec3,
    pub c: Vec3,
}

/// The triangles of a scene, flattened. Every plane is a column `[T, 1]`. Positions are relative to the center of the
/// scene's normalization, in units of about its radius.
///
/// Each triangle has an orthonormal frame in its plane, with corner a at the origin, b at `(base, 0)` and c at
/// `(apex_u, apex_v)`, `apex_v > 0`.
#[derive(Clone, Debug)]
pub struct Triangles {
    /// Corners. Degenerate triangles are replaced by a unit triangle, to avoid division by zero.
    pub corners: VertexData,
    /// Unit normal of the front, on which the corners run counter-clockwise.
    pub normal: Vec3,
    /// Unit vector from a towards b.
    pub u: Vec3,
    /// normal × u.
    pub v: Vec3,
    /// normal · a.
    pub plane: Tensor<2>,
    /// u · a.
    pub a_u: Tensor<2>,
    /// v · a.
    pub a_v: Tensor<2>,
    /// |b − a|.
    pub base: Tensor<2>,
    /// u · (c − a).
    pub apex_u: Tensor<2>,
    /// v · (c − a).
    pub apex_v: Tensor<2>,
    /// Area; 0 for degenerate triangles.
    pub area: Tensor<2>,
    /// Whether the triangle has area.
    pub valid: Tensor<2, Bool>,
    /// Linear velocity over the shutter, if any object moves.
    pub velocity: Option<Vec3>,
}

impl Triangles {
    /// Computes frames and planes from corners (columns `[T, 1]`, relative to the center of the normalization).
    pub fn new(context: &Context, corners: VertexData, velocity: Option<Vec3>) -> Self {
        let VertexData { a, b, c } = corners;
        let (ab, ac) = (detached_sub(&b, &a), detached_sub(&c, &a));
        let n = ab.cross(&ac);
        let doubled_area = n.dot(&n).sqrt();
        let longest = ab.dot(&ab).max_pair(ac.dot(&ac));
        let valid = doubled_area.greater(longest * (4.0 * context.epsilon()));
        let invalid = valid.clone().bool_not();
        let any_invalid = invalid.clone().any().into_scalar::<bool>();
        let sanitise = |p: Vec3, unit: [f64; 3]| {
            if !any_invalid {
                return p;
            }
            let fill = |x: Tensor<2>, value: f64| x.mask_fill(invalid.clone(), value);
            Vec3::new(fill(p.x, unit[0]), fill(p.y, unit[1]), fill(p.z, unit[2]))
        };
        let a = sanitise(a, [0.0, 0.0, 0.0]);
        let b = sanitise(b, [1.0, 0.0, 0.0]);
        let c = sanitise(c, [0.0, 1.0, 0.0]);

        let (ab, ac) = (b.sub(&a), c.sub(&a));
        let n = ab.cross(&ac);
        let doubled_area = n.dot(&n).sqrt();
        let normal = n.map(|x| x / doubled_area.clone());
        let base = ab.dot(&ab).sqrt();
        let u = ab.map(|x| x / base.clone());
        let v = normal.cross(&u);
        Self {
            plane: normal.dot(&a),
            a_u: u.dot(&a),
            a_v: v.dot(&a),
            apex_u: u.dot(&ac),
            apex_v: doubled_area.clone() / base.clone(),
            // An emitter without area emits no light.
            area: if any_invalid {
                (doubled_area * 0.5).mask_fill(invalid, 0.0)
            } else {
                doubled_area * 0.5
            },
            corners: VertexData { a, b, c },
            normal,
            u,
            v,
            base,
            valid,
            velocity,
        }
    }

    pub fn len(&self) -> usize {
        self.base.dims()[0]
    }
}

fn detached_sub(a: &Vec3, b: &Vec3) -> Vec3 {
    a.detached().sub(&b.detached())
}

/// The point of a triangle's border that is nearest to a point in its plane, without tape.
#[derive(Clone, Debug)]
pub struct Nearest {
    /// Squared distance from the point to the border.
    pub squared_distance: Tensor<2>,
    /// Whether the point is inside of the triangle.
    pub inside: Tensor<2, Bool>,
    pub weight_b: Tensor<2>,
    pub weight_c: Tensor<2>,
}

/// Returns the nearest points on the three edges to the points `(x, y)` in the triangles' frames, for pairs `[T, N]` or
/// for drawn triangles `[1, N]`. Arguments and results have no tape: the squared distance at a fixed nearest point has
/// the right derivative (envelope theorem).
pub(crate) fn nearest_on_triangle(
    x: &Tensor<2>,
    y: &Tensor<2>,
    base: &Tensor<2>,
    apex_u: &Tensor<2>,
    apex_v: &Tensor<2>,
) -> Nearest {
    let (base, apex_u, apex_v) = (detached(base), detached(apex_u), detached(apex_v));
    let square = |u: Tensor<2>, v: Tensor<2>| u.clone() * u + v.clone() * v;
    // a → b
    let s_ab = (x.clone() * base.clone().recip()).clamp(0.0, 1.0);
    let d_ab = square(x.clone() - s_ab.clone() * base.clone(), y.clone());
    // c → b, so that the parameter is the weight of b
    let (f_u, f_v) = (apex_u.clone() - base.clone(), apex_v.clone());
    let inverse = square(f_u.clone(), f_v.clone()).recip();
    let x_b = x.clone() - base;
    let s_bc = (x_b.clone() * (f_u.clone() * inverse.clone())
        + y.clone() * (f_v.clone() * inverse))
        .clamp(0.0, 1.0);
    let d_bc = square(
        x_b.clone() - s_bc.clone() * f_u.clone(),
        y.clone() - s_bc.clone() * f_v.clone(),
    );
    // a → c
    let inverse = square(apex_u.clone(), apex_v.clone()).recip();
    let s_ac = (x.clone() * (apex_u.clone() * inverse.clone())
        + y.clone() * (apex_v.clone() * inverse))
        .clamp(0.0, 1.0);
    let d_ac = square(
        x.clone() - s_ac.clone() * apex_u.clone(),
        y.clone() - s_ac.clone() * apex_v.clone(),
    );
    let inside = y
        .clone()
        .greater_equal_elem(0.0)
        .bool_and((f_u * y.clone()).greater_equal(f_v * x_b))
        .bool_and((apex_v * x.clone()).greater_equal(apex_u * y.clone()));
    let on_bc = d_bc.clone().lower(d_ab.clone());
    let least = d_ab.min_pair(d_bc);
    let on_ac = d_ac.clone().lower(least.clone());
    let weight_b = s_ab
        .mask_where(on_bc.clone(), s_bc.clone().neg().add_scalar(1.0))
        .mask_fill(on_ac.clone(), 0.0);
    let weight_c = s_bc
        .mask_fill(on_bc.bool_not(), 0.0)
        .mask_where(on_ac, s_ac);
    Nearest {
        squared_distance: least.min_pair(d_ac),
        inside,
        weight_b,
        weight_c,
    }
}
