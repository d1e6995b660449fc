//! Files that nobody meant to write: no panic, no hang, no unbounded memory, whatever the bytes.
//! The long tier goes on for 10 minutes with each kind of file; `SOFTRAY_FUZZ_SECONDS` sets another time.

use std::path::Path;
use std::time::{Duration, Instant};

use crate::common;
use crate::common::folder::Folder;
use crate::common::memory::peak;
use crate::common::process::alone;
use crate::gltf_maker::{Gltf, data_uri};
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;
use serde_json::{Value, json};
use softray::prelude::*;

/// Files of a scene and what came of loading it: rendered, or a message.
fn load(folder: &Path, obj: &[u8], mtl: &[u8]) -> Result<(), String> {
    std::fs::write(folder.join("a.obj"), obj).expect("a file");
    std::fs::write(folder.join("a.mtl"), mtl).expect("a file");
    let device = Device::flex();
    let scene = Scene::load(folder.join("a.obj"), &device).map_err(|e| e.to_string())?;
    seen(&scene)
}

/// Renders a scene unless it is large.
fn seen(scene: &Scene) -> Result<(), String> {
    let triangles: usize = scene.objects.iter().map(|o| o.mesh.faces.len()).sum();
    if triangles > 500 {
        return Ok(());
    }
    let camera = Camera::look_at([0.1, 0.2, 3.0], [0.0; 3]);
    let options = RenderOptions::new(2, 2).with_samples(1).with_bounces(1);
    let image = render(scene, &camera, &options).map_err(|e| e.to_string())?;
    assert_eq!(image.radiance.dims(), [2, 2, 3]);
    Ok(())
}

fn number() -> impl Strategy<Value = String> {
    prop_oneof![
        6 => (-3.0f64..3.0).prop_map(|v| format!("{v:.3}")),
        2 => (-9i64..9).prop_map(|v| v.to_string()),
        1 => prop_oneof![
            Just("nan"), Just("inf"), Just("-inf"), Just("1e999"), Just("1e-320"), Just("-0"),
            Just("2147483648"), Just("-2147483648"), Just("18446744073709551616"), Just("0x10"),
            Just("1/"), Just("//"), Just("1//1"), Just("1/2/3/4"), Just("é"), Just("+"), Just("."),
        ].prop_map(String::from),
    ]
}

fn line() -> impl Strategy<Value = String> {
    let keyword = prop_oneof![
        6 => Just("v"), 6 => Just("f"), 1 => Just("vt"), 1 => Just("vn"), 1 => Just("o"),
        1 => Just("g"), 1 => Just("usemtl"), 1 => Just("mtllib a.mtl"), 1 => Just("newmtl"),
        1 => Just("Kd"), 1 => Just("Ks"), 1 => Just("Ns"), 1 => Just("Ke"), 1 => Just("l"),
        1 => Just("p"), 1 => Just("#"), 1 => Just("s"), 1 => Just("map_Kd a.mtl"),
        1 => Just("mtllib ../../missing.mtl"), 1 => Just("\\"), 1 => Just("usemtl m"),
        1 => Just("newmtl m"),
    ];
    (keyword, prop::collection::vec(number(), 0..6))
        .prop_map(|(k, v)| format!("{k} {}", v.join(" ")))
}

fn text() -> impl Strategy<Value = Vec<u8>> {
    let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";
    (any::<bool>(), prop::collection::vec(line(), 0..12)).prop_map(move |(whole, lines)| {
        let before = if whole { vertices } else { "" };
        let after = if whole { "\nf 1 2 3\nf 1 3 4" } else { "" };
        format!("{before}{}{after}\n", lines.join("\n")).into_bytes()
    })
}

/// A good file with some bytes changed, cut or doubled.
fn damaged(good: Vec<u8>) -> impl Strategy<Value = Vec<u8>> {
    let edit = (
        any::<prop::sample::Index>(),
        any::<u8>(),
        0usize..4,
        1usize..30,
    );
    prop::collection::vec(edit, 0..8).prop_map(move |edits| {
        let mut bytes = good.clone();
        for (at, value, kind, length) in edits {
            if bytes.is_empty() {
                break;
            }
            let i = at.index(bytes.len());
            let end = (i + length).min(bytes.len());
            match kind {
                0 => bytes[i] = value,
                1 => drop(bytes.drain(i..end)),
                2 => {
                    let copy = bytes[i..end].to_vec();
                    bytes.splice(i..i, copy);
                }
                _ => bytes.insert(i, value),
            }
        }
        bytes
    })
}

