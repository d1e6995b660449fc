//! A replayed render is the taped one: value, gradients, whatever the loss, the tiles and the
//! threads; and its memory does not grow.

mod common;

use burn::tensor::{DType, Device};
use common::stress::World;
use common::{cpu_devices, values};
use softray::prelude::*;

fn worlds() -> Vec<(&'static str, World)> {
    let small = || {
        World::new().with(|w| {
            w.options = RenderOptions::new(9, 7)
                .samples(6)
                .bounces(2)
                .sigma(1e-3)
                .rays_per_tile(100)
                .fused(false)
                .seed(11);
        })
    };
    vec![
        ("all", {
            small().with(|w| {
                w.lens = Some((0.1, 4.0));
                w.thing("ball").velocity = Some([0.3, 0.1, 0.0]);
                let uvs = vec![[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]];
                w.thing("floor").texture = Some(([2, 2], vec![0.4; 12], uvs));
            })
        }),
        ("roulette, softmax", {
            small().with(|w| {
                let options = w.options.clone().russian_roulette(0);
                w.options = options.visibility(Visibility::softmax(1e-2));
            })
        }),
        ("soft order", {
            small().with(|w| {
                let form = Visibility::LayeredSoft { gamma: 0.02 };
                w.options = w.options.clone().visibility(form);
            })
        }),
    ]
}

#[test]
fn it_is_the_taped_render() {
    for device in cpu_devices() {
        for (name, world) in worlds() {
            let taped = world.run(&device, DType::F64).expect("an image");
            let replayed = world
                .clone()
                .with(|w| w.options = w.options.clone().replay());
            let replayed = replayed.run(&device, DType::F64).expect("an image");
            for (a, b) in taped.image.iter().zip(&replayed.image) {
                assert!((a - b).abs() < 1e-12, "{name}: {a} and {b}");
            }
            for (parameter, gradient) in &taped.gradients {
                let scale = gradient.iter().fold(1e-12f64, |m, g| m.max(g.abs()));
                for (a, b) in gradient.iter().zip(replayed.gradient(parameter)) {
                    assert!(
                        (a - b).abs() < 1e-9 * scale,
                        "{name}, {parameter}: {a} and {b}"
                    );
                }
            }
        }
    }
}

fn cornell(device: &Device) -> SceneFile {
    SceneFile::load(common::reference("cornell/scene.json"), device).expect("a scene")
}

/// The gradient of a loss that is not linear in the image, with outputs beside radiance, through a
/// part of the user's own before the scene.
fn of_a_loss(options: &RenderOptions) -> (f64, Vec<f64>) {
    let device = Device::flex();
    let angle = Tensor::<1>::from_floats([0.2], &device)
        .autodiff()
        .require_grad();
    let file = cornell(&device);
    let scene = file.scene.map_object("short", |o| {
        let turn = Transform::new().axis_angle([0.0, 1.0, 0.0], angle.clone().sin() * 0.5);
        o.map_mesh(|m| m.transformed(&turn))
    });
    let image = render(&scene, &file.camera, options).expect("an image");
    let opacity = image.opacity.expect("opacity").sum();
    let depth = image.depth.expect("depth").mean();
    let loss = image.radiance.powf_scalar(2.0).mean().log() + opacity * 0.01 + depth.sqrt();
    let gradients = loss.backward();
    let gradient = angle.grad(&gradients).expect("a gradient");
    (values(&loss)[0], values(&gradient))
}

#[test]
fn any_loss_and_any_threads() {
    let options = RenderOptions::new(24, 24)
        .samples(8)
        .bounces(1)
        .sigma(1e-2)
        .with_opacity()
        .with_depth();
    let (loss, taped) = of_a_loss(&options.clone().fused(false));
    for fused in [false, true] {
        let replay = options.clone().replay().fused(fused).rays_per_tile(512);
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.expect("threads").install(|| of_a_loss(&replay))
        };
        let one = on(1);
        assert!(
            (one.0 - loss).abs() < 1e-5 * loss.abs(),
            "{} and {loss}",
            one.0
        );
        assert!(
            (one.1[0] - taped[0]).abs() < 1e-3 * taped[0].abs(),
            "{one:?} and {taped:?}"
        );
        for threads in [2, 3, 5] {
            assert_eq!(one, on(threads), "{threads} threads");
        }
    }
}

