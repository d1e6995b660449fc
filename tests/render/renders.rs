//! Furnaces, determinism, outputs and errors of `render()`.

use crate::common;
use crate::common::cpu_devices;
use crate::common::errors::{message, says};
use crate::common::numbers::rmse;
use crate::common::scenes::{diffuse, facing_front, inward, lamp, on_axis, scene_file};
use crate::common::tensors::{radiance, values};
use burn::tensor::Device;
use softray::prelude::*;

/// The paper's form with a blur of its own, and cones.
fn forms(sigma: f64, gamma: f64) -> [Visibility; 3] {
    [
        Visibility::softmax(sigma, gamma),
        Visibility::default(),
        Visibility::cone(2.865),
    ]
}

fn white(environment: f64) -> Scene {
    Scene::new().with_environment([environment; 3])
}

/// Mean radiance over an image, all channels.
fn mean(image: &Image) -> f64 {
    image.mean().expect("values").iter().sum::<f64>() / 3.0
}

#[test]
fn a_convex_mesh_of_albedo_1_vanishes_in_a_uniform_environment() {
    let blurs = forms(1e-5, 1e-3);
    for (faces, form) in (0..3).flat_map(|f| blurs.map(|b| (f, b))) {
        let device = Device::flex();
        let ball = diffuse(shapes::icosphere(faces, &device), [1.0; 3]);
        let camera = Camera::look_at([0.0, 0.5, 3.0], [0.0; 3]).with_fov_y(30.0);
        let options = RenderOptions::new(24, 24)
            .with_samples(16)
            .with_bounces(0)
            .with_visibility(form);
        let image = render(&white(0.7).with_object(ball), &camera, &options).expect("an image");
        let (mean, faces) = (mean(&image), 20 << (2 * faces));
        assert!(
            (mean / 0.7 - 1.0).abs() < 0.01,
            "{form:?}, {faces} faces: {mean}"
        );
    }
}

#[test]
fn a_torus_of_albedo_1_vanishes_given_enough_bounces() {
    let device = Device::flex();
    let torus = diffuse(shapes::torus(1.0, 0.4, 12, 8, &device), [1.0; 3]);
    let camera = Camera::look_at([0.0, 2.5, 2.0], [0.0; 3]).with_fov_y(40.0);
    for form in forms(1e-6, 1e-5) {
        let options = RenderOptions::new(16, 16)
            .with_samples(32)
            .with_bounces(12)
            .with_visibility(form);
        let scene = white(1.0).with_object(torus.clone());
        let image = render(&scene, &camera, &options).expect("an image");
        let mean = mean(&image);
        assert!((mean - 1.0).abs() < 0.01, "{form:?}: {mean}");
    }
}

#[test]
fn inside_a_box_light_adds_up_as_a_geometric_series() {
    let device = Device::flex();
    let (emission, albedo) = (0.8f64, 0.5f64);
    // Seen from inside, the walls must be in front: the winding is turned over.
    let walls = Object::new(inward(shapes::cube(&device)));
    let glow = Material::diffuse([albedo; 3]).with_emission([emission; 3]);
    let scene = Scene::new().with_object(walls.with_material(glow));
    let camera = Camera::look_at([0.1, 0.0, 0.1], [0.0, 0.1, -0.4]).with_fov_y(70.0);
    let render_at = |form, bounces, samples: u32| {
        let options = RenderOptions::new(16, 16)
            .with_samples(samples)
            .with_bounces(bounces)
            .with_visibility(form)
            .with_seed(1);
        mean(&render(&scene, &camera, &options).expect("an image"))
    };
    for (bounces, blur) in [0, 1, 3]
        .into_iter()
        .flat_map(|b| forms(1e-8, 1e-5).map(|f| (b, f)))
    {
        // The camera sees E, and every hit adds the light of the one after it.
        let expected: f64 = (0..=bounces as i32 + 1)
            .map(|k| emission * albedo.powi(k))
            .sum();
        let found = render_at(blur, bounces, 512);
        assert!(
            // Near corners a cone of 0.05 sees less of the wall beside it.
            (found / expected - 1.0).abs() < 0.015,
            "{blur:?}, {bounces} bounces: {found}, expected {expected}"
        );
    }
    for blur in forms(1e-8, 1e-5) {
        let (found, expected) = (render_at(blur, 10, 256), emission / (1.0 - albedo));
        assert!(
            (found / expected - 1.0).abs() < 0.02,
            "{blur:?}, in the limit: {found}, expected {expected}"
        );
    }
}

