//! OBJ and MTL files, written and read back.

mod exporters;
mod sums;

use std::fs;
use std::path::Path;

use crate::common;
use crate::common::errors::{message, says};
use crate::common::folder::Folder;
use crate::common::materials::{base, model, roughness, specular};
use crate::common::tensors::points;
use crate::written::constant;
use softray::prelude::*;

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

fn vertices(object: &Object) -> Vec<[f64; 3]> {
    object.mesh.host_vertices().expect("values")
}

#[test]
fn objects_and_materials() {
    let folder = Folder::new("objects");
    folder.write(
        "some materials.mtl",
        "# comment\nnewmtl red\nKa 1 1 1\nKd 0.8 0.1 0.05\n\nnewmtl lamp\nKd 0 0 0\nKe 17 12 4\n\
         newmtl gloss\nKd 0.5\nKs 0.25 0.25 0.2\nNs 40\nillum 2\nnewmtl bare\n",
    );
    let scene = folder
        .load(format!(
            "mtllib some materials.mtl\no first\n{SQUARE}usemtl red\nf 1 2 3\nusemtl gloss\nf 1 3 4\n\
             g second\nv 0 0 2\nv 1 0 2\nv 0 1 2\nusemtl lamp\nf 5 6 7\nusemtl bare\nf 5 7 6\n\
             o first\nusemtl red\nf 2 1 4\nusemtl unknown\nf 4 3 2\n"
        ))
        .expect("a scene");
    let names: Vec<_> = scene.objects.iter().map(|o| o.name.as_str()).collect();
    assert_eq!(names, ["first", "second"]);

    let first = &scene.objects[0];
    let materials: Vec<_> = first.materials.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(materials, ["red", "gloss", "unknown"]);
    assert_eq!(*first.face_materials, [0, 1, 0, 2]);
    // Four vertices for all pieces, in the order of their first use.
    assert_eq!(vertices(first).len(), 4);
    assert_eq!(
        *first.mesh.faces,
        [[0, 1, 2], [0, 2, 3], [1, 0, 3], [3, 2, 1]]
    );
    assert_eq!(constant(base(&first.materials[0])), [0.8, 0.1, 0.05]);
    let gloss = &first.materials[1];
    let Bsdf::Phong {
        diffuse,
        specular,
        shininess,
    } = &gloss.bsdf
    else {
        panic!("{gloss:?}");
    };
    assert_eq!(constant(diffuse), [0.5; 3]);
    assert_eq!(constant(specular), [0.25, 0.25, 0.2]);
    assert_eq!(shininess.values().expect("values"), [40.0]);
    let gray = constant(base(&Material::default()));
    assert_eq!(constant(base(&first.materials[2])), gray);

    let second = &scene.objects[1];
    assert_eq!(
        vertices(second),
        [[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [0.0, 1.0, 2.0]]
    );
    let lamp = &second.materials[0];
    assert_eq!(constant(&lamp.emission), [17.0, 12.0, 4.0]);
    assert_eq!(constant(base(lamp)), [0.0; 3]);
    assert_eq!(constant(base(&second.materials[1])), gray);
}

#[test]
fn textures_are_decoded() {
    let folder = Folder::new("textures");
    fs::create_dir_all(folder.path("maps")).expect("a folder");
    let mut image = image::RgbImage::new(2, 1);
    image.put_pixel(0, 0, image::Rgb([255, 0, 128]));
    image.put_pixel(1, 0, image::Rgb([0, 64, 255]));
    image
        .save(folder.path("maps/wood fine.png"))
        .expect("a PNG file");
    folder.write(
        "maps/wood.mtl",
        "newmtl wood\nmap_Kd -s 1 1 1 -clamp off wood fine.png\nnewmtl unused\nmap_Kd none.png\n",
    );
    let scene = folder
        .load(format!(
            "mtllib maps\\wood.mtl\n{SQUARE}vt 0 0\nvt 1 0\nvt 1 1\nusemtl wood\nf 1/1 2/2 3/3\n"
        ))
        .expect("a scene");
    let ColorTexture::Texture { texels, .. } = base(&scene.objects[0].materials[0]) else {
        panic!("no texture");
    };
    assert_eq!(texels.dims(), [1, 2, 3]);
    let found = HostImage::from_tensor(texels).expect("values").pixels;
    // Of sRGB 128 and 64.
    let expected = [1.0, 0.0, 0.215_860_5, 0.0, 0.051_269_46, 1.0];
    for (f, e) in found.iter().zip(expected) {
        assert!((f - e).abs() < 1e-5, "{found:?}");
    }
}

#[test]
fn maps_of_gloss_and_clamped_textures() {
    let folder = Folder::new("gloss");
    let mut image = image::RgbImage::new(1, 1);
    image.put_pixel(0, 0, image::Rgb([255, 255, 0]));
    image.save(folder.path("a.png")).expect("a PNG file");
    image.put_pixel(0, 0, image::Rgb([0, 0, 255]));
    image.save(folder.path("blue.png")).expect("a PNG file");
    folder.write(
        "m.mtl",
        "newmtl tinted\nKs 0.5 0.25 1\nmap_Ks a.png\nNs 9\nmap_Kd -clamp on blue.png\n\
         newmtl whole\nKd 0\nmap_Ks -clamp on a.png\nKe 3 2 1\nmap_Ke -clamp on a.png\n\
         newmtl none\nKs 0\nmap_Ks a.png\nmap_Ke a.png\n",
    );
    let scene = folder
        .load(format!(
            "mtllib m.mtl\n{SQUARE}vt 0 0\nusemtl tinted\nf 1/1 2/1 3/1\nusemtl whole\n\
             f 1/1 2/1 3/1\nusemtl none\nf 1/1 2/1 3/1\n"
        ))
        .expect("a scene");
    let texture = |albedo: &ColorTexture| match albedo {
        ColorTexture::Texture { texels, wrap } => {
            let image = HostImage::from_tensor(texels).expect("values");
            (image.pixels, *wrap)
        }
        ColorTexture::Constant(_) => panic!("a constant"),
    };
    let [tinted, whole, none] = &scene.objects[0].materials[..] else {
        panic!("three materials");
    };
    assert_eq!(
        texture(specular(tinted)),
        (vec![0.5, 0.25, 0.0], Wrap::Repeat)
    );
    assert_eq!(texture(base(tinted)), (vec![0.0, 0.0, 1.0], Wrap::Clamp));
    assert_eq!(texture(specular(whole)), (vec![1.0, 1.0, 0.0], Wrap::Clamp));
    assert_eq!(constant(specular(none)), [0.0; 3]);
    assert_eq!(texture(&whole.emission), (vec![3.0, 2.0, 0.0], Wrap::Clamp));
    assert_eq!(texture(&none.emission), (vec![1.0, 1.0, 0.0], Wrap::Repeat));
    assert_eq!(constant(&tinted.emission), [0.0; 3]);
}

#[test]
fn polygons_and_negative_indices() {
    let folder = Folder::new("polygons");
    let scene = folder
        .load(format!(
            "{SQUARE}v -1 0.5 0\nf -5 -4 -3 \\\n -2 -1 # five corners\nl 1 2 3\np 1\nf 1 2 3 4\n"
        ))
        .expect("a scene");
    let object = &scene.objects[0];
    let expected = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 1, 2], [0, 2, 3]];
    assert_eq!(*object.mesh.faces, expected);
    assert_eq!(vertices(object)[4], [-1.0, 0.5, 0.0]);
}

