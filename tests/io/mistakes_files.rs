//! Mistakes of somebody who uses this crate for the first time, with files; and what is only a warning.

use std::path::PathBuf;

use crate::common::folder::Folder;
use crate::common::materials::base;
use crate::common::mistakes::{Mistakes, ball, camera, flex, lit, row, small, warnings};
use crate::common::process::alone;
use crate::gltf_maker::Gltf;
use burn::tensor::Tensor;
use serde_json::json;
use softray::Error;
use softray::prelude::*;

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

#[test]
fn files() {
    let mut mistakes = Mistakes::default();
    let folder = Folder::new("files");
    let obj = |path: PathBuf| Scene::load(path, &flex());
    mistakes.expect("no OBJ file", &["nowhere.obj", "No such file"], || {
        obj(folder.path("nowhere.obj"))
    });
    mistakes.expect("an OBJ file without faces", &["points.obj", "face"], || {
        obj(folder.write("points.obj", TRIANGLE))
    });
    mistakes.expect(
        "a glTF file without meshes",
        &["scene.gltf", "no node"],
        || obj(folder.write("scene.gltf", "{\"asset\": {\"version\": \"2.0\"}}")),
    );
    mistakes.expect("a file of another kind", &["a.fbx", ".gltf"], || {
        obj(folder.write("a.fbx", "Kaydara"))
    });
    mistakes.expect(
        "a texture that is not there",
        &["wood.png", "No such"],
        || {
            folder.write("a.mtl", "newmtl a\nmap_Kd wood.png\n");
            let text = format!("mtllib a.mtl\n{TRIANGLE}vt 0 0\nusemtl a\nf 1/1 2/1 3/1\n");
            let strict = LoadLimits::default().with_strict(true);
            Scene::load_within(folder.write("a.obj", text), &flex(), &strict)
        },
    );
    let scene = |rest: &str| {
        let text = format!(
            "{{\"obj\": \"s.obj\", \"camera\": {{\"eye\": [0, 0, 4], \"target\": [0, 0, 0], \
             \"fov_y_degrees\": 40, \"width\": 4, \"height\": 4}} {rest}}}"
        );
        SceneFile::load(folder.write("s.json", &text), &flex())
    };
    mistakes.expect(
        "a scene file without its OBJ",
        &["s.obj", "No such"],
        || scene(""),
    );
    folder.write("s.obj", TRIANGLE);
    mistakes.expect("a scene file, no faces", &["s.obj", "face"], || scene(""));
    folder.write("s.obj", format!("{TRIANGLE}f 1 2 3\n"));
    mistakes.expect("a velocity of nothing", &["s.json", "\"moon\""], || {
        scene(", \"velocities\": {\"moon\": [1, 0, 0]}")
    });
    mistakes.expect("a missing field", &["t.json", "camera"], || {
        SceneFile::load(folder.write("t.json", "{\"obj\": \"s.obj\"}"), &flex())
    });
    let image = || HostImage::new(2, 2, vec![0.5; 12]);
    mistakes.expect("write a JPEG", &["a.jpg", ".exr or .pfm or .png"], || {
        image()?.write(folder.path("a.jpg"))
    });
    mistakes.expect(
        "write without an ending",
        &["image", ".exr or .pfm or .png"],
        || image()?.write(folder.path("image")),
    );
    mistakes.expect("write into no folder", &["none", "no folder"], || {
        image()?.write(folder.path("none/a.png"))
    });
    mistakes.expect("read no image", &["a.obj", "decoded"], || {
        HostImage::read(folder.path("a.obj"))
    });
    mistakes.expect(
        "an image of 4 channels",
        &["[2, 2, 4]", "[H, W, 3]"],
        || HostImage::from_tensor(&Tensor::zeros([2, 2, 4], &flex())),
    );
    mistakes.expect("values of an image", &["11 values", "12", "2 × 2"], || {
        HostImage::new(2, 2, vec![0.0; 11])
    });
}

#[test]
fn errors_keep_their_source() {
    use std::error::Error as _;
    let error = Scene::load("nowhere.obj", &flex()).expect_err("no file");
    let source = error.source().expect("a source");
    assert!(source.is::<std::io::Error>(), "{source}");
    let bad = ball().with_velocity([f64::NAN, 0.0, 0.0]);
    let batch = Batch::new(vec![lit(bad)], vec![camera()]).expect("a batch");
    let error = render_batch(&batch, &small()).expect_err("a velocity");
    let source = error
        .source()
        .and_then(|s| s.downcast_ref::<Box<Error>>().map(|e| &**e));
    let source = source.or_else(|| error.source().and_then(|s| s.downcast_ref::<Error>()));
    assert!(matches!(source, Some(Error::Invalid { field, .. }) if field == "velocity"));
}

