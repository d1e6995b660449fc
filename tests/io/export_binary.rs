//! Meshes and scenes in glTF and PLY files.

use std::sync::Arc;

use crate::common::folder::Folder;
use crate::common::materials::base;
use crate::common::mistakes::warnings;
use crate::common::numbers::{largest, mean};
use crate::common::scenes::{facing_front, floor, lamp};
use crate::common::tensors::values;
use crate::written::{image, texels, uvs};
use burn::tensor::{DType, TensorData};
use softray::prelude::*;

/// A mesh with a seam: normals of faces.
fn faceted(mesh: Mesh) -> Mesh {
    let vertices = mesh.host_vertices().expect("values");
    let normals = mesh.faces.iter().map(|f| {
        let [a, b, c] = f.map(|v| glam::DVec3::from(vertices[v as usize]));
        (b - a).cross(c - a).normalize().as_vec3().to_array()
    });
    let flat: Vec<f32> = normals.flatten().collect();
    let count = mesh.faces.len();
    let values = Tensor::from_data(TensorData::new(flat, [count, 3]), &Device::flex());
    let faces = (0..count as u32).map(|f| [f; 3]).collect();
    let mut mesh = mesh;
    mesh.normals = Some(softray::scene::CornerAttribute {
        values,
        faces: Arc::new(faces),
    });
    mesh
}

/// Textures (of 8 bits and not, of all ways to go on), a gloss, normals smooth and with seams, emitters of more
/// than 1, and faces of two materials.
fn room() -> Scene {
    let device = Device::flex();
    let textured = |texels, wrap| Material::diffuse(ColorTexture::Texture { texels, wrap });
    let bytes = |i: usize| if (i / 3).is_multiple_of(2) { 1.0 } else { 0.0 };
    let floor = Object::new(floor(2.0, 0.0, &device).with_uvs(uvs()));
    let smooth = texels([3, 2, 3], |i| 0.05 + i as f32 / 50.0);
    let glossy = textured(texels([2, 3, 3], |i| 0.05 + i as f32 / 60.0), Wrap::Mirror);
    let diffuse = base(&glossy).clone();
    let glossy = Material::phong(diffuse, ColorTexture::texture(smooth), 7.5);
    let ball = shapes::icosphere(1, &device)
        .scaled(0.6)
        .translated([-0.6, 0.8, 0.1]);
    let ball = ball.clone().smooth_normals();
    let cube = faceted(
        shapes::cube(&device)
            .scaled(0.3)
            .translated([0.8, 0.4, 0.2]),
    );
    let back = facing_front([-2.0, 2.0], [0.0, 3.0], -2.0, &device);
    let mut back = Object::new(back.with_uvs(uvs())).with_name("back \"\n");
    back.materials = vec![glossy, Material::diffuse([0.7, 0.1 + 0.2, 1.0 / 3.0])].into();
    back.face_materials = Arc::new(vec![1, 0]);
    let checks = textured(texels([4, 4, 3], bytes), Wrap::Clamp);
    let shiny = Material::phong([0.2, 0.3, 0.4], [0.3, 0.3, 0.25], 30.0);
    Scene::new()
        .with_object(
            floor
                .with_name("floor")
                .with_material(checks.with_name("checks")),
        )
        .with_object(
            Object::new(ball)
                .with_name("ball")
                .with_material(shiny.clone()),
        )
        .with_object(Object::new(cube).with_name("cube").with_material(shiny))
        .with_object(back)
        .with_object(lamp(0.8, 2.9, [9.1, 8.3, 0.7], &device).with_name("lamp"))
}

#[test]
fn a_scene_reads_back_from_gltf_to_the_same_image() {
    let folder = Folder::new("gltf-scene");
    let scene = room();
    let before = image(&scene);
    assert!(mean(&before) > 0.05, "{}", mean(&before));
    for (name, files) in [
        ("room.glb", &["room.glb"][..]),
        ("my room.gltf", &["my room.bin", "my room.gltf", "room.glb"]),
    ] {
        let path = folder.path(name);
        let warned = warnings(|| scene.write(&path).expect("files"));
        assert!(warned.is_empty(), "{warned:?}");
        assert_eq!(folder.files(), files);
        let mut read = Scene::new();
        let warned = warnings(|| read = Scene::load(&path, &Device::flex()).expect("a scene"));
        assert!(warned.is_empty(), "{warned:?}");
        let names: Vec<&str> = read.objects.iter().map(|o| o.name.as_str()).collect();
        assert_eq!(names, ["floor", "ball", "cube", "back \"\n", "lamp"]);
        assert_eq!(read.objects[2].mesh.vertices.dims(), [8, 3]);
        let ColorTexture::Constant(lamp) = &read.objects[4].materials[0].emission else {
            panic!("a texture");
        };
        let lamp = lamp.values().expect("values");
        for (l, e) in lamp.iter().zip([9.1, 8.3, 0.7]) {
            assert!((l / e - 1.0).abs() < 1e-6, "{lamp:?}");
        }
        // 16 bits of sRGB are within 2e-5 of the texels.
        let most = largest(before.iter().zip(&image(&read)).map(|(a, b)| a - b));
        assert!(most < 2e-4, "{name}: {most}");
        // Written again it is the same.
        let again = folder.path("again.glb");
        read.write(&again).expect("a file");
        let twice = Scene::load(&again, &Device::flex()).expect("a scene");
        let most = largest(image(&twice).iter().zip(&image(&read)).map(|(a, b)| a - b));
        assert!(most < 1e-5, "{name}: {most}");
        std::fs::remove_file(again).expect("removed");
    }
}