#[test]
fn lobes_reflect_their_albedo_at_normal_incidence() {
    let device = Device::flex();
    let plane = facing_front([-1.0, 1.0], [-1.0, 1.0], 0.0, &device);
    let camera = Camera::look_at([0.0, 0.0, 50.0], [0.0; 3]).with_fov_y(0.5);
    let materials = [
        (Material::diffuse([0.6; 3]), 0.6),
        (Material::phong([0.0; 3], [0.7; 3], 5.0), 0.7),
        (Material::phong([0.0; 3], [0.7; 3], 80.0), 0.7),
        (Material::phong([0.3; 3], [0.4; 3], 20.0), 0.7),
    ];
    for (material, expected) in materials {
        let scene = white(1.0).with_object(Object::new(plane.clone()).with_material(material));
        let options = RenderOptions::new(16, 16).with_samples(256).with_bounces(0);
        let image = render(&scene, &camera, &options).expect("an image");
        let mean = mean(&image);
        assert!(
            (mean / expected - 1.0).abs() < 0.01,
            "{mean}, expected {expected}"
        );
    }
}

#[test]
fn the_same_seed_gives_the_same_bits_whatever_the_tiles() {
    for device in cpu_devices() {
        let file = scene_file("cornell", &device);
        let at = |options: RenderOptions| radiance(&file.scene, &file.camera, &options);
        let options = RenderOptions::new(24, 24)
            .with_samples(4)
            .with_bounces(1)
            .with_seed(9);
        let first = at(options.clone());
        assert_eq!(first, at(options.clone()));
        assert_eq!(first, at(options.clone().with_rays_per_tile(160)));
        assert_ne!(first, at(options.with_seed(10)));
    }
}

#[cfg(feature = "ndarray")]
#[test]
fn backends_agree_up_to_rounding() {
    let image = |device: &Device| {
        let file = scene_file("cornell", device);
        let options = RenderOptions::new(32, 32)
            .with_samples(16)
            .with_bounces(3)
            .with_seed(2);
        radiance(&file.scene, &file.camera, &options)
    };
    let [a, b] = [0, 1].map(|i| image(&cpu_devices()[i]));
    let close = crate::images::share_of_close_pixels(&a, &b);
    assert!(close >= 0.99, "{close}");
}

#[test]
fn outputs_of_the_camera_rays() {
    let device = Device::flex();
    let plane = facing_front([-1.0, 1.0], [-1.0, 1.0], 0.0, &device);
    let side = Object::new(plane.clone().translated([2.0, 0.0, -1.0]));
    let scene = white(1.0)
        .with_object(Object::new(plane).with_name("front"))
        .with_object(side.with_name("side"));
    let camera = on_axis(3.0).with_fov_y(60.0);
    let options = RenderOptions::new(31, 31)
        .with_samples(4)
        .with_bounces(0)
        .with_opacity()
        .with_depth()
        .with_normals()
        .with_object_ids();
    let image = render(&scene, &camera, &options).expect("an image");
    let opacity = values(&image.opacity.expect("opacity"));
    let depth = values(&image.depth.expect("depth"));
    let normals = values(&image.normals.expect("normals"));
    let ids = image.object_ids.expect("ids").into_data();
    let ids: Vec<i64> = ids.iter::<i64>().collect();
    let center = 15 * 31 + 15;
    assert!((opacity[center] - 1.0).abs() < 1e-4);
    assert!((depth[center] - 3.0).abs() < 1e-2, "{}", depth[center]);
    assert!((normals[3 * center + 2] - 1.0).abs() < 1e-4);
    assert_eq!(ids[center], 0);
    assert_eq!(ids[15 * 31 + 30], 1);
    assert_eq!(ids[0], -1);
    assert!(opacity[0] < 1e-4);
    assert_eq!(depth[0], 0.0);
}

/// That a render of a ball fails with a message that has these parts.
#[track_caller]
fn fails<const N: usize>(
    scene: &Scene,
    camera: &Camera,
    options: &RenderOptions,
    parts: [&str; N],
) {
    says(message(render(scene, camera, options)), parts);
}

