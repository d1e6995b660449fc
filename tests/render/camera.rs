//! Cameras from matrices, calibrations, orbits and scenes; parallel projection; views that nobody chose.

use crate::common;
use crate::common::errors::{message, says};
use crate::common::numbers::mean;
use crate::common::scenes::{diffuse, facing_front, lamp, under_sky};
use crate::common::tensors::{gradient, leaf, radiance};
use crate::common::{reference, values};
use softray::prelude::*;

/// A cube beside a ball on a floor, so that no two directions look alike.
fn scene(device: &Device) -> Scene {
    let [floor, _] = common::gradients::floor_and_light(device);
    let ball = shapes::icosphere(1, device);
    let ball = ball.scaled(Tensor::from_floats([0.5], device));
    let ball = ball.translated(Tensor::from_floats([0.6, 0.5, 0.2], device));
    let cube = shapes::cube(device).scaled(Tensor::from_floats([0.3, 0.6, 0.4], device));
    let cube = cube.translated(Tensor::from_floats([-0.6, 0.6, 0.0], device));
    Scene::new()
        .with_object(diffuse(floor, [0.4, 0.3, 0.2]))
        .with_object(diffuse(ball, [0.2, 0.3, 0.8]))
        .with_object(diffuse(cube, [0.8, 0.3, 0.2]))
        .with_environment([0.8, 0.9, 1.0])
}

fn image(camera: &Camera, options: &RenderOptions) -> Vec<f64> {
    let scene = scene(&Device::flex());
    radiance(&scene, camera, options)
}

fn options() -> RenderOptions {
    RenderOptions::new(24, 16).with_samples(16).with_bounces(0)
}

#[track_caller]
fn same(a: &Camera, b: &Camera) {
    let (a, b) = (image(a, &options()), image(b, &options()));
    let apart: Vec<f64> = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).collect();
    let apart = mean(&apart);
    assert!(apart < 1e-4, "{apart}");
}

/// From camera to world: right, up, backward and the position.
fn pose_of(eye: glam::DVec3, target: glam::DVec3) -> glam::DMat4 {
    let backward = (eye - target).normalize();
    let right = glam::DVec3::Y.cross(backward).normalize();
    let up = backward.cross(right);
    glam::DMat4::from_cols(
        right.extend(0.0),
        up.extend(0.0),
        backward.extend(0.0),
        eye.extend(1.0),
    )
}

#[test]
fn a_matrix_is_a_pose() {
    let (eye, target) = (glam::dvec3(1.0, 2.0, 4.0), glam::dvec3(0.1, 0.4, 0.0));
    let wanted = Camera::look_at(eye, target).with_fov_y(35.0);
    let pose = pose_of(eye, target);
    let from_numbers = Camera::from_matrix(pose)
        .expect("a camera")
        .with_fov_y(35.0);
    same(&wanted, &from_numbers);
    let flat: Vec<f64> = pose.transpose().to_cols_array().to_vec();
    let tensor = Tensor::<1>::from_data(flat.as_slice(), &Device::flex());
    let from_tensor = Camera::from_matrix(tensor.reshape([4, 4])).expect("a camera");
    same(&wanted, &from_tensor.with_fov_y(35.0));
}

#[test]
fn a_calibration_is_a_camera() {
    let (eye, target) = (glam::dvec3(1.0, 2.0, 4.0), glam::dvec3(0.1, 0.4, 0.0));
    let wanted = Camera::look_at(eye, target).with_fov_y(35.0);
    // To OpenCV's axes: y down, z forward.
    let view = pose_of(eye, target).inverse();
    let turned = glam::DMat4::from_scale(glam::dvec3(1.0, -1.0, -1.0)) * view;
    let rotation = glam::DMat3::from_mat4(turned);
    let translation = turned.w_axis.truncate();
    let focal = 8.0 / 17.5f64.to_radians().tan();
    let k = |cx: f64, cy: f64| [[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]];
    let camera = |k| Camera::from_intrinsics(k, rotation, translation, [24, 16]).expect("one");
    same(&wanted, &camera(k(12.0, 8.0)));
    // A principal point 4 pixels further right and 3 up shows the same, moved by as much.
    let fixed = options()
        .with_sampling(Sampling::default())
        .with_samples(64);
    let centerd = image(&camera(k(12.0, 8.0)), &fixed);
    let moved = image(&camera(k(16.0, 5.0)), &fixed);
    let at = |i: &[f64], x: usize, y: usize| i[3 * (24 * y + x)];
    let mut apart = 0.0;
    for y in 0..13 {
        for x in 4..24 {
            apart += (at(&moved, x, y) - at(&centerd, x - 4, y + 3)).abs();
        }
    }
    assert!(apart / (13.0 * 20.0) < 0.01, "{apart}");
    // All of it as tensors is the same camera.
    let device = Device::flex();
    let tensor = |m: [[f64; 3]; 3]| {
        let flat: Vec<f64> = m.iter().flatten().copied().collect();
        Tensor::<1>::from_data(flat.as_slice(), &device).reshape([3, 3])
    };
    let r = rotation.transpose().to_cols_array_2d();
    let t = Tensor::<1>::from_data(translation.to_array().as_slice(), &device);
    let of_tensors = Camera::from_intrinsics(tensor(k(12.0, 8.0)), tensor(r), t, [24, 16]);
    same(&wanted, &of_tensors.expect("a camera"));
}

