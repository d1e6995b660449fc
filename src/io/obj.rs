use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};

use super::description::Corners;
use super::obj_text::ObjText;
use super::{HostImage, LoadLimits};
use crate::error::{Error, Result};
use crate::scene::{Albedo, Material, Mesh, Object, Scene, Wrap};

/// Reads an OBJ file with its MTL files; see [`Scene::load`].
pub(super) fn read(path: &Path, device: &Device, limits: &LoadLimits) -> Result<Scene> {
    let text = ObjText::read(path, limits)?;
    let (models, described) = text.parse(path)?;
    let mut pieces: Vec<(String, Pieces)> = Vec::new();
    let mut index = HashMap::new();
    for model in &models {
        if model.mesh.indices.is_empty() {
            continue;
        }
        let i = *index.entry(&model.name).or_insert(pieces.len());
        if i == pieces.len() {
            pieces.push((model.name.clone(), Pieces::default()));
        }
        pieces[i].1.add(&model.mesh);
    }
    if pieces.is_empty() {
        return Err(Error::NoTriangles {
            path: Some(path.into()),
            objects: 0,
        });
    }
    let mut materials = Materials {
        described: &described,
        textures: &text.textures,
        limits,
        built: HashMap::new(),
        read: HashMap::new(),
        device,
    };
    let mut scene = Scene::new();
    for (name, mut joined) in pieces {
        if text.without_uvs.contains(&name) {
            joined.uvs = Corners::default();
        }
        if text.without_normals.contains(&name) {
            joined.normals = Corners::default();
        }
        scene = scene.with(joined.object(name, &mut materials, device)?);
    }
    Ok(scene)
}

impl<const C: usize> Corners<C> {
    fn add(&mut self, values: &[f64], indices: &[u32]) {
        let base = self.values.len() as u32;
        self.values.extend(rows(values));
        let faces = rows::<u32, 3>(indices);
        self.faces.extend(faces.map(|f| f.map(|i| base + i)));
    }
}

/// An object of the file, joined from the pieces that tobj makes where the material changes.
#[derive(Default)]
struct Pieces {
    positions: Vec<[f64; 3]>,
    /// The row of `positions` of each vertex of the file.
    row_of_vertex: HashMap<u64, u32>,
    faces: Vec<[u32; 3]>,
    uvs: Corners<2>,
    normals: Corners<3>,
    materials: Vec<Option<usize>>,
    face_materials: Vec<u32>,
}

impl Pieces {
    fn add(&mut self, mesh: &tobj::Mesh) {
        let vertices = rows::<f64, 3>(&mesh.positions);
        // The "colour" is the vertex's row in the file.
        let in_file = mesh.vertex_color.chunks_exact(3).map(|c| c[0] as u64);
        let mut row = Vec::with_capacity(mesh.positions.len() / 3);
        for (position, vertex) in vertices.zip(in_file) {
            let next = self.positions.len() as u32;
            let at = *self.row_of_vertex.entry(vertex).or_insert(next);
            if at == next {
                self.positions.push(position);
            }
            row.push(at);
        }
        let faces = rows::<u32, 3>(&mesh.indices).map(|f| f.map(|i| row[i as usize]));
        self.faces.extend(faces);
        self.uvs.add(&mesh.texcoords, &mesh.texcoord_indices);
        self.normals.add(&mesh.normals, &mesh.normal_indices);
        let known = self.materials.iter().position(|&m| m == mesh.material_id);
        let material = known.unwrap_or_else(|| {
            self.materials.push(mesh.material_id);
            self.materials.len() - 1
        });
        self.face_materials
            .resize(self.faces.len(), material as u32);
    }

    fn object(mut self, name: String, all: &mut Materials, device: &Device) -> Result<Object> {
        if self.normals.values.contains(&[0.0; 3]) {
            log::warn!("{name}: it has normals of zero length, using none of its normals");
            self.normals = Corners::default();
        }
        let n = self.faces.len();
        let mut mesh = Mesh::from_host(&self.positions, self.faces, device);
        mesh.uvs = self.uvs.attribute(n, device);
        mesh.normals = self.normals.attribute(n, device);
        let mut object = Object::new(mesh).named(name);
        let mut materials = Vec::with_capacity(self.materials.len());
        for &m in &self.materials {
            let mut material = all.get(m)?;
            if object.mesh.uvs.is_none() {
                let plain = [all.colour(m), all.specular(m), all.emission(m)];
                let Material {
                    diffuse,
                    specular,
                    emission,
                    name,
                    ..
                } = &mut material;
                let mut textured = false;
                for (albedo, plain) in [diffuse, specular, emission].into_iter().zip(plain) {
                    if matches!(albedo, Albedo::Texture { .. }) {
                        *albedo = plain;
                        textured = true;
                    }
                }
                if textured {
                    log::warn!(
                        "{}: material {name} has a texture, but not all corners have coordinates: taking its \
                         colour",
                        object.name,
                    );
                }
            }
            materials.push(material);
        }
        object.materials = materials.into();
        if object.materials.len() > 1 {
            object.face_materials = Arc::new(self.face_materials);
        }
        Ok(object)
    }
}

