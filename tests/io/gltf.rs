//! glTF files: what of them becomes the scene.

use crate::common;
use crate::common::errors::{message, says};
use crate::common::folder::Folder;
use crate::common::materials::base;
use crate::common::mistakes::warnings;
use crate::gltf_maker::{Gltf, data_uri};
use crate::written::constant;
use glam::DVec3;
use serde_json::{Value, json};
use softray::prelude::*;

fn load(file: &Gltf) -> softray::Result<Scene> {
    let folder = Folder::new("gltf");
    let path = folder.write(
        &format!("{:?}.glb", std::thread::current().id()),
        file.glb(),
    );
    Scene::load(path, &Device::flex())
}

/// The corners of all faces of an object.
fn triangles(object: &Object) -> Vec<[[f64; 3]; 3]> {
    let vertices = object.mesh.host_vertices().expect("values");
    let of = |f: &[u32; 3]| f.map(|v| vertices[v as usize]);
    object.mesh.faces.iter().map(of).collect()
}

fn area(object: &Object) -> DVec3 {
    let of = |t: &[[f64; 3]; 3]| {
        let [a, b, c] = t.map(DVec3::from);
        0.5 * (b - a).cross(c - a)
    };
    triangles(object).iter().map(of).sum()
}

fn near(a: impl Into<DVec3>, b: impl Into<DVec3>) {
    let (a, b) = (a.into(), b.into());
    assert!((a - b).length() < 1e-6, "{a} {b}");
}

fn png() -> Vec<u8> {
    let mut image = image::RgbaImage::new(2, 1);
    image.put_pixel(0, 0, image::Rgba([255, 0, 128, 255]));
    image.put_pixel(1, 0, image::Rgba([0, 64, 255, 0]));
    let mut bytes = std::io::Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, image::ImageFormat::Png)
        .expect("a PNG file");
    bytes.into_inner()
}

#[test]
fn triangles_strips_and_fans() {
    let of = |mode: Option<u32>, corners: Option<&[u16]>| {
        let mut file = Gltf::square();
        let primitive = "/meshes/0/primitives/0";
        if let Some(corners) = corners {
            let indices = file.indices(corners);
            file.json.pointer_mut(primitive).expect("it")["indices"] = json!(indices);
        } else {
            let json = file.json.pointer_mut(primitive).expect("it");
            json.as_object_mut().expect("it").remove("indices");
        }
        if let Some(mode) = mode {
            file.json.pointer_mut(primitive).expect("it")["mode"] = json!(mode);
        }
        load(&file)
    };
    for (mode, corners, faces) in [
        (None, Some(&[0, 1, 2, 0, 2, 3][..]), 2),
        (Some(4), Some(&[0, 1, 2, 0, 2, 3, 1][..]), 2),
        (Some(5), Some(&[0, 1, 3, 2][..]), 2),
        // Joined by triangles without area, which are left out.
        (Some(5), Some(&[0, 1, 2, 2, 2, 3, 0][..]), 2),
        (Some(6), Some(&[0, 1, 2, 3][..]), 2),
        (Some(6), None, 2),
    ] {
        let scene = of(mode, corners).expect("a scene");
        let object = &scene.objects[0];
        assert_eq!(object.mesh.faces.len(), faces, "{mode:?} {corners:?}");
        near(area(object), DVec3::Z);
        assert_eq!(object.mesh.host_vertices().expect("values").len(), 4);
        assert_eq!(object.name, "object");
    }
    let lines = of(Some(1), None);
    assert!(matches!(lines, Err(softray::Error::NoTriangles { .. })));
}

