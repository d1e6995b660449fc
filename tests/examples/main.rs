//! What the examples do with `--quick`: what is fitted ends at least ten times as near to its target as
//! it began. Seeds are fixed.
#![allow(dead_code, clippy::duplicate_mod)] // examples are programs of their own

use std::path::PathBuf;

#[path = "../../examples/camera_pose.rs"]
mod camera_pose;
#[path = "../../examples/cornell_box.rs"]
mod cornell_box;
#[path = "../../examples/fig1_gradients.rs"]
mod fig1_gradients;
#[path = "../../examples/fig2_shadow.rs"]
mod fig2_shadow;
#[path = "../../examples/fig3_indirect.rs"]
mod fig3_indirect;
#[path = "../../examples/fig4_motion.rs"]
mod fig4_motion;
#[path = "../../examples/fig5_aperture.rs"]
mod fig5_aperture;
#[path = "../../examples/material.rs"]
mod material;
#[path = "../../examples/mesh_from_views.rs"]
mod mesh_from_views;
#[path = "../../examples/mesh_predictor/main.rs"]
mod mesh_predictor;
#[path = "../../examples/metal_and_glass.rs"]
mod metal_and_glass;
#[path = "../../examples/mirror.rs"]
mod mirror;
#[path = "../../examples/photographs/main.rs"]
mod photographs;
#[path = "photographs.rs"]
mod photographs_test;
#[path = "../../examples/relief.rs"]
mod relief;
#[path = "../../examples/render.rs"]
mod render;
#[path = "../../examples/texture.rs"]
mod texture;
#[path = "../../examples/topology.rs"]
mod topology;

fn out(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("example-{name}"))
}

/// The quick fit of an example; its error at the start over that at the end, and its figure.
macro_rules! quick {
    ($example:ident) => {{
        let out = out(stringify!($example));
        let arguments = $example::common::study::Arguments::for_tests(out.clone());
        let outcome = $example::run(&arguments).expect("a fit");
        let figure = out.join(concat!(stringify!($example), ".png"));
        assert!(figure.exists(), "{figure:?}");
        outcome
    }};
}

/// The first command of README: from 10° to the target, in fewer steps and samples of the picture.
#[test]
fn angle_of_a_block() {
    let out = out("cornell_box");
    let folder = out.to_str().expect("a path");
    let line = ["", "--spp", "1", "--steps", "100", "--out", folder];
    let arguments = <cornell_box::Arguments as clap::Parser>::parse_from(line);
    let angle = cornell_box::run(&arguments).expect("a fit");
    assert!(angle.abs() < 1.0, "{angle}");
    assert!(out.join("cornell_box_fit.png").exists());
}

/// The derivative image of the first figure against central differences of sharp renders. Blur and
/// noise of both leave a few per cent.
#[test]
fn gradients() {
    let agreement = quick!(fig1_gradients);
    assert!(agreement.correlation > 0.95, "{agreement:?}");
    assert!((0.9..1.1).contains(&agreement.slope), "{agreement:?}");
}

/// From 2.0 scene units, where the shadow lies outside of the image, to under 0.01.
#[test]
fn shadow() {
    let outcome = quick!(fig2_shadow);
    assert!(outcome.errors[0] >= 2.0, "{outcome:?}");
    assert!(outcome.errors[1] < 0.01, "{outcome:?}");
}

#[test]
fn indirect() {
    let outcome = quick!(fig3_indirect);
    assert!(outcome.ratio() > 10.0, "{outcome:?}");
}

#[test]
fn motion() {
    let outcome = quick!(fig4_motion);
    assert!(outcome.ratio() > 15.0, "{outcome:?}");
}

#[test]
fn aperture() {
    let outcome = quick!(fig5_aperture);
    assert!(outcome.ratio() > 10.0, "{outcome:?}");
}

#[test]
fn texture_of_a_ball() {
    let outcome = quick!(texture);
    assert!(outcome.ratio() > 10.0, "{outcome:?}");
}

#[test]
fn pose_of_a_camera() {
    let outcome = quick!(camera_pose);
    assert!(outcome.ratio() > 10.0, "{outcome:?}");
}

#[test]
fn material_of_a_ball() {
    let outcome = quick!(material);
    assert!(outcome.ratio() > 10.0, "{outcome:?}");
}

