//! The noise of gradients of glossy bodies that move over a floor, beside that of a matt body.

use std::collections::HashMap;
use std::fmt;
use std::ops::Range;

use crate::common::long;
use crate::common::numbers::{mean, mean_and_error};
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
    /// Metal with a roughness of 0.05, and glass of 0.1.
    Polished,
    PolishedGlass,
    Glass,
}

/// The light beside a constant sky.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Light {
    None,
    /// A lamp that appears 1° wide.
    Small,
    /// A lamp that appears 20° wide.
    Wide,
    Near,
    /// Four bright texels of an environment map.
    Sun,
    /// A bright part of an environment map.
    Window,
    /// A point light whose shadows have the blur of a cone.
    Point,
}

/// A body over a floor.
#[derive(Clone, Copy)]
struct Setting {
    shape: Shape,
    surface: Surface,
    floor: Surface,
    light: Light,
    bounces: u32,
}

impl fmt::Display for Setting {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self {
            shape,
            surface,
            floor,
            light,
            bounces,
        } = self;
        write!(
            f,
            "{surface:?} {shape:?} over {floor:?}, light {light:?}, {bounces} bounces"
        )
    }
}

/// Estimates by several seeds.
struct Noise {
    /// The standard deviation of the derivative of a weighted image by the body's x, over the sum of the absolute changes
    /// of all pixels.
    relative: f64,
    /// The part of the variance that the worst of the seeds has: of the derivative, and of the weighted image.
    worst: f64,
    worst_image: f64,
}

const PIXELS: usize = 32;
const FROM: [f64; 3] = [-0.6, 0.75, 0.35];

/// A lamp in the direction `FROM`, of half a side `half`.
fn lamp(far: f64, half: f64, radiance: f64) -> Object {
    let toward = glam::DVec3::from(FROM).normalize();
    let across = glam::DVec3::Y.cross(toward).normalize();
    let up = toward.cross(across);
    let corner = |s: f64, t: f64| (toward * far + (across * s + up * t) * half).to_array();
    let d = Device::flex();
    let quad = shapes::quad(
        corner(-1.0, -1.0),
        corner(-1.0, 1.0),
        corner(1.0, 1.0),
        corner(1.0, -1.0),
        &d,
    );
    emitting(quad, [radiance; 3])
}

/// A map of constant radiance with a bright part.
fn map(rows: Range<usize>, columns: Range<usize>, radiance: f32) -> Environment {
    let [height, width] = [128, 256];
    let texel = |i: usize| {
        let bright = rows.contains(&(i / width)) && columns.contains(&(i % width));
        [if bright { radiance } else { 0.4 }; 3]
    };
    let texels: Vec<f32> = (0..height * width).flat_map(texel).collect();
    let texels = leaf(&texels, &Device::flex()).inner();
    Environment::map(texels.reshape([height, width, 3]))
}

impl Setting {
    fn scene(&self, x: &Tensor<1>) -> (Scene, Camera) {
        let d = Device::flex();
        let color = [0.8, 0.4, 0.3];
        let metal = Material::metallic_roughness;
        let body = match self.shape {
            Shape::Cube => shapes::cube(&d).scaled(0.45).rotated([0.3, 1.0, 0.2], 40.0),
            Shape::Torus => shapes::torus(0.5, 0.2, 32, 16, &d).rotated([1.0, 0.0, 0.3], 60.0),
            Shape::Ball => shapes::icosphere(3, &d).scaled(0.55),
            Shape::SmoothBall => shapes::icosphere(3, &d).scaled(0.55).smooth_normals(),
        };
        let body = body.translated([0.1, 0.75, 0.0]).translated(x.clone());
        let body = match self.surface {
            Surface::Matt => diffuse(body, color),
            Surface::Metal => Object::new(body).with_material(metal(color, 1.0, 0.2)),
            Surface::Polished => Object::new(body).with_material(metal(color, 1.0, 0.05)),
            Surface::Glass => Object::new(body).with_material(Material::dielectric(1.5, 0.2)),
            Surface::PolishedGlass => {
                Object::new(body).with_material(Material::dielectric(1.5, 0.1))
            }
        };
        let ground = floor(3.0, 0.0, &d);
        let ground = match self.floor {
            Surface::Matt => diffuse(ground, [0.7; 3]),
            _ => Object::new(ground).with_material(metal([0.7; 3], 1.0, 0.2)),
        };
        let scene = Scene::new().with_object(ground).with_object(body);
        let scene = scene.with_environment([0.4; 3]);
        let scene = match self.light {
            Light::None => scene,
            Light::Small => scene.with_object(lamp(20.0, 0.25, 12800.0)),
            Light::Wide => scene.with_object(lamp(10.0, 1.75, 65.0)),
            Light::Near => scene.with_object(lamp(2.6, 0.25, 40.0)),
            Light::Sun => scene.with_environment(map(31..33, 20..22, 4700.0)),
            Light::Window => scene.with_environment(map(26..40, 16..30, 96.0)),
            Light::Point => {
                scene.with_light(softray::scene::Light::point([-1.6, 2.2, 0.9], [40.0; 3]))
            }
        };
        let camera = Camera::look_at([0.0, 2.4, 4.2], [0.0, 0.35, 0.0]).with_fov_y(40.0);
        (scene, camera)
    }

