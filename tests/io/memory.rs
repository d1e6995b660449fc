//! Scenes from files in memory: the same as from the file system, and nothing but what is in memory.

use crate::common::errors::{message, says};
use crate::common::folder::Folder;
use crate::common::mistakes::{flex, warnings};
use crate::gltf_maker::Gltf;
use softray::prelude::*;

const OBJ: &str = "mtllib parts/a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl wood\nf 1/1 2/2 3/3\n";
const MTL: &str = "newmtl wood\nmap_Kd ..\\wood.png\n";
const SCENE: &str = "{\"scene\": \"./a.obj\", \"camera\": {\"eye\": [0.3, 0.3, 2], \"target\": [0.3, 0.3, 0], \
     \"fov_y_degrees\": 40, \"width\": 8, \"height\": 6}, \"environment\": [1, 1, 1]}";

type File = (String, Vec<u8>);

fn from_bytes(name: &str, files: &[File]) -> softray::Result<SceneFile> {
    let limits = LoadLimits::default().with_strict(true);
    SceneFile::from_bytes(name, files.to_vec(), &flex(), &limits)
}

fn image(file: &SceneFile) -> Vec<f32> {
    let options = RenderOptions::new(8, 6).with_samples(4).with_bounces(0);
    let image = render(&file.scene, &file.camera, &options).expect("an image");
    let image = HostImage::from_tensor(&image.radiance).expect("values");
    image.pixels
}

/// All files of a scene of each format, by the name of the file that holds the scene.
fn scenes(folder: &Folder) -> Vec<(&'static str, Vec<File>)> {
    let wood = folder.path("wood.png");
    let picture = HostImage::new(2, 1, vec![0.8, 0.4, 0.1, 0.2, 0.7, 0.9]);
    picture.expect("an image").write(&wood).expect("a file");
    let wood = std::fs::read(wood).expect("a file");
    let textured = Gltf::textured("wood.png");
    let named = |files: &[(&str, &[u8])]| {
        let all = files
            .iter()
            .map(|(name, bytes)| (name.to_string(), bytes.to_vec()));
        all.collect::<Vec<File>>()
    };
    let obj = [
        ("a.obj", OBJ.as_bytes()),
        ("parts/a.mtl", MTL.as_bytes()),
        ("wood.png", &wood),
        ("s.json", SCENE.as_bytes()),
    ];
    let gltf = textured.gltf("b.bin");
    vec![
        ("s.json", named(&obj)),
        ("a.obj", named(&obj)),
        (
            "b.gltf",
            named(&[
                ("b.gltf", gltf.as_ref()),
                ("b.bin", &textured.buffer),
                ("wood.png", &wood),
            ]),
        ),
        (
            "c.glb",
            named(&[("c.glb", &textured.glb()), ("wood.png", &wood)]),
        ),
        (
            "d.ply",
            named(&[(
                "d.ply",
                b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
            )]),
        ),
    ]
}

#[test]
fn files_in_memory_make_the_same_image_as_files() {
    let folder = Folder::new("memory");
    for (name, files) in scenes(&folder) {
        for (name, bytes) in &files {
            folder.write(name, bytes);
        }
        let lit = |file: softray::Result<SceneFile>| {
            let file = file.expect(name);
            SceneFile {
                scene: file.scene.with_environment([1.0; 3]),
                ..file
            }
        };
        let read = lit(SceneFile::load(folder.path(name), &flex()));
        let given = lit(from_bytes(name, &files));
        let values = image(&given);
        assert!(values.iter().any(|&v| v > 0.05), "{name} is black");
        assert_eq!(values, image(&read), "{name}");
        assert_eq!((given.width, given.height), (read.width, read.height));
    }
}

#[test]
fn what_is_not_in_memory_is_named() {
    let folder = Folder::new("memory");
    for (name, files) in scenes(&folder) {
        for missing in 0..files.len() {
            // On disk it would be found.
            folder.write(&files[missing].0, &files[missing].1);
            let rest: Vec<File> = [&files[..missing], &files[missing + 1..]].concat();
            let gone = files[missing].0.as_str();
            // No other file names the scene file.
            if name == gone || gone != "s.json" {
                let error = message(from_bytes(name, &rest));
                let last = gone.rsplit('/').next().expect("a name");
                says(error, [last, "it is not in memory, expected "]);
            }
        }
    }
    // A path on disk that a file names is not followed, whatever the limits allow.
    let outside = folder.write("there.mtl", "newmtl wood\nKd 1 0 0\n");
    let obj = OBJ.replace("parts/a.mtl", &outside.display().to_string());
    let limits = LoadLimits::default().with_outside(true);
    let load = |limits: &LoadLimits| {
        Scene::from_bytes("a.obj", [("a.obj", obj.as_str())], &flex(), limits)
    };
    let warned = warnings(|| load(&limits).expect("a scene"));
    assert!(
        warned
            .iter()
            .any(|w| w.contains("there.mtl: it is not in memory")),
        "{warned:?}"
    );
    says(
        message(load(&limits.with_strict(true))),
        ["there.mtl: it is not in memory, expected one of [\"a.obj\"]"],
    );
}

#[test]
fn mistakes_in_memory_get_a_sentence() {
    let load = |files: &[(&str, &str)]| {
        let files: Vec<File> = files
            .iter()
            .map(|(n, b)| (n.to_string(), b.as_bytes().to_vec()))
            .collect();
        message(from_bytes(files[0].0.clone().as_str(), &files))
    };
    says(
        load(&[("a.obj", "v 0 0 0\nf 1 2 3\n")]),
        ["a.obj", "line 2", "v index 2 is out of range"],
    );
    says(
        load(&[("a.glb", "glTF\u{2}\0\0\0")]),
        ["a.glb: it ends before the chunk JSON"],
    );
    says(load(&[("a.zip", "PK")]), ["a.zip: its ending is \"zip\""]);
    says(
        load(&[("x/../a.obj", OBJ), ("./a.obj", OBJ)]),
        ["a.obj: two files have this name"],
    );
    let small = LoadLimits::default().with_text_bytes(8);
    let large = Scene::from_bytes("a.obj", [("a.obj", OBJ)], &flex(), &small);
    says(message(large), ["a.obj: it has more than 8 bytes"]);
}