fn ball() -> Object {
    Object::new(shapes::icosahedron(&Device::flex())).with_name("ball")
}

fn few() -> RenderOptions {
    RenderOptions::new(8, 8).with_samples(1)
}

#[test]
fn errors_name_what_is_wrong_with_options() {
    let expect = |options: RenderOptions, parts: [&str; 2]| {
        fails(
            &white(1.0).with_object(ball()),
            &on_axis(3.0),
            &options,
            parts,
        );
    };
    expect(RenderOptions::new(0, 8), ["width", "0"]);
    expect(few().with_samples(0), ["samples", "0"]);
    for bad in [0.0, -1.0, f64::NAN] {
        let value = bad.to_string();
        let forms = [
            Visibility::softmax(bad, 1e-3),
            Visibility::softmax(1e-3, bad),
        ];
        for (form, field) in forms.into_iter().zip(["sigma", "gamma"]) {
            expect(few().with_visibility(form), [field, &value]);
        }
    }
    let softmax = |epsilon| SoftmaxOptions::new(1e-3, 1e-3).with_epsilon(epsilon);
    let cone = |angle, pixels| Visibility::Cone { angle, pixels };
    for (form, parts) in [
        (softmax(-1.0).into(), ["epsilon", "-1"]),
        (cone(-0.1, 0.5), ["angle", "-0.1"]),
        (cone(0.0, f64::NAN), ["pixels", "NaN"]),
    ] {
        expect(few().with_visibility(form), parts);
    }
}

#[test]
fn errors_name_what_is_wrong_with_a_scene() {
    fails(&Scene::new(), &on_axis(3.0), &few(), ["no objects"]);
    let expect = |object: Object, parts: [&str; 3]| {
        fails(
            &white(1.0).with_object(object),
            &on_axis(3.0),
            &few(),
            parts,
        );
    };
    let triangle = |z: f64, last: u32| {
        let v = [[0.0; 3], [1.0, 0.0, z], [0.0, 1.0, 0.0]];
        Object::new(Mesh::from_host(&v, vec![[0, 1, last]], &Device::flex()))
    };
    let nan = triangle(f64::NAN, 2).with_name("broken");
    expect(nan, ["broken", "vertices 1", "NaN"]);
    let range = triangle(0.0, 3).with_name("short");
    expect(range, ["short", "face 0", "3"]);
    let bright = Material::phong([0.7; 3], [0.4; 3], 8.0);
    expect(
        ball().with_material(bright),
        ["ball", "diffuse + specular", "1.1"],
    );
    #[cfg(feature = "ndarray")]
    {
        let other = Object::new(shapes::icosahedron(&cpu_devices()[1])).with_name("elsewhere");
        let two = white(1.0).with_object(ball()).with_object(other);
        let parts = ["elsewhere", "vertices", "ndarray"];
        fails(&two, &on_axis(3.0), &few(), parts);
    }
}

#[test]
fn errors_name_what_is_wrong_with_a_camera() {
    let good = white(1.0).with_object(ball());
    let up = on_axis(3.0).with_up([0.0, 0.0, 1.0]);
    fails(&good, &up, &few(), ["camera", "up"]);
    let fov = on_axis(3.0).with_fov_y(180.0);
    fails(&good, &fov, &few(), ["camera", "fov_y", "180"]);
    fails(&good, &on_axis(0.0), &few(), ["camera", "target"]);
}

#[test]
fn a_scene_without_light_is_black() {
    let options = RenderOptions::new(8, 8).with_samples(2);
    let image = radiance(&Scene::new().with_object(ball()), &on_axis(3.0), &options);
    assert!(image.iter().all(|&v| v == 0.0));
}

