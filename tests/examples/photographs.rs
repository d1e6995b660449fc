//! The whole way from photographs to an asset, with the set that has its truth.

use std::fs;
use std::path::Path;

use clap::Parser;
use softray::optim::metrics::{self, View};
use softray::photographs::{PhotographOptions, Photographs, Split};
use softray::prelude::*;

use super::photographs::{Arguments, Plan, run};

const SET: &str = "tests/data/photographs";

/// A short run, with a number of steps that does not depend on the machine: the shape, held-out views, and the base color
/// in the file that it writes. It finds that the light stands in the world.
#[test]
fn asset_of_the_ring() {
    let out = super::out("photographs");
    fs::create_dir_all(&out).expect("a folder");
    let _ = fs::remove_dir_all(out.join("steps"));
    let plan = Plan {
        size: 64,
        world: None,
        steps: vec![120, 40],
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
    let last = &numbers["levels"][1];
    let at_least = |name: &str, limit: f64| {
        let value = last[name].as_f64().expect("a number");
        assert!(value > limit, "{name}: {value}");
    };
    at_least("iou", 0.95);
    at_least("psnr_srgb", 22.0);
    for name in [
        "light.exr",
        "views.png",
        "relit.png",
        "turntable.gif",
        "log.txt",
    ] {
        assert!(out.join(name).exists(), "{name}");
    }
    let error = base_color_error(&out.join("asset.glb"));
    println!("base color: {error}");
    assert!(error < 0.25, "{error}");
}

/// The root mean square error of the base color of a file in held-out views, over the truth's root mean square, after the
/// best factor for each channel.
fn base_color_error(file: &Path) -> f64 {
    let device = Device::flex();
    let scene = Scene::load(file, &device).expect("the asset");
    let scene = scene.with_environment([1.0; 3]);
    let mut set = Photographs::open(SET).expect("the set");
    set.split_every(8).expect("a split");
    let options = PhotographOptions::new().with_longest_side(80);
    let held = set
        .load(&set.of_split(Split::Test), &options)
        .expect("views");
    for view in &mut set.views {
        let name = view.path.file_name().expect("a name");
        view.path = Path::new(SET).join("truth/base_color").join(name);
    }
    let truth = set
        .load(&set.of_split(Split::Test), &options)
        .expect("truth");
    let options = RenderOptions::new(80, 80).with_bounces(0).with_albedo();
    let see = |camera: &Camera| {
        let image = render(&scene, camera, &options).expect("an image");
        HostImage::from_tensor(&image.albedo.expect("requested")).expect("an image")
    };
    let images = held
        .photographs
        .iter()
        .map(|p| see(&p.camera.to_camera().expect("a camera")));
    let images: Vec<HostImage> = images.collect();
    let insides = held
        .photographs
        .iter()
        .map(|p| p.mask.iter().map(|&m| m > 0.99).collect());
    let insides: Vec<Vec<bool>> = insides.collect();
    let views = |images: &[HostImage], error: &mut dyn FnMut(&[View])| {
        let views = images.iter().zip(&truth.photographs).zip(&insides);
        let views = views.map(|((i, t), inside)| View::new(i, &t.color, inside).expect("a view"));
        error(&views.collect::<Vec<_>>());
    };
    let (mut scales, mut psnr, mut peak) = ([1.0; 3], 0.0, 0.0);
    views(&images, &mut |v| {
        scales = metrics::channel_scales(v).expect("factors")
    });
    let scaled: Vec<HostImage> = images.iter().map(|i| metrics::scaled(i, scales)).collect();
    views(&scaled, &mut |v| {
        psnr = metrics::psnr_linear(v).expect("a number")
    });
    let black: Vec<HostImage> = images
        .iter()
        .map(|i| metrics::scaled(i, [0.0; 3]))
        .collect();
    views(&black, &mut |v| {
        peak = metrics::psnr_linear(v).expect("a number")
    });
    10f64.powf((peak - psnr) / 20.0)
}
