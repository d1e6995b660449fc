//! Traverses the graph of nodes: meshes, cameras and lights in world space.

use std::collections::HashMap;
use std::f32::consts::FRAC_PI_4;
use std::f64::consts::FRAC_PI_2;

use glam::{DAffine3, DMat4, DQuat, DVec3};

use super::fields::{Fields, Range};
use super::materials::{images, materials};
use super::meshes::{mesh, most_triangles};
use super::schema::{CameraType, LightType, Node};
use super::{Document, materials::Material};
use crate::error::{Error, Result};
use crate::io::description::{Description, ObjectDescription};
use crate::io::limits::{LIGHT, Memory, OBJECT, TRIANGLE};
use crate::scene::{Camera, Light};

/// Returns the description of the file's default scene. Without a default scene, it is the first scene. Without
/// scenes, it contains all nodes.
pub(super) fn walk(document: &Document) -> Result<Description> {
    let root = &document.root;
    let materials = materials(document)?;
    let mut walk = Walk {
        document,
        materials: &materials,
        meshes: HashMap::new(),
        triangles: 0,
        description: Description {
            images: images(document)?,
            memory: Memory {
                read: document.bytes,
                ..Memory::default()
            },
            ..Description::default()
        },
    };
    let mut seen = vec![false; root.nodes.len()];
    // A stack: the last node is visited next.
    let mut next: Vec<(usize, DAffine3)> = Vec::new();
    for (i, place) in roots(document)? {
        enter(document, &mut seen, i, &place)?;
        next.push((i, DAffine3::IDENTITY));
    }
    next.reverse();
    while let Some((i, parent)) = next.pop() {
        let node = &root.nodes[i];
        let to_world = parent * local(document, node, i)?;
        let finite = |v: f64| (v as f32).is_finite();
        let message = "has a transform whose numbers are not finite in f32";
        let valid = to_world.to_cols_array().into_iter().all(finite);
        document.unless(valid, format_args!("nodes[{i}]"), message)?;
        walk.node(node, i, to_world)?;
        let first = next.len();
        for (k, &child) in node.children.iter().enumerate() {
            let place = format!("nodes[{i}].children[{k}]");
            document.get(&root.nodes, child, &place, "nodes")?;
            enter(document, &mut seen, child, &place)?;
            next.push((child, to_world));
        }
        next[first..].reverse();
    }
    let mut description = walk.description;
    description.materials = materials.into_iter().map(|m| m.description).collect();
    if description.objects.is_empty() {
        return Err(Error::NoTriangles {
            path: Some(document.path.into()),
            objects: 0,
        });
    }
    Ok(description)
}

/// Returns the nodes of the scene, or, without scenes, all nodes without a parent. Each has its place in the file.
fn roots(document: &Document) -> Result<Vec<(usize, String)>> {
    let root = &document.root;
    let first = (!root.scenes.is_empty()).then_some(0);
    if let Some(s) = root.scene.or(first) {
        let scene = document.fields(&root.scenes, s, "scene", "scenes")?;
        let nodes: Vec<usize> = scene.get("nodes")?.unwrap_or_default();
        let named = nodes.into_iter().enumerate().map(|(k, node)| {
            let place = scene.at(&format!("nodes[{k}]"));
            document.get(&root.nodes, node, &place, "nodes")?;
            Ok((node, place))
        });
        return named.collect();
    }
    let mut is_child = vec![false; root.nodes.len()];
    for child in root.nodes.iter().flat_map(|n| &n.children) {
        if let Some(is_child) = is_child.get_mut(*child) {
            *is_child = true;
        }
    }
    let roots = (0..root.nodes.len()).filter(|&i| !is_child[i]);
    Ok(roots.map(|i| (i, format!("nodes[{i}]"))).collect())
}

/// Marks a node as visited. A second visit is an error, since the graph could have a cycle or grow without bound.
fn enter(document: &Document, seen: &mut [bool], node: usize, place: &str) -> Result<()> {
    let known = std::mem::replace(&mut seen[node], true);
    let message = format_args!("is {node}, which has another parent or is above itself");
    document.unless(!known, place, message)
}

