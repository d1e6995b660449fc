//! Training steps on a GPU that wait for nothing: the device takes vertices from their tensor, and the host's values are
//! those of an earlier step.

mod lights;
mod prepared;

use burn::tensor::{Device, Gradients, Int, Tensor};
use softray::device::{Work, work};
use softray::prelude::*;

use crate::common::numbers::{apart, mean_and_error, norm};
use crate::common::process::alone;
use crate::common::scenes::{diffuse, floor, lamp};
use crate::common::tensors::{gradient, leaf, values};
use crate::device::device;

/// A ball of 1,280 faces that moves, and a scene with a ball of 320 faces that stands.
struct Bodies {
    ball: Mesh,
    scene: Scene,
    camera: Camera,
}

/// An image and a gradient.
type Step = [Vec<f64>; 2];

impl Bodies {
    fn new(device: &Device) -> Self {
        let beside = shapes::icosphere(2, device).scaled([0.4; 3]);
        let scene = Scene::new()
            .with_object(diffuse(floor(2.0, -0.6, device), [0.5, 0.4, 0.3]))
            .with_object(lamp(0.5, 2.0, [5.0, 4.0, 3.0], device))
            .with_object(diffuse(beside.translated([1.0, 0.0, 0.0]), [0.6, 0.5, 0.3]));
        Self {
            ball: shapes::icosphere(3, device).scaled([0.5; 3]),
            scene,
            camera: Camera::look_at([0.3, 1.0, 4.0], [0.2, 0.0, 0.0]).with_fov_y(40.0),
        }
    }

    /// Renders with the ball's vertices moved by `way`. Returns the image, the gradient by the vertices, and the work.
    fn step(&self, way: f32, options: &RenderOptions) -> Result<(Step, Work), softray::Error> {
        let vertices = self.ball.vertices.clone().add_scalar(way);
        let vertices = vertices.autodiff().require_grad();
        let mut ball = self.ball.clone();
        ball.vertices = vertices.clone();
        let ball = diffuse(ball, [0.3, 0.5, 0.6]).with_name("ball");
        let scene = self.scene.clone().with_object(ball);
        let before = work();
        let image = render(&scene, &self.camera, options)?;
        let gradients = image.radiance.clone().powf_scalar(2.0).sum().backward();
        let during = work() - before;
        let by = gradient(&vertices, &gradients);
        Ok(([values(&image.radiance), by], during))
    }
}

/// Leaves whose elements are waves, with a phase that moves with the steps.
struct Waves {
    step: u64,
    leaves: Vec<Tensor<1>>,
}

impl Waves {
    fn new(step: u64) -> Self {
        let leaves = Vec::new();
        Self { step, leaves }
    }

    /// Returns a leaf of `count` elements between `low` and `high`.
    fn next(&mut self, count: usize, low: f32, high: f32) -> Tensor<1> {
        let phases = Tensor::<1, Int>::arange(0..count as i64, &device()).float();
        let wave = (phases * 1.7 + 0.2 * self.step as f64).sin();
        let wave = wave * (0.5 * (high - low)) + 0.5 * (high + low);
        self.leaves.push(wave.autodiff().require_grad());
        self.leaves.last().expect("a leaf").clone()
    }

    fn gradients(&self, gradients: &Gradients) -> Vec<Vec<f64>> {
        let leaves = self.leaves.iter();
        leaves.map(|leaf| gradient(leaf, gradients)).collect()
    }
}

fn options(every: u32) -> RenderOptions {
    let cache = HierarchyCache::new().reading_every(every);
    let options = RenderOptions::new(16, 16).with_samples(4).with_bounces(1);
    options.with_cache(&cache)
}

