//! glTF and PLY files that nobody means well with: an error that says where the mistake is.

use crate::common::errors::{message, says};
use crate::common::folder::Folder;
use crate::common::memory::peak;
use crate::common::process::alone;
use crate::gltf_maker::{Gltf, data_uri};
use serde_json::{Value, json};
use softray::prelude::*;

fn load(folder: &Folder, file: &Gltf) -> softray::Result<Scene> {
    Scene::load(folder.write("a.glb", file.glb()), &Device::flex())
}

#[test]
#[expect(clippy::too_many_lines, reason = "a line for each mistake")]
fn mistakes_of_gltf_are_named() {
    let folder = Folder::new("gltf-mistakes");
    let cases = [
        (
            "/accessors/0/count",
            json!(5),
            "accessors[0] has 5 rows of 12 bytes",
        ),
        (
            "/accessors/0/count",
            json!(u64::MAX),
            "accessors[0] has 18446744073709551615 rows",
        ),
        ("/accessors/0/count", json!(-1), "accessors[0].count"),
        (
            "/accessors/0/byteOffset",
            json!(u64::MAX),
            "accessors[0] has 4 rows",
        ),
        (
            "/accessors/0/componentType",
            json!(5124),
            "accessors[0].componentType is 5124",
        ),
        (
            "/accessors/0/type",
            json!("MAT4"),
            "accessors[0].type is \"MAT4\"",
        ),
        (
            "/accessors/0/type",
            json!("VEC2"),
            "primitives[0].attributes.POSITION has rows of 2",
        ),
        (
            "/accessors/0/bufferView",
            json!(9),
            "accessors[0].bufferView is 9, expected an index of bufferViews, which has 3",
        ),
        (
            "/accessors/1/count",
            json!(3),
            "attributes.TEXCOORD_0 has 3 rows, but there are 4 positions",
        ),
        (
            "/accessors/2/componentType",
            json!(5122),
            "primitives[0].indices are no scalars",
        ),
        (
            "/accessors/2/count",
            json!(100),
            "accessors[2] has 100 rows",
        ),
        (
            "/bufferViews/0/byteLength",
            json!(9999),
            "bufferViews[0] ends after byte 9999 of buffers[0]",
        ),
        (
            "/bufferViews/0/byteOffset",
            json!(u64::MAX),
            "bufferViews[0] ends after byte 184467440737095516",
        ),
        (
            "/bufferViews/0/buffer",
            json!(1),
            "bufferViews[0].buffer is 1",
        ),
        (
            "/bufferViews/0/byteStride",
            json!(4),
            "bufferViews[0].byteStride is 4, but a row",
        ),
        (
            "/buffers/0/byteLength",
            json!(1u64 << 40),
            "buffers[0].byteLength is 1099511627776",
        ),
        (
            "/meshes/0/primitives/0/attributes/POSITION",
            json!(77),
            "attributes.POSITION is 77",
        ),
        (
            "/meshes/0/primitives/0/attributes",
            json!({}),
            "attributes has no POSITION",
        ),
        (
            "/meshes/0/primitives/0/indices",
            json!(u64::MAX),
            "primitives[0].indices is 18446744073709551615",
        ),
        (
            "/meshes/0/primitives/0/mode",
            json!(7),
            "primitives[0].mode is 7",
        ),
        (
            "/meshes/0/primitives/0/material",
            json!(0),
            "primitives[0].material is 0",
        ),
        ("/meshes/0/primitives", json!({}), "meshes[0].primitives"),
        ("/nodes/0/mesh", json!(1), "nodes[0].mesh is 1"),
        ("/nodes/0/camera", json!(0), "nodes[0].camera is 0"),
        (
            "/nodes/0/children",
            json!([0]),
            "nodes[0].children[0] is 0, which has another parent or is above",
        ),
        (
            "/nodes/0/rotation",
            json!([0, 0, 0, 0]),
            "nodes[0].rotation is",
        ),
        (
            "/nodes/0/scale",
            json!([1e300, 1e300, 1e300]),
            "nodes[0] has a transform",
        ),
        (
            "/nodes/0/matrix",
            json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 2]),
            "nodes[0].matrix has the last row",
        ),
        (
            "/nodes/0/extensions",
            json!({"KHR_lights_punctual": {"light": 3}}),
            "light is 3, expected an index of lights",
        ),
        (
            "/scenes/0/nodes",
            json!([0, 0]),
            "scenes[0].nodes[1] is 0, which has another parent",
        ),
        ("/scene", json!(4), "scene is 4"),
        ("/asset/version", json!("1.0"), "asset.version is \"1.0\""),
        (
            "/extensionsRequired",
            json!(["KHR_draco_mesh_compression"]),
            "extensionsRequired[0] is \"KHR_draco",
        ),
        (
            "/materials",
            json!([{"pbrMetallicRoughness": {"metallicFactor": 2}}]),
            "materials[0].pbrMetallicRoughness.metallicFactor is 2",
        ),
        (
            "/materials",
            json!([{"emissiveFactor": [0, -1, 0]}]),
            "materials[0].emissiveFactor is -1",
        ),
        (
            "/materials",
            json!([{"alphaMode": "GLASS"}]),
            "materials[0].alphaMode: unknown variant `GLASS`",
        ),
        (
            "/materials",
            json!([{"emissiveTexture": {"index": 3}}]),
            "is 3, expected an index of textures",
        ),
        (
            "/materials",
            json!([{"extensions": {"KHR_materials_transmission": {"transmissionFactor": -1}}}]),
            "KHR_materials_transmission.transmissionFactor is -1",
        ),
        (
            "/materials",
            json!([{"extensions": {"KHR_materials_ior": {"ior": -2}}}]),
            "KHR_materials_ior.ior is -2",
        ),
        (
            "/materials",
            json!([{"extensions": {"KHR_materials_volume": {"thicknessFactor": 1e99}}}]),
            "KHR_materials_volume.thicknessFactor",
        ),
        (
            "/materials",
            json!([{"pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": 9}}}]),
            "metallicRoughnessTexture is 9, expected an index of textures",
        ),
        (
            "/materials",
            json!([{"alphaMode": "MASK", "alphaCutoff": -1}]),
            "materials[0].alphaCutoff is -1",
        ),
        (
            "/materials",
            json!([{"normalTexture": {"index": 9}}]),
            "normalTexture is 9, expected an index of textures",
        ),
        (
            "/materials",
            json!([{"extras": {"softray": {"phong": {"specularFactor": [2, 0, 0], "shininess": 1}}}}]),
            "extras.softray.phong.specularFactor is 2",
        ),
        (
            "/materials",
            json!([{"extras": {"softray": {"conductor": {"eta": [-1, 0, 0], "extinction": [0, 0, 0]}}}}]),
            "extras.softray.conductor.eta is -1",
        ),
        (
            "/meshes/0/primitives/0/attributes/COLOR_0",
            json!(1),
            "attributes.COLOR_0 has rows of 2, expected [3, 4]",
        ),
        (
            "/meshes/0/primitives/0/attributes/TANGENT",
            json!(0),
            "attributes.TANGENT has rows of 3, expected [4]",
        ),
        (
            "/buffers/0/uri",
            json!("http://a.b/c.bin"),
            "buffers[0].uri is of the scheme \"http\"",
        ),
        ("/buffers/0/uri", json!("data:text,abc"), "expected base64"),
        ("/buffers/0/uri", json!("data:;base64,a*c="), "no base64"),
        ("/buffers/0/uri", json!("/etc/passwd"), "lies outside"),
        (
            "/buffers/0/uri",
            json!("../../../../etc/passwd"),
            "lies outside",
        ),
        ("/buffers/0/uri", json!("%2Fetc%2Fpasswd"), "lies outside"),
        ("/buffers/0/uri", json!("none.bin"), "none.bin"),
    ];
    for (pointer, value, expected) in cases {
        let mut file = Gltf::square();
        let (parent, key) = pointer.rsplit_once('/').expect("a pointer");
        file.json.pointer_mut(parent).expect("a place")[key] = value;
        let error = message(load(&folder, &file).and_then(|scene| {
            // What only a render finds.
            let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]);
            render(
                &scene.with_environment([1.0; 3]),
                &camera,
                &RenderOptions::new(2, 2).with_samples(1),
            )
        }));
        assert!(error.contains(expected), "{pointer}: {error}");
        assert!(error.len() < 500, "{error}");
    }
}

