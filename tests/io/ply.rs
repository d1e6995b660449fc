//! PLY files: ascii and binary, what of them becomes the scene.

use crate::common;
use crate::common::errors::{message, says};
use crate::common::folder::Folder;
use crate::common::materials::base;
use crate::common::mistakes::warnings;
use softray::prelude::*;

fn load(name: &str, bytes: impl AsRef<[u8]>) -> softray::Result<Scene> {
    let folder = Folder::new(&format!("ply-{name}"));
    Scene::load(folder.write("scan.ply", bytes), &Device::flex())
}

fn vertices(scene: &Scene) -> Vec<[f64; 3]> {
    scene.objects[0].mesh.host_vertices().expect("values")
}

/// A square and a triangle, with a property that is not known before and after each that is.
fn header(format: &str) -> String {
    format!(
        "ply\nformat {format} 1.0\ncomment made by hand\nelement vertex 5\nproperty uchar quality\n\
         property float x\nproperty double y\nproperty short z\nproperty list uchar ushort more\n\
         element edge 1\nproperty int a\nelement face 2\nproperty uint flags\n\
         property list uchar int vertex_indices\nproperty char last\nend_header\n"
    )
}

const VERTICES: [[f64; 3]; 5] = [
    [0.0, 0.0, 0.0],
    [1.5, 0.25, 0.0],
    [1.0, 1.0, -3.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 2.0],
];

fn ascii() -> Vec<u8> {
    let mut text = header("ascii");
    for (i, [x, y, z]) in VERTICES.iter().enumerate() {
        let more = vec!["7"; i % 3].join(" ");
        text += &format!("{i} {x} {y} {z} {} {more}\n", i % 3);
    }
    text += "5\n9 4 0 1 2 3 -1\n9 3 0 1 4 -1\n";
    text.into_bytes()
}

fn binary(big: bool) -> Vec<u8> {
    let mut bytes = header(match big {
        true => "binary_big_endian",
        false => "binary_little_endian",
    })
    .into_bytes();
    let mut put = |mut value: Vec<u8>| {
        if big {
            value.reverse();
        }
        bytes.extend(value);
    };
    for (i, [x, y, z]) in VERTICES.iter().enumerate() {
        put(vec![i as u8]);
        put((*x as f32).to_le_bytes().into());
        put(y.to_le_bytes().into());
        put((*z as i16).to_le_bytes().into());
        put(vec![(i % 3) as u8]);
        for _ in 0..i % 3 {
            put(7u16.to_le_bytes().into());
        }
    }
    put(5i32.to_le_bytes().into());
    for face in [&[0i32, 1, 2, 3][..], &[0, 1, 4]] {
        put(9u32.to_le_bytes().into());
        put(vec![face.len() as u8]);
        for i in face {
            put(i.to_le_bytes().into());
        }
        put(vec![0xff]);
    }
    bytes
}

#[test]
fn all_formats_hold_the_same() {
    for (name, bytes) in [
        ("ascii", ascii()),
        ("little", binary(false)),
        ("big", binary(true)),
    ] {
        let scene = load(name, bytes).expect("a scene");
        assert_eq!(vertices(&scene), VERTICES, "{name}");
        assert_eq!(scene.objects[0].name, "scan");
        let faces = &scene.objects[0].mesh.faces;
        assert_eq!(faces.len(), 3, "{name}");
        assert_eq!(faces[2], [0, 1, 4]);
    }
}

#[test]
fn concave_polygons_are_filled() {
    // Its fan from the first corner would cover more.
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
                property float z\nelement face 1\nproperty list uchar uint vertex_index\nend_header\n\
                2 0 0\n0 1 0\n0.5 0 0\n0 -1 0\n4 0 1 2 3\n";
    let scene = load("concave", text).expect("a scene");
    let v = vertices(&scene).map_points();
    let faces = &scene.objects[0].mesh.faces;
    let area: f64 = faces
        .iter()
        .map(|f| {
            let [a, b, c] = f.map(|i| v[i as usize]);
            0.5 * (b - a).cross(c - a).length()
        })
        .sum();
    assert!((area - 1.5).abs() < 1e-9, "{area}");
}

trait Points {
    fn map_points(self) -> Vec<glam::DVec3>;
}

