//! Lights without a surface: what they bring in closed form, and the derivative of an edge of a shadow; emissive textures.

use std::f64::consts::PI;

use crate::common;
use crate::common::errors::{message, says};
use crate::common::numbers::{mean, mean_and_error, rmse};
use crate::common::scenes::{diffuse, emitting, facing_down, floor};
use crate::common::tensors::{gradient, leaf, radiance};
use burn::tensor::Device;
use glam::DVec3;
use softray::prelude::*;

const ALBEDO: f64 = 0.6;

/// A floor seen from straight above, under whatever hides its light: a window of one unit about the origin.
fn from_above() -> Camera {
    Camera::look_at([0.0, 0.5, 0.0], [0.0; 3])
        .with_up([0.0, 0.0, -1.0])
        .with_orthographic(1.0)
}

fn lit_floor(light: Light, device: &Device) -> Scene {
    Scene::new()
        .with_object(diffuse(floor(4.0, 0.0, device), [ALBEDO; 3]))
        .with_light(light)
}

/// Pixel by pixel, for the engine of kernels and that of tensors, with and without cones.
fn brings(light: Light, irradiance: impl Fn(DVec3) -> f64) {
    let device = Device::flex();
    let size = 16;
    for (engine, visibility) in [
        (Engine::Kernels, Visibility::cone(0.0)),
        (Engine::Kernels, Visibility::cone(2.865)),
        (Engine::Tensors, Visibility::cone(2.865)),
        (Engine::Auto, Visibility::softmax(1e-4, 1e-3)),
    ] {
        let options = RenderOptions::new(size, size)
            .with_samples(64)
            .with_bounces(0)
            .with_visibility(visibility)
            .with_engine(engine);
        let found = radiance(&lit_floor(light.clone(), &device), &from_above(), &options);
        for (i, pixel) in found.chunks_exact(3).enumerate() {
            let at =
                |i: usize, sub: usize| (i as f64 + (sub as f64 + 0.5) / 4.0) / size as f64 - 0.5;
            // The mean over the pixel.
            let of_part =
                |k: usize| irradiance(DVec3::new(at(i % size, k % 4), 0.0, at(i / size, k / 4)));
            let wanted = ALBEDO / PI * mean(&(0..16).map(of_part).collect::<Vec<_>>());
            let error = (pixel[1] - wanted).abs();
            assert!(error < 0.01 * wanted + 1e-3, "{i}: {pixel:?} {wanted}");
        }
    }
}

#[test]
fn a_point_brings_its_intensity_over_the_square_of_the_distance() {
    let place = DVec3::new(0.3, 1.2, -0.2);
    brings(Light::point(place, [2.0; 3]), |x| {
        let to = place - x;
        2.0 * to.y / to.length().powi(3)
    });
}

#[test]
fn a_spot_falls_off_between_its_angles() {
    let (place, axis) = (DVec3::new(0.1, 1.0, -0.1), DVec3::new(0.1, -2.0, 0.2));
    let (inner, outer) = (0.15f64, 0.5f64);
    brings(
        Light::spot(
            place,
            axis,
            [2.0; 3],
            inner.to_degrees(),
            outer.to_degrees(),
        ),
        |x| {
            let to = place - x;
            let cosine = -to.normalize().dot(axis.normalize());
            let within = (cosine - outer.cos()) / (inner.cos() - outer.cos());
            2.0 * to.y / to.length().powi(3) * within.clamp(0.0, 1.0).powi(2)
        },
    );
}

#[test]
fn a_directional_light_brings_its_irradiance_times_the_cosine() {
    let towards = DVec3::new(0.6, -1.0, 0.3);
    brings(Light::directional(towards, [1.5; 3]), |_| {
        -1.5 * towards.normalize().y
    });
}

/// A plate hides the light of a point on one side of an edge. Where the plate's edge is at x = e, half as high as the
/// light, its shadow's is at 2e, wherever the cone blurs it to: so the mean over a window of width 1 that all of it lies in
/// grows by twice the radiance there.
#[test]
fn the_edge_of_a_shadow_moves_with_what_casts_it_and_with_the_light() {
    let device = Device::flex();
    let (height, edge, strength) = (2.0, 0.05, 3.0);
    let of = |seed: u64| {
        let (shift, place) = (leaf(&[0.0; 3], &device), leaf(&[0.0, 2.0, 0.0], &device));
        let plate = facing_down([edge, 3.0], [-3.0, 3.0], 0.5 * height, &device);
        let scene = lit_floor(Light::point(place.clone(), [strength; 3]), &device)
            .with_object(diffuse(plate.translated(shift.clone()), [0.0; 3]));
        let options = RenderOptions::new(8, 8)
            .with_samples(64)
            .with_bounces(0)
            .with_visibility(Visibility::cone(1.719))
            .with_seed(seed);
        let image = render(&scene, &from_above(), &options).expect("an image");
        let gradients = image.radiance.mean().backward();
        [
            gradient(&shift, &gradients)[0],
            gradient(&place, &gradients)[0],
        ]
    };
    let seeds = if common::long() { 400 } else { 64 };
    let all: Vec<[f64; 2]> = (0..seeds).map(of).collect();
    let there = |x: f64, z: f64| {
        let squared = x * x + z * z + height * height;
        ALBEDO / PI * strength * height / squared.powf(1.5)
    };
    let steps = || (0..100).map(|i| (f64::from(i) + 0.5) / 100.0);
    let along_edge: Vec<f64> = steps().map(|z| there(2.0 * edge, z - 0.5)).collect();
    // The light moves its shadow the other way, and what it brings everywhere that is lit.
    let slope = |x: f64, z: f64| (there(x - 1e-4, z) - there(x + 1e-4, z)) / 2e-4;
    let width = 0.5 + 2.0 * edge;
    let interior: f64 = steps()
        .map(|x| {
            steps()
                .map(|z| slope(width * x - 0.5, z - 0.5))
                .sum::<f64>()
                * 1e-4
                * width
        })
        .sum();
    let wanted = [2.0 * mean(&along_edge), interior - mean(&along_edge)];
    for (i, wanted) in wanted.into_iter().enumerate() {
        let of_one: Vec<f64> = all.iter().map(|g| g[i]).collect();
        let (found, error) = mean_and_error(&of_one);
        println!("{found} ± {error}, expected {wanted}");
        assert!(error < 0.03 * wanted.abs(), "{error}");
        assert!((found - wanted).abs() < 3.5 * error + 0.005 * wanted.abs());
    }
}

