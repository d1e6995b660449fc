//! Poses in the conventions of files, made into camera-to-world matrices in the axes of OpenGL.

use glam::{DMat3, DVec3};

/// Rows of a camera-to-world matrix.
pub(super) type Rows = [[f64; 4]; 3];

/// The relative error of axes that counts as rounding in a file.
const ROUNDING: f64 = 1e-3;

fn rows_of(axes: [DVec3; 3], position: DVec3) -> Rows {
    let [x, y, z] = axes;
    [0, 1, 2].map(|i| [x[i], y[i], z[i], position[i]])
}

/// Makes a pose from the rotation and translation from world to camera, x_camera = R·x_world + t, in the axes of OpenCV
/// (x right, y down, z forward).
pub(super) fn from_opencv(rotation: DMat3, translation: DVec3) -> Rows {
    let to_world = rotation.transpose();
    let axes = [to_world.x_axis, -to_world.y_axis, -to_world.z_axis];
    rows_of(axes, -(to_world * translation))
}

/// Returns the rotation of a quaternion (w, x, y, z) of any length but 0.
pub(super) fn rotation_of([w, x, y, z]: [f64; 4]) -> DMat3 {
    DMat3::from_quat(glam::DQuat::from_xyzw(x, y, z, w).normalize())
}

/// Returns a pose with unit axes, and the length that the axes had. A file may scale a camera: its rays stay the same.
///
/// # Errors
/// A description of what is wrong, for a message that says where.
pub(super) fn with_unit_axes(rows: Rows) -> Result<(Rows, f64), String> {
    if rows.iter().flatten().any(|v| !v.is_finite()) {
        return Err(format!("is {rows:?}, expected finite numbers"));
    }
    let axes = [0, 1, 2].map(|j| DVec3::from([0, 1, 2].map(|i| rows[i][j])));
    let position = DVec3::from([0, 1, 2].map(|i| rows[i][3]));
    let scale = axes.map(DVec3::length).iter().sum::<f64>() / 3.0;
    let [x, y, z] = axes.map(|axis| axis / scale);
    let off = [x, y, z].map(|a| (a.length() - 1.0).abs());
    let angles = [x.dot(y), y.dot(z), z.dot(x)].map(f64::abs);
    let wrong = off
        .into_iter()
        .chain(angles)
        .any(|e| e.is_nan() || e > ROUNDING);
    if scale <= 0.0 || wrong {
        return Err(format!(
            "is {rows:?}, expected columns that are perpendicular and equally long"
        ));
    }
    if x.cross(y).dot(z) < 0.0 {
        return Err(format!(
            "is {rows:?}, a reflection, expected a rotation with right-handed axes"
        ));
    }
    Ok((rows_of([x, y, z], position), scale))
}

/// A projection P = K·[R|t]: K with 1 in its last corner, the rotation and the translation from world to camera.
pub(super) struct Parts {
    pub k: [[f64; 3]; 3],
    pub rotation: DMat3,
    pub translation: DVec3,
}

/// Takes a projection apart by an RQ decomposition: the rows of R are those of P's left part, made perpendicular from the
/// last one upwards. `None` if the left part has no inverse.
pub(super) fn decomposed(p: Rows) -> Option<Parts> {
    let left = p.map(|row| DVec3::new(row[0], row[1], row[2]));
    // P is known up to a factor. Its sign is the one with which R is a rotation.
    let sign = left[0].cross(left[1]).dot(left[2]).signum();
    let [a, b, c] = left.map(|row| row * sign);
    let last = c.length();
    let r3 = c / last;
    let k23 = b.dot(r3);
    let b = b - k23 * r3;
    let r2 = b / b.length();
    let [k12, k13] = [a.dot(r2), a.dot(r3)];
    let a = a - k12 * r2 - k13 * r3;
    let r1 = a / a.length();
    let right = DVec3::from(p.map(|row| row[3] * sign));
    let z = right.z / last;
    let y = (right.y - k23 * z) / b.length();
    let x = (right.x - k12 * y - k13 * z) / a.length();
    let k = [
        [a.length(), k12, k13],
        [0.0, b.length(), k23],
        [0.0, 0.0, last],
    ]
    .map(|row| row.map(|v| v / last));
    let rotation = DMat3::from_cols(r1, r2, r3).transpose();
    let translation = DVec3::new(x, y, z);
    let fine = rotation.is_finite() && translation.is_finite();
    let fine = fine && k.iter().flatten().all(|v| v.is_finite());
    fine.then_some(Parts {
        k,
        rotation,
        translation,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projections_are_put_together_again() {
        let k = DMat3::from_cols_array(&[500.0, 0.0, 0.0, 0.0, 510.0, 0.0, 310.0, 250.0, 1.0]);
        let rotation = rotation_of([0.5, -0.3, 0.8, 0.1]);
        let translation = DVec3::new(0.4, -2.0, 7.0);
        for factor in [1.0, -3.0] {
            let left = k * rotation * factor;
            let right = k * translation * factor;
            let p = [0, 1, 2].map(|i| [left.row(i).x, left.row(i).y, left.row(i).z, right[i]]);
            let parts = decomposed(p).expect("parts");
            assert!(parts.rotation.abs_diff_eq(rotation, 1e-12));
            assert!(parts.translation.abs_diff_eq(translation, 1e-12));
            let back = DMat3::from_cols_array_2d(&parts.k).transpose();
            assert!(back.abs_diff_eq(k, 1e-9));
        }
        assert!(decomposed([[0.0; 4]; 3]).is_none());
    }

    #[test]
    fn axes_are_checked() {
        let unit = [
            [1.0, 0.0, 0.0, 4.0],
            [0.0, 1.0, 0.0, 5.0],
            [0.0, 0.0, 1.0, 6.0],
        ];
        let doubled = unit.map(|[x, y, z, t]| [2.0 * x, 2.0 * y, 2.0 * z, t]);
        assert_eq!(with_unit_axes(doubled), Ok((unit, 2.0)));
        for (i, value, expected) in [
            (0, f64::NAN, "finite"),
            (0, 1.1, "equally long"),
            (1, 0.1, "perpendicular"),
            (0, -1.0, "right-handed"),
        ] {
            let mut wrong = unit;
            wrong[0][i] = value;
            let message = with_unit_axes(wrong).expect_err("an error");
            assert!(message.contains(expected), "{message}");
        }
    }
}
