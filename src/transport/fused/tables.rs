//! What an image depends on, in one table, and sums of derivatives by its parts.

use std::sync::Arc;

use burn::tensor::Tensor;
use glam::{DVec2, DVec3};

use super::sums::{CameraSums, Sums};
use super::surface::HostAlbedos;
use crate::error::Result;
use crate::geometry::{Vec3, VertexData, host_values, host_vectors};
use crate::scene::{Albedos, Attached, CameraFrame, Flattened, SkyTensors, TrackedMesh};
use crate::transport::Sky;
use crate::transport::sky::SkyMap;

/// The parts of the table that are in a graph, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    /// Vertices of meshes `[V, 3]`, one after another, in scene units.
    Vertices,
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
}

/// Materials and environment on the host, and the table of what is in a graph of all but the camera.
pub(crate) struct Tables {
    pub(super) host: Host,
    parts: Vec<Part>,
    /// Meshes whose vertices are in a graph.
    meshes: Vec<MeshRows>,
    parent: Option<Tensor<1>>,
    triangles: usize,
    /// Scene units.
    unit: f64,
    /// Whether surfaces that rays meet have derivatives.
    rays: bool,
}

/// Where the vertices of a mesh are in the table.
struct MeshRows {
    vertices: usize,
    faces: Arc<Vec<[u32; 3]>>,
    first: usize,
}

/// What rays find, on the host.
pub(crate) struct Host {
    pub(super) diffuse: HostAlbedos,
    /// k_s and exponents, if any material is glossy.
    pub(super) specular: Option<(HostAlbedos, Vec<f64>)>,
    pub(super) emission: Vec<DVec3>,
    pub(super) sky: Option<HostSky>,
    pub(super) moves: bool,
    /// Texture coordinates of the corners, if anything has a texture.
    pub(super) uvs: Option<Vec<[DVec2; 3]>>,
    /// Shading normals of the corners, and which triangles have them.
    pub(super) normals: Option<(Vec<[DVec3; 3]>, Vec<bool>)>,
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
    /// Reads a scene back.
    ///
    /// # Errors
    /// If it can't be read.
    pub(crate) fn new(scene: &Flattened, sky: Option<Sky>) -> Result<Self> {
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
    /// Eye, forward, right, up `[12]`, half height, aperture and focus in one row, if any is in a graph.
    pub(super) parent: Option<Tensor<1>>,
    /// Whether any is.
    pub(super) tracked: bool,
    /// Whether the row has a lens, used or not.
    with_lens: bool,
}

impl HostCamera {
    pub(super) fn new(frame: &CameraFrame, has_lens: bool) -> Result<Self> {
        let vector = |v: &Vec3| Ok(host_vectors(v)?[0]);
        let number = |v: &Tensor<2>| Ok(host_values(v)?[0]);
        let lens = match &frame.lens {
            Some([aperture, focus]) if has_lens => Some([number(aperture)?, number(focus)?]),
            _ => None,
        };
        let mut planes: Vec<&Tensor<2>> = Vec::new();
        for v in [&frame.eye, &frame.forward, &frame.right, &frame.up] {
            planes.extend([&v.x, &v.y, &v.z]);
        }
        planes.push(&frame.half_height);
        planes.extend(frame.lens.iter().flatten());
        let parent = table(&planes);
        Ok(Self {
            eye: vector(&frame.eye)?,
            forward: vector(&frame.forward)?,
            right: vector(&frame.right)?,
            up: vector(&frame.up)?,
            half_height: number(&frame.half_height)?,
            lens,
            tracked: parent.is_some(),
            parent,
            with_lens: frame.lens.is_some(),
        })
    }