    /// The image with the body at `x`, times a smooth weight of each pixel.
    fn image(&self, x: &Tensor<1>, samples: u32, seed: u64) -> Tensor<3> {
        let wave = |i: usize| {
            let (x, y) = ((i % PIXELS) as f32, (i / PIXELS) as f32);
            (0.42 * x).sin() + 0.5 * (0.66 * y).cos()
        };
        let weights: Vec<f32> = (0..PIXELS * PIXELS).map(wave).collect();
        let weights = leaf(&weights, &Device::flex()).inner();
        let (scene, camera) = self.scene(x);
        let mut options = RenderOptions::new(PIXELS, PIXELS)
            .with_samples(samples)
            .with_bounces(self.bounces)
            .with_seed(seed);
        if self.light == Light::Point {
            options = options.with_visibility(Visibility::cone(1.0));
        }
        let image = render(&scene, &camera, &options).expect("an image");
        image.radiance * weights.reshape([PIXELS, PIXELS, 1])
    }

    /// The difference of two images over that of the body's x, whose mean is 0.
    fn difference(&self, step: f32, samples: u32, seed: u64) -> Tensor<3> {
        let d = Device::flex();
        let at = |x: f32| self.image(&leaf(&[x, 0.0, 0.0], &d).inner(), samples, seed);
        (at(step) - at(-step)) / (2.0 * f64::from(step))
    }

    /// The weighted image's sum and its derivative.
    fn derivative(&self, seed: u64) -> (f64, f64) {
        let x = leaf(&[0.0; 3], &Device::flex());
        let sum = self.image(&x, 16, seed).sum();
        let derivative = gradient(&x, &sum.clone().backward())[0];
        (scalar(&sum.inner()), derivative)
    }

    fn noise(&self, seeds: u64, samples: u32) -> Noise {
        let change = scalar(&self.difference(0.05, samples, 7).abs().sum());
        let of_seed = |seed| self.derivative(seed);
        let (sums, found): (Vec<f64>, Vec<f64>) = (0..seeds).into_par_iter().map(of_seed).unzip();
        let (variance, worst) = spread(&found);
        Noise {
            relative: variance.sqrt() / change,
            worst,
            worst_image: spread(&sums).1,
        }
    }
}

/// Returns the variance, and the largest part of it that is due to one of the values.
fn spread(found: &[f64]) -> (f64, f64) {
    let middle = mean(found);
    let squares: Vec<f64> = found.iter().map(|g| (g - middle).powi(2)).collect();
    let sum: f64 = squares.iter().sum();
    let variance = sum / (found.len() - 1) as f64;
    (variance, squares.iter().copied().fold(0.0, f64::max) / sum)
}

/// All settings of a glossy body.
fn grid() -> Vec<Setting> {
    use Shape::{Ball, Cube, SmoothBall, Torus};
    let mut all = Vec::new();
    for light in [
        Light::None,
        Light::Small,
        Light::Wide,
        Light::Near,
        Light::Sun,
        Light::Window,
        Light::Point,
    ] {
        for floor in [Surface::Matt, Surface::Metal] {
            for bounces in [0, 1, 3] {
                for shape in [Cube, Ball, SmoothBall, Torus] {
                    for surface in [Surface::Metal, Surface::Polished, Surface::Glass] {
                        all.push(Setting {
                            shape,
                            surface,
                            floor,
                            light,
                            bounces,
                        });
                    }
                }
            }
        }
    }
    all
}

