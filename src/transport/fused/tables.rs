//! What an image depends on, in one table, and sums of derivatives by its parts.

use burn::tensor::Tensor;
use glam::DVec3;

use crate::error::Result;
use crate::geometry::{Vec3, host_values, host_vectors};
use crate::scene::{CameraFrame, Flattened, SkyTensors};

/// The parts of the table that are in a graph, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    /// Corners a, b, c of each triangle `[T, 9]`.
    Corners,
    /// `[T, 3]`.
    Velocity,
    /// `[M, 3]`.
    Diffuse,
    Specular,
    /// `[M]`.
    Exponent,
    /// `[M, 3]`.
    Emission,
    /// `[3]`.
    Sky,
    /// Eye, forward, right, up `[12]`, half height, aperture and focus.
    Camera,
}

/// Materials, environment and camera on the host, and the table of what is in a graph.
pub(crate) struct Tables {
    pub(super) diffuse: Vec<DVec3>,
    /// k_s and exponents, if any material is glossy.
    pub(super) specular: Option<(Vec<DVec3>, Vec<f64>)>,
    pub(super) emission: Vec<DVec3>,
    pub(super) sky: Option<DVec3>,
    pub(super) moves: bool,
    parts: Vec<Part>,
    parent: Option<Tensor<1>>,
    triangles: usize,
    /// Whether rays and surfaces they meet have derivatives.
    pub(super) rays: bool,
}

/// A camera on the host.
pub(crate) struct HostCamera {
    pub(super) eye: DVec3,
    pub(super) forward: DVec3,
    pub(super) right: DVec3,
    pub(super) up: DVec3,
    pub(super) half_height: f64,
    /// Aperture radius and focus distance.
    pub(super) lens: Option<[f64; 2]>,
}

impl HostCamera {
    pub(super) fn new(frame: &CameraFrame, has_lens: bool) -> Result<Self> {
        let vector = |v: &Vec3| Ok(host_vectors(v)?[0]);
        let number = |v: &Tensor<2>| Ok(host_values(v)?[0]);
        let lens = match &frame.lens {
            Some([aperture, focus]) if has_lens => Some([number(aperture)?, number(focus)?]),
            _ => None,
        };
        Ok(Self {
            eye: vector(&frame.eye)?,
            forward: vector(&frame.forward)?,
            right: vector(&frame.right)?,
            up: vector(&frame.up)?,
            half_height: number(&frame.half_height)?,
            lens,
        })
    }
}

impl Tables {
    pub(super) fn new(scene: &Flattened, camera: &CameraFrame) -> Result<Self> {
        let triangles = &scene.triangles;
        let materials = &scene.materials;
        let (mut parts, mut list) = (Vec::new(), Vec::new());
        // A part is there as a whole if any of it is in a graph.
        let mut add = |part: Part, planes: &[&Tensor<2>]| {
            if planes.iter().any(|p| p.is_tracked()) {
                parts.push(part);
                let columns = planes.iter().map(|p| {
                    let [a, b] = p.dims();
                    (*p).clone().reshape([a * b, 1])
                });
                let table = Tensor::cat(columns.collect(), 1);
                let [a, b] = table.dims();
                list.push(table.reshape([a * b]));
            }
        };
        let c = &triangles.corners;
        add(
            Part::Corners,
            &[
                &c.a.x, &c.a.y, &c.a.z, &c.b.x, &c.b.y, &c.b.z, &c.c.x, &c.c.y, &c.c.z,
            ],
        );
        let vector = |v: &Vec3| [v.x.clone(), v.y.clone(), v.z.clone()];
        let mut add_vector = |part: Part, v: &Vec3| {
            let [x, y, z] = vector(v);
            add(part, &[&x, &y, &z]);
        };
        if let Some(velocity) = &triangles.velocity {
            add_vector(Part::Velocity, velocity);
        }
        add_vector(Part::Diffuse, &materials.diffuse.constant);
        if let Some((specular, exponent)) = &materials.specular {
            add_vector(Part::Specular, &specular.constant);
            add(Part::Exponent, &[exponent]);
        }
        let mut add_vector = |part: Part, v: &Vec3| {
            let [x, y, z] = vector(v);
            add(part, &[&x, &y, &z]);
        };
        add_vector(Part::Emission, &materials.emission);
        let sky = match &scene.environment {
            Some(SkyTensors::Constant(sky)) => {
                add_vector(Part::Sky, sky);
                Some(host_vectors(sky)?[0])
            }
            _ => None,
        };
        let mut planes: Vec<&Tensor<2>> = Vec::new();
        for v in [&camera.eye, &camera.forward, &camera.right, &camera.up] {
            planes.extend([&v.x, &v.y, &v.z]);
        }
        planes.push(&camera.half_height);
        planes.extend(camera.lens.iter().flatten());
        add(Part::Camera, &planes);
        let specular = match &materials.specular {
            Some((specular, exponent)) => {
                Some((host_vectors(&specular.constant)?, host_values(exponent)?))
            }
            None => None,
        };
        Ok(Self {
            diffuse: host_vectors(&materials.diffuse.constant)?,
            specular,
            emission: host_vectors(&materials.emission)?,
            sky,
            moves: triangles.velocity.is_some(),
            // The exponent turns the directions that are drawn from a lobe.
            rays: parts.iter().any(|p| {
                let turns = [Part::Corners, Part::Velocity, Part::Camera, Part::Exponent];
                turns.contains(p)
            }),
            parent: (!list.is_empty()).then(|| Tensor::cat(list, 0)),
            parts,
            triangles: triangles.len(),
        })
    }

