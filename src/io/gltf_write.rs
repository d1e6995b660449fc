//! Writes meshes and scenes as glTF 2.0 files.

use std::path::Path;

use glam::DVec3;
use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};
use serde_json::{Value, json};

use super::gltf_lights::light;
use super::gltf_materials::Materials;
use super::mtl_write::in_line;
use super::split::Split;
use super::whole::{Part, ending};
use crate::error::{Error, Result};
use crate::scene::{Mesh, Object, Scene};

/// Component types and buffer targets of glTF.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const OF_VERTICES: u32 = 34962;
const OF_INDICES: u32 = 34963;

/// The characters of a file name that are escaped in its URI.
const ESCAPED: &AsciiSet = &NON_ALPHANUMERIC
    .remove(b'-')
    .remove(b'.')
    .remove(b'_')
    .remove(b'~');

/// Writes a mesh with the default material.
pub(super) fn mesh(mesh: &Mesh, path: &Path) -> Result<()> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    scene(
        &Scene::new().with_object(Object::new(mesh.clone()).with_name(stem)),
        path,
    )
}

/// Writes a scene.
pub(super) fn scene(scene: &Scene, path: &Path) -> Result<()> {
    let mut file = File::default();
    let mut materials = Materials::new(path);
    for object in scene.objects.iter().filter(|o| !o.mesh.faces.is_empty()) {
        let mesh = file.mesh(object, &mut materials)?;
        file.meshes.push(mesh);
        let mesh = file.meshes.len() - 1;
        file.nodes.push(json!({"name": object.name, "mesh": mesh}));
    }
    let mut lights = Vec::new();
    for (i, from) in scene.lights.iter().enumerate() {
        let [light, mut node] = light(from, &format!("light {i}"), path)?;
        node["extensions"] = json!({"KHR_lights_punctual": {"light": i}});
        lights.push(light);
        file.nodes.push(node);
    }
    let images = materials.images()?;
    let images = images.iter().map(|png| {
        let view = file.buffer.view(png, None);
        json!({"mimeType": "image/png", "bufferView": view})
    });
    let images: Vec<Value> = images.collect();
    let nodes: Vec<usize> = (0..file.nodes.len()).collect();
    let mut json = json!({
        "asset": {"version": "2.0", "generator": "softray"},
        "scene": 0, "scenes": [{"nodes": nodes}], "nodes": file.nodes, "meshes": file.meshes,
        "accessors": file.accessors, "bufferViews": file.buffer.views,
        "materials": materials.described, "textures": materials.textures,
        "samplers": materials.samplers, "images": images,
        "buffers": [{"byteLength": file.buffer.bytes.len()}],
    });
    if !lights.is_empty() {
        materials.extensions.insert("KHR_lights_punctual");
        json["extensions"] = json!({"KHR_lights_punctual": {"lights": lights}});
    }
    json["extensionsUsed"] = json!(materials.extensions);
    // glTF does not allow empty lists.
    if let Some(lists) = json.as_object_mut() {
        lists.retain(|_, value| value.as_array().is_none_or(|list| !list.is_empty()));
    }
    if ending(path, &["gltf", "glb"])? == "glb" {
        return container(path, json, file.buffer.bytes)?.publish();
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let name = format!("{}.bin", in_line(&stem, "scene"));
    json["buffers"][0]["uri"] = json!(utf8_percent_encode(&name, ESCAPED).to_string());
    let beside = path.with_file_name(name);
    let buffer = Part::of(&beside, &[&file.buffer.bytes])?;
    let text = Part::write(path, |f| {
        serde_json::to_writer_pretty(f, &json).map_err(|e| Error::io(path)(e.into()))
    })?;
    buffer.publish()?;
    text.publish()
}

/// Writes a `.glb` file from JSON and a buffer.
fn container(path: &Path, json: Value, mut buffer: Vec<u8>) -> Result<Part> {
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    buffer.resize(buffer.len().next_multiple_of(4), 0);
    let length = |bytes: usize| {
        u32::try_from(bytes).map_err(|_| {
            let message = "it would have more than 2³² bytes, which a .glb file can't: write .gltf";
            Error::format(path, message)
        })
    };
    let all = length(28 + json.len() + buffer.len())?;
    let (of_json, of_buffer) = (length(json.len())?, length(buffer.len())?);
    let chunks: [&[u8]; 9] = [
        b"glTF",
        &2u32.to_le_bytes(),
        &all.to_le_bytes(),
        &of_json.to_le_bytes(),
        b"JSON",
        &json,
        &of_buffer.to_le_bytes(),
        b"BIN\0",
        &buffer,
    ];
    Part::of(path, &chunks)
}

/// The lists of a file that is being built.
#[derive(Default)]
struct File {
    nodes: Vec<Value>,
    meshes: Vec<Value>,
    accessors: Vec<Value>,
    buffer: Buffer,
}

/// The bytes of a file's buffer, and the views of it.
#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
}

