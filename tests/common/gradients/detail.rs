//! Cases of colors at corners and of normal maps.

use burn::tensor::{DType, Device, Tensor};
use softray::prelude::*;

use super::{Case, camera, case, change, constant, shift};
use crate::common::materials::base;

/// The scene with colors at the corners of the floor and the ball; those of one corner and vertex are a number.
fn colored(p: Tensor<1>, device: &Device, dtype: DType) -> Scene {
    let colors = |m: Mesh, rows: usize| {
        let base = (0..3 * rows).map(|i| 0.3 + 0.1 * (i % 5) as f64);
        let base = constant(&base.collect::<Vec<_>>(), [rows, 3], device, dtype);
        let one: Vec<f64> = (0..3 * rows)
            .map(|i| if i < 6 { 0.5 + 0.1 * i as f64 } else { 0.0 })
            .collect();
        let one = constant(&one, [rows, 3], device, dtype);
        let faces = m.faces.clone();
        m.with_colors(base + one * p.clone().reshape([1, 1]), faces)
    };
    change("floor", |o| o.map_mesh(|m| colors(m, 4)), device, dtype)
        .map_object("ball", |o| o.map_mesh(|m| colors(m, 12)))
        .expect("a ball")
}

/// Texels of a normal map `[2, 2, 3]`, none of unit length.
fn normals_of_map(device: &Device, dtype: DType) -> Tensor<3> {
    let texels = [
        0.3, 0.1, 1.1, -0.2, 0.3, 0.9, 0.1, -0.4, 1.0, -0.3, -0.2, 0.8,
    ];
    constant(&texels, [2, 2, 3], device, dtype)
}

/// The scene with a normal map on the floor, whose mesh is changed.
fn bumpy(texels: Tensor<3>, f: impl Fn(Mesh) -> Mesh, device: &Device, dtype: DType) -> Scene {
    let with_map = |o: Object| {
        let material = o.materials[0].clone().with_normal_map(texels.clone(), 1.0);
        o.map_mesh(&f).with_material(material)
    };
    change("floor", with_map, device, dtype)
}

/// The scene with a gloss on the floor, in the light of the lamp.
fn shiny(scene: Scene) -> Scene {
    let gloss = |mut o: Object| {
        let matt = base(&o.materials[0]).clone();
        o.materials[0].bsdf = Material::phong(matt, [0.4; 3], 8.0).bsdf;
        o
    };
    let scene = scene.map_object("floor", gloss).expect("a floor");
    scene.with_environment([0.1; 3])
}

/// Numbers of colors, and of what normal maps are made of.
pub fn cases() -> Vec<Case> {
    vec![
        case("vertex color", 0.5, 0.05, 1, |d, t, p| {
            (colored(p, d, t), camera())
        }),
        shift(case("normal map", 0.3, 0.03, 1, |d, t, p| {
            let one = constant(&[1.0, 0.2, 0.0, 0.8, 0.3, -0.2].repeat(2), [2, 2, 3], d, t);
            let texels = normals_of_map(d, t) + one * p.reshape([1, 1, 1]);
            // White, in the light of the lamp alone.
            let white = |mut o: Object| {
                o.materials[0].bsdf = Material::diffuse([0.9; 3]).bsdf;
                o
            };
            let scene = bumpy(texels, |m| m, d, t).map_object("floor", white);
            (scene.expect("a floor").with_environment([0.0; 3]), camera())
        })),
        case("glossy normal map", 0.3, 0.03, 0, |d, t, p| {
            let one = constant(&[0.0, 0.0, 0.0, 1.0, -0.6, 0.3].repeat(2), [2, 2, 3], d, t);
            let texels = normals_of_map(d, t) + one * p.reshape([1, 1, 1]);
            (shiny(bumpy(texels, |m| m, d, t)), camera())
        }),
        case("uvs of a normal map", 0.0, 0.01, 0, |d, t, p| {
            let stretch = constant(&[0.0, 0.0, 0.4, 0.0, 0.4, 0.5, 0.0, 0.5], [4, 2], d, t);
            let stretched = move |mut m: Mesh| {
                if let Some(uvs) = &mut m.uvs {
                    uvs.values = uvs.values.clone() + stretch.clone() * p.clone().reshape([1, 1]);
                }
                m
            };
            (
                shiny(bumpy(normals_of_map(d, t), stretched, d, t)),
                camera(),
            )
        }),
        case("turn under a normal map", 0.2, 0.03, 1, |d, t, p| {
            let turn = Transform::new().with_axis_angle([0.1, 1.0, 0.2], p * 1f64.to_degrees());
            let map = normals_of_map(d, t);
            (bumpy(map, |m| m.transformed(&turn), d, t), camera())
        }),
    ]
}
