//! Normal maps, alpha masks, colors and tangents of glTF files: what is read, and that what is written reads back
//! to the same image.

use crate::common::errors::{message, says};
use crate::common::folder::Folder;
use crate::common::materials::{base, metallic};
use crate::common::mistakes::warnings;
use crate::common::numbers::mean;
use crate::common::scenes::{facing_front, floor, lamp};
use crate::common::tensors::{radiance, values};
use crate::gltf_maker::{Gltf, data_uri};
use crate::written::{camera, image, near, texels, uvs};
use burn::tensor::Tensor;
use image::{ImageFormat, Rgba, RgbaImage};
use serde_json::{Value, json};
use softray::prelude::*;

fn load(file: &Gltf) -> (Scene, Vec<String>) {
    let folder = Folder::new("gltf-details");
    let name = format!("{:?}.glb", std::thread::current().id());
    let path = folder.write(&name, file.glb());
    let mut scene = Scene::new();
    let warned = warnings(|| scene = Scene::load(path, &Device::flex()).expect("a scene"));
    (scene, warned)
}

/// The square with a material and one texture of two pixels.
fn square(material: Value, pixels: [[u8; 4]; 2]) -> Gltf {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = RgbaImage::from_fn(2, 1, |x, _| Rgba(pixels[x as usize]));
    image
        .write_to(&mut bytes, ImageFormat::Png)
        .expect("a PNG file");
    let mut file = Gltf::square();
    let uri = data_uri("image/png", &bytes.into_inner());
    file.push("images", json!({"uri": uri}));
    file.push("samplers", json!({"wrapS": 33071, "wrapT": 33071}));
    file.push("textures", json!({"source": 0, "sampler": 0}));
    file.material(material);
    file
}

#[test]
fn normal_maps_and_masks() {
    let json = json!({
        "normalTexture": {"index": 0, "scale": 0.5},
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 1, 1, 0.5]},
        "alphaMode": "MASK", "alphaCutoff": 0.25
    });
    let (scene, warned) = load(&square(json, [[255, 0, 255, 255], [51, 204, 128, 51]]));
    assert!(warned.is_empty(), "{warned:?}");
    let material = &scene.objects[0].materials[0];
    let map = material.normal_map.as_ref().expect("a normal map");
    assert_eq!(map.wrap, Wrap::Clamp);
    let last = 2.0 * 128.0 / 255.0 - 1.0;
    near(&values(&map.texels), &[0.5, -0.5, 1.0, -0.3, 0.3, last]);
    let mask = material.alpha_mask.as_ref().expect("a mask");
    assert_eq!((mask.wrap, mask.cutoff), (Wrap::Clamp, 0.25));
    near(&values(&mask.alpha), &[0.5, 0.1]);
    // Half of the square is there.
    let camera = Camera::look_at([0.5, 0.5, 2.0], [0.5, 0.5, 0.0]).with_fov_y(20.0);
    let options = RenderOptions::new(8, 8).with_samples(1).with_bounces(0);
    let behind = scene.clone().with_environment([9.0, 0.0, 0.0]);
    let seen = radiance(&behind, &camera, &options);
    let sees_through: Vec<bool> = (0..8).map(|x| seen[3 * (8 * 4 + x)] == 9.0).collect();
    assert!(!sees_through[..3].contains(&true), "{seen:?}");
    assert!(!sees_through[5..].contains(&false), "{seen:?}");
    // A mask without holes is none, nor is one of an opaque material.
    for json in [
        json!({"alphaMode": "MASK", "alphaCutoff": 0.1, "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}),
        json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}),
    ] {
        let (scene, warned) = load(&square(json, [[255; 4], [51; 4]]));
        assert!(warned.is_empty() && scene.objects[0].materials[0].alpha_mask.is_none());
    }
}

