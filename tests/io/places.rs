//! Which files are read, who names them, and who may read what is written.

use std::path::Path;

use crate::common::errors::{message, says};
use crate::common::folder::Folder;
use crate::common::mistakes::{ball, flex, lit, warnings};
use crate::gltf_maker::Gltf;
use softray::prelude::*;

const OBJ: &str = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl wood\nf 1/1 2/1 3/1\n";

fn scene_file(rest: &str) -> String {
    format!(
        "{{\"obj\": \"a.obj\", \"camera\": {{\"eye\": [0, 0, 4], \"target\": [0, 0, 0], \
         \"fov_y_degrees\": 40, \"width\": 4, \"height\": 4}} {rest}}}"
    )
}

#[test]
fn messages_say_who_names_a_missing_file() {
    let folder = Folder::new("named");
    let strict = LoadLimits::default().with_strict(true);
    let load = |path: &Path| message(Scene::load_within(path, &flex(), &strict));
    folder.write("a.mtl", "newmtl wood\nmap_Kd wood.png\n");
    let path = folder.write("a.obj", OBJ);
    let of_mtl = ["wood.png: No such file", "a.mtl, material wood"];
    says(load(&path), of_mtl);
    let warned = warnings(|| Scene::load(&path, &flex()).expect("a scene"));
    assert_eq!(warned.len(), 1);
    says(&warned[0], of_mtl);
    let path = folder.write("b.glb", Gltf::textured("wood.png").glb());
    says(
        load(&path),
        ["wood.png: No such file", "b.glb, images[0].uri"],
    );
    // A damaged file, too.
    folder.write("wood.png", "no picture");
    says(
        load(&path),
        ["wood.png", "named by", "b.glb, images[0].uri"],
    );

    // A buffer, and one that is too large.
    let path = folder.write("c.gltf", Gltf::square().gltf("square.bin"));
    let named_by = "c.gltf, buffers[0].uri";
    says(load(&path), ["square.bin: No such file", named_by]);
    folder.write("square.bin", vec![0; 1 << 16]);
    let small = strict.with_text_bytes(1 << 15);
    let error = message(Scene::load_within(&path, &flex(), &small));
    says(error, ["square.bin", "more than 32768 bytes", named_by]);

    let load = |rest: &str| {
        let path = folder.write("s.json", scene_file(rest));
        message(SceneFile::load(path, &flex()))
    };
    let sky = load(", \"environment\": \"sky.hdr\"");
    says(&sky, ["sky.hdr: No such file", "named by", "s.json"]);
    std::fs::remove_file(folder.path("a.obj")).expect("a file");
    says(load(""), ["a.obj: No such file", "named by", "s.json"]);
}

/// Files outside of the folder are refused by their names, before the file system looks for them: a look at a file of
/// another machine would connect to it. So it does not matter whether they exist.
#[test]
fn places_outside_are_refused_by_name() {
    let folder = Folder::new("names");
    folder.write("a.obj", OBJ);
    let mut names = vec![
        "/nowhere/wood.png",
        "//machine/share/wood.png",
        "../gone/wood.png",
    ];
    if cfg!(windows) {
        names.extend([r"\\machine\share\wood.png", r"\\.\pipe\wood", "NUL"]);
    }
    for name in names {
        folder.write("a.mtl", format!("newmtl wood\nmap_Kd {name}\n"));
        let obj = message(Scene::load(folder.path("a.obj"), &flex()));
        says(&obj, ["a.mtl, material wood", "lies outside of"]);
        let file = Gltf::textured(&name.replace('\\', "%5C"));
        let gltf = message(Scene::load(folder.write("b.glb", file.glb()), &flex()));
        says(&gltf, ["images[0].uri", "lies outside of"]);
        folder.write("a.mtl", "");
        let sky = format!(", \"environment\": {name:?}");
        let path = folder.write("s.json", scene_file(&sky));
        says(
            message(SceneFile::load(path, &flex())),
            ["s.json", "lies outside of"],
        );
    }
    // Ways inside of the folder.
    let image = HostImage::new(1, 1, vec![0.5; 3]).expect("an image");
    image.write(folder.path("wood.png")).expect("a file");
    let own = folder
        .0
        .file_name()
        .expect("a name")
        .to_str()
        .expect("text");
    let whole = folder.path("wood.png");
    for name in [
        "./wood.png",
        &format!("../{own}/wood.png"),
        whole.to_str().expect("text"),
    ] {
        folder.write("a.mtl", format!("newmtl wood\nmap_Kd {name}\n"));
        let warned = warnings(|| Scene::load(folder.path("a.obj"), &flex()).expect("a scene"));
        assert_eq!(warned, [""; 0], "{name}");
    }
}

/// Files that are written have the rights of those that the program creates itself.
#[cfg(unix)]
#[test]
fn files_have_the_rights_of_new_files() {
    use std::os::unix::fs::PermissionsExt;
    let folder = Folder::new("rights");
    let mode = |path: &Path| {
        let metadata = std::fs::metadata(path).expect("a file");
        metadata.permissions().mode()
    };
    let usual = mode(&folder.write("usual", ""));
    let scene = lit(ball()).with_environment([0.0; 3]);
    let image = HostImage::new(1, 1, vec![0.5; 3]).expect("an image");
    image.write(folder.path("a.png")).expect("a file");
    for name in ["a.obj", "a.glb", "a.ply"] {
        scene.write(folder.path(name)).expect("files");
    }
    #[cfg(feature = "safetensors")]
    {
        use softray::modules::save_safetensors;
        let pose = RigidTransformConfig::new().init(&flex().autodiff());
        let pose = pose.expect("a pose");
        for _ in 0..2 {
            save_safetensors(&pose, folder.path("a.safetensors")).expect("a file");
        }
    }
    for name in folder.files() {
        assert_eq!(mode(&folder.path(&name)), usual, "{name}");
    }
}
