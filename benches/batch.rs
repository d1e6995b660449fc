//! Batches against renders one by one: a deformed template per item, and one scene by many cameras.
//! Times of one run, best of some rounds in turn; the ratio is what counts on a shared machine.
//!
//! ```sh
//! cargo bench --bench batch
//! ```

use std::time::Instant;

use burn::tensor::{Device, Tensor};
use softray::prelude::*;

const ROUNDS: usize = 7;

/// A template of some faces, a lamp, and vertices of all items as a network returns them.
struct World {
    scene: Scene,
    ball: Mesh,
    vertices: Tensor<3>,
    cameras: Vec<Camera>,
}

fn world(level: u32, items: usize) -> World {
    let device = Device::flex();
    let ball = shapes::icosphere(level, &device);
    let corners = [
        [-1.0, 3.0, -1.0],
        [1.0, 3.0, -1.0],
        [1.0, 3.0, 1.0],
        [-1.0, 3.0, 1.0],
    ];
    let [a, b, c, d] = corners;
    let lamp = Object::new(shapes::quad(a, b, c, d, &device));
    let scene = Scene::new()
        .with_object(Object::new(ball.clone()).with_name("body"))
        .with_object(lamp.with_material(Material::emitter([8.0; 3])))
        .with_environment([0.4; 3]);
    let widths: Vec<f32> = (0..items)
        .map(|i| 0.7 + 0.5 * i as f32 / items as f32)
        .collect();
    let widths = Tensor::<1>::from_floats(widths.as_slice(), &device);
    let vertices = ball.vertices.clone().unsqueeze::<3>() * widths.reshape([items, 1, 1]);
    let camera = |i: usize| {
        let angle = i as f64;
        let eye = [4.0 * angle.sin(), 1.0, 4.0 * angle.cos()];
        Camera::look_at(eye, [0.0; 3]).with_fov_y(40.0)
    };
    World {
        scene,
        ball,
        vertices,
        cameras: (0..items).map(camera).collect(),
    }
}

/// Seconds forward and backward, and the gradient's length.
fn batch(world: &World, options: &RenderOptions) -> f64 {
    let vertices = world.vertices.clone().autodiff().require_grad();
    let start = Instant::now();
    let scenes = vec![world.scene.clone(); world.cameras.len()];
    let batch = Batch::new(scenes, world.cameras.clone()).expect("a batch");
    let batch = batch
        .with_vertices("body", vertices.clone())
        .expect("vertices");
    let images = render_batch(&batch, options).expect("images");
    let gradients = images.radiance.powf_scalar(2.0).mean().backward();
    vertices.grad(&gradients).expect("a gradient").into_data();
    start.elapsed().as_secs_f64()
}

fn one_by_one(world: &World, options: &RenderOptions) -> f64 {
    let vertices = world.vertices.clone().autodiff().require_grad();
    let [_, count, _] = vertices.dims();
    let start = Instant::now();
    let mut images = Vec::new();
    for (i, camera) in world.cameras.iter().enumerate() {
        let rows = vertices.clone().slice([i..i + 1]).reshape([count, 3]);
        let mesh = world.ball.clone().with_vertices(rows);
        let scene = world.scene.clone();
        let scene = scene
            .map_object("body", |o| o.map_mesh(|_| mesh.clone()))
            .expect("the object");
        let image = render(&scene, camera, &options.of_view(i)).expect("an image");
        images.push(image.radiance);
    }
    let images = Tensor::stack::<4>(images, 0);
    let gradients = images.powf_scalar(2.0).mean().backward();
    vertices.grad(&gradients).expect("a gradient").into_data();
    start.elapsed().as_secs_f64()
}

/// One scene by all cameras, without gradient: together, one by one.
fn views(world: &World, options: &RenderOptions) -> [f64; 2] {
    let start = Instant::now();
    let batch = Batch::new(vec![world.scene.clone()], world.cameras.clone()).expect("a batch");
    render_batch(&batch, options).expect("images");
    let together = start.elapsed().as_secs_f64();
    let start = Instant::now();
    for (i, camera) in world.cameras.iter().enumerate() {
        render(&world.scene, camera, &options.of_view(i)).expect("an image");
    }
    [together, start.elapsed().as_secs_f64()]
}

fn least(mut run: impl FnMut() -> [f64; 2]) -> [f64; 2] {
    let mut best = [f64::INFINITY; 2];
    for _ in 0..ROUNDS {
        let times = run();
        best = [best[0].min(times[0]), best[1].min(times[1])];
    }
    best
}

fn main() {
    println!("| what | items | faces | image | batch, ms | one by one, ms | ratio |");
    println!("|---|---|---|---|---|---|---|");
    let row = |what: &str, (items, level, size, samples): (usize, u32, usize, u32), t: [f64; 2]| {
        let faces = 20 * 4u32.pow(level);
        println!(
            "| {what} | {items} | {faces} | {size}² × {samples} | {:.1} | {:.1} | {:.2} |",
            1e3 * t[0],
            1e3 * t[1],
            t[1] / t[0]
        );
    };
    for setting in [
        (16, 2, 32, 1),
        (16, 2, 64, 2),
        (16, 3, 64, 2),
        (32, 3, 32, 1),
    ] {
        let (items, level, size, samples) = setting;
        let world = world(level, items);
        let options = RenderOptions::new(size, size)
            .with_samples(samples)
            .with_bounces(0);
        let times = least(|| [batch(&world, &options), one_by_one(&world, &options)]);
        row("deformed template, forward + backward", setting, times);
    }
    for setting in [(16, 3, 32, 1), (16, 5, 32, 1)] {
        let (items, level, size, samples) = setting;
        let world = world(level, items);
        let options = RenderOptions::new(size, size)
            .with_samples(samples)
            .with_bounces(0);
        let times = least(|| views(&world, &options));
        row("one scene, many cameras, forward", setting, times);
    }
}
