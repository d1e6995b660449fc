//! Derivatives of every output at every kind of boundary, with respect to every kind of motion, against central
//! differences.

use burn::tensor::{Device, Tensor};
use softray::prelude::*;

use crate::common;
use crate::common::numbers::{mean_and_error, noise};
use crate::common::tensors::{gradient, leaf, values};

const SIZE: usize = 16;

/// What moves past what: a ball before the sky, an open sheet before the sky, the fold of a roof that fills the image, a
/// sheet that passes through a ball, a wall that another one hides in part, a cylinder, a torus that hides itself.
const BOUNDARIES: [&str; 7] = [
    "outline",
    "border",
    "crease",
    "crossing",
    "half hidden",
    "cylinder",
    "torus",
];

const MOTIONS: [&str; 5] = ["vertices", "pose", "velocity", "camera", "camera's turn"];

const OUTPUTS: [&str; 4] = ["radiance", "opacity", "depth", "normals"];

fn along(x: &Tensor<1>, direction: [f32; 3]) -> Tensor<1> {
    x.clone() * Tensor::from_floats(direction, &x.device().inner())
}

/// A sheet with corners in the order of its outline.
fn sheet(corners: [[f64; 3]; 4], device: &Device) -> Mesh {
    let [a, b, c, d] = corners;
    shapes::quad(a, b, c, d, device)
}

/// The body that moves, and one that stands still.
fn bodies(boundary: &str, d: &Device) -> (Mesh, Option<Mesh>) {
    let turned = |mesh: Mesh| mesh.rotated([0.3, 1.0, 0.2], 40.0);
    let tilted = |z: f64| {
        let corners = [
            [-0.5, -0.7, 0.1],
            [0.8, -0.5, -0.2],
            [0.6, 0.8, 0.2],
            [-0.7, 0.5, 0.0],
        ];
        sheet(corners.map(|[x, y, w]| [x, y, w + z]), d)
    };
    let ball = || shapes::icosphere(2, d).scaled(0.7);
    match boundary {
        "outline" => (ball(), None),
        "border" => (tilted(0.0), None),
        "crease" => {
            let roof = [
                [-6.0, -6.0, -3.0],
                [0.4, -6.0, 0.2],
                [-0.3, 6.0, 0.4],
                [-6.0, 6.0, -2.0],
                [6.0, -6.0, -2.0],
                [6.0, 6.0, -4.0],
            ];
            let faces = vec![[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]];
            (Mesh::from_host(&roof, faces, d), None)
        }
        "crossing" => (tilted(0.1), Some(turned(shapes::cube(d).scaled(0.55)))),
        "half hidden" => {
            let wall = sheet(
                [
                    [-9.0, -9.0, -1.2],
                    [9.0, -9.0, -0.8],
                    [9.0, 9.0, -1.0],
                    [-9.0, 9.0, -1.4],
                ],
                d,
            );
            (tilted(0.4), Some(wall))
        }
        "cylinder" => (turned(shapes::cylinder(0.5, 1.2, 12, d)), None),
        "torus" => (turned(shapes::torus(0.6, 0.25, 12, 8, d)), None),
        other => panic!("there is no boundary {other:?}"),
    }
}