#[test]
fn orbits_go_round() {
    let around = |azimuth: f64, elevation: f64| {
        let camera = Camera::orbit([1.0, 2.0, 3.0], 2.0, azimuth, elevation).expect("a camera");
        let eye = camera.eye.values().expect("numbers");
        [eye[0] - 1.0, eye[1] - 2.0, eye[2] - 3.0]
    };
    let near = |a: [f64; 3], b: [f64; 3]| {
        let apart = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f64>();
        assert!(apart < 1e-9, "{a:?} {b:?}");
    };
    near(around(0.0, 0.0), [0.0, 0.0, 2.0]);
    near(around(90.0, 0.0), [2.0, 0.0, 0.0]);
    near(around(-90.0, 30.0), [-(3f64.sqrt()), 1.0, 0.0]);
    let device = Device::flex();
    let turn = Tensor::from_floats([40.0], &device);
    let of_tensor = Camera::orbit([0.0, 0.5, 0.0], 4.0, turn, 25.0).expect("a camera");
    same(
        &Camera::orbit([0.0, 0.5, 0.0], 4.0, 40.0, 25.0).expect("a camera"),
        &of_tensor,
    );
}

#[test]
fn parallel_rays_keep_sizes() {
    let device = Device::flex();
    let quad = facing_front([-0.5, 0.5], [-0.5, 0.5], 0.0, &device);
    let scene = under_sky(quad);
    let options = RenderOptions::new(32, 16)
        .with_samples(16)
        .with_bounces(0)
        .with_opacity()
        .with_depth();
    for distance in [1.0, 5.0, 50.0] {
        let camera = Camera::look_at([0.0, 0.0, distance], [0.0; 3]).with_orthographic(2.0);
        let image = render(&scene, &camera, &options).expect("an image");
        let opacity = values(&image.opacity.expect("it"));
        let depth = values(&image.depth.expect("it"));
        // 1 × 1 in a film of 4 × 2.
        let covered = mean(&opacity);
        assert!((covered - 0.125).abs() < 1e-3, "{covered}");
        let middle = depth[8 * 32 + 16];
        assert!((middle - distance).abs() < 1e-4 * distance, "{middle}");
        // The corner of the quad is no further away.
        assert!((depth[5 * 32 + 13] - distance).abs() < 1e-4 * distance);
    }
    // What is behind the plane of the eye is not seen.
    let camera = Camera::look_at([0.0, 0.0, -1.0], [0.0, 0.0, -2.0]).with_orthographic(2.0);
    let image = render(&scene, &camera, &options).expect("an image");
    let opacity = values(&image.opacity.expect("it"));
    assert!(opacity.iter().all(|&o| o == 0.0));
    let lens = Camera::look_at([0.0, 0.0, 2.0], [0.0; 3])
        .with_orthographic(2.0)
        .with_thin_lens(0.1, 2.0);
    let error = render(&scene, &lens, &options).expect_err("a lens");
    assert!(error.to_string().contains("parallel rays"), "{error}");
}

/// A wall across the view is everywhere as far along the axis, and further along slanted rays.
#[test]
fn depth_along_the_axis() {
    let device = Device::flex();
    let wall = shapes::plane_grid(40.0, 40.0, 1, 1, &device);
    let scene = under_sky(wall);
    let camera = Camera::look_at([0.0, 3.0, 0.0], [0.0; 3])
        .with_up([0.0, 0.0, -1.0])
        .with_fov_y(60.0);
    let options = RenderOptions::new(24, 16)
        .with_samples(16)
        .with_bounces(0)
        .with_depth();
    let depth = render(&scene, &camera, &options).expect("an image").depth;
    let depth = depth.expect("it");
    let corner = values(&depth)[0];
    assert!(corner > 3.5, "{corner}");
    for z in values(&camera.axial_depth(depth).expect("depths")) {
        assert!((z - 3.0).abs() < 0.01, "{z}");
    }
}

