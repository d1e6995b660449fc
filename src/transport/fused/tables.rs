//! What an image depends on, in one table, and sums of derivatives by its parts.

use burn::tensor::Tensor;
use glam::{DVec2, DVec3};

use super::surface::HostAlbedos;
use crate::error::Result;
use crate::geometry::{Vec3, VertexData, host_values, host_vectors};
use crate::scene::{Albedos, CameraFrame, Flattened, SkyTensors};
use crate::transport::Sky;
use crate::transport::sky::SkyMap;

/// The parts of the table that are in a graph, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    /// Corners a, b, c of each triangle `[T, 9]`.
    Corners,
    /// `[T, 3]`.
    Velocity,
    /// Texture coordinates of the corners `[T, 6]`.
    Uvs,
    /// Shading normals of the corners `[T, 9]`.
    Normals,
    /// `[M, 3]`, and texels `[A, 3]`.
    Diffuse,
    DiffuseTexels,
    Specular,
    SpecularTexels,
    /// `[M]`.
    Exponent,
    /// `[M, 3]`.
    Emission,
    /// `[3]`, or texels `[A, 3]`.
    Sky,
    /// Eye, forward, right, up `[12]`, half height, aperture and focus.
    Camera,
}

/// Materials, environment and camera on the host, and the table of what is in a graph.
pub(crate) struct Tables {
    pub(super) host: Host,
    parts: Vec<Part>,
    parent: Option<Tensor<1>>,
    triangles: usize,
    /// Whether the camera's part has a lens, used or not.
    lens: bool,
    /// Whether rays and surfaces they meet have derivatives.
    pub(super) rays: bool,
}

/// What rays find, on the host.
pub(super) struct Host {
    pub diffuse: HostAlbedos,
    /// k_s and exponents, if any material is glossy.
    pub specular: Option<(HostAlbedos, Vec<f64>)>,
    pub emission: Vec<DVec3>,
    pub sky: Option<HostSky>,
    pub moves: bool,
    /// Texture coordinates of the corners, if anything has a texture.
    pub uvs: Option<Vec<[DVec2; 3]>>,
    /// Shading normals of the corners, and which triangles have them.
    pub normals: Option<(Vec<[DVec3; 3]>, Vec<bool>)>,
}

/// An environment on the host.
pub(super) enum HostSky {
    Constant(DVec3),
    Map(Box<SkyMap>),
}

impl HostSky {
    /// Radiance along a direction.
    #[inline]
    pub fn at(&self, direction: DVec3) -> DVec3 {
        match self {
            Self::Constant(radiance) => *radiance,
            Self::Map(map) => map.at(direction),
        }
    }

    /// Adds derivatives of g·radiance; returns that by the direction.
    #[inline]
    pub fn pull(&self, direction: DVec3, g: DVec3, sums: &mut [DVec3]) -> DVec3 {
        match self {
            Self::Constant(_) => {
                sums[0] += g;
                DVec3::ZERO
            }
            Self::Map(map) => map.pull(direction, g, sums),
        }
    }

    pub fn map(&self) -> Option<&SkyMap> {
        match self {
            Self::Constant(_) => None,
            Self::Map(map) => Some(map),
        }
    }

    fn len(&self) -> usize {
        self.map().map_or(1, SkyMap::len)
    }
}

