//! Materials and lights of glTF files: what is read, and that what is written reads back to the same image.

use crate::common::folder::Folder;
use crate::common::materials::{base, metallic, model, roughness};
use crate::common::mistakes::warnings;
use crate::common::numbers::mean;
use crate::common::scenes::{facing_front, floor, lamp};
use crate::common::tensors::{radiance, values};
use crate::gltf_maker::{Gltf, data_uri};
use crate::written::{camera, near, texels, uvs};
use image::{ImageFormat, Rgba, RgbaImage};
use serde_json::{Value, json};
use softray::prelude::*;

/// Two pixels side by side.
fn png(pixels: [[u8; 4]; 2]) -> String {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = RgbaImage::from_fn(2, 1, |x, _| Rgba(pixels[x as usize]));
    image
        .write_to(&mut bytes, ImageFormat::Png)
        .expect("a PNG file");
    data_uri("image/png", &bytes.into_inner())
}

/// The square with a material, whose textures are images of pixels.
fn square(material: Value, images: &[[[u8; 4]; 2]]) -> Gltf {
    let mut file = Gltf::square();
    for &pixels in images {
        let source = file.push("images", json!({"uri": png(pixels)}));
        file.push("textures", json!({"source": source}));
    }
    file.material(material);
    file
}

/// The scene of a `.gltf` file, and the warnings of it.
fn load(file: &Gltf) -> (Scene, Vec<String>) {
    let folder = Folder::new("gltf-materials");
    let name = format!("{:?}.gltf", std::thread::current().id());
    let text = file.gltf(&data_uri("application/octet-stream", &file.buffer));
    let path = folder.write(&name, text);
    let mut scene = Scene::new();
    let warned = warnings(|| scene = Scene::load(path, &Device::flex()).expect("a scene"));
    (scene, warned)
}

fn number(texture: &ScalarTexture) -> Vec<f64> {
    match texture {
        ScalarTexture::Constant(p) => p.values().expect("a number").to_vec(),
        ScalarTexture::Texture { texels, .. } => values(texels),
    }
}

fn color(albedo: &ColorTexture) -> Vec<f64> {
    match albedo {
        ColorTexture::Constant(p) => p.values().expect("a color").to_vec(),
        ColorTexture::Texture { texels, .. } => values(texels),
    }
}

#[test]
fn metal_and_roughness_are_of_linear_channels() {
    let json = json!({
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.9, 0.6, 0.3, 1], "metallicFactor": 0.5, "roughnessFactor": 0.8,
            "metallicRoughnessTexture": {"index": 0}
        },
        "emissiveTexture": {"index": 1}, "emissiveFactor": [1, 0.5, 0],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 6}}
    });
    let file = square(
        json,
        &[
            [[9, 51, 255, 255], [7, 102, 0, 255]],
            [[255, 188, 5, 255], [0; 4]],
        ],
    );
    let (scene, warned) = load(&file);
    assert!(warned.is_empty(), "{warned:?}");
    let material = &scene.objects[0].materials[0];
    assert_eq!(model(material), "metallic roughness");
    near(&color(base(material)), &[0.9, 0.6, 0.3]);
    near(&number(roughness(material)), &[0.8 * 0.2, 0.8 * 0.4]);
    near(&number(metallic(material)), &[0.5, 0.0]);
    // Colors of emission are sRGB: 188 is 0.502886.
    let green = 0.502_886_5 * 3.0;
    near(
        &color(&material.emission),
        &[6.0, green, 0.0, 0.0, 0.0, 0.0],
    );
    // As a file that leaves out all of it.
    let (scene, _) = load(&square(json!({}), &[]));
    let material = &scene.objects[0].materials[0];
    assert_eq!(model(material), "metallic roughness");
    assert_eq!(number(metallic(material)), [1.0]);
    assert_eq!(number(roughness(material)), [1.0]);
}

