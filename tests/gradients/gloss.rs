//! The noise of gradients of glossy bodies that move over a floor, beside that of a matt body.

use crate::common::long;
use crate::common::numbers::mean;
use crate::common::scenes::{diffuse, emitting, floor};
use crate::common::tensors::{gradient, leaf, scalar};
use burn::tensor::Device;
use rayon::prelude::*;
use softray::prelude::*;
use softray::scene::shapes;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    Cube,
    Ball,
    SmoothBall,
    Torus,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Surface {
    Matt,
    Metal,
    Glass,
}

/// A body over a floor, below a constant sky and perhaps a lamp.
#[derive(Clone, Copy, Debug)]
struct Setting {
    shape: Shape,
    surface: Surface,
    floor: Surface,
    lamp: bool,
    bounces: u32,
}

/// Estimates of the derivative of a weighted image by the body's x.
struct Noise {
    /// The standard deviation, over the sum of the absolute changes of all pixels.
    relative: f64,
    /// The part of the variance that the worst of the seeds has.
    worst: f64,
}

const PIXELS: usize = 32;

impl Setting {
    fn scene(&self, x: &Tensor<1>) -> (Scene, Camera) {
        let d = Device::flex();
        let rough = |color: [f64; 3]| Material::metallic_roughness(color, 1.0, 0.2);
        let body = match self.shape {
            Shape::Cube => shapes::cube(&d).scaled(0.45).rotated([0.3, 1.0, 0.2], 40.0),
            Shape::Torus => shapes::torus(0.5, 0.2, 32, 16, &d).rotated([1.0, 0.0, 0.3], 60.0),
            Shape::Ball => shapes::icosphere(3, &d).scaled(0.55),
            Shape::SmoothBall => shapes::icosphere(3, &d).scaled(0.55).smooth_normals(),
        };
        let body = body.translated([0.1, 0.75, 0.0]).translated(x.clone());
        let body = match self.surface {
            Surface::Matt => diffuse(body, [0.8, 0.4, 0.3]),
            Surface::Metal => Object::new(body).with_material(rough([0.8, 0.4, 0.3])),
            Surface::Glass => Object::new(body).with_material(Material::dielectric(1.5, 0.2)),
        };
        let ground = floor(3.0, 0.0, &d);
        let ground = match self.floor {
            Surface::Matt => diffuse(ground, [0.7; 3]),
            _ => Object::new(ground).with_material(rough([0.7; 3])),
        };
        let scene = Scene::new().with_object(ground).with_object(body);
        let mut scene = scene.with_environment([0.4; 3]);
        if self.lamp {
            let lamp = shapes::quad(
                [-6.0, 8.0, 2.0],
                [-3.0, 8.0, 2.0],
                [-3.0, 8.0, 5.0],
                [-6.0, 8.0, 5.0],
                &d,
            );
            scene = scene.with_object(emitting(lamp, [60.0; 3]));
        }
        let camera = Camera::look_at([0.0, 2.4, 4.2], [0.0, 0.35, 0.0]).with_fov_y(40.0);
        (scene, camera)
    }

    fn noise(&self, seeds: u64) -> Noise {
        let d = Device::flex();
        let wave = |i: usize| {
            let (x, y) = ((i % PIXELS) as f32, (i / PIXELS) as f32);
            (0.42 * x).sin() + 0.5 * (0.66 * y).cos()
        };
        let weights: Vec<f32> = (0..PIXELS * PIXELS).map(wave).collect();
        let weights = leaf(&weights, &d).inner().reshape([PIXELS, PIXELS, 1]);
        let image = |x: &Tensor<1>, samples, seed| {
            let (scene, camera) = self.scene(x);
            let options = RenderOptions::new(PIXELS, PIXELS)
                .with_samples(samples)
                .with_bounces(self.bounces)
                .with_seed(seed);
            let image = render(&scene, &camera, &options).expect("an image");
            image.radiance * weights.clone()
        };
        let at = |x: f32| image(&leaf(&[x, 0.0, 0.0], &d).inner(), 256, 7);
        let change = scalar(&((at(0.05) - at(-0.05)) / 0.1).abs().sum());
        let of_seed = |seed| {
            let x = leaf(&[0.0; 3], &d);
            gradient(&x, &image(&x, 16, seed).sum().backward())[0]
        };
        let found: Vec<f64> = (0..seeds).into_par_iter().map(of_seed).collect();
        let middle = mean(&found);
        let squares: Vec<f64> = found.iter().map(|g| (g - middle).powi(2)).collect();
        let sum: f64 = squares.iter().sum();
        Noise {
            relative: (sum / (seeds - 1) as f64).sqrt() / change,
            worst: squares.iter().copied().fold(0.0, f64::max) / sum,
        }
    }
}

/// In the long tier these are more shapes, three bounces, and a lamp, whose caustics have noise in images, too.
#[test]
fn glossy_bodies_have_little_noise_beside_matt_ones() {
    use Shape::{Ball, Cube, SmoothBall, Torus};
    let shapes: &[Shape] = match long() {
        true => &[Cube, Ball, SmoothBall, Torus],
        false => &[Ball, SmoothBall],
    };
    // The floor, whether there is a lamp, and the number of bounces.
    let around: &[(Surface, bool, u32)] = match long() {
        true => &[
            (Surface::Matt, false, 1),
            (Surface::Metal, false, 1),
            (Surface::Matt, false, 3),
            (Surface::Matt, true, 1),
            (Surface::Matt, true, 3),
        ],
        false => &[(Surface::Matt, false, 1)],
    };
    let mut failures = Vec::new();
    for &(floor, lamp, bounces) in around {
        // The limits of the noise over that of a matt body, and of the worst seed.
        let metal = match (lamp, long()) {
            (true, _) => 18.0,
            (false, true) => 4.0,
            (false, false) => 3.0,
        };
        let glass = match (lamp, bounces) {
            (false, 1) if !long() => 4.0,
            (false, 1) => 16.0,
            (false, _) => 30.0,
            (true, _) => 80.0,
        };
        for &shape in shapes {
            let of = |shape, surface| {
                let setting = Setting {
                    shape,
                    surface,
                    floor,
                    lamp,
                    bounces,
                };
                (setting, setting.noise(48))
            };
            // That of a smooth body is compared with one of flat faces.
            let flat = if shape == SmoothBall { Ball } else { shape };
            let (_, matt) = of(flat, Surface::Matt);
            for (surface, most) in [(Surface::Metal, metal), (Surface::Glass, glass)] {
                let (setting, found) = of(shape, surface);
                let ratio = found.relative / matt.relative;
                println!("{setting:?}: {ratio:.2} of matt, worst {:.2}", found.worst);
                // Few samples of glass have most of the noise.
                let worst = if lamp || surface == Surface::Glass {
                    0.9
                } else {
                    0.4
                };
                if ratio > most || found.worst > worst {
                    failures.push(setting);
                }
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}