/// Returns a node's local transform.
fn local(document: &Document, node: &Node, i: usize) -> Result<DAffine3> {
    if let Some(matrix) = &node.matrix {
        let matrix = DMat4::from_cols_array(matrix);
        let last = matrix.row(3).to_array();
        let message = format_args!("has the last row {last:?}, expected 0, 0, 0, 1");
        let valid = last == [0.0, 0.0, 0.0, 1.0];
        document.unless(valid, format_args!("nodes[{i}].matrix"), message)?;
        return Ok(DAffine3::from_mat4(matrix));
    }
    let vector = |v: Option<[f64; 3]>, default: DVec3| v.map_or(default, DVec3::from);
    let rotation = match node.rotation {
        Some(rotation) => {
            let rotation = DQuat::from_array(rotation);
            let length = rotation.length();
            let message = format!("is {:?}, expected a quaternion", rotation.to_array());
            let valid = length > 0.0 && length.is_finite();
            document.unless(valid, format_args!("nodes[{i}].rotation"), message)?;
            rotation.normalize()
        }
        None => DQuat::IDENTITY,
    };
    Ok(DAffine3::from_scale_rotation_translation(
        vector(node.scale, DVec3::ONE),
        rotation,
        vector(node.translation, DVec3::ZERO),
    ))
}

struct Walk<'a> {
    document: &'a Document<'a>,
    materials: &'a [Material],
    /// The index in the description of each mesh of the file.
    meshes: HashMap<usize, usize>,
    /// The number of triangles of all instances so far.
    triangles: u64,
    description: Description,
}

