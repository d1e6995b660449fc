//! Gradients against central differences of renders of the same blurred scene.

mod cameras;
mod detail;
pub mod lights;

use burn::tensor::{DType, Device, Tensor};
use softray::gradcheck::{Checked, GradCheck, Row, gradcheck};
use softray::prelude::*;

use super::scenes::{diffuse, emitting, facing_down, facing_front, floor};
use super::tensors::{gradient, tensor as constant};

/// A scene that depends on one number.
pub struct Case {
    pub name: &'static str,
    pub value: f64,
    pub step: f64,
    pub bounces: u32,
    /// Weight of the objective at a point of the image, both coordinates from −1 to 1.
    pub weight: fn(f64, f64) -> f64,
    /// Scene and camera from the number, a tensor `[1]`.
    pub build: fn(&Device, DType, Tensor<1>) -> (Scene, Camera),
    /// By what share of the derivative two programs in f32 may differ since a sample sees another surface by rounding.
    pub flips: f64,
    /// The standard error of the derivative, over it, at which the long tier compares.
    pub precision: f64,
}

const SIZE: usize = 12;

pub fn vector(p: Tensor<1>, direction: [f64; 3], device: &Device, dtype: DType) -> Tensor<1> {
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

/// A floor and a light above it.
pub fn floor_and_light(device: &Device) -> [Mesh; 2] {
    let floor = floor(2.0, 0.0, device);
    let light = facing_down([-0.7, 0.7], [-0.7, 0.7], 2.6, device);
    [floor, light]
}

/// A floor, a light, a ball and a free triangle, all with a part in the image.
pub fn objects(device: &Device, dtype: DType) -> [Object; 4] {
    let [floor, light] = floor_and_light(device);
    let half = constant(&[0.5], [1], device, dtype);
    let ball = shapes::icosahedron(device).cast(dtype).scaled(half);
    let ball = ball.translated(constant(&[0.3, 0.95, 0.1], [3], device, dtype));
    let triangle = shapes::triangle(
        [-1.3, 0.8, 0.3],
        [-0.4, 0.9, 0.6],
        [-0.7, 1.5, -0.3],
        device,
    );
    [
        diffuse(floor.cast(dtype), [0.35, 0.3, 0.25]).with_name("floor"),
        emitting(light.cast(dtype), [3.0, 2.7, 2.4]).with_name("light"),
        diffuse(ball, [0.1, 0.2, 0.3]).with_name("ball"),
        diffuse(triangle.cast(dtype), [0.2, 0.25, 0.1]).with_name("triangle"),
    ]
}

pub fn scene(objects: [Object; 4]) -> Scene {
    let scene = Scene::new().with_environment([0.9, 1.0, 1.1]);
    objects.into_iter().fold(scene, Scene::with_object)
}

/// The scene with a small lamp before the camera, whose image moves and blurs with it.
fn with_lamp(device: &Device, dtype: DType) -> Scene {
    let lamp = facing_front([-0.47, -0.23], [1.23, 1.47], 1.5, device);
    let lamp = emitting(lamp.cast(dtype), [6.0, 5.0, 4.0]).with_name("lamp");
    scene(objects(device, dtype)).with_object(lamp)
}

pub fn camera() -> Camera {
    Camera::look_at([0.2, 1.3, 4.2], [0.0, 0.9, 0.0]).with_fov_y(38.0)
}

pub fn change(
    name: &'static str,
    f: impl Fn(Object) -> Object,
    device: &Device,
    dtype: DType,
) -> Scene {
    scene(objects(device, dtype))
        .map_object(name, f)
        .expect("the object")
}

/// A case whose weights rise over the image.
pub fn case(
    name: &'static str,
    value: f64,
    step: f64,
    bounces: u32,
    build: fn(&Device, DType, Tensor<1>) -> (Scene, Camera),
) -> Case {
    Case {
        name,
        value,
        step,
        bounces,
        build,
        weight: |x, y| 0.8 + 0.6 * x + 0.3 * y,
        flips: 0.0,
        precision: 0.015,
    }
}

/// With weights that bring out a shift.
pub fn shift(case: Case) -> Case {
    Case {
        weight: |x, _| 2.0 * x,
        ..case
    }
}

/// Every class of parameter that the paper differentiates, and those of surfaces in detail.
pub fn cases() -> Vec<Case> {
    let all = classes().into_iter().chain(cameras::cases());
    all.chain(detail::cases()).collect()
}

/// Those of surfaces and an environment.
#[expect(clippy::too_many_lines, reason = "a list of scenes")]
fn classes() -> Vec<Case> {
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
        case("translation", 0.0, 0.012, 1, |d, t, p| {
            let s = change(
                "ball",
                |o| o.map_mesh(|m| m.translated(vector(p.clone(), [1.0, 0.3, 0.2], d, t))),
                d,
                t,
            );
            (s, camera())
        }),
        case("rotation", 0.1, 0.02, 0, |d, t, p| {
            let turn = Transform::new().with_axis_angle([0.3, 1.0, 0.2], p * 1f64.to_degrees());
            let turned = |o: Object| o.map_mesh(|m| m.transformed(&turn));
            (change("triangle", turned, d, t), camera())
        }),
        shift(case("velocity", 0.5, 0.025, 0, |d, t, p| {
            let u = vector(p, [1.0, 0.3, 0.2], d, t);
            (
                change("ball", |o| o.with_velocity(u.clone()), d, t),
                camera(),
            )
        })),
        // The line in which it passes through the floor moves while the shutter is open. Kernels of GPUs find it in f32,
        // and one of a thousand samples on the film may see another pixel than on the host.
        Case {
            flips: 2e-3,
            ..case("flying through the floor", 0.0, 0.03, 0, |d, t, p| {
                let by = vector(p, [0.4, 1.0, 0.2], d, t) + constant(&[0.0, -0.8, 0.4], [3], d, t);
                let flies = |o: Object| {
                    let o = o.map_mesh(|m| m.translated(by.clone()));
                    o.with_velocity([0.3, 0.2, 0.1])
                };
                (change("ball", flies, d, t), camera())
            })
        },
        case("albedo", 0.5, 0.05, 2, |d, t, p| {
            let m = Material::diffuse(vector(p, [0.9, 0.6, 0.3], d, t));
            (
                change("floor", |o| o.with_material(m.clone()), d, t),
                camera(),
            )
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
            let m = Material::diffuse(ColorTexture::texture(base + one * p.reshape([1, 1, 1])));
            (
                change("floor", |o| o.with_material(m.clone()), d, t),
                camera(),
            )
        }),
        case("specular", 0.4, 0.05, 1, |d, t, p| {
            let m = Material::phong([0.3, 0.3, 0.2], vector(p, [0.9, 1.0, 0.8], d, t), 12.0);
            (
                change("floor", |o| o.with_material(m.clone()), d, t),
                camera(),
            )
        }),
        case("shininess", 12.0, 0.4, 1, |d, t, p| {
            let m = Material::phong([0.3, 0.3, 0.2], [0.5; 3], p);
            (
                change("floor", |o| o.with_material(m.clone()), d, t).with_environment([0.0; 3]),
                camera(),
            )
        }),
        case("smooth normals", 0.0, 0.03, 1, |d, t, p| {
            let rows = constant(&[0.8, -0.5, 0.3, 0.1].repeat(3), [12, 1], d, t);
            let s = change(
                "ball",
                |o| {
                    o.map_mesh(|m| {
                        let shift =
                            rows.clone() * vector(p.clone(), [0.4, 0.7, 0.5], d, t).reshape([1, 3]);
                        let v = m.vertices.clone() + shift;
                        m.with_vertices(v).smooth_normals()
                    })
                },
                d,
                t,
            );
            (s, camera())
        }),
        case("emission", 4.0, 0.2, 1, |d, t, p| {
            let m = Material::emitter(vector(p, [1.0, 0.9, 0.8], d, t));
            (
                change("light", |o| o.with_material(m.clone()), d, t),
                camera(),
            )
        }),
        case("light translation", 0.0, 0.01, 0, |d, t, p| {
            let s = change(
                "light",
                |o| o.map_mesh(|m| m.translated(vector(p.clone(), [0.3, -0.8, 0.4], d, t))),
                d,
                t,
            );
            (s.with_environment([0.0; 3]), camera())
        }),
        case("environment", 0.3, 0.05, 1, |d, t, p| {
            (
                scene(objects(d, t)).with_environment(vector(p, [0.8, 0.9, 1.0], d, t)),
                camera(),
            )
        }),
    ]
}