/// How long to go on.
fn time(short: u64) -> Duration {
    let asked = std::env::var("SOFTRAY_FUZZ_SECONDS").ok();
    let asked = asked.and_then(|s| s.parse().ok());
    Duration::from_secs(asked.unwrap_or(if common::long() { 600 } else { short }))
}

/// Tries cases until the time is over: none takes longer than 20 s (a hang, not a slow machine), or more
/// than 512 MiB beyond what there was before; some load, some don't.
fn fuzz<T: std::fmt::Debug>(
    name: &str,
    time: Duration,
    strategy: impl Strategy<Value = T>,
    load: impl Fn(T) -> Result<(), String>,
) {
    let mut runner = TestRunner::deterministic();
    let (begin, mut cases, mut loaded) = (Instant::now(), 0, 0);
    let (mut slowest, mut largest) = (Duration::ZERO, 0.0f64);
    while begin.elapsed() < time {
        let case = strategy.new_tree(&mut runner).expect("a case").current();
        // Resets the highest resident memory to what there is now.
        let _ = std::fs::write("/proc/self/clear_refs", "5");
        let (start, before) = (Instant::now(), peak());
        let outcome = load(case);
        slowest = slowest.max(start.elapsed());
        largest = largest.max(peak() - before);
        cases += 1;
        match outcome {
            Ok(()) => loaded += 1,
            Err(message) => assert!(message.len() < 2000, "{message}"),
        }
    }
    println!(
        "{name}: {cases} cases, {loaded} loaded, the slowest in {slowest:?}, at most {largest:.0} MiB"
    );
    assert!(loaded > 0 && loaded < cases, "{name}: {loaded} of {cases}");
    assert!(slowest < Duration::from_secs(20), "{name}: {slowest:?}");
    assert!(largest < 512.0, "{name}: {largest} MiB");
}

/// A small picture in a format.
fn picture(format: image::ImageFormat) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let value = |x: u32, y: u32| ((x * 37 + y * 11) % 200) as f32 / 200.0;
    let written = match format {
        image::ImageFormat::Png | image::ImageFormat::Jpeg => {
            let byte = |x, y| (value(x, y) * 255.0) as u8;
            let image = image::RgbImage::from_fn(24, 16, |x, y| {
                image::Rgb([byte(x, y), byte(y, x), byte(x, x)])
            });
            image.write_to(&mut bytes, format)
        }
        _ => {
            let image = image::Rgb32FImage::from_fn(24, 16, |x, y| {
                image::Rgb([value(x, y), value(y, x), 2.0])
            });
            image.write_to(&mut bytes, format)
        }
    };
    written.expect("a picture");
    bytes.into_inner()
}

#[test]
fn any_bytes_are_an_image_or_an_error() {
    if !alone(any_bytes_are_an_image_or_an_error) {
        return;
    }
    use image::ImageFormat::{Hdr, Jpeg, OpenExr, Png};
    let folder = Folder::new("pictures");
    let limits = LoadLimits::default().with_pixels(1 << 20);
    for (format, ending) in [(Png, "png"), (Jpeg, "jpg"), (Hdr, "hdr"), (OpenExr, "exr")] {
        let path = folder.0.join(format!("a.{ending}"));
        fuzz(ending, time(2), damaged(picture(format)), |bytes| {
            std::fs::write(&path, bytes).expect("a file");
            let image = HostImage::read_within(&path, &limits).map_err(|e| e.to_string())?;
            assert_eq!(image.pixels.len(), 3 * image.width * image.height);
            Ok(())
        });
    }
}