/// Late steps read nothing back, send little, and have the images and gradients of steps that read.
#[test]
fn late_steps_wait_for_nothing() {
    if !alone(late_steps_wait_for_nothing) {
        return;
    }
    let bodies = Bodies::new(&device());
    let (late, reading) = (options(3), options(1));
    // The steps 2 and 5 request values. These arrive in the next step, and steps from 5 and from 8 on use them.
    let ways = [
        0.0, 1e-6, 2e-6, 3e-6, 3e-3, 4e-3, 4.001e-3, 4.002e-3, 4.003e-3,
    ];
    for (i, way) in ways.into_iter().enumerate() {
        let seed = 7 + i as u64;
        let step = |options: &RenderOptions| {
            let step = bodies.step(way, &options.clone().with_seed(seed));
            step.expect("an image")
        };
        let ([image, by], work) = step(&late);
        let ([wanted, wanted_by], usual) = step(&reading);
        let (off, off_by) = (apart(&image, &wanted), apart(&by, &wanted_by));
        println!("step {i}: image {off:e}, gradient {off_by:e}\n{work:?}\n{usual:?}");
        assert_eq!(image, wanted, "step {i}");
        // Film samples are drawn in the order that the edges had when the values were read.
        let read_at = [0, 0, 0, 0, 0, 2, 2, 2, 5][i];
        let limit = if way - ways[read_at] > 1e-4 {
            0.2
        } else {
            3e-7
        };
        assert!(off_by < limit, "step {i}: {off_by:e}");
        assert_eq!(usual.read_backs, 1);
        assert_eq!(work.read_backs, u64::from(i == 0), "step {i}");
        assert!(work.launches <= 24, "step {i}: {work:?}");
        // Steps that begin to use other values send what was prepared from them.
        if ![0, 5, 8].contains(&i) {
            assert!(
                work.launches <= 23 && work.uploads <= 2,
                "step {i}: {work:?}"
            );
            assert!(work.uploaded_bytes * 20 < usual.uploaded_bytes, "step {i}");
        }
    }
}

/// After a move, edges on the film are drawn in the order of the last reading: gradients by the ball's place have other
/// noise, and the same mean within four standard errors.
#[test]
fn gradients_after_a_move_have_the_same_mean() {
    const SEEDS: u64 = 24;
    let bodies = Bodies::new(&device());
    let (late, reading) = (options(1000), options(1));
    bodies.step(0.0, &late).expect("an image");
    let by_place = |options: &RenderOptions, seed: u64| {
        let step = bodies.step(4e-3, &options.clone().with_seed(seed));
        let ([_, by], _) = step.expect("an image");
        [0, 1, 2].map(|axis| by.iter().skip(axis).step_by(3).sum::<f64>())
    };
    let pairs: Vec<_> = (0..SEEDS)
        .map(|seed| (by_place(&late, seed), by_place(&reading, seed)))
        .collect();
    let usual = [0, 1, 2].map(|axis| {
        let along: Vec<f64> = pairs.iter().map(|pair| pair.1[axis]).collect();
        mean_and_error(&along)
    });
    let size = norm(&usual.map(|(mean, _)| mean));
    for (axis, (usual, noise)) in usual.into_iter().enumerate() {
        let differences = pairs.iter().map(|(late, usual)| late[axis] - usual[axis]);
        let (mean, error) = mean_and_error(&differences.collect::<Vec<_>>());
        println!("axis {axis}: {usual:.4} ± {noise:.4} of {size:.4}, late {mean:.4} ± {error:.4}");
        // More noise would hide a bias.
        assert!(noise < 0.2 * size, "axis {axis}: {noise} of {size}");
        // Two renders of independent noise differ by √2 of it, which 24 seeds tell within a half.
        assert!(
            error > 0.0 && error < 2.5 * noise,
            "axis {axis}: {error}, {noise}"
        );
        assert!(mean.abs() < 4.0 * error, "axis {axis}");
    }
}

