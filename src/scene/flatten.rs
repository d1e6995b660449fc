//! Flattens a scene into planes of triangles and materials.

use std::sync::Arc;

use burn::tensor::Tensor;
use glam::DVec3;

use super::material_planes::{ChannelPlanes, Materials, planes, texel_rows};
use super::mesh::take_rows;
use super::texture::Value;
use super::{Bounds, Camera, CornerAttribute, Environment, LightPlanes, Mesh, Parameter, Scene};
use crate::error::Result;
use crate::geometry::{Context, Topology, Triangles, Vec3, VertexData};
use softray_kernels::host::{Holes, HostAttribute, HostObject, HostScene, SceneFrame, Weld};

/// A sphere about the scene that sets the scale of depths and tolerances. It has no gradient.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Normalization {
    /// The center, in scene units.
    pub center: [f64; 3],
    /// The radius, in scene units.
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
    /// The triangles, relative to the center of the normalization, in units of `unit`.
    pub triangles: Triangles,
    /// Connectivity, on the host.
    pub topology: Topology,
    /// All materials.
    pub(crate) materials: Materials,
    /// The indices of the triangles that emit.
    pub emitters: Vec<u32>,
    /// The position and size of the scene, in scene units.
    pub(crate) normalization: Normalization,
    /// The unit of length of the planes, in scene units: the power of two nearest to the scene's radius.
    /// A scene therefore renders alike at any scale, and squares and products of small lengths do not underflow.
    pub unit: f64,
    /// Texture coordinates of the corners, if any material has a texture or a normal map. z is unused.
    pub uvs: Option<VertexData>,
    /// Shading normals of the corners and whether each triangle has them, if any mesh has them.
    pub normals: Option<(VertexData, Vec<bool>)>,
    /// Colors of the corners, if any mesh has them. They are 1 where a mesh has none.
    pub colors: Option<VertexData>,
    /// Normal maps, if any material has one.
    pub tilts: Option<Tilts>,
    /// Holes, if any surface has any.
    pub holes: Option<Arc<Holes>>,
    /// Delta lights, if there are any.
    pub(crate) lights: Option<LightPlanes>,
    /// The environment, unless it is a constant black.
    pub environment: Option<SkyTensors>,
}

/// The data of normal maps.
#[derive(Clone, Debug)]
pub(crate) struct Tilts {
    /// Tangents of the corners, of any length; 0 where a mesh has none.
    pub tangents: VertexData,
    /// The sign of each triangle's bitangents, 1 or −1; 0 where a mesh has no tangents.
    pub sides: Vec<f64>,
    /// Texels of the maps, and (0, 0, 1) for materials without a map.
    pub maps: ChannelPlanes,
}

