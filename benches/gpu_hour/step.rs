//! A step of a training: images, a loss and its gradient.

use std::time::{Duration, Instant};

use burn::tensor::{Device, Tensor};
use serde_json::{Value, json};
use softray::device::{Stage, stages_of, work};
use softray::prelude::*;

/// How long steps run before they are timed.
const WARM_UP: Duration = Duration::from_secs(1);

/// Scenes with a body whose vertices are trained and one that stands, or with colors that are trained alone.
pub struct Step {
    pub name: &'static str,
    scenes: usize,
    /// Faces of the body that moves and of the one that stands.
    faces: [usize; 2],
    /// Pixels of a side, and samples.
    size: usize,
    samples: u32,
    /// Vertices are read back once in so many renders.
    every: u32,
}

impl Step {
    pub fn new(
        name: &'static str,
        scenes: usize,
        faces: [usize; 2],
        (size, samples): (usize, u32),
    ) -> Self {
        Self {
            name,
            scenes,
            faces,
            size,
            samples,
            every: 1,
        }
    }

    /// Lets steps wait for nothing ([`HierarchyCache::reading_every`]).
    pub fn late(mut self) -> Self {
        self.every = 8;
        self
    }

    fn options(&self, world: &World, k: usize) -> RenderOptions {
        RenderOptions::new(self.size, self.size)
            .with_samples(self.samples)
            .with_bounces(1)
            .with_seed(k as u64)
            .with_adaptive_edges(false)
            .with_cache(&world.cache)
    }

    /// Returns the duration of a render without a gradient.
    fn image(&self, world: &World, k: usize, device: &Device) -> Duration {
        let start = Instant::now();
        let batch = world.batch(&world.parameter, self.scenes);
        let _images = render_batch(&batch, &self.options(world, k)).expect("images");
        device.sync().expect("a device that computes");
        start.elapsed()
    }

    /// Runs it once, for the k-th time, and returns the images and the gradient.
    fn run(&self, world: &World, k: usize, device: &Device) -> [Tensor<1>; 2] {
        let options = self.options(world, k);
        let scale = 1.0 + 1e-4 * k as f64;
        let parameter = (world.parameter.clone() * scale).autodiff().require_grad();
        let batch = world.batch(&parameter, self.scenes);
        let images = render_batch(&batch, &options).expect("images");
        let gradients = images.radiance.clone().powf_scalar(2.0).mean().backward();
        let gradient = parameter.grad(&gradients).expect("a gradient");
        device.sync().expect("a device that computes");
        let [b, h, w, c] = images.radiance.dims();
        let of_gradient: usize = gradient.dims().iter().product();
        [
            images.radiance.inner().reshape([b * h * w * c]),
            gradient.reshape([of_gradient]),
        ]
    }

    /// The numbers of the image and of the gradient.
    pub fn values(&self, device: &Device) -> [Vec<f32>; 2] {
        let world = World::new(self, device);
        let numbers = |t: Tensor<1>| t.into_data().iter::<f32>().collect();
        self.run(&world, 0, device).map(numbers)
    }

    /// The first step, the fastest of some others or the mean of late ones, what one does (that which sends least of three),
    /// and the times of its stages, each the fastest of some steps.
    pub fn measure(&self, device: &Device, runs: usize) -> Value {
        let world = World::new(self, device);
        let timed = |k: usize| {
            let start = Instant::now();
            self.run(&world, k, device);
            start.elapsed()
        };
        let first = timed(0);
        // The clock of a GPU rises while it works.
        let start = Instant::now();
        while start.elapsed() < WARM_UP {
            self.run(&world, 0, device);
        }
        // One of so many late steps begins to use other values, and takes longer.
        let step = match self.every {
            1 => (1..=runs.max(1)).map(timed).min().expect("a run"),
            every => (1..=every as usize).map(timed).sum::<Duration>() / every,
        };
        let images = (0..=runs.max(1)).map(|k| self.image(&world, k, device));
        let image = images.skip(1).min().expect("a run");
        self.run(&world, runs, device);
        let does = |k: usize| {
            let before = work();
            self.run(&world, runs + k, device);
            work() - before
        };
        let done = (1..=3).map(does).min_by_key(|done| done.uploaded_bytes);
        let done = done.expect("a run");
        let mut stages: Vec<Stage> = Vec::new();
        for k in 1..=runs.max(1) {
            let own = stages_of(|| self.run(&world, runs + 3 + k, device)).1;
            if stages.is_empty() {
                stages = own;
                continue;
            }
            for stage in &mut stages {
                let same = own.iter().find(|s| s.name == stage.name);
                stage.time = same.map_or(stage.time, |s| s.time.min(stage.time));
            }
        }
        let paths = (self.scenes * self.size * self.size) as f64 * f64::from(self.samples);
        let ms = |t: Duration| 1e3 * t.as_secs_f64();
        let of = |s: &Stage| json!({ "name": s.name, "count": s.count, "ms": ms(s.time) });
        let of_host = stages.iter().filter(|s| !s.on_device);
        json!({
            "name": self.name,
            "scenes": self.scenes,
            "faces that move": self.faces[0],
            "faces that stand": self.faces[1],
            "size": self.size,
            "samples": self.samples,
            "first, s": first.as_secs_f64(),
            "step, ms": ms(step),
            "image alone, ms": ms(image),
            "host of a timed step, ms": ms(of_host.map(|s| s.time).sum()),
            "million paths of steps a second": 1e-6 * paths / step.as_secs_f64(),
            "million paths of images a second": 1e-6 * paths / image.as_secs_f64(),
            "launches": done.launches,
            "uploads": done.uploads,
            "bytes up": done.uploaded_bytes,
            "read-backs": done.read_backs,
            "bytes back": done.read_bytes,
            "stages": stages.iter().map(of).collect::<Vec<_>>(),
        })
    }
}

