//! The whole way from photographs to an asset, with the set that has its truth.

use std::fs;
use std::path::Path;

use clap::Parser;
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