/// The largest noise over that of a matt body that has flat faces, and the largest median over the grid. The lobe of a polished
/// surface moves over fixed points of lamps, and the images have caustics.
fn limits(light: Light, surface: Surface) -> [f64; 2] {
    match (light, surface) {
        (Light::None, Surface::Glass) => [100.0, 1.8],
        (Light::None, _) => [10.0, 1.8],
        (Light::Point, Surface::Metal) => [35.0, 9.0],
        (Light::Point, Surface::Glass) => [600.0, 10.0],
        (Light::Point, _) => [50_000.0, 50.0],
        (Light::Sun, Surface::Polished) => [2_000.0, 20.0],
        (Light::Window, Surface::Polished) => [60.0, 20.0],
        (_, Surface::Polished) => [2_500.0, 24.0],
        (Light::Near, _) => [160.0, 7.0],
        (_, _) => [60.0, 6.0],
    }
}

/// In the long tier these are all settings of the grid, otherwise each 20th in an order that is mixed.
#[test]
fn glossy_bodies_have_little_noise_beside_matt_ones() {
    let (seeds, samples) = if long() { (64, 256) } else { (16, 64) };
    let grid = grid();
    let chosen = |i: usize| long() || i * 101 % grid.len() < grid.len() / 20;
    let mut failures = Vec::new();
    let mut ratios: HashMap<String, (Vec<f64>, f64)> = HashMap::new();
    for (_, setting) in grid.iter().enumerate().filter(|(i, _)| chosen(*i)) {
        let shape = match setting.shape {
            Shape::SmoothBall => Shape::Ball,
            other => other,
        };
        let matt = Setting {
            shape,
            surface: Surface::Matt,
            ..*setting
        };
        let (found, matt) = (setting.noise(seeds, samples), matt.noise(seeds, samples));
        let ratio = found.relative / matt.relative;
        println!(
            "{setting}: {:.4}, {ratio:.2} of matt {:.4}; worst {:.2}, matt {:.2}, image {:.2}",
            found.relative, matt.relative, found.worst, matt.worst, found.worst_image
        );
        let [most, median] = limits(setting.light, setting.surface);
        let class = format!("{:?} {:?}", setting.light, setting.surface);
        let (of_class, _) = ratios.entry(class).or_insert((Vec::new(), median));
        of_class.push(ratio);
        // NaN is a failure, too.
        let quiet = ratio < most && found.worst < 0.97;
        if !quiet {
            failures.push(setting.to_string());
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
    if long() {
        for (class, (mut ratios, most)) in ratios {
            ratios.sort_by(f64::total_cmp);
            let median = ratios[ratios.len() / 2];
            println!("{class}: median {median:.2}");
            assert!(median < most, "{class}: {median} {ratios:?}");
        }
    }
}

/// Light of an environment map arrives at a polished surface in directions that turn with its lobe.
#[test]
fn directions_to_a_map_turn_with_polished_lobes() {
    for (surface, shape, bounces) in [
        (Surface::Polished, Shape::SmoothBall, 0),
        (Surface::Polished, Shape::Cube, 1),
        (Surface::PolishedGlass, Shape::SmoothBall, 1),
    ] {
        let setting = Setting {
            shape,
            surface,
            floor: Surface::Matt,
            light: Light::Window,
            bounces,
        };
        let seeds = if long() { 2048 } else { 384 };
        let found: Vec<f64> = (0..seeds)
            .into_par_iter()
            .map(|seed| setting.derivative(seed).1)
            .collect();
        let differences: Vec<f64> = (0..seeds / 4)
            .into_par_iter()
            .map(|seed| scalar(&setting.difference(0.01, 64, seed).sum()))
            .collect();
        let change = scalar(&setting.difference(0.05, 256, 7).abs().sum());
        let (derivative, error) = mean_and_error(&found);
        let (difference, other) = mean_and_error(&differences);
        let error = error.hypot(other);
        println!("{setting}: {derivative} - {difference} = ± {error} of {change}");
        assert!(error < 0.06 * change, "{setting}: {error} of {change}");
        let apart = (derivative - difference).abs();
        assert!(
            apart < 4.0 * error,
            "{setting}: {derivative} {difference} ± {error}"
        );
    }
}