#[test]
fn details_without_coordinates_are_left_out() {
    let json = json!({
        "normalTexture": {"index": 0}, "alphaMode": "MASK", "alphaCutoff": 0.25,
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 0}}
    });
    let mut file = square(json, [[255, 0, 255, 255], [255, 51, 0, 0]]);
    let attributes = &mut file.json["meshes"][0]["primitives"][0]["attributes"];
    attributes.as_object_mut().expect("it").remove("TEXCOORD_0");
    let (scene, warned) = load(&file);
    for part in ["a normal map or an alpha mask", "taking its mean"] {
        assert!(warned.iter().any(|t| t.contains(part)), "{warned:?}");
    }
    let material = &scene.objects[0].materials[0];
    let ScalarTexture::Constant(metal) = metallic(material) else {
        panic!("a texture");
    };
    near(&metal.values().expect("a number"), &[0.5]);
    let options = RenderOptions::new(4, 4).with_samples(1).with_bounces(1);
    let seen = radiance(&scene.with_environment([1.0; 3]), &camera(), &options);
    assert!(seen.iter().all(|v| v.is_finite()));
}

#[test]
fn colors_and_tangents() {
    let mut file = Gltf::square();
    let view = file.view(&[
        255, 0, 51, 255, 0, 255, 51, 255, 0, 0, 51, 255, 255, 255, 51, 255,
    ]);
    let colors = file.push(
        "accessors",
        json!({"bufferView": view, "componentType": 5121, "normalized": true, "count": 4, "type": "VEC4"}),
    );
    let normals = file.floats("VEC3", &[[0.0, 0.0, 1.0]; 4]);
    let tangents = file.floats("VEC4", &[[1.0, 0.0, 0.0, 1.0]; 4]);
    let attributes = &mut file.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["COLOR_0"] = json!(colors);
    attributes["NORMAL"] = json!(normals);
    attributes["TANGENT"] = json!(tangents);
    file.json["nodes"][0]["matrix"] = json!([0, 2, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
    let (scene, warned) = load(&file);
    assert!(warned.is_empty(), "{warned:?}");
    let mesh = &scene.objects[0].mesh;
    let found = mesh.colors.as_ref().expect("colors");
    let expected = [1.0, 0.0, 0.2, 0.0, 1.0, 0.2, 0.0, 0.0, 0.2, 1.0, 1.0, 0.2];
    near(&values(&found.values), &expected);
    // x goes to 2 y; a mirror image has its bitangents on the other side.
    let found = mesh.tangents.as_ref().expect("tangents");
    near(&values(&found.values)[..4], &[0.0, 2.0, 0.0, -1.0]);
}

/// Normal maps with and without tangents, masks with and without a texture of colors, and colors with seams.
fn room() -> Scene {
    let device = Device::flex();
    let tilts = texels([3, 2, 3], |i| {
        if i % 3 == 2 {
            1.5
        } else {
            (i * 5 % 7) as f32 / 4.0 - 0.7
        }
    });
    let ripples = Material::diffuse([0.6, 0.7, 0.8]).with_normal_map(tilts, 0.8);
    let holes = texels([4, 4], |i| {
        if (i / 4 + i).is_multiple_of(2) {
            3.0
        } else {
            -1.0
        }
    });
    let checks = Material::diffuse([0.9, 0.3, 0.2]).with_alpha_mask(holes.clone(), 0.7);
    let leaf = ColorTexture::texture(texels([4, 4, 3], |i| (i % 10) as f32 / 12.0));
    let leaf = Material::metallic_roughness(leaf, 0.5, 0.4).with_alpha_mask(holes, 0.2);
    let floor = floor(2.0, 0.0, &device).with_uvs(uvs());
    let back = facing_front([-2.0, 2.0], [0.0, 3.0], -2.0, &device).with_uvs(uvs());
    let sides = Tensor::from_floats([[0.6, 0.8, 0.0, -1.0], [1.0, 0.0, 0.0, 1.0]], &device);
    let faces = vec![[0; 3], [1; 3]];
    let back = back
        .with_tangents(sides, faces.clone())
        .with_normals(texels([4, 3], |i| (i % 3 / 2) as f32));
    let tinted = Tensor::from_floats([[1.0, 0.2, 0.1], [0.3, 0.9, 1.4]], &device);
    let screen =
        |x: f64, z: f64| facing_front([x - 0.5, x + 0.5], [0.3, 1.3], z, &device).with_uvs(uvs());
    let put = |name: &str, mesh: Mesh, material: Material| {
        Object::new(mesh)
            .with_name(name)
            .with_material(material.with_name(name))
    };
    Scene::new()
        .with_object(put("floor", floor, ripples.clone()))
        .with_object(put("back", back, ripples))
        .with_object(put("checks", screen(-0.8, 0.3), checks))
        .with_object(put("leaf", screen(0.8, 0.1), leaf))
        .with_object(put(
            "tinted",
            screen(0.0, -0.9).with_colors(tinted, faces),
            Material::diffuse([0.6, 0.7, 0.5]),
        ))
        .with_object(lamp(0.8, 2.9, [9.0, 8.0, 7.0], &device).with_name("lamp"))
        .with_environment([0.0; 3])
        .with_light(Light::point([0.5, 1.5, 3.0], [4.0; 3]))
}

#[test]
fn details_read_back_to_the_same_image() {
    let folder = Folder::new("gltf-details-room");
    let scene = room();
    let before = image(&scene);
    assert!(mean(&before) > 0.1, "{}", mean(&before));
    let differ = |other: &Scene| -> Vec<f64> {
        let other = image(other);
        let pairs = before.iter().zip(&other);
        pairs.map(|(a, b)| (a - b).abs()).collect()
    };
    let mut back = scene.clone();
    // What was read is written and read again, too.
    for name in ["room.glb", "room.gltf"] {
        let path = folder.path(name);
        let warned = warnings(|| {
            back.write(&path).expect("a file");
            back = Scene::load(&path, &Device::flex()).expect("a scene");
        });
        assert!(warned.is_empty(), "{warned:?}");
        let (other, same): (Vec<f64>, Vec<f64>) = differ(&back).iter().partition(|d| **d > 2e-3);
        println!(
            "{} numbers differ, the others by {:.1e}",
            other.len(),
            mean(&same)
        );
        assert!(other.len() < 9 && mean(&same) < 1e-4);
    }
    // Each of them counts.
    let changes: [fn(&mut Scene); 5] = [
        |scene| scene.objects[0].materials[0].normal_map = None,
        |scene| scene.objects[1].mesh.tangents = None,
        |scene| scene.objects[2].materials[0].alpha_mask = None,
        |scene| scene.objects[3].materials[0].alpha_mask = None,
        |scene| scene.objects[4].mesh.colors = None,
    ];
    for (i, change) in changes.into_iter().enumerate() {
        let mut changed = back.clone();
        change(&mut changed);
        let wrong = differ(&changed).into_iter().filter(|d| *d > 2e-3).count();
        assert!(wrong > 40, "{i}: {wrong}");
    }
}

#[test]
fn other_formats_tell_what_they_lose() {
    let folder = Folder::new("details-losses");
    let scene = room();
    for (name, parts) in [
        (
            "a.obj",
            &["the normal map", "the alpha mask", "the colors of tinted"][..],
        ),
        ("a.ply", &["the normal map", "the alpha mask"]),
    ] {
        let warned = warnings(|| scene.write(folder.path(name)).expect("a file"));
        for part in parts {
            assert!(
                warned.iter().any(|t| t.contains(part)),
                "{name}: {warned:?}"
            );
        }
    }
}

/// What refines a surface is left out with a warning, also where the file requires it; what its shape depends on is not.
#[test]
fn extensions_that_are_not_read() {
    let folder = Folder::new("extensions");
    let load = |name: &str| {
        let mut file = Gltf::square();
        file.json["extensionsUsed"] = json!([name]);
        file.json["extensionsRequired"] = json!([name]);
        let path = folder.write("a.glb", file.glb());
        let mut scene = None;
        let warned = warnings(|| scene = Some(Scene::load(path, &Device::flex())));
        (scene.expect("it was loaded"), warned)
    };
    for name in [
        "KHR_materials_unlit",
        "KHR_materials_clearcoat",
        "KHR_materials_variants",
        "KHR_texture_basisu",
        "EXT_lights_image_based",
        "KHR_animation_pointer",
    ] {
        let (scene, warned) = load(name);
        assert!(scene.is_ok(), "{name}: {scene:?}");
        assert!(warned.len() == 1 && warned[0].contains(name), "{warned:?}");
    }
    for (name, part) in [
        ("KHR_draco_mesh_compression", "compressed by Draco"),
        ("EXT_meshopt_compression", "compressed by meshopt"),
        ("EXT_mesh_gpu_instancing", "expected one of those known"),
    ] {
        let error = load(name).0.expect_err(name).to_string();
        assert!(error.contains(name) && error.contains(part), "{error}");
    }
}

#[test]
fn webp_is_read_as_png_is() {
    let folder = Folder::new("webp");
    let picture =
        image::RgbImage::from_fn(4, 4, |x, y| image::Rgb([60 * x as u8, 60 * y as u8, 9]));
    let texels = |format: image::ImageFormat, kind: &str, by_extension: bool| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut bytes, format).expect("a picture");
        let mut file = Gltf::textured(&data_uri(kind, &bytes.into_inner()));
        if by_extension {
            file.json["extensionsRequired"] = json!(["EXT_texture_webp"]);
            file.json["textures"][0] = json!({"extensions": {"EXT_texture_webp": {"source": 0}}});
        }
        let path = folder.write("a.glb", file.glb());
        let scene = Scene::load(path, &Device::flex()).expect("a scene");
        match base(&scene.objects[0].materials[0]) {
            ColorTexture::Texture { texels, .. } => values(texels),
            ColorTexture::Constant(_) => panic!("no texture"),
        }
    };
    let png = texels(image::ImageFormat::Png, "image/png", false);
    assert_eq!(texels(image::ImageFormat::WebP, "image/webp", true), png);
}

