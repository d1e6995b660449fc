//! Gradients against central differences of renders of the same blurred scene.

use burn::tensor::{DType, Device, Tensor, TensorData};
use rayon::prelude::*;
use softray::prelude::*;

/// A scene that depends on one number.
pub struct Case {
    pub name: &'static str,
    pub value: f64,
    pub step: f64,
    pub bounces: u32,
    /// Scene and camera from the number, a tensor `[1]`.
    pub build: fn(&Device, DType, Tensor<1>) -> (Scene, Camera),
}

/// A mean with its standard error.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    pub mean: f64,
    pub error: f64,
}

const SIZE: usize = 12;

fn constant<const D: usize>(
    v: &[f64],
    shape: [usize; D],
    device: &Device,
    dtype: DType,
) -> Tensor<D> {
    Tensor::from_data(TensorData::new(v.to_vec(), shape), (device, dtype))
}

fn vector(p: Tensor<1>, direction: [f64; 3], device: &Device, dtype: DType) -> Tensor<1> {
    p * constant(&direction, [3], device, dtype)
}

fn offset(
    p: Tensor<1>,
    base: [f64; 3],
    direction: [f64; 3],
    device: &Device,
    dtype: DType,
) -> Tensor<1> {
    vector(p, direction, device, dtype) + constant(&base, [3], device, dtype)
}

/// A floor, a light, a ball and a free triangle, all with a part in the image.
fn objects(device: &Device, dtype: DType) -> [Object; 4] {
    let floor = shapes::quad(
        [-2.0, 0.0, 2.0],
        [2.0, 0.0, 2.0],
        [2.0, 0.0, -2.0],
        [-2.0, 0.0, -2.0],
        device,
    );
    let light = shapes::quad(
        [-0.7, 2.6, -0.7],
        [0.7, 2.6, -0.7],
        [0.7, 2.6, 0.7],
        [-0.7, 2.6, 0.7],
        device,
    );
    let half = constant(&[0.5], [1], device, dtype);
    let ball = shapes::icosahedron(device).cast(dtype).scaled(half);
    let ball = ball.translated(constant(&[0.3, 0.7, 0.1], [3], device, dtype));
    let triangle = shapes::triangle(
        [-1.2, 0.9, 0.3],
        [-0.3, 1.0, 0.6],
        [-0.6, 1.3, -0.5],
        device,
    );
    [
        Object::new(floor.cast(dtype))
            .named("floor")
            .material(Material::diffuse([0.6, 0.5, 0.4])),
        Object::new(light.cast(dtype))
            .named("light")
            .material(Material::emitter([5.0, 4.5, 4.0])),
        Object::new(ball)
            .named("ball")
            .material(Material::diffuse([0.3, 0.4, 0.7])),
        Object::new(triangle.cast(dtype))
            .named("triangle")
            .material(Material::diffuse([0.5, 0.6, 0.3])),
    ]
}

fn scene(objects: [Object; 4]) -> Scene {
    Scene {
        objects: objects.into(),
        ..Scene::new()
    }
    .environment([0.2, 0.25, 0.3])
}

fn camera() -> Camera {
    Camera::look_at([0.2, 1.7, 4.2], [0.0, 0.6, 0.0]).fov_y(38.0)
}

fn change(
    name: &'static str,
    f: impl Fn(Object) -> Object,
    device: &Device,
    dtype: DType,
) -> Scene {
    scene(objects(device, dtype)).map_object(name, f)
}