#[test]
fn nodes_place_meshes() {
    let mut file = Gltf::square();
    let turn = (0.25 * std::f64::consts::PI).sin();
    file.json["nodes"] = json!([
        {"name": "parent", "translation": [10, 0, 0], "children": [1, 2], "scale": [2, 2, 2]},
        {"name": "turned", "mesh": 0, "rotation": [turn, 0, 0, turn]},
        {"name": "mirrored", "mesh": 0, "children": [3],
         "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 3, 0, 1]},
        {"name": "again", "mesh": 0, "scale": [-1, 1, 1]},
    ]);
    let scene = load(&file).expect("a scene");
    let names: Vec<&str> = scene.objects.iter().map(|o| o.name.as_str()).collect();
    assert_eq!(names, ["turned", "mirrored", "again"]);
    let [turned, mirrored, again] = [0, 1, 2].map(|i| &scene.objects[i]);
    // Twice as large: four times the area. From z to −y.
    near(area(turned), [0.0, -4.0, 0.0]);
    let has = |object: &Object, place: [f64; 3]| {
        let near = |p: &[f64; 3]| DVec3::from(*p).distance(place.into()) < 1e-6;
        let corners = triangles(object);
        assert!(corners.iter().flatten().any(near), "{corners:?}");
    };
    has(turned, [12.0, 0.0, 2.0]);
    // A mirror image shows its front to the same side.
    near(area(mirrored), [0.0, 0.0, 4.0]);
    near(area(again), [0.0, 0.0, 4.0]);
    has(mirrored, [8.0, 8.0, 0.0]);
    has(again, [12.0, 8.0, 0.0]);
}

/// glTF splits vertices at seams of normals; surfaces stay closed.
#[test]
fn vertices_at_one_place_are_one() {
    let mut file = Gltf::new();
    let cube = shapes::cube(&Device::flex());
    let vertices = cube.host_vertices().expect("values");
    let (mut positions, mut normals) = (Vec::new(), Vec::new());
    for face in cube.faces.iter() {
        let corners = face.map(|v| DVec3::from(vertices[v as usize]));
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        for corner in corners {
            positions.push(corner.as_vec3().to_array());
            normals.push((2.0 * normal).as_vec3().to_array());
        }
    }
    let positions = file.floats("VEC3", &positions);
    let normals = file.floats("VEC3", &normals);
    file.json["meshes"] = json!([{"primitives": [
        {"attributes": {"POSITION": positions, "NORMAL": normals}}
    ]}]);
    file.json["nodes"][0]["scale"] = json!([1, -2, 1]);
    let scene = load(&file).expect("a scene");
    let mesh = &scene.objects[0].mesh;
    assert_eq!((mesh.faces.len(), mesh.vertices.dims()[0]), (12, 8));
    // Normals point to the outside of the mirror image, too.
    let normals = mesh.normals.as_ref().expect("normals");
    let values = common::tensors::points(&normals.values);
    for (corners, rows) in triangles(&scene.objects[0])
        .iter()
        .zip(normals.faces.iter())
    {
        let [a, b, c] = corners.map(DVec3::from);
        let across = (b - a).cross(c - a);
        assert!(across.dot(a + b + c) > 0.0);
        near(across.normalize(), values[rows[0] as usize]);
    }
}

#[test]
fn materials_and_textures() {
    let folder = Folder::new("gltf-textures");
    folder.write("maps/oak wood.png", png());
    let mut file = Gltf::square();
    let view = file.view(&png());
    for image in [
        json!({"bufferView": view, "mimeType": "image/png"}),
        json!({"uri": "maps/oak%20wood.png"}),
        json!({"uri": data_uri("image/png", &png())}),
    ] {
        let mut file = Gltf {
            json: file.json.clone(),
            buffer: file.buffer.clone(),
        };
        file.push("images", image);
        file.push("samplers", json!({"wrapS": 33071, "wrapT": 33071}));
        file.push("textures", json!({"source": 0, "sampler": 0}));
        file.material(json!({
            "name": "wood", "emissiveFactor": [1, 0.5, 0],
            "pbrMetallicRoughness": {
                "baseColorTexture": {"index": 0}, "baseColorFactor": [1, 1, 0.5, 1],
                "metallicFactor": 0
            },
            "extensions": {
                "KHR_materials_specular": {"specularFactor": 0},
                "KHR_materials_emissive_strength": {"emissiveStrength": 8}
            }
        }));
        let path = folder.write(
            "scene.gltf",
            file.gltf(&data_uri("application/octet-stream", &file.buffer)),
        );
        let mut loaded = None;
        let warned = warnings(|| loaded = Some(Scene::load(&path, &Device::flex())));
        assert!(warned.is_empty(), "{warned:?}");
        let scene = loaded.expect("it").expect("a scene");
        let material = &scene.objects[0].materials[0];
        assert_eq!(material.name, "wood");
        assert_eq!(constant(&material.emission), [8.0, 4.0, 0.0]);
        let ColorTexture::Texture { texels, wrap } = base(material) else {
            panic!("no texture");
        };
        assert_eq!(*wrap, Wrap::Clamp);
        let found = HostImage::from_tensor(texels).expect("values").pixels;
        // Of sRGB 128 and 64, times the factor, which is linear.
        let expected = [1.0, 0.0, 0.5 * 0.215_860_5, 0.0, 0.051_269_46, 0.5];
        for (f, e) in found.iter().zip(expected) {
            assert!((f - e).abs() < 1e-5, "{found:?}");
        }
        // v grows upwards here.
        let mesh = &scene.objects[0].mesh;
        let uvs = common::values(&mesh.uvs.as_ref().expect("uvs").values);
        assert_eq!(uvs, [0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0]);
    }
}

/// What this crate doesn't render causes warnings, each once.
#[test]
fn what_is_not_rendered_warns() {
    let mut file = Gltf::square();
    file.push("images", json!({"uri": data_uri("image/png", &png())}));
    file.push("textures", json!({"source": 0}));
    file.material(json!({
        "alphaMode": "BLEND", "emissiveFactor": [1, 1, 1], "doubleSided": true,
        "extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.5}},
        "pbrMetallicRoughness": {"metallicFactor": 0}
    }));
    file.json["animations"] = json!([{"channels": [], "samplers": []}]);
    file.json["extensionsUsed"] = json!(["KHR_materials_clearcoat", "KHR_materials_transmission"]);
    let warned = warnings(|| load(&file).expect("a scene"));
    assert_eq!(warned.len(), 2, "{warned:?}");
    says(
        &warned[0],
        ["not read: KHR_materials_clearcoat, animations"],
    );
    says(
        &warned[1],
        [
            "not rendered",
            "alphaMode BLEND",
            "emission of back sides",
            "transmission",
        ],
    );
}

#[test]
fn texture_coordinates_of_any_kind() {
    let mut file = Gltf::square();
    file.push("images", json!({"uri": data_uri("image/png", &png())}));
    file.push("textures", json!({"source": 0}));
    // Bytes that stand for [0, 1], with gaps, in another set.
    let view = file.view(&[0, 255, 9, 9, 255, 255, 9, 9, 255, 0, 9, 9, 0, 0]);
    file.json["bufferViews"][view]["byteStride"] = json!(4);
    let uvs = file.push(
        "accessors",
        json!({"bufferView": view, "componentType": 5121, "normalized": true, "count": 4, "type": "VEC2"}),
    );
    file.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = json!(uvs);
    let texture = |transform: Value| {
        json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1,
            "extensions": {"KHR_texture_transform": transform}}}})
    };
    let mut uvs_by = |transform: Value| {
        file.material(texture(transform));
        let scene = load(&file).expect("a scene");
        common::values(&scene.objects[0].mesh.uvs.as_ref().expect("uvs").values)
    };
    assert_eq!(uvs_by(json!({})), [0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0]);
    let scaled = uvs_by(json!({"scale": [2, 1], "offset": [0.5, 0.25]}));
    assert_eq!(scaled, [0.5, -0.25, 2.5, -0.25, 2.5, 0.75, 0.5, 0.75]);
    // By a quarter about the upper left, against the clock as it is seen.
    let turned = uvs_by(json!({"rotation": 0.5 * std::f64::consts::PI}));
    let expected = [1.0, 1.0, 1.0, 2.0, 0.0, 2.0, 0.0, 1.0];
    for (t, e) in turned.iter().zip(expected) {
        assert!((t - e).abs() < 1e-6, "{turned:?}");
    }
}

