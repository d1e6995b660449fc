//! Tangents from texture coordinates by MikkTSpace (Mikkelsen 2008, *Simulation of Wrinkled Surfaces Revisited*), the
//! convention in which normal maps are baked.

use std::collections::HashMap;
use std::sync::Arc;

use burn::tensor::{Tensor, TensorData};

use super::mesh::take_rows;
use super::normals::{unit_or_zero, unit_sums};
use super::{CornerAttribute, Mesh};
use crate::error::Result;
use crate::geometry::{Context, Vec3, length, unit_size};

impl Mesh {
    /// Sets tangents by MikkTSpace, the convention of normal maps.
    ///
    /// They are computed from vertices, texture coordinates and normals; a mesh without normals uses the normals of its
    /// faces. Around each vertex, faces are joined across edges where neither texture coordinates nor normals have a
    /// seam and the texture is not mirrored. Their tangents, perpendicular to the normal, are added, each weighted by
    /// the angle of its face.
    ///
    /// The tangents are in the graph of all three inputs. A render computes them itself for meshes that have texture
    /// coordinates, a material with a normal map and no tangents. Call this function beforehand to share them among
    /// renders.
    ///
    /// Faces without area, on the surface or in the texture, do not contribute. Corners that only such faces touch get
    /// the tangent (1, 0, 0). A mesh that can't be rendered or has no texture coordinates stays unchanged.
    ///
    /// ```
    /// use softray::prelude::*;
    /// let device = Device::flex();
    /// let wall = shapes::quad([0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], &device);
    /// let tangents = wall.mikktspace_tangents().tangents.expect("tangents");
    /// assert_eq!(tangents.values.slice([0..1]).into_data().iter::<f32>().collect::<Vec<_>>(), [1.0, 0.0, 0.0, 1.0]);
    /// ```
    pub fn mikktspace_tangents(mut self) -> Self {
        if let Some(uvs) = self.uvs.as_ref().filter(|_| !self.faces.is_empty())
            && let Ok(corners) = Corners::new(&self, uvs)
        {
            let spaces = Spaces::new(&corners);
            let tangents = spaces.tangents(&self, uvs);
            self = self.with_tangents(tangents, spaces.faces);
        }
        self
    }
}

/// Position, normal and texture coordinates of a corner, by their bits.
type Key = ([u64; 3], [u64; 3], [u64; 2]);

/// The corners of a mesh on the host. Corners of the same position, normal and texture coordinates have one number.
struct Corners {
    numbers: Vec<[u32; 3]>,
    /// Twice the signed area of each face in the texture; None for a face without area on the surface.
    texture: Vec<Option<f64>>,
}

impl Corners {
    /// Numbers the corners of a mesh with these texture coordinates.
    fn new(mesh: &Mesh, uvs: &CornerAttribute) -> Result<Self> {
        let places = mesh.checked_vertices("mesh")?;
        let coordinates = mesh.check_attribute("mesh", "uvs", uvs, 2)?;
        let normals = mesh.normals.as_ref();
        let rows = normals.map(|a| mesh.check_attribute("mesh", "normals", a, 3));
        let normals = normals.zip(rows.transpose()?);
        let uv = |row: u32| -> [f64; 2] { [0, 1].map(|i| coordinates[2 * row as usize + i]) };
        let mut known: HashMap<Key, u32> = HashMap::new();
        let count = mesh.faces.len();
        let (mut numbers, mut texture) = (Vec::with_capacity(count), Vec::with_capacity(count));
        for (f, face) in mesh.faces.iter().enumerate() {
            let corners = face.map(|v| places[v as usize]);
            let own_normal = cross(corners);
            let key = |i: usize| {
                let normal = normals.as_ref().map_or(own_normal, |(a, rows)| {
                    [0, 1, 2].map(|k| rows[3 * a.faces[f][i] as usize + k])
                });
                let bits = |v: f64| (v + 0.0).to_bits();
                let at = uv(uvs.faces[f][i]);
                (corners[i].map(bits), normal.map(bits), at.map(bits))
            };
            numbers.push([0, 1, 2].map(|i| {
                let next = known.len() as u32;
                *known.entry(key(i)).or_insert(next)
            }));
            let [a, b, c] = uvs.faces[f].map(uv);
            let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            let has_area = own_normal != [0.0; 3];
            texture.push(has_area.then_some(area));
        }
        Ok(Self { numbers, texture })
    }
}