/// A batch whose scenes need other kernels is traced in two groups, each with its own lists. Both are placed by the device,
/// and their values arrive together.
#[test]
fn late_steps_of_two_groups() {
    if !alone(late_steps_of_two_groups) {
        return;
    }
    let bodies = Bodies::new(&device());
    let (late, reading) = (options(3), options(1));
    let with = |material: Material| {
        let ball = Object::new(bodies.ball.clone()).with_name("ball");
        bodies
            .scene
            .clone()
            .with_object(ball.with_material(material))
    };
    let scenes = vec![
        with(Material::diffuse([0.3, 0.5, 0.6])),
        with(Material::phong([0.3, 0.2, 0.2], [0.4; 3], 20.0)),
    ];
    let step = |way: f32, options: &RenderOptions| {
        let one = bodies.ball.vertices.clone().add_scalar(way).unsqueeze();
        let vertices: Tensor<3> = Tensor::cat(vec![one.clone(), one * 1.1], 0);
        let vertices = vertices.autodiff().require_grad();
        let batch = Batch::new(scenes.clone(), vec![bodies.camera.clone(); 2]);
        let batch = batch.and_then(|batch| batch.with_vertices("ball", vertices.clone()));
        let before = work();
        let images = render_batch(&batch.expect("a batch"), options).expect("images");
        let gradients = images.radiance.clone().powf_scalar(2.0).sum().backward();
        let during = work() - before;
        let by = gradient(&vertices, &gradients);
        ([values(&images.radiance), by], during)
    };
    for i in 0..6 {
        let way = 1e-6 * i as f32;
        let seed = 7 + i as u64;
        let ([image, by], work) = step(way, &late.clone().with_seed(seed));
        let ([wanted, wanted_by], usual) = step(way, &reading.clone().with_seed(seed));
        let off_by = apart(&by, &wanted_by);
        println!("step {i}: gradient {off_by:e}\n{work:?}\n{usual:?}");
        assert_eq!(image, wanted, "step {i}");
        assert!(off_by < 1e-6, "step {i}: {off_by:e}");
        assert!(usual.launches > 40, "one group: {usual:?}");
        assert_eq!(usual.read_backs, 1);
        assert_eq!(work.read_backs, u64::from(i == 0), "step {i}");
        // In step 5 the values of step 2 are taken.
        if ![0, 5].contains(&i) {
            assert!(work.uploads <= 4, "step {i}: {work:?}");
            assert!(work.uploaded_bytes * 20 < usual.uploaded_bytes, "step {i}");
        }
    }
}

/// A vertex that has moved far, or is not finite, is found in the next step, which reads.
#[test]
fn far_moves_and_wrong_vertices_are_found() {
    if !alone(far_moves_and_wrong_vertices_are_found) {
        return;
    }
    let bodies = Bodies::new(&device());
    let options = options(100);
    let reads = |way: f32| {
        let step = bodies.step(way, &options);
        step.map(|(_, work)| work.read_backs)
    };
    let steps = [(0.0, 1), (1e-3, 0), (0.1, 0), (0.1, 1), (0.101, 0)];
    for (i, (way, wanted)) in steps.into_iter().enumerate() {
        assert_eq!(reads(way).expect("an image"), wanted, "step {i}");
    }
    assert_eq!(reads(f32::NAN).expect("an image that nothing waits for"), 0);
    let error = reads(f32::NAN).expect_err("vertices that are not finite");
    let message = error.to_string();
    println!("{message}");
    assert!(
        message.contains("ball") && message.contains("vertices"),
        "{message}"
    );
    assert_eq!(reads(0.1).expect("an image"), 1);
}

/// Constants that are tensors are told apart by their memory, also a camera's and those that are not contiguous.
#[test]
fn other_constants_are_read() {
    if !alone(other_constants_are_read) {
        return;
    }
    let device = device();
    let mut bodies = Bodies::new(&device);
    let (late, reading) = (options(100), options(1));
    let scene = bodies.scene.clone();
    let texels = |red: f32| {
        let planes = [[red; 16], [0.4; 16], [0.3; 16]].concat();
        let planes = Tensor::<1>::from_floats(planes.as_slice(), &device);
        ColorTexture::texture(planes.reshape([3, 4, 4]).permute([1, 2, 0]))
    };
    let eye = |x: f32| Parameter::Tensor(Tensor::from_floats([x, 1.0, 4.0], &device));
    let wall = Object::new(floor(1.0, -0.5, &device));
    let (dark, bright, left, right) = (texels(0.2), texels(0.8), eye(0.3), eye(0.4));
    let steps = [
        (&dark, &left, 1),
        (&dark, &left, 0),
        (&bright, &left, 1),
        (&bright, &left, 0),
        (&bright, &right, 1),
        (&bright, &right, 0),
    ];
    for (i, (texels, eye, wanted)) in steps.into_iter().enumerate() {
        let textured = wall
            .clone()
            .with_material(Material::diffuse(texels.clone()));
        bodies.scene = scene.clone().with_object(textured);
        bodies.camera.eye = eye.clone();
        let (found, work) = bodies.step(1e-6 * i as f32, &late).expect("an image");
        let (usual, _) = bodies.step(1e-6 * i as f32, &reading).expect("an image");
        assert_eq!(work.read_backs, wanted, "step {i}");
        assert_eq!(found[0], usual[0], "step {i}");
    }
}