/// What a step is of.
struct World {
    scene: Scene,
    /// Vertices of each scene's body `[B, V, 3]`, or one color `[1, 1, 3]`.
    parameter: Tensor<3>,
    moves: bool,
    cache: HierarchyCache,
}

impl World {
    fn new(step: &Step, device: &Device) -> Self {
        let [moving, standing] = step.faces;
        let ball = |faces: usize, x: f64| {
            let level = ((faces / 20).ilog2() / 2).max(1);
            let moved = Tensor::from_floats([x as f32, 0.9, 0.0], device);
            let size = Tensor::from_floats([0.7], device);
            shapes::icosphere(level, device)
                .scaled(size)
                .translated(moved)
        };
        let square = |y: f64, half: f64, up: f64| {
            let at = |x: f64, z: f64| [half * x, y, half * z * up];
            let [a, b] = [at(-1.0, -1.0), at(-1.0, 1.0)];
            let [c, d] = [at(1.0, 1.0), at(1.0, -1.0)];
            shapes::quad(a, b, c, d, device)
        };
        let matt = |color: [f64; 3]| Material::diffuse(color);
        let mut scene = Scene::new()
            .with_object(Object::new(square(0.0, 3.0, 1.0)).with_material(matt([0.7; 3])))
            .with_object(
                Object::new(square(4.0, 0.7, -1.0)).with_material(Material::emitter([9.0; 3])),
            )
            .with_environment([0.2; 3]);
        if standing > 0 {
            let object = Object::new(ball(standing, 0.9)).with_name("stands");
            scene = scene.with_object(object.with_material(matt([0.3, 0.5, 0.7])));
        }
        let mut parameter = Tensor::from_floats([[[0.3, 0.5, 0.7]]], device);
        if moving > 0 {
            let mesh = ball(moving, -0.9);
            let [count, _] = mesh.vertices.dims();
            let one = mesh.vertices.clone().reshape([1, count, 3]);
            parameter = one.repeat(&[step.scenes, 1, 1]);
            let object = Object::new(mesh).with_name("moves");
            scene = scene.with_object(object.with_material(matt([0.7, 0.5, 0.3])));
        }
        Self {
            scene,
            parameter,
            moves: moving > 0,
            cache: HierarchyCache::new().reading_every(step.every),
        }
    }

    fn batch(&self, parameter: &Tensor<3>, scenes: usize) -> Batch {
        let camera = |k: usize| {
            let turn = 0.1 * k as f64;
            let eye = [5.0 * turn.sin(), 1.5, 5.0 * turn.cos()];
            Camera::look_at(eye, [0.0, 0.8, 0.0]).with_fov_y(45.0)
        };
        let cameras = (0..scenes).map(camera).collect();
        if self.moves {
            let batch = Batch::new(vec![self.scene.clone(); scenes], cameras);
            let batch = batch.and_then(|b| b.with_vertices("moves", parameter.clone()));
            return batch.expect("a batch");
        }
        let color = parameter.clone().reshape([3]);
        let scene = self.scene.clone();
        let scene = scene.map_object("stands", |o| {
            o.with_material(Material::diffuse(color.clone()))
        });
        Batch::new(vec![scene.expect("the body")], cameras).expect("a batch")
    }
}
