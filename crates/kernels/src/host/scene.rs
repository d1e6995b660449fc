//! Scenes, objects and materials.

use std::sync::Arc;

use glam::DVec3;

use super::{Bounds, Channel, Holes, HostLight, HostTexture, MaterialKind};

/// A scene.
pub struct HostScene {
    /// The objects, in the order of their ids.
    pub objects: Vec<HostObject>,
    /// The materials of all objects, one object after the other.
    pub materials: Vec<HostMaterial>,
    /// Delta lights.
    pub lights: Vec<HostLight>,
    /// The radiance from infinity: a constant, or an equirectangular map.
    pub environment: HostTexture,
    /// The holes of alpha masks, if any surface has any.
    pub holes: Option<Arc<Holes>>,
    /// False only for an environment that is a constant black.
    pub shines: bool,
}

/// An object.
pub struct HostObject {
    /// The positions of the vertices, in scene units.
    pub positions: Vec<[f64; 3]>,
    /// The vertices of each face, counterclockwise seen from the front.
    pub faces: Arc<Vec<[u32; 3]>>,
    /// Texture coordinates.
    pub uvs: Option<HostAttribute<2>>,
    /// Normals, of any length.
    pub normals: Option<HostAttribute<3>>,
    /// Colors that multiply the base color, linear RGB.
    pub colors: Option<HostAttribute<3>>,
    /// Tangents for normal maps, with the sign of the bitangent.
    pub tangents: Option<HostAttribute<4>>,
    /// Its linear velocity, in scene units over the shutter, if it moves or may come to move.
    pub velocity: Option<[f64; 3]>,
    /// The index in the scene of the first of its materials.
    pub first_material: usize,
    /// The index of each face's material among its own. If the list is empty, all faces have the first one.
    pub face_materials: Arc<Vec<u32>>,
}

impl HostObject {
    /// The bounding box over the shutter, or None without vertices.
    pub fn bounds(&self) -> Option<Bounds> {
        let bounds = Bounds::of_points(self.positions.iter().copied())?;
        let moved = self.velocity.map(|v| bounds.union(&bounds.moved(v)));
        Some(moved.unwrap_or(bounds))
    }

    /// The material of a face in the scene.
    pub fn material_of(&self, face: usize) -> usize {
        self.first_material + self.face_materials.get(face).copied().unwrap_or(0) as usize
    }

    /// The material of each face in the scene, and its texture coordinates.
    pub fn masked_faces(&self) -> impl Iterator<Item = (usize, Option<[[f32; 2]; 3]>)> {
        (0..self.faces.len()).map(|f| {
            let of_face = |uvs: &HostAttribute<2>| uvs.faces[f].map(|row| uvs.values[row as usize]);
            (self.material_of(f), self.uvs.as_ref().map(of_face))
        })
    }
}

/// Values at the corners of faces.
pub struct HostAttribute<const C: usize> {
    /// The values.
    pub values: Vec<[f32; C]>,
    /// The rows of the values at the corners of each face.
    pub faces: Arc<Vec<[u32; 3]>>,
}

/// A material.
pub struct HostMaterial {
    /// The parameters, each at its place ([`Channel::place`]).
    pub channels: Vec<HostTexture>,
    /// The parts that it has.
    pub kind: MaterialKind,
    /// Tilts of the shading normal.
    pub normal_map: Option<HostTexture>,
}

impl HostMaterial {
    /// Whether its radiance is other than 0.
    pub fn shines(&self) -> bool {
        self.channels[Channel::Emission.place()].shines()
    }
}

impl HostScene {
    /// Whether any triangle has an area.
    pub fn has_area(&self) -> bool {
        self.objects.iter().any(|object| {
            let corner = |v: u32| DVec3::from(object.positions[v as usize]);
            let has_area = |face: &[u32; 3]| {
                let [a, b, c] = face.map(corner);
                (b - a).cross(c - a) != DVec3::ZERO
            };
            object.faces.iter().any(has_area)
        })
    }

    /// Whether any emitter or the environment has a radiance other than 0.
    pub fn has_light(&self) -> bool {
        let lights = self.lights.iter().any(|l| l.strength != [0.0; 3]);
        lights || self.environment.shines() || self.materials.iter().any(HostMaterial::shines)
    }
}

/// The coordinates in which a scene is traced: relative to a center, in a unit that is a power of two, so that
/// nothing rounds. Both are medians over the vertices: what lies far away from the rest does not count.
#[derive(Clone, Copy, Debug)]
pub struct SceneFrame {
    /// The center, in scene units.
    pub center: DVec3,
    /// The unit, in scene units.
    pub unit: f64,
}

impl SceneFrame {
    /// The frame of a scene.
    pub fn new(scene: &HostScene) -> Self {
        let count: usize = scene.objects.iter().map(|o| o.positions.len()).sum();
        let all = || scene.objects.iter().flat_map(|o| &o.positions);
        // Some of many serve as well.
        let stride = (count / 4096).max(1);
        let some: Vec<DVec3> = all().step_by(stride).map(|&p| p.into()).collect();
        let median = |mut values: Vec<f64>| -> f64 {
            let middle = values.len() / 2;
            if values.is_empty() {
                return 0.0;
            }
            *values.select_nth_unstable_by(middle, f64::total_cmp).1
        };
        let along = |axis: usize| median(some.iter().map(|p| p[axis]).collect());
        let center = DVec3::new(along(0), along(1), along(2));
        let spread = |from: DVec3| median(some.iter().map(|p| p.distance(from)).collect());
        // Coordinates that are not far from their origin stay as they are, which rounds nothing.
        let near = spread(center);
        let (center, size) = if center.length() > 16.0 * near {
            (center, near)
        } else {
            (DVec3::ZERO, spread(DVec3::ZERO))
        };
        let size = if size > 0.0 && size.is_finite() {
            size
        } else {
            1.0
        };
        Self {
            center,
            unit: size.log2().round().exp2(),
        }
    }

    /// A point in scene units, in the coordinates of the frame.
    pub fn inner(&self, p: DVec3) -> DVec3 {
        (p - self.center) / self.unit
    }
}
