//! A random scene as a function of a seed and of the values of its parameters; building it without values lists them.

use burn::tensor::{DType, Device, Tensor};
use softray::gradcheck::Point;
use softray::prelude::*;

use crate::common::tensors::tensor as constant;

/// A parameter: its value, the step of its difference, and whether it moves an object, a light or the camera.
pub struct Number {
    name: String,
    pub value: f64,
    pub step: f64,
    moves: bool,
    /// Whether gradients have all of its derivative: the outlines of masks have none.
    pub differentiable: bool,
}

impl Number {
    pub fn name(&self) -> &str {
        &self.name
    }
}

/// Parameters that turn sampled directions.
const TURNING: [&str; 1] = ["normal map"];

/// A scene while it is built.
pub struct Maker<'a> {
    seed: u64,
    drawn: u64,
    point: Option<&'a Point>,
    pub device: Device,
    pub dtype: DType,
    numbers: Vec<Number>,
    pub description: Vec<String>,
    /// Whether a material has a mask.
    pub masked: bool,
    /// Whether a light has no extent, so that its shadows need a cone.
    pub delta: bool,
    pub refracts: bool,
}

/// A scene that depends on numbers.
pub struct RandomScene {
    pub numbers: Vec<Number>,
    pub description: String,
    pub options: RenderOptions,
    pub seed: u64,
    /// It at the values of its numbers.
    pub scene: Scene,
    pub camera: Camera,
    build: fn(&mut Maker) -> (Scene, Camera),
}

impl RandomScene {
    pub fn new(seed: u64) -> Self {
        let mut maker = Maker::new(seed, None);
        let (scene, camera) = maker.scene();
        let angle = match maker.delta || maker.unit() < 0.5 {
            true => maker.between(1.2, 8.6),
            false => 0.0,
        };
        let least = if maker.refracts { 2 } else { 0 };
        let bounces = maker.pick(3).max(least) as u32;
        let options = RenderOptions::new(10, 10)
            .with_samples(64)
            .with_bounces(bounces)
            .with_blur(angle);
        // Masks whose outlines move in the image, in a reflection or in what is refracted.
        let turns = |n: &Number| TURNING.iter().any(|field| n.name.ends_with(field));
        for number in &mut maker.numbers {
            number.differentiable = !(maker.masked && (number.moves || turns(number)));
        }
        let about = maker.description.join(", ");
        Self {
            numbers: maker.numbers,
            description: format!("{about}; {bounces} bounces, angle {angle:.3}"),
            options,
            seed,
            scene,
            camera,
            build: |m| m.scene(),
        }
    }

    /// Two bodies of one color or black that pass through each other, in direct light without a cone.
    pub fn of_crossing_bodies(seed: u64) -> Self {
        let mut maker = Maker::new(seed, None);
        let (scene, camera) = maker.crossing_bodies();
        Self {
            description: maker.description.join(", "),
            numbers: maker.numbers,
            options: RenderOptions::new(8, 8).with_samples(64).with_bounces(0),
            seed,
            scene,
            camera,
            build: |m| m.crossing_bodies(),
        }
    }

    /// The scene at values of its numbers.
    pub fn build(&self, point: &Point) -> (Scene, Camera) {
        (self.build)(&mut Maker::new(self.seed, Some(point)))
    }
}

impl<'a> Maker<'a> {
    fn new(seed: u64, point: Option<&'a Point>) -> Self {
        Self {
            seed,
            drawn: 0,
            point,
            device: point.map_or_else(Device::flex, |p| p.device.clone()),
            dtype: point.map_or(DType::F64, |p| p.dtype),
            numbers: Vec::new(),
            description: Vec::new(),
            masked: false,
            delta: false,
            refracts: false,
        }
    }

    /// In [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.drawn += 1;
        // SplitMix64 (Steele, Lea and Flood 2014).
        let mut x = ((self.seed << 20) + self.drawn).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub fn pick(&mut self, n: usize) -> usize {
        ((self.unit() * n as f64) as usize).min(n - 1)
    }

    pub fn vector(&mut self, low: f64, high: f64) -> [f64; 3] {
        std::array::from_fn(|_| self.between(low, high))
    }

    pub fn direction(&mut self) -> [f64; 3] {
        loop {
            let v = self.vector(-1.0, 1.0);
            let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
            if (0.3..1.0).contains(&length) {
                return v.map(|x| x / length);
            }
        }
    }

    pub fn tensor<const D: usize>(&self, values: &[f64], dims: [usize; D]) -> Tensor<D> {
        constant(values, dims, &self.device, self.dtype)
    }

    /// A number that the scene depends on, as a tensor `[1]`.
    pub fn number(&mut self, name: &str, value: f64, step: f64, moves: bool) -> Tensor<1> {
        self.numbers.push(Number {
            name: name.into(),
            value,
            step,
            moves,
            differentiable: true,
        });
        match self.point {
            Some(p) => p.get(name).expect("the number"),
            None => self.tensor(&[value], [1]),
        }
    }

    /// base + number · direction.
    pub fn along(&mut self, name: &str, base: [f64; 3], step: f64, moves: bool) -> Tensor<1> {
        let direction = self.direction();
        let p = self.number(name, 0.0, step, moves);
        self.tensor(&base, [3]) + p * self.tensor(&direction, [3])
    }

    /// A color that a number scales.
    pub fn color(&mut self, name: &str, low: f64, high: f64) -> Tensor<1> {
        let color = self.vector(low, high);
        self.number(name, 1.0, 0.2, false) * self.tensor(&color, [3])
    }

