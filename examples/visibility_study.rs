//! The figures of docs/VISIBILITY.md: both forms of visibility against unblurred references.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Parser, Subcommand};
use rayon::prelude::*;
use softray::geometry::Vec3;
use softray::prelude::*;
use softray::scene::Flattened;
use softray::visibility::{CoverageSettings, Rays, coverage};

/// Compares the forms of visibility; prints Markdown tables.
#[derive(Parser)]
struct Arguments {
    #[command(subcommand)]
    study: Study,
    /// Paths a pixel.
    #[arg(long, default_value_t = 256, global = true)]
    samples: u32,
    /// Folder for pictures.
    #[arg(long, default_value = "out", global = true)]
    out: PathBuf,
}

#[derive(Subcommand)]
enum Study {
    /// Mean, RMSE and time against the references, over σ.
    References {
        #[arg(long, value_delimiter = ',', default_values_t = [1e-4, 1e-3, 1e-2])]
        sigma: Vec<f64>,
    },
    /// The derivative image of the shadow scene against unblurred central differences, over σ.
    Gradient {
        #[arg(long, value_delimiter = ',', default_values_t = [1e-4, 1e-3, 1e-2])]
        sigma: Vec<f64>,
    },
    /// One shape in ever finer faces: coverage, silhouette, mean.
    Tessellation,
    /// Coverage as the integral of a kernel over each triangle, which adds up over subdivisions,
    /// beside Eq. 1: the opacity of a unit sphere along parallel rays at growing distances from
    /// its centre.
    Kernel,
}

const FORMS: [(&str, Visibility); 2] = [
    (
        "softmax γ 1e-3",
        Visibility::Softmax {
            gamma: 1e-3,
            epsilon: 1e-3,
        },
    ),
    ("layered", Visibility::Layered),
];

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    std::fs::create_dir_all(&arguments.out)?;
    match &arguments.study {
        Study::References { sigma } => references(&arguments, sigma),
        Study::Gradient { sigma } => gradient(&arguments, sigma),
        Study::Tessellation => tessellation(&arguments),
        Study::Kernel => kernel(),
    }
}

fn data(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data")
        .join(path)
}

fn references(arguments: &Arguments, sigmas: &[f64]) -> Result<(), Box<dyn Error>> {
    const SCENES: [(&str, u32); 9] = [
        ("cornell", 0),
        ("cornell", 1),
        ("cornell", 3),
        ("shadow", 0),
        ("sphere", 1),
        ("glossy_sphere", 1),
        ("lens", 1),
        ("motion", 0),
        ("motion", 1),
    ];
    println!("| scene | bounces | σ | form | mean / reference | clipped RMSE | seconds |");
    println!("|---|---|---|---|---|---|---|");
    for (name, bounces) in SCENES {
        let file = SceneFile::load(data(&format!("{name}/scene.json")), &Device::flex())?;
        let reference = HostImage::read(data(&format!("{name}/bounces-{bounces}.exr")))?;
        for &sigma in sigmas {
            for (form, visibility) in FORMS {
                let options = RenderOptions::new(file.width, file.height)
                    .samples(arguments.samples)
                    .bounces(bounces)
                    .sigma(sigma)
                    .visibility(visibility)
                    .seed(5);
                let start = Instant::now();
                let image = render(&file.scene, &file.camera, &options)?;
                let image = HostImage::from_tensor(&image.radiance)?;
                let seconds = start.elapsed().as_secs_f64();
                println!(
                    "| {name} | {bounces} | {sigma:e} | {form} | {:.4} | {:.4} | {seconds:.1} |",
                    image.mean_ratio(&reference),
                    image.rmse(&reference, true)?,
                );
                let residual = residual(&image, &reference)?;
                let short = form.split(' ').next().unwrap_or(form);
                let path = format!("residual-{name}-{bounces}-{sigma:e}-{short}.png");
                HostImage::side_by_side(&[&reference, &image, &residual])
                    .write(arguments.out.join(path))?;
            }
        }
    }
    Ok(())
}

