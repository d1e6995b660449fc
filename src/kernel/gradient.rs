//! Sums of derivatives by what a scene and its camera are made of.

use std::ops::{AddAssign, Range};

use glam::DVec3;

use super::delta_sums::DeltaSums;
use super::scene::KernelScene;
use crate::model::camera::CameraGradient;
use crate::scene::{CHANNELS, Channel, LightPart, ParameterId};

/// Which derivatives are asked for.
#[derive(Clone, Debug, Default)]
pub(crate) struct Wanted {
    /// Whether rays and the points that they hit have any.
    pub rays: bool,
    /// Objects whose vertices or velocity have.
    pub objects: Vec<bool>,
    pub velocities: bool,
    pub uvs: bool,
    pub normals: bool,
    /// Colours at corners.
    pub colours: bool,
    pub tangents: bool,
    /// Whether normals are tilted by what has any: texels of normal maps, or their coordinates.
    pub tilts: bool,
    /// Colours and exponents of materials.
    pub materials: bool,
    pub exponents: bool,
    pub emission: bool,
    /// Whether each light without extent has any, and whether it moves or turns.
    pub lights: Vec<bool>,
    pub moving_lights: Vec<bool>,
    pub sky: bool,
    pub camera: bool,
}

impl Wanted {
    /// The derivatives by tensors that are in a graph.
    pub fn new(scene: &KernelScene, ids: impl Iterator<Item = ParameterId>) -> Self {
        use ParameterId as Id;
        let mut wanted = Self {
            objects: vec![false; scene.objects.len()],
            lights: vec![false; scene.emitters.lights().len()],
            moving_lights: vec![false; scene.emitters.lights().len()],
            ..Self::default()
        };
        for id in ids {
            match id {
                Id::Vertices(i) => wanted.objects[i] = true,
                Id::Velocity(i) => {
                    wanted.objects[i] = true;
                    wanted.velocities = true;
                }
                Id::Uvs(_) => wanted.uvs = true,
                Id::Normals(_) => wanted.normals = true,
                Id::Colours(_) => wanted.colours = true,
                Id::Tangents(_) => wanted.tangents = true,
                Id::NormalMap(_) => {
                    wanted.materials = true;
                    wanted.tilts = true;
                }
                Id::Material(_, Channel::Emission) => wanted.emission = true,
                Id::Material(_, channel) => {
                    wanted.materials = true;
                    wanted.exponents |= channel.turns();
                }
                Id::Light(i, part) => {
                    wanted.lights[i] = true;
                    wanted.moving_lights[i] |=
                        matches!(part, LightPart::Position | LightPart::Direction);
                }
                Id::Environment => wanted.sky = true,
                // Those of cameras.
                _ => wanted.camera = true,
            }
        }
        // Normals and exponents turn the directions that are drawn.
        wanted.exponents &= scene.glossy;
        wanted.tangents &= scene.tilted;
        wanted.tilts |= wanted.uvs && scene.tilted;
        wanted.rays = wanted.moves() || wanted.uvs;
        wanted
    }

    /// Whether anything moves: geometry, or rays.
    pub fn moves(&self) -> bool {
        self.shifts() || self.turns()
    }

    /// Whether objects, lights or the camera move.
    pub fn shifts(&self) -> bool {
        let lights = self.moving_lights.contains(&true);
        self.camera || lights || self.objects.contains(&true)
    }

    /// Whether directions that are drawn at a surface turn while it stands still.
    pub fn turns(&self) -> bool {
        self.normals || self.exponents || self.tangents || self.tilts
    }
}

/// Derivatives by a triangle's normal and area, which go to its corners at the end.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TriangleSums {
    pub normal: DVec3,
    pub area: f64,
}

/// Derivatives by what a camera is made of ([`CameraGradient`]).
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CameraSums {
    pub eye: DVec3,
    pub across: DVec3,
    pub upward: DVec3,
    pub forward: DVec3,
    pub lens: [DVec3; 2],
    pub per_focus: f64,
    pub filter: f64,
}

#[cfg(feature = "wgpu")]
impl CameraSums {
    /// From its numbers, in the order of its fields.
    pub fn of(number: impl Fn(usize) -> f64) -> Self {
        let vector = |k: usize| DVec3::new(number(3 * k), number(3 * k + 1), number(3 * k + 2));
        Self {
            eye: vector(0),
            across: vector(1),
            upward: vector(2),
            forward: vector(3),
            lens: [vector(4), vector(5)],
            per_focus: number(18),
            filter: number(19),
        }
    }
}