/// Entries of a material that are not read cause one warning a file, with their names; a texture without
/// coordinates gives way to the color.
#[test]
fn what_files_hold_and_is_not_read() {
    let folder = Folder::new("unread");
    let mtl =
        "newmtl a\nKd 1 0 0\nd 0.5\nPr 0.3\nmap_Bump b.png\nnewmtl b\nPm 1\nd 0.2\nKs 0 0 0\n";
    folder.write("a.mtl", mtl);
    let text = format!("mtllib a.mtl\n{TRIANGLE}usemtl a\nf 1 2 3\n");
    let path = folder.write("a.obj", &text);
    let warned = warnings(|| Scene::load(&path, &flex()).expect("a scene"));
    let whole = warned.len() == 1 && warned[0].contains("a.mtl");
    assert!(
        whole && warned[0].contains("not read: d, Pr, map_Bump, Pm. Metal and glass"),
        "{warned:?}"
    );

    let image = HostImage::new(1, 1, vec![0.0; 3]).expect("an image");
    image.write(folder.path("black.png")).expect("a file");
    folder.write("a.mtl", "newmtl a\nKd 1 0 0\nmap_Kd black.png\n");
    let mut scene = Scene::new();
    let warned = warnings(|| scene = Scene::load(&path, &flex()).expect("a scene"));
    let one =
        warned.len() == 1 && warned[0].contains("have a texture") && warned[0].ends_with(": a");
    assert!(one, "{warned:?}");
    let shown = format!("{:?}", scene.objects[0].materials[0]);
    assert_eq!(shown, r#"Material "a" { diffuse: [1.0, 0.0, 0.0] }"#);
    assert!(render(&scene, &camera(), &small()).is_ok());
}

/// A warning for each kind of fault of an OBJ file, which names some and counts the rest.
#[test]
fn warnings_of_obj_files_are_few() {
    let folder = Folder::new("few");
    let all = |of: &dyn Fn(usize) -> String| (0..9).map(of).collect::<String>();
    let mtl = all(&|i| format!("newmtl m{i}\nKd 0.8\nKs 0.5\nmap_Kd {i}.png\n"));
    folder.write("a.mtl", mtl);
    let faces = |name: &str| all(&|i| format!("usemtl {name}{i}\nf 1/1 2/1 3/1\n"));
    let (known, unknown) = (faces("m"), faces("u"));
    let text = format!("mtllib a.mtl b.mtl\n{TRIANGLE}vt 0 0\n{known}{unknown}");
    let path = folder.write("a.obj", text);
    let warned = warnings(|| Scene::load(&path, &flex()).expect("a scene"));
    assert_eq!(warned.len(), 3, "{warned:?}");
    let has = |part: &str, end: &str| {
        let found = warned.iter().any(|w| w.contains(part) && w.ends_with(end));
        assert!(found, "{part}: {warned:?}");
    };
    has("no file defines", ": u0, u1, u2, u3, u4 and 4 more");
    has("Ks is scaled down", ": m0, m1, m2, m3, m4 and 4 more");
    has("b.mtl", "and 5 more");
}

#[test]
fn black_images_warn() {
    let black = |scene: Scene, part: &str| {
        let warned = warnings(|| {
            let image = render(&scene, &camera(), &small()).expect("an image");
            assert_eq!(image.mean().expect("values"), [0.0; 3]);
        });
        assert!(warned.len() == 1 && warned[0].contains(part), "{warned:?}");
    };
    black(Scene::new().with_object(ball()), "no light");
    // A tensor of zeros is dark, too.
    black(lit(ball()).with_environment(row([0.0; 3])), "no light");
    // The camera is outside of a box with a lamp in it.
    let lamp = Object::new(shapes::icosahedron(&flex()).scaled(row([0.1])))
        .with_material(Material::emitter([1.0; 3]));
    let walls = Object::new(shapes::cube(&flex()));
    black(
        Scene::new().with_object(lamp.clone()).with_object(walls),
        "view 0 is black",
    );

    let seen = Scene::new().with_object(lamp);
    let options = RenderOptions::new(16, 16).with_samples(4).with_bounces(0);
    let warned = warnings(|| render(&seen, &camera(), &options).expect("an image"));
    assert!(warned.is_empty(), "{warned:?}");
}

/// What would lose a render is an error before it, and leaves no file behind.
#[test]
fn places_that_can_not_be_written_to() {
    let mut mistakes = Mistakes::default();
    let folder = Folder::new("places");
    // Where nobody may write, whatever their rights.
    #[cfg(target_os = "linux")]
    mistakes.expect(
        "a folder of the system",
        &["/proc/a.png", "folder /proc"],
        || HostImage::check_path("/proc/a.png"),
    );
    std::fs::create_dir(folder.path("b.png")).expect("a folder");
    mistakes.expect("a folder as a file", &["b.png", "it is a folder"], || {
        HostImage::check_path(folder.path("b.png"))
    });
    mistakes.expect(
        "an image larger than the disk",
        &["e.exr", "free space"],
        || HostImage::check_room(folder.path("e.exr"), 1 << 24, 1 << 24),
    );
    let path = folder.write("c.exr", "old");
    HostImage::check_path(&path).expect("a place");
    HostImage::check_room(folder.path("d.png"), 200, 100).expect("room");
    assert_eq!(folder.files(), ["b.png", "c.exr"]);
    assert_eq!(std::fs::read(path).expect("bytes"), b"old");
}

#[test]
fn fields_that_scene_files_do_not_have() {
    let folder = Folder::new("fields");
    folder.write("s.obj", format!("{TRIANGLE}f 1 2 3\n"));
    let text = r#"{"obj": "s.obj", "enviroment": [1, 1, 1], "camera": {"eye": [0, 0, 4],
        "target": [0, 0, 0], "fov_y_degrees": 40, "width": 4, "height": 4, "fov": 3}, "lights": [
        {"kind": "point", "position": [1, 1, 1], "intensity": [1, 1, 1], "color": [1, 0, 0]}]}"#;
    let path = folder.write("s.json", text);
    let warned = warnings(|| SceneFile::load(&path, &flex()).expect("a scene"));
    let whole = warned.len() == 1 && warned[0].contains("s.json");
    let fields = "not known: enviroment, camera.fov, lights[0].color";
    assert!(whole && warned[0].ends_with(fields), "{warned:?}");
    let known = text
        .replace("enviroment", "environment")
        .replace(", \"fov\": 3", "");
    let path = folder.write("s.json", known.replace(", \"color\": [1, 0, 0]", ""));
    let warned = warnings(|| SceneFile::load(&path, &flex()).expect("a scene"));
    assert!(warned.is_empty(), "{warned:?}");
}

