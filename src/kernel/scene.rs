//! A scene as kernels trace it: flat lists in f32.

use std::sync::Arc;

use glam::DVec3;

use crate::accel::{Hierarchy, HierarchyCache, HostTriangle};
use crate::model::delta_light::DeltaLight;
use crate::model::emitter::Emission;
use crate::model::sky::Sky;
use crate::model::texture::{Colour, Texels, Texture};
use crate::model::{V3, v3};
use crate::sampling::{Emitter, EmitterSampling, Emitters};
use crate::scene::{
    CHANNELS, Channel, Holes, HostAttribute, HostLight, HostScene, HostTexture, MaterialKind,
    SceneFrame,
};

/// The place of an object's parts in the scene's lists.
#[derive(Clone, Debug)]
pub(crate) struct ObjectPart {
    pub first_triangle: usize,
    pub first_vertex: usize,
    pub vertices: usize,
    pub first_uv: usize,
    pub first_normal: usize,
    pub first_colour: usize,
    pub first_tangent: usize,
    /// Whether it has shading normals.
    pub smooth: bool,
}

/// A scene as kernels trace it.
pub(crate) struct KernelScene {
    pub frame: SceneFrame,
    pub triangles: Vec<Triangle>,
    pub hierarchy: Arc<Hierarchy>,
    /// The way of each object over the shutter, if any moves.
    pub velocities: Option<Vec<V3>>,
    /// Holes, if any surface has any.
    pub holes: Option<Arc<Holes>>,
    pub objects: Vec<ObjectPart>,
    /// The object of the scene that each object with triangles is, in order.
    pub counted: Vec<usize>,
    /// Rows of all vertices, texture coordinates and normals at the corners.
    pub vertex_rows: Vec<[u32; 3]>,
    pub uv_rows: Vec<[u32; 3]>,
    pub normal_rows: Vec<[u32; 3]>,
    pub uvs: Vec<[f32; 2]>,
    pub normals: Vec<V3>,
    pub colours: Corners,
    pub tangents: Corners,
    /// The sides of the bitangents of all tangents, 1 or −1.
    pub tangent_sides: Vec<f32>,
    pub materials: Vec<Material>,
    pub texels: Texels,
    pub emitters: Emitters,
    /// Lengths of the directions of lights, as they are given.
    pub lengths_of_axes: Vec<f64>,
    pub sky: Sky,
    /// Whether any material has a texture, any object shading normals, any material a gloss.
    pub textured: bool,
    pub smooth: bool,
    pub glossy: bool,
    /// Whether any material has a normal map.
    pub tilted: bool,
}

/// Values at the corners of triangles that few scenes have; empty in the others.
#[derive(Default)]
pub(crate) struct Corners {
    /// Rows of the values at the corners of each triangle, `u32::MAX` where it has none.
    pub rows: Vec<[u32; 3]>,
    pub values: Vec<V3>,
}

impl Corners {
    /// Adds those of an object with so many faces, unless no object of the scene has any; takes the first three
    /// numbers of each row.
    fn add<const C: usize>(&mut self, of: Option<&HostAttribute<C>>, faces: usize, any: bool) {
        if !any {
            return;
        }
        let first = self.values.len() as u32;
        match of {
            None => self.rows.resize(self.rows.len() + faces, [u32::MAX; 3]),
            Some(a) => {
                let rows = a.faces.iter().map(|f| f.map(|row| row + first));
                self.rows.extend(rows);
                self.values
                    .extend(a.values.iter().map(|v| v3(v[0], v[1], v[2])));
            }
        }
    }
}