impl AddAssign for CameraSums {
    fn add_assign(&mut self, o: Self) {
        self.eye += o.eye;
        self.across += o.across;
        self.upward += o.upward;
        self.forward += o.forward;
        self.lens[0] += o.lens[0];
        self.lens[1] += o.lens[1];
        self.per_focus += o.per_focus;
        self.filter += o.filter;
    }
}

impl From<CameraGradient> for CameraSums {
    #[inline(always)]
    fn from(g: CameraGradient) -> Self {
        Self {
            eye: g.eye.into(),
            across: g.across.into(),
            upward: g.upward.into(),
            forward: g.forward.into(),
            lens: [g.lens.first.into(), g.lens.second.into()],
            per_focus: g.per_focus.into(),
            filter: g.filter.into(),
        }
    }
}

/// Sums of derivatives. What is not asked for may be empty.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sums {
    pub vertices: Vec<DVec3>,
    pub triangles: Vec<TriangleSums>,
    /// One for each object.
    pub velocities: Vec<DVec3>,
    pub uvs: Vec<[f64; 2]>,
    pub normals: Vec<DVec3>,
    pub colours: Vec<DVec3>,
    pub tangents: Vec<DVec3>,
    /// Each at its place ([`Channel::place`]).
    pub materials: Vec<[DVec3; CHANNELS]>,
    pub texels: Vec<DVec3>,
    pub lights: Vec<DeltaSums>,
    pub sky: Vec<DVec3>,
    pub camera: CameraSums,
}

fn add_each<T: Copy + AddAssign>(to: &mut [T], from: &[T]) {
    to.iter_mut().zip(from).for_each(|(a, b)| *a += *b);
}

impl Sums {
    pub fn new(scene: &KernelScene, wanted: &Wanted) -> Self {
        let zeros = |wanted: bool, count: usize| vec![DVec3::ZERO; if wanted { count } else { 0 }];
        let moves = wanted.objects.contains(&true);
        let vertices = scene
            .objects
            .last()
            .map_or(0, |o| o.first_vertex + o.vertices);
        Self {
            vertices: zeros(moves, vertices),
            triangles: if moves {
                vec![TriangleSums::default(); scene.triangles.len()]
            } else {
                Vec::new()
            },
            velocities: zeros(wanted.velocities, scene.objects.len()),
            uvs: vec![[0.0; 2]; if wanted.uvs { scene.uvs.len() } else { 0 }],
            normals: zeros(wanted.normals, scene.normals.len()),
            colours: zeros(wanted.colours, scene.colours.values.len()),
            tangents: zeros(wanted.tangents, scene.tangents.values.len()),
            materials: vec![[DVec3::ZERO; CHANNELS]; scene.materials.len()],
            texels: zeros(wanted.materials || wanted.emission, scene.texels.len()),
            lights: vec![DeltaSums::default(); wanted.lights.len()],
            sky: zeros(wanted.sky, scene.sky.len()),
            camera: CameraSums::default(),
        }
    }

    /// The number of its numbers.
    pub fn len(&self) -> usize {
        3 * (self.vertices.len() + self.velocities.len() + self.normals.len())
            + 3 * (self.texels.len() + self.sky.len())
            + 3 * (self.colours.len() + self.tangents.len())
            + 4 * self.triangles.len()
            + 11 * self.lights.len()
            + 2 * self.uvs.len()
            + 3 * CHANNELS * self.materials.len()
            + 19
    }

    pub fn add(&mut self, o: &Self) {
        add_each(&mut self.vertices, &o.vertices);
        for (a, b) in self.triangles.iter_mut().zip(&o.triangles) {
            a.normal += b.normal;
            a.area += b.area;
        }
        add_each(&mut self.velocities, &o.velocities);
        for (a, b) in self.uvs.iter_mut().zip(&o.uvs) {
            add_each(a, b);
        }
        add_each(&mut self.normals, &o.normals);
        add_each(&mut self.colours, &o.colours);
        add_each(&mut self.tangents, &o.tangents);
        for (a, b) in self.materials.iter_mut().zip(&o.materials) {
            add_each(a, b);
        }
        add_each(&mut self.texels, &o.texels);
        add_each(&mut self.lights, &o.lights);
        add_each(&mut self.sky, &o.sky);
        self.camera += o.camera;
    }

