//! Meshes and scenes in files.

use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

use crate::common::errors::{message, says};
use crate::common::folder::Folder;
use crate::common::materials::base;
use crate::common::mistakes::warnings;
use crate::common::numbers::{largest, mean};
use crate::common::scenes::{facing_front, floor, lamp};
use crate::common::tensors::{radiance, values};
use crate::written::{camera, texels, uvs};
use burn::tensor::DType;
use softray::prelude::*;

/// Textures (of 8 bits and not, clamped and repeating, diffuse and specular), a gloss, smooth
/// normals, a transform, an emitter, faces of two materials, and names that need care.
fn room() -> Scene {
    let device = Device::flex();
    let folder = Folder::new("texture");
    let path = folder.path("checks.png");
    let checks = |i: usize| {
        if (i / 3 + i / 12).is_multiple_of(2) {
            0.8
        } else {
            0.1 + 0.02 * i as f32
        }
    };
    let checks = HostImage::from_tensor(&texels([4, 4, 3], checks)).expect("values");
    checks.write(&path).expect("a file");
    let checks = HostImage::read(&path)
        .expect("an image")
        .into_tensor(&device);
    let floor = Object::new(floor(2.0, 0.0, &device).with_uvs(uvs()));
    let checkered = Material::diffuse(ColorTexture::Texture {
        texels: checks,
        wrap: Wrap::Clamp,
    });
    let stripes = texels([2, 3, 3], |i| 0.05 + i as f32 / 50.0);
    let dark = Tensor::<1>::from_floats([0.1, 0.2, 0.3], &device);
    let striped = Material::phong(dark, ColorTexture::texture(stripes), 7.5);
    let turn = Transform::new()
        .with_scale(Tensor::from_floats([0.6, 0.9, 0.6], &device))
        .with_axis_angle([1.0, 0.4, 0.0], Tensor::from_floats([40.0], &device))
        .with_translation(Tensor::from_floats([-0.6, 0.8, 0.1], &device));
    let ball = shapes::icosphere(1, &device);
    let ball = ball.clone().with_normals(ball.vertices.clone());
    let back = facing_front([-2.0, 2.0], [0.0, 3.0], -2.0, &device);
    let mut back = Object::new(back.with_uvs(uvs())).with_name("ball ");
    back.materials = vec![striped, Material::diffuse([0.7, 0.1 + 0.2, 1.0 / 3.0])].into();
    back.face_materials = Arc::new(vec![1, 0]);
    let lamp = lamp(0.8, 2.9, [9.0, 8.0, 7.0], &device);
    Scene::new()
        .with_object(
            floor
                .with_name("the floor\\")
                .with_material(checkered.with_name("Wood #1")),
        )
        .with_object(
            Object::new(ball.transformed(&turn))
                .with_name("ball")
                .with_material(Material::phong([0.2, 0.3, 0.4], [0.3, 0.3, 0.25], 30.0)),
        )
        .with_object(back)
        .with_object(lamp.with_name("\n"))
}

#[test]
fn a_scene_reads_back_to_the_same_image() {
    let folder = Folder::new("scene");
    let path = folder.path("my room.obj");
    let scene = room();
    scene.write(&path).expect("files");
    assert_eq!(
        folder.files(),
        [
            "my room.mtl",
            "my room.obj",
            "my room_material_specular.exr",
            "my room_wood__1_diffuse.png",
        ]
    );
    let read = Scene::load(&path, &Device::flex()).expect("a scene");
    let names: Vec<&str> = read.objects.iter().map(|o| o.name.as_str()).collect();
    assert_eq!(names, ["the floor_", "ball", "ball_2", "object"]);
    let floor = &read.objects[0].materials[0];
    assert_eq!(floor.name, "Wood _1");
    assert!(matches!(
        base(floor),
        ColorTexture::Texture {
            wrap: Wrap::Clamp,
            ..
        }
    ));
    let options = RenderOptions::new(24, 24).with_samples(4).with_bounces(2);
    let image = |scene: &Scene| radiance(scene, &camera(), &options);
    let (before, after) = (image(&scene), image(&read));
    assert!(mean(&before) > 0.05, "{}", mean(&before));
    let most = largest(before.iter().zip(&after).map(|(a, b)| a - b));
    assert!(most < 1e-5, "{most}");

    // Written again it has as many faces.
    let again = folder.path("again.obj");
    read.write(&again).expect("files");
    let geometry = |path: &PathBuf| {
        let text = fs::read_to_string(path).expect("a text");
        let of_faces = text.lines().filter(|l| l.starts_with("f "));
        of_faces.count()
    };
    assert_eq!(geometry(&again), geometry(&path));
    let twice = Scene::load(&again, &Device::flex()).expect("a scene");
    assert_eq!(image(&twice), after);
}