#[test]
fn sparse_arrays_change_some_rows() {
    let mut file = Gltf::square();
    let indices = file.view(&[1, 3]);
    let values: Vec<u8> = [5.0f32, 0.0, 0.0, 0.0, 7.0, 0.0]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let values = file.view(&values);
    file.json["accessors"][0]["sparse"] = json!({
        "count": 2, "indices": {"bufferView": indices, "componentType": 5121},
        "values": {"bufferView": values}
    });
    let vertices = |file: &Gltf| {
        let scene = load(file).expect("a scene");
        scene.objects[0].mesh.host_vertices().expect("values")
    };
    let expected = [[0.0; 3], [5.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 7.0, 0.0]];
    assert_eq!(vertices(&file), expected);
    // Without a base all other rows are 0.
    let accessor = file.json["accessors"][0].as_object_mut().expect("it");
    accessor.remove("bufferView");
    assert_eq!(
        vertices(&file),
        [[0.0; 3], [5.0, 0.0, 0.0], [0.0, 7.0, 0.0]]
    );
}

#[test]
fn cameras() {
    let mut file = Gltf::square();
    file.push(
        "cameras",
        json!({"type": "perspective", "perspective": {"yfov": 0.5, "aspectRatio": 2, "znear": 1}}),
    );
    file.push(
        "cameras",
        json!({"type": "orthographic",
               "orthographic": {"xmag": 3, "ymag": 1.5, "znear": 0, "zfar": 9}}),
    );
    let turn = (0.25 * std::f64::consts::PI).sin();
    file.push(
        "nodes",
        json!({"name": "eye", "camera": 0, "translation": [0, 0, 5], "scale": [3, 3, 3]}),
    );
    file.push(
        "nodes",
        json!({"camera": 1, "translation": [0, 4, 0], "rotation": [-turn, 0, 0, turn]}),
    );
    file.json["scenes"][0]["nodes"] = json!([0, 1, 2]);
    let folder = Folder::new("gltf-cameras");
    let path = folder.write("scene.glb", file.glb());
    let found = SceneFile::load(&path, &Device::flex()).expect("a scene");
    let names: Vec<&str> = found.cameras.iter().map(|c| c.0.as_str()).collect();
    assert_eq!(names, ["eye", "camera 2"]);
    assert_eq!((found.width, found.height), (512, 256));
    let place = |c: &Camera| {
        let (eye, target) = (
            c.eye.values().expect("values"),
            c.target.values().expect("values"),
        );
        (DVec3::from(eye), DVec3::from(target) - DVec3::from(eye))
    };
    let (eye, forward) = place(&found.camera);
    near(eye, [0.0, 0.0, 5.0]);
    near(forward, DVec3::NEG_Z);
    assert!((common::fov(&found.camera) - 0.5f64.to_degrees()).abs() < 1e-5);
    // It looks down.
    let (eye, forward) = place(&found.cameras[1].1);
    near(eye, [0.0, 4.0, 0.0]);
    near(forward, DVec3::NEG_Y);
    let Projection::Orthographic { height } = &found.cameras[1].1.projection else {
        panic!("no parallel rays");
    };
    assert_eq!(height.values().expect("a number"), [3.0]);
    // The square is seen in the middle of the image.
    let options = RenderOptions::new(8, 8).with_samples(4).with_bounces(0);
    let scene = found.scene.with_environment([1.0; 3]);
    let image = render(&scene, &found.camera, &options).expect("an image");
    let rows = HostImage::from_tensor(&image.radiance).expect("values");
    let at = |x: usize, y: usize| rows.pixels[3 * (8 * y + x)];
    assert!(at(4, 3) < 0.9 && at(0, 0) > 0.99 && at(3, 4) > 0.99);
}

/// A file without scenes shows all of its nodes.
#[test]
fn files_without_scenes_and_materials() {
    let mut file = Gltf::square();
    let json = file.json.as_object_mut().expect("it");
    json.remove("scene");
    json.remove("scenes");
    let scene = load(&file).expect("a scene");
    let material = &scene.objects[0].materials[0];
    assert_eq!(
        constant(base(material)),
        constant(base(&Material::default()))
    );
    file.json["nodes"] = json!([]);
    let none = load(&file);
    assert!(matches!(none, Err(softray::Error::NoTriangles { .. })));
    let text = message(none);
    assert!(!text.contains("lines that begin"), "{text}");
}
