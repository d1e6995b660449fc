//! The whole way from photographs to an asset, with the set that has its truth.

use std::fs;
use std::path::Path;

use clap::Parser;
use glam::{DMat3, DQuat, DVec3};
use softray::optim::metrics::{self, View};
use softray::photographs::{Photograph, PhotographOptions, Photographs, Split};
use softray::prelude::*;

use super::photographs::{Arguments, Plan, run};

const SET: &str = "tests/data/photographs";

/// A short run, with a number of steps that does not depend on the machine: the shape, held-out views, and the base
/// color and roughness in the file that it writes. It finds that the light stands in the world.
#[test]
fn asset_of_the_ring() {
    let out = super::out("photographs");
    fs::create_dir_all(&out).expect("a folder");
    let _ = fs::remove_dir_all(out.join("steps"));
    let plan = Plan {
        folder: SET.into(),
        size: 64,
        hold_out: 8,
        steps: vec![100, 60, 60],
        ..Plan::default()
    };
    let text = serde_json::to_string(&plan).expect("numbers");
    fs::write(out.join("plan.json"), text).expect("a file");
    let folder = out.to_str().expect("a path");
    let line = ["", SET, "--quick", "--resume", "--out", folder];
    run(Arguments::parse_from(line)).expect("a result");

    let text = fs::read_to_string(out.join("metrics.json")).expect("numbers");
    let numbers: serde_json::Value = serde_json::from_str(&text).expect("numbers");
    assert_eq!(numbers["light"], "stands in the world", "{text}");
    let mesh = &numbers["mesh"];
    assert_eq!(
        (&mesh["closed"], &mesh["genus"]),
        (&true.into(), &1.into()),
        "{text}"
    );
    assert_eq!(mesh["crossings"], 0, "{text}");
    let last = &numbers["levels"][2];
    let at_least = |name: &str, limit: f64| {
        let value = last[name].as_f64().expect("a number");
        assert!(value > limit, "{name}: {value}");
    };
    at_least("iou", 0.98);
    at_least("psnr_srgb", 28.5);
    for name in [
        "light.exr",
        "views.png",
        "relit.png",
        "turntable.gif",
        "log.txt",
    ] {
        assert!(out.join(name).exists(), "{name}");
    }
    let [color, roughness] = surface_errors(&out.join("asset.glb"));
    println!("base color: {color}, roughness: {roughness}");
    assert!(color < 0.14, "{color}");
    // The best constant is 0.119 off.
    assert!(roughness < 0.11, "{roughness}");
}

/// A few steps with cameras as COLMAP writes them, with a wrong focal length: poses are refined, those of the
/// held-out photographs too. A run that was stopped before its last level goes on to the same file, and a run with
/// other settings does not go on.
#[test]
fn cameras_of_colmap_and_a_stopped_run() {
    let out = super::out("photographs-colmap");
    let _ = fs::remove_dir_all(&out);
    let folder = out.join("set");
    colmap_set(&folder);
    let plan = Plan {
        folder: folder.clone(),
        size: 32,
        hold_out: 8,
        world: Some(true),
        bounces: Some(0),
        steps: vec![6, 4],
        ..Plan::default()
    };
    let text = serde_json::to_string(&plan).expect("numbers");
    fs::write(out.join("plan.json"), text).expect("a file");
    let [set, folder] = [&folder, &out].map(|path| path.to_str().expect("a path"));
    let go_on = |size| {
        let line = ["", set, "--size", size, "--resume", "--out", folder];
        run(Arguments::parse_from(line))
    };
    go_on("32").expect("a result");
    let asset = fs::read(out.join("asset.glb")).expect("an asset");
    let text = fs::read_to_string(out.join("metrics.json")).expect("numbers");
    let numbers: serde_json::Value = serde_json::from_str(&text).expect("numbers");
    let last = &numbers["levels"][1];
    assert!(last["poses_refined"]["iou"].as_f64() > Some(0.9), "{text}");
    assert!(last["poses_moved_degrees"].as_f64() > Some(0.0), "{text}");
    assert!(numbers["levels"][0]["poses_refined"].is_null(), "{text}");

    fs::remove_dir_all(out.join("steps/1")).expect("a level");
    fs::remove_file(out.join("asset.glb")).expect("an asset");
    go_on("32").expect("a result");
    assert!(fs::read(out.join("asset.glb")).expect("an asset") == asset);

    let error = go_on("48").expect_err("another size").to_string();
    assert!(error.contains("plan.json: a run of other"), "{error}");
}

