//! What is rendered. Every scene has an object that moves, a `light` and a `floor`: what the
//! gradients are of.

use std::path::Path;

use burn::tensor::{DType, TensorData};
use clap::ValueEnum;
use softray::prelude::*;
use softray::scene::Flattened;

use crate::{Outcome, data};

/// The scenes by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Subject {
    /// The Cornell box, 1 bounce; the short block moves.
    Cornell,
    /// The same with 3 bounces.
    Cornell3,
    /// A triangle that the camera does not see and its shadow, no bounce; the triangle moves.
    Shadow,
    /// A ball of 320 faces under a light and a sky, 1 bounce; the ball moves.
    Sphere,
    /// Three balls through a thin lens, 1 bounce; the middle one moves.
    Lens,
    /// A ball of gloss, 1 bounce; the ball moves.
    GlossySphere,
    /// A ball in motion, 1 bounce; it moves as a whole.
    Motion,
    /// Made here: a ball of gloss between a textured floor and a wall under a large dim light and
    /// a small bright one, 1 bounce; the ball moves.
    Textured,
    /// Made here: a ball of 20,480 faces on a floor under a light, 1 bounce; the ball moves.
    Icosphere,
}

/// What is measured unless scenes are named.
pub const USUAL: [Subject; 7] = [
    Subject::Cornell,
    Subject::Shadow,
    Subject::Sphere,
    Subject::Lens,
    Subject::GlossySphere,
    Subject::Textured,
    Subject::Icosphere,
];

/// The parameters θ of a gradient, all 0 in the scene as it is.
pub const PARAMETERS: usize = 5;

/// A parameter of 1 is 1 %: of the radius of the scene for the translation, of itself for emission
/// and albedo. So the components of a gradient are changes of the objective by changes of the
/// scene that are about as noticeable.
const UNIT: f64 = 0.01;

/// A scene on a device, in a float type.
pub struct World {
    pub bounces: u32,
    pub width: usize,
    pub height: usize,
    pub faces: usize,
    pub camera: Camera,
    /// As it is: without a tensor beside meshes and textures.
    pub scene: Scene,
    /// Of the scene as it is; held fixed wherever something moves.
    pub bounds: Bounds,
    moving: &'static str,
}

impl Subject {
    pub fn name(self) -> String {
        crate::settings::name(&self)
    }

    /// Folder, bounces and the object that moves.
    fn file(self) -> Option<(&'static str, u32, &'static str)> {
        match self {
            Self::Cornell => Some(("cornell", 1, "short")),
            Self::Cornell3 => Some(("cornell", 3, "short")),
            Self::Shadow => Some(("shadow", 0, "occluder")),
            Self::Sphere => Some(("sphere", 1, "sphere")),
            Self::Lens => Some(("lens", 1, "ball1")),
            Self::GlossySphere => Some(("glossy_sphere", 1, "sphere")),
            Self::Motion => Some(("motion", 1, "sphere")),
            Self::Textured | Self::Icosphere => None,
        }
    }

    /// The reference of an independent renderer without blur; none of the scenes made here.
    pub fn reference(self) -> Outcome<Option<HostImage>> {
        let Some((folder, bounces, _)) = self.file() else {
            return Ok(None);
        };
        let path = data(Path::new(folder)).join(format!("bounces-{bounces}.exr"));
        Ok(Some(HostImage::read(path)?))
    }

    /// Whether a setting suits the scene: fine meshes are left out where a ray would meet hundreds
    /// of faces (edges shorter than the blur, of which docs/VISIBILITY.md says that they don't
    /// converge to the unblurred image anyway).
    pub fn suits(self, setting: &crate::settings::Setting) -> bool {
        self != Self::Icosphere || setting.reach() < 0.05
    }

    pub fn build(self, device: &Device, dtype: DType) -> Outcome<World> {
        let (file, bounces, moving) = match self.file() {
            Some((folder, bounces, moving)) => {
                let path = data(Path::new(folder)).join("scene.json");
                (SceneFile::load(path, device)?, bounces, moving)
            }
            None => (made(self, device), 1, "ball"),
        };
        let mut scene = file.scene;
        for object in &mut scene.objects {
            object.mesh = object.mesh.clone().cast(dtype);
            for material in &mut object.materials {
                for albedo in [&mut material.diffuse, &mut material.specular] {
                    if let Albedo::Texture { texels, .. } = albedo {
                        *texels = texels.clone().cast(dtype);
                    }
                }
            }
        }
        for name in [moving, "light", "floor"] {
            assert!(scene.object(name).is_some(), "{self:?} has no {name}");
        }
        Ok(World {
            bounces,
            width: file.width,
            height: file.height,
            faces: scene.objects.iter().map(|o| o.mesh.faces.len()).sum(),
            bounds: Flattened::new(&scene, &file.camera, None)?.bounds,
            camera: file.camera,
            scene,
            moving,
        })
    }
}

impl World {
    /// A tensor of parameters for [`at`](Self::at).
    pub fn parameters(&self, values: [f64; PARAMETERS]) -> Tensor<1> {
        let vertices = &self.scene.objects[0].mesh.vertices;
        let data = TensorData::new(values.to_vec(), [PARAMETERS]);
        Tensor::from_data(data, (&vertices.device(), vertices.dtype()))
    }

