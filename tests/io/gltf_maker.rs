//! Small glTF files, made by hand.

use serde_json::{Value, json};

/// A file in the making: its JSON and its only buffer.
#[derive(Debug)]
pub struct Gltf {
    pub json: Value,
    pub buffer: Vec<u8>,
}

impl Gltf {
    /// A file without meshes.
    pub fn new() -> Self {
        let json = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
            "nodes": [{"name": "object", "mesh": 0}], "meshes": [], "accessors": [],
            "bufferViews": [], "buffers": [{"byteLength": 0}], "materials": [], "textures": [],
            "images": [], "samplers": [], "cameras": []
        });
        let buffer = Vec::new();
        Self { json, buffer }
    }

    /// A unit square in the plane z = 0 with its lower left at the origin, in two triangles, with texture
    /// coordinates.
    pub fn square() -> Self {
        let mut file = Self::new();
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let positions = file.floats("VEC3", &corners.map(|[x, y]| [x, y, 0.0]));
        // v grows downwards.
        let uvs = file.floats("VEC2", &corners.map(|[x, y]| [x, 1.0 - y]));
        let indices = file.indices(&[0, 1, 2, 0, 2, 3]);
        file.json["meshes"] = json!([{"name": "square", "primitives": [{
            "attributes": {"POSITION": positions, "TEXCOORD_0": uvs}, "indices": indices
        }]}]);
        file
    }

    /// A square whose base color is a texture of an image at a URI.
    pub fn textured(uri: &str) -> Self {
        let mut file = Self::square();
        file.push("images", json!({"uri": uri}));
        file.push("textures", json!({"source": 0}));
        file.material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
        file
    }

    /// Adds an element to a list and returns its number.
    pub fn push(&mut self, list: &str, element: Value) -> usize {
        let list = self.json[list].as_array_mut().expect("a list");
        list.push(element);
        list.len() - 1
    }

    /// Adds bytes to the buffer as a view.
    pub fn view(&mut self, bytes: &[u8]) -> usize {
        while !self.buffer.len().is_multiple_of(4) {
            self.buffer.push(0);
        }
        let offset = self.buffer.len();
        self.buffer.extend(bytes);
        let length = bytes.len();
        self.json["buffers"][0]["byteLength"] = json!(self.buffer.len());
        self.push(
            "bufferViews",
            json!({"buffer": 0, "byteOffset": offset, "byteLength": length}),
        )
    }

    /// Adds an array of rows of floats.
    pub fn floats<const N: usize>(&mut self, kind: &str, rows: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = rows
            .iter()
            .flatten()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        let view = self.view(&bytes);
        self.push(
            "accessors",
            json!({"bufferView": view, "componentType": 5126, "count": rows.len(), "type": kind}),
        )
    }

    /// Adds an array of indices of 16 bits.
    pub fn indices(&mut self, all: &[u16]) -> usize {
        let bytes: Vec<u8> = all.iter().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes);
        self.push(
            "accessors",
            json!({"bufferView": view, "componentType": 5123, "count": all.len(), "type": "SCALAR"}),
        )
    }

    /// Gives the first mesh a material.
    pub fn material(&mut self, material: Value) {
        let index = self.push("materials", material);
        self.json["meshes"][0]["primitives"][0]["material"] = json!(index);
    }

    /// A square with a bit of everything, and a picture at a URI.
    pub fn everything(picture: &str) -> Self {
        let mut file = Self::square();
        file.push("images", json!({"uri": picture}));
        file.push("samplers", json!({"wrapS": 33648}));
        file.push("textures", json!({"source": 0, "sampler": 0}));
        let texture = json!({"index": 0, "extensions": {"KHR_texture_transform": {"rotation": 1}}});
        file.material(json!({
        "pbrMetallicRoughness": {
            "baseColorTexture": texture, "metallicRoughnessTexture": texture, "metallicFactor": 0
        },
        "emissiveFactor": [1, 1, 1], "emissiveTexture": texture, "alphaMode": "MASK",
        "normalTexture": texture,
        "extensions": {
            "KHR_materials_specular": {"specularFactor": 0.5}, "KHR_materials_ior": {"ior": 1.4},
            "KHR_materials_transmission": {"transmissionFactor": 1},
            "KHR_materials_volume": {"thicknessFactor": 1},
            "KHR_materials_emissive_strength": {"emissiveStrength": 2}
        },
        "extras": {"softray": {"compensated": false}}
    }));
        let metal = json!({"eta": [0.2, 0.4, 1.4], "extinction": [3.9, 2.4, 1.6]});
        file.push(
            "materials",
            json!({"extras": {"softray": {"conductor": metal}}}),
        );
        let colors = file.floats("VEC3", &[[1.0, 0.5, 0.0]; 4]);
        let normals = file.floats("VEC3", &[[0.0, 0.0, 1.0]; 4]);
        let tangents = file.floats("VEC4", &[[1.0, 0.0, 0.0, -1.0]; 4]);
        let mut second = file.json["meshes"][0]["primitives"][0].clone();
        let attributes = &mut file.json["meshes"][0]["primitives"][0]["attributes"];
        attributes["COLOR_0"] = json!(colors);
        attributes["NORMAL"] = json!(normals);
        attributes["TANGENT"] = json!(tangents);
        second["material"] = json!(1);
        let primitives = file.json["meshes"][0]["primitives"].as_array_mut();
        primitives.expect("a list").push(second);
        let (indices, values) = (file.view(&[1, 2]), file.view(&[0; 24]));
        file.json["accessors"][0]["sparse"] = json!({
            "count": 2, "indices": {"bufferView": indices, "componentType": 5121},
            "values": {"bufferView": values}
        });
        file.push(
            "cameras",
            json!({"type": "perspective", "perspective": {"yfov": 0.5, "znear": 1}}),
        );
        file.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
            {"type": "spot", "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.5}},
            {"type": "point", "intensity": 3}, {"type": "directional", "color": [1, 0.5, 1]}
        ]}});
        file.json["nodes"] = json!([
            {"mesh": 0, "children": [1, 2], "scale": [1, -1, 1]},
            {"camera": 0, "translation": [0, 0, 4], "extensions": {"KHR_lights_punctual": {"light": 1}}},
            {"mesh": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}, "rotation": [0, 0, 1, 0]}
        ]);
        file
    }

    /// The file as `.glb`.
    pub fn glb(&self) -> Vec<u8> {
        let mut json = self.json.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut buffer = self.buffer.clone();
        buffer.resize(buffer.len().next_multiple_of(4), 0);
        let length = 28 + json.len() + buffer.len();
        let mut bytes = b"glTF\x02\0\0\0".to_vec();
        bytes.extend((length as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", json), (b"BIN\0", buffer)] {
            bytes.extend((chunk.len() as u32).to_le_bytes());
            bytes.extend(kind);
            bytes.extend(chunk);
        }
        bytes
    }

    /// The file as `.gltf`, its buffer at a URI.
    pub fn gltf(&self, uri: &str) -> String {
        let mut json = self.json.clone();
        json["buffers"][0]["uri"] = json!(uri);
        json.to_string()
    }
}

/// Bytes as a URI in base64.
pub fn data_uri(kind: &str, bytes: &[u8]) -> String {
    let digits = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = format!("data:{kind};base64,");
    for group in bytes.chunks(3) {
        let mut all = [0; 4];
        all[1..=group.len()].copy_from_slice(group);
        let bits = u32::from_be_bytes(all);
        for i in 0..4 {
            let digit = digits[(bits >> (18 - 6 * i) & 63) as usize] as char;
            text.push(if i <= group.len() { digit } else { '=' });
        }
    }
    text
}