impl Points for Vec<[f64; 3]> {
    fn map_points(self) -> Vec<glam::DVec3> {
        self.into_iter().map(glam::DVec3::from).collect()
    }
}

#[test]
fn normals_and_texture_coordinates() {
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                property float z\nproperty float nx\nproperty float ny\nproperty float nz\n\
                property float s\nproperty float t\nelement face 1\n\
                property list uchar int vertex_indices\nend_header\n\
                0 0 0 0 0 1 0 0\n1 0 0 0 0.6 0.8 1 0\n0 1 0 0 1 0 0 1\n3 0 1 2\n";
    let scene = load("attributes", text).expect("a scene");
    let mesh = &scene.objects[0].mesh;
    let normals = mesh.normals.as_ref().expect("normals");
    let expected: [f64; 9] = [0.0, 0.0, 1.0, 0.0, 0.6, 0.8, 0.0, 1.0, 0.0];
    for (n, e) in common::values(&normals.values).iter().zip(expected) {
        assert!((n - e).abs() < 1e-7);
    }
    let uvs = mesh.uvs.as_ref().expect("texture coordinates");
    assert_eq!(common::values(&uvs.values), [0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
}

/// MeshLab's coordinates of corners, and its name of a texture.
#[test]
fn textures_of_scans() {
    let folder = Folder::new("ply-texture");
    let mut image = image::RgbImage::new(1, 1);
    image.put_pixel(0, 0, image::Rgb([255, 128, 0]));
    image.save(folder.path("a b.png")).expect("a PNG file");
    let text = |name: &str| {
        format!(
            "ply\nformat ascii 1.0\ncomment TextureFile {name}\nelement vertex 4\nproperty float x\n\
             property float y\nproperty float z\nelement face 1\n\
             property list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n\
             0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3 8 0 0 1 0 1 1 0 1\n"
        )
    };
    let path = folder.write("inner/scan.ply", text("../a b.png"));
    let device = Device::flex();
    says(
        message(Scene::load(&path, &device)),
        ["lies outside", "a b.png"],
    );
    let path = folder.write("scan.ply", text("a b.png"));
    let scene = Scene::load(path, &device).expect("a scene");
    let object = &scene.objects[0];
    assert_eq!(object.mesh.uvs.as_ref().expect("uvs").faces.len(), 2);
    let ColorTexture::Texture { texels, .. } = base(&object.materials[0]) else {
        panic!("no texture");
    };
    let texels = common::values(texels);
    assert!((texels[1] - 0.215_860_5).abs() < 1e-6, "{texels:?}");
}

#[test]
fn vertex_colors() {
    let text = |kind: &str, rows: [&str; 3]| {
        let [a, b, c] = rows;
        format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
             property float z\nproperty {kind} red\nproperty {kind} green\nproperty {kind} blue\n\
             element face 1\nproperty list uchar int vertex_indices\nend_header\n\
             0 0 0 {a}\n1 0 0 {b}\n0 1 0 {c}\n3 0 1 2\n"
        )
    };
    let dark = 0.215_860_5;
    for (kind, rows, expected) in [
        // Bytes are sRGB.
        (
            "uchar",
            ["255 0 0", "0 128 0", "0 0 255"],
            [1.0, 0.0, 0.0, 0.0, dark, 0.0, 0.0, 0.0, 1.0],
        ),
        (
            "float",
            ["0.5 0 0", "0 2 0", "0 0 1"],
            [0.5, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0],
        ),
    ] {
        let mut scene = Scene::new();
        let warned = warnings(|| scene = load("colors", text(kind, rows)).expect("a scene"));
        assert!(warned.is_empty(), "{warned:?}");
        let object = &scene.objects[0];
        let colors = object.mesh.colors.as_ref().expect("colors");
        for (c, e) in common::values(&colors.values).iter().zip(expected) {
            assert!((c - e).abs() < 1e-6, "{kind}: {c} {e}");
        }
        let ColorTexture::Constant(albedo) = base(&object.materials[0]) else {
            panic!("a texture");
        };
        assert_eq!(albedo.values().expect("a color"), [1.0; 3]);
        // Written and read they are the same.
        let folder = Folder::new(&format!("ply-colors-{kind}"));
        let path = folder.path("scan.ply");
        scene.write(&path).expect("a file");
        let written = std::fs::read(&path).expect("bytes");
        let property = format!("property {kind} red");
        assert!(
            written
                .windows(property.len())
                .any(|w| w == property.as_bytes())
        );
        let back = Scene::load(&path, &Device::flex()).expect("a scene");
        let again = back.objects[0].mesh.colors.as_ref().expect("colors");
        assert_eq!(
            common::values(&again.values),
            common::values(&colors.values)
        );
    }
}

#[test]
fn mistakes_are_named() {
    let head = |elements: &str| format!("ply\nformat ascii 1.0\n{elements}end_header\n");
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    let list = "property list uchar int vertex_indices\n";
    let mesh = |face: &str| {
        let head = head(&format!("element vertex 3\n{xyz}element face 1\n{list}"));
        format!("{head}0 0 0\n1 0 0\n0 1 0\n{face}\n")
    };
    let points = head(&format!("element vertex 2\n{xyz}"));
    for (text, parts) in [
        ("nothing".into(), ["no PLY file", "scan.ply"]),
        ("plain\n".into(), ["line 1", "no PLY file"]),
        ("ply\nformat ascii 1.0\n".into(), ["end_header", ""]),
        ("ply\nend_header\n".into(), ["no format", ""]),
        (
            "ply\nformat utf8 1.0\nend_header\n".into(),
            ["line 2", "utf8"],
        ),
        (head("property float x\n"), ["line 3", "before any element"]),
        (head("element vertex many\n"), ["line 3", "many"]),
        (
            head("element vertex 1\nproperty half x\n"),
            ["line 4", "half"],
        ),
        (
            head("element vertex 0\nproperty float x\n"),
            ["vertex", "x, y and z"],
        ),
        (
            format!("{points}0 0 0\n1 1 1\n"),
            ["2 vertices", "no faces"],
        ),
        (
            format!("{points}0 0 0\n1 1\n"),
            ["element vertex", "claims 2 rows"],
        ),
        (
            format!("{points}0.12345 0 0\n1 1\n"),
            ["vertex 1, property z", "ends"],
        ),
        (
            format!("{points}0 0 0\n1 x 1\n"),
            ["vertex 1, property y", "\"x\""],
        ),
        (mesh("2 0 1"), ["face 0", "2 corners"]),
        (mesh("3 0 1 3"), ["face 0", "index 3 is out of range"]),
        (mesh("3 0 1 -1"), ["face 0", "index -1"]),
        (mesh("3 0 1 0.5"), ["face 0", "index 0.5"]),
        (
            mesh("-3 0 1 2"),
            ["face 0, property vertex_indices", "length is -3"],
        ),
        (
            mesh("99 0 1 2"),
            ["face 0, property vertex_indices", "length is 99"],
        ),
    ] {
        let error = message(load("mistakes", &text));
        says(&error, parts);
    }
    // A claim is not believed.
    let huge = head(&format!("element vertex 4000000000000\n{xyz}"));
    says(message(load("huge", huge)), ["claims 4000000000000 rows"]);
    let no_values =
        head("element vertex 3\nproperty float x\nelement nothing 18446744073709551615\n");
    assert!(load("nothing", no_values).is_err());
}

/// Old writers put more into a line than the header says; where each row has a line the rest of it is left out.
#[test]
fn lines_with_more_than_the_header_says() {
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                  property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let folder = Folder::new("ply-lines");
    let load = |rows: &str| {
        let path = folder.write("a.ply", format!("{header}{rows}"));
        Scene::load(path, &Device::flex())
    };
    let scene = load("0 0 0 7\n1 0 0 7\n0 1 0 7\n3 0 1 2 9 1 1 1\n").expect("a scene");
    let corners = scene.objects[0].mesh.host_vertices().expect("values");
    assert_eq!(corners, [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!(*scene.objects[0].mesh.faces, [[0, 1, 2]]);
    // Rows that share lines are read as numbers, one after the other.
    let scene = load("0 0 0 1 0 0\n0 1 0\n3 0 1 2\n").expect("a scene");
    assert_eq!(
        scene.objects[0].mesh.host_vertices().expect("values"),
        corners
    );
}
