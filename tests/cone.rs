//! Cones: gradients of edges against differences of the same renders.
mod common;
use burn::tensor::Device;
use common::gradients::{Effort, LAYERED, cases, check};
use softray::prelude::*;

#[test]
fn classes() {
    let angle: f64 = std::env::var("ANGLE")
        .ok()
        .and_then(|a| a.parse().ok())
        .unwrap_or(0.0);
    let only = std::env::var("CASE").unwrap_or_default();
    let n: u64 = std::env::var("SEEDS")
        .ok()
        .and_then(|a| a.parse().ok())
        .unwrap_or(200);
    let effort = Effort {
        visibility: Visibility::Cone {
            angle,
            pixels: std::env::var("PX")
                .ok()
                .and_then(|a| a.parse().ok())
                .unwrap_or(0.5),
        },
        samples: 256,
        ..LAYERED
    };
    for case in cases() {
        if case.name.contains(&only) {
            check(&case, &Device::flex(), effort, 0.003, [32, n]);
        }
    }
}

#[test]
fn extra() {
    use softray::gradcheck::{Checked, GradCheck, gradcheck};
    let angle: f64 = std::env::var("ANGLE")
        .ok()
        .and_then(|a| a.parse().ok())
        .unwrap_or(0.0);
    let n: u64 = std::env::var("SEEDS")
        .ok()
        .and_then(|a| a.parse().ok())
        .unwrap_or(100);
    let only = std::env::var("CASE").unwrap_or_default();
    for with in [
        "cross",
        "self",
        "gloss",
        "map",
        "mapgloss",
        "seam",
        "lensmove",
        "smooth",
        "wall",
        "crossmove",
        "mirror",
    ] {
        if !with.contains(&only) {
            continue;
        }
        let visibility = Visibility::Cone { angle, pixels: 0.5 };
        let options = RenderOptions::new(16, 16)
            .samples(256)
            .bounces(1)
            .visibility(visibility);
        let settings = GradCheck::new(options, &Device::flex())
            .precision(0.003)
            .tolerance(0.01)
            .seeds(16, n);
        let parameters = [
            Checked::new("x", [0.0], 0.02),
            Checked::new("y", [0.0], 0.02),
            Checked::new("turn", [0.2], 0.02),
        ];
        let report = gradcheck(&parameters, &settings, |point| {
            let d = &point.device;
            let f = |v: &[f64]| Tensor::<1>::from_data(v, (d, point.dtype));
            let y = point.get("y")?;
            let x = point.get("x")?;
            let turn = Transform::new().axis_angle([0.3, 1.0, 0.2], point.get("turn")?);
            let offset = Tensor::cat(vec![x.clone(), y.clone() + 0.7, x * 0.3], 0);
            let floor = shapes::quad(
                [-2.0, 0.0, 2.0],
                [2.0, 0.0, 2.0],
                [2.0, 0.0, -2.0],
                [-2.0, 0.0, -2.0],
                d,
            )
            .cast(point.dtype);
            let light = shapes::quad(
                [-0.7, 2.6, -0.7],
                [0.7, 2.6, -0.7],
                [0.7, 2.6, 0.7],
                [-0.7, 2.6, 0.7],
                d,
            )
            .cast(point.dtype);
            let mut floor = Object::new(floor);
            if with == "mirror" {
                floor = floor.material(Material::diffuse([0.1; 3]).specular([0.8; 3], 200.0));
            }
            let mut scene = Scene::new()
                .with(floor)
                .with(Object::new(light).material(Material::emitter([3.0; 3])));
            let ball = |n| {
                shapes::icosphere(n, d)
                    .cast(point.dtype)
                    .scaled(f(&[0.5]))
                    .transformed(&turn)
                    .translated(offset.clone())
            };
            let quad = |m: Material| {
                let q = shapes::quad(
                    [-0.6, -0.5, 0.0],
                    [0.6, -0.5, 0.0],
                    [0.6, 0.5, 0.0],
                    [-0.6, 0.5, 0.0],
                    d,
                )
                .cast(point.dtype);
                Object::new(q.transformed(&turn).translated(offset.clone())).material(m)
            };
            let fixed = |m: Material| {
                let q = shapes::quad(
                    [0.1, 0.1, -0.6],
                    [0.1, 0.1, 0.6],
                    [-0.3, 1.3, 0.6],
                    [-0.3, 1.3, -0.6],
                    d,
                )
                .cast(point.dtype);
                Object::new(q).material(m)
            };
            let texels = Tensor::<1>::from_data(
                [
                    0.8f64, 0.1, 0.1, 0.1, 0.8, 0.1, 0.1, 0.1, 0.8, 0.7, 0.7, 0.2,
                ]
                .as_slice(),
                (d, point.dtype),
            )
            .reshape([2, 2, 3]);
            let map = || {
                let v: Vec<f64> = (0..8 * 16 * 3)
                    .map(|i| {
                        0.3 + ((i * 37) % 11) as f64 * 0.1 + if i / 3 == 35 { 30.0 } else { 0.0 }
                    })
                    .collect();
                Tensor::<1>::from_data(v.as_slice(), (d, point.dtype)).reshape([8, 16, 3])
            };
            match with {
                "cross" => {
                    scene = scene
                        .with(quad(Material::diffuse([0.8, 0.2, 0.2])))
                        .with(fixed(Material::diffuse([0.2, 0.8, 0.2])))
                }
                "crossmove" => {
                    scene = scene
                        .with(quad(Material::diffuse([0.8, 0.2, 0.2])).velocity([0.3, 0.1, 0.0]))
                        .with(fixed(Material::diffuse([0.2, 0.8, 0.2])))
                }
                "self" => {
                    scene = scene
                        .with(Object::new(ball(1)))
                        .with(fixed(Material::diffuse([0.2, 0.8, 0.2])))
                }
                "gloss" => {
                    scene = scene.with(
                        Object::new(ball(1))
                            .material(Material::diffuse([0.2, 0.3, 0.4]).specular([0.5; 3], 30.0)),
                    )
                }
                "mirror" => {
                    scene = scene
                        .with(Object::new(ball(1)).material(Material::diffuse([0.2, 0.3, 0.4])))
                }
                "map" => {
                    scene = Scene {
                        objects: vec![scene.objects[0].clone(), Object::new(ball(1))],
                        environment: Environment::map(map()),
                    }
                }
                "mapgloss" => {
                    scene = Scene {
                        objects: vec![
                            scene.objects[0].clone(),
                            Object::new(ball(1)).material(
                                Material::diffuse([0.2, 0.3, 0.4]).specular([0.5; 3], 30.0),
                            ),
                        ],
                        environment: Environment::map(map()),
                    }
                }
                "seam" => {
                    let a = Material::diffuse(Albedo::texture(texels.clone()));
                    let mut o = quad(a.clone());
                    o.materials.push(Material::diffuse([0.1, 0.6, 0.9]));
                    o.face_materials = std::sync::Arc::new(vec![0, 1]);
                    scene = scene.with(o);
                }
                "lensmove" => scene = scene.with(Object::new(ball(1)).velocity([0.4, 0.2, 0.1])),
                "smooth" => {
                    let b = shapes::icosphere(1, d).cast(point.dtype);
                    let n = b.vertices.clone();
                    let b = b
                        .with_normals(n)
                        .scaled(f(&[0.5]))
                        .transformed(&turn)
                        .translated(offset.clone());
                    scene = scene.with(Object::new(b));
                }
                "wall" => {
                    let wall = shapes::quad(
                        [-2.0, 0.0, -0.9],
                        [2.0, 0.0, -0.9],
                        [2.0, 2.5, -0.9],
                        [-2.0, 2.5, -0.9],
                        d,
                    )
                    .cast(point.dtype);
                    let y = point.get("y")?;
                    let x = point.get("x")?;
                    let lamp = shapes::quad(
                        [0.2, 0.8, -0.9],
                        [0.2, 0.8, -0.4],
                        [0.8, 0.8, -0.4],
                        [0.8, 0.8, -0.9],
                        d,
                    )
                    .cast(point.dtype);
                    let lamp = lamp.translated(Tensor::cat(vec![x, y.clone(), y * 0.0], 0));
                    scene = Scene::new()
                        .with(scene.objects[0].clone())
                        .with(Object::new(wall))
                        .with(Object::new(lamp).material(Material::emitter([5.0; 3])));
                }
                _ => {}
            }
            let mut cam = Camera::look_at([0.2, 1.3, 4.2], [0.0, 0.6, 0.0]).fov_y(30.0);
            if with == "lensmove" {
                cam = cam.thin_lens(0.2, 3.0);
            }
            Ok((scene, cam))
        });
        match report {
            Ok(r) => println!("{with}\n{r}"),
            Err(e) => println!("{with} {e}"),
        }
    }
}
