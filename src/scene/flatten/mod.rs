//! Flattens a scene into planes of triangles and materials.

mod attached;
mod materials;

use std::sync::Arc;

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
pub struct Flattened {
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
    /// The centre and the size of the scene, in scene units.
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
    /// The objects that the topology was made from.
    connected: Arc<Vec<Connected>>,
}

/// An object on the host.
#[derive(Debug)]
struct Connected {
    /// Scene units.
    positions: Vec<[f64; 3]>,
    faces: Arc<Vec<[u32; 3]>>,
    weld: Weld,
}

impl Connected {
    /// Whether its triangles have the same neighbours.
    fn is_like(&self, other: &Self) -> bool {
        (Arc::ptr_eq(&self.faces, &other.faces) || self.faces == other.faces)
            && self.weld == other.weld
    }
}

impl Flattened {
    /// Checks the scene and gathers its triangles. Bounds, where they are given, set the scale of depths
    /// and tolerances in place of the scene's vertices.
    ///
    /// # Errors
    /// If the scene or the camera is not valid.
    pub fn new(scene: &Scene, camera: &Camera, bounds: Option<Bounds>) -> Result<Self> {
        Self::of_scene(scene, bounds.map(Normalization::from), None)?.seen_by(camera)
    }

    /// Flattens a scene without a camera ([`Flattened::seen_by`] sets one). Neighbours of objects that are connected as in
    /// the scene `like` are taken from there.
    ///
    /// # Errors
    /// As [`Flattened::new`].
    pub(crate) fn of_scene(
        scene: &Scene,
        normalization: Option<Normalization>,
        like: Option<&Self>,
    ) -> Result<Self> {
        let context = check_scene(scene)?;
        let mut connected = Vec::with_capacity(scene.objects.len());
        let mut shifts = Vec::with_capacity(scene.objects.len());
        for object in &scene.objects {
            let positions = object.mesh.host_vertices()?;
            connected.push(Connected {
                weld: Weld::new(&positions),
                positions,
                faces: object.mesh.faces.clone(),
            });
            shifts.push(match &object.velocity {
                Some(v) => v.check(&object.name, "velocity", "finite numbers", |_| true)?,
                None => [0.0; 3],
            });
        }
        let topology = topology(scene, &connected, like);
        let normalization = normalization.unwrap_or_else(|| normalization_of(&connected, &shifts));
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
        let emitters: Vec<u32> = (0..topology.object.len() as u32)
            .filter(|&t| materials.kinds[topology.material[t as usize] as usize].emits)
            .collect();
        if emitters.is_empty() && environment.is_none() {
            log::warn!(
                "the scene has no light, so that its image is black: give it an environment \
                 (Scene::environment), or an object a Material::emitter"
            );
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
            connected: Arc::new(connected),
        })
    }

    /// Sets which sides of closed objects the camera can see.
    ///
    /// # Errors
    /// If the camera is not valid.
    pub(crate) fn seen_by(mut self, camera: &Camera) -> Result<Self> {
        check_camera(camera, &self.context)?;
        let eye = camera.eye.values()?;
        let mut first = 0;
        for object in self.connected.iter() {
            let n = object.faces.len();
            if n > 0 && self.topology.closed[first] {
                let side = visible_side(&object.positions, &object.faces, eye);
                self.topology.visible_side[first..first + n].fill(side);
            }
            first += n;
        }
        Ok(self)
    }

    /// The number of objects that have triangles.
    pub(crate) fn objects(&self) -> usize {
        self.topology.object.last().map_or(0, |&o| o as usize + 1)
    }

    /// The scene's radius in units of `unit`.
    pub fn radius(&self) -> f64 {
        self.normalization.radius / self.unit
    }
}

/// Objects, materials and neighbours of all triangles.
fn topology(scene: &Scene, connected: &[Connected], like: Option<&Flattened>) -> Topology {
    let like = like.filter(|other| {
        let pairs = || connected.iter().zip(other.connected.iter());
        connected.len() == other.connected.len() && pairs().all(|(a, b)| a.is_like(b))
    });
    let (mut base, mut first) = (0, 0);
    let mut topology = like.map_or_else(Topology::default, |other| other.topology.clone());
    for (object, host) in scene.objects.iter().zip(connected) {
        let n = object.mesh.faces.len();
        let of_face: Vec<u32> = (0..n)
            .map(|f| base + object.face_materials.get(f).copied().unwrap_or(0))
            .collect();
        base += object.materials.len() as u32;
        match like {
            Some(_) => topology.material[first..first + n].copy_from_slice(&of_face),
            None => topology.push_object(&host.weld, &object.mesh.faces, &of_face),
        }
        first += n;
    }
    topology
}

fn normalization_of(objects: &[Connected], shifts: &[[f64; 3]]) -> Normalization {
    let all = || objects.iter().flat_map(|o| o.positions.iter());
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
        .flat_map(|(o, u)| {
            let far = |v| distance(v, u, 0.0).max(distance(v, u, 1.0));
            o.positions.iter().map(far)
        })
        .fold(0.0, f64::max);
    // A scene that is one point has no scale of its own.
    let radius = if radius > 0.0 { radius } else { 1.0 };
    Normalization { center, radius }
}

/// The side of a closed object that can be seen from `eye`: +1 if its sides with n·d > 0, −1 if those with
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
