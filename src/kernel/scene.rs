//! A scene as kernels trace it: flat lists in f32.

use std::sync::Arc;

use glam::DVec3;

use super::emitters::Emitters;
use super::sky::Sky;
use crate::accel::{Hierarchy, HierarchyCache, HostTriangle};
use crate::model::{V3, v3};
use crate::scene::{CHANNELS, Channel, MaterialKind};
use crate::scene::{HostAttribute, HostScene, HostTexture, SceneFrame, Wrap};
use crate::transport::EmitterSampling;

/// A triangle, in inner coordinates at the start of the shutter.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Triangle {
    pub corners: [V3; 3],
    /// Unit normal of the front.
    pub normal: V3,
    /// normal · corner.
    pub plane: f32,
    pub area: f32,
    pub material: u32,
    pub object: u32,
}

/// A colour of a material: constant, or a texture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Colour {
    pub constant: V3,
    pub texture: Option<Texture>,
}

/// Colours of textures, three numbers each.
#[derive(Clone, Debug, Default)]
pub(crate) struct Texels(Vec<f32>);

impl Texels {
    /// Of a list that is moved.
    pub fn new(numbers: Vec<f32>) -> Self {
        Self(numbers)
    }

    pub fn len(&self) -> usize {
        self.0.len() / 3
    }

    #[inline(always)]
    pub fn at(&self, texel: usize) -> V3 {
        let t = &self.0[3 * texel..3 * texel + 3];
        v3(t[0], t[1], t[2])
    }

    /// Adds a list; the first is not copied.
    fn push(&mut self, numbers: Vec<f32>) {
        if self.0.is_empty() {
            self.0 = numbers;
        } else {
            self.0.extend(numbers);
        }
    }
}

/// Where a texture lies among the texels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Texture {
    pub offset: usize,
    pub width: usize,
    pub height: usize,
    pub wrap: Wrap,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Material {
    /// In the order of [`Channel::ALL`].
    pub channels: [Colour; CHANNELS],
    pub kind: MaterialKind,
}

impl Material {
    pub fn emission(&self) -> V3 {
        self.channels[Channel::Emission as usize].constant
    }

    pub fn is_textured(&self) -> bool {
        self.channels.iter().any(|c| c.texture.is_some())
    }
}

/// Where an object's parts are in the scene's lists.
#[derive(Clone, Debug)]
pub(crate) struct ObjectPart {
    pub first_triangle: usize,
    pub first_vertex: usize,
    pub vertices: usize,
    pub first_uv: usize,
    pub first_normal: usize,
    /// Whether it has shading normals.
    pub smooth: bool,
}

pub(crate) struct KernelScene {
    pub frame: SceneFrame,
    pub triangles: Vec<Triangle>,
    pub hierarchy: Arc<Hierarchy>,
    /// Of each object over the shutter, if any moves.
    pub velocities: Option<Vec<V3>>,
    pub objects: Vec<ObjectPart>,
    /// The object of the scene that each object with triangles is, in order.
    pub counted: Vec<usize>,
    /// Rows of all vertices, texture coordinates and normals at the corners.
    pub vertex_rows: Vec<[u32; 3]>,
    pub uv_rows: Vec<[u32; 3]>,
    pub normal_rows: Vec<[u32; 3]>,
    pub uvs: Vec<[f32; 2]>,
    pub normals: Vec<V3>,
    pub materials: Vec<Material>,
    pub texels: Texels,
    pub emitters: Emitters,
    pub sky: Sky,
    /// Texture coordinates count for something.
    pub textured: bool,
    pub smooth: bool,
    pub glossy: bool,
}

impl KernelScene {
    /// How many triangles have no area.
    pub fn degenerate(&self) -> u64 {
        self.triangles.iter().filter(|t| t.area <= 0.0).count() as u64
    }