#[test]
fn what_lets_all_light_pass_is_a_dielectric() {
    let glass = |transmission: f64, volume: Value, metallic: f64, ior: f64| {
        json!({
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.5, 1, 1, 1], "metallicFactor": metallic, "roughnessFactor": 0.25
            },
            "extensions": {
                "KHR_materials_transmission": {"transmissionFactor": transmission},
                "KHR_materials_ior": {"ior": ior}, "KHR_materials_volume": volume
            }
        })
    };
    let solid = json!({"thicknessFactor": 0.1});
    let (scene, warned) = load(&square(glass(1.0, solid.clone(), 0.0, 1.33), &[]));
    assert!(warned.is_empty(), "{warned:?}");
    let material = &scene.objects[0].materials[0];
    assert_eq!(model(material), "dielectric");
    near(&color(base(material)), &[0.5, 1.0, 1.0]);
    let Bsdf::Dielectric { ior, .. } = &material.bsdf else {
        panic!("{material:?}");
    };
    near(&number(ior), &[1.33]);
    near(&number(roughness(material)), &[0.25]);
    for (json, bsdf, part) in [
        (
            glass(1.0, json!({}), 0.0, 1.5),
            "dielectric",
            "walls without thickness",
        ),
        (
            glass(0.5, solid.clone(), 0.0, 1.5),
            "metallic roughness",
            "transmission of less",
        ),
        (
            glass(1.0, solid.clone(), 0.5, 1.5),
            "metallic roughness",
            "beside metal",
        ),
        (
            glass(0.0, json!({}), 0.0, 2.0),
            "metallic roughness",
            "indices of refraction",
        ),
    ] {
        let (scene, warned) = load(&square(json, &[]));
        assert_eq!(model(&scene.objects[0].materials[0]), bsdf, "{part}");
        assert!(warned.len() == 1 && warned[0].contains(part), "{warned:?}");
    }
    // Metal lets nothing pass, and its reflection has no index of refraction.
    let (_, warned) = load(&square(glass(1.0, solid.clone(), 1.0, 2.0), &[]));
    assert!(warned.is_empty(), "{warned:?}");
    // What doesn't refract renders, too.
    let (scene, _) = load(&square(glass(1.0, solid, 0.0, 1.0), &[]));
    let options = RenderOptions::new(4, 4).with_samples(1).with_bounces(2);
    let seen = radiance(&scene.with_environment([1.0; 3]), &camera(), &options);
    assert!(seen.iter().all(|v| v.is_finite()));
}

#[test]
fn lights_shine_along_their_nodes() {
    let mut file = Gltf::square();
    file.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 12, "color": [1, 0.5, 0.25]},
        {"type": "spot", "spot": {"outerConeAngle": 0.5}},
        {"type": "directional", "intensity": 3}
    ]}});
    let half = 0.5f64.sqrt();
    let node = |light: u32| json!({"KHR_lights_punctual": {"light": light}});
    file.json["nodes"] = json!([
        {"mesh": 0},
        {"children": [2, 3, 4], "translation": [1, 2, 3], "scale": [2, 2, 2]},
        {"translation": [0, 1, 0], "extensions": node(0)},
        {"rotation": [-half, 0, 0, half], "extensions": node(1)},
        {"rotation": [0, half, 0, half], "extensions": node(2)}
    ]);
    file.json["scenes"][0]["nodes"] = json!([0, 1]);
    let (scene, warned) = load(&file);
    assert!(warned.is_empty(), "{warned:?}");
    let of = |p: &Parameter<3>| p.values().expect("values");
    let [
        Light::Point {
            position,
            intensity,
        },
        Light::Spot {
            direction,
            inner,
            outer,
            ..
        },
        Light::Directional {
            direction: along,
            irradiance,
        },
    ] = &scene.lights[..]
    else {
        panic!("other lights");
    };
    near(&of(position), &[1.0, 4.0, 3.0]);
    near(&of(intensity), &[12.0, 6.0, 3.0]);
    near(&of(direction), &[0.0, -1.0, 0.0]);
    near(&inner.values().expect("an angle"), &[0.0]);
    near(&outer.values().expect("an angle"), &[0.5f64.to_degrees()]);
    near(&of(along), &[-1.0, 0.0, 0.0]);
    near(&of(irradiance), &[3.0; 3]);
}

