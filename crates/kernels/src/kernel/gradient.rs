//! The required derivatives, their sums on the host, and the gradients of tensors that follow from these sums.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;

use super::scene::KernelScene;
use crate::host::{CHANNELS, Channel, LightPart, ParameterId};
use crate::model::{V3, v3};
use crate::trace::{
    AREAS, CAMERAS, COLORS, Derivatives, LIGHTS, MATERIALS, NORMALS, OF_CAMERA, OF_LIGHT, PARTS,
    SKY, SumTangents, Sums, TANGENTS, TEXELS, TRIANGLES, UVS, VELOCITIES, VERTICES,
};

/// The derivatives that are required.
#[derive(Clone, Debug, Default)]
pub struct Wanted {
    pub of: Derivatives,
    /// For each object: 1 if derivatives with respect to its vertices or velocity are required, otherwise 0. The same
    /// in `lights` for each delta light.
    pub objects: Vec<u32>,
    pub lights: Vec<u32>,
    /// Whether each delta light moves or turns.
    pub moving_lights: Vec<bool>,
}

impl Wanted {
    /// Returns the derivatives with respect to the tracked tensors `ids`.
    pub fn new(scene: &KernelScene, ids: impl Iterator<Item = ParameterId>) -> Self {
        use ParameterId as Id;
        let mut wanted = Self {
            objects: vec![0; scene.lists.objects.len()],
            lights: vec![0; scene.emitters.lights().len()],
            moving_lights: vec![false; scene.emitters.lights().len()],
            ..Self::default()
        };
        let of = &mut wanted.of;
        // Normals turn the sampled directions.
        let mut tilts = false;
        for id in ids {
            match id {
                Id::Vertices(i) => wanted.objects[i] = 1,
                Id::Velocity(i) => {
                    wanted.objects[i] = 1;
                    of.velocities = true;
                }
                Id::Uvs(_) => of.uvs = true,
                Id::Normals(_) => of.normals = true,
                Id::Colors(_) => of.colors = true,
                Id::Tangents(_) => of.tangents = true,
                Id::NormalMap(_) => {
                    of.materials = true;
                    tilts = true;
                }
                Id::Material(_, Channel::Emission) => of.emission = true,
                Id::Material(..) => of.materials = true,
                Id::Light(i, part) => {
                    of.lights = true;
                    wanted.lights[i] = 1;
                    wanted.moving_lights[i] |=
                        matches!(part, LightPart::Position | LightPart::Direction);
                }
                Id::Environment => of.sky = true,
                // All other ids belong to cameras.
                _ => of.camera = true,
            }
        }
        let features = &scene.features;
        of.objects = wanted.objects.contains(&1);
        of.tangents &= features.tilted;
        tilts |= of.uvs && features.tilted;
        of.turns = of.normals || of.tangents || tilts;
        let uvs = of.uvs;
        wanted.of.rays = wanted.moves() || uvs;
        wanted
    }

    /// Returns whether geometry or rays move.
    pub fn moves(&self) -> bool {
        self.shifts() || self.of.turns
    }

    /// Returns whether objects, delta lights or the camera move.
    pub fn shifts(&self) -> bool {
        self.of.camera || self.of.objects || self.moving_lights.contains(&true)
    }

    /// Returns the length of each part of the sums of a scene. Parts that are not required may be empty.
    pub fn lengths(&self, scene: &KernelScene) -> [usize; PARTS] {
        let of = &self.of;
        let some = |wanted: bool, count: usize| if wanted { count } else { 0 };
        let (lists, texels) = (&scene.lists, scene.texels.0.len());
        let mut lengths = [0; PARTS];
        for (part, length) in [
            (VERTICES, some(of.objects, 3 * scene.vertices())),
            (TRIANGLES, some(of.objects, 3 * lists.surfaces.len())),
            (AREAS, some(of.objects, lists.surfaces.len())),
            (VELOCITIES, some(of.velocities, 3 * lists.objects.len())),
            (UVS, some(of.uvs, 2 * lists.uvs.len())),
            (NORMALS, some(of.normals, 3 * lists.normals.len())),
            (MATERIALS, 3 * CHANNELS * scene.materials.len()),
            (TEXELS, some(of.materials || of.emission, texels)),
            (SKY, some(of.sky, scene.sky.values.len())),
            (COLORS, some(of.colors, 3 * lists.colors.values.len())),
            (TANGENTS, some(of.tangents, 3 * lists.tangents.values.len())),
            (LIGHTS, OF_LIGHT as usize * self.lights.len()),
            (CAMERAS, OF_CAMERA as usize),
        ] {
            lengths[part as usize] = length;
        }
        lengths
    }
}