/// (b − a) × (c − a).
fn cross([a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    let [a, b, c] = [a, b, c].map(glam::DVec3::from);
    (b - a).cross(c - a).to_array()
}

/// Spaces: groups of corners that share a tangent.
struct Spaces {
    /// The space of each corner of each face.
    faces: Arc<Vec<[u32; 3]>>,
    /// The sign of each space's bitangent.
    sides: Vec<f64>,
    /// The corners that contribute: face, corner and space.
    counted: Vec<(u32, u8, u32)>,
}

const NONE: u32 = u32::MAX;

impl Spaces {
    fn new(corners: &Corners) -> Self {
        let count = corners.numbers.len();
        let neighbors = neighbors(corners);
        // A face without area in the texture joins either side.
        let mut side: Vec<Option<bool>> = corners
            .texture
            .iter()
            .map(|area| area.filter(|&a| a != 0.0).map(|a| a > 0.0))
            .collect();
        let counts: Vec<bool> = side.iter().map(Option::is_some).collect();
        let mut spaces = vec![[NONE; 3]; count];
        let mut sides = Vec::new();
        for f in (0..count).filter(|&f| counts[f]) {
            for i in 0..3 {
                if spaces[f][i] != NONE {
                    continue;
                }
                let (own, vertex) = (sides.len() as u32, corners.numbers[f][i]);
                let positive = side[f] == Some(true);
                sides.push(if positive { 1.0 } else { -1.0 });
                let mut open = vec![f as u32];
                while let Some(face) = open.pop() {
                    let face = face as usize;
                    let at = corners.numbers[face].iter().position(|&n| n == vertex);
                    let Some(at) = at.filter(|&at| spaces[face][at] == NONE) else {
                        continue;
                    };
                    if *side[face].get_or_insert(positive) != positive {
                        continue;
                    }
                    spaces[face][at] = own;
                    // Across the edge that leaves the corner and the edge that arrives at it.
                    let next = [neighbors[face][at], neighbors[face][(at + 2) % 3]];
                    open.extend(next.into_iter().filter(|&n| n != NONE));
                }
            }
        }
        let mut counted = Vec::new();
        for f in (0..count).filter(|&f| counts[f]) {
            counted.extend((0..3).map(|i| (f as u32, i as u8, spaces[f][i])));
        }
        // Corners that are in no space share an extra space.
        if spaces.iter().flatten().any(|&s| s == NONE) {
            let last = sides.len() as u32;
            sides.push(1.0);
            let all = spaces.iter_mut().flatten();
            all.filter(|s| **s == NONE).for_each(|s| *s = last);
        }
        Self {
            faces: Arc::new(spaces),
            sides,
            counted,
        }
    }

    /// Returns the tangents `[N, 4]` of the spaces, in the graph of the mesh.
    fn tangents(&self, mesh: &Mesh, uvs: &CornerAttribute) -> Tensor<2> {
        let context = Context {
            device: mesh.vertices.device().inner(),
            dtype: mesh.vertices.dtype(),
        };
        let spaces = self.sides.len();
        if self.counted.is_empty() {
            return context.tensor(&[1.0, 0.0, 0.0, 1.0].repeat(spaces), [spaces, 4]);
        }
        let vertices = unit_size(mesh.vertices.clone().swap_dims(0, 1)).swap_dims(0, 1);
        // Values at each contributing corner (`turn` 0), at the next corner (1) and at the previous corner (2).
        let rows = |values: &Tensor<2>, faces: &[[u32; 3]], turn: usize| {
            let all = self.counted.iter();
            take_rows(
                values,
                all.map(|&(f, i, _)| faces[f as usize][(i as usize + turn) % 3]),
            )
        };
        let place = |turn| Vec3::from_columns(rows(&vertices, &mesh.faces, turn));
        let own = place(0);
        let (next, before) = (place(1).sub(&own), place(2).sub(&own));
        let normal = match &mesh.normals {
            Some(a) => Vec3::from_columns(rows(&a.values, &a.faces, 0)),
            None => next.cross(&before),
        };
        let normal = unit_or_zero(&normal);
        let flat = |v: &Vec3| v.sub(&normal.scale(&normal.dot(v)));

        let v = |turn| rows(&uvs.values, &uvs.faces, turn).narrow(1, 1, 1);
        // The derivative of the position along u, times twice the signed area in the texture.
        let tangent = next
            .scale(&(v(2) - v(0)))
            .sub(&before.scale(&(v(1) - v(0))));
        let n = self.counted.len();
        let sides = self.counted.iter().map(|c| self.sides[c.2 as usize]);
        let sides = context.tensor(&sides.collect::<Vec<_>>(), [n, 1]);
        let tangent = unit_or_zero(&flat(&tangent.scale(&sides)));
        let (a, b) = (flat(&next), flat(&before));
        let (sine, cosine) = (length(&a.cross(&b)), a.dot(&b));
        let angle = sine.clone().atan2(cosine);
        let angle = angle.mask_fill(sine.lower_equal_elem(0.0), 0.0);
        let weighted = tangent.scale(&angle).columns().swap_dims(0, 1);

        let index: Vec<i32> = self.counted.iter().map(|c| c.2 as i32).collect();
        let index = Tensor::from_data(TensorData::new(index, [1, n]), &context.device);
        let unit = unit_sums(weighted, index, spaces, [1.0, 0.0, 0.0], &context);
        let sides = context.tensor(&self.sides, [spaces, 1]);
        Tensor::cat(vec![unit, sides], 1)
    }
}

/// Returns the face across each edge of each face, from a corner to the next. Two faces that run along an edge in
/// opposite directions are paired, each with one face at most.
fn neighbors(corners: &Corners) -> Vec<[u32; 3]> {
    let mut found = vec![[NONE; 3]; corners.numbers.len()];
    let mut open: HashMap<(u32, u32), Vec<(u32, u8)>> = HashMap::new();
    for (f, numbers) in corners.numbers.iter().enumerate() {
        if corners.texture[f].is_none() {
            continue;
        }
        for i in 0..3 {
            let (a, b) = (numbers[i], numbers[(i + 1) % 3]);
            match open.get_mut(&(b, a)).and_then(Vec::pop) {
                Some((other, j)) => {
                    found[f][i] = other;
                    found[other as usize][j as usize] = f as u32;
                }
                None => open.entry((a, b)).or_default().push((f as u32, i as u8)),
            }
        }
    }
    found
}