/// Blur and samples of a render.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    pub visibility: Visibility,
    pub samples: u32,
}

/// The swelling √(σ·Δz/γ) stays well under the distances between objects: where it reaches the
/// plane's origin a surface stops to count, a jump that no gradient sees.
pub const SOFTMAX: Effort = Effort {
    visibility: Visibility::softmax(5e-3, 0.2),
    samples: 16,
};

/// Cones without an angle or a pixel filter.
pub const SHARP: Visibility = Visibility::Cone {
    angle: 0.0,
    pixels: 0.0,
};

/// Cones that blur by about a pixel.
pub const CONES: Effort = Effort {
    visibility: Visibility::Cone {
        angle: 2.865,
        pixels: 0.5,
    },
    samples: 64,
};

fn options(case: &Case, effort: Effort) -> RenderOptions {
    // A sphere of radius 3.2 goes through the corners.
    let half = 3.2 / 3f64.sqrt();
    let bounds = Bounds {
        min: [-half, 0.8 - half, -half],
        max: [half, 0.8 + half, half],
    };
    let visibility = match effort.visibility {
        Visibility::Softmax(softmax) => softmax.with_bounds(bounds).into(),
        cone => cone,
    };
    RenderOptions::new(SIZE, SIZE)
        .with_samples(effort.samples)
        .with_bounces(case.bounces)
        .with_visibility(visibility)
}