    /// The scene at parameters θ `[5]`, in their graph: the moving object translated by
    /// (θ₀, θ₁, θ₂) per cent of the scene's radius, the emission of `light` brighter by θ₃ per
    /// cent, the albedo of `floor` by θ₄ per cent.
    pub fn at(&self, theta: &Tensor<1>) -> Scene {
        let offset = theta.clone().slice([0..3]) * (UNIT * self.bounds.radius);
        let factor = |i: usize| theta.clone().slice([i..i + 1]) * UNIT + 1.0;
        let scaled = |p: &Parameter<3>| {
            let Parameter::Constant(rgb) = p else {
                panic!("the colours of these scenes are numbers");
            };
            let device = theta.device().inner();
            let data = TensorData::new(rgb.to_vec(), [3]);
            Tensor::<1>::from_data(data, (&device, theta.dtype()))
        };
        self.scene
            .clone()
            .map_object(self.moving, |o| {
                o.map_mesh(|m| m.translated(offset.clone()))
            })
            .map_object("light", |mut o| {
                for material in &mut o.materials {
                    let emission = scaled(&material.emission) * factor(3).expand([3]);
                    material.emission = Parameter::Tensor(emission);
                }
                o
            })
            .map_object("floor", |mut o| {
                for material in &mut o.materials {
                    material.diffuse = match &material.diffuse {
                        Albedo::Constant(p) => (scaled(p) * factor(4).expand([3])).into(),
                        Albedo::Texture { texels, wrap } => Albedo::Texture {
                            texels: texels.clone()
                                * factor(4).reshape([1, 1, 1]).expand(texels.dims()),
                            wrap: *wrap,
                        },
                    };
                }
                o
            })
    }
}

fn made(subject: Subject, device: &Device) -> SceneFile {
    let quad = |name: &str, [a, b, c, d]: [[f64; 3]; 4], material: Material| {
        Object::new(shapes::quad(a, b, c, d, device))
            .named(name)
            .material(material)
    };
    let flat = |name: &str, y: f64, [x0, x1, z0, z1]: [f64; 4], up: bool, material: Material| {
        let mut corners = [[x0, y, z1], [x1, y, z1], [x1, y, z0], [x0, y, z0]];
        if !up {
            corners.reverse();
        }
        quad(name, corners, material)
    };
    let ball = |subdivisions: u32, radius: f64, centre: [f32; 3]| {
        shapes::icosphere(subdivisions, device)
            .scaled(Tensor::from_floats([radius as f32], device))
            .translated(Tensor::from_floats(centre, device))
    };
    let scene = if subject == Subject::Textured {
        let floor = Material::diffuse(Albedo::texture(pattern(device)));
        let wall = [[-3., 0., -2.], [3., 0., -2.], [3., 4., -2.], [-3., 4., -2.]];
        let gloss = Material::diffuse([0.2, 0.3, 0.5]).specular([0.4; 3], 30.0);
        let large = Material::emitter([3.0, 2.7, 2.2]);
        let small = Material::emitter([60.0, 50.0, 40.0]);
        Scene::new()
            .with(flat("floor", 0.0, [-3.0, 3.0, -2.0, 3.0], true, floor))
            .with(quad("wall", wall, Material::diffuse([0.6, 0.5, 0.5])))
            .with(
                Object::new(ball(2, 0.7, [0.1, 0.8, 0.0]))
                    .named("ball")
                    .material(gloss),
            )
            .with(flat("light", 3.9, [-1.2, 1.2, -1.0, 1.4], false, large))
            .with(flat("lamp", 2.2, [1.3, 1.5, 0.6, 0.8], false, small))
    } else {
        let blue = Material::diffuse([0.3, 0.5, 0.8]);
        let light = Material::emitter([20.0, 18.0, 15.0]);
        Scene::new()
            .with(flat(
                "floor",
                0.0,
                [-3.0, 3.0, -3.0, 3.0],
                true,
                Material::diffuse([0.6, 0.5, 0.4]),
            ))
            .with(
                Object::new(ball(5, 0.8, [0.0, 0.9, 0.0]))
                    .named("ball")
                    .material(blue),
            )
            .with(flat("light", 3.5, [-0.3, 0.5, -0.3, 0.5], false, light))
    };
    SceneFile {
        scene,
        camera: Camera::look_at([0.0, 1.8, 4.5], [0.0, 0.8, 0.0]).fov_y(40.0),
        width: 64,
        height: 64,
    }
}

/// A smooth pattern of 32 × 32 texels.
fn pattern(device: &Device) -> Tensor<3> {
    const SIZE: usize = 32;
    let texels: Vec<f32> = (0..SIZE * SIZE)
        .flat_map(|i| {
            let angle = |k: usize| k as f32 / SIZE as f32 * std::f32::consts::TAU;
            let wave = (2.0 * angle(i % SIZE)).sin() * (3.0 * angle(i / SIZE)).cos();
            [0.45 + 0.3 * wave, 0.45 - 0.25 * wave, 0.4]
        })
        .collect();
    Tensor::from_data(TensorData::new(texels, [SIZE, SIZE, 3]), device)
}
