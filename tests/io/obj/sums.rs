//! Many objects, materials and corners: linear, or an error that names a limit.

use super::SQUARE;
use crate::common::errors::{message, says};
use crate::common::folder::Folder;
use crate::common::materials::base;
use crate::written::constant;
use softray::prelude::*;

const MANY: usize = 300_000;

/// Lines for each of many numbers.
fn lines(count: usize, of: impl Fn(usize) -> String) -> String {
    (0..count).map(of).collect()
}

/// Each change of a name was a mesh of its own.
#[test]
fn names_that_alternate() {
    let folder = Folder::new("alternate");
    let ab = |i: usize| ["a", "b"][i % 2];
    let points = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    for (keyword, objects, materials) in [("o", 2, 1), ("g", 2, 1), ("usemtl", 1, 2)] {
        let faces = lines(MANY, |i| format!("{keyword} {}\nf 1 2 3\n", ab(i)));
        let scene = folder.load(format!("{points}{faces}")).expect("a scene");
        let faces: usize = scene.objects.iter().map(|o| o.mesh.faces.len()).sum();
        assert_eq!((scene.objects.len(), faces), (objects, MANY), "{keyword}");
        assert_eq!(scene.objects[0].materials.len(), materials, "{keyword}");
    }
}

#[test]
fn objects_and_materials_have_a_limit() {
    let folder = Folder::new("many");
    for keyword in ["o", "g", "usemtl"] {
        let names = lines(MANY, |i| format!("{keyword} n{i}\nf 1 2 3\n"));
        let error = message(folder.load(format!("{SQUARE}{names}")));
        says(&error, ["line", "object", "LoadLimits::with_memory"]);
    }
    // Materials of several objects count for each.
    let names = lines(40, |i| format!("o {}\nusemtl {}\nf 1 2 3\n", i % 4, i % 5));
    let path = folder.write("scene.obj", format!("{SQUARE}{names}"));
    let load = |parts: u64| {
        let limits = LoadLimits::default().with_memory(parts * 12_288);
        Scene::load_within(&path, &Device::flex(), &limits)
    };
    says(message(load(19)), ["LoadLimits::with_memory"]);
    assert_eq!(load(20).expect("a scene").objects.len(), 4);
}

/// One image counts for each color by which it is multiplied, and once for all that take it as it is.
#[test]
fn textures_have_a_limit() {
    let folder = Folder::new("textures");
    let image = HostImage::new(100, 100, vec![0.25; 30_000]).expect("an image");
    image.write(folder.path("a.png")).expect("a file");
    let load = |tint: &str, textures: u64| {
        let mtl = lines(9, |i| {
            format!("newmtl m{i}\nKd 0\nmap_Kd a.png\nNs 4\nKs {tint}{i}\nmap_Ks a.png\n")
        });
        folder.write("m.mtl", mtl);
        let faces = lines(9, |i| format!("usemtl m{i}\nf 1/1 2/1 3/1\n"));
        let text = format!("mtllib m.mtl\n{SQUARE}vt 0 0\n{faces}");
        let limits = LoadLimits::default().with_memory(9 * 12_288 + textures * 120_000);
        Scene::load_within(folder.write("scene.obj", text), &Device::flex(), &limits)
    };
    // Ks of 1.00 to 1.08 are 1: one texture, and each pair is compared.
    assert!(load("1.0", 10).is_ok());
    says(
        message(load("1.0", 9)),
        ["a.png", "LoadLimits::with_memory"],
    );
    // Of 0.10 to 0.18, nine textures more.
    says(
        message(load("0.1", 18)),
        ["a.png", "LoadLimits::with_memory"],
    );
    assert!(load("0.1", 19).is_ok());
}

/// Names of materials were looked for in all of them, for each number of each and for each line; and textures in all
/// textures.
#[test]
fn thousands_of_materials() {
    let folder = Folder::new("materials");
    let count = 20_000;
    let mtl = lines(count, |i| {
        format!("newmtl m{i}\nKd 0.25 0.5 {}\nmap_Kd t{i}.png\n", i % 2)
    });
    folder.write("m.mtl", mtl);
    let faces = lines(count, |i| format!("usemtl m{i}\nf 1/1 2/1 3/1\n"));
    let libraries = "mtllib m.mtl\nmtllib ./m.mtl m.mtl\n".repeat(1000);
    let scene = folder.load(format!("{libraries}{SQUARE}vt 0 0\n{faces}"));
    let scene = scene.expect("a scene").with_environment([1.0; 3]);
    let object = &scene.objects[0];
    assert_eq!(object.materials.len(), count);
    assert_eq!(constant(base(&object.materials[7])), [0.25, 0.5, 1.0]);
    let camera = Camera::look_at([0.3, 0.3, 4.0], [0.3, 0.3, 0.0]);
    let options = RenderOptions::new(2, 2).with_samples(1).with_bounces(0);
    let begin = std::time::Instant::now();
    render(&scene, &camera, &options).expect("an image");
    // It took minutes.
    assert!(begin.elapsed().as_secs() < 60, "{:?}", begin.elapsed());
}

#[test]
fn concave_polygons_have_a_limit() {
    let folder = Folder::new("corners");
    let star = |corners: usize| {
        let points = lines(corners, |i| {
            let (angle, radius) = (i as f64, 1.0 + 0.5 * (i % 2) as f64);
            let (sin, cos) = (angle * std::f64::consts::TAU / corners as f64).sin_cos();
            format!("v {} {} 0\n", radius * cos, radius * sin)
        });
        let face = lines(corners, |i| format!(" {}", i + 1));
        (points, format!("f{face}\n"))
    };
    let (points, face) = star(1_000_000);
    let error = message(folder.load(format!("{points}{face}")));
    says(
        &error,
        [
            "line 1000001",
            "1000000 corners",
            "LoadLimits::with_corners",
        ],
    );

    let (points, face) = star(2000);
    let limits = |most| LoadLimits::default().with_corners(most);
    let load = |faces: usize, most| {
        let path = folder.write("star.obj", format!("{points}{}", face.repeat(faces)));
        Scene::load_within(path, &Device::flex(), &limits(most))
    };
    let scene = load(4, 4000).expect("a scene");
    assert_eq!(scene.objects[0].mesh.faces.len(), 4 * 1998);
    says(
        message(load(5, 4000)),
        ["line 2005", "LoadLimits::with_corners"],
    );

    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 2000\nproperty float x\nproperty float y\nproperty float z\n\
         element face 1\nproperty list int int vertex_indices\nend_header\n{}2000 {}\n",
        points.replace("v ", ""),
        lines(2000, |i| format!(" {i}"))
    );
    let path = folder.write("star.ply", ply);
    let device = Device::flex();
    says(
        message(Scene::load_within(&path, &device, &limits(1999))),
        ["face 0", "LoadLimits::with_corners"],
    );
    assert!(Scene::load_within(&path, &device, &limits(2000)).is_ok());
}