/// Sums of derivatives with respect to a scene and a camera, or in forward mode the derivatives of pixels.
pub struct HostSums {
    numbers: Vec<f64>,
    /// The index of the first number of each part.
    first: [u32; PARTS],
    of: Derivatives,
    /// In forward mode: the tangents, and the pixels whose derivatives are the numbers.
    forward: Option<(Arc<SumTangents>, Range<u32>)>,
    /// The place of the sums of the current pixel and channel.
    at: AtomicUsize,
}

impl HostSums {
    pub fn new(scene: &KernelScene, wanted: &Wanted) -> Self {
        let mut count = 0;
        let first = wanted.lengths(scene).map(|length| {
            count += length;
            u32::try_from(count - length).expect("a scene has less than 2³² derivatives")
        });
        Self {
            numbers: vec![0.0; count],
            first,
            of: wanted.of,
            forward: None,
            at: AtomicUsize::new(0),
        }
    }

    /// Makes the derivatives and values `[P, C, K + 1]` of pixels from the tangents of these sums.
    pub fn into_pixels(self, tangents: SumTangents, pixels: Range<u32>) -> Self {
        Self {
            forward: Some((Arc::new(tangents), pixels.clone())),
            ..self
        }
        .empty(pixels)
    }

    /// Returns empty sums of the same form, in forward mode for some of the pixels.
    pub fn empty(&self, pixels: Range<u32>) -> Self {
        let forward = self.forward.as_ref().map(|f| (f.0.clone(), pixels));
        let count = match &forward {
            None => self.numbers.len(),
            Some((tangents, pixels)) => pixels.len() * tangents.of_pixel(),
        };
        Self {
            numbers: vec![0.0; count],
            first: self.first,
            of: self.of,
            forward,
            at: AtomicUsize::new(0),
        }
    }

    /// Returns whether these are derivatives of pixels.
    pub fn is_forward(&self) -> bool {
        self.forward.is_some()
    }

    /// The number of sums.
    pub fn count(&self) -> usize {
        self.numbers.len()
    }

    /// Returns the derivatives and values `[P, C, K + 1]` of pixels in forward mode.
    pub fn into_numbers(self) -> Vec<f64> {
        self.numbers
    }