/// All BSDFs of facets with and without textures, and all kinds of lights.
fn room() -> Scene {
    let device = Device::flex();
    let ball = |x: f64, z: f64, material: Material| {
        let mesh = shapes::icosphere(1, &device).scaled(0.45).smooth_normals();
        let name = format!("ball {x}");
        Object::new(mesh.translated([x, 0.5, z]))
            .with_name(&name)
            .with_material(material)
    };
    let rough = ScalarTexture::Texture {
        texels: texels([3, 2], |i| 0.2 + i as f32 / 9.0),
        wrap: Wrap::Mirror,
    };
    let metal = ScalarTexture::Texture {
        texels: texels([3, 2], |i| (i % 2) as f32),
        wrap: Wrap::Mirror,
    };
    let base = ColorTexture::texture(texels([2, 2, 3], |i| 0.05 + i as f32 / 14.0));
    let tiles = Material::metallic_roughness(base, metal, rough);
    let worn = ScalarTexture::texture(texels([1, 3], |i| 0.4 + i as f32 / 4.0));
    let wall = Material::metallic_roughness([0.8, 0.7, 0.2], 0.75, worn).with_compensated(false);
    let screen = ColorTexture::texture(texels([2, 3, 3], |i| (i * 7 % 5) as f32));
    let screen = Material::metallic_roughness([0.1; 3], 0.0, 0.4).with_emission(screen);
    let glass = Material::dielectric(1.45, 0.2).with_tint([0.5, 0.9, 1.0]);
    let gold = Material::conductor([0.2, 0.4, 1.4], [3.9, 2.4, 1.6], 0.3);
    let put =
        |mesh: Mesh, material: Material| Object::new(mesh.with_uvs(uvs())).with_material(material);
    Scene::new()
        .with_object(put(floor(2.0, 0.0, &device), tiles).with_name("floor"))
        .with_object(
            put(
                facing_front([-2.0, 2.0], [0.0, 3.0], -2.0, &device),
                wall.with_name("worn"),
            )
            .with_name("wall"),
        )
        .with_object(
            put(
                facing_front([-0.5, 0.5], [1.2, 1.9], -1.5, &device),
                screen.with_name("screen"),
            )
            .with_name("screen"),
        )
        .with_object(ball(-0.9, 0.3, glass.with_name("glass")))
        .with_object(ball(0.0, -0.4, gold.with_name("gold")))
        .with_object(ball(
            0.9,
            0.2,
            Material::metallic_roughness([0.9, 0.2, 0.1], 0.0, 0.35),
        ))
        .with_object(lamp(0.8, 2.9, [3.0, 2.5, 2.0], &device).with_name("lamp"))
        .with_light(Light::point([1.0, 2.0, 1.5], [3.1, 2.2, 0.3]))
        .with_light(Light::spot(
            [-1.5, 2.5, 1.0],
            [3.0, -4.0, -1.0],
            [9.0, 12.0, 7.7],
            11.5,
            34.0,
        ))
        .with_light(Light::directional([0.3, -1.0, -0.4], [0.3, 0.2, 0.4]))
}

fn image(scene: &Scene) -> Vec<f64> {
    let options = RenderOptions::new(24, 24).with_samples(4).with_bounces(3);
    radiance(scene, &camera(), &options)
}

/// Writes a scene and reads it back, both without a warning.
fn there_and_back(scene: &Scene, name: &str) -> Scene {
    let folder = Folder::new("gltf-there-and-back");
    let path = folder.path(name);
    let mut back = Scene::new();
    let warned = warnings(|| {
        scene.write(&path).expect("a file");
        back = Scene::load(&path, &Device::flex()).expect("a scene");
    });
    assert!(warned.is_empty(), "{warned:?}");
    back
}

