//! What skipping saves, in ratios of one run: `cargo bench --bench candidates -- [PART…]`, parts
//! `cornell`, `faces`, `few`, `cutoff`, `features`; all without one. Prints the Markdown of
//! `benches/RESULTS.md`.

#[path = "font/mod.rs"]
mod font;

use std::path::PathBuf;
use std::time::Instant;

use softray::prelude::*;

fn main() {
    let parts: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with('-'))
        .collect();
    if std::env::args().any(|a| a == "--help") {
        println!("cargo bench --bench candidates -- [cornell] [faces] [few] [cutoff] [features]");
        return;
    }
    let wanted = |part: &str| parts.is_empty() || parts.iter().any(|p| p == part);
    for (name, f) in [
        ("cornell", cornell as fn()),
        ("faces", faces),
        ("few", few),
        ("cutoff", cutoff),
        ("features", features),
    ] {
        if wanted(name) {
            f();
            println!();
        }
    }
}

/// Seconds of the fastest of some runs, and what the last returned.
fn time<T>(runs: usize, mut f: impl FnMut() -> T) -> (f64, T) {
    let mut once = || {
        let start = Instant::now();
        let value = f();
        (start.elapsed().as_secs_f64(), value)
    };
    let mut best = once();
    for _ in 1..runs {
        let next = once();
        best = (best.0.min(next.0), next.1);
    }
    best
}

fn data(path: &str) -> SceneFile {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data")
        .join(path);
    SceneFile::load(path, &Device::flex()).expect("a scene")
}

/// Forward and backward to all vertices of a scene: image and gradients.
fn both(scene: &Scene, camera: &Camera, options: &RenderOptions) -> (Vec<f64>, Vec<f64>) {
    let mut scene = scene.clone();
    let mut leaves = Vec::new();
    for object in &mut scene.objects {
        let leaf = object
            .mesh
            .vertices
            .clone()
            .inner()
            .autodiff()
            .require_grad();
        object.mesh = object.mesh.clone().with_vertices(leaf.clone());
        leaves.push(leaf);
    }
    let image = render(&scene, camera, options).expect("an image").radiance;
    let values = numbers(&image.clone().inner());
    let gradients = image.powf_scalar(2.0).mean().backward();
    let gradient = leaves
        .iter()
        .flat_map(|l| l.grad(&gradients).map_or(vec![], |g| numbers(&g)))
        .collect();
    (values, gradient)
}

fn numbers<const D: usize>(t: &Tensor<D>) -> Vec<f64> {
    t.clone().into_data().iter::<f64>().collect()
}

fn rmse(a: &[f64], b: &[f64]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum();
    (sum / a.len() as f64).sqrt()
}

/// |a − b|/|b|.
fn relative(a: &[f64], b: &[f64]) -> f64 {
    let zero = vec![0.0; b.len()];
    rmse(a, b) / rmse(b, &zero)
}

