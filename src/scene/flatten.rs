//! From a scene to the planes that rays meet: the one place that gathers vertices into triangles.

use burn::tensor::Tensor;

use super::check::check;
use super::mesh::take;
use super::{Albedo, Camera, Environment, Material, Parameter, Scene, Wrap};
use crate::error::Result;
use crate::geometry::{Context, Topology, Triangles, Vec3, VertexData};

/// A sphere around the scene: sets the scale of depths and tolerances; takes no gradient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// The mean of all vertices.
    pub center: [f64; 3],
    /// The largest distance of a vertex from it, over the whole shutter.
    pub radius: f64,
}

/// Where a texture lies in the atlas.
#[derive(Clone, Copy, Debug)]
pub struct TextureSlot {
    /// Its first texel.
    pub offset: usize,
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// Outside of the unit square.
    pub wrap: Wrap,
}

/// The diffuse or specular albedos of all materials.
#[derive(Clone, Debug)]
pub struct Albedos {
    /// `[1, M]`; 0 where the material has a texture.
    pub constant: Vec3,
    /// The texture of each material.
    pub texture: Vec<Option<TextureSlot>>,
    /// All texels `[1, A]`, if there are textures.
    pub atlas: Option<Vec3>,
}

/// All materials of a scene; planes are rows `[1, M]`.
#[derive(Clone, Debug)]
pub struct Materials {
    /// k_d.
    pub diffuse: Albedos,
    /// k_s and the exponent, if any material is glossy.
    pub specular: Option<(Albedos, Tensor<2>)>,
    /// Emitted radiance.
    pub emission: Vec3,
    /// Whether a material reflects.
    pub reflects: Vec<bool>,
    /// Whether a material has a specular part.
    pub glossy: Vec<bool>,
    /// Whether a material emits.
    pub emits: Vec<bool>,
}

/// An environment as planes.
#[derive(Clone, Debug)]
pub enum SkyTensors {
    /// `[1, 1]`.
    Constant(Vec3),
    /// An equirectangular map.
    Map(EnvironmentMap),
}

/// The texels of an equirectangular map.
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
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
            Environment::Constant(p) => {
                let [r, g, b] = p.planes(context);
                Self::Constant(Vec3::new(r, g, b))
            }
            Environment::Map(texels) => {
                let [height, width, _] = texels.dims();
                let rows = texels.clone().reshape([height * width, 3]).transpose();
                let rows = if rows.is_tracked() {
                    rows
                } else {
                    rows.inner()
                };
                Self::Map(EnvironmentMap {
                    texels: Vec3::from_rows(rows),
                    height,
                    width,
                })
            }
        }
    }

    fn plain(&self) -> Self {
        match self {
            Self::Constant(v) => Self::Constant(v.plain()),
            Self::Map(map) => Self::Map(EnvironmentMap {
                texels: map.texels.plain(),
                ..*map
            }),
        }
    }
}