/// A fan of this arrow is 11 % off in area.
#[test]
fn concave_polygons() {
    let folder = Folder::new("concave");
    let text = "v 0 0 0\nv -1 2 0\nv -1.5 -1 0\nv 2 0 0\nf 1 2 3 4\n";
    let scene = folder.load(text).expect("a scene");
    let mesh = &scene.objects[0].mesh;
    let at = points(&mesh.vertices);
    let area = |f: &[u32; 3]| {
        let [a, b, c] = f.map(|v| at[v as usize]);
        0.5 * (b - a).cross(c - a).length()
    };
    let found: f64 = mesh.faces.iter().map(area).sum();
    assert!((found - 3.0).abs() < 1e-9, "{found}");
}

#[test]
fn attributes_are_optional() {
    let folder = Folder::new("attributes");
    let corners = "vt 0 0\nvt 1 0\nvt 0.25 1\nvn 0 0 1\nvn 0 1 1\n";
    let scene = folder
        .load(format!(
            "{SQUARE}{corners}o all\nf 1/3/1 2/1/1 3/2/2\no uvs\nf 1/1 2/2 3/3\n\
             o normals\nf 1//2 2//1 3//1\no none\nf 1 2 3\n\
             o some\nf 1/1/1 2/2/1 3/3/1\nf 1 3 4\n"
        ))
        .expect("a scene");
    let has = |name: &str| {
        let mesh = &scene.object(name).expect("an object").mesh;
        (mesh.uvs.is_some(), mesh.normals.is_some())
    };
    assert_eq!(has("all"), (true, true));
    assert_eq!(has("uvs"), (true, false));
    assert_eq!(has("normals"), (false, true));
    assert_eq!(has("none"), (false, false));
    assert_eq!(has("some"), (false, false));

    let mesh = &scene.object("all").expect("an object").mesh;
    let uvs = mesh.uvs.as_ref().expect("uvs");
    let values: Vec<f64> = uvs.values.to_data().iter::<f64>().collect();
    let first = uvs.faces[0][0] as usize;
    assert_eq!(values[2 * first..2 * first + 2], [0.25, 1.0]);
    let normals = mesh.normals.as_ref().expect("normals");
    assert_eq!(*normals.faces, [[0, 0, 1]]);

    let zero = folder.load(format!("{SQUARE}vn 0 0 0\nf 1//1 2//1 3//1\n"));
    assert!(zero.expect("a scene").objects[0].mesh.normals.is_none());
}

