//! Flattens a scene into planes of triangles and materials.

mod attached;
mod materials;

use burn::tensor::Tensor;

use super::check::{check_camera, check_scene};
use super::{Bounds, Camera, Scene};
use crate::error::Result;
use crate::geometry::{Context, Topology, Triangles, Vec3, VertexData, Weld};
use attached::Attached;
pub(crate) use materials::{ChannelPlanes, EnvironmentMap, Materials, SkyTensors};

/// A sphere around the scene that sets the scale of depths and tolerances; takes no gradient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Normalization {
    /// The mean of all vertices, scene units.
    pub center: [f64; 3],
    /// The largest distance of a vertex from it, over the whole shutter.
    pub radius: f64,
}

impl From<Bounds> for Normalization {
    fn from(bounds: Bounds) -> Self {
        Self {
            center: bounds.center(),
            radius: bounds.radius(),
        }
    }
}

/// A scene as planes of triangles and materials.
#[derive(Clone, Debug)]
pub(crate) struct Flattened {
    /// Device and float type.
    pub context: Context,
    /// The triangles, relative to the centre of the normalization, in units of `unit`.
    pub triangles: Triangles,
    /// Host-side connectivity.
    pub topology: Topology,
    /// All materials.
    pub(crate) materials: Materials,
    /// The triangles that emit.
    pub emitters: Vec<u32>,
    /// The place and size of the scene, in scene units.
    pub(crate) normalization: Normalization,
    /// The unit of length of the planes, in scene units: the power of two
    /// nearest to the scene's radius. So a scene renders alike at any scale, and squares and
    /// products of small lengths do not underflow.
    pub unit: f64,
    /// Texture coordinates of the corners, z unused, if any material has a texture.
    pub uvs: Option<VertexData>,
    /// Shading normals of the corners, if any mesh has them, and for which triangles.
    pub normals: Option<(VertexData, Vec<bool>)>,
    /// The environment, if it is not a constant black.
    pub environment: Option<SkyTensors>,
}

impl Flattened {
    /// Checks the scene and the camera that sees it, and gathers the triangles. A normalization, where it is
    /// given, sets the scale of depths and tolerances in place of the scene's vertices.
    ///
    /// # Errors
    /// If the scene or the camera is not valid; the error names the mistake.
    pub fn new(
        scene: &Scene,
        camera: &Camera,
        normalization: Option<Normalization>,
    ) -> Result<Self> {
        let context = check_scene(scene)?;
        let mut positions = Vec::with_capacity(scene.objects.len());
        let mut shifts = Vec::with_capacity(scene.objects.len());
        for object in &scene.objects {
            positions.push(object.mesh.host_vertices()?);
            shifts.push(match &object.velocity {
                Some(v) => v.check(&object.name, "velocity", "finite numbers", |_| true)?,
                None => [0.0; 3],
            });
        }
        let normalization = normalization.unwrap_or_else(|| normalization_of(&positions, &shifts));
        let unit = normalization.radius.log2().round().exp2();
        let centre = context.tensor(&normalization.center, [1, 3]);
        let corner = |i| {
            let parts = scene
                .objects
                .iter()
                .filter(|o| !o.mesh.faces.is_empty())
                .map(|o| o.mesh.corner(i))
                .collect();
            Vec3::from_columns((Tensor::cat(parts, 0) - centre.clone()) * unit.recip())
        };
        let corners = VertexData {
            a: corner(0),
            b: corner(1),
            c: corner(2),
        };
        let Attached {
            velocity,
            uvs,
            normals,
            materials,
            environment,
        } = Attached::new(scene, &context, unit);
        let triangles = Triangles::new(&context, corners, velocity);
        let mut topology = topology(scene, &positions);
        let emitters: Vec<u32> = (0..topology.object.len() as u32)
            .filter(|&t| materials.kinds[topology.material[t as usize] as usize].emits)
            .collect();
        if emitters.is_empty() && environment.is_none() {
            log::warn!(
                "the scene has no light, so that its image is black: give it an environment \
                 (Scene::environment), or an object a Material::emitter"
            );
        }
        check_camera(camera, &context)?;
        let eye = camera.eye.values()?;
        let mut first = 0;
        for (object, positions) in scene.objects.iter().zip(&positions) {
            let faces = &object.mesh.faces;
            let past = first + faces.len();
            if !faces.is_empty() && topology.closed[first] {
                let side = visible_side(positions, faces, eye);
                topology.visible_side[first..past].fill(side);
            }
            first = past;
        }
        Ok(Self {
            context,
            triangles,
            topology,
            materials,
            emitters,
            normalization,
            unit,
            uvs,
            normals,
            environment,
        })
    }

    /// The number of objects with triangles.
    pub(crate) fn objects(&self) -> usize {
        self.topology.object.last().map_or(0, |&o| o as usize + 1)
    }

    /// The scene's radius in units of `unit`.
    pub fn radius(&self) -> f64 {
        self.normalization.radius / self.unit
    }
}

/// Objects, materials and neighbours of all triangles.
fn topology(scene: &Scene, positions: &[Vec<[f64; 3]>]) -> Topology {
    let mut base = 0;
    let mut topology = Topology::default();
    for (object, positions) in scene.objects.iter().zip(positions) {
        let of_face: Vec<u32> = (0..object.mesh.faces.len())
            .map(|f| base + object.face_materials.get(f).copied().unwrap_or(0))
            .collect();
        base += object.materials.len() as u32;
        topology.push_object(&Weld::new(positions), &object.mesh.faces, &of_face);
    }
    topology
}

fn normalization_of(objects: &[Vec<[f64; 3]>], shifts: &[[f64; 3]]) -> Normalization {
    let all = || objects.iter().flatten();
    let n = all().count() as f64;
    let center: [f64; 3] = std::array::from_fn(|i| all().map(|v| v[i]).sum::<f64>() / n);
    let distance = |v: &[f64; 3], u: &[f64; 3], time: f64| {
        (0..3)
            .map(|i| (v[i] + time * u[i] - center[i]).powi(2))
            .sum::<f64>()
            .sqrt()
    };
    let radius = objects
        .iter()
        .zip(shifts)
        .flat_map(|(positions, u)| {
            let far = |v| distance(v, u, 0.0).max(distance(v, u, 1.0));
            positions.iter().map(far)
        })
        .fold(0.0, f64::max);
    // A scene that is one point has no scale of its own.
    let radius = if radius > 0.0 { radius } else { 1.0 };
    Normalization { center, radius }
}

/// The side of a closed object that can be seen from `eye`: +1 those with n·d > 0, −1 those with
/// n·d < 0. From outside a surface can only be entered, from inside only be left; nothing
/// transmits light, so this holds for every ray of a path.
fn visible_side(positions: &[[f64; 3]], faces: &[[u32; 3]], eye: [f64; 3]) -> f64 {
    let eye = glam::DVec3::from(eye);
    let (mut solid_angle, mut volume) = (0.0, 0.0);
    for f in faces {
        let [a, b, c] = f.map(|i| glam::DVec3::from(positions[i as usize]) - eye);
        let triple = a.dot(b.cross(c));
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        // Van Oosterom and Strackee 1983.
        let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
        solid_angle += 2.0 * triple.atan2(below);
        volume += triple;
    }
    let outside = solid_angle.abs() < 2.0 * std::f64::consts::PI;
    if outside == (volume > 0.0) { -1.0 } else { 1.0 }
}
