//! Distortion, levels and windows of loaded photographs, and regions.

use glam::DVec3;
use serde_json::json;

use super::loading::{IntoRgba, assert_near, folder_with, linear, load, set};
use super::{Folder, SIZE, cameras, sets};
use crate::photographs::{Distortion, PhotographOptions, Photographs, Region, ViewCamera, Window};

#[test]
fn distortion_is_undone() {
    let lens = Distortion::Radial {
        numerator: [-0.25, 0.05, 0.0, 0.0],
        denominator: [0.0; 3],
        tangential: [0.004, -0.003],
    };
    let camera = ViewCamera {
        focal: [150.0, 155.0],
        principal: [98.0, 77.0],
        size: [200, 150],
        distortion: lens,
        ..cameras([1.0; 2], [0.0; 2])[0]
    };
    // What the lens shows of a smooth function of the direction.
    let seen = |[x, y]: [f64; 2]| 0.5 + 0.3 * (4.0 * x).sin() * (5.0 * y).cos();
    let byte = |x: u32, y: u32| {
        let shown = [
            (f64::from(x) + 0.5 - 98.0) / 150.0,
            (f64::from(y) + 0.5 - 77.0) / 155.0,
        ];
        let value = seen(lens.undistort(shown).expect("a direction")) as f32;
        (0..=255u8).min_by(|a, b| {
            (linear(*a) - value)
                .abs()
                .total_cmp(&(linear(*b) - value).abs())
        })
    };
    let folder = Folder::new();
    folder.image("images/000.png", [200, 150], |x, y| {
        [byte(x, y).expect("a byte"); 3].into_rgba()
    });
    let more = json!({"k1": -0.25, "k2": 0.05, "p1": 0.004, "p2": -0.003});
    sets::nerfstudio(&folder, &[camera], &more);
    let set = Photographs::open(&folder).expect("a set");
    for (longest, tolerance) in [(200, 0.006), (100, 0.006), (50, 0.012)] {
        let options = PhotographOptions::new().with_longest_side(longest);
        let photo = &load(&set, &options).photographs[0];
        assert!(photo.camera.distortion.is_none() && photo.camera.to_camera().is_ok());
        let (c, mut inside) = (photo.camera, 0);
        for i in 0..photo.weight.len() {
            let pixel = [(i % c.size[0]) as f64 + 0.5, (i / c.size[0]) as f64 + 0.5];
            let direction = [0, 1].map(|a| (pixel[a] - c.principal[a]) / c.focal[a]);
            if photo.weight[i] == 1.0 {
                inside += 1;
                let error = (f64::from(photo.color.pixels[3 * i]) - seen(direction)).abs();
                assert!(error < tolerance, "{pixel:?}: {error}");
            }
        }
        // This lens shows more than the pinhole, so few pixels look outside.
        assert!(inside * 10 > 9 * photo.weight.len());
    }
    assert!(set.views[0].camera.to_camera().is_err());
}

#[test]
fn pixels_outside_of_the_photograph_have_no_weight() {
    let folder = folder_with([40, 30], |_, _| [255; 4]);
    sets::nerfstudio(
        &folder,
        &cameras([50.0, 50.0], [20.0, 15.0]),
        &json!({"k1": 0.5}),
    );
    let set = Photographs::open(&folder).expect("a set");
    let photo = &load(&set, &PhotographOptions::new()).photographs[0];
    assert_eq!((photo.weight[0], photo.weight[15 * 40 + 20]), (0.0, 1.0));
    assert_eq!(photo.color.pixels[0], 0.0);
    let small = photo.shrunk(10).expect("a photograph");
    let partial = |w: &&f32| **w > 0.0 && **w < 1.0;
    assert!(small.weight.iter().any(|w| partial(&w)));
    // Colors are those of the pixels that are seen.
    let seen = small.weight.iter().zip(small.color.pixels.chunks(3));
    seen.filter(|(w, _)| **w > 0.0)
        .for_each(|(_, c)| assert_near(c[0], 1.0));
}

