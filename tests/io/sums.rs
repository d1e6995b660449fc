//! Files whose parts are small and whose sum is not: what they share is there once, and what they take is bounded.

use std::sync::{Arc, Mutex};

use crate::common::errors::{message, says};
use crate::common::folder::Folder;
use crate::common::memory::{peak, resident};
use crate::common::numbers::furthest;
use crate::common::process::alone;
use crate::common::tensors::{gradient, radiance};
use crate::gltf_maker::{Gltf, data_uri};
use burn::tensor::Gradients;
use serde_json::{Value, json};
use softray::prelude::*;

/// A picture of one color, which takes few bytes.
fn flat(folder: &Folder, side: usize, color: [f32; 3]) -> String {
    let pixels = color.repeat(side * side);
    let image = HostImage::new(side, side, pixels).expect("an image");
    let path = folder.path("flat.png");
    image.write(&path).expect("a file");
    data_uri("image/png", &std::fs::read(path).expect("bytes"))
}

/// A row of squares, each with a material of its own that has a texture of one of some images.
fn squares(count: usize, images: &[String]) -> Gltf {
    let mut file = Gltf::square();
    for image in images {
        let source = file.push("images", json!({"uri": image}));
        file.push("textures", json!({"source": source}));
    }
    let mesh = file.json["meshes"][0].clone();
    file.json["meshes"] = json!([]);
    for i in 0..count {
        let texture = json!({"index": i % images.len()});
        let material = file.push(
            "materials",
            json!({"pbrMetallicRoughness": {"baseColorTexture": texture, "metallicFactor": 0}}),
        );
        let mut mesh = mesh.clone();
        mesh["primitives"][0]["material"] = json!(material);
        file.push("meshes", mesh);
    }
    let nodes = (0..count).map(|i| json!({"mesh": i, "translation": [i, 0, 0]}));
    place(&mut file, nodes.collect());
    file
}

fn place(file: &mut Gltf, nodes: Vec<Value>) {
    file.json["scenes"][0]["nodes"] = json!((0..nodes.len()).collect::<Vec<_>>());
    file.json["nodes"] = json!(nodes);
}

fn small() -> RenderOptions {
    RenderOptions::new(8, 8).with_samples(2).with_bounces(1)
}

/// 40 materials of one image of 12 MiB as a texture: 480 MiB if each had its own, in the scene and in what renders it.
#[test]
fn an_image_that_materials_share_is_there_once() {
    if !alone(an_image_that_materials_share_is_there_once) {
        return;
    }
    let folder = Folder::new("shared-image");
    let file = squares(40, &[flat(&folder, 1024, [0.25, 0.5, 0.75])]);
    let path = folder.write("shared.glb", file.glb());
    let before = peak();
    let limits = LoadLimits::default().with_memory(20 << 20);
    let scene = Scene::load_within(&path, &Device::flex(), &limits).expect("a scene");
    let scene = scene.with_environment([1.0; 3]);
    let camera = Camera::look_at([20.0, 0.5, 30.0], [20.0, 0.5, 0.0]);
    let seen = radiance(&scene, &camera, &small());
    assert!(seen.iter().any(|&v| v > 0.1));
    let taken = peak() - before;
    assert!(taken < 240.0, "{taken} MiB");
}

#[test]
fn the_sum_of_images_is_bounded() {
    if !alone(the_sum_of_images_is_bounded) {
        return;
    }
    let folder = Folder::new("many-images");
    let image = flat(&folder, 512, [0.5; 3]);
    let file = squares(4, &[(); 4].map(|()| image.clone()));
    let path = folder.write("many.glb", file.glb());
    let load = |bytes| {
        let limits = LoadLimits::default().with_memory(bytes);
        Scene::load_within(&path, &Device::flex(), &limits)
    };
    // Each has 3 MiB of numbers.
    let error = message(load(10 << 20));
    says(error, ["many.glb", "images[3]", "LoadLimits::with_memory"]);
    assert!(load(13 << 20).is_ok());
    // By default small files are not believed either: 60 images of 4096² would take 12 GB, and are not decoded.
    let image = flat(&folder, 4096, [0.5; 3]);
    let before = peak();
    let file = squares(60, &[(); 60].map(|()| image.clone()));
    let path = folder.write("huge.glb", file.glb());
    let error = message(Scene::load(path, &Device::flex()));
    says(error, ["huge.glb", "LoadLimits::with_memory"]);
    assert!(peak() - before < 100.0, "{} MiB", peak() - before);
}

