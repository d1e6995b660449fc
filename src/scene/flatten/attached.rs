//! Velocities, attributes of corners, materials and environment of a scene as planes, in its graph.

use burn::tensor::Tensor;

use super::materials::{Materials, SkyTensors, flatten_materials};
use crate::geometry::{Context, Vec3, VertexData};
use crate::scene::mesh::take;
use crate::scene::{Parameter, Scene};

/// Velocities, attributes of corners, materials and environment.
#[derive(Clone, Debug)]
pub(crate) struct Attached {
    /// The velocity of each triangle, if any object moves, in units of the scene's `unit` over the shutter.
    pub velocity: Option<Vec3>,
    /// Texture coordinates of the corners, z unused, if any material has a texture.
    pub uvs: Option<VertexData>,
    /// Shading normals of the corners, if any mesh has them, and for which triangles.
    pub normals: Option<(VertexData, Vec<bool>)>,
    pub materials: Materials,
    /// The environment, if it is not a constant black.
    pub environment: Option<SkyTensors>,
}

impl Attached {
    pub(crate) fn new(scene: &Scene, context: &Context, unit: f64) -> Self {
        let materials: Vec<_> = scene.objects.iter().flat_map(|o| &o.materials).collect();
        let materials = flatten_materials(&materials, context);
        let textured = materials.textured();
        let smooth: Vec<bool> = scene
            .objects
            .iter()
            .flat_map(|o| vec![o.mesh.normals.is_some(); o.mesh.faces.len()])
            .collect();
        let normals = smooth
            .iter()
            .any(|&s| s)
            .then(|| (corner_values(scene, context, 3), smooth));
        let shines = scene.environment.shines();
        Self {
            velocity: velocities(scene, context).map(|v| v.map(|x| x * unit.recip())),
            uvs: textured.then(|| corner_values(scene, context, 2)),
            normals,
            materials,
            environment: shines.then(|| SkyTensors::new(&scene.environment, context)),
        }
    }
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
    Some(Vec3::cat(&parts, 0))
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