#[test]
fn any_bytes_are_a_scene_file_or_an_error() {
    if !alone(any_bytes_are_a_scene_file_or_an_error) {
        return;
    }
    let folder = Folder::new("scenes");
    let data = common::reference("shadow");
    for entry in std::fs::read_dir(&data).expect("a scene").flatten() {
        let ending = entry.path().extension().map(|e| e.to_os_string());
        if ending.is_some_and(|e| e == "obj" || e == "mtl") {
            let name = entry.file_name();
            std::fs::copy(entry.path(), folder.0.join(name)).expect("a copy");
        }
    }
    let good = std::fs::read(data.join("scene.json")).expect("a scene");
    let path = folder.0.join("scene.json");
    fuzz("json", time(2), damaged(good), |bytes| {
        std::fs::write(&path, bytes).expect("a file");
        let file = SceneFile::load(&path, &Device::flex()).map_err(|e| e.to_string())?;
        let options = RenderOptions::new(2, 2).with_samples(1).with_bounces(0);
        let image = render(&file.scene, &file.camera, &options);
        image.map_err(|e| e.to_string()).map(|_| ())
    });
}

#[test]
fn any_bytes_load_or_are_an_error() {
    if !alone(any_bytes_load_or_are_an_error) {
        return;
    }
    let folder = Folder::new("fuzz");
    let data = common::reference("cornell");
    let file = |ending: &str| {
        let files = std::fs::read_dir(&data).expect("the Cornell box");
        let path = files
            .flatten()
            .map(|f| f.path())
            .find(|p| p.extension().is_some_and(|e| e == ending));
        std::fs::read(path.expect("a file")).expect("bytes")
    };
    // Its material file goes by another name here.
    let obj = String::from_utf8(file("obj")).expect("text");
    let obj: Vec<&str> = obj.lines().filter(|l| !l.starts_with("mtllib")).collect();
    let obj = format!("mtllib a.mtl\n{}\n", obj.join("\n")).into_bytes();
    let bytes = || prop::collection::vec(any::<u8>(), 0..400);
    let strategy = prop_oneof![
        (text(), text()),
        (damaged(obj), damaged(file("mtl"))),
        (bytes(), bytes()),
    ];
    fuzz("obj", time(10), strategy, |(obj, mtl)| {
        load(&folder.0, &obj, &mtl)
    });
}

/// A file with a bit of everything.
fn gltf() -> Gltf {
    Gltf::everything(&data_uri("image/png", &picture(image::ImageFormat::Png)))
}

/// All places of a JSON value below which there are none.
fn leaves<'a>(value: &'a mut Value, found: &mut Vec<&'a mut Value>) {
    match value {
        Value::Array(list) => list.iter_mut().for_each(|v| leaves(v, found)),
        Value::Object(map) => map.values_mut().for_each(|v| leaves(v, found)),
        leaf => found.push(leaf),
    }
}

/// A good file some of whose numbers and names are others.
fn changed() -> impl Strategy<Value = Gltf> {
    let value = prop_oneof![
        4 => (0u64..9).prop_map(Value::from),
        2 => (5120u64..5127).prop_map(Value::from),
        1 => any::<u64>().prop_map(Value::from),
        1 => any::<i32>().prop_map(Value::from),
        1 => any::<f64>().prop_map(Value::from),
        1 => prop_oneof![Just("VEC3"), Just("SCALAR"), Just("data:,"), Just("../x"), Just("")]
            .prop_map(Value::from),
        1 => prop_oneof![Just(json!(null)), Just(json!([])), Just(json!({})), Just(json!([0]))],
    ];
    let edit = (any::<prop::sample::Index>(), value);
    prop::collection::vec(edit, 0..4).prop_map(|edits| {
        let mut file = gltf();
        let mut all = Vec::new();
        leaves(&mut file.json, &mut all);
        for (at, value) in edits {
            let i = at.index(all.len());
            *all[i] = value;
        }
        file
    })
}