/// What shines is any value above 0: exporters write black textures for what does not emit.
#[test]
fn black_textures_are_no_light() {
    let folder = Folder::new("black-light");
    let load = |value: f32, factor: f64, intensity: f64| {
        let picture = HostImage::new(2, 2, vec![value; 12]).expect("an image");
        picture.write(folder.path("glow.png")).expect("a file");
        let mut file = Gltf::textured("glow.png");
        file.json["materials"][0]["emissiveTexture"] = json!({"index": 0});
        file.json["materials"][0]["emissiveFactor"] = json!([factor, factor, factor]);
        let light = json!({"type": "point", "intensity": intensity});
        file.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [light]}});
        file.json["nodes"][0]["extensions"] = json!({"KHR_lights_punctual": {"light": 0}});
        Scene::load(folder.write("a.glb", file.glb()), &Device::flex()).expect("a scene")
    };
    for (value, factor, intensity, lit) in [
        (0.0, 1.0, 0.0, false),
        (1.0, 0.0, 0.0, false),
        (1.0, 1.0, 0.0, true),
        (0.0, 1.0, 2.0, true),
    ] {
        let scene = load(value, factor, intensity);
        assert_eq!(scene.has_light(), lit, "{value} {factor} {intensity}");
    }
    // Those of other files, and tensors of a fit, too.
    let device = Device::flex();
    let with = |texels: Tensor<3>| {
        let emission = Material::emitter(ColorTexture::texture(texels));
        let uvs = Tensor::zeros([8, 2], &device);
        let cube = shapes::cube(&device).with_uvs(uvs);
        Scene::new().with_object(Object::new(cube).with_material(emission))
    };
    let black = Tensor::<3>::zeros([2, 2, 3], &device);
    assert!(!with(black.clone()).has_light());
    assert!(with(black.clone() + 0.1).has_light());
    let of_map = |map: Tensor<3>| {
        Scene::new()
            .with_environment(Environment::map(map))
            .has_light()
    };
    assert!(!of_map(black.clone()) && of_map(black + 0.1));
}

/// An image that is damaged behind its header is left out as one that is missing; where limits are strict both are
/// errors.
#[test]
fn damaged_images() {
    let folder = Folder::new("damaged");
    let noise = (0..3072u16).map(|i| f32::from(i).sin().abs()).collect();
    let image = HostImage::new(32, 32, noise).expect("an image");
    image.write(folder.path("cut.png")).expect("a file");
    let whole = std::fs::read(folder.path("cut.png")).expect("bytes");
    folder.write("cut.png", &whole[..whole.len() / 2]);
    let strict = LoadLimits::default().with_strict(true);
    for uri in ["cut.png", "nowhere.png"] {
        let path = folder.write("a.glb", Gltf::textured(uri).glb());
        let scene = Scene::load(&path, &Device::flex()).expect("a scene");
        let diffuse = base(&scene.objects[0].materials[0]);
        assert!(matches!(diffuse, ColorTexture::Constant(_)), "{uri}");
        let error = Scene::load_within(&path, &Device::flex(), &strict);
        says(message(error), [uri]);
    }
}
