//! A scene as kernels trace it: flat lists in f32.

use std::collections::HashMap;
use std::sync::Arc;

use glam::DVec3;

use super::lists::{Corners, Lists, ObjectPart, Triangle};
use crate::accel::{Hierarchy, HierarchyCache, Spare};
use crate::model::V3;
use crate::model::delta_light::DeltaLight;
use crate::model::emitter::Emission;
use crate::model::sky::Sky;
use crate::model::texture::{Colour, Texels, Texture};
use crate::sampling::{Emitter, EmitterSampling, Emitters};
use crate::scene::{
    CHANNELS, Channel, Holes, HostMaterial, HostScene, HostTexture, MaterialKind, SceneFrame,
};

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
        let lists = Lists::new(scene, &frame);
        let ways = scene.objects.iter();
        let ways = ways.map(|o| DVec3::from(o.velocity.unwrap_or([0.0; 3])) / frame.unit);
        let ways: Vec<DVec3> = ways.collect();
        let velocities: Option<Vec<V3>> = moves.then(|| ways.iter().map(|&v| v.into()).collect());
        let way = |object: u32| ways[object as usize];
        // As in the last render, while a fit looks at a scene from elsewhere or by other light.
        let last = cache.and_then(HierarchyCache::last);
        let triangle = |k: usize| (lists.corners(k), way(lists.owners[k][1]));
        // Rays don't tell triangles from copies of them, unless they emit or have holes.
        let (materials, holes) = (&scene.materials, &scene.holes);
        let plain = |k: usize| {
            let emits = materials[lists.owners[k][0] as usize].kind.emits;
            !emits && holes.as_ref().is_none_or(|holes| !holes.are_in(k))
        };
        let spare: Spare = Some(&plain);
        let hierarchy = match (last, like, cache) {
            (Some(last), ..) if last.is_of(lists.owners.len(), triangle) => last,
            (_, None, Some(cache)) => cache.take(lists.for_boxes(way), spare),
            _ => Arc::new(Hierarchy::like(lists.for_boxes(way), like, spare).0),
        };
        let triangles = lists.triangles(&hierarchy.triangles);
        let mut packed = Packed::default();
        let materials = scene.materials.iter_mut();
        let materials: Vec<Material> = materials.map(|m| packed.material(m)).collect();
        let texels = packed.texels;
        let emits =
            |t: &(usize, &Triangle)| t.1.area > 0.0 && materials[t.1.material as usize].kind.emits;
        let list = triangles.iter().enumerate().filter(emits);
        let list = list.map(|(k, t)| {
            let emission = &materials[t.material as usize].channels[Channel::Emission.place()];
            let uv = |row: u32| lists.uvs.get(row as usize).copied().unwrap_or_default();
            let radiance = emission.mean_over(&texels, lists.uv_rows[k].map(uv));
            let velocity = velocities.as_ref().map(|v| v[t.object as usize]);
            t.emitter(k, velocity.unwrap_or(V3::ZERO), radiance)
        });
        let lights = scene
            .lights
            .iter()
            .map(|l| DeltaLight::new(l, &frame))
            .collect();
        let moves = velocities.is_some();
        let emitters = Emitters::new(list.collect(), lights, (moves, 1.0), sampling);
        Self {
            textured: materials.iter().any(|m| m.is_textured()),
            lengths_of_axes: (scene.lights.iter())
                .map(|l| DVec3::from(l.direction).length())
                .collect(),
            smooth: lists.objects.iter().any(|o| o.smooth),
            tilted: materials.iter().any(|m| m.normal_map.is_some()),
            glossy: materials.iter().any(|m| m.kind.glossy),
            sky: Sky::new(scene),
            frame,
            triangles,
            hierarchy,
            velocities,
            holes: scene.holes.clone(),
            objects: lists.objects,
            counted: lists.counted,
            vertex_rows: lists.vertex_rows,
            uv_rows: lists.uv_rows,
            normal_rows: lists.normal_rows,
            uvs: lists.uvs,
            normals: lists.normals,
            colours: lists.colours,
            tangents: lists.tangents,
            tangent_sides: lists.tangent_sides,
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

/// The texels of materials so far.
#[derive(Default)]
struct Packed {
    texels: Texels,
    /// Where those lie that several textures share, by their addresses.
    shared: HashMap<*const Vec<f32>, usize>,
}

impl Packed {
    fn material(&mut self, material: &mut HostMaterial) -> Material {
        let map = material.normal_map.as_mut();
        Material {
            normal_map: map.and_then(|map| self.colour(map).texture),
            channels: std::array::from_fn(|i| self.colour(&mut material.channels[i])),
            kind: material.kind,
        }
    }

    /// Packs a colour; the texels of a texture move to the others.
    fn colour(&mut self, colour: &mut HostTexture) -> Colour {
        match colour {
            HostTexture::Constant(c) => Colour {
                constant: DVec3::from(*c).into(),
                texture: None,
            },
            HostTexture::Image {
                texels,
                width,
                height,
                wrap,
            } => Colour {
                constant: V3::ZERO,
                texture: Some(Texture::new(
                    self.place(std::mem::take(texels)),
                    [*width, *height],
                    *wrap,
                )),
            },
        }
    }

    /// The number of the first of some texels, which are packed once.
    fn place(&mut self, texels: Arc<Vec<f32>>) -> usize {
        let address = Arc::as_ptr(&texels);
        if let Some(&offset) = self.shared.get(&address) {
            return offset;
        }
        let offset = self.texels.len();
        if Arc::strong_count(&texels) > 1 {
            self.shared.insert(address, offset);
        }
        self.texels.push(texels);
        offset
    }
}

impl Triangle {
    /// The emitter that it is, by its number, with its velocity and mean radiance.
    fn emitter(&self, k: usize, velocity: V3, radiance: f32) -> Emitter {
        Emitter {
            triangle: k as u32,
            object: self.object,
            corners: self.corners,
            normal: self.normal,
            area: self.area,
            velocity,
            radiance,
            group: 0,
        }
    }
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