impl Flattened {
    /// Gathers the triangles of a scene and computes their connectivity from the values on the host.
    ///
    /// # Errors
    /// If the position of the camera can't be read.
    pub fn new(
        scene: &Scene,
        (host, context): (&HostScene, &Context),
        camera: &Camera,
        normalization: Normalization,
    ) -> Result<Self> {
        let unit = normalization.radius.log2().round().exp2();
        let center = context.tensor(&normalization.center, [1, 3]);
        let relative = |p: Tensor<2>| (p - center.clone()) * unit.recip();
        let positions = corners(scene, context, 0.0, |m| Some((&m.vertices, &m.faces)));
        let tilts = Tilts::new(scene, host, context);
        let materials: Vec<_> = scene.objects.iter().flat_map(|o| &o.materials).collect();
        let materials = Materials::new(materials.into_iter().cloned().collect(), context);
        let attribute =
            |of: fn(&Mesh) -> Option<&CornerAttribute>| attribute_planes(scene, context, 0.0, of);
        let colored = host.objects.iter().any(|o| o.colors.is_some());
        let colors = colored.then(|| attribute_planes(scene, context, 1.0, |m| m.colors.as_ref()));
        let smooth: Vec<bool> = scene
            .objects
            .iter()
            .flat_map(|o| vec![o.mesh.normals.is_some(); o.mesh.faces.len()])
            .collect();
        let normals = smooth.contains(&true);
        let normals = normals.then(|| (attribute(|m| m.normals.as_ref()), smooth));
        let sky = &scene.environment;
        let place = (Vec3::constant(context, normalization.center), unit);
        let size = SceneFrame::new(host).unit / unit;
        let topology = topology(host, camera.eye.values()?.into());
        let emits = |t: u32| materials.kinds[topology.material[t as usize] as usize].emits;
        let triangles = 0..topology.object.len() as u32;
        Ok(Self {
            emitters: triangles.filter(|&t| emits(t)).collect(),
            triangles: Triangles::new(
                context,
                vertex_data(positions.map(relative)),
                velocities(scene, host, context).map(|v| v.map(|x| x * unit.recip())),
            ),
            uvs: (materials.textured() || tilts.is_some()).then(|| attribute(|m| m.uvs.as_ref())),
            normals,
            colors,
            tilts,
            holes: host.holes.clone(),
            lights: LightPlanes::new(&scene.lights, context, place, size),
            environment: sky.shines().then(|| SkyTensors::new(sky, context)),
            context: context.clone(),
            topology,
            materials,
            normalization,
            unit,
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

/// Returns the first three columns of an attribute at the corners of all faces. They are `without` where a mesh has
/// none.
fn attribute_planes(
    scene: &Scene,
    context: &Context,
    without: f64,
    of: fn(&Mesh) -> Option<&CornerAttribute>,
) -> VertexData {
    let rows = |m| of(m).map(|a| (&a.values, &a.faces));
    vertex_data(corners(scene, context, without, rows))
}

/// Returns rows of a tensor at the corners of all faces. They are `without` where a mesh has none. A third column that
/// is missing is 0.
fn corners<'a>(
    scene: &'a Scene,
    context: &Context,
    without: f64,
    of: impl Fn(&'a Mesh) -> Option<(&'a Tensor<2>, &'a Arc<Vec<[u32; 3]>>)>,
) -> [Tensor<2>; 3] {
    let meshes = || {
        let all = scene.objects.iter().map(|o| &o.mesh);
        all.filter(|m| !m.faces.is_empty())
    };
    [0, 1, 2].map(|corner| {
        let parts = meshes().map(|mesh| {
            let n = mesh.faces.len();
            let filled = |columns, number| context.tensor(&vec![number; n * columns], [n, columns]);
            let Some((values, faces)) = of(mesh) else {
                return filled(3, without);
            };
            let rows = take_rows(values, faces.iter().map(|f| f[corner]));
            match rows.dims()[1] {
                2 => Tensor::cat(vec![rows, filled(1, 0.0)], 1),
                _ => rows.narrow(1, 0, 3),
            }
        });
        Tensor::cat(parts.collect(), 0)
    })
}

fn vertex_data(corners: [Tensor<2>; 3]) -> VertexData {
    let [a, b, c] = corners.map(Vec3::from_columns);
    VertexData { a, b, c }
}

impl Tilts {
    /// Collects the normal maps of a scene. Returns None if no material has one.
    fn new(scene: &Scene, host: &HostScene, context: &Context) -> Option<Self> {
        let materials = scene.objects.iter().flat_map(|o| &o.materials);
        let mut maps: Vec<_> = materials.map(|m| m.normal_map.clone()).collect();
        if maps.iter().all(Option::is_none) {
            return None;
        }
        let mut up = vec![Parameter::Constant([0.0, 0.0, 1.0]); maps.len()];
        let values = maps.iter_mut().zip(&mut up).map(|(map, up)| match map {
            Some(map) => Value::Image(&mut map.texels, map.wrap),
            None => Value::Color(up),
        });
        let side = |o: &HostObject, f: usize| {
            let of = |t: &HostAttribute<4>| t.values[t.faces[f][0] as usize][3].into();
            o.tangents.as_ref().map_or(0.0, of)
        };
        let all = host.objects.iter();
        Some(Self {
            maps: planes(values.collect(), context),
            sides: all
                .flat_map(|o| (0..o.faces.len()).map(move |f| side(o, f)))
                .collect(),
            tangents: attribute_planes(scene, context, 0.0, |m| m.tangents.as_ref()),
        })
    }
}

/// Returns the velocity of each triangle. Returns None if no object has a velocity, or only constants 0.
fn velocities(scene: &Scene, host: &HostScene, context: &Context) -> Option<Vec3> {
    if host.objects.iter().all(|o| o.velocity.is_none()) {
        return None;
    }
    let objects = scene.objects.iter().filter(|o| !o.mesh.faces.is_empty());
    let parts = objects.map(|o| {
        let still = Parameter::Constant([0.0; 3]);
        let velocity = o.velocity.as_ref().unwrap_or(&still);
        let n = o.mesh.faces.len();
        velocity.vector(context).map(|p| p.expand([n, 1]))
    });
    Some(Vec3::cat(&parts.collect::<Vec<_>>(), 0))
}

/// Computes objects, materials and neighbors of all triangles, and the side of closed objects that is visible from
/// `eye`.
fn topology(host: &HostScene, eye: DVec3) -> Topology {
    let mut topology = Topology::default();
    for object in &host.objects {
        let first = topology.object.len();
        let base = object.first_material as u32;
        let of_face: Vec<u32> = (0..object.faces.len())
            .map(|f| base + object.face_materials.get(f).copied().unwrap_or(0))
            .collect();
        topology.push_object(&Weld::new(&object.positions), &object.faces, &of_face);
        if topology.closed.get(first) == Some(&true) {
            let side = visible_side(&object.positions, &object.faces, eye);
            topology.visible_side[first..].fill(side);
        }
    }
    topology
}

impl Normalization {
    /// Computes the center, which is the mean of all vertices, and the radius, which is the largest distance of a
    /// vertex from it over the whole shutter.
    pub fn new(host: &HostScene) -> Self {
        let all = || host.objects.iter().flat_map(|o| &o.positions);
        let n = all().count() as f64;
        let center: [f64; 3] = std::array::from_fn(|i| all().map(|v| v[i]).sum::<f64>() / n);
        let mut radius = 0.0f64;
        for object in &host.objects {
            let u = object.velocity.unwrap_or([0.0; 3]);
            for v in &object.positions {
                for time in [0.0, 1.0] {
                    let square = |i: usize| (v[i] + time * u[i] - center[i]).powi(2);
                    radius = radius.max((0..3).map(square).sum::<f64>().sqrt());
                }
            }
        }
        // A scene that is a single point has no scale of its own.
        let radius = if radius > 0.0 { radius } else { 1.0 };
        Self { center, radius }
    }
}

/// Returns the side of a closed object that is visible from `eye`: +1 for n·d > 0, −1 for n·d < 0. Rays from outside
/// can only enter the surface, rays from inside only leave it. This holds for every ray of a path, because the softmax
/// form, which uses it, has no materials that transmit light.
fn visible_side(positions: &[[f64; 3]], faces: &[[u32; 3]], eye: DVec3) -> f64 {
    let (mut solid_angle, mut volume) = (0.0, 0.0);
    for f in faces {
        let [a, b, c] = f.map(|i| DVec3::from(positions[i as usize]) - eye);
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

/// An environment as planes.
#[derive(Clone, Debug)]
pub(crate) enum SkyTensors {
    /// `[1, 1]`.
    Constant(Vec3),
    /// An equirectangular map.
    Map(EnvironmentMap),
}

/// The texels of an equirectangular map.
#[derive(Clone, Debug)]
pub(crate) struct EnvironmentMap {
    /// `[1, H·W]`, row by row.
    pub texels: Vec3,
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
}

impl SkyTensors {
    fn new(environment: &Environment, context: &Context) -> Self {
        match environment {
            Environment::Constant(p) => Self::Constant(p.vector(context)),
            Environment::Map(texels) => {
                let [height, width, _] = texels.dims();
                Self::Map(EnvironmentMap {
                    texels: texel_rows(texels),
                    height,
                    width,
                })
            }
        }
    }
}
