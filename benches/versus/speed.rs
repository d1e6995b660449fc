use std::time::Instant;

use clap::{Args, ValueEnum};
use softray::prelude::*;

use crate::load_to;

#[derive(Args)]
pub struct Speed {
    /// Which scenes [default: all].
    #[arg(value_enum)]
    scenes: Vec<Which>,
    /// Pixels of a side.
    #[arg(long, default_value_t = 128)]
    size: usize,
    /// Samples a pixel.
    #[arg(long, default_value_t = 16)]
    spp: u32,
    /// Runs, of which the median counts.
    #[arg(long, default_value_t = 9)]
    runs: usize,
    /// Subdivisions of the ball.
    #[arg(long, default_value_t = 6)]
    subdivisions: u32,
    /// Forward alone.
    #[arg(long)]
    forward: bool,
    /// The device, such as `flex` or `vulkan`; of GPUs the time of the first render, with compilation, is told.
    #[arg(long, default_value = "flex")]
    device: String,
    /// The program of tensor operations in place of kernels.
    #[arg(long)]
    tensors: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Which {
    /// The Cornell box, three surfaces a path.
    Cornell,
    /// A ball on a floor under a lamp, two surfaces a path.
    Ball,
}

impl Speed {
    pub fn run(&self, visibility: Visibility) {
        for which in [Which::Cornell, Which::Ball] {
            if self.scenes.is_empty() || self.scenes.contains(&which) {
                self.of(which, visibility);
            }
        }
    }

    fn of(&self, which: Which, visibility: Visibility) {
        let device = softray::device::named(Some(&self.device)).expect("a device");
        let (mut file, bounces) = match which {
            Which::Cornell => (load_to("cornell", &device), 2),
            Which::Ball => (load_to("sphere", &device), 1),
        };
        if which == Which::Ball {
            let ball = shapes::icosphere(self.subdivisions, &device)
                .scaled(Tensor::from_floats([0.8], &device))
                .translated(Tensor::from_floats([0.0, 0.8, 0.0], &device));
            file.scene = file
                .scene
                .map_object("sphere", |o| o.map_mesh(|_| ball.clone()))
                .expect("the object");
        }
        let cache = HierarchyCache::default();
        let options = RenderOptions::new(self.size, self.size)
            .samples(self.spp)
            .bounces(bounces)
            .visibility(visibility)
            .engine(if self.tensors {
                Engine::Tensors
            } else {
                Engine::Auto
            })
            .cache(&cache);
        let faces: usize = file.scene.objects.iter().map(|o| o.mesh.faces.len()).sum();
        let forward = self.time(|| {
            let image = render(&file.scene, &file.camera, &options).expect("an image");
            let _ = image.radiance.into_data();
        });
        let paths = (self.size * self.size) as f64 * f64::from(self.spp);
        print!(
            "{which:?}, {faces} faces: forward {:.2} M paths/s",
            paths / forward / 1e6
        );
        if !self.forward {
            let mut scene = file.scene.clone();
            for object in &mut scene.objects {
                let vertices = object.mesh.vertices.clone().autodiff().require_grad();
                object.mesh = object.mesh.clone().with_vertices(vertices);
            }
            let both = self.time(|| {
                let image = render(&scene, &file.camera, &options).expect("an image");
                let gradients = image.radiance.powf_scalar(2.0).sum().backward();
                for object in &scene.objects {
                    let gradient = object.mesh.vertices.grad(&gradients);
                    let _ = gradient.expect("a gradient").into_data();
                }
            });
            print!(
                ", with gradients of all vertices {:.2} M",
                paths / both / 1e6
            );
        }
        println!();
    }

    fn time(&self, f: impl Fn()) -> f64 {
        let start = Instant::now();
        f();
        if self.device != "flex" {
            eprintln!("first: {:.2} s", start.elapsed().as_secs_f64());
        }
        let mut times: Vec<f64> = (0..self.runs)
            .map(|_| {
                let start = Instant::now();
                f();
                start.elapsed().as_secs_f64()
            })
            .collect();
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    }
}