/// A body past another one. A glossy one has smooth normals and lies before a matt floor that sees it.
fn scene(boundary: &str, motion: &str, glossy: bool, x: &Tensor<1>) -> (Scene, Camera) {
    let d = &x.device().inner();
    let (mut moving, still) = bodies(boundary, d);
    let mut camera = Camera::look_at([0.2, 0.4, 4.0], [0.05, 0.0, 0.0])
        .with_fov_y(33.0)
        .with_up([0.2, 1.0, 0.0]);
    let mut velocity = None;
    match motion {
        "vertices" => {
            let v = moving.vertices.clone();
            let field =
                v.clone() * 0.5 + Tensor::<1>::from_floats([0.6, 0.3, 0.5], d).unsqueeze_dim(0);
            moving = moving.with_vertices(v + field * x.clone().unsqueeze_dim(1));
        }
        "pose" => {
            let turn = Transform::new().with_axis_angle([0.2, 0.5, 1.0], x.clone() * 30.0);
            moving = moving
                .transformed(&turn)
                .translated(along(x, [0.7, 0.4, 0.5]));
        }
        "velocity" => {
            velocity = Some(along(&(x.clone() + 0.4), [0.7, 0.4, 0.5]));
        }
        "camera" => {
            camera.eye =
                (along(x, [1.0, 0.5, 0.4]) + Tensor::from_floats([0.2, 0.4, 4.0], d)).into()
        }
        "camera's turn" => {
            camera.target =
                (along(x, [0.4, 0.2, 0.0]) + Tensor::from_floats([0.05, 0.0, 0.0], d)).into()
        }
        other => panic!("there is no motion {other:?}"),
    }
    let colored = |mesh, color: [f64; 3]| Object::new(mesh).with_material(Material::diffuse(color));
    let mut object = colored(moving.clone(), [0.8, 0.5, 0.3]);
    if glossy {
        // Darker than the environment.
        let metal = Material::metallic_roughness([0.3, 0.2, 0.1], 1.0, 0.3);
        object = Object::new(moving.smooth_normals()).with_material(metal);
    }
    if let Some(velocity) = velocity {
        object = object.with_velocity(velocity);
    }
    // A roof has no shadows, and its faces differ by this light.
    let sun = Light::directional([-0.4, 0.1, -1.0], [1.2, 1.0, 0.8]);
    let scene = Scene::new()
        .with_environment([0.7, 0.8, 1.0])
        .with_object(object);
    let scene = if boundary == "crease" {
        scene.with_light(sun)
    } else {
        scene
    };
    let floor = glossy.then(|| shapes::plane_grid(5.0, 5.0, 1, 1, d).translated([0.0, -1.1, 0.0]));
    let still = still.into_iter().chain(floor);
    let still = still.map(|mesh| colored(mesh, [0.2, 0.4, 0.7]));
    (still.fold(scene, Scene::with_object), camera)
}

/// Weighted sums of the outputs.
fn losses(boundary: &str, motion: &str, glossy: bool, x: &Tensor<1>, seed: u64) -> [Tensor<1>; 4] {
    let device = &x.device().inner();
    let (scene, camera) = scene(boundary, motion, glossy, x);
    let options = RenderOptions::new(SIZE, SIZE)
        .with_samples(32)
        .with_bounces(u32::from(glossy))
        .with_depth()
        .with_normals()
        .with_seed(seed);
    let image = render(&scene, &camera, &options).expect("an image");
    let weight = |i: usize| {
        let [u, v] = [i % SIZE, i / SIZE].map(|k| k as f32 / SIZE as f32);
        0.2 + 1.2 * u + 0.7 * v * u
    };
    let weights: Vec<f32> = (0..SIZE * SIZE).map(weight).collect();
    let weights = Tensor::<1>::from_floats(weights.as_slice(), device).reshape([SIZE, SIZE]);
    let of_plane = |plane: Tensor<2>| (plane * weights.clone()).sum();
    let of_colors = |colors: Tensor<3>, factors: [f32; 3]| {
        let factors = Tensor::<1>::from_floats(factors, device).reshape([1, 1, 3]);
        of_plane((colors * factors).sum_dim(2).squeeze_dim(2))
    };
    [
        of_colors(image.radiance, [1.0, 0.8, 0.6]),
        of_plane(image.opacity.expect("opacity")),
        of_plane(image.depth.expect("depth")),
        of_colors(image.normals.expect("normals"), [0.7, -0.4, 1.0]),
    ]
}

#[test]
fn outputs_of_matt_bodies_agree_with_central_differences() {
    compare(&BOUNDARIES, false);
}

#[test]
fn radiance_of_glossy_bodies_agrees_with_central_differences() {
    compare(&["outline", "crossing", "half hidden", "torus"], true);
}