    /// What is in a graph, in one row; None if nothing is. It can be taken once.
    pub(crate) fn take_parent(&mut self) -> Option<Tensor<1>> {
        self.parent.take()
    }

    /// Sums of derivatives, all 0.
    pub(crate) fn sums(&self) -> Sums {
        let triangles = if self.rays { self.triangles } else { 0 };
        let materials = self.diffuse.len();
        Sums {
            corners: vec![[DVec3::ZERO; 3]; triangles],
            normal: vec![DVec3::ZERO; triangles],
            area: vec![0.0; triangles],
            velocity: vec![DVec3::ZERO; if self.moves { triangles } else { 0 }],
            diffuse: vec![DVec3::ZERO; materials],
            specular: vec![DVec3::ZERO; materials],
            exponent: vec![0.0; materials],
            emission: vec![DVec3::ZERO; materials],
            sky: DVec3::ZERO,
            camera: CameraSums::default(),
        }
    }

    /// How many numbers the sums have.
    pub(crate) fn size(&self) -> usize {
        16 * self.triangles + 10 * self.diffuse.len() + 18
    }

    /// The derivatives by the table, from sums whose normals and areas were resolved.
    pub(super) fn flatten(&self, sums: &Sums, has_lens: bool) -> Vec<f64> {
        let mut all = Vec::new();
        let vectors = |all: &mut Vec<f64>, list: &[DVec3]| {
            all.extend(list.iter().flat_map(|v| v.to_array()));
        };
        for part in &self.parts {
            match part {
                Part::Corners => sums.corners.iter().for_each(|c| vectors(&mut all, c)),
                Part::Velocity => vectors(&mut all, &sums.velocity),
                Part::Diffuse => vectors(&mut all, &sums.diffuse),
                Part::Specular => vectors(&mut all, &sums.specular),
                Part::Exponent => all.extend(&sums.exponent),
                Part::Emission => vectors(&mut all, &sums.emission),
                Part::Sky => vectors(&mut all, &[sums.sky]),
                Part::Camera => {
                    let c = &sums.camera;
                    vectors(&mut all, &[c.eye, c.forward, c.right, c.up]);
                    all.push(c.half_height);
                    if has_lens {
                        all.extend(c.lens);
                    }
                }
            }
        }
        all
    }
}

/// Sums of derivatives by what a scene is made of.
pub(crate) struct Sums {
    pub corners: Vec<[DVec3; 3]>,
    pub normal: Vec<DVec3>,
    pub area: Vec<f64>,
    pub velocity: Vec<DVec3>,
    pub diffuse: Vec<DVec3>,
    pub specular: Vec<DVec3>,
    pub exponent: Vec<f64>,
    pub emission: Vec<DVec3>,
    pub sky: DVec3,
    pub camera: CameraSums,
}

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CameraSums {
    pub eye: DVec3,
    pub forward: DVec3,
    pub right: DVec3,
    pub up: DVec3,
    pub half_height: f64,
    pub lens: [f64; 2],
}

impl Sums {
    /// Adds others.
    pub fn add(&mut self, o: &Self) {
        fn each<T: Copy + std::ops::AddAssign>(a: &mut [T], b: &[T]) {
            a.iter_mut().zip(b).for_each(|(a, b)| *a += *b);
        }
        for (a, b) in self.corners.iter_mut().zip(&o.corners) {
            each(a, b);
        }
        each(&mut self.normal, &o.normal);
        each(&mut self.area, &o.area);
        each(&mut self.velocity, &o.velocity);
        each(&mut self.diffuse, &o.diffuse);
        each(&mut self.specular, &o.specular);
        each(&mut self.exponent, &o.exponent);
        each(&mut self.emission, &o.emission);
        self.sky += o.sky;
        let (a, b) = (&mut self.camera, &o.camera);
        a.eye += b.eye;
        a.forward += b.forward;
        a.right += b.right;
        a.up += b.up;
        a.half_height += b.half_height;
        each(&mut a.lens, &b.lens);
    }
}
