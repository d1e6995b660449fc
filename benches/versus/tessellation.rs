use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use softray::prelude::*;

use crate::gradient::weights;
use crate::weights::SIZE;
use crate::{load, mean_and_deviation};
use softray::figure::{Figure, Plot};

#[derive(Args)]
pub struct Tessellation {
    /// Samples a pixel.
    #[arg(long, default_value_t = 64)]
    spp: u32,
    /// Seeds, each a run of its own.
    #[arg(long, default_value_t = 16)]
    seeds: u64,
    /// Samples a pixel of the differences.
    #[arg(long, default_value_t = 256)]
    difference_spp: u32,
    /// Subdivisions of the finest ball.
    #[arg(long, default_value_t = 6)]
    most: u32,
    /// Another renderer's figures, as `beside_mitsuba.py tessellation` prints them: faces, mean and noise over the
    /// reference derivative, seconds of a gradient.
    #[arg(long)]
    beside: Option<PathBuf>,
    /// Where the figure goes.
    #[arg(long, default_value = "out/tessellation.png")]
    out: PathBuf,
}

/// The derivative of a weighted image by the ball's place along z.
struct Ball {
    scene: Scene,
    camera: Camera,
    mesh: Mesh,
    options: RenderOptions,
    weights: Tensor<3>,
}

impl Ball {
    fn loss(&self, z: &Tensor<1>, samples: u32, seed: u64) -> Tensor<1> {
        let zero = z.zeros_like();
        let offset = Tensor::cat(vec![zero.clone(), zero, z.clone()], 0);
        let moved = self.mesh.clone().translated(offset);
        let scene = self.scene.clone();
        let scene = scene
            .map_object("sphere", |o| o.map_mesh(|_| moved.clone()))
            .expect("the object");
        let options = self.options.clone().samples(samples).seed(seed);
        let image = render(&scene, &self.camera, &options).expect("an image");
        (image.radiance * self.weights.clone()).sum()
    }
}

impl Tessellation {
    #[expect(
        clippy::too_many_lines,
        reason = "a measurement from its scene to its table"
    )]
    pub fn run(&self, visibility: Visibility) -> Result<(), Box<dyn Error>> {
        let device = Device::flex();
        let file = load("sphere");
        let (weights, exact) = weights("sphere", "ball-z");
        let mut all_expected = Vec::new();
        let weights = Tensor::<1>::from_floats(weights.as_slice(), &device);
        let (mut bias, mut noise) = (Vec::new(), Vec::new());
        println!("| faces | gradient over differences | noise × √time | µs a path |");
        println!("|---|---|---|---|");
        for level in 1..=self.most {
            let mesh = shapes::icosphere(level, &device)
                .scaled(Tensor::from_floats([0.8], &device))
                .translated(Tensor::from_floats([0.0, 0.8, 0.0], &device));
            let faces = mesh.faces.len();
            let cache = HierarchyCache::default();
            let ball = Ball {
                scene: file.scene.clone(),
                camera: file.camera.clone(),
                mesh,
                options: RenderOptions::new(SIZE, SIZE)
                    .bounces(1)
                    .visibility(visibility)
                    .cache(&cache),
                weights: weights.clone().reshape([SIZE, SIZE, 1]),
            };
            let (mut found, mut times, mut differences) = (Vec::new(), Vec::new(), Vec::new());
            for seed in 0..=self.seeds {
                let start = Instant::now();
                let leaf = Tensor::<1>::zeros([1], &device).autodiff().require_grad();
                let gradients = ball.loss(&leaf, self.spp, seed).backward();
                let gradient = leaf.grad(&gradients).ok_or("a gradient")?;
                // The first warms up.
                if seed > 0 {
                    times.push(start.elapsed().as_secs_f64());
                    found.push(f64::from(gradient.into_scalar::<f32>()));
                    let at = |z: f32| {
                        let z = Tensor::<1>::from_floats([z], &device);
                        let loss = ball.loss(&z, self.difference_spp, seed);
                        f64::from(loss.into_scalar::<f32>())
                    };
                    differences.push((at(0.03) - at(-0.03)) / 0.06);
                }
            }
            let (mean, deviation) = mean_and_deviation(&found);
            let (expected, of_differences) = mean_and_deviation(&differences);
            let n = (self.seeds as f64).sqrt();
            let error = deviation.hypot(of_differences) / n / expected.abs();
            times.sort_by(f64::total_cmp);
            let time = times[times.len() / 2];
            let paths = (SIZE * SIZE) as f64 * f64::from(self.spp);
            let scaled = deviation * time.sqrt() / expected.abs();
            println!(
                "| {faces} | {:.4} ± {error:.4} | {scaled:.4} | {:.2} |",
                mean / expected,
                time / paths * 1e6
            );
            let decades = (faces as f64).log10();
            all_expected.push((faces as f64, expected));
            bias.push((decades, 100.0 * (mean / expected - 1.0)));
            noise.push((decades, scaled));
        }
        let mut plots = [
            Plot::new("bias of the mean, %", "log10 faces", "").curve("softray", bias),
            Plot::new("noise × √time, relative", "log10 faces", "")
                .log()
                .curve("softray", noise),
        ];
        if let Some(path) = &self.beside {
            let text = std::fs::read_to_string(path)?;
            let mut rows = Vec::new();
            for line in text.lines().skip(1) {
                let row: Result<Vec<f64>, _> = line.split(',').map(str::parse).collect();
                let [faces, mean, noise, seconds] = row?[..] else {
                    return Err(format!("{}: not four numbers: {line}", path.display()).into());
                };
                let Some((_, expected)) = all_expected.iter().find(|e| e.0 == faces) else {
                    continue;
                };
                let scale = exact / expected;
                let bias = 100.0 * (mean * scale - 1.0);
                let noise = noise * scale.abs() * seconds.sqrt();
                println!("| {faces} | {:.4} | {noise:.4} | beside |", mean * scale);
                rows.push((faces.log10(), bias, noise));
            }
            let [a, b] = plots;
            plots = [
                a.curve("Mitsuba", rows.iter().map(|r| (r.0, r.1))),
                b.curve("Mitsuba", rows.iter().map(|r| (r.0, r.2))),
            ];
        }
        let mut picture = Figure::new("A ball in more and more faces");
        for plot in plots {
            picture = picture.plot(plot);
        }
        if let Some(folder) = self.out.parent() {
            std::fs::create_dir_all(folder)?;
        }
        picture.write(&self.out)?;
        println!("wrote {}", self.out.display());
        Ok(())
    }
}