impl Host {
    fn new(scene: &Flattened, sky: Option<Sky>) -> Result<Self> {
        let materials = &scene.materials;
        let albedos = |a: &Albedos| -> Result<HostAlbedos> {
            Ok(HostAlbedos {
                constant: host_vectors(&a.constant)?,
                texture: a.texture.clone(),
                atlas: match &a.atlas {
                    Some(atlas) => host_vectors(atlas)?,
                    None => Vec::new(),
                },
            })
        };
        let corners = |v: &VertexData| -> Result<Vec<[DVec3; 3]>> {
            let (a, b, c) = (
                host_vectors(&v.a)?,
                host_vectors(&v.b)?,
                host_vectors(&v.c)?,
            );
            Ok((0..a.len()).map(|k| [a[k], b[k], c[k]]).collect())
        };
        let specular = match &materials.specular {
            Some((specular, exponent)) => Some((albedos(specular)?, host_values(exponent)?)),
            None => None,
        };
        let uvs = scene.uvs.as_ref().map(corners).transpose()?;
        let normals = match &scene.normals {
            Some((normals, smooth)) => Some((corners(normals)?, smooth.clone())),
            None => None,
        };
        Ok(Self {
            diffuse: albedos(&materials.diffuse)?,
            specular,
            emission: host_vectors(&materials.emission)?,
            sky: match sky {
                Some(Sky::Constant(sky)) => Some(HostSky::Constant(host_vectors(&sky)?[0])),
                Some(Sky::Map(map)) => Some(HostSky::Map(Box::new(map))),
                None => None,
            },
            moves: scene.triangles.velocity.is_some(),
            uvs: uvs.map(|list| {
                let flat = |c: [DVec3; 3]| c.map(|v| v.truncate());
                list.into_iter().map(flat).collect()
            }),
            normals,
        })
    }
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
    pub(super) fn new(scene: &Flattened, sky: Option<Sky>, camera: &CameraFrame) -> Result<Self> {
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
        let of_vector = |v: &Vec3| [v.x.clone(), v.y.clone(), v.z.clone()];
        let of_corners = |v: &VertexData, width: usize| -> Vec<Tensor<2>> {
            let corners = [&v.a, &v.b, &v.c].into_iter();
            corners
                .flat_map(|c| of_vector(c).into_iter().take(width))
                .collect()
        };
        let mut all: Vec<(Part, Vec<Tensor<2>>)> =
            vec![(Part::Corners, of_corners(&triangles.corners, 3))];
        if let Some(velocity) = &triangles.velocity {
            all.push((Part::Velocity, of_vector(velocity).to_vec()));
        }
        if let Some(uvs) = &scene.uvs {
            all.push((Part::Uvs, of_corners(uvs, 2)));
        }
        if let Some((normals, _)) = &scene.normals {
            all.push((Part::Normals, of_corners(normals, 3)));
        }
        let mut albedos = |albedos: &Albedos, constant: Part, texels: Part| {
            all.push((constant, of_vector(&albedos.constant).to_vec()));
            if let Some(atlas) = &albedos.atlas {
                all.push((texels, of_vector(atlas).to_vec()));
            }
        };
        albedos(&materials.diffuse, Part::Diffuse, Part::DiffuseTexels);
        if let Some((specular, exponent)) = &materials.specular {
            albedos(specular, Part::Specular, Part::SpecularTexels);
            all.push((Part::Exponent, vec![exponent.clone()]));
        }
        all.push((Part::Emission, of_vector(&materials.emission).to_vec()));
        let shining = match &scene.environment {
            Some(SkyTensors::Constant(radiance)) => Some(radiance),
            Some(SkyTensors::Map(map)) => Some(&map.texels),
            None => None,
        };
        all.extend(shining.map(|v| (Part::Sky, of_vector(v).to_vec())));
        for (part, planes) in &all {
            add(*part, &planes.iter().collect::<Vec<_>>());
        }
        let mut planes: Vec<&Tensor<2>> = Vec::new();
        for v in [&camera.eye, &camera.forward, &camera.right, &camera.up] {
            planes.extend([&v.x, &v.y, &v.z]);
        }
        planes.push(&camera.half_height);
        planes.extend(camera.lens.iter().flatten());
        add(Part::Camera, &planes);
        Ok(Self {
            host: Host::new(scene, sky)?,
            // Normals and the exponent turn the directions that are drawn.
            rays: parts.iter().any(|p| {
                use Part::{Camera, Corners, Exponent, Normals, Velocity};
                [Corners, Velocity, Camera, Exponent, Normals].contains(p)
            }),
            parent: (!list.is_empty()).then(|| Tensor::cat(list, 0)),
            parts,
            triangles: triangles.len(),
            lens: camera.lens.is_some(),
        })
    }

    /// What is in a graph, in one row; None if nothing is. It can be taken once.
    pub(crate) fn take_parent(&mut self) -> Option<Tensor<1>> {
        self.parent.take()
    }

