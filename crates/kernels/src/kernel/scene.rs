//! A scene as the host's kernels trace it. GPU buffers are made from it, too.

use std::collections::HashMap;
use std::sync::Arc;

use glam::DVec3;

use super::lists::Lists;
use crate::accel::{Hierarchy, LastHierarchy, Spare};
use crate::host::{
    BsdfKind, CHANNELS, Channel, Holes, HostMaterial, HostScene, HostTexture, LightPart,
    MaterialKind, SceneFrame,
};
use crate::model::V3;
use crate::model::bsdf::Models;
use crate::model::delta_light::{DeltaLight, OF_LIGHT};
use crate::model::sky::Sky;
use crate::model::texture::{Color, Texels, Texture};
use crate::model::triangle::{AREA, Triangle, triangle_at};
use crate::sampling::{Emitter, EmitterGroup, EmitterSampling, Emitters};
use crate::trace::{
    COMPENSATED, EMITS, FOLLOWED, Features, GLOSSY, GLOWS, MATERIAL, MODEL, NONE, POLISHED,
    REFLECTS, Scene,
};

/// A scene as kernels trace it.
pub struct KernelScene {
    pub frame: SceneFrame,
    pub hierarchy: Arc<Hierarchy>,
    pub lists: Lists,
    /// The displacement of each object over the shutter, if any object moves.
    pub velocities: Option<Vec<[f32; 3]>>,
    /// The holes of alpha masks, if any surface has them.
    pub holes: Option<Arc<Holes>>,
    pub materials: Vec<Material>,
    pub texels: Texels,
    pub emitters: Emitters,
    /// The lengths of the light directions as the user gave them.
    pub lengths_of_axes: Vec<f64>,
    pub sky: Sky,
    pub features: Features,
    flat: Flat,
}

/// Parts of a scene that stages read as lists.
#[derive(Default)]
struct Flat {
    materials: Vec<[[f32; 3]; CHANNELS]>,
    of_materials: Vec<[u32; MATERIAL as usize]>,
    emitters: Vec<u32>,
    groups: Vec<[f32; 7]>,
    group_of_emitters: Vec<u32>,
}

impl KernelScene {
    /// Returns the number of triangles without area.
    pub fn degenerate(&self) -> u64 {
        let surfaces = self.lists.surfaces.iter();
        surfaces.filter(|t| t[AREA] <= 0.0).count() as u64
    }

    /// Packs a scene. The hierarchy of the last render is reused if its triangles are the same. Otherwise it, or the
    /// hierarchy `like` of another scene, is refitted if possible.
    pub fn new(
        scene: &mut HostScene,
        sampling: EmitterSampling,
        like: Option<&Arc<Hierarchy>>,
        cache: &LastHierarchy,
    ) -> Self {
        let frame = SceneFrame::new(scene);
        let moves = scene.objects.iter().any(|o| o.velocity.is_some());
        let mut lists = Lists::new(scene, &frame);
        let ways = scene.objects.iter();
        let ways = ways.map(|o| DVec3::from(o.velocity.unwrap_or([0.0; 3])) / frame.unit);
        let ways: Vec<DVec3> = ways.collect();
        let velocities = moves.then(|| ways.iter().map(|v| v.as_vec3().to_array()).collect());
        let way = |object: u32| ways[object as usize];
        let triangle = |k: usize| (lists.corners(k), way(lists.triangles[k][1]));
        // Rays cannot distinguish a triangle from a copy of it, unless the triangles emit or have holes.
        let (materials, holes) = (&scene.materials, &scene.holes);
        let plain = |k: usize| {
            let emits = materials[lists.triangles[k][0] as usize].kind.emits;
            !emits && holes.as_ref().is_none_or(|holes| !holes.are_in(k))
        };
        let spare: Spare = Some(&plain);
        // In a fit that changes only the camera or the light, the triangles are those of the last render.
        let last = cache.last();
        let last = last.filter(|last| last.is_of(lists.triangles.len(), triangle));
        let hierarchy = last.unwrap_or_else(|| cache.take(like, lists.for_boxes(way), spare));
        lists.add_surfaces(&hierarchy.triangles);
        let mut packed = Packed::default();
        let materials = scene.materials.iter_mut();
        let materials: Vec<Material> = materials.map(|m| packed.material(m)).collect();
        let mut this = Self {
            lengths_of_axes: (scene.lights.iter())
                .map(|l| DVec3::from(l.direction).length())
                .collect(),
            sky: Sky::new(scene),
            frame,
            hierarchy,
            lists,
            velocities,
            holes: scene.holes.clone(),
            materials,
            texels: packed.texels,
            emitters: Emitters::new(Vec::new(), Vec::new(), (false, 1.0), sampling),
            features: Features::default(),
            flat: Flat::default(),
        };
        let lights = scene.lights.iter();
        let lights = lights.map(|l| DeltaLight::new(l, &this.frame)).collect();
        this.emitters = Emitters::new(this.emissive(), lights, (moves, 1.0), sampling);
        this.features = this.features();
        this.flat = this.flat();
        this
    }