#[test]
fn the_sum_of_meshes_is_bounded() {
    let folder = Folder::new("many-meshes");
    let mut file = Gltf::square();
    // The same 20,000 triangles in 300 meshes: 6 million of a file of 200 kB.
    let indices = file.indices(&[0, 1, 2].repeat(20_000));
    file.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    let mesh = file.json["meshes"][0].clone();
    file.json["meshes"] = json!(vec![mesh; 300]);
    place(&mut file, (0..300).map(|i| json!({"mesh": i})).collect());
    let path = folder.write("many.glb", file.glb());
    let error = message(Scene::load(&path, &Device::flex()));
    says(error, ["many.glb", "].mesh", "LoadLimits::with_memory"]);
}

/// Nodes of one mesh share all but their places: 20,000 of them took 660 MB and over a minute.
#[test]
fn objects_take_little() {
    if !alone(objects_take_little) {
        return;
    }
    let folder = Folder::new("many-nodes");
    let mut file = Gltf::square();
    let count = 20_000;
    let nodes = (0..count).map(|i| json!({"mesh": 0, "translation": [i % 150, i / 150, 0]}));
    place(&mut file, nodes.collect());
    let path = folder.write("nodes.glb", file.glb());
    let before = resident();
    let scene = Scene::load(path, &Device::flex()).expect("a scene");
    let scene = scene.with_environment([1.0; 3]);
    let camera = Camera::framing(&scene, [0.0, 0.0, 1.0]).expect("a camera");
    // While all that a render makes of them is there.
    let most = Arc::new(Mutex::new(0.0));
    let seen = most.clone();
    let progress = move |_, _| *seen.lock().expect("a number") = resident();
    radiance(&scene, &camera, &small().with_progress(progress));
    let most = *most.lock().expect("a number");
    let of_one = (most - before) * 1024.0 / f64::from(count);
    println!("{of_one:.2} KiB an object");
    assert!(most > before && of_one < 12.0, "{of_one} KiB");
}

/// 40,000 squares at one place look as one does. The time to build boxes about them grew with the square of their number:
/// to minutes.
#[test]
fn faces_at_one_place_take_linear_time() {
    let folder = Folder::new("one-place");
    let shown = |count: usize| {
        let mut file = Gltf::square();
        place(&mut file, vec![json!({"mesh": 0}); count]);
        let path = folder.write("squares.glb", file.glb());
        let scene = Scene::load(path, &Device::flex()).expect("a scene");
        let scene = scene.with_environment([1.0; 3]);
        let camera = Camera::look_at([0.2, 0.4, 2.0], [0.5, 0.5, 0.0]);
        radiance(&scene, &camera, &small())
    };
    let one = shown(1);
    let start = std::time::Instant::now();
    let many = shown(40_000);
    println!("{:?}", start.elapsed());
    assert!(start.elapsed().as_secs() < 60, "{:?}", start.elapsed());
    let off = furthest(&one, &many);
    assert!(off < 0.05, "{off}");
}

/// A texture in the graph has the derivatives of each material that has it, once.
#[test]
fn a_shared_texture_has_the_sum_of_its_derivatives() {
    let device = Device::flex();
    let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]);
    let options = RenderOptions::new(8, 8).with_samples(4).with_bounces(1);
    let texels = |value: f32| Tensor::<3>::full([2, 2, 3], value, &device);
    // The gradient by the textures of two squares that face the camera.
    let render = |of: [Tensor<3>; 2]| {
        let squares = of.into_iter().zip([-0.6, 0.6]).map(|(texture, x)| {
            let square = shapes::quad(
                [x - 0.5, -0.5, 0.0],
                [x + 0.5, -0.5, 0.0],
                [x + 0.5, 0.5, 0.0],
                [x - 0.5, 0.5, 0.0],
                &device,
            );
            Object::new(square).with_material(Material::diffuse(ColorTexture::texture(texture)))
        });
        let scene = squares.fold(Scene::new().with_environment([1.0; 3]), Scene::with_object);
        let image = render(&scene, &camera, &options).expect("an image");
        image.radiance.sum().backward()
    };
    let leaf = || texels(0.5).autodiff().require_grad();
    let sum = |leaf: &Tensor<3>, g: &Gradients| gradient(leaf, g).iter().sum::<f64>();
    let [left, right] = [leaf(), leaf()];
    let apart = render([left.clone(), right.clone()]);
    let wanted = sum(&left, &apart) + sum(&right, &apart);
    let both = leaf();
    let found = sum(&both, &render([both.clone(), both.clone()]));
    assert!(
        wanted > 0.0 && (found / wanted - 1.0).abs() < 1e-5,
        "{found} {wanted}"
    );
}