    /// Returns the sums in the form to which stages add.
    pub fn sums(&mut self) -> Sums<'_> {
        let sums = Sums::new(&mut self.numbers, &self.first, self.of);
        match &self.forward {
            None => sums,
            Some((tangents, pixels)) => sums.forward(tangents, pixels.start, &self.at),
        }
    }

    pub fn add(&mut self, o: &Self) {
        let mut skipped = 0;
        if let (Some((tangents, all)), Some((_, own))) = (&self.forward, &o.forward) {
            skipped = (own.start - all.start) as usize * tangents.of_pixel();
        }
        add_each(&mut self.numbers[skipped..], &o.numbers);
    }

    /// Returns the index of the first number of a part, and the index after its last one.
    pub(super) fn range(&self, part: u32) -> Range<usize> {
        let past = self.first.get(part as usize + 1);
        let past = past.map_or(self.numbers.len(), |&past| past as usize);
        self.first[part as usize] as usize..past
    }

    fn part(&self, part: u32) -> &[f64] {
        &self.numbers[self.range(part)]
    }

    /// Returns a vector of a part.
    fn vector(&self, part: u32, k: usize) -> V3 {
        let all = &self.part(part)[3 * k..][..3];
        v3(all[0] as f32, all[1] as f32, all[2] as f32)
    }

    /// Turns derivatives with respect to normals and areas into derivatives with respect to vertices.
    pub fn resolve(&mut self, scene: &KernelScene) {
        for k in 0..self.part(AREAS).len() {
            let by_normal = self.vector(TRIANGLES, k);
            let by_area = self.part(AREAS)[k] as f32;
            let tri = scene.triangle(k as u32);
            if tri.area <= 0.0 || (by_normal == V3::ZERO && by_area == 0.0) {
                continue;
            }
            let by = tri.sides_backward(by_normal, by_area);
            let [a, b, c] = scene.lists.vertex_rows[k];
            let sums = self.sums();
            sums.add_vector(3 * a, -(by.first + by.second), VERTICES);
            sums.add_vector(3 * b, by.first, VERTICES);
            sums.add_vector(3 * c, by.second, VERTICES);
        }
        let [first, past] = [TRIANGLES, AREAS + 1].map(|part| self.first[part as usize] as usize);
        self.numbers[first..past].fill(0.0);
    }

    /// Adds the derivatives with respect to parameters of the scene at their places in `all`.
    /// [`resolve`](Self::resolve) must have been called.
    pub fn write(
        &self,
        scene: &KernelScene,
        places: &[(ParameterId, Range<usize>)],
        all: &mut [f64],
    ) {
        for (id, range) in places {
            let to = &mut all[range.clone()];
            if let ParameterId::Light(i, part) = *id {
                let own = &self.part(LIGHTS)[OF_LIGHT as usize * i..];
                let by = scene.by_light(i, part, std::array::from_fn(|k| own[k]));
                add_each(to, &by);
            } else if let Some(rows) = Rows::of(scene, *id, to.len()) {
                let own = self.part(rows.part).get(rows.width * rows.first..);
                let own = own.unwrap_or_default().chunks_exact(rows.width);
                for (to, own) in to.chunks_exact_mut(rows.length).zip(own) {
                    to.iter_mut()
                        .zip(own)
                        .for_each(|(to, by)| *to += by * rows.factor);
                }
            }
        }
    }

    /// Returns the sums of the camera.
    pub fn camera(&self) -> &[f64] {
        self.part(CAMERAS)
    }
}

fn add_each(to: &mut [f64], from: &[f64]) {
    to.iter_mut().zip(from).for_each(|(a, b)| *a += *b);
}

/// The rows of a part of the sums from which the gradient of a tensor is made.
pub struct Rows {
    pub part: u32,
    /// The length of a row of sums, and (in `first`) the index of the tensor's first row.
    pub width: usize,
    pub first: usize,
    /// The length of a row of the tensor: it takes the first numbers of a row of sums, and zeros after them.
    pub length: usize,
    pub factor: f64,
}

impl Rows {
    /// Returns the rows for a tensor of `numbers` values, or `None` if it has none, as for delta lights and cameras.
    pub fn of(scene: &KernelScene, id: ParameterId, numbers: usize) -> Option<Self> {
        use ParameterId as Id;
        let per_unit = scene.frame.unit.recip();
        let object = |i: usize| &scene.lists.objects[i];
        let (part, first, length, factor) = match id {
            Id::Vertices(i) => (VERTICES, object(i).first_vertex, 3, per_unit),
            Id::Velocity(i) => (VELOCITIES, i, 3, per_unit),
            Id::Uvs(i) => (UVS, object(i).first_uv, 2, 1.0),
            Id::Normals(i) => (NORMALS, object(i).first_normal, 3, 1.0),
            Id::Colors(i) => (COLORS, object(i).first_color, 3, 1.0),
            // Tangents only matter where a material has a normal map.
            Id::Tangents(i) if scene.features.tilted => (TANGENTS, object(i).first_tangent, 4, 1.0),
            Id::NormalMap(m) => {
                let texels = scene.materials[m].normal_map?;
                (TEXELS, texels.first as usize, 3, 1.0)
            }
            Id::Material(m, channel) => {
                let place = channel.place();
                match &scene.materials[m].channels[place].texture {
                    None => (MATERIALS, CHANNELS * m + place, numbers, 1.0),
                    Some(t) => {
                        let texels = (t.width * t.height) as usize;
                        (TEXELS, t.first as usize, numbers / texels, 1.0)
                    }
                }
            }
            Id::Environment => (SKY, 0, 3, 1.0),
            _ => return None,
        };
        Some(Self {
            part,
            width: if part == UVS { 2 } else { 3 },
            first,
            length,
            factor,
        })
    }
}