/// Grey is equal, red too bright, blue too dark; full colour at a difference of 0.1.
fn residual(image: &HostImage, reference: &HostImage) -> Result<HostImage, softray::Error> {
    let pixels = image
        .pixels
        .chunks_exact(3)
        .zip(reference.pixels.chunks_exact(3))
        .flat_map(|(a, b)| {
            let clipped = |p: &[f32]| p.iter().map(|v| v.clamp(0.0, 1.0)).sum::<f32>() / 3.0;
            let d = ((clipped(a) - clipped(b)) / 0.1).clamp(-1.0, 1.0);
            [0.2 + 0.8 * d.max(0.0), 0.2, 0.2 + 0.8 * (-d).max(0.0)]
        })
        .collect();
    HostImage::new(image.width, image.height, pixels)
}

fn gradient(arguments: &Arguments, sigmas: &[f64]) -> Result<(), Box<dyn Error>> {
    const BLOCK: usize = 8;
    let device = Device::flex();
    let file = SceneFile::load(data("shadow/scene.json"), &device)?;
    let reference = HostImage::read(data("shadow/gradient-occluder-x.exr"))?;
    let target = reference.to_tensor(&device);
    let (width, height) = (file.width, file.height);
    println!("| σ | form | slope | correlation | seconds |");
    println!("|---|---|---|---|---|");
    for &sigma in sigmas {
        for (form, visibility) in FORMS {
            // Σ weights·d image/dx, the mean over independent seeds.
            let project = |weights: &Tensor<3>, seeds: u64| -> softray::Result<f64> {
                let one = |seed| {
                    let offset = Tensor::<1>::zeros([1], &device).autodiff().require_grad();
                    let axis = Tensor::<1>::from_floats([1.0, 0.0, 0.0], &device);
                    let scene = file.scene.clone().map_object("occluder", |o| {
                        o.map_mesh(|m| m.translated(offset.clone() * axis.clone()))
                    });
                    let options = RenderOptions::new(width, height)
                        .samples(16)
                        .bounces(0)
                        .sigma(sigma)
                        .visibility(visibility)
                        .seed(seed);
                    let image = render(&scene, &file.camera, &options)?.radiance;
                    let gradients = (image * weights.clone()).sum().backward();
                    let slope = offset.grad(&gradients).map(|g| g.into_scalar::<f32>());
                    Ok(f64::from(slope.unwrap_or(0.0)) / seeds as f64)
                };
                (0..seeds).into_par_iter().map(one).sum()
            };
            let start = Instant::now();
            let seeds = u64::from(arguments.samples / 16).max(1);
            let square: f64 = reference.pixels.iter().map(|&v| f64::from(v).powi(2)).sum();
            let slope = project(&target, seeds)? / square;
            let (mut found, mut expected) = (Vec::new(), Vec::new());
            for block in 0..(width / BLOCK) * (height / BLOCK) {
                let (x, y) = (block % (width / BLOCK), block / (width / BLOCK));
                let inside = |i: usize| i / 3 / width / BLOCK == y && i / 3 % width / BLOCK == x;
                let mask: Vec<f32> = (0..width * height * 3)
                    .map(|i| if inside(i) { 1.0 } else { 0.0 })
                    .collect();
                let mask = HostImage::new(width, height, mask)?.to_tensor(&device);
                found.push(project(&mask, (seeds / 8).max(1))?);
                let sum = |(_, v): (usize, &f32)| f64::from(*v);
                let of_block = reference
                    .pixels
                    .iter()
                    .enumerate()
                    .filter(|(i, _)| inside(*i));
                expected.push(of_block.map(sum).sum());
            }
            println!(
                "| {sigma:e} | {form} | {slope:.3} | {:.4} | {:.1} |",
                correlation(&found, &expected),
                start.elapsed().as_secs_f64(),
            );
        }
    }
    Ok(())
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len() as f64;
    let (ma, mb) = (a.iter().sum::<f64>() / n, b.iter().sum::<f64>() / n);
    let c = |x: &[f64], mx: f64, y: &[f64], my: f64| {
        x.iter()
            .zip(y)
            .map(|(p, q)| (p - mx) * (q - my))
            .sum::<f64>()
    };
    c(a, ma, b, mb) / (c(a, ma, a, ma) * c(b, mb, b, mb)).sqrt()
}