    /// Turns derivatives by normals and areas into those by the vertices.
    pub fn resolve(&mut self, scene: &KernelScene) {
        for (k, sums) in self.triangles.iter().enumerate() {
            let tri = &scene.triangles[k];
            if tri.area <= 0.0 || (sums.normal == DVec3::ZERO && sums.area == 0.0) {
                continue;
            }
            let [a, b, c] = tri.corners.map(DVec3::from);
            let normal = DVec3::from(tri.normal);
            let (ab, ac) = (b - a, c - a);
            let across = sums.normal - normal * normal.dot(sums.normal);
            let by_cross = across / (2.0 * f64::from(tri.area)) + normal * (0.5 * sums.area);
            let (by_ab, by_ac) = (ac.cross(by_cross), by_cross.cross(ab));
            let [va, vb, vc] = scene.vertex_rows[k].map(|v| v as usize);
            self.vertices[va] -= by_ab + by_ac;
            self.vertices[vb] += by_ab;
            self.vertices[vc] += by_ac;
        }
        self.triangles.clear();
    }

    /// The numbers of a row of a part, 0 where there is none.
    fn row(&self, part: Part, row: usize) -> [f64; 3] {
        let of = |list: &[DVec3]| list.get(row).copied().unwrap_or_default().to_array();
        match part {
            Part::Vertices => of(&self.vertices),
            Part::Velocities => of(&self.velocities),
            Part::Uvs => {
                let [u, v] = self.uvs[row];
                [u, v, 0.0]
            }
            Part::Normals => of(&self.normals),
            Part::Colours => of(&self.colours),
            Part::Tangents => of(&self.tangents),
            Part::Materials => of(self.materials.as_flattened()),
            Part::Texels => of(&self.texels),
            Part::Sky => of(&self.sky),
        }
    }

    /// Adds the derivatives by parameters of the scene at their places; the sums must be resolved.
    pub fn write(
        &self,
        scene: &KernelScene,
        places: &[(ParameterId, Range<usize>)],
        all: &mut [f64],
    ) {
        for (id, range) in places {
            let to = &mut all[range.clone()];
            if let ParameterId::Light(i, part) = *id {
                self.lights[i].write(scene, i, part, to);
            } else if let Some(rows) = Rows::of(scene, *id, to.len()) {
                for (i, to) in to.chunks_exact_mut(rows.length).enumerate() {
                    let by = self.row(rows.part, rows.first + i);
                    add_each(to, &by.map(|g| g * rows.factor));
                }
            }
        }
    }
}

/// Sums of a scene that are lists of rows.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Part {
    Vertices,
    Velocities,
    Uvs,
    Normals,
    Colours,
    Tangents,
    /// As many rows as a material has channels.
    Materials,
    Texels,
    Sky,
}

/// The sums that the derivative by a tensor follows from.
pub(crate) struct Rows {
    pub part: Part,
    pub first: usize,
    /// Numbers of a row of the tensor: the first of a row of sums, and zeros behind them.
    pub length: usize,
    pub factor: f64,
}

impl Rows {
    /// Those of a tensor of so many numbers; none of lights without extent and cameras.
    pub fn of(scene: &KernelScene, id: ParameterId, numbers: usize) -> Option<Self> {
        use ParameterId as Id;
        let per_unit = scene.frame.unit.recip();
        let object = |i: usize| &scene.objects[i];
        let (part, first, length, factor) = match id {
            Id::Vertices(i) => (Part::Vertices, object(i).first_vertex, 3, per_unit),
            Id::Velocity(i) => (Part::Velocities, i, 3, per_unit),
            Id::Uvs(i) => (Part::Uvs, object(i).first_uv, 2, 1.0),
            Id::Normals(i) => (Part::Normals, object(i).first_normal, 3, 1.0),
            Id::Colours(i) => (Part::Colours, object(i).first_colour, 3, 1.0),
            // They count where a material has a normal map.
            Id::Tangents(i) if scene.tilted => (Part::Tangents, object(i).first_tangent, 4, 1.0),
            Id::NormalMap(m) => {
                let texels = scene.materials[m].normal_map?;
                (Part::Texels, texels.first as usize, 3, 1.0)
            }
            Id::Material(m, channel) => {
                let place = channel.place();
                match &scene.materials[m].channels[place].texture {
                    None => (Part::Materials, CHANNELS * m + place, numbers, 1.0),
                    Some(t) => {
                        let texels = (t.width * t.height) as usize;
                        (Part::Texels, t.first as usize, numbers / texels, 1.0)
                    }
                }
            }
            Id::Environment => (Part::Sky, 0, 3, 1.0),
            _ => return None,
        };
        Some(Self {
            part,
            first,
            length,
            factor,
        })
    }
}