#[test]
fn shared_vertices_stay_shared() {
    let folder = Folder::new("cube");
    folder.write(
        "cube.mtl",
        "newmtl a\nKd 0.1 0.1 0.1\nnewmtl b\nKd 0.2 0.2 0.2\n",
    );
    let mut obj = String::from("mtllib cube.mtl\no cube\n");
    for i in 0..8 {
        obj += &format!("v {} {} {}\n", i & 1, (i >> 1) & 1, i >> 2);
    }
    // A ninth vertex that no face has.
    obj += "v 9 9 9\n";
    let sides = [
        "1 5 7 3", "2 4 8 6", "1 2 6 5", "3 7 8 4", "1 3 4 2", "5 6 8 7",
    ];
    for (i, side) in sides.iter().enumerate() {
        obj += &format!("usemtl {}\nf {side}\n", ["a", "b"][i % 2]);
    }
    let scene = folder.load(&obj).expect("a scene");
    let cube = &scene.objects[0];
    assert_eq!((scene.objects.len(), cube.materials.len()), (1, 2));
    assert_eq!(vertices(cube).len(), 8);
    assert_eq!(*cube.face_materials, [0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1]);
    // Closed: each directed edge has its opposite.
    let edges: Vec<_> = cube
        .mesh
        .faces
        .iter()
        .flat_map(|f| [(f[0], f[1]), (f[1], f[2]), (f[2], f[0])])
        .collect();
    assert!(edges.iter().all(|&(p, q)| edges.contains(&(q, p))));
}

#[test]
fn errors_name_file_and_field() {
    let folder = Folder::new("errors");
    let missing = Scene::load(folder.path("none.obj"), &Device::flex());
    says(message(missing), ["none.obj"]);

    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    for (tail, parts) in [
        ("f 1 2 x\n", ["scene.obj", "line 4", "v/vt/vn"]),
        ("v 1 zero 0\nf 1 2 3\n", ["scene.obj", "line 4", "position"]),
        ("vn 1\nf 1 2 3\n", ["scene.obj", "line 4", "normal"]),
        ("f 1 2\n", ["scene.obj", "line 4", "2 corners"]),
        ("f 1 2 4\n", ["scene.obj", "v index 4", "out of range"]),
        ("f 1 2 0\n", ["scene.obj", "v index 0", "out of range"]),
        ("f 1 2 -4\n", ["scene.obj", "v index -4", "out of range"]),
        (
            "f 1/1 2/1 3/1\n",
            ["scene.obj", "vt index 1", "out of range"],
        ),
        (
            "vn 0 0 1\nf 1//-9 2//1 3//1\n",
            ["scene.obj", "vn index -9", "out of range"],
        ),
        (
            "mtllib none.mtl\nf 1 2 3\n",
            ["none.mtl", "scene.obj", "line 4"],
        ),
    ] {
        says(
            message(strict(&folder, &format!("{triangle}{tail}"))),
            parts,
        );
    }
    assert!(matches!(
        folder.load(triangle),
        Err(softray::Error::NoTriangles { .. })
    ));

    for (material, parts) in [
        ("newmtl m\nKd 0.1 0.2\n", ["m.mtl", "line 2", "Kd"]),
        ("newmtl m\n\nNs shiny\n", ["m.mtl", "line 3", "Ns"]),
        ("newmtl\n", ["m.mtl", "line 1", "newmtl"]),
        ("Kd 1 1 1\n", ["m.mtl", "line 1", "Kd"]),
        ("newmtl m\nmap_Kd none.png\n", ["none.png", "", ""]),
        ("newmtl m\nmap_Kd m.mtl\n", ["m.mtl", "", "decoded"]),
    ] {
        folder.write("m.mtl", material);
        let text = format!("mtllib m.mtl\nusemtl m\n{triangle}vt 0 0\nf 1/1 2/1 3/1\n");
        says(message(strict(&folder, &text)), parts);
    }
}