#[test]
fn pixels_are_those_of_the_image() {
    let device = Device::flex();
    let file = cornell(&device);
    let options = RenderOptions::new(20, 16).samples(5).bounces(2).seed(3);
    let whole = render(&file.scene, &file.camera, &options).expect("an image");
    let whole = values(&whole.radiance);
    let pixels: Vec<u32> = (0..97).map(|i| (i * 37) % 320).collect();
    let part = render_pixels(&file.scene, &file.camera, &options, &pixels).expect("pixels");
    assert_eq!(part.radiance.dims(), [1, 97, 3]);
    let part = values(&part.radiance);
    for (i, &p) in pixels.iter().enumerate() {
        let p = p as usize;
        assert_eq!(part[3 * i..3 * i + 3], whole[3 * p..3 * p + 3], "pixel {p}");
    }
    let at = |list: &[u32]| render_pixels(&file.scene, &file.camera, &options, list);
    assert!(
        at(&[320])
            .expect_err("an error")
            .to_string()
            .contains("320")
    );
    assert!(at(&[]).is_err());
}

/// Resident memory at its highest, in MiB.
fn peak() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with("VmHWM:"));
    let value = line.and_then(|l| l.split_whitespace().nth(1)?.parse::<f64>().ok());
    value.unwrap_or(0.0) / 1024.0
}

/// The peak of forward and backward in a process of its own.
fn peak_of(samples: u32, bounces: u32, fused: bool) -> f64 {
    let this = std::env::current_exe().expect("this test");
    let output = std::process::Command::new(this)
        .args(["--exact", "memory_is_that_of_a_tile", "--nocapture"])
        .env(
            "SOFTRAY_SETTINGS",
            format!("{samples} {bounces} {}", u32::from(fused)),
        )
        .output()
        .expect("a process");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let line = text.lines().find_map(|l| l.strip_prefix("peak "));
    line.and_then(|l| l.parse().ok())
        .unwrap_or_else(|| panic!("{text}"))
}

#[test]
fn memory_is_that_of_a_tile() {
    if let Ok(settings) = std::env::var("SOFTRAY_SETTINGS") {
        let numbers: Vec<u32> = settings
            .split(' ')
            .map(|v| v.parse().expect("a number"))
            .collect();
        let device = Device::flex();
        let mut file = cornell(&device);
        for object in &mut file.scene.objects {
            let leaf = object.mesh.vertices.clone().autodiff().require_grad();
            object.mesh = object.mesh.clone().with_vertices(leaf);
        }
        let options = RenderOptions::new(64, 64)
            .samples(numbers[0])
            .bounces(numbers[1])
            .fused(numbers[2] == 1)
            .replay();
        let image = render(&file.scene, &file.camera, &options).expect("an image");
        image.radiance.powf_scalar(2.0).mean().backward();
        println!("peak {}", peak());
        return;
    }
    for fused in [false, true] {
        let samples = [4, 64, 256].map(|s| peak_of(s, 1, fused));
        let bounces = [1, 3, 8].map(|b| peak_of(16, b, fused));
        println!("fused {fused}: over samples {samples:.1?} MiB, over bounces {bounces:.1?} MiB");
        for list in [samples, bounces] {
            let largest = list.iter().fold(0.0f64, |m, v| m.max(*v));
            // Fused kernels keep a log of what rays found, up to 64 MiB.
            let most = if fused { list[0] + 64.0 } else { 1.3 * list[0] };
            assert!(largest < most && largest < 160.0, "fused {fused}: {list:?}");
        }
    }
}