#[test]
fn what_is_lost_warns() {
    let folder = Folder::new("losses");
    let device = Device::flex();
    let wandered = Tensor::<1>::from_floats([-0.01, 0.5, 1.2], &device);
    let mirrored = ColorTexture::Texture {
        texels: texels([1, 2, 3], |i| i as f32 / 9.0),
        wrap: Wrap::Mirror,
    };
    let cube = |name: &str| Object::new(shapes::cube(&device)).with_name(name);
    let tiled = |mesh: Mesh| {
        let uvs = mesh.vertices.clone().narrow(1, 0, 2);
        mesh.with_uvs(uvs)
    };
    let nothing = Mesh::from_host(&[[0.0; 3]], Vec::new(), &device);
    let scene = Scene::new()
        .with_object(cube("lost_still").with_material(Material::diffuse(wandered)))
        .with_object(cube("lost_moving").with_velocity([0.5, 0.0, 0.0]))
        .with_object(
            cube("lost_tiled")
                .map_mesh(tiled)
                .with_material(Material::diffuse(mirrored)),
        )
        .with_object(cube("lost_moving").with_velocity([0.0; 3]))
        .with_object(Object::new(nothing).with_name("lost_empty"))
        .with_environment([0.2; 3]);
    let path = folder.path("losses.obj");
    let warnings = warnings(|| scene.write(&path).expect("files"));
    let warned = |word: &str, of: &str| {
        let found = warnings
            .iter()
            .filter(|w| w.contains(word) && w.contains(of));
        assert_eq!(found.count(), 1, "{word}, {of}: {warnings:?}");
    };
    warned("losses.obj", "environment");
    warned("velocity [0.5, 0.0, 0.0]", "lost_moving");
    warned("lost_empty", "no faces");
    warned("lost_still, material material", "can't be rendered");
    warned("lost_tiled, material material", "mirrored");
    warned("\"lost_moving\" is \"lost_moving_2\"", "losses.obj");
    let text = fs::read_to_string(folder.path("losses.mtl")).expect("a text");
    assert!(text.contains("Kd -0.01 0.5 1.2\n"), "{text}");
    let read = Scene::load(&path, &device).expect("a scene");
    assert_eq!(read.objects.len(), 4);
    // At the shutter's start.
    let place = |scene: &Scene, i: usize| scene.objects[i].mesh.host_vertices().expect("values");
    let mut places = [place(&scene, 1), place(&read, 1)];
    for p in &mut places {
        p.sort_by(|a, b| a.partial_cmp(b).expect("numbers"));
    }
    assert_eq!(places[0], places[1]);
}

#[test]
fn meshes_keep_every_bit() {
    let folder = Folder::new("mesh");
    let device = Device::flex();
    let ball = shapes::icosphere(2, &device);
    let tracked = ball.vertices.clone().autodiff().require_grad();
    let path = folder.path("ball.obj");
    ball.clone()
        .with_normals(ball.vertices.clone() * 3.0)
        .with_vertices(tracked / 3.0)
        .write(&path)
        .expect("a file");
    assert_eq!(folder.files(), ["ball.obj"]);
    let read = Scene::load(&path, &device).expect("a scene");
    let object = read.object("ball").expect("named like the file");
    let read = &object.mesh;
    assert_eq!(read.faces.len(), ball.faces.len());
    let was = values(&(ball.vertices.clone() / 3.0));
    let is = values(&read.vertices);
    let normals = read.normals.as_ref().expect("normals");
    let normals_were = values(&(ball.vertices.clone() * 3.0));
    let normals_are = values(&normals.values);
    for (f, face) in ball.faces.iter().enumerate() {
        for (c, &row) in face.iter().enumerate() {
            let at = |list: &[f64], row: u32| list[3 * row as usize..][..3].to_vec();
            assert_eq!(at(&was, row), at(&is, read.faces[f][c]));
            let normal = at(&normals_are, normals.faces[f][c]);
            assert_eq!(at(&normals_were, row), normal);
        }
    }

    let double = ball.cast(DType::F64);
    let double = double.clone().with_vertices(double.vertices.clone() / 3.0);
    double.write(&path).expect("a file");
    let text = fs::read_to_string(&path).expect("a text");
    let of_vertices = text.lines().filter_map(|l| l.strip_prefix("v "));
    let numbers = of_vertices.flat_map(|l| l.split(' '));
    let numbers: Vec<f64> = numbers.map(|n| n.parse().expect("a number")).collect();
    assert_eq!(numbers, values(&double.vertices));
}

#[test]
fn nothing_is_left_of_what_fails() {
    let folder = Folder::new("failure");
    // The MTL file can't take the place of a folder.
    fs::create_dir_all(folder.path("room.mtl/full")).expect("a folder");
    says(message(room().write(folder.path("room.obj"))), ["room.mtl"]);
    let files = folder.files();
    assert!(!files.iter().any(|f| f.contains("part")), "{files:?}");
    assert!(!files.contains(&"room.obj".to_owned()), "{files:?}");

    let before = folder.files();
    let cube = shapes::cube(&Device::flex());
    says(
        message(cube.write(folder.path("cube.stl"))),
        ["expected .obj", ".ply"],
    );
    says(
        message(room().write(folder.path("room"))),
        ["expected .obj"],
    );
    let empty = Scene::new().write(folder.path("none.obj"));
    assert!(matches!(empty, Err(softray::Error::NoTriangles { .. })));
    let faceless = Mesh::from_host(&[[0.0; 3]], Vec::new(), &Device::flex());
    says(message(faceless.write(folder.path("none.obj"))), ["faces"]);
    let nan = Mesh::from_host(&[[f64::NAN; 3]; 3], vec![[0, 1, 2]], &Device::flex());
    says(message(nan.write(folder.path("nan.obj"))), ["finite"]);
    assert_eq!(folder.files(), before);
}