/// Two rows of four texels.
const TEXELS: [[f64; 3]; 8] = [
    [9.0, 0.0, 1.0],
    [0.0, 2.0, 0.0],
    [0.0; 3],
    [4.0, 4.0, 1.0],
    [0.5, 0.5, 3.0],
    [0.0; 3],
    [0.0, 7.0, 2.0],
    [1.0, 0.0, 12.0],
];

/// Their bilinear look-up at a point of the unit square.
fn texel_at(u: f64, v: f64) -> [f64; 3] {
    let (x, y) = (4.0 * u - 0.5, 2.0 * (1.0 - v) - 0.5);
    let mut sum = DVec3::ZERO;
    for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let [column, row] = [x.floor() + f64::from(i), y.floor() + f64::from(j)];
        let weight = (1.0 - (x - column).abs()) * (1.0 - (y - row).abs());
        let texel = 4 * (row as i64).clamp(0, 1) + (column as i64).clamp(0, 3);
        sum += DVec3::from(TEXELS[texel as usize]) * weight;
    }
    sum.into()
}

/// A lamp with a texture lights a floor as one that is cut into pieces with its radiance in their middles.
#[test]
fn an_emissive_texture_lights_as_its_pieces_do() {
    let device = Device::flex();
    let (half, pieces) = (0.8, 24);
    let texels: Vec<f32> = TEXELS.iter().flatten().map(|&x| x as f32).collect();
    let texels = Tensor::<1>::from_floats(texels.as_slice(), &device).reshape([2, 4, 3]);
    let lamp = facing_down([-half, half], [-half, half], 0.7, &device);
    let uvs: Vec<f32> = lamp
        .host_vertices()
        .expect("vertices")
        .iter()
        .flat_map(|v| [v[0], v[2]].map(|x| ((x / half + 1.0) * 0.5) as f32))
        .collect();
    let uvs = Tensor::<1>::from_floats(uvs.as_slice(), &device).reshape([4, 2]);
    let wrap = Wrap::Clamp;
    let whole = Object::new(lamp.with_uvs(uvs))
        .with_material(Material::emitter(ColorTexture::Texture { texels, wrap }));
    let floor = || Scene::new().with_object(diffuse(floor(4.0, 0.0, &device), [ALBEDO; 3]));
    let mut cut = floor();
    let place = |i: i32| 2.0 * half * f64::from(i) / f64::from(pieces) - half;
    let middle = |i: i32| (f64::from(i) + 0.5) / f64::from(pieces);
    for i in 0..pieces * pieces {
        let (x, z) = (i % pieces, i / pieces);
        let piece = facing_down(
            [place(x), place(x + 1)],
            [place(z), place(z + 1)],
            0.7,
            &device,
        );
        cut = cut.with_object(emitting(piece, texel_at(middle(x), middle(z))));
    }
    for visibility in [Visibility::cone(0.0), Visibility::cone(2.865)] {
        let image = |scene: &Scene, seed| {
            let options = RenderOptions::new(6, 6)
                .with_samples(if common::long() { 16384 } else { 2048 })
                .with_bounces(0)
                .with_visibility(visibility)
                .with_seed(seed);
            radiance(scene, &from_above(), &options)
        };
        let whole = floor().with_object(whole.clone());
        let (found, wanted) = (image(&whole, 1), image(&cut, 2));
        let noise = rmse(&found, &image(&whole, 3)).hypot(rmse(&wanted, &image(&cut, 4)));
        let (apart, mean) = (rmse(&found, &wanted), mean(&wanted));
        println!("{apart} apart, noise {noise}, mean {mean}");
        assert!(noise < 0.02 * mean, "{noise} of {mean}");
        assert!(apart < noise, "{apart} apart, noise {noise}");
        let by_channel = |image: &[f64]| -> Vec<f64> {
            (0..3)
                .map(|c| image.iter().skip(c).step_by(3).sum::<f64>() / 36.0)
                .collect()
        };
        for (a, b) in by_channel(&found).into_iter().zip(by_channel(&wanted)) {
            assert!((a - b).abs() < 4.0 * noise / 6.0, "{a} {b}, noise {noise}");
        }
    }
}

#[test]
fn mistakes_are_errors() {
    let device = Device::flex();
    let cases = [
        (
            Light::directional([0.0; 3], [1.0; 3]),
            ["light 0", "direction"],
        ),
        (
            Light::point([f64::NAN; 3], [1.0; 3]),
            ["light 0", "position"],
        ),
        (
            Light::spot([0.0; 3], [0.0, -1.0, 0.0], [1.0; 3], 30.0, 20.0),
            ["light 0", "inner ≤ outer"],
        ),
    ];
    for (light, words) in cases {
        let scene = lit_floor(light, &device);
        let options = RenderOptions::new(4, 4);
        says(message(render(&scene, &from_above(), &options)), words);
    }
}