/// Loads an OBJ file; what would be a warning is an error.
fn strict(folder: &Folder, obj: &str) -> softray::Result<Scene> {
    let limits = LoadLimits::default().with_strict(true);
    Scene::load_within(folder.write("scene.obj", obj), &Device::flex(), &limits)
}

fn scene_file(folder: &Folder, tail: &str) -> softray::Result<SceneFile> {
    folder.write("scene.obj", format!("o ball\n{SQUARE}f 1 2 3 4\n"));
    let text = format!(
        r#"{{ "obj": "scene.obj", "samples_per_pixel": 4,
             "camera": {{ "eye": [0, 1, 4], "target": [0, 1, 0], "up": [0, 1, 0],
                          "fov_y_degrees": 35, "width": 12, "height": 8 {tail} }}"#
    );
    SceneFile::load(folder.write("scene.json", &text), &Device::flex())
}

#[test]
fn scene_files() {
    let folder = Folder::new("json");
    // The tail closes the camera.
    let full = r#", "aperture_radius": 0.2, "focus_distance": 3 }, "environment": [1, 2, 3],
        "velocities": { "ball": [0.5, 0, -1] },
        "materials": { "ball": { "bsdf": "metallic_roughness", "roughness": "rough.png", "metallic": 0.5 } },
        "lights": [
            { "kind": "directional", "direction": [0, -2, 1], "irradiance": [1, 2, 4] },
            { "kind": "point", "position": [1, 3, 2], "intensity": [4, 5, 6] },
            { "kind": "spot", "position": [0, 3, 0], "direction": [0, -1, 0.5], "intensity": [7, 8, 9],
              "inner_degrees": 30, "outer_degrees": 60 }
        ]"#;
    let rough = HostImage::new(1, 1, vec![0.0, 1.0, 0.0]).expect("an image");
    rough.write(folder.0.join("rough.png")).expect("a file");
    let file = scene_file(&folder, full).expect("a scene");
    assert_eq!((file.width, file.height), (12, 8));
    assert_eq!(common::fov(&file.camera), 35.0);
    let lens = file.camera.lens.as_ref().expect("a lens");
    let (aperture, focus) = (&lens.aperture_radius, &lens.focus_distance);
    assert_eq!(aperture.values().expect("values"), [0.2]);
    assert_eq!(focus.values().expect("values"), [3.0]);
    assert_eq!(
        match &file.scene.environment {
            Environment::Constant(p) => p.values().expect("values"),
            Environment::Map(_) => panic!("a constant"),
        },
        [1.0, 2.0, 3.0]
    );
    let velocity = file.scene.objects[0].velocity.as_ref().expect("a velocity");
    assert_eq!(velocity.values().expect("values"), [0.5, 0.0, -1.0]);

    let material = &file.scene.objects[0].materials[0];
    assert_eq!(model(material), "metallic roughness");
    let ScalarTexture::Texture { texels, .. } = roughness(material) else {
        panic!("a texture");
    };
    assert_eq!(texels.to_data().iter::<f64>().collect::<Vec<_>>(), [1.0]);
    let lights = format!("{:?}", file.scene.lights);
    let wanted = [
        Light::directional([0.0, -2.0, 1.0], [1.0, 2.0, 4.0]),
        Light::point([1.0, 3.0, 2.0], [4.0, 5.0, 6.0]),
        Light::spot(
            [0.0, 3.0, 0.0],
            [0.0, -1.0, 0.5],
            [7.0, 8.0, 9.0],
            30.0,
            60.0,
        ),
    ];
    assert_eq!(lights, format!("{wanted:?}"));

    let plain = scene_file(&folder, "}").expect("a scene");
    assert!(plain.camera.lens.is_none() && plain.scene.objects[0].velocity.is_none());

    let unknown = scene_file(&folder, r#"}, "velocities": { "moon": [1, 0, 0] }"#);
    says(
        message(unknown),
        ["scene.json", "velocities", "moon", "ball"],
    );
    for (material, part) in [
        (
            r#"{ "bsdf": "dielectric", "ior": [1] }"#,
            "materials.ball.ior",
        ),
        (r#"{ "bsdf": "dielectric", "index": 1 }"#, "index"),
        (r#"{ "bsdf": "chrome" }"#, "chrome"),
        (
            r#"{ "bsdf": "conductor", "roughness": "../x.png" }"#,
            "x.png",
        ),
    ] {
        let tail = format!(r#"}}, "materials": {{ "ball": {material} }}"#);
        says(message(scene_file(&folder, &tail)), [part]);
    }
    says(message(scene_file(&folder, "")), ["scene.json"]);
    let none = SceneFile::load(Path::new("nowhere/scene.json"), &Device::flex());
    says(message(none), ["nowhere"]);
}