#[test]
fn roughness_of_metal_and_glass() {
    let outcome = quick!(metal_and_glass);
    assert!(outcome.ratio() > 5.0, "{outcome:?}");
}

#[test]
fn relief_of_a_plate() {
    let outcome = quick!(relief);
    assert!(outcome.ratio() > 5.0, "{outcome:?}");
}

#[test]
fn mesh() {
    let outcome = quick!(mesh_from_views);
    assert!(outcome.ratio() > 10.0, "{outcome:?}");
}

/// A ball becomes a torus with one hole, and another one two balls.
#[test]
fn topology_from_pictures() {
    let outcome = quick!(topology);
    assert!(outcome.ratio() > 4.0, "{outcome:?}");
    let found: Vec<f64> = outcome.others.iter().map(|(_, value)| *value).collect();
    assert_eq!(found, [1.0, 1.0, 2.0, 0.0], "{outcome:?}");
}

/// A few seconds of training teach a network what it sees: its predictions overlap with objects that the training has not
/// seen, more than before it and more than those for other images, and so do their volumes.
#[test]
fn bodies_from_single_images() {
    let out = out("mesh_predictor");
    let arguments = mesh_predictor::common::study::Arguments::for_tests(out.clone());
    let settings = mesh_predictor::settings::Settings::tiny();
    let outcome = mesh_predictor::learn(&arguments, &settings, Vec::new()).expect("training");
    assert!(out.join("mesh_predictor.png").exists());
    let [before, after] = [outcome.before, outcome.after].map(|scores| scores.silhouettes[0]);
    assert!(after > before + 0.05, "{outcome:?}");
    assert!(after > outcome.after.of_another[0] + 0.02, "{outcome:?}");
    assert!(
        outcome.after.volume > outcome.before.volume + 0.02,
        "{outcome:?}"
    );
    // The far side is at best simple.
    assert!((0.5..0.95).contains(&outcome.visible_side), "{outcome:?}");
}

#[test]
fn reflection() {
    let outcome = quick!(mirror);
    assert!(outcome.ratio() > 10.0, "{outcome:?}");
}

/// A lamp in candela is far too bright for a picture of 8 bits, unless it is exposed for it. An .exr has its light.
#[test]
fn exposure() {
    let folder = out("exposure");
    std::fs::create_dir_all(&folder).expect("a folder");
    let file = |name: &str| folder.join(name).display().to_string();
    let wall = "v -9 -9 0\nv 9 -9 0\nv 9 9 0\nv -9 9 0\nf 1 2 3 4\n";
    std::fs::write(file("wall.obj"), wall).expect("a file");
    let scene = r#"{"obj": "wall.obj", "camera": {"eye": [0, 0, 4], "target": [0, 0, 0],
        "fov_y_degrees": 40, "width": 8, "height": 8}, "lights": [
        {"kind": "point", "position": [0, 0, 4], "intensity": [50000, 50000, 50000]}]}"#;
    std::fs::write(file("scene.json"), scene).expect("a file");
    let mean = |name: &str, more: &[&str]| {
        let (scene, out) = (file("scene.json"), file(name));
        let all = ["render", &scene, "--out", &out, "--spp", "4"];
        let all = all.iter().chain(more);
        let arguments = <render::Arguments as clap::Parser>::try_parse_from(all);
        render::run(&arguments.expect("arguments")).expect("a picture");
        let image = softray::prelude::HostImage::read(&out).expect("a picture");
        image.mean()[0]
    };
    let linear = mean("linear.exr", &[]);
    assert!(linear > 300.0, "{linear}");
    assert_eq!(mean("same.exr", &["--exposure", "-9"]), linear);
    let automatic = mean("automatic.png", &[]);
    assert!((0.1..0.3).contains(&automatic), "{automatic}");
    assert!(mean("as_it_is.png", &["--exposure", "0"]) > 0.99);
    mean("inputs.exr", &["--denoiser-inputs", "--clamp", "5"]);
    for name in ["color", "albedo", "normal"] {
        assert!(folder.join(format!("inputs.{name}.pfm")).exists(), "{name}");
    }
    let set = mean("set.png", &["--exposure", "-12"]);
    assert!((set * 4096.0 / linear - 1.0).abs() < 0.05, "{set} {linear}");
}