#[test]
fn scenes_without_extent_or_area() {
    // Its warning is logged once in a process.
    if !alone(scenes_without_extent_or_area) {
        return;
    }
    let mut mistakes = Mistakes::default();
    let scene = |corners: [[f64; 3]; 3]| {
        lit(Object::new(Mesh::from_host(
            &corners,
            vec![[0, 1, 2]],
            &flex(),
        )))
    };
    for place in [[0.0; 3], [1.0, -2.0, 1e6]] {
        let parts = ["scene: bounds", "not all in one point"];
        mistakes.expect("a point", &parts, || overview(&scene([place; 3])));
        mistakes.expect("a point in a frame", &parts, || {
            Camera::framing(&scene([place; 3]), [0.0, 0.0, 1.0])
        });
    }
    let line = scene([[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
    let said = warnings(|| render(&line, &camera(), &small()).expect("an image"));
    assert!(said.iter().any(|t| t.contains("has an area")), "{said:?}");
    // Flat and dark: no side of it is better than another.
    let flat = scene([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).with_environment([0.0; 3]);
    assert!(overview(&flat).is_ok());
}

/// A surface whose texture is missing is there without it, as other readers have it; one that the texture would say the
/// light of is dark.
#[test]
fn images_that_are_not_there() {
    let folder = Folder::new("missing");
    folder.write("text.png", "no picture");
    for (uri, part) in [("nowhere.png", "nowhere.png"), ("text.png", "text.png")] {
        let mut file = Gltf::textured(uri);
        file.json["materials"][0]["emissiveTexture"] = json!({"index": 0});
        file.json["materials"][0]["emissiveFactor"] = json!([1, 1, 1]);
        file.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] =
            json!([1, 0.5, 0, 1]);
        let path = folder.write("a.glb", file.glb());
        let mut scene = Scene::new();
        let warned = warnings(|| scene = Scene::load(path, &flex()).expect("a scene"));
        let whole = warned.len() == 1 && warned[0].contains("without what can't be read");
        assert!(whole && warned[0].contains(part), "{warned:?}");
        let ColorTexture::Constant(color) = base(&scene.objects[0].materials[0]) else {
            panic!("a texture");
        };
        assert_eq!(color.values().expect("a color"), [1.0, 0.5, 0.0]);
        assert!(!scene.has_light());
    }
}

/// Files that name Draco without requiring it still have no positions.
#[test]
fn draco_without_a_requirement() {
    let folder = Folder::new("draco");
    let mut file = Gltf::square();
    file.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    let primitive = &mut file.json["meshes"][0]["primitives"][0];
    primitive["extensions"] = json!({"KHR_draco_mesh_compression": {"bufferView": 0}});
    let load = |file: &Gltf| Scene::load(folder.write("a.glb", file.glb()), &flex());
    // Beside it are the same positions without compression.
    assert!(load(&file).is_ok());
    let accessor = file.json["accessors"][0].as_object_mut().expect("it");
    accessor.remove("bufferView");
    let error = load(&file).expect_err("an error").to_string();
    assert!(
        error.contains("primitives[0] is compressed by Draco"),
        "{error}"
    );
}