/// Materials made when first used, so that objects share textures and unused ones aren't read.
struct Materials<'a> {
    described: &'a [tobj::Material],
    textures: &'a [PathBuf],
    limits: &'a LoadLimits,
    built: HashMap<usize, Material>,
    /// Textures that were read, by their number.
    read: HashMap<usize, Tensor<3>>,
    device: &'a Device,
}

impl Materials<'_> {
    /// The diffuse colour of a material without its texture.
    fn colour(&self, id: Option<usize>) -> Albedo {
        let described = id.and_then(|i| self.described.get(i));
        match described.and_then(|m| m.diffuse) {
            Some(kd) => kd.into(),
            None => Material::default().diffuse,
        }
    }

    /// `Ks`, black where there is none.
    fn specular(&self, id: Option<usize>) -> Albedo {
        let described = id.and_then(|i| self.described.get(i));
        let ks = described.and_then(|m| m.specular);
        ks.unwrap_or([0.0; 3]).into()
    }

    /// `Ke`, black where there is none.
    fn emission(&self, id: Option<usize>) -> Albedo {
        let described = id.and_then(|i| self.described.get(i));
        let ke = described.and_then(|m| m.emissive);
        ke.unwrap_or([0.0; 3]).into()
    }

    fn get(&mut self, id: Option<usize>) -> Result<Material> {
        let Some((id, source)) = id.and_then(|i| Some((i, self.described.get(i)?))) else {
            return Ok(Material::default().named("default"));
        };
        if let Some(built) = self.built.get(&id) {
            return Ok(built.clone());
        }
        let mut material = Material::default().named(source.name.clone());
        material.diffuse = self.colour(Some(id));
        if let Some((texels, wrap)) = self.texture(source.diffuse_texture.as_deref())? {
            material.diffuse = Albedo::Texture { texels, wrap };
            if source.diffuse.is_some_and(|kd| kd != [1.0; 3]) {
                log::info!("material {}: map_Kd replaces Kd", source.name);
            }
        }
        material.specular =
            match self.tinted(source.specular, source.specular_texture.as_deref())? {
                Some(texture) => texture,
                None => self.specular(Some(id)),
            };
        if let Some(ns) = source.shininess {
            material.shininess = ns.into();
        }
        let map = source.unknown_param.get("map_Ke").map(String::as_str);
        material.emission = match self.tinted(source.emissive, map)? {
            Some(texture) => texture,
            None => self.emission(Some(id)),
        };
        self.built.insert(id, material.clone());
        Ok(material)
    }

    /// A texture times a colour, which is white where there is none. None where the colour is black.
    fn tinted(
        &mut self,
        colour: Option<[f64; 3]>,
        statement: Option<&str>,
    ) -> Result<Option<Albedo>> {
        if colour == Some([0.0; 3]) {
            return Ok(None);
        }
        let Some((mut texels, wrap)) = self.texture(statement)? else {
            return Ok(None);
        };
        if let Some(colour) = colour.filter(|c| *c != [1.0; 3]) {
            let colour = Tensor::<1>::from_data(TensorData::from(colour), self.device);
            texels = texels * colour.reshape([1, 1, 3]);
        }
        Ok(Some(Albedo::Texture { texels, wrap }))
    }

    /// The texture that a statement of [`ObjText`] names.
    fn texture(&mut self, statement: Option<&str>) -> Result<Option<(Tensor<3>, Wrap)>> {
        let mut words = statement.unwrap_or("").split_whitespace();
        let number = words.next().and_then(|w| w.parse::<usize>().ok());
        let wrap = match words.next() {
            Some(_) => Wrap::Clamp,
            None => Wrap::Repeat,
        };
        let Some((number, file)) = number.and_then(|n| Some((n, self.textures.get(n)?))) else {
            return Ok(None);
        };
        let texels = match self.read.get(&number) {
            Some(texels) => texels.clone(),
            None => {
                let image = HostImage::read_within(file, self.limits)?;
                let texels = image.into_tensor(self.device);
                self.read.insert(number, texels.clone());
                texels
            }
        };
        Ok(Some((texels, wrap)))
    }
}

/// Flat values as rows of N.
fn rows<T: Copy, const N: usize>(flat: &[T]) -> impl Iterator<Item = [T; N]> {
    flat.chunks_exact(N).map(|c| std::array::from_fn(|i| c[i]))
}