/// The difference over a wide step is the mean of the derivatives within it, which are taken at opposite points in pairs.
fn compare(boundaries: &[&str], glossy: bool) {
    let device = Device::flex();
    let (pairs, precision) = match (common::long(), glossy) {
        (true, false) => (64, 0.03),
        (true, true) => (256, 0.05),
        (false, false) => (8, 0.12),
        (false, true) => (12, 0.25),
    };
    let outputs = if glossy { 1 } else { OUTPUTS.len() };
    let step = 0.15;
    let mut failures = Vec::new();
    for (boundary, motion) in boundaries.iter().flat_map(|b| MOTIONS.map(|m| (*b, m))) {
        let values_at = |x: f64, seed| {
            let x = Tensor::from_floats([x as f32], &device);
            losses(boundary, motion, glossy, &x, seed).map(|loss| values(&loss)[0])
        };
        let by_output = |x: f64, seed| {
            std::array::from_fn::<f64, 4, _>(|k| {
                if k >= outputs {
                    return 0.0;
                }
                let x = leaf(&[x as f32], &device);
                let [loss] = [losses(boundary, motion, glossy, &x, seed)[k].clone()];
                if loss.is_tracked() {
                    gradient(&x, &loss.backward())[0]
                } else {
                    0.0
                }
            })
        };
        let points = noise(pairs, 7);
        let found: Vec<[[f64; 2]; 4]> = (0..pairs)
            .map(|pair| {
                let seeds = [2 * pair as u64, 2 * pair as u64 + 1];
                let ends = seeds.map(|seed| [step, -step].map(|x| values_at(x, seed)));
                let inside = [
                    by_output(step * points[pair], seeds[0]),
                    by_output(-step * points[pair], seeds[1]),
                ];
                std::array::from_fn(|k| {
                    let difference = ends.map(|[high, low]| (high[k] - low[k]) / (2.0 * step));
                    [
                        (inside[0][k] + inside[1][k]) / 2.0,
                        (difference[0] + difference[1]) / 2.0,
                    ]
                })
            })
            .collect();
        for (k, output) in OUTPUTS[..outputs].iter().enumerate() {
            let of = |f: &dyn Fn([f64; 2]) -> f64| {
                mean_and_error(&found.iter().map(|all| f(all[k])).collect::<Vec<_>>())
            };
            let ((by, _), (difference, _), (apart, error)) =
                (of(&|v| v[0]), of(&|v| v[1]), of(&|v| v[0] - v[1]));
            let size = by.abs().max(difference.abs());
            let name = format!(
                "{boundary}, {motion}, {output}: {by:.3}, difference {difference:.3}, apart {:.2} % ± {:.2} %",
                100.0 * apart / size,
                100.0 * error / size
            );
            println!("{name}");
            // Nothing depends on the number: the opacity of what fills the image.
            if size == 0.0 {
                continue;
            }
            if !(error <= precision * size && apart.abs() <= 4.0 * error + 0.005 * size) {
                failures.push(name);
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// Depth of surfaces: a quotient of means. Its derivative is biased by up to (1 − p) ÷ (samples · p) where surfaces cover a
/// share p of a pixel: 1 % at the floor.
#[test]
fn quotients_by_the_opacity_agree_with_central_differences() {
    let device = Device::flex();
    for motion in ["pose", "camera's turn"] {
        let loss = |x: &Tensor<1>, seed| {
            let (scene, camera) = scene("cylinder", motion, false, x);
            // Over wide pixels, all of which cross the floor gradually.
            let wide = Visibility::Cone {
                angle: 0.0,
                pixels: 3.0,
            };
            let options = RenderOptions::new(24, 24)
                .with_samples(256)
                .with_bounces(0)
                .with_visibility(wide)
                .with_depth()
                .with_seed(seed);
            let image = render(&scene, &camera, &options).expect("an image");
            let (depth, opacity) = (image.depth.expect("depth"), image.opacity.expect("opacity"));
            let of_surfaces = unpremultiply(depth, opacity, 0.3).expect("a quotient");
            let columns: Vec<f32> = (0..24).map(|i| 0.2 + i as f32 / 10.0).collect();
            let columns = Tensor::<1>::from_floats(columns.as_slice(), &device);
            (of_surfaces * columns.reshape([1, 24])).sum()
        };
        let step = 0.05;
        let pairs = noise(if common::long() { 64 } else { 12 }, 3)
            .into_iter()
            .enumerate()
            .map(|(pair, at)| {
                let of_seed = |at: f64, seed: u64| {
                    let x = leaf(&[(step * at) as f32], &device);
                    let by = gradient(&x, &loss(&x, seed).backward())[0];
                    let end =
                        |x: f64| values(&loss(&Tensor::from_floats([x as f32], &device), seed))[0];
                    [by, (end(step) - end(-step)) / (2.0 * step)]
                };
                let [a, b] = [
                    of_seed(at, 2 * pair as u64),
                    of_seed(-at, 2 * pair as u64 + 1),
                ];
                [a[0] + b[0], a[1] + b[1]].map(|sum| sum / 2.0)
            });
        let pairs: Vec<[f64; 2]> = pairs.collect();
        let (size, _) = mean_and_error(&pairs.iter().map(|pair| pair[1]).collect::<Vec<_>>());
        let (apart, error) = mean_and_error(
            &pairs
                .iter()
                .map(|pair| pair[0] - pair[1])
                .collect::<Vec<_>>(),
        );
        println!("{motion}: difference {size:.3}, apart {apart:.4} ± {error:.4}");
        assert!(error < 0.03 * size.abs(), "{motion}: {error} of {size}");
        assert!(
            apart.abs() < 4.0 * error + 0.01 * size.abs(),
            "{motion}: {apart} ± {error}"
        );
    }
}
