//! Losses that depend on little of an image, or on numbers that are not finite, and emitters that are many: kernels on a
//! GPU beside those of the host.

use crate::common::numbers::apart;
use crate::common::scenes::{diffuse, emitting, facing_front, floor, lamp};
use crate::common::tensors::{gradient, tensor, with_leaves};
use crate::device::device;
use burn::tensor::{DType, Device, Tensor};
use softray::prelude::*;

const SIZE: usize = 32;

/// A body over a floor, in the light of a lamp, under a black sky.
fn scene(device: &Device) -> Scene {
    let body = shapes::icosahedron(device).scaled([0.5; 3]);
    Scene::new()
        .with_object(diffuse(floor(1.0, -0.6, device), [0.5, 0.4, 0.3]).with_name("floor"))
        .with_object(lamp(0.5, 2.0, [5.0, 4.0, 3.0], device).with_name("lamp"))
        .with_object(diffuse(body, [0.3, 0.5, 0.6]).with_name("body"))
}

fn camera() -> Camera {
    Camera::look_at([0.3, 1.0, 4.0], [0.0, 0.0, 0.0]).with_fov_y(40.0)
}

fn options() -> RenderOptions {
    let options = RenderOptions::new(SIZE, SIZE)
        .with_samples(4)
        .with_bounces(1);
    options.with_opacity().with_seed(4)
}

/// Derivatives of a loss by all vertices.
fn by_vertices(
    scene: Scene,
    options: &RenderOptions,
    loss: impl Fn(Image) -> Tensor<1>,
) -> Vec<f64> {
    let scene = with_leaves(scene);
    let image = render(&scene, &camera(), options).expect("an image");
    let gradients = loss(image).backward();
    let of = |o: &Object| gradient(&o.mesh.vertices, &gradients);
    scene.objects.iter().flat_map(of).collect()
}

/// How far the gradient of a loss is from that of the host.
fn off(
    build: impl Fn(&Device) -> Scene,
    options: &RenderOptions,
    loss: impl Fn(Image) -> Tensor<1>,
) -> f64 {
    let found = by_vertices(build(&device()), options, &loss);
    let wanted = by_vertices(build(&Device::flex()), options, &loss);
    assert!(wanted.iter().any(|&g| g != 0.0));
    let off = apart(&found, &wanted);
    println!("{off:e}");
    off
}

/// The sum of an image's pixels, each times a weight.
fn weighted(image: Image, weight: impl Fn(usize) -> f64) -> Tensor<1> {
    let radiance = image.radiance;
    let size = radiance.dims();
    let list: Vec<f64> = (0..size.iter().product()).map(|i| weight(i / 3)).collect();
    let weights = tensor(&list, size, &radiance.device(), DType::F32);
    (radiance * weights).sum()
}

/// A loss of few pixels, very small: derivatives that few samples have are still measured and added.
#[test]
fn a_loss_of_few_pixels() {
    let few = |pixel: usize| if pixel % 97 == 43 { 1e-9 } else { 0.0 };
    assert!(off(scene, &options(), |image| weighted(image, few)) < 1e-5);
}

/// A pixel that is not among those that are measured, and counts for far more than all of them: its derivatives are
/// added to sums that have more room than those of a launch.
#[test]
fn a_pixel_that_counts_for_far_more() {
    let options = RenderOptions::new(128, 128)
        .with_samples(1)
        .with_bounces(1)
        .with_seed(4);
    let options = options.with_adaptive_edges(false);
    let one = 64 * 128 + 62;
    let weight = |pixel: usize| if pixel == one { 1e9 } else { 1.0 };
    assert!(off(scene, &options, |image| weighted(image, weight)) < 1e-5);
}

/// Film jumps alone carry a loss of what is covered.
#[test]
fn a_loss_of_opacity() {
    let of_opacity = |image: Image| {
        let opacity = image.opacity.expect("opacity");
        opacity.slice([14..19, 0..SIZE]).sum() * 1e-6
    };
    assert!(off(scene, &options(), of_opacity) < 1e-5);
}

#[test]
fn a_loss_of_nothing() {
    let found = by_vertices(scene(&device()), &options(), |i| weighted(i, |_| 0.0));
    assert!(found.iter().all(|&g| g == 0.0));
}

