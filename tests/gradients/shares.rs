//! Samples are shared out among edges of shadows, of reflected light and on the film by their variance and cost.

use crate::common::numbers::mean_and_error;
use crate::common::scenes::{diffuse, emitting, facing_down, facing_front};
use crate::common::tensors::{gradient, leaf};
use burn::tensor::Device;
use rayon::prelude::*;
use softray::prelude::*;
use softray::scene::shapes;

/// Derivatives by the x of a ball that is seen in a rough mirror alone, by seeds.
fn in_a_mirror(adaptive: bool, seeds: u64) -> Vec<f64> {
    let device = Device::flex();
    let mirror = Material::phong([0.02; 3], [0.9; 3], 400.0);
    let wall = facing_front([-2.5, 2.5], [-1.8, 1.8], 0.0, &device);
    let ball = shapes::icosphere(0, &device)
        .scaled(0.8)
        .translated([-0.2, 0.3, 4.6]);
    let lamp = facing_down([-0.7, 0.7], [2.3, 3.7], 4.0, &device);
    let camera = Camera::look_at([0.0, 0.0, 2.6], [0.0; 3]).with_fov_y(55.0);
    let of_seed = |seed| {
        let options = RenderOptions::new(32, 32)
            .with_samples(16)
            .with_bounces(1)
            .with_adaptive_edges(adaptive)
            .with_seed(seed);
        let offset = leaf(&[0.0; 3], &device);
        let ball = diffuse(ball.clone().translated(offset.clone()), [0.8, 0.5, 0.2]);
        let scene = Scene::new()
            .with_object(Object::new(wall.clone()).with_material(mirror.clone()))
            .with_object(ball)
            .with_object(emitting(lamp.clone(), [20.0, 18.0, 15.0]));
        let image = render(&scene, &camera, &options).expect("an image");
        // Its left half, so that the derivative is not the small one of an image that shifts as a whole.
        let left = image.radiance.slice([0..32, 0..16]).sum();
        gradient(&offset, &left.backward())[0]
    };
    (0..seeds).into_par_iter().map(of_seed).collect()
}

/// A loss of few pixels has none that could measure the others: the usual numbers are taken.
#[test]
fn losses_of_few_pixels_take_the_usual_numbers() {
    let device = Device::flex();
    let (room, camera) = cornell_box(&device);
    let derivative = |adaptive| {
        let offset = leaf(&[0.0; 3], &device);
        let moved = |o: Object| o.map_mesh(|m| m.translated(offset.clone()));
        let room = room.clone().map_object("tall", moved).expect("a block");
        let options = RenderOptions::new(16, 16)
            .with_samples(8192)
            .with_bounces(0)
            .with_adaptive_edges(adaptive);
        let image = render_pixels(&room, &camera, &options, &[102, 103]).expect("pixels");
        gradient(&offset, &image.radiance.sum().backward())
    };
    let usual = derivative(false);
    assert!(usual.iter().any(|g| g.abs() > 1e-3), "{usual:?}");
    assert_eq!(usual, derivative(true));
}

/// What goes to edges of shadows and on the film, of which there are none, goes to reflected ones, and the mean stays.
#[test]
fn more_samples_where_the_noise_is() {
    let seeds = 60;
    let (usual, shared) = (in_a_mirror(false, seeds), in_a_mirror(true, seeds));
    let [(mean, error), (other, other_error)] = [&usual, &shared].map(|v| mean_and_error(v));
    println!("usual {mean:.4} ± {error:.4}, shared {other:.4} ± {other_error:.4}");
    // More noise would hide a bias.
    assert!(error.hypot(other_error) < 0.1 * mean.abs());
    assert!((mean - other).abs() < 3.0 * error.hypot(other_error));
    assert!(other_error < 0.8 * error);
    assert_eq!(in_a_mirror(true, 2), shared[..2]);
}
