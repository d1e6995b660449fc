//! Files, sizes and values that nobody means well with: an error that says what is wrong, or the right
//! result, in time and memory linear in the input.

use std::path::Path;

use crate::common::errors::{message, says};
use crate::common::folder::Folder;
use crate::common::scenes::under_sky;
use crate::common::tensors::{gradient, values, with_leaves};
use burn::tensor::{Device, Tensor};
use softray::prelude::*;

fn camera() -> Camera {
    Camera::look_at([0.3, 0.4, 4.0], [0.0; 3]).with_fov_y(40.0)
}

fn small() -> RenderOptions {
    RenderOptions::new(8, 8).with_samples(2).with_bounces(1)
}

/// Renders with gradients of all vertices by both forms; all of it finite.
fn finite(scene: &Scene) {
    for form in [Visibility::default(), Visibility::softmax(1e-4, 1e-3)] {
        let scene = with_leaves(scene.clone().with_environment([1.0; 3]));
        let options = small().with_visibility(form);
        let image = render(&scene, &camera(), &options).expect("an image");
        let gradients = image.radiance.clone().sum().backward();
        let finite = values(&image.radiance).iter().all(|v| v.is_finite());
        assert!(finite, "{form:?}: image");
        for object in &scene.objects {
            let gradient = gradient(&object.mesh.vertices, &gradients);
            let finite = gradient.iter().all(|v| v.is_finite());
            assert!(finite, "{form:?}: gradient of {}", object.name);
        }
    }
}

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

/// A vertex that thousands of triangles share made lists of all pairs of them.
#[test]
fn polygons_that_repeat_a_vertex_and_polygons_of_100_000_corners() {
    let folder = Folder::new("polygons");
    let repeated = format!("{SQUARE}f {}\n", "1 2 3 ".repeat(10_000));
    assert!(repeated.len() > 60_000);
    finite(&folder.load(repeated).expect("a scene"));

    let n = 100_000;
    let mut text = String::new();
    for i in 0..n {
        let angle = std::f64::consts::TAU * f64::from(i) / f64::from(n);
        text += &format!("v {} {} 0\n", angle.cos(), angle.sin());
    }
    text += "f";
    for i in 1..=n {
        text += &format!(" {i}");
    }
    let scene = folder.load(text).expect("a scene");
    assert_eq!(scene.objects[0].mesh.faces.len(), n as usize - 2);
    finite(&scene);
}

/// What a network that fails may predict: all vertices in one place, or nearly so.
#[test]
fn meshes_collapsed_to_a_point() {
    let device = Device::flex();
    let ball = shapes::icosphere(5, &device);
    for size in [0.0, 1e-12, 1e-6] {
        let point = ball.clone().scaled(Tensor::from_floats([size], &device));
        let beside = shapes::icosphere(1, &device);
        let scene = Scene::new()
            .with_object(Object::new(point).with_name(format!("point of {size:e}")))
            .with_object(Object::new(beside));
        finite(&scene);
    }
}

/// A PNG of 49 KB may hold 20,000² pixels: a size that is refused by name, unless it is allowed.
#[test]
fn images_larger_than_the_limit() {
    let folder = Folder::new("pixels");
    let path = folder.0.join("large.png");
    HostImage::new(300, 200, vec![0.5; 300 * 200 * 3])
        .expect("an image")
        .write(&path)
        .expect("a file");
    let limits = LoadLimits::default().with_pixels(59_999);
    let error = message(HostImage::read_within(&path, &limits));
    says(&error, ["300 × 200", "LoadLimits::with_pixels"]);
    let limits = limits.with_pixels(60_000);
    assert!(HostImage::read_within(&path, &limits).is_ok());

    // What a header promises is not allocated: 60,000² pixels in 70 bytes.
    let mut header = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut chunk = b"IHDR".to_vec();
    chunk.extend(60_000u32.to_be_bytes());
    chunk.extend(60_000u32.to_be_bytes());
    chunk.extend([8, 2, 0, 0, 0]);
    header.extend(13u32.to_be_bytes());
    let sum = crc(&chunk);
    header.extend(chunk);
    header.extend(sum.to_be_bytes());
    header.extend([0, 0, 0, 0, b'I', b'D', b'A', b'T', 0x35, 0xaf, 0x06, 0x1e]);
    let path = folder.write("bomb.png", header);
    says(message(HostImage::read(&path)), ["60000 × 60000"]);
}