/// A scene as planes of triangles and materials.
#[derive(Clone, Debug)]
pub struct Flattened {
    /// Device and float type.
    pub context: Context,
    /// Relative to the centre of the bounds, in units of `unit`.
    pub triangles: Triangles,
    /// Host-side connectivity.
    pub topology: Topology,
    /// All materials.
    pub materials: Materials,
    /// Triangles that emit.
    pub emitters: Vec<u32>,
    /// The scene's bounds, in scene units.
    pub bounds: Bounds,
    /// The length that everything is measured in from here on, in scene units: the power of two
    /// nearest to the radius of the bounds. So a scene renders alike at any scale, and squares and
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
    /// Checks the scene and gathers its triangles.
    ///
    /// # Errors
    /// Whatever a user can get wrong in a scene, named.
    pub fn new(scene: &Scene, camera: &Camera, bounds: Option<Bounds>) -> Result<Self> {
        let context = check(scene, camera)?;
        let mut topology = Topology::default();
        let mut materials = Vec::new();
        let mut host = Vec::new();
        for object in &scene.objects {
            let positions = object.mesh.host_vertices()?;
            let base = materials.len() as u32;
            let of_face: Vec<u32> = (0..object.mesh.faces.len())
                .map(|f| base + object.face_materials.get(f).copied().unwrap_or(0))
                .collect();
            materials.extend(object.materials.iter());
            topology.push_object(&positions, &object.mesh.faces, &of_face);
            let velocity = match &object.velocity {
                Some(v) => v.check(&object.name, "velocity", "finite numbers", |_| true)?,
                None => [0.0; 3],
            };
            host.push((positions, velocity));
        }
        let bounds = bounds.unwrap_or_else(|| bounds_of(&host));
        let eye = camera.eye.values()?;
        let mut first = 0;
        for (object, (positions, _)) in scene.objects.iter().zip(&host) {
            let n = object.mesh.faces.len();
            if n > 0 && topology.closed[first] {
                let side = visible_side(positions, &object.mesh.faces, eye);
                topology.visible_side[first..first + n].fill(side);
            }
            first += n;
        }

        let unit = bounds.radius.log2().round().exp2();
        let centre = context.tensor(&bounds.center, [1, 3]);
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
        let velocities = velocities(scene, &context).map(|v| v.map(|x| x * unit.recip()));
        let triangles = Triangles::new(&context, corners, velocities);
        let materials = flatten_materials(&materials, &context);
        let emitters: Vec<u32> = (0..topology.object.len() as u32)
            .filter(|&t| materials.emits[topology.material[t as usize] as usize])
            .collect();
        let textured = materials.diffuse.atlas.is_some()
            || materials
                .specular
                .as_ref()
                .is_some_and(|(s, _)| s.atlas.is_some());
        let uvs = textured.then(|| corner_values(scene, &context, 2));
        let smooth: Vec<bool> = scene
            .objects
            .iter()
            .flat_map(|o| vec![o.mesh.normals.is_some(); o.mesh.faces.len()])
            .collect();
        let normals = smooth
            .iter()
            .any(|&s| s)
            .then(|| (corner_values(scene, &context, 3), smooth));
        let shines = scene.environment.shines();
        let environment = shines.then(|| SkyTensors::new(&scene.environment, &context));
        if emitters.is_empty() && environment.is_none() {
            log::warn!("the scene has no emitter and a black environment: the image is black");
        }
        Ok(Self {
            context,
            triangles,
            topology,
            materials,
            emitters,
            bounds,
            unit,
            uvs,
            normals,
            environment,
        })
    }

    /// Without tape.
    pub(crate) fn plain(self) -> Self {
        let column = |t: &Tensor<2>| crate::geometry::plain(t);
        let vertices = |v: &VertexData| VertexData {
            a: v.a.plain(),
            b: v.b.plain(),
            c: v.c.plain(),
        };
        let albedos = |a: &Albedos| Albedos {
            constant: a.constant.plain(),
            texture: a.texture.clone(),
            atlas: a.atlas.as_ref().map(Vec3::plain),
        };
        let t = &self.triangles;
        let triangles = Triangles {
            corners: vertices(&t.corners),
            normal: t.normal.plain(),
            u: t.u.plain(),
            v: t.v.plain(),
            plane: column(&t.plane),
            a_u: column(&t.a_u),
            a_v: column(&t.a_v),
            base: column(&t.base),
            apex_u: column(&t.apex_u),
            apex_v: column(&t.apex_v),
            area: column(&t.area),
            valid: t.valid.clone(),
            velocity: t.velocity.as_ref().map(Vec3::plain),
        };
        let m = &self.materials;
        let materials = Materials {
            diffuse: albedos(&m.diffuse),
            specular: m.specular.as_ref().map(|(s, n)| (albedos(s), column(n))),
            emission: m.emission.plain(),
            reflects: m.reflects.clone(),
            glossy: m.glossy.clone(),
            emits: m.emits.clone(),
        };
        Self {
            triangles,
            materials,
            uvs: self.uvs.as_ref().map(vertices),
            normals: self.normals.as_ref().map(|(n, s)| (vertices(n), s.clone())),
            environment: self.environment.as_ref().map(SkyTensors::plain),
            ..self
        }
    }

    /// The radius of the bounds in units of `unit`.
    pub fn radius(&self) -> f64 {
        self.bounds.radius / self.unit
    }
}

fn bounds_of(objects: &[(Vec<[f64; 3]>, [f64; 3])]) -> Bounds {
    let all = || objects.iter().flat_map(|(v, _)| v.iter());
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
        .flat_map(|(vs, u)| {
            vs.iter()
                .map(move |v| distance(v, u, 0.0).max(distance(v, u, 1.0)))
        })
        .fold(0.0, f64::max);
    // A scene that is one point has no scale of its own.
    let radius = if radius > 0.0 { radius } else { 1.0 };
    Bounds { center, radius }
}

/// Which side of a closed object can be seen from `eye`: +1 those with n·d > 0, −1 those with
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

