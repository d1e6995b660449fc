//! Meshes and scenes as binary PLY files.

use std::io::Write;
use std::path::Path;

use burn::tensor::DType;

use super::split::Split;
use super::srgb::{srgb_byte, srgb_table};
use super::whole::write_whole;
use crate::error::{Error, Result};
use crate::scene::{ColorTexture, Material, Mesh, Scene};
use softray_kernels::warning;

/// Writes a mesh.
pub(super) fn mesh(mesh: &Mesh, path: &Path) -> Result<()> {
    let double = mesh.vertices.dtype() == DType::F64;
    write(path, double, &[Split::of(mesh)?])
}

/// Writes a scene as one mesh, its colors those of the materials times those of meshes.
pub(super) fn scene(scene: &Scene, path: &Path) -> Result<()> {
    let (mut parts, mut lost) = (Vec::new(), false);
    let objects = || scene.objects.iter().filter(|o| !o.mesh.faces.is_empty());
    for object in objects() {
        let split = Split::of(&object.mesh)?;
        for (m, material) in object.materials.iter().enumerate() {
            let of_face = |f: &usize| object.face_materials.get(*f).map_or(0, |&m| m as usize);
            let faces = (0..split.faces.len()).filter(|f| of_face(f) == m);
            let part = split.part(faces);
            if part.faces.is_empty() {
                continue;
            }
            let color = color(material)?;
            lost |= color.is_none() || material.bsdf.lobe().is_some() || material.emits();
            parts.push((part, color));
        }
    }
    if lost {
        let file = path.display();
        warning!("{file}: textures, gloss and emission are not written, PLY has none");
    }
    let plain = color(&Material::default())?;
    let painted = |(part, color): &(Split, Option<[f64; 3]>)| {
        part.colors.is_some() || (color.is_some() && *color != plain)
    };
    let any = parts.iter().any(painted);
    let parts = parts.into_iter().map(|(mut part, color)| {
        // Of a texture nothing is left.
        let factor = color.unwrap_or([1.0; 3]);
        let all = part.colors.take();
        let all = all.unwrap_or_else(|| vec![[1.0; 3]; part.positions.len()]);
        let times = |c: &[f64; 3]| std::array::from_fn(|i| c[i] * factor[i]);
        part.colors = any.then(|| all.iter().map(times).collect());
        part
    });
    let parts: Vec<Split> = parts.collect();
    let double = objects().any(|o| o.mesh.vertices.dtype() == DType::F64);
    write(path, double, &parts)
}

/// A material's albedo, None for a texture.
fn color(material: &Material) -> Result<Option<[f64; 3]>> {
    match material.bsdf.base() {
        Some(ColorTexture::Constant(p)) => Ok(Some(p.values()?)),
        Some(ColorTexture::Texture { .. }) => Ok(None),
        None => Ok(Some([0.0; 3])),
    }
}

fn write(path: &Path, double: bool, parts: &[Split]) -> Result<()> {
    let vertices: usize = parts.iter().map(|p| p.positions.len()).sum();
    let faces: usize = parts.iter().map(|p| p.faces.len()).sum();
    let has_normals = parts.iter().all(|p| p.normals.is_some());
    let has_uvs = parts.iter().all(|p| p.uvs.is_some());
    let colors = || parts.iter().flat_map(|p| &p.colors).flatten().flatten();
    let table = srgb_table();
    // Bytes, which all readers know, where they hold the colors.
    let byte = |v: f64| srgb_byte(v as f32);
    let bytes = colors().all(|&v| table[usize::from(byte(v))] == v as f32);
    let float = if double { "double" } else { "float" };
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment softray\nelement vertex {vertices}\n"
    );
    let mut properties = |kind: &str, names: &[&str]| {
        for name in names {
            header += &format!("property {kind} {name}\n");
        }
    };
    properties(float, &["x", "y", "z"]);
    if has_normals {
        properties(float, &["nx", "ny", "nz"]);
    }
    if has_uvs {
        properties(float, &["s", "t"]);
    }
    let has_colors = colors().next().is_some();
    if has_colors {
        let kind = if bytes { "uchar" } else { "float" };
        properties(kind, &["red", "green", "blue"]);
    }
    header +=
        &format!("element face {faces}\nproperty list uchar uint vertex_indices\nend_header\n");
    write_whole(path, |file| {
        let mut put = |bytes: &[u8]| file.write_all(bytes).map_err(Error::io(path));
        put(header.as_bytes())?;
        let mut row = Vec::new();
        for part in parts {
            for i in 0..part.positions.len() {
                row.clear();
                row.extend(part.positions[i]);
                if let Some(normals) = part.normals.as_ref().filter(|_| has_normals) {
                    row.extend(normals[i]);
                }
                if let Some(uvs) = part.uvs.as_ref().filter(|_| has_uvs) {
                    row.extend(uvs[i]);
                }
                for &v in &row {
                    match double {
                        true => put(&v.to_le_bytes())?,
                        false => put(&(v as f32).to_le_bytes())?,
                    }
                }
                for v in part.colors.iter().flat_map(|colors| colors[i]) {
                    match bytes {
                        true => put(&[byte(v)])?,
                        false => put(&(v as f32).to_le_bytes())?,
                    }
                }
            }
        }
        let mut first = 0;
        for part in parts {
            for face in &part.faces {
                put(&[3])?;
                face.iter()
                    .try_for_each(|v| put(&(first + v).to_le_bytes()))?;
            }
            first += part.positions.len() as u32;
        }
        Ok(())
    })
}