impl Walk<'_> {
    fn node(&mut self, node: &Node, i: usize, to_world: DAffine3) -> Result<()> {
        let (document, root) = (self.document, &self.document.root);
        let name = |of: Option<&str>, kind: &str| {
            let name = node.name.as_deref().or(of);
            name.map_or_else(|| format!("{kind} {i}"), str::to_owned)
        };
        if let Some(index) = node.mesh {
            let place = format!("nodes[{i}].mesh");
            let json = document.get(&root.meshes, index, &place, "meshes")?;
            let name = name(json.name.as_deref(), "node");
            self.instance(index, name, to_world, &place)?;
            if node.skin.is_some() {
                document.skip("skins");
            }
        }
        if let Some(index) = node.camera {
            let place = format!("nodes[{i}].camera");
            let json = document.fields(&root.cameras, index, &place, "cameras")?;
            let name = name(json.get("name")?, "camera");
            let (camera, aspect) = self.camera(&json, to_world, &place)?;
            self.description.cameras.push((name, camera, aspect));
        }
        let extensions = Fields {
            document,
            json: &node.extensions,
            place: format!("nodes[{i}].extensions"),
        };
        let path = "KHR_lights_punctual.light";
        if let Some(index) = extensions.get(path)? {
            let place = extensions.at(path);
            let lights = root.extensions.get("KHR_lights_punctual");
            let lights = lights.and_then(|l| l["lights"].as_array());
            let lights = lights.map_or(&[][..], Vec::as_slice);
            let json = document.fields(lights, index, &place, "lights")?;
            let taken = self.description.memory.take(1, LIGHT, &document.files);
            taken.map_err(|message| document.fail(&place, message))?;
            self.description.lights.push(self.light(&json, to_world)?);
        }
        Ok(())
    }

    fn instance(&mut self, index: usize, name: String, to: DAffine3, place: &str) -> Result<()> {
        let document = self.document;
        let more = most_triangles(document, &document.root.meshes[index]);
        self.triangles = self.triangles.saturating_add(more);
        let most = document.files.triangles;
        let message = format_args!(
            "makes more than {most} triangles: LoadLimits::with_triangles raises the limit"
        );
        document.unless(self.triangles <= most, place, message)?;
        let memory = &mut self.description.memory;
        let taken = memory.take(more, TRIANGLE, &document.files);
        let taken = taken.and_then(|()| memory.take(1, OBJECT, &document.files));
        taken.map_err(|message| document.fail(place, message))?;
        let known = match self.meshes.get(&index) {
            Some(&known) => known,
            None => {
                let next = self.description.meshes.len();
                let mesh = mesh(document, index, self.materials)?;
                self.description.meshes.push(mesh);
                self.meshes.insert(index, next);
                next
            }
        };
        if !self.description.meshes[known].faces.is_empty() {
            self.description.objects.push(ObjectDescription {
                name,
                mesh: known,
                to_world: to,
            });
        }
        Ok(())
    }

    /// Converts a camera, which looks along −z of its node. The scale of the node has no effect.
    fn camera(&self, json: &Fields, to: DAffine3, place: &str) -> Result<(Camera, Option<f64>)> {
        let document = self.document;
        let axes = [-to.matrix3.z_axis, to.matrix3.y_axis].map(|a| a.try_normalize());
        let [Some(forward), Some(up)] = axes else {
            let message = "is at a node whose axes have no directions";
            return Err(document.fail(place, message));
        };
        let message = "is at a node whose y and z axes are parallel";
        document.unless(forward.cross(up).length() >= 1e-6, place, message)?;
        let positive = |path: &str, value: f32| {
            let [value] = json.check(path, [value], Range::Positive)?;
            Result::Ok(value)
        };
        let eye = to.translation;
        let camera =
            Camera::look_at(eye.to_array(), (eye + forward).to_array()).with_up(up.to_array());
        Ok(match json.required("type")? {
            CameraType::Perspective => {
                let path = "perspective.yfov";
                let yfov = json.required(path)?;
                let fov_y = positive(path, yfov)?.to_degrees();
                let message = format_args!("is {yfov}, expected an angle under π");
                document.unless(fov_y < 180.0, json.at(path), message)?;
                let path = "perspective.aspectRatio";
                let aspect = json.get(path)?.map(|a| positive(path, a));
                (camera.with_fov_y(fov_y), aspect.transpose()?)
            }
            CameraType::Orthographic => {
                let size = |path: &str| {
                    // A negative magnification mirrors the image in some files. Only its size is used.
                    positive(path, json.required::<f32>(path)?.abs())
                };
                let (high, wide) = (size("orthographic.ymag")?, size("orthographic.xmag")?);
                (camera.with_orthographic(2.0 * high), Some(wide / high))
            }
        })
    }

    /// Converts a light, which shines along −z of its node. The scale of the node has no effect. Photometric units
    /// count as units of the scene: candela as radiant intensity, lux as irradiance.
    fn light(&self, json: &Fields, to: DAffine3) -> Result<Light> {
        let strength = json.number("intensity", 1.0, Range::NotNegative)?;
        let color = json.three("color", [1.0; 3], Range::NotNegative)?;
        let intensity = color.map(|v| v * strength);
        if json.get::<f32>("range")?.is_some() {
            self.document.skip("range of lights");
        }
        let position = to.translation.to_array();
        let direction = (-to.matrix3.z_axis).try_normalize();
        let direction = direction.unwrap_or(DVec3::NEG_Z).to_array();
        Ok(match json.required("type")? {
            LightType::Point => Light::point(position, intensity),
            LightType::Directional => Light::directional(direction, intensity),
            LightType::Spot => {
                let inner: f32 = json.get("spot.innerConeAngle")?.unwrap_or(0.0);
                let outer = json.get("spot.outerConeAngle")?.unwrap_or(FRAC_PI_4);
                // The limit is above π/2, since numbers in files are rounded.
                let valid = 0.0 <= inner && inner <= outer && outer <= 1.571;
                let message = format_args!(
                    "has the angles {inner} and {outer}, expected 0 ≤ innerConeAngle ≤ outerConeAngle ≤ π/2"
                );
                self.document.unless(valid, json.at("spot"), message)?;
                let [inner, outer] =
                    [inner, outer].map(|a| [f64::from(a).min(FRAC_PI_2).to_degrees()]);
                Light::spot(position, direction, intensity, inner, outer)
            }
        })
    }
}