/// A derivative that is not a number, by a pixel that sees the black sky, reaches nothing.
#[test]
fn nan_where_nothing_is_seen() {
    let loss = |image: Image| {
        let nan = |p: usize| if p == 1 { f64::NAN } else { 0.0 };
        let opacity = image.opacity.clone().expect("opacity");
        let list: Vec<f64> = (0..SIZE * SIZE).map(nan).collect();
        let nans = tensor(&list, [SIZE, SIZE], &opacity.device(), DType::F32);
        weighted(image, |p| 0.1 + nan(p + 1)) + (opacity * nans).sum()
    };
    assert!(off(scene, &options(), loss) < 1e-5);
}

/// A derivative that is not finite, by a pixel that sees the body, is in the gradient: by its radiance, and by its depth
/// alone.
#[test]
fn what_is_not_finite_is_not_lost() {
    const MIDDLE: usize = SIZE / 2 * SIZE + SIZE / 2;
    let at = |bad: f64| move |pixel: usize| if pixel == MIDDLE { bad } else { 0.0 };
    let by_depth = |image: Image, bad: f64| {
        let depth = image.depth.expect("depth");
        let list: Vec<f64> = (0..SIZE * SIZE).map(at(bad)).collect();
        let weights = tensor(&list, [SIZE, SIZE], &depth.device(), DType::F32);
        (depth * weights).sum()
    };
    let options = options().with_depth();
    for bad in [f64::NAN, f64::INFINITY] {
        for device in [device(), Device::flex()] {
            let lost = |by: &[f64]| by.iter().all(|g| g.is_finite());
            let by = by_vertices(scene(&device), &options, |i| weighted(i, at(bad)));
            assert!(!lost(&by), "{bad} by radiance on {device:?}: {by:?}");
            let by = by_vertices(scene(&device), &options, |i| by_depth(i, bad));
            assert!(!lost(&by), "{bad} by depth on {device:?}: {by:?}");
        }
    }
}

/// So many emitters that one is searched for, with fixed probabilities; and lights that are all far away.
#[test]
fn many_emitters() {
    let balls = |device: &Device| {
        let ball = shapes::icosphere(1, device).scaled([0.2; 3]);
        let ball = emitting(ball.translated([-1.0, 1.2, 0.4]), [1.0, 2.0, 3.0]);
        scene(device).with_object(ball)
    };
    for emitters in [EmitterSampling::Uniform, EmitterSampling::Power] {
        let mut sampling = Sampling::default();
        sampling.emitters = emitters;
        let options = options().with_sampling(sampling);
        assert!(off(balls, &options, |i| weighted(i, |_| 1.0)) < 1e-5);
    }
    let distant = |device: &Device| {
        let lights = (0..70).map(|i| {
            let turn = 0.7 * f64::from(i);
            let direction = [0.5 * turn.cos(), -1.0, 0.5 * turn.sin()];
            Light::directional(direction, [0.01 + 1e-3 * f64::from(i); 3])
        });
        let dark =
            scene(device).map_object("lamp", |o| o.with_material(Material::diffuse([0.2; 3])));
        lights.fold(dark.expect("the lamp"), Scene::with_light)
    };
    assert!(off(distant, &options(), |i| weighted(i, |_| 1.0)) < 1e-4);
}

/// Jumps at the lines in which a flying body passes through what stands, which move while the shutter is open.
#[test]
fn flying_crossings() {
    let on = |device: &Device| {
        let still = scene(device);
        let wall = facing_front([-0.2, 1.4], [-0.4, 1.0], 0.1, device);
        let flying = still
            .clone()
            .map_object("body", |o| o.with_velocity([0.4, 0.1, 0.0]))
            .expect("the body")
            .with_object(diffuse(wall, [0.6, 0.5, 0.4]));
        let [still, flying] = [still, flying].map(with_leaves);
        let batch = Batch::new(vec![still.clone(), flying.clone()], vec![camera(); 2]);
        let images = render_batch(&batch.expect("a batch"), &options()).expect("images");
        let gradients = images.radiance.powi_scalar(2).sum().backward();
        let objects = still.objects.iter().chain(&flying.objects);
        let by = objects.flat_map(|o| gradient(&o.mesh.vertices, &gradients));
        by.collect::<Vec<f64>>()
    };
    let off = apart(&on(&device()), &on(&Device::flex()));
    println!("{off:e}");
    assert!(off < 1e-5, "{off}");
}