#[test]
fn facets_and_lights_read_back_to_the_same_image() {
    let scene = room();
    let before = image(&scene);
    assert!(mean(&before) > 0.1, "{}", mean(&before));
    let back = there_and_back(&scene, "room.glb");
    let bsdfs = |scene: &Scene| -> Vec<&'static str> {
        let materials = scene.objects.iter().flat_map(|o| &o.materials);
        materials.map(model).collect()
    };
    assert_eq!(bsdfs(&back), bsdfs(&scene));
    // Textures are of 16 bits; by that much a path may choose another lobe.
    let differences = |other: &[f64]| -> Vec<f64> {
        before
            .iter()
            .zip(other)
            .map(|(a, b)| (a - b).abs())
            .collect()
    };
    let (other, same): (Vec<f64>, Vec<f64>) =
        differences(&image(&back)).iter().partition(|d| **d > 1e-3);
    println!(
        "{} numbers differ, the others by {:.1e}",
        other.len(),
        mean(&same)
    );
    assert!(other.len() < 9 && mean(&same) < 2e-5);
    // Each of them counts.
    let changes: [fn(&mut Scene); 4] = [
        |scene| scene.lights.clear(),
        |scene| match &mut scene.objects[4].materials[0].bsdf {
            Bsdf::Conductor { roughness, .. } => *roughness = 0.6.into(),
            _ => panic!("no conductor"),
        },
        |scene| match &mut scene.objects[3].materials[0].bsdf {
            Bsdf::Dielectric { ior, .. } => *ior = 1.2.into(),
            _ => panic!("no dielectric"),
        },
        |scene| {
            let material = &mut scene.objects[1].materials[0];
            *material = material.clone().with_compensated(true);
        },
    ];
    for change in changes {
        let mut changed = back.clone();
        change(&mut changed);
        let wrong = differences(&image(&changed))
            .into_iter()
            .filter(|d| *d > 1e-3)
            .count();
        assert!(wrong > 60, "{wrong}");
    }
}

#[test]
fn what_gltf_can_not_hold_warns() {
    let device = Device::flex();
    let square = |material: Material| {
        let mesh = floor(1.0, 0.0, &device).with_uvs(uvs());
        Scene::new().with_object(
            Object::new(mesh)
                .with_name("square")
                .with_material(material),
        )
    };
    let image = |height: usize| ScalarTexture::texture(texels([height, 2], |i| 0.1 * i as f32));
    let warned = |scene: &Scene, name: &str| {
        let folder = Folder::new("gltf-losses");
        warnings(|| scene.write(folder.path(name)).expect("a file"))
    };
    let other_size = square(Material::metallic_roughness([0.5; 3], image(1), image(2)));
    let refraction = Material::dielectric(ScalarTexture::texture(texels([1, 2], |_| 1.4)), 0.0);
    let refraction = square(refraction);
    let dark = Scene::clone(&refraction).with_light(Light::point([0.0; 3], [-1.0, 1.0, 1.0]));
    for (scene, parts) in [
        (&other_size, &["of other sizes or wraps"][..]),
        (&refraction, &["indices of refraction"]),
        (&dark, &["no less than 0", "indices of refraction"]),
    ] {
        let warned = warned(scene, "a.glb");
        assert_eq!(warned.len(), parts.len(), "{warned:?}");
        assert!(
            parts.iter().all(|p| warned.iter().any(|t| t.contains(p))),
            "{warned:?}"
        );
    }
    let lit = Scene::new()
        .with_object(
            Object::new(shapes::cube(&device)).with_material(Material::dielectric(1.5, 0.0)),
        )
        .with_light(Light::directional([0.0, -1.0, 0.0], [1.0; 3]));
    for name in ["a.obj", "a.ply"] {
        let warned = warned(&lit, name);
        for part in [
            "lights without a surface",
            "without what only glTF has: the BSDF",
        ] {
            assert!(
                warned.iter().any(|t| t.contains(part)),
                "{name}: {warned:?}"
            );
        }
    }
}