#[test]
fn any_bytes_are_gltf_or_an_error() {
    if !alone(any_bytes_are_gltf_or_an_error) {
        return;
    }
    let folder = Folder::new("gltf-fuzz");
    let path = folder.0.join("a.glb");
    // Whole numbers of instances: not the renderer is tested.
    let limits = LoadLimits::default()
        .with_pixels(1 << 20)
        .with_triangles(1 << 16);
    let strategy = prop_oneof![
        changed().prop_map(|file| file.glb()),
        damaged(gltf().glb()),
        damaged(gltf().gltf(&data_uri("", &gltf().buffer)).into_bytes()),
    ];
    fuzz("gltf", time(5), strategy, |bytes| {
        std::fs::write(&path, bytes).expect("a file");
        let scene = Scene::load_within(&path, &Device::flex(), &limits);
        seen(&scene.map_err(|e| e.to_string())?)
    });
}

#[test]
fn any_bytes_are_ply_or_an_error() {
    if !alone(any_bytes_are_ply_or_an_error) {
        return;
    }
    let folder = Folder::new("ply-fuzz");
    let path = folder.0.join("a.ply");
    let device = Device::flex();
    let ball = shapes::icosahedron(&device).smooth_normals();
    ball.write(&path).expect("a file");
    let binary = std::fs::read(&path).expect("bytes");
    let (first, second) = (
        "ply\nformat binary_".len(),
        "ply\nformat binary_little".len(),
    );
    let big = [&binary[..first], b"big", &binary[second..]].concat();
    let ascii = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
                 property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
                 element face 2\nproperty list uchar int vertex_indices\n\
                 property list uchar float texcoord\nend_header\n0 0 0 1 2 3\n1 0 0 4 5 6\n\
                 1 1 0 7 8 9\n0 1 0 0 0 0\n4 0 1 2 3 8 0 0 1 0 1 1 0 1\n3 0 1 3 6 0 0 0 0 1 1\n";
    let strategy = prop_oneof![damaged(binary), damaged(big), damaged(ascii.into()),];
    fuzz("ply", time(5), strategy, |bytes| {
        std::fs::write(&path, bytes).expect("a file");
        seen(&Scene::load(&path, &device).map_err(|e| e.to_string())?)
    });
}

#[test]
fn claims_of_size_are_not_believed() {
    if !alone(claims_of_size_are_not_believed) {
        return;
    }
    let folder = Folder::new("claims");
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n";
    // Without strictness some of it is a warning.
    let limits = LoadLimits::default().with_strict(true);
    let message = |obj: &str, mtl: &[u8]| {
        folder.write("a.mtl", mtl);
        let path = folder.write("a.obj", obj);
        let loaded = Scene::load_within(path, &Device::flex(), &limits);
        loaded.map(drop).expect_err("an error").to_string()
    };
    for index in [
        "2147483647",
        "4294967296",
        "-2147483648",
        "18446744073709551615",
        "0",
    ] {
        let text = message(&format!("{corners}f 1 2 {index}\n"), b"");
        assert!(text.contains("line 7"), "{index}: {text}");
    }
    // Headers of 65,535 × 65,535 pixels with nothing behind them.
    let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\xff\xff\0\0\xff\xff\x08\x02\0\0\0".to_vec();
    let crc = png[12..].iter().fold(!0u32, |mut crc, &byte| {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 {
                0xedb8_8320 ^ (crc >> 1)
            } else {
                crc >> 1
            };
        }
        crc
    });
    png.extend((!crc).to_be_bytes());
    let hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 65535 +X 65535\n".to_vec();
    let jpeg = b"\xff\xd8\xff\xc0\0\x11\x08\xff\xff\xff\xff\x03\x01\x22\0\x02\x11\x01\x03\x11\x01"
        .to_vec();
    for (name, header) in [("t.png", png), ("t.hdr", hdr), ("t.jpg", jpeg)] {
        std::fs::write(folder.0.join(name), &header).expect("a file");
        let obj = format!("mtllib a.mtl\nusemtl m\n{corners}f 1/1 2/2 3/3\n");
        let text = message(&obj, format!("newmtl m\nmap_Kd {name}\n").as_bytes());
        assert!(text.contains(name), "{text}");
    }
    assert!(peak() < 1500.0, "{} MiB", peak());
    // A file that is not there.
    let text = message(&format!("mtllib ../no/such.mtl\n{corners}f 1 2 3\n"), b"");
    assert!(
        text.contains("such.mtl") && text.contains("line 1"),
        "{text}"
    );
}