    /// Texels `[2, 3, 3]`, some of which depend on a number.
    pub fn texels(&mut self, name: &str, low: f64, high: f64) -> Tensor<3> {
        let base: Vec<f64> = (0..18).map(|_| self.between(low, high)).collect();
        let one: Vec<f64> = (0..18).map(|_| self.between(-0.2, 1.0)).collect();
        let (low, one) = (self.tensor(&base, [2, 3, 3]), self.tensor(&one, [2, 3, 3]));
        let p = self.number(name, 0.0, 0.12, false);
        low + one * p.reshape([1, 1, 1])
    }

    pub fn albedo(&mut self, name: &str) -> ColorTexture {
        match self.pick(3) {
            0 => ColorTexture::texture(self.texels(name, 0.15, 0.6)),
            _ => self.color(name, 0.2, 0.8).into(),
        }
    }

    pub fn share(&mut self, name: &str, low: f64, high: f64) -> ScalarTexture {
        if self.pick(3) == 0 {
            let base: Vec<f64> = (0..4).map(|_| self.between(low, high)).collect();
            let p = self.number(name, 0.0, 0.08, false);
            let texels = self.tensor(&base, [2, 2]) + p.reshape([1, 1]);
            return ScalarTexture::texture(texels);
        }
        let value = self.between(low, high);
        self.number(name, value, 0.08, false).into()
    }

    fn lights(&mut self, mut scene: Scene) -> Scene {
        match self.pick(4) {
            0 => {
                let radiance = self.color("environment", 0.3, 0.9);
                scene = scene.with_environment(radiance);
            }
            1 => {
                let texels: Vec<f64> = (0..96).map(|_| self.between(0.1, 1.2)).collect();
                let one: Vec<f64> = (0..96).map(|_| self.unit()).collect();
                let p = self.number("map's texels", 0.0, 0.3, false);
                let [texels, one] = [texels, one].map(|v| self.tensor(&v, [4, 8, 3]));
                let map = Environment::map(texels + one * p.reshape([1, 1, 1]));
                self.description.push("map".into());
                scene = scene.with_environment(map);
            }
            _ => scene = scene.with_environment(self.vector(0.05, 0.2)),
        }
        let kind = self.pick(6);
        let place = [
            self.between(-1.2, 1.2),
            self.between(2.0, 2.8),
            self.between(-0.3, 1.5),
        ];
        match kind {
            0 | 1 => {
                let size = self.between(0.2, 0.6);
                let d = self.device.clone();
                let lamp = match kind {
                    0 => shapes::quad(
                        [-size, 0.0, -size],
                        [size, 0.0, -size],
                        [size, 0.0, size],
                        [-size, 0.0, size],
                        &d,
                    ),
                    _ => shapes::icosphere(1, &d).scaled(size),
                };
                let place = self.along("lamp: translation", place, 0.4, true);
                let radiance = match self.pick(3) {
                    0 => ColorTexture::texture(self.texels("lamp: emission", 2.0, 8.0)),
                    _ => self.color("lamp: emission", 3.0, 8.0).into(),
                };
                self.description
                    .push(["square lamp", "round lamp"][kind].into());
                let lamp = Object::new(self.with_coordinates(lamp).translated(place));
                scene = scene.with_object(
                    lamp.with_name("lamp")
                        .with_material(Material::emitter(radiance)),
                );
            }
            2 | 3 => {
                self.delta = true;
                let intensity = self.color("light: intensity", 3.0, 8.0);
                let target = self.vector(-0.3, 0.3);
                let towards = std::array::from_fn(|i| target[i] - place[i]);
                let position = self.along("light: position", place, 0.4, true);
                let light = match kind {
                    2 => Light::point(position, intensity),
                    _ => {
                        let direction = self.along("light: direction", towards, 0.25, false);
                        let inner = self.number("light: inner angle", 17.0, 10.0, false);
                        let outer = self.number("light: outer angle", 40.0, 10.0, false);
                        Light::spot(position, direction, intensity, inner, outer)
                    }
                };
                self.description.push(["point", "spot"][kind - 2].into());
                scene = scene.with_light(light);
            }
            4 => {
                self.delta = true;
                let irradiance = self.color("light: irradiance", 1.0, 3.0);
                let direction = self.along("light: direction", [-0.4, -1.0, -0.3], 0.3, true);
                self.description.push("directional".into());
                scene = scene.with_light(Light::directional(direction, irradiance));
            }
            _ => {}
        }
        scene
    }

    fn camera(&mut self) -> Camera {
        let eye = [self.between(-1.5, 1.5), self.between(1.0, 2.6), 4.2];
        let eye = self.along("camera: eye", eye, 0.4, true);
        let target = self.vector(-0.1, 0.1);
        let target = self.along(
            "camera: target",
            [target[0], 0.7 + target[1], target[2]],
            0.1,
            true,
        );
        // Tilted, so that no edge lies along a row of pixels.
        let up = [self.between(0.1, 0.4), 1.0, 0.0];
        let camera = Camera::look_at(eye, target).with_up(up);
        if self.unit() < 0.2 {
            self.description.push("parallel rays".into());
            let height = self.number("camera: height", 2.6, 0.6, true);
            return camera.with_orthographic(height);
        }
        let fov = self.between(28.0, 42.0);
        let camera = camera.with_fov_y(self.number("camera: field of view", fov, 6.0, true));
        if self.unit() < 0.25 {
            self.description.push("lens".into());
            let aperture = self.number("lens: aperture", 0.2, 0.1, true);
            let focus = self.number("lens: focus", 2.6, 0.6, true);
            return camera.with_thin_lens(aperture, focus);
        }
        camera
    }

    fn scene(&mut self) -> (Scene, Camera) {
        let objects = self.bodies();
        let scene = objects.into_iter().fold(Scene::new(), Scene::with_object);
        let scene = self.lights(scene);
        (scene, self.camera())
    }
}