/// The CRC-32 of PNG chunks, bit by bit.
fn crc(bytes: &[u8]) -> u32 {
    let mut sum = !0u32;
    for &byte in bytes {
        sum ^= u32::from(byte);
        for _ in 0..8 {
            sum = (sum >> 1) ^ if sum & 1 == 1 { 0xedb8_8320 } else { 0 };
        }
    }
    !sum
}

#[test]
#[cfg(unix)]
fn files_that_are_no_files() {
    let folder = Folder::new("devices");
    let limits = LoadLimits::default().with_outside(true).with_strict(true);
    let device = Device::flex();
    for library in ["/dev/zero", "/dev/null"] {
        let path = folder.write("scene.obj", format!("mtllib {library}\n{SQUARE}f 1 2 3\n"));
        says(
            message(Scene::load_within(&path, &device, &limits)),
            ["regular file"],
        );
    }
    let pipe = folder.0.join("pipe.obj");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    if made.is_ok_and(|s| s.success()) {
        says(message(Scene::load(&pipe, &device)), ["regular file"]);
        says(message(HostImage::read(&pipe)), ["regular file"]);
    }
    let inner = folder.0.join("folder.obj");
    std::fs::create_dir_all(&inner).expect("a folder");
    says(message(Scene::load(&inner, &device)), ["a folder"]);
}

#[test]
fn texts_and_meshes_larger_than_the_limits() {
    let folder = Folder::new("limits");
    let path = folder.write("scene.obj", format!("{SQUARE}f 1 2 3 4\n"));
    let load = |limits| Scene::load_within(&path, &Device::flex(), &limits);
    says(
        message(load(LoadLimits::default().with_text_bytes(20))),
        ["LoadLimits::with_text_bytes"],
    );
    let error = message(load(LoadLimits::default().with_triangles(1)));
    says(&error, ["line 5", "LoadLimits::with_triangles"]);
    assert!(load(LoadLimits::default().with_triangles(2)).is_ok());
}

#[test]
fn files_outside_of_the_folder() {
    let folder = Folder::new("outside");
    folder.write("secret.mtl", "newmtl a\nKd 1 0 0\n");
    let image = HostImage::new(2, 2, vec![0.5; 12]).expect("an image");
    image.write(folder.0.join("secret.png")).expect("a file");
    folder.write("inner/scene.mtl", "newmtl a\nmap_Kd ../secret.png\n");
    let device = Device::flex();
    let outside = LoadLimits::default().with_outside(true);
    for library in ["../secret.mtl", "scene.mtl"] {
        let text = format!("mtllib {library}\n{SQUARE}usemtl a\nf 1 2 3\n");
        let path = folder.write("inner/scene.obj", text);
        let error = message(Scene::load(&path, &device));
        says(&error, ["lies outside", "secret"]);
        says(&error, ["scene.", "LoadLimits::with_outside"]);
        assert!(Scene::load_within(&path, &device, &outside).is_ok());
    }
    let json = |environment: &str, obj: &str| {
        format!(
            r#"{{"obj": "{obj}", "environment": {environment}, "camera": {{"eye": [0, 0, 4],
            "target": [0, 0, 0], "fov_y_degrees": 40, "width": 8, "height": 8}}}}"#
        )
    };
    folder.write("inner/plain.obj", format!("{SQUARE}f 1 2 3\n"));
    folder.write("plain.obj", format!("{SQUARE}f 1 2 3\n"));
    for text in [
        json("\"../secret.png\"", "plain.obj"),
        json("[1, 1, 1]", "../plain.obj"),
    ] {
        let path = folder.write("inner/scene.json", text);
        says(message(SceneFile::load(&path, &device)), ["lies outside"]);
        assert!(SceneFile::load_within(&path, &device, &outside).is_ok());
    }
}

#[test]
fn sizes_that_no_machine_holds() {
    let scene = under_sky(shapes::icosahedron(&Device::flex()));
    let at = |options: RenderOptions| message(render(&scene, &camera(), &options));
    for (size, takes) in [(65_535, "51.5 GB"), (30_000, "10.8 GB")] {
        let error = at(RenderOptions::new(size, size));
        says(&error, [takes, "memory_limit"]);
    }
    let error = at(small().with_bounces(u32::MAX));
    says(&error, ["bounces", "4294967296 surfaces"]);
    says(at(RenderOptions::new(1 << 40, 1 << 40)), ["2³²"]);
    let options = RenderOptions::new(1 << 40, 1 << 40);
    says(
        message(render_pixels(&scene, &camera(), &options, &[7])),
        ["2³²"],
    );
    says(
        at(small().with_memory_limit(100).with_normals()),
        ["memory_limit"],
    );
    says(
        message(HostImage::new(1 << 63, 2, Vec::new())),
        ["0 values"],
    );
}