/// Writes every third photograph of the set with `cameras.txt` and `images.txt`. The focal length is 2 % too long.
fn colmap_set(folder: &Path) {
    let set = Photographs::open(SET).expect("the set");
    let sparse = folder.join("sparse/0");
    fs::create_dir_all(&sparse).expect("a folder");
    fs::create_dir_all(folder.join("images")).expect("a folder");
    let mut images = String::new();
    for (i, view) in set.views.iter().enumerate().step_by(3) {
        // The axes of OpenCV.
        let [x, y, z] = view.camera.from_world();
        let [y, z] = [y, z].map(|row| row.map(|v| -v));
        let rows = [x, y, z].map(|row| DVec3::new(row[0], row[1], row[2]));
        let [a, b, c] = rows;
        let q = DQuat::from_mat3(&DMat3::from_cols(a, b, c).transpose());
        let name = format!("{i:03}.png");
        images += &format!("{} {} {} {} {} ", i + 1, q.w, q.x, q.y, q.z);
        images += &format!("{} {} {} 1 {name}\n\n", x[3], y[3], z[3]);
        fs::copy(&view.path, folder.join("images").join(name)).expect("a photograph");
    }
    let camera = set.views[0].camera;
    let ([w, h], [fx, fy], [cx, cy]) = (camera.size, camera.focal, camera.principal);
    let cameras = format!("1 PINHOLE {w} {h} {} {} {cx} {cy}\n", 1.02 * fx, 1.02 * fy);
    let files = [
        ("cameras", cameras),
        ("images", images),
        ("points3D", String::new()),
    ];
    for (name, text) in files {
        fs::write(sparse.join(format!("{name}.txt")), text).expect("a file");
    }
}

/// The errors of a file in held-out views: the root mean square error of the base color, over the truth's root mean square,
/// after the best factor for each channel; and that of the roughness.
fn surface_errors(file: &Path) -> [f64; 2] {
    let device = Device::flex();
    let scene = Scene::load(file, &device).expect("the asset");
    let scene = scene.with_environment([1.0; 3]);
    let mut rough = scene.clone();
    for object in &mut rough.objects {
        let Bsdf::MetallicRoughness { roughness, .. } = &object.materials[0].bsdf else {
            panic!("{:?}", object.materials);
        };
        let ScalarTexture::Texture { texels, .. } = roughness else {
            panic!("{roughness:?}");
        };
        let gray = texels.clone().unsqueeze_dim::<3>(2).repeat(&[1, 1, 3]);
        object.materials = vec![Material::diffuse(ColorTexture::texture(gray))].into();
    }
    let mut set = Photographs::open(SET).expect("the set");
    set.split_every(8).expect("a split");
    let held = set.of_split(Split::Test);
    let options = PhotographOptions::new().with_longest_side(80);
    let held_out = set.load(&held, &options).expect("views").photographs;
    let mut truth = |folder: &str| {
        for view in &mut set.views {
            let name = view.path.file_name().expect("a name").to_owned();
            view.path = Path::new(SET).join("truth").join(folder).join(name);
        }
        set.load(&held, &options).expect("truth").photographs
    };
    let options = RenderOptions::new(80, 80).with_bounces(0).with_albedo();
    let see = |scene: &Scene, photograph: &Photograph| {
        let camera = photograph.camera.to_camera().expect("a camera");
        let image = render(scene, &camera, &options).expect("an image");
        HostImage::from_tensor(&image.albedo.expect("requested")).expect("an image")
    };
    let inside = |p: &Photograph| p.mask.iter().map(|&m| m > 0.99).collect();
    let insides: Vec<Vec<bool>> = held_out.iter().map(inside).collect();
    let error = |images: &[HostImage], truth: &[HostImage]| {
        let views = images.iter().zip(truth).zip(&insides);
        let views: Vec<View> = views
            .map(|((i, t), m)| View::new(i, t, m).expect("a view"))
            .collect();
        let psnr = metrics::psnr_linear(&views).expect("a number");
        let scales = metrics::channel_scales(&views).expect("factors");
        (10f64.powf(-psnr / 20.0), scales)
    };
    let black: Vec<HostImage> = held_out
        .iter()
        .map(|p| metrics::scaled(&p.color, [0.0; 3]))
        .collect();

    let colors: Vec<HostImage> = truth("base_color").into_iter().map(|p| p.color).collect();
    let images: Vec<HostImage> = held_out.iter().map(|p| see(&scene, p)).collect();
    let scales = error(&images, &colors).1;
    let scaled: Vec<HostImage> = images.iter().map(|i| metrics::scaled(i, scales)).collect();
    let base = error(&scaled, &colors).0 / error(&black, &colors).0;

    // Green is roughness, and these files are linear: what was decoded as sRGB is encoded again.
    let green = |p: Photograph| {
        let mut image = p.color;
        let values = image.to_srgb();
        for (pixel, value) in image.pixels.chunks_mut(3).zip(values.chunks(3)) {
            pixel.fill(f32::from(value[1]) / 255.0);
        }
        image
    };
    let values: Vec<HostImage> = truth("metallic_roughness").into_iter().map(green).collect();
    let images: Vec<HostImage> = held_out.iter().map(|p| see(&rough, p)).collect();
    [base, error(&images, &values).0]
}