    /// Returns the triangles that emit.
    fn emissive(&self) -> Vec<Emitter> {
        let emitter = |k: usize| {
            let words = &self.lists.triangles[k];
            let material = &self.materials[words[0] as usize];
            if !material.kind.emits {
                return None;
            }
            let t = self.triangle(k as u32);
            if t.area <= 0.0 {
                return None;
            }
            let emission = &material.channels[Channel::Emission.place()];
            let uv = |row: u32| self.lists.uvs.get(row as usize).copied();
            let uvs = [words[2], words[3], words[4]].map(|row| uv(row).unwrap_or_default());
            Some(Emitter {
                triangle: k as u32,
                object: words[1],
                corners: t.corners(),
                normal: t.normal,
                area: t.area,
                velocity: self.shift(k as u32, 1.0),
                radiance: emission.mean_over(&self.texels, uvs),
                group: 0,
            })
        };
        (0..self.lists.surfaces.len()).filter_map(emitter).collect()
    }

    /// Returns the features of the scene; a view adds its own.
    fn features(&self) -> Features {
        let models = self.materials.iter().map(|m| Models::of(m.kind.bsdf));
        let lists = &self.lists;
        Features {
            moves: self.velocities.is_some(),
            smooth: lists.objects.iter().any(|o| o.smooth),
            textured: self.materials.iter().any(|m| m.is_textured()),
            tinted: !lists.colors.values.is_empty(),
            tilted: self.materials.iter().any(|m| m.normal_map.is_some())
                && !lists.tangents.values.is_empty(),
            glows: self.materials.iter().any(|m| m.kind.glows),
            holes: self.holes.is_some(),
            glossy: self.materials.iter().any(|m| m.kind.glossy),
            models: models.reduce(Models::or).unwrap_or_default(),
            emitters: !self.emitters.is_empty(),
            of_emitters: self.emitters.kinds,
            sky_constant: !self.sky.values.is_empty() && self.sky.drawn.is_none(),
            sky_map: self.sky.drawn.is_some(),
            dark: self.emitters.is_empty() && self.sky.values.is_empty(),
            turns_to_map: self.materials.iter().any(|m| m.is_polished(&self.texels)),
            ..Features::default()
        }
    }

    fn flat(&self) -> Flat {
        let emitters = &self.emitters;
        let count = emitters.triangles().len() + emitters.lights().len();
        let group = |g: &EmitterGroup| {
            let ([a, b, c], [x, y, z]) = (g.center.to_array(), g.velocity.to_array());
            [a, b, c, g.radius, x, y, z]
        };
        let constants = |m: &Material| m.channels.map(|c| c.constant.to_array());
        Flat {
            materials: self.materials.iter().map(constants).collect(),
            of_materials: self.materials.iter().map(Material::words).collect(),
            emitters: emitters
                .triangles()
                .map(|k| emitters.get(k).triangle)
                .collect(),
            groups: emitters.groups.iter().map(group).collect(),
            group_of_emitters: (0..count).map(|k| emitters.group_of(k) as u32).collect(),
        }
    }