impl KernelScene {
    /// The number of triangles without area.
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
        let mut velocities: Option<Vec<V3>> = moves.then(Vec::new);
        let mut lists = Lists::default();
        for (i, o) in scene.objects.iter().enumerate() {
            let velocity = DVec3::from(o.velocity.unwrap_or([0.0; 3])) / frame.unit;
            lists.add_object(scene, i, &frame, velocity);
            velocities.iter_mut().for_each(|v| v.push(velocity.into()));
        }
        let Lists {
            triangles,
            host,
            objects,
            counted,
            vertex_rows,
            uv_rows,
            normal_rows,
            uvs,
            normals,
            colours,
            tangents,
            tangent_sides,
        } = lists;
        let hierarchy = match (like, cache) {
            (None, Some(cache)) => cache.take(host),
            _ => Arc::new(Hierarchy::like(host, like).0),
        };
        let mut texels = Texels::default();
        let materials: Vec<Material> = scene
            .materials
            .iter_mut()
            .map(|m| Material {
                channels: std::array::from_fn(|i| pack_colour(&mut m.channels[i], &mut texels)),
                kind: m.kind,
                normal_map: m
                    .normal_map
                    .as_mut()
                    .and_then(|map| pack_colour(map, &mut texels).texture),
            })
            .collect();
        let emits =
            |t: &(usize, &Triangle)| t.1.area > 0.0 && materials[t.1.material as usize].kind.emits;
        let list = triangles.iter().enumerate().filter(emits);
        let list = list.map(|(k, t)| Emitter {
            triangle: k as u32,
            object: t.object,
            corners: t.corners,
            normal: t.normal,
            area: t.area,
            velocity: velocities
                .as_ref()
                .map_or(V3::ZERO, |v| v[t.object as usize]),
            radiance: {
                let emission = &materials[t.material as usize].channels[Channel::Emission.place()];
                let uv = |row: u32| uvs.get(row as usize).copied().unwrap_or_default();
                emission.mean_over(&texels, uv_rows[k].map(uv))
            },
            group: 0,
        });
        let lights = scene.lights.iter().map(|l| pack_light(l, &frame)).collect();
        let emitters = Emitters::new(
            list.collect(),
            lights,
            (velocities.is_some(), 1.0),
            sampling,
        );
        Self {
            textured: materials.iter().any(|m| m.is_textured()),
            lengths_of_axes: (scene.lights.iter())
                .map(|l| DVec3::from(l.direction).length())
                .collect(),
            smooth: objects.iter().any(|o| o.smooth),
            tilted: materials.iter().any(|m| m.normal_map.is_some()),
            glossy: materials.iter().any(|m| m.kind.glossy),
            sky: Sky::new(scene),
            frame,
            triangles,
            hierarchy,
            velocities,
            holes: scene.holes.clone(),
            objects,
            counted,
            vertex_rows,
            uv_rows,
            normal_rows,
            uvs,
            normals,
            colours,
            tangents,
            tangent_sides,
            materials,
            texels,
            emitters,
        }
    }

    /// The vector by which a triangle has moved at a time in the shutter.
    #[inline(always)]
    pub fn shift(&self, triangle: u32, time: f32) -> V3 {
        match &self.velocities {
            Some(v) => v[self.triangles[triangle as usize].object as usize] * time,
            None => V3::ZERO,
        }
    }

    /// Whether a triangle has a hole at the point with these weights of its corners.
    #[inline(always)]
    pub fn is_open(&self, triangle: u32, weights: [f32; 3]) -> bool {
        let holes = self.holes.as_ref();
        holes.is_some_and(|holes| holes.open(triangle, || weights))
    }

    /// The emission of a triangle at a point given by weights of its corners.
    #[inline(always)]
    pub fn emission(&self, triangle: usize, weights: [f32; 3]) -> Emission {
        let uv = self.uv_at(triangle, weights);
        self.material(triangle as u32).emission(&self.texels, uv)
    }

    pub fn material(&self, triangle: u32) -> &Material {
        &self.materials[self.triangles[triangle as usize].material as usize]
    }
}

/// Lists of a scene that grow object by object.
#[derive(Default)]
struct Lists {
    triangles: Vec<Triangle>,
    host: Vec<HostTriangle>,
    objects: Vec<ObjectPart>,
    counted: Vec<usize>,
    vertex_rows: Vec<[u32; 3]>,
    uv_rows: Vec<[u32; 3]>,
    normal_rows: Vec<[u32; 3]>,
    uvs: Vec<[f32; 2]>,
    normals: Vec<V3>,
    colours: Corners,
    tangents: Corners,
    tangent_sides: Vec<f32>,
}