#[test]
fn levels_and_windows_keep_their_rays() {
    let folder = folder_with([40, 30], |x, y| [(x * 6) as u8, (y * 8) as u8, 0, 255]);
    let set = set(&folder);
    let photo = &load(&set, &PhotographOptions::new()).photographs[0];
    let levels = photo.levels(10).expect("levels");
    let sizes: Vec<_> = levels.iter().map(|level| level.camera.size).collect();
    assert_eq!(sizes, [[10, 8], [20, 15], [40, 30]]);
    assert_eq!(&levels[2], photo);
    let window = Window {
        start: [7, 4],
        size: [5, 6],
    };
    let part = photo.cropped(window).expect("a part");
    assert_eq!(
        part.color.pixels[..3],
        photo.color.pixels[3 * (4 * 40 + 7)..][..3]
    );
    assert_eq!(part.camera.ray([1.5, 2.5]), photo.camera.ray([8.5, 6.5]));
    let outside = Window {
        start: [36, 0],
        size: [5, 6],
    };
    assert!(photo.cropped(outside).is_err());
}

#[test]
fn masks_meet_at_the_object() {
    let center = DVec3::new(0.25, -0.1, 0.3);
    let folder = Folder::new();
    let set_cameras = cameras([50.0; 2], [20.0, 15.0]);
    for (i, camera) in set_cameras.iter().enumerate() {
        folder.image(
            &format!("images/{i:03}.png"),
            SIZE.map(|n| n as u32),
            |x, y| {
                let (eye, d) = camera
                    .ray([f64::from(x) + 0.5, f64::from(y) + 0.5])
                    .expect("a ray");
                let offset = center - DVec3::from(eye);
                let inside = offset.cross(DVec3::from(d)).length() < 0.5;
                [200, 200, 200, if inside { 255 } else { 0 }]
            },
        );
    }
    sets::nerfstudio(&folder, &set_cameras, &json!({}));
    let set = Photographs::open(&folder).expect("a set");
    let region = Region::of_masks(&load(&set, &PhotographOptions::new()).photographs);
    let region = region.expect("a region");
    assert!(center.distance(region.center.into()) < 0.03, "{region:?}");
    assert!((0.45..0.56).contains(&region.radius), "{region:?}");
    // The cameras look at (0.2, −0.1, 0.3).
    let seen = set.region().expect("a region");
    assert!(DVec3::new(0.2, -0.1, 0.3).distance(seen.center.into()) < 1e-9);
    let error = Region::of_cameras(&[set.views[0].camera; 2]).expect_err("one direction");
    assert!(error.to_string().contains("different directions"));
    let points = Region::of_points(&sets::POINTS).expect("a region");
    assert_eq!(points.low, [0.25, -1.0, -3.0]);
}

#[test]
fn cameras_project_points_along_their_rays() {
    let mut camera = cameras([50.0, 53.0], [18.0, 16.0])[1];
    camera.distortion = Distortion::Radial {
        numerator: [0.1, 0.02, 0.0, 0.0],
        denominator: [0.0; 3],
        tangential: [0.001, 0.002],
    };
    let (eye, direction) = camera.ray([7.25, 21.5]).expect("a ray");
    let point = [0, 1, 2].map(|i| eye[i] + 3.0 * direction[i]);
    let [x, y] = camera.project(point).expect("a pixel");
    assert!((x - 7.25).abs() < 1e-9 && (y - 21.5).abs() < 1e-9);
    let behind = [0, 1, 2].map(|i| eye[i] - direction[i]);
    assert!(camera.project(behind).is_none());
}

#[test]
fn cameras_of_renders_have_the_axes() {
    let view = cameras([50.0, 53.0], [18.0, 16.0])[0];
    let camera = view.to_camera().expect("a camera");
    let values = [&camera.eye, &camera.target, &camera.up].map(|p| p.values().expect("values"));
    let [eye, target, up] = values.map(DVec3::from);
    assert_eq!(eye.to_array(), view.position());
    let right = (target - eye).cross(up);
    for i in 0..3 {
        assert!((right[i] - view.to_world[i][0]).abs() < 1e-12);
        assert!((up[i] - view.to_world[i][1]).abs() < 1e-12);
    }
}
