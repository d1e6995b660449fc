//! Properties that hold for atlases of random meshes.

use glam::{DVec2, DVec3};
use proptest::prelude::*;

use super::meshes::{Mesh, noisy_ball, torus};
use super::{assert_valid, spread};
use crate::atlas::overlap::any_cross;
use crate::atlas::{Atlas, AtlasOptions, NearestFaces};

/// Any triangles between random points: most have edges of many faces, and some no area.
fn soup() -> impl Strategy<Value = Mesh> {
    let coordinate = prop_oneof![Just(0.0), -1.0..1.0f64];
    let positions = prop::collection::vec(prop::array::uniform3(coordinate), 4..12);
    positions.prop_flat_map(|positions| {
        let index = 0..positions.len() as u32;
        let faces = prop::collection::vec(prop::array::uniform3(index), 1..16);
        (Just(positions), faces)
    })
}

fn mesh() -> impl Strategy<Value = Mesh> {
    prop_oneof![
        (0..4usize, 0.0..0.3).prop_map(|(levels, noise)| noisy_ball(levels, noise)),
        (3..24u32, 3..16u32, 0.0..0.3).prop_map(|(a, b, bumps)| torus(a, b, bumps)),
        soup(),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn atlases_are_valid(mesh in mesh(), size in 32..300usize, gutter in 2..7usize, angle in 20.0..75.0) {
        let options = AtlasOptions { gutter, max_angle: angle };
        match Atlas::new(&mesh.0, &mesh.1, size, &options) {
            Ok(atlas) => assert_valid(&atlas, &mesh),
            Err(error) => prop_assert!(error.to_string().contains("for"), "{error}"),
        }
    }

    #[test]
    fn crossings_are_found(corners in prop::array::uniform6(prop::array::uniform2(-1.0..1.0f64))) {
        let points = corners.map(DVec2::from);
        let turned = |[a, b, c]: [DVec2; 3]| match (b - a).perp_dot(c - a) > 0.0 {
            true => [a, b, c],
            false => [a, c, b],
        };
        let (a, b) = (turned([points[0], points[1], points[2]]), turned([points[3], points[4], points[5]]));
        let inside = |t: [DVec2; 3], p: DVec2| {
            (0..3).all(|i| (t[(i + 1) % 3] - t[i]).perp_dot(p - t[i]) > 1e-9)
        };
        let sample = |t: [DVec2; 3], k| {
            let w = spread(k);
            t[0] * w[0] + t[1] * w[1] + t[2] * w[2]
        };
        let common = (0..200).any(|k| inside(a, sample(b, k)) || inside(b, sample(a, k)));
        prop_assert!(!common || any_cross(&[a, b]));
        // Far apart.
        prop_assert!(!any_cross(&[a, b.map(|p| p + DVec2::splat(2.5))]));
    }

    #[test]
    fn nearest_points_are_nearest(mesh in soup(), point in prop::array::uniform3(-2.0..2.0f64)) {
        let tree = NearestFaces::new(&mesh.0, &mesh.1).expect("a tree");
        let nearest = tree.nearest(point);
        let at = |f: u32, w: [f64; 3]| super::point(&mesh, f, w).distance(DVec3::from(point));
        prop_assert!((at(nearest.face, nearest.barycentric) - nearest.distance).abs() < 1e-9);
        prop_assert!(nearest.barycentric.iter().all(|b| (-1e-12..=1.0 + 1e-12).contains(b)));
        for f in 0..mesh.1.len() as u32 {
            for k in 0..50 {
                prop_assert!(at(f, spread(k)) >= nearest.distance - 1e-9);
            }
        }
    }
}