    /// Returns the lists of the scene; a view adds its own.
    #[inline(always)]
    pub fn scene(&self) -> Scene<'_> {
        let (lists, flat, emitters) = (&self.lists, &self.flat, self.emitters.lists());
        let mut scene = Scene {
            features: self.features,
            surfaces: lists.surfaces.as_flattened(),
            triangles: lists.triangles.as_flattened(),
            vertex_rows: lists.vertex_rows.as_flattened(),
            uvs: lists.uvs.as_flattened(),
            normals: lists.normals.as_flattened(),
            colors: lists.colors.values.as_flattened(),
            color_rows: lists.colors.rows.as_flattened(),
            tangents: lists.tangents.values.as_flattened(),
            tangent_rows: lists.tangents.rows.as_flattened(),
            materials: flat.materials.as_flattened().as_flattened(),
            of_materials: flat.of_materials.as_flattened(),
            texels: &self.texels.0,
            lights: emitters.lights,
            light_bits: emitters.bits,
            emitters: &flat.emitters,
            emitter_triangles: emitters.triangles,
            brightness: emitters.brightness,
            fixed: emitters.tree.fixed.chances,
            fixed_sums: emitters.tree.fixed.sums,
            emitter_count: emitters.tree.fixed.count,
            emissive_count: emitters.triangle_count,
            light_branches: emitters.tree.branches,
            light_nodes: emitters.tree.nodes,
            light_node_count: emitters.tree.count,
            light_places: emitters.tree.places,
            distant: emitters.tree.distant,
            distant_count: emitters.tree.distant_count,
            distant_sums: emitters.tree.sums,
            distant_axes: emitters.tree.axes,
            groups: flat.groups.as_flattened(),
            group_of_emitters: &flat.group_of_emitters,
            sky: &self.sky.values,
            ..Scene::default()
        };
        if let Some(velocities) = &self.velocities {
            scene.velocities = velocities.as_flattened();
        }
        if let Some(holes) = &self.holes {
            let masks = holes.masks();
            (scene.masked, scene.masks) = (masks.masked, masks.images);
            (scene.masked_uvs, scene.alphas) = (masks.uvs, masks.alphas);
        }
        if let Some(drawn) = &self.sky.drawn {
            (scene.sky_width, scene.sky_height) = (drawn.map.width, drawn.map.height);
            scene.sky_density = &drawn.list;
        }
        scene
    }

    /// Returns a triangle in inner coordinates, at the start of the shutter.
    #[inline(always)]
    pub fn triangle(&self, k: u32) -> Triangle {
        triangle_at(self.lists.surfaces.as_flattened(), k)
    }

    /// Returns the object of a triangle.
    #[inline(always)]
    pub fn object_of(&self, triangle: u32) -> u32 {
        self.lists.triangles[triangle as usize][1]
    }

    /// Returns the displacement of a triangle at a time in the shutter.
    #[inline(always)]
    pub fn shift(&self, triangle: u32, time: f32) -> V3 {
        match &self.velocities {
            Some(v) => V3::from(v[self.object_of(triangle) as usize]) * time,
            None => V3::ZERO,
        }
    }

    /// Returns the derivative of the loss with respect to a parameter of the i-th delta light, given the derivatives
    /// with respect to the light's numbers in the list.
    pub fn by_light(&self, i: usize, part: LightPart, by: [f64; OF_LIGHT]) -> [f64; 3] {
        let light = &self.emitters.lights()[i];
        light.by_part(by, part, self.frame.unit, self.lengths_of_axes[i])
    }

    /// Returns the total number of vertices.
    pub fn vertices(&self) -> usize {
        let last = self.lists.objects.last();
        last.map_or(0, |o| o.first_vertex + o.vertices)
    }

    pub fn material(&self, triangle: u32) -> &Material {
        &self.materials[self.lists.triangles[triangle as usize][0] as usize]
    }
}