/// Every class of parameter that the paper differentiates.
pub fn cases() -> Vec<Case> {
    let case = |name, value, step, bounces, build| Case {
        name,
        value,
        step,
        bounces,
        build,
    };
    vec![
        case("vertex", 0.0, 0.02, 0, |d, t, p| {
            let s = change(
                "triangle",
                |o| {
                    let row = constant(&[1.0, 0.0, 0.0], [3, 1], d, t);
                    let shift = row * (vector(p.clone(), [0.6, 0.8, 0.3], d, t).reshape([1, 3]));
                    o.map_mesh(|m| {
                        let v = m.vertices.clone() + shift;
                        m.with_vertices(v)
                    })
                },
                d,
                t,
            );
            (s, camera())
        }),
        case("translation", 0.0, 0.02, 1, |d, t, p| {
            let s = change(
                "ball",
                |o| o.map_mesh(|m| m.translated(vector(p.clone(), [1.0, 0.3, 0.2], d, t))),
                d,
                t,
            );
            (s, camera())
        }),
        case("rotation", 0.1, 0.02, 0, |d, t, p| {
            let turn = Transform::new().axis_angle([0.3, 1.0, 0.2], p);
            (
                change("triangle", |o| o.map_mesh(|m| m.transformed(&turn)), d, t),
                camera(),
            )
        }),
        case("velocity", 0.8, 0.04, 0, |d, t, p| {
            let u = vector(p, [1.0, 0.5, 0.2], d, t);
            (change("ball", |o| o.velocity(u.clone()), d, t), camera())
        }),
        case("camera position", 0.0, 0.02, 0, |d, t, p| {
            let mut c = camera();
            c.eye = offset(p, [0.2, 1.7, 4.2], [1.0, 0.5, 0.3], d, t).into();
            (scene(objects(d, t)), c)
        }),
        case("field of view", 38.0, 0.4, 0, |d, t, p| {
            (scene(objects(d, t)), camera().fov_y(p))
        }),
        case("aperture", 0.25, 0.02, 0, |d, t, p| {
            (scene(objects(d, t)), camera().thin_lens(p, 3.0))
        }),
        case("focus distance", 3.0, 0.1, 0, |d, t, p| {
            (scene(objects(d, t)), camera().thin_lens(0.3, p))
        }),
        case("albedo", 0.5, 0.05, 2, |d, t, p| {
            let m = Material::diffuse(vector(p, [0.9, 0.6, 0.3], d, t));
            (change("floor", |o| o.material(m.clone()), d, t), camera())
        }),
        case("texel", 0.5, 0.05, 1, |d, t, p| {
            let base = constant(
                &[0.2, 0.3, 0.4, 0.5, 0.4, 0.3, 0.6, 0.6, 0.2, 0.3, 0.7, 0.5],
                [2, 2, 3],
                d,
                t,
            );
            let one = constant(
                &[0.0, 0.0, 0.0, 1.0, 0.5, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                [2, 2, 3],
                d,
                t,
            );
            let m = Material::diffuse(Albedo::texture(base + one * p.reshape([1, 1, 1])));
            (change("floor", |o| o.material(m.clone()), d, t), camera())
        }),
        case("specular", 0.4, 0.05, 1, |d, t, p| {
            let m =
                Material::diffuse([0.3, 0.3, 0.2]).specular(vector(p, [0.9, 1.0, 0.8], d, t), 12.0);
            (change("floor", |o| o.material(m.clone()), d, t), camera())
        }),
        case("shininess", 12.0, 1.0, 1, |d, t, p| {
            let m = Material::diffuse([0.3, 0.3, 0.2]).specular([0.5; 3], p);
            (change("floor", |o| o.material(m.clone()), d, t), camera())
        }),
        case("emission", 4.0, 0.2, 1, |d, t, p| {
            let m = Material::emitter(vector(p, [1.0, 0.9, 0.8], d, t));
            (change("light", |o| o.material(m.clone()), d, t), camera())
        }),
        case("light translation", 0.0, 0.03, 0, |d, t, p| {
            let s = change(
                "light",
                |o| o.map_mesh(|m| m.translated(vector(p.clone(), [0.6, 0.4, 0.5], d, t))),
                d,
                t,
            );
            (s, camera())
        }),
        case("environment", 0.3, 0.05, 1, |d, t, p| {
            (
                scene(objects(d, t)).environment(vector(p, [0.8, 0.9, 1.0], d, t)),
                camera(),
            )
        }),
    ]
}

/// Blur and samples of an estimate.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    pub sigma: f64,
    pub gamma: f64,
    pub samples: u32,
    pub seeds: u64,
}

/// Σ of the image under fixed smooth weights, so that no symmetry cancels.
fn objective(
    case: &Case,
    device: &Device,
    dtype: DType,
    p: Tensor<1>,
    effort: Effort,
    seed: u64,
) -> Tensor<1> {
    let (scene, camera) = (case.build)(device, dtype, p);
    let options = RenderOptions::new(SIZE, SIZE)
        .samples(effort.samples)
        .bounces(case.bounces)
        .blur(effort.sigma, effort.gamma)
        .bounds(Bounds {
            center: [0.0, 0.8, 0.0],
            radius: 3.2,
        })
        .seed(seed);
    let image = render(&scene, &camera, &options)
        .expect("an image")
        .radiance;
    let weights: Vec<f64> = (0..SIZE * SIZE * 3)
        .map(|i| {
            let (y, x, c) = (i / 3 / SIZE, i / 3 % SIZE, i % 3);
            0.3 + 0.12 * x as f64 + 0.05 * y as f64 + 0.2 * c as f64
        })
        .collect();
    (image * constant(&weights, [SIZE, SIZE, 3], device, dtype)).sum()
}

fn number(t: Tensor<1>) -> f64 {
    t.inner().into_scalar::<f64>()
}

fn estimate(values: Vec<f64>) -> Estimate {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    Estimate {
        mean,
        error: (variance / n).sqrt(),
    }
}

/// The autodiff gradient, over independent seeds.
pub fn gradient(case: &Case, device: &Device, dtype: DType, effort: Effort) -> Estimate {
    estimate(
        (0..effort.seeds)
            .into_par_iter()
            .map(|seed| {
                let p = constant(&[case.value], [1], device, dtype)
                    .autodiff()
                    .require_grad();
                let gradients =
                    objective(case, device, dtype, p.clone(), effort, 1000 + seed).backward();
                number(p.grad(&gradients).expect("a gradient"))
            })
            .collect(),
    )
}

/// Central differences with common random numbers, over independent seeds.
pub fn difference(case: &Case, device: &Device, dtype: DType, effort: Effort) -> Estimate {
    estimate(
        (0..effort.seeds)
            .into_par_iter()
            .map(|seed| {
                let at = |v: f64| {
                    number(objective(
                        case,
                        device,
                        dtype,
                        constant(&[v], [1], device, dtype),
                        effort,
                        900_000 + seed,
                    ))
                };
                (at(case.value + case.step) - at(case.value - case.step)) / (2.0 * case.step)
            })
            .collect(),
    )
}

/// Compares both and prints a line; returns (gradient, difference).
pub fn compare(
    case: &Case,
    device: &Device,
    dtype: DType,
    gradient_effort: Effort,
    difference_effort: Effort,
) -> (Estimate, Estimate) {
    let g = gradient(case, device, dtype, gradient_effort);
    let d = difference(case, device, dtype, difference_effort);
    println!(
        "{:18} gradient {:10.4} ± {:.4}   difference {:10.4} ± {:.4}   ({:+.2} %, {:.1} standard errors)",
        case.name,
        g.mean,
        g.error,
        d.mean,
        d.error,
        100.0 * (g.mean / d.mean - 1.0),
        (g.mean - d.mean).abs() / g.error.hypot(d.error)
    );
    (g, d)
}