#[test]
fn values_that_f32_cannot_hold_and_normals_without_a_direction() {
    let device = Device::flex();
    let ball = || shapes::icosahedron(&device);
    let error = |object: Object| {
        let scene = Scene::new().with_object(object).with_environment([1.0; 3]);
        message(render(&scene, &camera(), &small()))
    };
    let lamp = Object::new(ball()).with_material(Material::emitter([1e308, 0.0, 0.0]));
    let found = error(lamp);
    says(&found, ["emission", "finite"]);
    let folder = Folder::new("values");
    folder.write("scene.mtl", "newmtl a\nKe 1e308 0 0\n");
    let text = format!("mtllib scene.mtl\n{SQUARE}usemtl a\nf 1 2 3\n");
    let scene = folder.load(text).expect("a scene");
    says(message(render(&scene, &camera(), &small())), ["emission"]);

    let mut normals: Vec<f32> = vec![0.6; 36];
    normals[9..12].fill(0.0);
    let normals = Tensor::<1>::from_floats(normals.as_slice(), &device).reshape([12, 3]);
    says(
        error(Object::new(ball().with_normals(normals))),
        ["normals 3"],
    );
}

#[test]
fn byte_order_marks_and_other_encodings() {
    let folder = Folder::new("encodings");
    let text = format!("{SQUARE}f 1 2 3\n");
    let marked = format!("\u{feff}{text}");
    // The mark swallowed the first vertex.
    let scene = folder.load(marked).expect("a scene");
    assert_eq!(
        scene.objects[0].mesh.host_vertices().expect("values")[0],
        [0.0; 3]
    );
    folder.write("scene.mtl", "\u{feff}newmtl a\nKd 1 0 0\n");
    let with = format!("mtllib scene.mtl\n{SQUARE}usemtl a\nf 1 2 3\n");
    let scene = folder.load(with).expect("a scene");
    assert_eq!(scene.objects[0].materials[0].name, "a");
    let json = "\u{feff}{\"obj\": \"scene.obj\", \"camera\": {\"eye\": [0, 0, 4], \
                \"target\": [0, 0, 0], \"fov_y_degrees\": 40, \"width\": 8, \"height\": 8}}";
    let path = folder.write("scene.json", json);
    assert!(SceneFile::load(&path, &Device::flex()).is_ok());

    let mut wide = vec![0xff, 0xfe];
    wide.extend(text.encode_utf16().flat_map(u16::to_le_bytes));
    says(message(folder.load(wide)), ["UTF-16"]);
    says(
        message(folder.load(text.replace('\n', "\r"))),
        ["carriage return"],
    );
    assert!(folder.load(text.replace('\n', "\r\n")).is_ok());
}

/// The direction up and the distance between eye and target count by their direction alone.
#[test]
fn cameras_with_tiny_and_huge_vectors() {
    let device = Device::flex();
    let scene = Scene::new()
        .with_object(Object::new(shapes::icosahedron(&device)))
        .with_environment([1.0, 0.5, 0.2]);
    for engine in [Engine::Kernels, Engine::Tensors] {
        let options = small().with_samples(16).with_engine(engine).with_opacity();
        let image = |camera: &Camera| {
            let image = render(&scene, camera, &options).expect("an image");
            values(&image.opacity.expect("opacity"))
        };
        let usual = image(&camera());
        for length in [1e-23, 1e-10, 2e19] {
            let found = image(&camera().with_up([0.0, length, 0.0]));
            assert_eq!(found, usual, "{engine:?}, up {length:e}");
        }
        let eye = glam::DVec3::new(0.3, 0.4, 4.0);
        let near = eye - eye.normalize() * 1e-7;
        let close = Camera::look_at(eye, near).with_fov_y(40.0);
        for (a, b) in image(&close).iter().zip(&usual) {
            assert!((a - b).abs() < 1e-3, "{engine:?}");
        }
    }
    let same = Camera::look_at([0.0, 0.0, 4.0], [0.0, 0.0, 4.0]);
    says(message(render(&scene, &same, &small())), ["target"]);
}