fn velocities(scene: &Scene, context: &Context) -> Option<Vec3> {
    let still = |p: &Option<Parameter<3>>| match p {
        None => true,
        Some(Parameter::Constant(v)) => *v == [0.0; 3],
        Some(Parameter::Tensor(_)) => false,
    };
    if scene.objects.iter().all(|o| still(&o.velocity)) {
        return None;
    }
    let parts: Vec<Vec3> = scene
        .objects
        .iter()
        .map(|o| {
            let n = o.mesh.faces.len();
            let [x, y, z] = match &o.velocity {
                Some(v) => v.planes(context),
                None => Parameter::Constant([0.0; 3]).planes(context),
            };
            Vec3::new(x, y, z).map(|p| p.expand([n, 1]))
        })
        .filter(|v| v.x.dims()[0] > 0)
        .collect();
    Some(cat(parts, 0))
}

fn cat(parts: Vec<Vec3>, dim: usize) -> Vec3 {
    let plane =
        |f: fn(&Vec3) -> &Tensor<2>| Tensor::cat(parts.iter().map(|p| f(p).clone()).collect(), dim);
    Vec3::new(plane(|p| &p.x), plane(|p| &p.y), plane(|p| &p.z))
}

/// Texture coordinates (`width` 2) or normals (3) at the corners of all triangles, zero where an
/// object has none.
fn corner_values(scene: &Scene, context: &Context, width: usize) -> VertexData {
    let at = |corner: usize| {
        let parts = scene
            .objects
            .iter()
            .filter(|o| !o.mesh.faces.is_empty())
            .map(|o| {
                let attribute = if width == 2 {
                    &o.mesh.uvs
                } else {
                    &o.mesh.normals
                };
                let n = o.mesh.faces.len();
                let zero = |c: usize| context.tensor(&vec![0.0; n * c], [n, c]);
                match attribute {
                    Some(a) => {
                        let v = take(&a.values, &a.faces, corner);
                        if width == 2 {
                            Tensor::cat(vec![v, zero(1)], 1)
                        } else {
                            v
                        }
                    }
                    None => zero(3),
                }
            })
            .collect();
        Vec3::from_columns(Tensor::cat(parts, 0))
    };
    VertexData {
        a: at(0),
        b: at(1),
        c: at(2),
    }
}

fn flatten_materials(materials: &[&Material], context: &Context) -> Materials {
    let planes = |f: &dyn Fn(&Material) -> [Tensor<2>; 3]| {
        cat(
            materials
                .iter()
                .map(|m| {
                    let [x, y, z] = f(m);
                    Vec3::new(x, y, z)
                })
                .collect(),
            1,
        )
    };
    let glossy = materials.iter().any(|m| m.specular.reflects());
    Materials {
        diffuse: albedos(materials.iter().map(|m| &m.diffuse), context),
        specular: glossy.then(|| {
            let exponent = materials
                .iter()
                .map(|m| {
                    let [n] = m.shininess.planes(context);
                    n
                })
                .collect();
            (
                albedos(materials.iter().map(|m| &m.specular), context),
                Tensor::cat(exponent, 1),
            )
        }),
        emission: planes(&|m| m.emission.planes(context)),
        reflects: materials.iter().map(|m| m.reflects()).collect(),
        glossy: materials.iter().map(|m| m.specular.reflects()).collect(),
        emits: materials.iter().map(|m| m.emits()).collect(),
    }
}

fn albedos<'a>(list: impl Iterator<Item = &'a Albedo>, context: &Context) -> Albedos {
    let (mut constant, mut texture, mut atlas) = (Vec::new(), Vec::new(), Vec::new());
    let mut offset = 0;
    for albedo in list {
        let [r, g, b] = match albedo {
            Albedo::Constant(p) => {
                texture.push(None);
                p.planes(context)
            }
            Albedo::Texture { texels, wrap } => {
                let [height, width, _] = texels.dims();
                texture.push(Some(TextureSlot {
                    offset,
                    height,
                    width,
                    wrap: *wrap,
                }));
                offset += height * width;
                let texels = if texels.is_tracked() {
                    texels.clone()
                } else {
                    texels.clone().inner()
                };
                atlas.push(Vec3::from_rows(
                    texels.reshape([height * width, 3]).transpose(),
                ));
                Parameter::Constant([0.0; 3]).planes(context)
            }
        };
        constant.push(Vec3::new(r, g, b));
    }
    Albedos {
        constant: cat(constant, 1),
        texture,
        atlas: (!atlas.is_empty()).then(|| cat(atlas, 1)),
    }
}