    /// Packs a scene; boxes are fitted to those of another where they still serve.
    pub fn new(
        scene: &mut HostScene,
        sampling: EmitterSampling,
        like: Option<&Hierarchy>,
        cache: Option<&HierarchyCache>,
    ) -> Self {
        let frame = SceneFrame::new(scene);
        let moves = scene.objects.iter().any(|o| o.velocity.is_some());
        let velocity_of = |i: usize| -> DVec3 {
            let velocity = scene.objects[i].velocity.unwrap_or([0.0; 3]);
            DVec3::from(velocity) / frame.unit
        };
        let mut objects = Vec::with_capacity(scene.objects.len());
        let (mut counted, mut host, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
        let mut vertex_rows = Vec::new();
        let (mut uvs, mut uv_rows) = (Vec::new(), Vec::new());
        let (mut normals, mut normal_rows) = (Vec::new(), Vec::new());
        let mut first_vertex = 0;
        for (i, o) in scene.objects.iter().enumerate() {
            let part = ObjectPart {
                first_triangle: triangles.len(),
                first_vertex,
                vertices: o.positions.len(),
                first_uv: uvs.len(),
                first_normal: normals.len(),
                smooth: o.normals.is_some(),
            };
            first_vertex += o.positions.len();
            if !o.faces.is_empty() {
                counted.push(i);
            }
            let inner: Vec<DVec3> = o.positions.iter().map(|&p| frame.inner(p.into())).collect();
            let velocity = velocity_of(i);
            for (f, face) in o.faces.iter().enumerate() {
                let corners = face.map(|v| inner[v as usize]);
                let own = o.face_materials.get(f).copied().unwrap_or(0);
                let mut t = HostTriangle::new(corners, velocity, true);
                // Not hit where f32 has no inverse of its area.
                let area = t.area() as f32;
                t.valid &= area > 1e-35 && area.is_finite();
                triangles.push(Triangle {
                    corners: corners.map(V3::from),
                    normal: if t.valid {
                        t.normal.into()
                    } else {
                        v3(0.0, 0.0, 1.0)
                    },
                    plane: if t.valid {
                        t.normal.dot(t.corners[0]) as f32
                    } else {
                        0.0
                    },
                    area: if t.valid { area } else { 0.0 },
                    material: o.first_material as u32 + own,
                    object: i as u32,
                });
                host.push(t);
                vertex_rows.push(face.map(|v| v + part.first_vertex as u32));
                let rows = |faces: Option<&Arc<Vec<[u32; 3]>>>, first: usize| {
                    faces.map_or([u32::MAX; 3], |faces| faces[f].map(|v| v + first as u32))
                };
                uv_rows.push(rows(o.uvs.as_ref().map(|a| &a.faces), part.first_uv));
                normal_rows.push(rows(
                    o.normals.as_ref().map(|a| &a.faces),
                    part.first_normal,
                ));
            }
            if let Some(HostAttribute { values, .. }) = &o.uvs {
                uvs.extend_from_slice(values);
            }
            if let Some(HostAttribute { values, .. }) = &o.normals {
                normals.extend(values.iter().map(|n| v3(n[0], n[1], n[2])));
            }
            objects.push(part);
        }
        let hierarchy = match (like, cache) {
            (Some(like), _) => Arc::new(Hierarchy::like(host, like)),
            (None, Some(cache)) => cache.take(host),
            (None, None) => Arc::new(Hierarchy::new(host)),
        };
        let mut texels = Texels::default();
        let mut colour = |t: &mut HostTexture| match t {
            HostTexture::Constant(c) => Colour {
                constant: (*c).into(),
                texture: None,
            },
            HostTexture::Image {
                texels: list,
                width,
                height,
                wrap,
            } => {
                let texture = Texture {
                    offset: texels.len(),
                    width: *width,
                    height: *height,
                    wrap: *wrap,
                };
                texels.push(std::mem::take(list));
                Colour {
                    constant: V3::ZERO,
                    texture: Some(texture),
                }
            }
        };
        let materials: Vec<Material> = scene
            .materials
            .iter_mut()
            .map(|m| Material {
                channels: std::array::from_fn(|i| colour(&mut m.channels[i])),
                kind: m.kind,
            })
            .collect();
        let velocities: Option<Vec<V3>> = moves.then(|| {
            (0..scene.objects.len())
                .map(|i| velocity_of(i).into())
                .collect()
        });
        let emitters = Emitters::new(&triangles, &materials, velocities.as_deref(), sampling);
        Self {
            textured: materials.iter().any(|m| m.is_textured()),
            smooth: objects.iter().any(|o| o.smooth),
            glossy: materials.iter().any(|m| m.kind.glossy),
            sky: Sky::new(scene),
            frame,
            triangles,
            hierarchy,
            velocities,
            objects,
            counted,
            vertex_rows,
            uv_rows,
            normal_rows,
            uvs,
            normals,
            materials,
            texels,
            emitters,
        }
    }

    /// How far a triangle has moved at a time in the shutter.
    #[inline(always)]
    pub fn shift(&self, triangle: u32, time: f32) -> V3 {
        match &self.velocities {
            Some(v) => v[self.triangles[triangle as usize].object as usize] * time,
            None => V3::ZERO,
        }
    }

    pub fn material(&self, triangle: u32) -> &Material {
        &self.materials[self.triangles[triangle as usize].material as usize]
    }
}
