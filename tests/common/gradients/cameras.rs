//! Cases of cameras.

use softray::prelude::*;

use super::{Case, camera, case, constant, offset, shift, vector, with_lamp};
use crate::common::long;

/// A wide step passes kinks of pixels without a filter, which is 10 % of this derivative; a narrow one takes many seeds.
fn step_of_pose() -> f64 {
    if long() { 0.005 } else { 0.02 }
}

/// Numbers of cameras of every kind.
pub fn cases() -> Vec<Case> {
    let growth = |case: Case| Case {
        weight: |x, y| x * x + y * y,
        ..case
    };
    let sharpness = |case: Case| Case {
        weight: |x, y| (-((x + 0.5).powi(2) + (y - 0.33).powi(2)) / 0.1).exp(),
        ..case
    };
    vec![
        shift(case("camera position", 0.0, 0.02, 0, |d, t, p| {
            let mut c = camera();
            c.eye = offset(p, [0.2, 1.3, 4.2], [1.0, 0.2, 0.3], d, t).into();
            (with_lamp(d, t), c)
        })),
        growth(case("field of view", 38.0, 0.4, 0, |d, t, p| {
            (with_lamp(d, t), camera().with_fov_y(p))
        })),
        shift(case("orbit", 3.0, 0.3, 0, |d, t, p| {
            let elevation = p.clone() * 0.3 + 4.0;
            let distance = p.clone() * (-0.01) + 4.2;
            let c = Camera::orbit([0.0, 0.9, 0.0], distance, p, elevation).expect("a camera");
            // Rolled: an edge along a row of pixels would make a kink that differences step over.
            (with_lamp(d, t), c.with_up([0.3, 1.0, 0.1]).with_fov_y(38.0))
        })),
        Case {
            precision: 0.03,
            ..shift(case("pose matrix", 0.0, step_of_pose(), 0, |d, t, p| {
                let pose = [
                    0.95, -0.3, 0.05, 0.2, 0.3, 0.95, 0.1, 1.3, -0.05, -0.1, 1.0, 4.2, 0.0, 0.0,
                    0.0, 1.0,
                ];
                let change = [
                    0.02, 0.01, 0.01, 1.0, -0.01, 0.02, 0.02, 0.2, 0.01, 0.02, 0.02, 0.3, 0.0, 0.0,
                    0.0, 0.0,
                ];
                let pose = constant(&pose, [4, 4], d, t)
                    + constant(&change, [4, 4], d, t) * p.reshape([1, 1]);
                let c = Camera::from_matrix(pose).expect("a camera");
                (with_lamp(d, t), c.with_fov_y(38.0))
            }))
        },
        growth(case("calibrated camera", 17.0, 0.2, 0, |d, t, p| {
            let f = p.clone().reshape([1, 1]);
            let k = constant(&[0.0, 0.0, 5.6, 0.0, 0.0, 6.5, 0.0, 0.0, 1.0], [3, 3], d, t)
                + constant(
                    &[1.0, 0.0, 0.0, 0.0, 1.05, 0.0, 0.0, 0.0, 0.0],
                    [3, 3],
                    d,
                    t,
                ) * f;
            let down = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
            // The camera moves back with it.
            let away = constant(&[0.0, 0.0, 0.05], [3], d, t) * p;
            let place = constant(&[-0.2, 1.1, 3.4], [3], d, t) + away;
            let c = Camera::from_intrinsics(k, down, place, [12, 12]).expect("a camera");
            (with_lamp(d, t), c)
        })),
        shift(case("principal point", 6.2, 0.1, 0, |d, t, p| {
            let mut c = camera();
            let center = vector(p, [1.0, 0.9, 0.0], d, t).slice([0..2]);
            c.projection = Projection::Intrinsics {
                focal: [17.0, 18.0].into(),
                principal: center.into(),
                size: [12, 12],
            };
            (with_lamp(d, t), c)
        })),
        growth(case("orthographic height", 3.0, 0.04, 1, |d, t, p| {
            (with_lamp(d, t), camera().with_orthographic(p))
        })),
        shift(case("orthographic position", 0.0, 0.02, 0, |d, t, p| {
            let mut c = camera().with_orthographic(3.0);
            c.eye = offset(p, [0.2, 1.3, 4.2], [1.0, 0.2, 0.3], d, t).into();
            (with_lamp(d, t), c)
        })),
        sharpness(case("aperture", 0.25, 0.02, 0, |d, t, p| {
            (with_lamp(d, t), camera().with_thin_lens(p, 1.7))
        })),
        sharpness(case("focus distance", 1.7, 0.05, 0, |d, t, p| {
            (with_lamp(d, t), camera().with_thin_lens(0.25, p))
        })),
    ]
}