impl Lists {
    fn add_object(&mut self, scene: &HostScene, i: usize, frame: &SceneFrame, velocity: DVec3) {
        let o = &scene.objects[i];
        let part = ObjectPart {
            first_triangle: self.triangles.len(),
            first_vertex: self
                .objects
                .last()
                .map_or(0, |o| o.first_vertex + o.vertices),
            vertices: o.positions.len(),
            first_uv: self.uvs.len(),
            first_normal: self.normals.len(),
            first_colour: self.colours.values.len(),
            first_tangent: self.tangents.values.len(),
            smooth: o.normals.is_some(),
        };
        if !o.faces.is_empty() {
            self.counted.push(i);
        }
        let inner: Vec<DVec3> = o.positions.iter().map(|&p| frame.inner(p.into())).collect();
        for (f, face) in o.faces.iter().enumerate() {
            let own = o.face_materials.get(f).copied().unwrap_or(0);
            let corners = face.map(|v| inner[v as usize]);
            let material = o.first_material as u32 + own;
            self.add_triangle(corners, velocity, material, i as u32);
            self.vertex_rows
                .push(face.map(|v| v + part.first_vertex as u32));
            let rows = |faces: Option<&Arc<Vec<[u32; 3]>>>, first: usize| {
                faces.map_or([u32::MAX; 3], |faces| faces[f].map(|v| v + first as u32))
            };
            self.uv_rows
                .push(rows(o.uvs.as_ref().map(|a| &a.faces), part.first_uv));
            self.normal_rows.push(rows(
                o.normals.as_ref().map(|a| &a.faces),
                part.first_normal,
            ));
        }
        if let Some(HostAttribute { values, .. }) = &o.uvs {
            self.uvs.extend_from_slice(values);
        }
        if let Some(HostAttribute { values, .. }) = &o.normals {
            self.normals
                .extend(values.iter().map(|n| v3(n[0], n[1], n[2])));
        }
        let any = scene.objects.iter().any(|o| o.colours.is_some());
        self.colours.add(o.colours.as_ref(), o.faces.len(), any);
        let any = scene.objects.iter().any(|o| o.tangents.is_some());
        self.tangents.add(o.tangents.as_ref(), o.faces.len(), any);
        let tangents = o.tangents.iter().flat_map(|t| &t.values);
        self.tangent_sides.extend(tangents.map(|t| t[3]));
        self.objects.push(part);
    }

    /// Adds a triangle; one whose area has no inverse in f32 counts as without area and is never hit.
    fn add_triangle(&mut self, corners: [DVec3; 3], velocity: DVec3, material: u32, object: u32) {
        let mut t = HostTriangle::new(corners, velocity, true);
        let area = t.area() as f32;
        t.valid &= area > 1e-35 && area.is_finite();
        let (mut normal, mut plane, mut own) = (v3(0.0, 0.0, 1.0), 0.0, 0.0);
        if t.valid {
            normal = t.normal.into();
            plane = t.normal.dot(t.corners[0]) as f32;
            own = area;
        }
        self.triangles.push(Triangle {
            corners: corners.map(|c| c.into()),
            normal,
            plane,
            area: own,
            material,
            object,
        });
        self.host.push(t);
    }
}

fn pack_light(light: &HostLight, frame: &SceneFrame) -> DeltaLight {
    let [inner, outer] = light.angles;
    let mut packed = DeltaLight {
        position: V3::ZERO,
        axis: DVec3::from(light.direction).normalize().into(),
        strength: DVec3::from(light.strength).into(),
        directional: light.directional,
        spot: light.spot,
        cos_inner: inner.cos() as f32,
        cos_outer: outer.cos() as f32,
    };
    if !light.directional {
        packed.position = frame.inner(light.position.into()).into();
        packed.strength = (DVec3::from(light.strength) / (frame.unit * frame.unit)).into();
    }
    packed
}

/// Packs a colour; the texels of a texture move to the others.
fn pack_colour(colour: &mut HostTexture, texels: &mut Texels) -> Colour {
    match colour {
        HostTexture::Constant(c) => Colour {
            constant: DVec3::from(*c).into(),
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
    }
}

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

#[derive(Clone, Copy, Debug)]
pub(crate) struct Material {
    /// Each at its place ([`Channel::place`](crate::scene::Channel::place)).
    pub channels: [Colour; CHANNELS],
    pub kind: MaterialKind,
    pub normal_map: Option<Texture>,
}

impl Material {
    #[inline(always)]
    pub fn emission(&self, texels: &Texels, uv: [f32; 2]) -> Emission {
        Emission::of(|channel| self.channels[channel.place()].at(texels, uv))
    }

    /// Whether its emission is a texture.
    #[inline(always)]
    pub fn glows(&self) -> bool {
        self.channels[Channel::Emission.place()].texture.is_some()
    }

    pub fn is_textured(&self) -> bool {
        self.normal_map.is_some() || self.channels.iter().any(|c| c.texture.is_some())
    }
}