/// Lights whose numbers are none.
#[test]
fn mistakes_of_lights_are_named() {
    let folder = Folder::new("gltf-lights");
    let spot = |inner: f64, outer: f64| json!({"type": "spot", "spot": {"innerConeAngle": inner, "outerConeAngle": outer}});
    let point = |intensity: f64, red: f64| json!({"type": "point", "intensity": intensity, "color": [red, 0, 0]});
    for (light, expected) in [
        (spot(1.0, 0.5), "lights[0].spot has the angles 1 and 0.5"),
        (spot(0.0, 3.0), "lights[0].spot has the angles 0 and 3"),
        (point(-1.0, 1.0), "lights[0].intensity is -1"),
        (point(1e99, 1.0), "lights[0].intensity"),
        (point(1.0, -1.0), "lights[0].color is -1"),
        (
            json!({"type": "sun"}),
            "lights[0].type: unknown variant `sun`",
        ),
    ] {
        let mut file = Gltf::square();
        file.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [light]}});
        file.json["nodes"][0]["extensions"] = json!({"KHR_lights_punctual": {"light": 0}});
        says(message(load(&folder, &file)), [expected]);
    }
}

/// A graph of 100,000 nodes one below the other, and one in which every node names the next one twice.
#[test]
fn deep_and_branching_graphs() {
    let folder = Folder::new("gltf-graphs");
    let mut file = Gltf::square();
    let count = 100_000;
    let mut nodes: Vec<Value> = (1..count)
        .map(|i| json!({"children": [i], "translation": [0.00001, 0, 0]}))
        .collect();
    nodes.push(json!({"mesh": 0}));
    file.json["nodes"] = json!(nodes);
    let scene = load(&folder, &file).expect("a scene");
    let corner = scene.objects[0].mesh.host_vertices().expect("values")[0];
    assert!((corner[0] - 0.99999).abs() < 1e-5, "{corner:?}");
    let twice: Vec<Value> = (1..60).map(|i| json!({"children": [i, i]})).collect();
    file.json["nodes"] = json!([twice, vec![json!({"mesh": 0})]].concat());
    let error = message(load(&folder, &file));
    says(
        error,
        ["nodes[0].children[1] is 1, which has another parent"],
    );
}