#[test]
fn mistakes_of_the_api_are_errors() {
    let device = Device::flex();
    let ball = || shapes::icosahedron(&device);
    let see = |mesh: Mesh| {
        let scene = Scene::new()
            .with_object(Object::new(mesh).with_name("ball"))
            .with_environment([1.0; 3]);
        message(render(&scene, &camera(), &small()))
    };
    let two = || Tensor::<1>::from_floats([1.0, 2.0], &device);
    let error = see(ball().translated(two()));
    says(&error, ["ball", "shape [2]"]);
    says(see(ball().scaled(two())), ["scaled"]);
    let wrong = Mesh::new(ball().vertices, vec![[0, 1, 12]]);
    says(message(wrong.subdivided()), ["indices under 12"]);

    // An object without faces, whose vertices are in a graph.
    let tracked = ball().vertices.autodiff().require_grad();
    let empty = Mesh::new(tracked.clone(), Vec::new());
    let scene = Scene::new()
        .with_object(Object::new(empty))
        .with_object(Object::new(ball()))
        .with_environment([1.0; 3]);
    for engine in [Engine::Kernels, Engine::Tensors] {
        let image = render(&scene, &camera(), &small().with_engine(engine)).expect("an image");
        let gradients = image.radiance.sum().backward();
        assert!(gradient(&tracked, &gradients).iter().all(|&g| g == 0.0));
    }

    let scenes = vec![Scene::new().with_object(Object::new(ball()).with_name("ball")); 2];
    let none = Tensor::<3>::zeros([2, 0, 3], &device);
    let batch = Batch::new(scenes, vec![camera()]).expect("a batch");
    let rendered = batch
        .with_vertices("ball", none)
        .and_then(|batch| render_batch(&batch, &small()));
    says(message(rendered), ["ball"]);
}

#[test]
fn messages_name_what_is_wrong() {
    let folder = Folder::new("messages");
    for face in ["f 1 / 2 3", "f 1 2 x", "f 1/1/1/1 2 3", "f /1 2 3"] {
        let error = message(folder.load(format!("{SQUARE}vt 0 0\nvn 0 0 1\n{face}\n")));
        assert!(
            error.contains("line 7") && error.contains("v/vt/vn"),
            "{face}: {error}"
        );
    }
    folder.write("scene.obj", format!("{SQUARE}f 1 2 3\n"));
    let json = |camera: &str, rest: &str| {
        format!(r#"{{"obj": "scene.obj", "camera": {{{camera}}} {rest}}}"#)
    };
    let good =
        r#""eye": [0, 0, 4], "target": [0, 0, 0], "fov_y_degrees": 40, "width": 8, "height": 8"#;
    let bad_eye = good.replace("[0, 0, 4]", r#"[0, "x", 4]"#);
    let short = good.replace("[0, 0, 4]", "[0, 4]");
    for (text, parts) in [
        (json(&bad_eye, ""), ["camera.eye[1]", "string"]),
        (json(&short, ""), ["camera.eye", "length 2"]),
        (
            json(good, r#", "environment": [1, 2]"#),
            ["environment", "three numbers"],
        ),
        (
            json(good, r#", "environment": {"a": 1}"#),
            ["environment", "three numbers"],
        ),
        (
            json(good, r#", "velocities": {"b": [1, 2, "z"]}"#),
            ["velocities.b[2]", "string"],
        ),
        (
            json(good, r#", "lights": [{"kind": "area"}]"#),
            ["lights[0]", "spot"],
        ),
        (json(good, ",,"), ["line", "column"]),
    ] {
        let path = folder.write("scene.json", &text);
        let error = message(SceneFile::load(&path, &Device::flex()));
        let whole = parts.iter().all(|p| error.contains(p)) && !error.contains("untagged");
        assert!(whole, "{text}: {error}");
    }
    // Refused before the render, which would be lost.
    let at = |path: &Path| message(HostImage::check_path(path));
    assert!(at(&folder.0.join("x.jpg")).contains(".exr or .pfm or .png"));
    assert!(at(&folder.0.join("nowhere/x.png")).contains("no folder"));
    assert!(HostImage::check_path(folder.0.join("x.png")).is_ok());
    // A `main` that returns an error prints it by `{:?}`.
    let error = softray::device::named(Some("abacus")).expect_err("an error");
    assert_eq!(format!("{error:?}"), error.to_string());
}