fn forms() -> [(&'static str, Visibility); 2] {
    [
        ("layered", Visibility::Layered),
        ("softmax γ 1e-3", Visibility::softmax(1e-3)),
    ]
}

fn cornell() {
    println!(
        "### Cornell box, 128 × 128, 16 samples, 2 bounces, σ = 1e-4, gradients of all vertices\n"
    );
    println!(
        "| form | pass | brute force, s | candidates, s | ratio | paths/s | replay, s | image RMSE | gradient difference |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let file = data("cornell/scene.json");
    for (name, form) in forms() {
        let options = RenderOptions::new(128, 128)
            .samples(16)
            .bounces(2)
            .sigma(1e-4)
            .visibility(form);
        let dense = options.clone().brute_force();
        let forward = |o: &RenderOptions| {
            let image = render(&file.scene, &file.camera, o).expect("an image");
            numbers(&image.radiance)
        };
        let paths = 128.0 * 128.0 * 16.0;
        let (slow, expected) = time(1, || forward(&dense));
        let (fast, found) = time(3, || forward(&options));
        println!(
            "| {name} | forward | {slow:.2} | {fast:.3} | {:.1} | {:.0} | | {:.1e} | |",
            slow / fast,
            paths / fast,
            rmse(&found, &expected),
        );
        let run = |o: &RenderOptions| both(&file.scene, &file.camera, o);
        let (slow, expected) = time(1, || run(&dense));
        let (fast, found) = time(3, || run(&options));
        let (replayed, _) = time(3, || run(&options.clone().replay()));
        println!(
            "| {name} | forward + backward | {slow:.2} | {fast:.3} | {:.1} | {:.0} | {replayed:.3} | {:.1e} | {:.1e} |",
            slow / fast,
            paths / fast,
            rmse(&found.0, &expected.0),
            relative(&found.1, &expected.1),
        );
    }
}

fn icosphere(subdivisions: u32) -> (Mesh, f64) {
    let mesh = shapes::icosphere(subdivisions, &Device::flex());
    let edge = (16.0 * std::f64::consts::PI / 3f64.sqrt() / mesh.faces.len() as f64).sqrt();
    (mesh, edge)
}

fn torus(step: u32) -> (Mesh, f64) {
    let (major, minor) = (0.7, 0.3);
    let n = 8usize << step;
    let mesh = shapes::torus(major, minor, n, n / 2 + n / 8, &Device::flex());
    let area = 4.0 * std::f64::consts::PI.powi(2) * major * minor;
    let edge = (4.0 * area / 3f64.sqrt() / mesh.faces.len() as f64).sqrt();
    (mesh, edge)
}

fn faces() {
    println!(
        "### Faces: 128 × 128, 16 samples, 1 bounce, a body in a uniform environment, forward\n"
    );
    println!(
        "| body | faces | σ | µs a ray | ratio to the first of about 1,280 | tested a ray | surfaces a ray: mean, p99, most | brute force, µs a ray |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    let camera = Camera::look_at([0.0, 1.0, 3.0], [0.0; 3]).fov_y(40.0);
    for (name, make) in [
        ("icosphere", icosphere as fn(u32) -> (Mesh, f64)),
        ("torus", torus),
    ] {
        for relative in [true, false] {
            let mut base = None;
            let last = if name == "torus" { 7 } else { 8 };
            for step in 1..last {
                let (mesh, edge) = make(step);
                let count = mesh.faces.len();
                let sigma = if relative { (0.1 * edge).powi(2) } else { 1e-4 };
                let body = Object::new(mesh).material(Material::diffuse([0.7; 3]));
                let scene = Scene::new().with(body).environment([1.0; 3]);
                let cache = HierarchyCache::default();
                let options = RenderOptions::new(128, 128)
                    .samples(16)
                    .bounces(1)
                    .sigma(sigma)
                    .cache(&cache);
                let (seconds, image) =
                    time(2, || render(&scene, &camera, &options).expect("an image"));
                let s = image.statistics;
                let each = 1e6 * seconds / s.rays as f64;
                if count >= 1280 && base.is_none() {
                    base = Some(each);
                }
                let brute = (count <= 5200).then(|| {
                    let options = RenderOptions::new(24, 24)
                        .samples(4)
                        .bounces(1)
                        .sigma(sigma)
                        .brute_force();
                    let (seconds, image) =
                        time(1, || render(&scene, &camera, &options).expect("an image"));
                    1e6 * seconds / image.statistics.rays as f64
                });
                println!(
                    "| {name} | {count} | {sigma:.1e} | {each:.2} | {} | {:.1} | {:.2}, {}, {} | {} |",
                    base.map_or(String::new(), |b| format!("{:.2}", each / b)),
                    s.tested as f64 / s.rays as f64,
                    s.surfaces[0],
                    s.surfaces[1],
                    s.surfaces[2],
                    brute.map_or(String::new(), |b| format!("{b:.1}")),
                );
            }
        }
    }
}

fn few() {
    println!("### Few triangles: with boxes and without (4 and fewer are asked one by one)\n");
    println!("| triangles | µs a ray |");
    println!("|---|---|");
    let device = Device::flex();
    let camera = Camera::look_at([0.0, 0.0, 6.0], [0.0; 3]).fov_y(45.0);
    for count in [4, 8, 12, 16, 20, 24, 26, 28, 32, 40, 48, 64] {
        let mut scene = Scene::new().environment([1.0; 3]);
        for i in 0..count {
            let (x, y) = (f64::from(i % 8) * 0.5 - 2.0, f64::from(i / 8) * 0.5 - 1.5);
            let z = f64::from(i * 7 % 5) * 0.3;
            let t = shapes::triangle([x, y, z], [x + 0.6, y, z], [x, y + 0.6, z + 0.2], &device);
            scene = scene.with(Object::new(t).material(Material::diffuse([0.5; 3])));
        }
        let options = RenderOptions::new(128, 128)
            .samples(4)
            .bounces(2)
            .sigma(1e-4);
        let (seconds, image) = time(5, || render(&scene, &camera, &options).expect("an image"));
        println!(
            "| {count} | {:.3} |",
            1e6 * seconds / image.statistics.rays as f64
        );
    }
}

fn cutoff() {
    println!(
        "### Cutoff: a ball of 320 faces, σ = 1e-3, 32 × 32, 16 samples, 1 bounce, against brute force\n"
    );
    println!("| form | cutoff | s | image RMSE / mean | gradient difference |");
    println!("|---|---|---|---|---|");
    let file = data("sphere/scene.json");
    let mut lines: Vec<(String, Vec<(f64, f64)>)> = Vec::new();
    for (name, form) in forms() {
        let (mut image, mut gradient) = (Vec::new(), Vec::new());
        let options = RenderOptions::new(32, 32)
            .samples(16)
            .bounces(1)
            .sigma(1e-3)
            .visibility(form);
        let run = |o: &RenderOptions| both(&file.scene, &file.camera, o);
        let expected = run(&options.clone().brute_force());
        let mean = expected.0.iter().sum::<f64>() / expected.0.len() as f64;
        for exponent in 2..9 {
            let cutoff = 10f64.powi(-exponent);
            let options = options.clone().cutoff(cutoff);
            let (seconds, found) = time(3, || run(&options));
            let errors = [
                rmse(&found.0, &expected.0) / mean,
                relative(&found.1, &expected.1),
            ];
            image.push((cutoff, errors[0]));
            gradient.push((cutoff, errors[1]));
            println!(
                "| {name} | 1e-{exponent} | {seconds:.3} | {:.1e} | {:.1e} |",
                errors[0], errors[1],
            );
        }
        lines.push((format!("{name}, image"), image));
        lines.push((format!("{name}, gradient"), gradient));
    }
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("benches/cutoff.svg");
    plot(&path, &lines).expect("a plot");
    println!("\n![](cutoff.svg)");
}

/// Errors over the cutoff, both logarithmic.
fn plot(
    path: &std::path::Path,
    lines: &[(String, Vec<(f64, f64)>)],
) -> Result<(), Box<dyn std::error::Error>> {
    use plotters::prelude::*;
    font::register();
    let area = SVGBackend::new(path, (720, 420)).into_drawing_area();
    area.fill(&WHITE)?;
    let all = || lines.iter().flat_map(|l| l.1.iter().map(|p| p.1));
    let least = all().fold(f64::INFINITY, f64::min).max(1e-12);
    let most = all().fold(0.0, f64::max);
    let mut chart = ChartBuilder::on(&area)
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(64)
        .build_cartesian_2d(
            (1e-8..1e-2).log_scale(),
            (0.5 * least..2.0 * most).log_scale(),
        )?;
    let exponent = |v: &f64| format!("{v:.0e}");
    chart
        .configure_mesh()
        .x_desc("cutoff")
        .y_desc("relative error")
        .x_label_formatter(&exponent)
        .y_label_formatter(&exponent)
        .draw()?;
    for (i, (name, points)) in lines.iter().enumerate() {
        let colour = Palette99::pick(i).to_rgba();
        chart
            .draw_series(LineSeries::new(
                points.iter().copied(),
                colour.stroke_width(2),
            ))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .border_style(BLACK)
        .background_style(WHITE)
        .draw()?;
    area.present()?;
    Ok(())
}

fn features() {
    println!(
        "### Features: the Cornell box, 64 × 64, 16 samples, 2 bounces, forward + backward; what each adds\n"
    );
    println!("| feature | rays | s | ratio |");
    println!("|---|---|---|---|");
    let file = data("cornell/scene.json");
    let plain = || (file.scene.clone(), file.camera.clone());
    let device = Device::flex();
    let gloss = Material::diffuse([0.4; 3]).specular([0.4; 3], 20.0);
    let texels = Tensor::<3>::ones([4, 4, 3], &device) * 0.5;
    let textured = Material::diffuse(Albedo::texture(texels));
    let uvs = |m: Mesh| {
        let n = m.vertices.dims()[0];
        m.with_uvs(Tensor::<2>::zeros([n, 2], &device))
    };
    let change = |name: &'static str, f: &dyn Fn(Scene, Camera) -> (Scene, Camera)| {
        let (scene, camera) = plain();
        (name, f(scene, camera), 2)
    };
    let mut cases = vec![
        ("none", plain(), 2),
        ("no bounce", plain(), 0),
        change("gloss", &|s, c| {
            (s.map_object("floor", |o| o.material(gloss.clone())), c)
        }),
        change("texture", &|s, c| {
            (
                s.map_object("floor", |o| o.material(textured.clone()).map_mesh(uvs)),
                c,
            )
        }),
        change("velocity", &|s, c| {
            (s.map_object("short", |o| o.velocity([0.1, 0.0, 0.0])), c)
        }),
        change("lens", &|s, c| (s, c.thin_lens(0.1, 9.0))),
        change("environment", &|s, c| (s.environment([0.1; 3]), c)),
    ];
    let mut base = None;
    for (name, (scene, camera), bounces) in cases.drain(..) {
        let options = RenderOptions::new(64, 64)
            .samples(16)
            .bounces(bounces)
            .sigma(1e-4);
        let rays = render(&scene, &camera, &options)
            .expect("an image")
            .statistics
            .rays;
        let (seconds, _) = time(5, || both(&scene, &camera, &options));
        let base = *base.get_or_insert(seconds);
        println!("| {name} | {rays} | {seconds:.3} | {:.2} |", seconds / base);
    }
    let (scene, camera) = plain();
    let options = RenderOptions::new(64, 64)
        .samples(16)
        .bounces(2)
        .sigma(1e-4);
    let (seconds, _) = time(5, || render(&scene, &camera, &options).expect("an image"));
    println!(
        "| none, no gradient | | {seconds:.3} | {:.2} |",
        seconds / base.unwrap_or(1.0)
    );
}