fn tessellation(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    const SIZE: usize = 48;
    let device = Device::flex();
    let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]).fov_y(40.0);
    let samples = (arguments.samples / 16).max(1);
    let mut ball = shapes::icosphere(2, &device);
    let sharp = {
        let scene = Scene::new()
            .with(Object::new(ball.clone()))
            .environment([1.0; 3]);
        let options = RenderOptions::new(SIZE, SIZE)
            .samples(256)
            .bounces(0)
            .sigma(1e-9)
            .visibility(Visibility::Layered)
            .with_opacity();
        mean(render(&scene, &camera, &options)?.opacity)?
    };
    println!(
        "| faces | σ | σ / edge² | form | silhouette radius | furnace mean | surfaces a ray |"
    );
    println!("|---|---|---|---|---|---|---|");
    for _ in 0..4 {
        let faces = ball.faces.len();
        let edge = (16.0 * std::f64::consts::PI / 3f64.sqrt() / faces as f64).sqrt();
        for sigma in [1e-2, 1e-3, (0.3 * edge).powi(2)] {
            for (form, visibility) in FORMS {
                let white = Object::new(ball.clone()).material(Material::diffuse([1.0; 3]));
                let scene = Scene::new().with(white).environment([1.0; 3]);
                let options = RenderOptions::new(SIZE, SIZE)
                    .samples(samples)
                    .bounces(0)
                    .sigma(sigma)
                    .visibility(visibility)
                    .with_opacity();
                let image = render(&scene, &camera, &options)?;
                let bright = f64::from(image.radiance.mean().into_scalar::<f32>());
                let radius = (mean(image.opacity)? / sharp).sqrt();
                let surfaces = surfaces_a_ray(&scene, &camera, sigma)?;
                let ratio = sigma / (edge * edge);
                println!(
                    "| {faces} | {sigma:.1e} | {ratio:.3} | {form} | {radius:.4} | {bright:.4} | {surfaces:.1} |"
                );
            }
        }
        ball = ball.subdivided();
    }
    Ok(())
}

fn mean(image: Option<Tensor<2>>) -> Result<f64, Box<dyn Error>> {
    let image = image.ok_or("no opacity")?;
    Ok(f64::from(image.mean().into_scalar::<f32>()))
}

