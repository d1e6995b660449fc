//! Kernels that a training compiles.

use std::path::Path;

use crate::common::folder::Folder;
use crate::common::process::alone_with;
use crate::common::scenes::{diffuse, floor, lamp};
use crate::common::tensors::gradient;
use crate::device::device;
use burn::tensor::Tensor;
use softray::prelude::*;

/// The variable that names the file in which CubeCL logs what it compiles.
const LOG: &str = "CUBECL_DEBUG_LOG";

/// Kernels of this crate that were compiled so far, by the log.
fn compiled(log: &Path) -> usize {
    let text = std::fs::read_to_string(log).expect("a log");
    text.matches("\nname: softray::").count()
}

/// A hundred steps in which a body changes its form, comes to pass through the floor and leaves it again compile no kernel
/// after the third. A step of a large image then compiles only the kernel that adds the sums of several launches.
#[test]
fn a_fit_compiles_its_kernels_in_its_first_steps() {
    let folder = Folder::new("compiled");
    let log = [(LOG, &*folder.path("log"))];
    if !alone_with(a_fit_compiles_its_kernels_in_its_first_steps, &log) {
        return;
    }
    let log = std::env::var(LOG).expect("the variable");
    let device = device();
    let ball = shapes::icosphere(2, &device).scaled([0.5; 3]);
    let scene = Scene::new()
        .with_object(diffuse(floor(2.0, -0.6, &device), [0.5, 0.4, 0.3]))
        .with_object(lamp(0.5, 2.0, [5.0, 4.0, 3.0], &device))
        .with_object(diffuse(ball.clone(), [0.3, 0.5, 0.6]).with_name("body"));
    let camera = Camera::look_at([0.3, 1.0, 4.0], [0.0, 0.0, 0.0]).with_fov_y(40.0);
    let cache = HierarchyCache::default();
    let options = |size, samples| {
        RenderOptions::new(size, size)
            .with_samples(samples)
            .with_bounces(1)
            .with_cache(&cache)
    };
    let waves = (ball.vertices.clone() * 9.0).sin();
    let run = |step: u32, options: &RenderOptions| {
        let down = 0.3 * (f64::from(step) / 99.0 * std::f64::consts::PI).sin();
        let down = Tensor::<1>::from_floats([0.0, -down as f32, 0.0], &device);
        let vertices = ball.vertices.clone() + waves.clone() * (0.001 * f64::from(step));
        let vertices = (vertices + down.unsqueeze()).autodiff().require_grad();
        let body = ball.clone().with_vertices(vertices.clone());
        let scene = scene
            .clone()
            .map_object("body", |o| o.map_mesh(|_| body.clone()));
        let scene = scene.expect("the body");
        let image =
            render(&scene, &camera, &options.clone().with_seed(step.into())).expect("an image");
        let gradients = image.radiance.powf_scalar(2.0).sum().backward();
        assert!(
            gradient(&vertices, &gradients)
                .iter()
                .all(|g| g.is_finite())
        );
        compiled(Path::new(&log))
    };
    let counts: Vec<usize> = (0..100).map(|step| run(step, &options(8, 2))).collect();
    let large = run(99, &options(64, 40));
    println!("kernels: {counts:?}, with a large image {large}");
    let early = counts[2];
    assert!(early > 10 && counts[99] == early && large <= early + 1);
}