    /// Sums of derivatives, all 0.
    pub(crate) fn sums(&self) -> Sums {
        let triangles = if self.rays { self.triangles } else { 0 };
        let host = &self.host;
        let materials = host.emission.len();
        let atlas = |a: &HostAlbedos| vec![DVec3::ZERO; a.atlas.len()];
        Sums {
            corners: vec![[DVec3::ZERO; 3]; triangles],
            normal: vec![DVec3::ZERO; triangles],
            area: vec![0.0; triangles],
            velocity: vec![DVec3::ZERO; if host.moves { triangles } else { 0 }],
            uvs: vec![[DVec2::ZERO; 3]; host.uvs.as_ref().map_or(0, Vec::len)],
            normals: vec![[DVec3::ZERO; 3]; host.normals.as_ref().map_or(0, |n| n.0.len())],
            diffuse: vec![DVec3::ZERO; materials],
            diffuse_texels: atlas(&host.diffuse),
            specular: vec![DVec3::ZERO; materials],
            specular_texels: host
                .specular
                .as_ref()
                .map_or_else(Vec::new, |s| atlas(&s.0)),
            exponent: vec![0.0; materials],
            emission: vec![DVec3::ZERO; materials],
            sky: vec![DVec3::ZERO; host.sky.as_ref().map_or(0, HostSky::len)],
            camera: CameraSums::default(),
        }
    }

    /// How many numbers the sums have.
    pub(crate) fn size(&self) -> usize {
        let host = &self.host;
        let texels = host.specular.as_ref().map_or(0, |s| s.0.atlas.len());
        let texels = texels + host.diffuse.atlas.len() + host.sky.as_ref().map_or(0, HostSky::len);
        31 * self.triangles + 10 * host.emission.len() + 3 * texels + 18
    }

    /// The derivatives by the table, from sums whose normals and areas were resolved.
    pub(super) fn flatten(&self, sums: &Sums) -> Vec<f64> {
        let mut all = Vec::new();
        let vectors = |all: &mut Vec<f64>, list: &[DVec3]| {
            all.extend(list.iter().flat_map(|v| v.to_array()));
        };
        for part in &self.parts {
            match part {
                Part::Corners => sums.corners.iter().for_each(|c| vectors(&mut all, c)),
                Part::Velocity => vectors(&mut all, &sums.velocity),
                Part::Uvs => {
                    let corners = sums.uvs.iter().flatten();
                    all.extend(corners.flat_map(|v| v.to_array()));
                }
                Part::Normals => sums.normals.iter().for_each(|c| vectors(&mut all, c)),
                Part::Diffuse => vectors(&mut all, &sums.diffuse),
                Part::DiffuseTexels => vectors(&mut all, &sums.diffuse_texels),
                Part::Specular => vectors(&mut all, &sums.specular),
                Part::SpecularTexels => vectors(&mut all, &sums.specular_texels),
                Part::Exponent => all.extend(&sums.exponent),
                Part::Emission => vectors(&mut all, &sums.emission),
                Part::Sky => vectors(&mut all, &sums.sky),
                Part::Camera => {
                    let c = &sums.camera;
                    vectors(&mut all, &[c.eye, c.forward, c.right, c.up]);
                    all.push(c.half_height);
                    if self.lens {
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
    pub uvs: Vec<[DVec2; 3]>,
    pub normals: Vec<[DVec3; 3]>,
    pub diffuse: Vec<DVec3>,
    pub diffuse_texels: Vec<DVec3>,
    pub specular: Vec<DVec3>,
    pub specular_texels: Vec<DVec3>,
    pub exponent: Vec<f64>,
    pub emission: Vec<DVec3>,
    pub sky: Vec<DVec3>,
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
        for (a, b) in self.uvs.iter_mut().zip(&o.uvs) {
            each(a, b);
        }
        for (a, b) in self.normals.iter_mut().zip(&o.normals) {
            each(a, b);
        }
        each(&mut self.diffuse, &o.diffuse);
        each(&mut self.diffuse_texels, &o.diffuse_texels);
        each(&mut self.specular, &o.specular);
        each(&mut self.specular_texels, &o.specular_texels);
        each(&mut self.exponent, &o.exponent);
        each(&mut self.emission, &o.emission);
        each(&mut self.sky, &o.sky);
        let (a, b) = (&mut self.camera, &o.camera);
        a.eye += b.eye;
        a.forward += b.forward;
        a.right += b.right;
        a.up += b.up;
        a.half_height += b.half_height;
        each(&mut a.lens, &b.lens);
    }
}