/// Numbers in a few bytes that stand for gigabytes.
#[test]
fn claims_of_gltf_are_not_believed() {
    if !alone(claims_of_gltf_are_not_believed) {
        return;
    }
    let folder = Folder::new("gltf-claims");
    let before = peak();
    // Zeros that no bytes stand for.
    let mut file = Gltf::square();
    let view = file.view(&[0]);
    let sparse = json!({"count": 1, "indices": {"bufferView": view, "componentType": 5121},
                        "values": {"bufferView": 0}});
    file.json["accessors"][0] = json!({"count": 4_000_000_000u64, "type": "VEC3",
                                       "componentType": 5126, "sparse": sparse});
    says(
        message(load(&folder, &file)),
        ["accessors[0].count is 4000000000 without a bufferView"],
    );
    // Many instances of one mesh.
    let mut file = Gltf::square();
    let nodes: Vec<Value> = (0..1000).map(|_| json!({"mesh": 0})).collect();
    file.json["nodes"] = json!(nodes);
    file.json["scenes"][0]["nodes"] = json!((0..1000).collect::<Vec<_>>());
    let path = folder.write("many.glb", file.glb());
    let limits = LoadLimits::default().with_triangles(1999);
    let error = message(Scene::load_within(&path, &Device::flex(), &limits));
    says(error, ["nodes[999].mesh", "LoadLimits::with_triangles"]);
    let limits = limits.with_triangles(2000);
    assert!(Scene::load_within(&path, &Device::flex(), &limits).is_ok());
    // A file larger than the limit.
    let limits = LoadLimits::default().with_text_bytes(100);
    let error = message(Scene::load_within(&path, &Device::flex(), &limits));
    says(error, ["many.glb", "LoadLimits::with_text_bytes"]);
    // A picture of many pixels.
    let mut file = Gltf::square();
    let image = HostImage::new(300, 200, vec![0.5; 300 * 200 * 3]).expect("an image");
    image.write(folder.path("large.png")).expect("a file");
    let bytes = std::fs::read(folder.path("large.png")).expect("bytes");
    file.push("images", json!({"uri": data_uri("image/png", &bytes)}));
    file.push("textures", json!({"source": 0}));
    file.material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    let path = folder.write("textured.glb", file.glb());
    let limits = LoadLimits::default().with_pixels(59_999);
    let error = message(Scene::load_within(&path, &Device::flex(), &limits));
    says(
        error,
        [
            "textured.glb, images[0]",
            "300 × 200",
            "LoadLimits::with_pixels",
        ],
    );
    assert!(peak() - before < 300.0, "{} MiB", peak() - before);
}

#[test]
fn images_outside_of_the_folder() {
    let folder = Folder::new("gltf-outside");
    let image = HostImage::new(2, 2, vec![0.5; 12]).expect("an image");
    image.write(folder.path("secret.png")).expect("a file");
    let mut file = Gltf::square();
    file.push("images", json!({"uri": "../secret.png"}));
    file.push("textures", json!({"source": 0}));
    file.material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    let path = folder.write("inner/a.glb", file.glb());
    let device = Device::flex();
    let error = message(Scene::load(&path, &device));
    says(
        &error,
        [
            "secret.png",
            "lies outside",
            "images[0].uri",
            "LoadLimits::with_outside",
        ],
    );
    let outside = LoadLimits::default().with_outside(true);
    assert!(Scene::load_within(&path, &device, &outside).is_ok());
    // A JSON file's scene, too.
    let json = json!({"scene": "../inner/a.glb", "camera": {"eye": [0, 0, 4], "target": [0, 0, 0],
                      "fov_y_degrees": 40, "width": 8, "height": 8}});
    let path = folder.write("other/scene.json", json.to_string());
    says(message(SceneFile::load(&path, &device)), ["lies outside"]);
}