/// Σ of the image under fixed smooth weights.
fn weighted(image: Tensor<3>, weight: fn(f64, f64) -> f64) -> Tensor<1> {
    let center = |i: usize| (2 * i + 1) as f64 / SIZE as f64 - 1.0;
    let weights: Vec<f64> = (0..SIZE * SIZE * 3)
        .map(|i| {
            let (y, x, c) = (i / 3 / SIZE, i / 3 % SIZE, i % 3);
            weight(center(x), -center(y)) * (1.0 + 0.2 * c as f64)
        })
        .collect();
    let (device, dtype) = (image.device().inner(), image.dtype());
    (image * constant(&weights, [SIZE, SIZE, 3], &device, dtype)).sum()
}

/// The check of one case by the library's own `gradcheck`; prints its row.
pub fn check(case: &Case, device: &Device, effort: Effort, precision: f64, seeds: [u64; 2]) -> Row {
    let start = std::time::Instant::now();
    let weight = case.weight;
    let settings = GradCheck::new(options(case, effort), device)
        .with_precision(precision)
        .with_seeds(seeds[0], seeds[1])
        .with_objective(move |image| weighted(image, weight));
    let parameters = [Checked::new(case.name, [case.value], case.step)];
    let report = gradcheck(&parameters, &settings, |point| {
        let p = point.get(case.name)?;
        Ok((case.build)(&point.device, point.dtype, p))
    })
    .expect("a report");
    let row = report.rows[0].clone();
    let table = report.to_string();
    let line = table.lines().nth(1).unwrap_or_default();
    println!("{line} ({:.0} s)", start.elapsed().as_secs_f64());
    row
}

/// The autodiff gradient of one seed.
pub fn of_seed(case: &Case, at: Setup, dtype: DType, effort: Effort, seed: u64) -> f64 {
    let (device, change) = at;
    let p = constant(&[case.value], [1], device, dtype)
        .autodiff()
        .require_grad();
    let (scene, camera) = (case.build)(device, dtype, p.clone());
    let options = change(options(case, effort).with_seed(seed));
    let image = render(&scene, &camera, &options).expect("an image");
    let gradients = weighted(image.radiance, case.weight).backward();
    gradient(&p, &gradients)[0]
}

/// A device, and what else is set.
pub type Setup<'a> = (&'a Device, fn(RenderOptions) -> RenderOptions);

/// Every class of parameter, and lights without a surface.
pub fn all_classes() -> Vec<Case> {
    let lights = lights::still().into_iter().chain(lights::moving());
    cases().into_iter().chain(lights).collect()
}

/// That the gradients of one seed are the same in two setups, but for a share of the larger under a limit.
///
/// # Panics
/// With the cases that are further apart, or have no gradient.
#[track_caller]
pub fn assert_agreement(
    cases: &[Case],
    setups: [Setup; 2],
    dtype: DType,
    effort: Effort,
    limit: impl Fn(&Case) -> f64,
) {
    let apart = |case: &Case| {
        let [x, y] = setups.map(|e| of_seed(case, e, dtype, effort, 5));
        // NaN where both are 0.
        (x - y).abs() / x.abs().max(y.abs())
    };
    let found: Vec<_> = cases.iter().map(|c| (c, apart(c))).collect();
    let show = |all: &[&(&Case, f64)]| -> Vec<String> {
        let each = all.iter();
        each.map(|(case, apart)| format!("{}: {apart:.1e}", case.name))
            .collect()
    };
    println!("{}", show(&found.iter().collect::<Vec<_>>()).join(", "));
    let close = |(case, apart): &(&Case, f64)| *apart < limit(case);
    let far: Vec<_> = found.iter().filter(|f| !close(f)).collect();
    assert!(!found.is_empty() && far.is_empty(), "{:?}", show(&far));
}
