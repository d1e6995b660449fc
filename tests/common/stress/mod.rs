//! Scenes at the edge of what floats can hold. Every number of a [`World`] is a leaf of the graph.

pub mod cases;

use burn::tensor::{DType, Device, Gradients, Tensor};
use softray::prelude::*;

use crate::common::scenes::{facing_down, floor};
use crate::common::tensors::tensor;

/// Height, width, texels; and texture coordinates of the vertices.
pub type Texels = ([usize; 2], Vec<f64>, Vec<[f64; 2]>);

/// An object by numbers.
#[derive(Clone, Debug)]
pub struct Thing {
    pub name: &'static str,
    pub vertices: Vec<[f64; 3]>,
    pub faces: Vec<[u32; 3]>,
    pub diffuse: [f64; 3],
    pub gloss: Option<([f64; 3], f64)>,
    pub emission: Option<[f64; 3]>,
    pub velocity: Option<[f64; 3]>,
    pub texture: Option<Texels>,
}

impl Thing {
    pub fn new(name: &'static str, vertices: Vec<[f64; 3]>, faces: Vec<[u32; 3]>) -> Self {
        Self {
            name,
            vertices,
            faces,
            diffuse: [0.5, 0.4, 0.3],
            gloss: None,
            emission: None,
            velocity: None,
            texture: None,
        }
    }

    pub fn triangle(name: &'static str, corners: [[f64; 3]; 3]) -> Self {
        Self::new(name, corners.to_vec(), vec![[0, 1, 2]])
    }

    pub fn shape(name: &'static str, mesh: Mesh, at: [f64; 3], size: f64) -> Self {
        let vertices = mesh.host_vertices().expect("vertices");
        let place = |v: [f64; 3]| std::array::from_fn(|i| at[i] + size * v[i]);
        let vertices = vertices.into_iter().map(place).collect();
        Self::new(name, vertices, mesh.faces.to_vec())
    }

    pub fn emitting(mut self, radiance: [f64; 3]) -> Self {
        self.emission = Some(radiance);
        self
    }
}

/// A scene, a camera and how to render it.
#[derive(Clone, Debug)]
pub struct World {
    pub things: Vec<Thing>,
    pub environment: [f64; 3],
    pub eye: [f64; 3],
    pub target: [f64; 3],
    pub up: [f64; 3],
    pub fov: f64,
    pub lens: Option<(f64, f64)>,
    pub options: RenderOptions,
}

/// What came out.
pub struct Outcome {
    pub image: Vec<f64>,
    /// By leaf.
    pub gradients: Vec<(String, Vec<f64>)>,
}

impl Outcome {
    /// Names the first value that is not finite.
    pub fn not_finite(&self) -> Option<String> {
        let bad = |values: &[f64]| values.iter().position(|v| !v.is_finite());
        if let Some(i) = bad(&self.image) {
            return Some(format!("image[{i}] is {}", self.image[i]));
        }
        self.gradients.iter().find_map(|(name, values)| {
            bad(values).map(|i| format!("gradient of {name}[{i}] is {}", values[i]))
        })
    }

    pub fn gradient(&self, name: &str) -> &[f64] {
        let found = self.gradients.iter().find(|(n, _)| n == name);
        &found.unwrap_or_else(|| panic!("no leaf {name}")).1
    }

    pub fn mean(&self) -> f64 {
        self.image.iter().sum::<f64>() / self.image.len() as f64
    }
}

/// What went wrong with which scenes.
#[derive(Default)]
pub struct Failures(Vec<String>);

impl Failures {
    /// Notes an error, or the first value that is not finite.
    pub fn note(&mut self, name: &str, result: softray::Result<Outcome>) {
        let what = match result {
            Ok(outcome) => outcome.not_finite(),
            Err(error) => Some(error.to_string()),
        };
        self.0.extend(what.map(|what| format!("{name}: {what}")));
    }

    #[track_caller]
    pub fn assert_none(&self) {
        let Self(all) = self;
        assert!(all.is_empty(), "{}:\n{}", all.len(), all.join("\n"));
    }
}

type Read = Box<dyn Fn(&Gradients) -> Vec<f64>>;

/// Makes leaves and remembers them.
struct Leaves {
    device: Device,
    dtype: DType,
    list: Vec<(String, Read)>,
}

impl Leaves {
    fn make<const D: usize>(&mut self, name: String, v: Vec<f64>, shape: [usize; D]) -> Tensor<D> {
        let leaf = tensor(&v, shape, &self.device, self.dtype)
            .autodiff()
            .require_grad();
        let read = leaf.clone();
        let count = shape.iter().product();
        self.list.push((
            name,
            Box::new(move |g| {
                read.grad(g)
                    .map_or(vec![0.0; count], |g| crate::common::values(&g))
            }),
        ));
        leaf
    }
}