/// 320 faces against the same shape in 5,120 (long tier: 20,480), at σ = (0.3 mean edges of the
/// finer)²: no face shadows itself, no seam shows.
#[test]
fn fine_faces_render_like_coarse_ones() {
    let device = Device::flex();
    let splits = if common::long() { 3 } else { 2 };
    let coarse = shapes::icosphere(2, &device);
    let mut fine = coarse.clone();
    for _ in 0..splits {
        fine = fine.subdivided().expect("a mesh");
    }
    // The area of a unit sphere shared by equilateral triangles.
    let edge = (16.0 * std::f64::consts::PI / 3f64.sqrt() / fine.faces.len() as f64).sqrt();
    let render_at = |mesh: &Mesh, form, seed| {
        let scene = white(0.5)
            .with_object(diffuse(mesh.clone(), [0.8; 3]))
            .with_object(lamp(0.5, 3.0, [8.0; 3], &device));
        let camera = Camera::look_at([0.0, 1.0, 3.0], [0.0; 3]).with_fov_y(45.0);
        let options = RenderOptions::new(12, 12)
            .with_samples(32)
            .with_bounces(0)
            .with_visibility(form)
            .with_seed(seed);
        let image = render(&scene, &camera, &options).expect("an image");
        (mean(&image), values(&image.radiance))
    };
    for form in [
        Visibility::softmax((0.3 * edge).powi(2), 1e-2),
        Visibility::default(),
    ] {
        let (expected, image) = render_at(&coarse, form, 1);
        let noise = rmse(&image, &render_at(&coarse, form, 2).1);
        let (found, split) = render_at(&fine, form, 3);
        let difference = rmse(&image, &split);
        println!(
            "{form:?}: mean {expected} at 320 faces, {found} at {}; rmse {difference}, noise {noise}",
            fine.faces.len()
        );
        assert!(
            (found / expected - 1.0).abs() < 0.02,
            "{form:?}: {found}, expected {expected}"
        );
        // More noise would hide what is wrong.
        assert!(noise < 0.1 * expected, "{form:?}: {noise} of {expected}");
        assert!(
            difference < 1.3 * noise + 0.003,
            "{form:?}: {difference}, noise {noise}"
        );
    }
}

#[test]
fn diagnostics_count_what_is_degenerate() {
    let device = Device::flex();
    let camera = on_axis(3.0).with_fov_y(30.0);
    let options = RenderOptions::new(8, 8)
        .with_samples(4)
        .with_bounces(1)
        .with_visibility(Visibility::softmax(1e-6, 1e-3));
    let at = |scene: &Scene, options: &RenderOptions| {
        let image = render(scene, &camera, options).expect("an image");
        (image.diagnostics, values(&image.radiance))
    };
    let brute_force = SoftmaxOptions::new(1e-6, 1e-3).with_brute_force();
    let brute_force = options.clone().with_visibility(brute_force);
    let (none, expected) = at(&white(1.0).with_object(ball()), &brute_force);
    assert_eq!(none, None);
    let options = options.with_diagnostics();
    let (clean, radiance) = at(&white(1.0).with_object(ball()), &options);
    assert_eq!(expected, radiance);
    let clean = clean.expect("diagnostics");
    assert_eq!(clean.degenerate_triangles, 0);
    assert_eq!(clean.parallel_pairs, 0);
    let non_finite = [
        clean.non_finite_weights,
        clean.non_finite_throughputs,
        clean.non_finite_light,
    ];
    assert_eq!(non_finite, [0; 3]);
    assert!((1.0..1.2).contains(&clean.effective_surfaces), "{clean:?}");
    assert!((0.4..0.6).contains(&clean.largest_throughput), "{clean:?}");

    // Two faces without area, one that every ray of this camera is parallel to.
    let flat = shapes::triangle([0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], &device);
    let point = shapes::triangle([0.5; 3], [0.5; 3], [0.5; 3], &device);
    let scene = white(1.0)
        .with_object(ball())
        .with_object(Object::new(flat))
        .with_object(Object::new(point));
    let found = at(&scene, &options).0.expect("diagnostics");
    assert_eq!(found.degenerate_triangles, 2);
    let narrow = on_axis(3.0).with_fov_y(1e-7);
    let wall = shapes::triangle([0.5, 0.0, 0.0], [0.5, 1.0, 0.0], [0.5, 0.0, 1.0], &device);
    let scene = white(1.0).with_object(Object::new(wall));
    let image = render(&scene, &narrow, &options).expect("an image");
    let found = image.diagnostics.expect("diagnostics");
    assert_eq!(found.parallel_pairs, 8 * 8 * 4, "{found:?}");

    // A large blur lets many surfaces share a ray.
    let options = options.with_visibility(Visibility::softmax(0.3, 0.3));
    let blurred = at(&white(1.0).with_object(ball()), &options).0;
    assert!(blurred.expect("diagnostics").effective_surfaces > 1.5);
}