#[test]
fn framing_has_all_in_view_and_no_more() {
    let device = Device::flex();
    for size in [1e-3, 1.0, 1e4] {
        let scale = Tensor::from_floats([size as f32], &device);
        let scene = under_sky(shapes::icosphere(2, &device).scaled(scale));
        for direction in [[0.0, 0.0, 1.0], [0.0, 5.0, 0.0], [-2.0, -1.0, 0.5]] {
            let camera = Camera::framing(&scene, direction).expect("a camera");
            let options = RenderOptions::new(64, 64).with_samples(4).with_bounces(0);
            let image = render(&scene, &camera, &options.with_opacity()).expect("an image");
            let opacity = values(&image.opacity.expect("it"));
            let on_border = |i: &usize| {
                let (x, y) = (i % 64, i / 64);
                x == 0 || y == 0 || x == 63 || y == 63
            };
            let border: f64 = (0..4096).filter(on_border).map(|i| opacity[i]).sum();
            assert_eq!(border, 0.0, "{size} {direction:?}");
            let covered = mean(&opacity);
            assert!(
                (0.5..0.8).contains(&covered),
                "{size} {direction:?} {covered}"
            );
        }
    }
    let gone = Camera::framing(&Scene::new(), [0.0, 0.0, 1.0]).expect_err("an empty scene");
    assert!(gone.to_string().contains("no objects"), "{gone}");
    let direction = leaf(&[1.0, 0.5, 2.0], &device);
    let scene = scene(&device);
    let camera = Camera::framing(&scene, direction.clone()).expect("a camera");
    let image = render(&scene, &camera, &options()).expect("an image");
    let gradients = image.radiance.powf_scalar(2.0).mean().backward();
    let gradient = gradient(&direction, &gradients);
    // Only where the direction points matters.
    let along = gradient[0] + 0.5 * gradient[1] + 2.0 * gradient[2];
    let size = gradient.iter().map(|g| g.abs()).fold(0.0, f64::max);
    assert!(size > 1e-4 && along.abs() < 1e-3 * size, "{gradient:?}");
}

/// The Cornell box is open towards −z; a box without an opening is seen from inside.
#[test]
fn an_overview_looks_in_where_a_scene_is_open() {
    let device = Device::flex();
    let cornell = Scene::load(reference("cornell/cornell.obj"), &device).expect("a scene");
    let camera = overview(&cornell).expect("a camera");
    let eye = camera.eye.values().expect("numbers");
    assert!(eye[2] < -1.0, "{eye:?}");
    let options = RenderOptions::new(24, 24).with_samples(16).with_bounces(2);
    let brightness = |scene: &Scene, camera: &Camera| {
        let pixels = radiance(scene, camera, &options);
        pixels.iter().filter(|&&v| v > 0.02).count() as f64 / pixels.len() as f64
    };
    assert!(brightness(&cornell, &camera) > 0.5);
    let room = Scene::new().with_object(Object::new(shapes::cube(&device)));
    let room = room.with_object(lamp(0.3, 0.9, [5.0; 3], &device));
    let camera = overview(&room).expect("a camera");
    assert!(brightness(&room, &camera) > 0.9);
    // An object under a sky is seen from the front, a little above.
    let eye = overview(&scene(&device)).expect("a camera").eye;
    let eye = eye.values().expect("numbers");
    assert!(eye[2] > 1.0 && eye[1] > 0.5, "{eye:?}");
}

#[test]
fn mistakes_are_named() {
    let no_camera = |result: softray::Result<Camera>, word: &str| {
        says(message(result), [word]);
    };
    let mut pose = [[0.0; 4]; 4];
    for (i, row) in pose.iter_mut().enumerate() {
        row[i] = 1.0;
    }
    // As for row vectors.
    pose[3] = [1.0, 2.0, 3.0, 1.0];
    no_camera(Camera::from_matrix(pose), "last column");
    pose[3] = [0.0, 0.0, 0.0, 1.0];
    pose[0][0] = -1.0;
    no_camera(Camera::from_matrix(pose), "right-handed");
    let flat = Tensor::<2>::zeros([3, 4], &Device::flex());
    no_camera(Camera::from_matrix(flat), "shape [4, 4]");
    no_camera(Camera::orbit([0.0; 3], -1.0, 0.0, 0.0), "distance");
    no_camera(Camera::orbit([0.0; 3], 1.0, 0.0, 90.0), "elevation");
    let target = Tensor::<1>::zeros([2], &Device::flex());
    no_camera(Camera::orbit(target, 1.0, 0.0, 0.0), "shape [3]");
    let k = [[10.0, 0.0, 5.0], [0.0, 10.0, 5.0], [0.0, 0.0, 1.0]];
    let turn = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
    let by = |k, r, size| Camera::from_intrinsics(k, r, [0.0; 3], size);
    let mut skewed = k;
    skewed[0][1] = 0.1;
    no_camera(by(skewed, turn, [10, 10]), "f_x, 0, c_x");
    let mut mirrored = turn;
    mirrored[0][0] = -1.0;
    no_camera(by(k, mirrored, [10, 10]), "right-handed");
    let mut stretched = turn;
    stretched[0][0] = 1.5;
    no_camera(by(k, stretched, [10, 10]), "rotation");
    no_camera(by(k, turn, [0, 10]), "size");
}