impl World {
    /// A floor, a ball, a triangle and a light: all kinds of parameters but lens, motion and
    /// texture, seen from above.
    pub fn new() -> Self {
        let device = Device::flex();
        let light = facing_down([-0.5, 0.5], [-0.5, 0.5], 2.5, &device);
        let slope = [[-1.2, 0.3, 0.4], [-0.3, 0.4, 0.8], [-0.6, 1.2, 0.1]];
        let mut ball = Thing::shape("ball", shapes::icosahedron(&device), [0.4, 0.7, 0.0], 0.6);
        ball.gloss = Some(([0.3, 0.3, 0.3], 20.0));
        Self {
            things: vec![
                Thing::shape("floor", floor(2.0, 0.0, &device), [0.0; 3], 1.0),
                ball,
                Thing::triangle("triangle", slope),
                Thing::shape("light", light, [0.0; 3], 1.0).emitting([4.0, 3.5, 3.0]),
            ],
            environment: [0.3, 0.4, 0.5],
            eye: [0.3, 1.6, 4.0],
            target: [0.0, 0.7, 0.0],
            up: [0.0, 1.0, 0.0],
            fov: 40.0,
            lens: None,
            options: RenderOptions::new(8, 8)
                .with_samples(4)
                .with_bounces(2)
                .with_seed(3),
        }
    }

    pub fn with(mut self, f: impl FnOnce(&mut Self)) -> Self {
        f(&mut self);
        self
    }

    pub fn thing(&mut self, name: &str) -> &mut Thing {
        let found = self.things.iter_mut().find(|t| t.name == name);
        found.unwrap_or_else(|| panic!("nothing is called {name}"))
    }

    /// Every point moved.
    pub fn mapped(mut self, f: impl Fn([f64; 3]) -> [f64; 3]) -> Self {
        for t in &mut self.things {
            t.vertices.iter_mut().for_each(|v| *v = f(*v));
        }
        self.eye = f(self.eye);
        self.target = f(self.target);
        self
    }

    fn build(&self, leaves: &mut Leaves) -> (Scene, Camera) {
        let mut scene = Scene::new();
        for t in &self.things {
            let name = |field: &str| format!("{} {field}", t.name);
            let rows = |v: &[[f64; 3]]| v.iter().flatten().copied().collect::<Vec<_>>();
            let vertices = rows(&t.vertices);
            let vertices = leaves.make(name("vertices"), vertices, [t.vertices.len(), 3]);
            let mut mesh = Mesh::new(vertices, t.faces.clone());
            let diffuse: ColorTexture = match &t.texture {
                Some(([h, w], texels, uvs)) => {
                    let flat = uvs.iter().flatten().copied().collect();
                    mesh = mesh.with_uvs(leaves.make(name("uvs"), flat, [uvs.len(), 2]));
                    let texels = leaves.make(name("texels"), texels.clone(), [*h, *w, 3]);
                    ColorTexture::texture(texels)
                }
                None => leaves.make(name("diffuse"), t.diffuse.to_vec(), [3]).into(),
            };
            let mut material = match t.gloss {
                Some((specular, shininess)) => {
                    let specular = leaves.make(name("specular"), specular.to_vec(), [3]);
                    let shininess = leaves.make(name("shininess"), vec![shininess], [1]);
                    Material::phong(diffuse, specular, shininess)
                }
                None => Material::diffuse(diffuse),
            };
            if let Some(emission) = t.emission {
                let emission = leaves.make(name("emission"), emission.to_vec(), [3]);
                material = material.with_emission(emission);
            }
            let mut object = Object::new(mesh).with_name(t.name).with_material(material);
            if let Some(v) = t.velocity {
                object = object.with_velocity(leaves.make(name("velocity"), v.to_vec(), [3]));
            }
            scene = scene.with_object(object);
        }
        let environment = self.environment.to_vec();
        let scene = scene.with_environment(leaves.make("environment".into(), environment, [3]));
        let eye = leaves.make("eye".into(), self.eye.to_vec(), [3]);
        let target = leaves.make("target".into(), self.target.to_vec(), [3]);
        let up = leaves.make("up".into(), self.up.to_vec(), [3]);
        let fov = leaves.make("fov".into(), vec![self.fov], [1]);
        let mut camera = Camera::look_at(eye, target).with_up(up).with_fov_y(fov);
        if let Some((aperture, focus)) = self.lens {
            let aperture = leaves.make("aperture".into(), vec![aperture], [1]);
            let focus = leaves.make("focus".into(), vec![focus], [1]);
            camera = camera.with_thin_lens(aperture, focus);
        }
        (scene, camera)
    }

    /// Renders, and differentiates the mean radiance under weights that rise across the image.
    pub fn run(&self, device: &Device, dtype: DType) -> softray::Result<Outcome> {
        let mut leaves = Leaves {
            device: device.clone(),
            dtype,
            list: Vec::new(),
        };
        let (scene, camera) = self.build(&mut leaves);
        let image = render(&scene, &camera, &self.options)?.radiance;
        let values = crate::common::values(&image);
        let weight = |i: usize| 0.5 + i as f64 / values.len() as f64;
        let weights: Vec<f64> = (0..values.len()).map(weight).collect();
        let weights = tensor(&weights, image.dims(), device, dtype);
        let gradients = (image * weights).mean().backward();
        Ok(Outcome {
            image: values,
            gradients: leaves
                .list
                .into_iter()
                .map(|(name, read)| (name, read(&gradients)))
                .collect(),
        })
    }
}
