//! Fused kernels against the tensor form, in ratios of one run: `cargo bench --bench fused -- --help`.
//! Prints the Markdown tables of `docs/PERFORMANCE.md`.

use std::path::PathBuf;
use std::time::Instant;

use clap::{Parser, ValueEnum};
use softray::prelude::*;

/// Times fused kernels and the tensor form in turn, and prints the fastest runs of each.
#[derive(Parser)]
struct Arguments {
    /// What to measure [default: all].
    #[arg(value_enum)]
    parts: Vec<Part>,
    /// Runs of each, in turn.
    #[arg(long, default_value_t = 5)]
    runs: usize,
    /// Passed by cargo.
    #[arg(long, hide = true)]
    bench: bool,
    /// One forward and backward pass of the Cornell box, and the peak memory of the process.
    #[arg(long, hide = true)]
    peak: Option<u32>,
    /// So many forward passes at 32 × 32, 16,384 paths each, to count
    /// instructions of: `valgrind --tool=callgrind`, and the difference between two and one.
    #[arg(long)]
    passes: Option<usize>,
    /// With gradients, for `--passes`.
    #[arg(long, requires = "passes")]
    backward: bool,
    /// Which form of visibility, for `--passes`.
    #[arg(long, value_enum, default_value = "layered")]
    form: Form,
    /// A ball of 20·4ⁿ faces on a floor in place of the Cornell box, for `--passes`.
    #[arg(long, requires = "passes", value_name = "N")]
    ball: Option<u32>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Form {
    Layered,
    Softmax,
    LayeredSoft,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Part {
    /// The Cornell box: forms, engines, both passes, peak memory.
    Cornell,
    /// Camera rays alone, with direct light, and with bounces.
    Stages,
    /// A ball of 20 to 327,680 faces.
    Faces,
    /// One to all cores.
    Threads,
}

fn main() {
    let arguments = Arguments::parse();
    let form = FORMS[arguments.form as usize];
    if let Some(samples) = arguments.peak {
        let (scene, camera) = cornell();
        let options = of_cornell(form).samples(samples);
        pass(&scene, &camera, &options, true);
        println!("{:.0}", peak().unwrap_or(f64::NAN));
        return;
    }
    if let Some(passes) = arguments.passes {
        let (scene, camera, options) = match arguments.ball {
            Some(subdivisions) => {
                let (scene, camera, sigma) = ball(subdivisions);
                (scene, camera, of_ball(32, sigma).visibility(form))
            }
            None => {
                let (scene, camera) = cornell();
                (scene, camera, options(32, form))
            }
        };
        for _ in 0..passes {
            pass(&scene, &camera, &options, arguments.backward);
        }
        return;
    }
    let wanted = |part| arguments.parts.is_empty() || arguments.parts.contains(&part);
    let runs = arguments.runs.max(1);
    for (part, f) in [
        (Part::Cornell, of_forms as fn(usize)),
        (Part::Stages, of_stages),
        (Part::Faces, of_faces),
        (Part::Threads, of_threads),
    ] {
        if wanted(part) {
            f(runs);
            println!();
        }
    }
}

fn cornell() -> (Scene, Camera) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/cornell/scene.json");
    let file = SceneFile::load(path, &Device::flex()).expect("a scene");
    (file.scene, file.camera)
}

const SIZE: usize = 128;

fn of_cornell(form: Visibility) -> RenderOptions {
    options(SIZE, form)
}

fn options(size: usize, form: Visibility) -> RenderOptions {
    RenderOptions::new(size, size)
        .samples(16)
        .bounces(2)
        .sigma(1e-4)
        .visibility(form)
        .replay()
}

/// Seconds of a render, with gradients of all vertices on request.
fn pass(scene: &Scene, camera: &Camera, options: &RenderOptions, backward: bool) -> f64 {
    let start = Instant::now();
    if !backward {
        render(scene, camera, options).expect("an image");
        return start.elapsed().as_secs_f64();
    }
    let mut scene = scene.clone();
    let mut leaves = Vec::new();
    for object in &mut scene.objects {
        let vertices = object.mesh.vertices.clone().autodiff().require_grad();
        leaves.push(vertices.clone());
        object.mesh = object.mesh.clone().with_vertices(vertices);
    }
    let image = render(&scene, camera, options).expect("an image");
    let gradients = image.radiance.powf_scalar(2.0).sum().backward();
    let norms = leaves.iter().map(|leaf| {
        let gradient = leaf.grad(&gradients).expect("a gradient");
        gradient.abs().sum().into_scalar::<f32>()
    });
    assert!(norms.sum::<f32>().is_finite());
    start.elapsed().as_secs_f64()
}

/// The fastest of some runs of each, taken in turn.
fn in_turn<const N: usize>(runs: usize, f: [&dyn Fn() -> f64; N]) -> [f64; N] {
    let mut best = [f64::INFINITY; N];
    for _ in 0..runs {
        for (best, f) in best.iter_mut().zip(f) {
            *best = best.min(f());
        }
    }
    best
}

fn name(form: Visibility) -> &'static str {
    match form {
        Visibility::Layered => "layered",
        Visibility::Softmax { .. } => "softmax γ 1e-3",
        Visibility::LayeredSoft { .. } => "layered-soft γ 1e-3",
    }
}