/// The texels of the materials that were packed so far.
#[derive(Default)]
struct Packed {
    texels: Texels,
    /// The offsets of texels that several textures share, by their addresses.
    shared: HashMap<*const Vec<f32>, usize>,
}

impl Packed {
    fn material(&mut self, material: &mut HostMaterial) -> Material {
        let map = material.normal_map.as_mut();
        Material {
            normal_map: map.and_then(|map| self.color(map).texture),
            channels: std::array::from_fn(|i| self.color(&mut material.channels[i])),
            kind: material.kind,
        }
    }

    /// Packs a color. The texels of a texture move into the common list.
    fn color(&mut self, color: &mut HostTexture) -> Color {
        let (constant, texture) = match color {
            HostTexture::Constant(c) => (DVec3::from(*c).into(), None),
            HostTexture::Image {
                texels,
                width,
                height,
                wrap,
            } => {
                let first = self.place(std::mem::take(texels));
                let texture = Texture::new(first, [*width, *height], *wrap);
                (V3::ZERO, Some(texture))
            }
        };
        Color { constant, texture }
    }

    /// Returns the offset of texels in the common list. Shared texels are packed once.
    fn place(&mut self, texels: Arc<Vec<f32>>) -> usize {
        let address = Arc::as_ptr(&texels);
        if let Some(&offset) = self.shared.get(&address) {
            return offset;
        }
        let offset = self.texels.count();
        if Arc::strong_count(&texels) > 1 {
            self.shared.insert(address, offset);
        }
        self.texels.push(texels);
        offset
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Material {
    /// Each channel is at [`Channel::place`](crate::host::Channel::place).
    pub channels: [Color; CHANNELS],
    pub kind: MaterialKind,
    pub normal_map: Option<Texture>,
}

impl Material {
    pub fn is_textured(&self) -> bool {
        self.normal_map.is_some() || self.channels.iter().any(|c| c.texture.is_some())
    }

    /// Whether any of its lobes may turn with the surface towards a map ([`Scene::turns_to_map`]).
    fn is_polished(&self, texels: &Texels) -> bool {
        let exponent = &self.channels[Channel::Roughness.place()];
        let polished = match exponent.texture {
            Some(t) => {
                let first = 3 * t.first as usize;
                let of_texture = &texels.0[first..][..3 * (t.width * t.height) as usize];
                of_texture.iter().step_by(3).any(|&r| r < POLISHED)
            }
            None => exponent.constant.x < POLISHED,
        };
        self.kind.glossy && (polished || self.kind.bsdf == BsdfKind::Phong)
    }

    /// Whether bounces may follow it ([`Scene::is_followed`]).
    pub fn is_followed(&self) -> bool {
        self.bits() & FOLLOWED != 0
    }

    /// Returns the flags of the material and the number of its BSDF.
    fn bits(&self) -> u32 {
        let kind = &self.kind;
        let bit = |is: bool, bit: u32| if is { bit } else { 0 };
        bit(kind.emits, EMITS)
            | bit(kind.reflects, REFLECTS)
            | bit(kind.glossy, GLOSSY)
            | bit(kind.compensated, COMPENSATED)
            | bit(kind.glows, GLOWS)
            | (MODEL * kind.bsdf as u32)
    }

    /// Returns the flags of the material and the words of its textures: those of its channels and its normal map.
    fn words(&self) -> [u32; MATERIAL as usize] {
        let mut words = [NONE; MATERIAL as usize];
        words[0] = self.bits();
        let textures = self.channels.iter().map(|c| c.texture);
        let textures = textures.chain([self.normal_map]);
        for (to, texture) in words[1..].chunks_exact_mut(4).zip(textures) {
            if let Some(texture) = texture {
                to.copy_from_slice(&texture.words());
            }
        }
        words
    }
}
