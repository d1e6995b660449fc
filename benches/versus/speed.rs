use std::cell::Cell;
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
    /// Times of all cores together, without what else they do, in place of the clock's: on Linux, in 1/100 s.
    #[arg(long)]
    cpu: bool,
    /// The device, such as `flex` or `vulkan`; of GPUs the time of the first render, with compilation, is printed.
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
    /// A ball on a floor, lit by a lamp of 2 emissive triangles, by the same cut into 10,000, and by 10,000 of small
    /// balls: time and noise of each.
    Lamps,
}

impl Speed {
    pub fn run(&self, visibility: Visibility) {
        for which in [Which::Cornell, Which::Ball, Which::Lamps] {
            if self.scenes.is_empty() || self.scenes.contains(&which) {
                match which {
                    Which::Lamps => self.lamps(visibility),
                    _ => self.of(which, visibility),
                }
            }
        }
    }

    fn of(&self, which: Which, visibility: Visibility) {
        let device = softray::device::named(Some(&self.device)).expect("a device");
        let (mut file, bounces) = match which {
            Which::Cornell => (load_to("cornell", &device), 2),
            Which::Ball | Which::Lamps => (load_to("sphere", &device), 1),
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
            .with_samples(self.spp)
            .with_bounces(bounces)
            .with_visibility(visibility)
            .with_engine(if self.tensors {
                Engine::Tensors
            } else {
                Engine::Auto
            })
            .with_cache(&cache);
        let faces: usize = file.scene.objects.iter().map(|o| o.mesh.faces.len()).sum();
        let forward = self.time(|| {
            let image = render(&file.scene, &file.camera, &options).expect("an image");
            let _ = image.radiance.into_data();
            device.sync().expect("a device that computes");
        });
        let paths = (self.size * self.size) as f64 * f64::from(self.spp);
        print!(
            "{which:?}, {faces} faces: forward {:.2} M paths/s ({forward:.3} s)",
            paths / forward / 1e6
        );
        if !self.forward {
            let step = Cell::new(0);
            let both = self.time(|| {
                // A step of a fit has moved all vertices a little.
                step.set(step.get() + 1);
                let scale = 1.0 + 1e-6 * f64::from(step.get());
                let mut scene = file.scene.clone();
                for object in &mut scene.objects {
                    let vertices = object.mesh.vertices.clone().mul_scalar(scale);
                    let vertices = vertices.autodiff().require_grad();
                    object.mesh = object.mesh.clone().with_vertices(vertices);
                }
                let image = render(&scene, &file.camera, &options).expect("an image");
                let gradients = image.radiance.powf_scalar(2.0).sum().backward();
                for object in &scene.objects {
                    let gradient = object.mesh.vertices.grad(&gradients);
                    let _ = gradient.expect("a gradient").into_data();
                }
                device.sync().expect("a device that computes");
            });
            print!(
                ", with gradients of all vertices {:.2} M ({both:.3} s)",
                paths / both / 1e6
            );
        }
        println!();
    }

    /// Time and noise with 2 emissive triangles and with 10,000, by each choice of emitters.
    fn lamps(&self, visibility: Visibility) {
        let device = softray::device::named(Some(&self.device)).expect("a device");
        let camera = Camera::look_at([0.0, 2.0, 5.0], [0.0, 0.8, 0.0]).with_fov_y(45.0);
        let options = RenderOptions::new(self.size, self.size)
            .with_samples(self.spp)
            .with_bounces(1)
            .with_visibility(visibility);
        let paths = (self.size * self.size) as f64 * f64::from(self.spp);
        let mut first = None;
        for lamps in [Lamps::Two, Lamps::Cut, Lamps::Balls] {
            let (scene, count) = lit_by_lamps(lamps, &device);
            let converged = render(
                &scene,
                &camera,
                &options.clone().with_samples(64 * self.spp).with_seed(9),
            );
            let converged = converged.expect("an image").radiance;
            for emitters in [EmitterSampling::SolidAngle, EmitterSampling::Power] {
                let mut sampling = Sampling::default();
                sampling.emitters = emitters;
                let options = options.clone().with_sampling(sampling);
                let cache = HierarchyCache::default();
                let options = options.with_cache(&cache);
                let image = || {
                    render(&scene, &camera, &options)
                        .expect("an image")
                        .radiance
                };
                let square = (image() - converged.clone()).powf_scalar(2.0).mean();
                let noise = square.sqrt() / converged.clone().mean();
                let noise: Vec<f32> = noise.into_data().iter::<f32>().collect();
                let forward = self.time(|| drop(image().into_data()));
                let leaves = with_leaves(&scene);
                let both = self.time(|| {
                    let image = render(&leaves, &camera, &options).expect("an image");
                    let gradients = image.radiance.powf_scalar(2.0).sum().backward();
                    let gradient = leaves.objects[0].mesh.vertices.grad(&gradients);
                    drop(gradient.expect("a gradient").into_data());
                });
                let (forward_of_two, both_of_two) = *first.get_or_insert((forward, both));
                println!(
                    "{lamps:?}, {count} emissive triangles, {emitters:?}: forward {:.2} M paths/s ({:.2} × the time of the \
                     first), with gradients {:.2} M ({:.2} ×), relative noise {:.4}",
                    paths / forward / 1e6,
                    forward / forward_of_two,
                    paths / both / 1e6,
                    both / both_of_two,
                    noise[0],
                );
            }
        }
    }

    fn time(&self, f: impl Fn()) -> f64 {
        let start = Instant::now();
        f();
        if self.device != "flex" {
            eprintln!("first: {:.2} s", start.elapsed().as_secs_f64());
        }
        if self.cpu {
            let start = cpu_seconds();
            (0..self.runs).for_each(|_| f());
            return (cpu_seconds() - start) / self.runs as f64;
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

/// What this process has had of all cores so far.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").expect("Linux");
    // After the name in parentheses; user and system time are fields 14 and 15.
    let rest = stat.rsplit(')').next().expect("fields");
    let ticks = rest.split_whitespace().skip(11).take(2);
    ticks
        .map(|t| t.parse::<f64>().expect("ticks") / 100.0)
        .sum()
}

/// What emits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lamps {
    /// A square.
    Two,
    /// The square, cut into 10,000 triangles.
    Cut,
    /// Small balls.
    Balls,
}

/// A floor and a ball under 125 small balls of 80 triangles, with the number of emissive triangles: all of these, or those of
/// a square lamp. The camera sees neither.
fn lit_by_lamps(lamps: Lamps, device: &Device) -> (Scene, usize) {
    let quad = |half: f64, y: f64| {
        let [a, b, c, d] = [[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]]
            .map(|[x, z]| [half * x, y, half * z]);
        shapes::quad(a, b, c, d, device)
    };
    let at = |mesh: Mesh, size: f32, place: [f32; 3]| {
        mesh.scaled(Tensor::from_floats([size], device))
            .translated(Tensor::from_floats(place, device))
    };
    let ball = at(shapes::icosphere(3, device), 0.7, [0.0, 0.7, 0.0]);
    let mut scene = Scene::new()
        .with_object(Object::new(ball).with_material(Material::diffuse([0.6, 0.5, 0.4])))
        .with_object(Object::new(quad(4.0, 0.0)).with_material(Material::diffuse([0.5; 3])));
    for i in 0..125 {
        let [x, y, z] = [i % 5, i / 5 % 5, i / 25].map(|k| k as f32);
        let place = [1.3 * (x - 2.0), 4.0 + 0.5 * y, 1.3 * (z - 2.0)];
        let lamp = at(shapes::icosphere(1, device), 0.03, place);
        let material = match lamps {
            Lamps::Balls => Material::emitter([80.0; 3]),
            _ => Material::diffuse([0.0; 3]),
        };
        scene = scene.with_object(Object::new(lamp).with_material(material));
    }
    let parts = match lamps {
        Lamps::Balls => return (scene, 10_000),
        Lamps::Two => 1,
        Lamps::Cut => 71,
    };
    let at = |k: u32| f64::from(k % (parts + 1)) / f64::from(parts) - 0.5;
    let corners: Vec<[f64; 3]> = (0..(parts + 1) * (parts + 1))
        .map(|k| [at(k), 3.0, at(k / (parts + 1))])
        .collect();
    let faces = (0..parts * parts).flat_map(|k| {
        let a = k / parts * (parts + 1) + k % parts;
        let [b, c, d] = [a + 1, a + parts + 2, a + parts + 1];
        [[a, b, c], [a, c, d]]
    });
    let faces: Vec<[u32; 3]> = faces.collect();
    let count = faces.len();
    let lamp = Mesh::from_host(&corners, faces, device);
    let lamp = Object::new(lamp).with_material(Material::emitter([12.0; 3]));
    (scene.with_object(lamp), count)
}

/// The scene with the vertices of its first object as a leaf.
fn with_leaves(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    let mesh = &mut scene.objects[0].mesh;
    let vertices = mesh.vertices.clone().autodiff().require_grad();
    *mesh = mesh.clone().with_vertices(vertices);
    scene
}