/// The mean number of triangles with p > 1e-4 along rays that aim at the unit disk.
fn surfaces_a_ray(scene: &Scene, camera: &Camera, sigma: f64) -> Result<f64, Box<dyn Error>> {
    let flat = Flattened::new(scene, camera, None)?;
    let context = &flat.context;
    let points: Vec<[f64; 2]> = (0..256)
        .map(|i| {
            let (r, a) = (((i as f64 + 0.5) / 256.0).sqrt(), i as f64 * 2.399_963);
            [r * a.cos(), r * a.sin()]
        })
        .collect();
    let to = |p: &[f64; 2], k: usize| {
        let d = [p[0], p[1], -4.0];
        d[k] / (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
    };
    let direction =
        [0, 1, 2].map(|k| context.row(&points.iter().map(|p| to(p, k)).collect::<Vec<_>>()));
    let [x, y, z] = direction;
    let eye = [0.0, 0.0, 4.0].map(|v| context.row(&[v; 256]));
    let [a, b, c] = eye;
    let rays = Rays {
        origin: Vec3::new(a, b, c)
            .sub(&Vec3::constant(context, flat.bounds.center))
            .scale_by(flat.unit.recip()),
        direction: Vec3::new(x, y, z),
        time: None,
        departure: None,
        arrival: None,
    };
    let settings = CoverageSettings {
        sigma: sigma / flat.unit.powi(2),
        t_min: 0.0,
        start: 0.0,
        arrival_margin: 0.0,
    };
    let found = coverage(context, &flat.triangles, &flat.topology, &rays, &settings);
    let counts = found.probability().greater_elem(1e-4).int().sum();
    Ok(counts.into_scalar::<i32>() as f64 / 256.0)
}

/// An edge as seen from a point of the plane: its signed distance, positive inside, and where it
/// begins and ends along its own direction.
type Edge = (f64, f64, f64);

fn by_distance(edges: &[Edge; 3], sigma: f64) -> f64 {
    let inside = edges.iter().all(|e| e.0 >= 0.0);
    let squared = |&(h, from, to): &Edge| h * h + 0f64.clamp(from, to).powi(2);
    let d = edges.iter().map(squared).fold(f64::INFINITY, f64::min);
    1.0 / (1.0 + (if inside { -d } else { d } / sigma).exp())
}

/// The integral over the triangle of 3/(πR²)·(1 − r²/R²)² within R, R² such that the half plane has
/// the same variance as in Eq. 1. By the divergence theorem a sum over edges: with q = 1 − r²/R²,
/// inside − Σ ∫ q³ dθ/(2π), where q³ dθ = dθ − h/R²·(1 + q + q²) dl.
fn by_kernel(edges: &[Edge; 3], sigma: f64) -> f64 {
    let r2 = 16.0 * std::f64::consts::LN_2 * sigma;
    let inside = edges.iter().all(|e| e.0 >= 0.0);
    let cut = edges.iter().map(|&(h, from, to)| {
        let half = (r2 - h * h).max(0.0).sqrt();
        let (a, b) = (from.max(-half), to.min(half));
        if a >= b {
            return 0.0;
        }
        let angle = (h * (b - a)).atan2(h * h + a * b);
        let q = 1.0 - h * h / r2;
        let along = |l: f64| {
            l * (1.0 + q + q * q) - l.powi(3) / (3.0 * r2) * (1.0 + 2.0 * q)
                + l.powi(5) / (5.0 * r2 * r2)
        };
        angle - h / r2 * (along(b) - along(a))
    });
    let whole = if inside { 1.0 } else { 0.0 };
    whole - cut.sum::<f64>() / std::f64::consts::TAU
}

fn kernel() -> Result<(), Box<dyn Error>> {
    use glam::DVec3;
    const AT: [f64; 8] = [0.5, 0.8, 0.9, 0.95, 0.98, 1.0, 1.02, 1.05];
    const TURNS: usize = 16;
    print!("| σ | faces | coverage |");
    AT.iter().for_each(|b| print!(" {b} |"));
    println!("\n|---|---|---|{}", "---|".repeat(AT.len()));
    for sigma in [1e-2, 1e-3] {
        for subdivisions in 2..6 {
            let mesh = shapes::icosphere(subdivisions, &Device::flex());
            let vertices = mesh.host_vertices()?;
            let faces: Vec<[DVec3; 3]> = mesh
                .faces
                .iter()
                .map(|f| f.map(|i| DVec3::from(vertices[i as usize])))
                .collect();
            type Coverage = fn(&[Edge; 3], f64) -> f64;
            for (name, p) in [
                ("Eq. 1", by_distance as Coverage),
                ("kernel", by_kernel as Coverage),
            ] {
                let opacity = |distance: f64| {
                    let along = |turn: usize| {
                        let angle = 0.1 + turn as f64 * std::f64::consts::TAU / TURNS as f64;
                        let x = DVec3::new(distance * angle.cos(), distance * angle.sin(), 0.0);
                        let sum: f64 = faces
                            .iter()
                            .filter_map(|corners| {
                                let [a, b, c] = *corners;
                                let n = (b - a).cross(c - a).normalize();
                                if n.z < 1e-6 {
                                    return None;
                                }
                                let hit = x + DVec3::Z * (n.dot(a - x) / n.z);
                                let edges = [(a, b), (b, c), (c, a)].map(|(from, to)| {
                                    let d = (to - from).normalize();
                                    let begin = (from - hit).dot(d);
                                    let end = begin + from.distance(to);
                                    ((hit - from).dot(n.cross(d)) + 0.0, begin, end)
                                });
                                Some(p(&edges, sigma))
                            })
                            .sum();
                        sum.min(1.0)
                    };
                    (0..TURNS).map(along).sum::<f64>() / TURNS as f64
                };
                print!("| {sigma:e} | {} | {name} |", faces.len());
                AT.iter().for_each(|&b| print!(" {:.3} |", opacity(b)));
                println!();
            }
        }
    }
    Ok(())
}