#[test]
fn a_scene_reads_back_from_ply_to_the_same_image() {
    let folder = Folder::new("ply-scene");
    let device = Device::flex();
    let ball = shapes::icosphere(1, &device).smooth_normals();
    let cube = faceted(
        shapes::cube(&device)
            .scaled(0.4)
            .translated([0.9, 0.6, 0.8]),
    );
    let scene = Scene::new()
        .with_object(Object::new(ball))
        .with_object(Object::new(cube).with_name("cube"))
        .with_environment([1.0, 0.5, 0.25]);
    let path = folder.path("two.ply");
    let warned = warnings(|| scene.write(&path).expect("a file"));
    assert!(
        warned.len() == 1 && warned[0].contains("environment"),
        "{warned:?}"
    );
    let read = Scene::load(&path, &device).expect("a scene");
    assert_eq!(read.objects.len(), 1);
    let read = read.with_environment([1.0, 0.5, 0.25]);
    let most = largest(image(&scene).iter().zip(&image(&read)).map(|(a, b)| a - b));
    assert!(most < 1e-5, "{most}");
}

#[test]
fn meshes_keep_every_bit() {
    let folder = Folder::new("binary-mesh");
    let device = Device::flex();
    let ball = shapes::icosphere(2, &device);
    let ball = ball.clone().with_vertices(ball.vertices / 3.0);
    for name in ["ball.ply", "ball.glb"] {
        let path = folder.path(name);
        ball.write(&path).expect("a file");
        let read = Scene::load(&path, &device).expect("a scene");
        let read = &read.object("ball").expect("named like the file").mesh;
        assert_eq!(read.faces.len(), ball.faces.len());
        let (was, is) = (values(&ball.vertices), values(&read.vertices));
        for (a, b) in ball.faces.iter().zip(read.faces.iter()) {
            for (&a, &b) in a.iter().zip(b) {
                let at = |list: &[f64], row: u32| list[3 * row as usize..][..3].to_vec();
                assert_eq!(at(&was, a), at(&is, b), "{name}");
            }
        }
        if name == "ball.ply" {
            assert_eq!(*read.faces, *ball.faces);
        }
    }
    let double = ball.cast(DType::F64);
    let double = double.clone().with_vertices(double.vertices.clone() / 7.0);
    let path = folder.path("double.ply");
    double.write(&path).expect("a file");
    let bytes = std::fs::read(&path).expect("bytes");
    let end = b"end_header\n";
    let start = bytes.windows(end.len()).position(|w| w == end);
    let body = &bytes[start.expect("a header") + end.len()..];
    let numbers = body
        .chunks_exact(8)
        .map(|b| f64::from_le_bytes(b.try_into().expect("8")));
    let count = 3 * double.vertices.dims()[0];
    assert_eq!(
        numbers.take(count).collect::<Vec<_>>(),
        values(&double.vertices)
    );
}

#[test]
fn what_is_lost_warns() {
    let folder = Folder::new("binary-losses");
    let device = Device::flex();
    let wandered = Tensor::<1>::from_floats([-0.01, 0.5, 1.2], &device);
    let cube = |name: &str| Object::new(shapes::cube(&device)).with_name(name);
    let bright = texels([1, 2, 3], |i| i as f32 / 2.0);
    let tiled = |mesh: Mesh| mesh.clone().with_uvs(mesh.vertices.narrow(1, 0, 2));
    let nothing = Mesh::from_host(&[[0.0; 3]], Vec::new(), &device);
    let scene = Scene::new()
        .with_object(cube("still").with_material(Material::diffuse(wandered)))
        .with_object(cube("moving").with_velocity([0.5, 0.0, 0.0]))
        .with_object(
            cube("bright")
                .map_mesh(tiled)
                .with_material(Material::diffuse(ColorTexture::texture(bright))),
        )
        .with_object(Object::new(nothing).with_name("empty"));
    let warned = warnings(|| scene.write(folder.path("a.glb")).expect("a file"));
    for (part, of) in [
        ("no faces", "empty"),
        ("velocity [0.5, 0.0, 0.0]", "moving"),
        ("written as [0.0, 0.5, 1.0]", "still, material material"),
        ("clipped", "bright, material material"),
    ] {
        let found = warned.iter().filter(|w| w.contains(part) && w.contains(of));
        assert_eq!(found.count(), 1, "{part}: {warned:?}");
    }
    assert_eq!(warned.len(), 4, "{warned:?}");
    let warned = warnings(|| scene.write(folder.path("a.ply")).expect("a file"));
    assert!(
        warned.iter().any(|w| w.contains("textures, gloss")),
        "{warned:?}"
    );
}
