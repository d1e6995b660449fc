//! Renders, gradients, and surfaces of grids: `cargo bench --bench render`. Items are rays, or nodes of grids.

use std::path::PathBuf;

use divan::Bencher;
use divan::counter::ItemsCount;
use softray::modules::DMTetParamsConfig;
use softray::prelude::*;

fn main() {
    divan::main();
}

fn cornell(device: &Device) -> SceneFile {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/cornell/scene.json");
    SceneFile::load(path, device).expect("a scene")
}

fn options(bounces: u32) -> RenderOptions {
    RenderOptions::new(64, 64)
        .with_samples(4)
        .with_bounces(bounces)
}

fn rays(scene: &Scene, camera: &Camera, options: &RenderOptions) -> u64 {
    let image = render(scene, camera, options).expect("an image");
    image.statistics.rays
}

/// Without gradient, over bounces.
#[divan::bench(args = [0, 1, 3], sample_count = 10)]
fn cornell_box(bencher: Bencher, bounces: u32) {
    let file = cornell(&Device::flex());
    let options = options(bounces);
    bencher
        .counter(ItemsCount::new(rays(&file.scene, &file.camera, &options)))
        .bench(|| render(&file.scene, &file.camera, &options).expect("an image"));
}

/// Forward and backward to all vertices of the short block, over bounces.
#[divan::bench(args = [0, 1, 3], sample_count = 10)]
fn cornell_box_gradient(bencher: Bencher, bounces: u32) {
    let file = cornell(&Device::flex());
    let options = options(bounces);
    bencher
        .counter(ItemsCount::new(rays(&file.scene, &file.camera, &options)))
        .bench(|| {
            let offset = Tensor::<2>::zeros([1, 3], &Device::flex())
                .autodiff()
                .require_grad();
            let scene = file
                .scene
                .clone()
                .map_object("short", |o| {
                    o.map_mesh(|m| {
                        let moved = m.vertices.clone() + offset.clone();
                        m.with_vertices(moved)
                    })
                })
                .expect("the object");
            let image = render(&scene, &file.camera, &options).expect("an image");
            image.radiance.powf_scalar(2.0).mean().backward()
        });
}

/// The derivative images of the same, over the number of directions in which the short block moves.
#[divan::bench(args = [1, 2, 4, 8], sample_count = 10)]
fn cornell_box_directions(bencher: Bencher, directions: usize) {
    let file = cornell(&Device::flex());
    let options = options(1);
    let tangents: Vec<Tangent> = (0..directions)
        .map(|k| {
            let along: [f32; 3] = std::array::from_fn(|axis| ((k + axis) as f32).sin());
            let set = |scene: &mut Scene, _: &mut Camera| {
                let short = scene.objects.iter_mut().find(|o| o.name == "short");
                let vertices = &mut short.expect("the object").mesh.vertices;
                let along = Tensor::<2>::from_floats([along], &Device::flex());
                *vertices = along.expand(vertices.dims());
            };
            Tangent::new(&file.scene, &file.camera, set).expect("a direction")
        })
        .collect();
    bencher
        .counter(ItemsCount::new(rays(&file.scene, &file.camera, &options)))
        .bench(|| {
            render_derivative(&file.scene, &file.camera, &options, &tangents).expect("derivatives")
        });
}

/// A sphere in a uniform environment, without gradient, over its faces.
#[divan::bench(args = [1, 2, 3], sample_count = 10)]
fn icosphere(bencher: Bencher, subdivisions: u32) {
    let device = Device::flex();
    let ball = shapes::icosphere(subdivisions, &device);
    let scene = Scene::new()
        .with_object(Object::new(ball).with_material(Material::diffuse([0.7; 3])))
        .with_environment([1.0; 3]);
    let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]).with_fov_y(40.0);
    let options = RenderOptions::new(32, 32).with_samples(4).with_bounces(0);
    bencher
        .counter(ItemsCount::new(rays(&scene, &camera, &options)))
        .bench(|| render(&scene, &camera, &options).expect("an image"));
}

/// The surface of a ball from a grid of signed distances and offsets, forward and backward, over cells along an axis.
#[divan::bench(args = [32, 64, 128], sample_count = 10)]
fn marching_tetrahedra(bencher: Bencher, cells: usize) {
    let ball = DMTetParamsConfig::new(cells).with_radius(0.7);
    let ball = ball.init(&Device::flex().autodiff()).expect("a ball");
    bencher
        .counter(ItemsCount::new(ball.grid().size().pow(3)))
        .bench(|| {
            let vertices = ball.mesh().expect("a surface").vertices;
            vertices.powi_scalar(2).sum().backward()
        });
}