/// A light that turns is found at once.
#[test]
fn a_light_that_turns_is_read() {
    if !alone(a_light_that_turns_is_read) {
        return;
    }
    let device = device();
    let mut bodies = Bodies::new(&device);
    let (late, reading) = (options(100), options(1));
    let scene = bodies.scene.clone();
    let tracked = |x: f32| Parameter::Tensor(leaf(&[x, -1.5, -1.0], &device));
    let constant = |x: f64| Parameter::Constant([x, -1.5, -1.0]);
    let lights = [
        (constant(0.0), 1),
        (constant(0.0), 0),
        (constant(0.1), 1),
        (constant(0.1), 0),
        (tracked(0.1), 1),
        (tracked(0.2), 1),
    ];
    for (i, (direction, wanted)) in lights.into_iter().enumerate() {
        bodies.scene = scene
            .clone()
            .with_light(Light::directional(direction, [1.0, 2.0, 3.0]));
        let (found, work) = bodies.step(0.0, &late).expect("an image");
        let (usual, _) = bodies.step(0.0, &reading).expect("an image");
        assert_eq!(work.read_backs, wanted, "step {i}");
        assert!(found == usual, "step {i}");
    }
}

/// The device places texture coordinates, vertex colors, constants, textures and normal maps, too.
#[test]
fn late_steps_of_materials() {
    if !alone(late_steps_of_materials) {
        return;
    }
    let bodies = Bodies::new(&device());
    let globe = shapes::sphere(12, 6, &device()).scaled([0.5; 3]);
    let globe = globe.translated([-1.2, 0.0, 0.0]);
    // Tangents that are not given are computed on the host.
    let tangents = Tensor::from_floats([[1.0, 0.0, 0.0, 1.0]], &device());
    let corners = vec![[0; 3]; globe.faces.len()];
    let globe = globe.with_tangents(tangents, corners);
    let (late, reading) = (options(3), options(1));
    let step = |i: u64, options: &RenderOptions| {
        let mut waves = Waves::new(i);
        let mut wave = |count, low, high| waves.next(count, low, high);
        let base = ColorTexture::texture(wave(4 * 3 * 3, 0.2, 0.9).reshape([4, 3, 3]));
        let metallic = wave(1, 0.3, 0.7);
        let roughness = ScalarTexture::texture(wave(5 * 2, 0.3, 0.7).reshape([5, 2]));
        let tilts = wave(2 * 2 * 3, 0.5, 1.0).reshape([2, 2, 3]);
        let mut globe = globe.clone();
        let uvs = globe.uvs.as_mut().expect("texture coordinates");
        let [count, _] = uvs.values.dims();
        uvs.values = uvs.values.clone() + wave(2 * count, 0.0, 0.05).reshape([count, 2]);
        let material = Material::metallic_roughness(base, metallic, roughness);
        let globe = Object::new(globe).with_material(material.with_normal_map(tilts, 1.0));
        let [count, _] = bodies.ball.vertices.dims();
        let colors = wave(3 * count, 0.3, 0.8).reshape([count, 3]);
        let ball = bodies
            .ball
            .clone()
            .with_colors(colors, bodies.ball.faces.clone());
        let ball = Object::new(ball).with_material(Material::diffuse(wave(3, 0.4, 0.9)));
        let scene = bodies.scene.clone().with_object(globe).with_object(ball);
        let options = options.clone().with_seed(7 + i);
        let before = work();
        let image = render(&scene, &bodies.camera, &options).expect("an image");
        let gradients = image.radiance.clone().powf_scalar(2.0).sum().backward();
        let during = work() - before;
        let by = waves.gradients(&gradients);
        ((values(&image.radiance), by), during)
    };
    for i in 0..6 {
        let ((image, by), work) = step(i, &late);
        let ((wanted, wanted_by), usual) = step(i, &reading);
        assert_eq!(image, wanted, "step {i}");
        for (k, (by, wanted)) in by.iter().zip(&wanted_by).enumerate() {
            assert!(wanted.iter().any(|d| *d != 0.0), "leaf {k}");
            assert_eq!(by, wanted, "step {i}, leaf {k}");
        }
        assert_eq!(usual.read_backs, 1);
        assert_eq!(work.read_backs, u64::from(i == 0), "step {i}: {work:?}");
    }
}
