//! Cameras of photographs that an asset was not fitted to.

use crate::common::errors::{message, says};
use crate::common::tensors::values;
use softray::meshing::{HullOptions, TriangleMesh, renew};
use softray::modules::{AssetLevel, AssetParams};
use softray::photographs::{ObjectPhotographs, PhotographOptions};
use softray::prelude::*;

/// If the cameras of photographs were turned by a known angle, turn and shift move the image back by it, beside a fit of the
/// cameras that were not. Nothing else moves.
#[test]
fn held_out_cameras_are_found() {
    const ANGLE: f64 = 0.003;
    let options = PhotographOptions::new().with_longest_side(24);
    let set = ObjectPhotographs::open("tests/data/photographs", 8, options).expect("a set");
    let hull = set.visual_hull(&HullOptions::default().with_resolution(32));
    let level = AssetLevel::new(&set.train, 24).expect("a level");
    let mesh = renew(&hull.expect("a hull"), level.edge()).expect("a mesh");
    let asset = level.begin(&mesh, true, &Device::flex()).expect("a start");
    let turns = |angle: f64| -> Vec<f64> {
        let mut held = set.held_out.clone();
        for row in held.iter_mut().flat_map(|p| &mut p.camera.to_world) {
            let [right, backward] = [row[0], row[2]];
            (row[0], row[2]) = (right + angle * backward, backward - angle * right);
        }
        let level = AssetLevel::new(&held, 24).expect("a level");
        let found = level.register(&asset, 60).expect("cameras");
        let known = |asset: &AssetParams| {
            let vertices = values(&asset.object.mesh.vertices.val());
            (vertices, values(&asset.sky.log_radiance.val()))
        };
        assert_eq!(known(&asset), known(&found));
        let cameras = found.viewpoints.expect("corrections");
        let moves = values(&(cameras.turns.val() + cameras.shifts.val()));
        let mut angles: Vec<_> = moves.chunks(3).map(|m| m[0].hypot(m[1])).collect();
        angles.sort_by(f64::total_cmp);
        let median = cameras.median_move().expect("an angle").to_radians();
        assert!((median.tan() - angles[angles.len() / 2]).abs() < 1e-6);
        moves.into_iter().step_by(3).collect()
    };
    let pairs: Vec<_> = turns(0.0).into_iter().zip(turns(ANGLE)).collect();
    let back = pairs.iter().map(|(a, b)| a - b).sum::<f64>() / pairs.len() as f64;
    assert!(
        (back / ANGLE - 1.0).abs() < 0.3,
        "{back} of {ANGLE}: {pairs:?}"
    );
}

/// Corrections of 0 change nothing, in both kinds of light, and the common factor of the focal lengths is also that of
/// photographs without corrections.
#[test]
fn corrected_cameras_have_the_intrinsics_of_their_photographs() {
    let options = PhotographOptions::new().with_longest_side(16);
    let set = ObjectPhotographs::open("tests/data/photographs", 8, options).expect("a set");
    let ball = TriangleMesh::try_from(&shapes::icosphere(1, &Device::flex())).expect("a ball");
    let device = Device::flex().autodiff();
    for stands in [true, false] {
        let start = AssetParams::from_photographs(&set.train, &ball, 0.2, stands, &device);
        let (start, view) = (start.expect("a start"), &set.train[3]);
        let camera = |asset: &AssetParams, index| -> softray::Result<([f64; 3], f64)> {
            let (object, sky) = (asset.object.object()?, asset.sky.environment());
            let (_, camera) = asset.view(&object, &sky, view, index)?;
            let Projection::Intrinsics { focal, .. } = &camera.projection else {
                panic!("{:?}", camera.projection);
            };
            Ok((camera.eye.values()?, focal.values()?[0]))
        };
        let given = camera(&start, None).expect("a camera");
        let mut asset = start.with_viewpoints(&set.train).expect("corrections");
        let same = camera(&asset, Some(3)).expect("a camera");
        let off = given.0.iter().zip(same.0).map(|(a, b)| (a - b).abs());
        assert!(off.fold(0.0, f64::max) < 1e-5 && (given.1 - same.1).abs() < 1e-4);
        let viewpoints = asset.viewpoints.as_mut().expect("corrections");
        viewpoints.log_focal = viewpoints.log_focal.clone().map(|x| (x + 0.1).detach());
        for index in [None, Some(3)] {
            let longer = camera(&asset, index).expect("a camera").1 / given.1;
            assert!((longer - 0.1f64.exp()).abs() < 1e-4, "{longer}");
        }
        let few = RenderOptions::new(1, 1).with_samples(1).with_bounces(0);
        let error = asset.compare(&set.held_out, &few, true).map(|_| ());
        says(message(error), ["asset", "photographs", "5", "35"]);
    }
}

/// A mask that lacks a half of the object does not cut it off.
#[test]
fn a_mask_that_is_cut_does_not_cut_the_hull() {
    let options = PhotographOptions::new().with_longest_side(40);
    let set = ObjectPhotographs::open("tests/data/photographs", 8, options).expect("a set");
    let carve = |set: &ObjectPhotographs| {
        let hull = set.visual_hull(&HullOptions::default().with_resolution(32));
        hull.expect("a hull").volume()
    };
    let mut cut = set.clone();
    let half = cut.train[0].mask.len() / 2;
    cut.train[0].mask[..half].fill(0.0);
    let ratio = carve(&cut) / carve(&set);
    assert!((0.95..1.2).contains(&ratio), "{ratio}");
}