    /// The derivatives by the row.
    pub(super) fn flatten(&self, sums: &CameraSums) -> Vec<f64> {
        let vectors = [sums.eye, sums.forward, sums.right, sums.up];
        let mut all: Vec<f64> = vectors.iter().flat_map(|v| v.to_array()).collect();
        all.push(sums.half_height);
        if self.with_lens {
            all.extend(sums.lens);
        }
        all
    }
}

/// Columns side by side in one row, if any of them is in a graph.
fn table(planes: &[&Tensor<2>]) -> Option<Tensor<1>> {
    if !planes.iter().any(|p| p.is_tracked()) {
        return None;
    }
    let columns = planes.iter().map(|p| {
        let [a, b] = p.dims();
        (*p).clone().reshape([a * b, 1])
    });
    let table = Tensor::cat(columns.collect(), 1);
    let [a, b] = table.dims();
    Some(table.reshape([a * b]))
}

impl Tables {
    /// From a scene without tape, and what of it is in a graph; those meshes first whose vertices are in
    /// no row of this table, but of the batch.
    pub(crate) fn new(
        scene: &Flattened,
        host: Host,
        attached: Option<&Attached>,
        meshes: Vec<TrackedMesh>,
    ) -> Self {
        let (mut parts, mut list, mut rows) = (Vec::new(), Vec::new(), Vec::new());
        for mesh in meshes {
            let vertices = mesh.count;
            list.extend(mesh.vertices.map(|v| v.reshape([3 * vertices])));
            rows.push(MeshRows {
                vertices,
                faces: mesh.faces,
                first: mesh.first,
            });
        }
        if !rows.is_empty() {
            parts.push(Part::Vertices);
        }
        // A part is there as a whole if any of it is in a graph.
        for (part, planes) in attached.map(parts_of).unwrap_or_default() {
            if let Some(row) = table(&planes.iter().collect::<Vec<_>>()) {
                parts.push(part);
                list.push(row);
            }
        }
        Self {
            host,
            // Normals and the exponent turn the directions that are drawn.
            rays: parts.iter().any(|p| {
                use Part::{Exponent, Normals, Velocity, Vertices};
                [Vertices, Velocity, Exponent, Normals].contains(p)
            }),
            parent: (!list.is_empty()).then(|| Tensor::cat(list, 0)),
            parts,
            meshes: rows,
            triangles: scene.triangles.len(),
            unit: scene.unit,
        }
    }

    /// What is in a graph, in one row; None if nothing is. It can be taken once.
    pub(crate) fn take_parent(&mut self) -> Option<Tensor<1>> {
        self.parent.take()
    }

    /// Whether surfaces that rays meet have derivatives, seen by a camera.
    pub(super) fn rays(&self, camera: &HostCamera) -> bool {
        self.rays || camera.tracked
    }

    /// Sums of derivatives, all 0, with those of rays or without.
    pub(super) fn sums(&self, rays: bool) -> Sums {
        let triangles = if rays { self.triangles } else { 0 };
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
                Part::Vertices => {
                    for mesh in &self.meshes {
                        vectors(&mut all, &mesh.by_vertices(sums, self.unit));
                    }
                }
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
            }
        }
        all
    }
}

impl MeshRows {
    /// Derivatives by the corners of triangles, summed at their vertices, by scene units.
    fn by_vertices(&self, sums: &Sums, unit: f64) -> Vec<DVec3> {
        let mut rows = vec![DVec3::ZERO; self.vertices];
        for (face, corners) in self.faces.iter().zip(&sums.corners[self.first..]) {
            for (&v, corner) in face.iter().zip(corners) {
                rows[v as usize] += *corner;
            }
        }
        rows.iter_mut().for_each(|row| *row /= unit);
        rows
    }
}

/// All planes of a scene but corners, by part.
fn parts_of(attached: &Attached) -> Vec<(Part, Vec<Tensor<2>>)> {
    let of_vector = |v: &Vec3| [v.x.clone(), v.y.clone(), v.z.clone()];
    let of_corners = |v: &VertexData, width: usize| -> Vec<Tensor<2>> {
        let corners = [&v.a, &v.b, &v.c].into_iter();
        corners
            .flat_map(|c| of_vector(c).into_iter().take(width))
            .collect()
    };
    let mut all: Vec<(Part, Vec<Tensor<2>>)> = Vec::new();
    if let Some(velocity) = &attached.velocity {
        all.push((Part::Velocity, of_vector(velocity).to_vec()));
    }
    if let Some(uvs) = &attached.uvs {
        all.push((Part::Uvs, of_corners(uvs, 2)));
    }
    if let Some((normals, _)) = &attached.normals {
        all.push((Part::Normals, of_corners(normals, 3)));
    }
    let mut albedos = |albedos: &Albedos, constant: Part, texels: Part| {
        all.push((constant, of_vector(&albedos.constant).to_vec()));
        if let Some(atlas) = &albedos.atlas {
            all.push((texels, of_vector(atlas).to_vec()));
        }
    };
    let materials = &attached.materials;
    albedos(&materials.diffuse, Part::Diffuse, Part::DiffuseTexels);
    if let Some((specular, exponent)) = &materials.specular {
        albedos(specular, Part::Specular, Part::SpecularTexels);
        all.push((Part::Exponent, vec![exponent.clone()]));
    }
    all.push((Part::Emission, of_vector(&materials.emission).to_vec()));
    let shining = match &attached.environment {
        Some(SkyTensors::Constant(radiance)) => Some(radiance),
        Some(SkyTensors::Map(map)) => Some(&map.texels),
        None => None,
    };
    all.extend(shining.map(|v| (Part::Sky, of_vector(v).to_vec())));
    all
}