const FORMS: [Visibility; 3] = [
    Visibility::Layered,
    Visibility::Softmax {
        gamma: 1e-3,
        epsilon: 1e-3,
    },
    Visibility::LayeredSoft { gamma: 1e-3 },
];

fn of_forms(runs: usize) {
    println!(
        "### Cornell box, {SIZE} × {SIZE}, 16 samples, 3 surfaces a path, σ = 1e-4, gradients of all vertices\n"
    );
    println!(
        "| form | pass | fused, s | paths/s | tensors, candidates, s | ratio | tensors, all triangles, s | ratio |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    let (scene, camera) = cornell();
    let paths = (SIZE * SIZE * 16) as f64;
    for form in FORMS {
        let fused = of_cornell(form);
        let tensors = fused.clone().fused(false);
        let all = fused.clone().brute_force();
        for backward in [false, true] {
            let [f, t] = in_turn(
                runs,
                [&|| pass(&scene, &camera, &fused, backward), &|| {
                    pass(&scene, &camera, &tensors, backward)
                }],
            );
            let a = pass(&scene, &camera, &all, backward);
            println!(
                "| {} | {} | {f:.3} | {:.0} | {t:.3} | {:.1} | {a:.2} | {:.0} |",
                name(form),
                if backward {
                    "forward + backward"
                } else {
                    "forward"
                },
                paths / f,
                t / f,
                a / f,
            );
        }
    }
    println!(
        "\n| samples | peak memory of the process, forward + backward, MiB: layered | softmax |\n|---|---|---|"
    );
    let peak = |samples: u32, form: &str| {
        let program = std::env::current_exe().expect("this program");
        let output = std::process::Command::new(program)
            .args(["--peak", &samples.to_string(), "--form", form])
            .output()
            .expect("a process");
        String::from_utf8_lossy(&output.stdout).trim().to_string()
    };
    for samples in [1u32, 16, 64] {
        let [layered, softmax] = ["layered", "softmax"].map(|form| peak(samples, form));
        println!("| {samples} | {layered} | {softmax} |");
    }
}

fn of_stages(runs: usize) {
    println!("### Stages: the Cornell box, {SIZE} × {SIZE}, 16 samples, layered\n");
    println!(
        "| bounces | lights | rays a path | fused forward, ns a ray | forward + backward | tensors, candidates, forward | forward + backward | ratios |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    let (scene, camera) = cornell();
    let mut dark = scene.clone().environment([1.0; 3]);
    for material in dark.objects.iter_mut().flat_map(|o| &mut o.materials) {
        *material = material.clone().emission([0.0; 3]);
    }
    for (scene, bounces, lights) in [
        (&dark, 0, "environment only"),
        (&scene, 0, "yes"),
        (&scene, 1, "yes"),
        (&scene, 2, "yes"),
        (&scene, 4, "yes"),
    ] {
        let fused = of_cornell(Visibility::Layered).bounces(bounces);
        let tensors = fused.clone().fused(false);
        let rays = render(scene, &camera, &fused)
            .expect("an image")
            .statistics
            .rays as f64;
        let [a, b, c, d] = in_turn(
            runs,
            [
                &|| pass(scene, &camera, &fused, false),
                &|| pass(scene, &camera, &fused, true),
                &|| pass(scene, &camera, &tensors, false),
                &|| pass(scene, &camera, &tensors, true),
            ],
        );
        let per_ray = |s: f64| s / rays * 1e9;
        println!(
            "| {bounces} | {lights} | {:.1} | {:.0} | {:.0} | {:.0} | {:.0} | {:.1}, {:.1} |",
            rays / (SIZE * SIZE * 16) as f64,
            per_ray(a),
            per_ray(b),
            per_ray(c),
            per_ray(d),
            c / a,
            d / b,
        );
    }
}

/// A ball on a floor under a light, and a blur of 0.1 mean edges.
fn ball(subdivisions: u32) -> (Scene, Camera, f64) {
    let device = Device::flex();
    let ball = shapes::icosphere(subdivisions, &device);
    // The mean edge of an icosphere of radius 1.
    let face = 4.0 * std::f64::consts::PI / ball.faces.len() as f64;
    let edge = (face * 4.0 / 3f64.sqrt()).sqrt();
    let floor = shapes::quad(
        [-4.0, -1.0, 4.0],
        [4.0, -1.0, 4.0],
        [4.0, -1.0, -4.0],
        [-4.0, -1.0, -4.0],
        &device,
    );
    let light = shapes::quad(
        [-1.0, 3.0, -1.0],
        [1.0, 3.0, -1.0],
        [1.0, 3.0, 1.0],
        [-1.0, 3.0, 1.0],
        &device,
    );
    let scene = Scene::new()
        .with(Object::new(ball).material(Material::diffuse([0.6, 0.5, 0.4])))
        .with(Object::new(floor).material(Material::diffuse([0.5; 3])))
        .with(Object::new(light).material(Material::emitter([8.0; 3])));
    let camera = Camera::look_at([0.0, 1.0, 5.0], [0.0, 0.0, 0.0]);
    (scene, camera, (0.1 * edge).powi(2))
}

fn of_ball(size: usize, sigma: f64) -> RenderOptions {
    RenderOptions::new(size, size)
        .samples(16)
        .bounces(1)
        .sigma(sigma)
        .replay()
}

fn of_faces(runs: usize) {
    println!(
        "### Faces: a ball on a floor under a light, {SIZE} × {SIZE}, 16 samples, 2 surfaces a path, σ = (0.1 mean edges)², layered\n"
    );
    println!(
        "| faces | σ | set-up: forward, with backward, s | forward, ns a ray | to 1,280 | forward + backward, ns a ray | to 1,280 | surfaces a ray | tensors, candidates, forward + backward | ratio |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let mut first = None;
    for subdivisions in [0u32, 1, 3, 4, 5, 6, 7] {
        let (scene, camera, sigma) = ball(subdivisions);
        let faces = scene.objects[0].mesh.faces.len();
        let options = of_ball(SIZE, sigma);
        let tensors = options.clone().fused(false);
        // What is done before the first ray, which a cache of boxes shortens.
        let few = of_ball(1, sigma).samples(1);
        let [f0, b0] = in_turn(
            runs.min(3),
            [&|| pass(&scene, &camera, &few, false), &|| {
                pass(&scene, &camera, &few, true)
            }],
        );
        let statistics = render(&scene, &camera, &options)
            .expect("an image")
            .statistics;
        let rays = statistics.rays as f64;
        let [a, b] = in_turn(
            runs.min(3),
            [&|| pass(&scene, &camera, &options, false), &|| {
                pass(&scene, &camera, &options, true)
            }],
        );
        let compared = faces <= 20_480;
        let t = if compared {
            pass(&scene, &camera, &tensors, true)
        } else {
            f64::NAN
        };
        let ns = [(a - f0) / rays * 1e9, (b - b0) / rays * 1e9];
        if faces == 1280 {
            first = Some(ns);
        }
        let ratio = |i: usize| first.map_or(String::new(), |f| format!("{:.2}", ns[i] / f[i]));
        println!(
            "| {faces} | {sigma:.1e} | {f0:.3}, {b0:.3} | {:.0} | {} | {:.0} | {} | {:.2} | {} | {} |",
            ns[0],
            ratio(0),
            ns[1],
            ratio(1),
            statistics.surfaces[0],
            if compared {
                format!("{t:.2} s")
            } else {
                String::new()
            },
            if compared {
                format!("{:.1}", t / b)
            } else {
                String::new()
            },
        );
    }
}

fn of_threads(runs: usize) {
    println!("### Threads: the Cornell box as above, layered\n");
    println!("| threads | forward, s | paths/s | forward + backward, s | paths/s |");
    println!("|---|---|---|---|---|");
    let (scene, camera) = cornell();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let paths = (SIZE * SIZE * 16) as f64;
    for threads in (0..).map(|i| 1 << i).take_while(|&t| t <= cores) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.expect("threads");
        let options = of_cornell(Visibility::Layered);
        let [f, b] = pool.install(|| {
            in_turn(
                runs,
                [&|| pass(&scene, &camera, &options, false), &|| {
                    pass(&scene, &camera, &options, true)
                }],
            )
        });
        println!(
            "| {threads} | {f:.3} | {:.0} | {b:.3} | {:.0} |",
            paths / f,
            paths / b
        );
    }
}

/// The most memory that this process had, MiB; on Linux only.
fn peak() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kib: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib / 1024.0)
}