impl Buffer {
    /// Adds bytes and returns the index of their view.
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let (offset, length) = (self.bytes.len(), bytes.len());
        let mut view = json!({"buffer": 0, "byteOffset": offset, "byteLength": length});
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bytes.extend(bytes);
        self.views.push(view);
        self.views.len() - 1
    }
}

impl File {
    /// Returns the JSON of a mesh with one primitive per material.
    fn mesh(&mut self, object: &Object, materials: &mut Materials) -> Result<Value> {
        let split = Split::of(&object.mesh)?;
        let mut attributes = json!({"POSITION": self.rows("VEC3", &split.positions, true)});
        if let Some(normals) = &split.normals {
            let unit = |n: &[f64; 3]| DVec3::from(*n).normalize_or_zero().to_array();
            let normals: Vec<[f64; 3]> = normals.iter().map(unit).collect();
            attributes["NORMAL"] = json!(self.rows("VEC3", &normals, false));
        }
        if let Some(uvs) = &split.uvs {
            let downwards: Vec<[f64; 2]> = uvs.iter().map(|[u, v]| [*u, 1.0 - v]).collect();
            attributes["TEXCOORD_0"] = json!(self.rows("VEC2", &downwards, false));
        }
        if let Some(colors) = &split.colors {
            attributes["COLOR_0"] = json!(self.rows("VEC3", colors, false));
        }
        if let Some(tangents) = &split.tangents {
            let unit = |&[x, y, z, w]: &[f64; 4]| {
                let [x, y, z] = DVec3::new(x, y, z).normalize_or_zero().to_array();
                [x, y, z, w]
            };
            let tangents: Vec<[f64; 4]> = tangents.iter().map(unit).collect();
            attributes["TANGENT"] = json!(self.rows("VEC4", &tangents, false));
        }
        let mut primitives = Vec::new();
        for (m, material) in object.materials.iter().enumerate() {
            let of_face = |f: usize| object.face_materials.get(f).map_or(0, |&m| m as usize);
            let faces = split.faces.iter().enumerate();
            let faces = faces.filter(|(f, _)| of_face(*f) == m);
            let indices: Vec<u8> = faces
                .flat_map(|(_, face)| face)
                .flat_map(|v| v.to_le_bytes())
                .collect();
            if indices.is_empty() {
                continue;
            }
            let view = self.buffer.view(&indices, Some(OF_INDICES));
            let count = indices.len() / 4;
            let indices = self.accessor(view, UNSIGNED_INT, count, "SCALAR");
            let material = materials.number(material, &object.name)?;
            primitives
                .push(json!({"attributes": attributes, "indices": indices, "material": material}));
        }
        Ok(json!({"name": object.name, "primitives": primitives}))
    }

    /// Adds an array of rows and returns the index of its accessor. `bounds` adds the bounds that glTF requires for
    /// positions.
    fn rows<const C: usize>(&mut self, kind: &str, rows: &[[f64; C]], bounds: bool) -> usize {
        let floats = rows.iter().flatten().map(|&v| v as f32);
        let bytes: Vec<u8> = floats.flat_map(f32::to_le_bytes).collect();
        let view = self.buffer.view(&bytes, Some(OF_VERTICES));
        let number = self.accessor(view, FLOAT, rows.len(), kind);
        if bounds {
            let bound = |better: fn(f32, f32) -> f32| -> [f32; C] {
                std::array::from_fn(|c| {
                    let column = rows.iter().map(|row| row[c] as f32);
                    column.reduce(better).unwrap_or(0.0)
                })
            };
            let (least, most) = (bound(f32::min), bound(f32::max));
            self.accessors[number]["min"] = json!(least.as_slice());
            self.accessors[number]["max"] = json!(most.as_slice());
        }
        number
    }

    fn accessor(&mut self, view: usize, component: u32, count: usize, kind: &str) -> usize {
        self.accessors.push(
            json!({"bufferView": view, "componentType": component, "count": count, "type": kind}),
        );
        self.accessors.len() - 1
    }
}
