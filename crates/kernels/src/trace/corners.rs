//! Interpolation of texture coordinates, normals, colors and tangents from triangle corners, and their derivatives.

use crate::cube::*;

use super::parts::{UVS, VELOCITIES, VERTICES};
#[cfg(feature = "gpu")]
use super::scene::SceneExpand;
use super::scene::{MATERIAL, NONE, NORMAL_MAP, NORMAL_ROWS, Scene, TRIANGLE, UV_ROWS};
use super::sums::Sums;
use crate::model::lists::vector;
use crate::model::normal_map::Tilt;
use crate::model::{V2, V3, component, splat, v2};

/// Lower bound of the length of an interpolated normal, since corner normals may cancel.
const TINY: f32 = 1e-15;

/// Three rows of a list, one per corner.
#[apply(record!)]
pub struct Rows {
    pub a: u32,
    pub b: u32,
    pub c: u32,
}

/// Reads three rows from index `at` of a list.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn rows_at(list: &[u32], at: u32) -> Rows {
    let i = at as usize;
    let c = list[i + 2];
    let b = list[i + 1];
    Rows { a: list[i], b, c }
}

/// Vectors at the corners of a triangle.
#[apply(record!)]
pub struct Corners {
    pub a: V3,
    pub b: V3,
    pub c: V3,
}

#[cfg_attr(feature = "gpu", cube)]
impl Corners {
    #[inline(always)]
    pub fn at(&self, weights: V3) -> V3 {
        self.a * weights.x + self.b * weights.y + self.c * weights.z
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Rows {
    /// Returns whether the triangle has rows.
    #[inline(always)]
    pub fn exist(&self) -> bool {
        self.a != NONE
    }

    /// Reads the vectors of the rows from a list with a stride.
    #[inline(always)]
    pub fn of(&self, list: &[f32], stride: u32) -> Corners {
        Corners {
            a: vector(list, stride * self.a),
            b: vector(list, stride * self.b),
            c: vector(list, stride * self.c),
        }
    }

    #[inline(always)]
    fn row(&self, k: u32) -> u32 {
        let mut row = self.a;
        if k == 1 {
            row = self.b;
        } else if k == 2 {
            row = self.c;
        }
        row
    }

    /// Adds the derivative with respect to an interpolated vector to those of the vectors at the corners.
    #[inline(always)]
    pub fn add(&self, sums: &Sums, weights: V3, g: V3, part: u32) {
        let mut k = 0u32;
        while k < 3 {
            sums.add_vector(3 * self.row(k), g * component(weights, k), part);
            k += 1;
        }
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl<'a> Scene<'a> {
    /// Returns the rows of a triangle's texture coordinates.
    #[inline(always)]
    pub fn uv_rows(&self, triangle: u32) -> Rows {
        rows_at(self.triangles, TRIANGLE * triangle + UV_ROWS)
    }

    /// Returns the rows of a triangle's normals.
    #[inline(always)]
    pub fn normal_rows(&self, triangle: u32) -> Rows {
        rows_at(self.triangles, TRIANGLE * triangle + NORMAL_ROWS)
    }

    /// Returns the texture coordinates of a row.
    #[inline(always)]
    pub fn uv_of(&self, row: u32) -> V2 {
        let i = 2 * row as usize;
        let v = self.uvs[i + 1];
        v2(self.uvs[i], v)
    }

    /// Returns the texture coordinates at a point of a triangle; 0 if nothing has a texture.
    #[inline(always)]
    pub fn uv_at(&self, triangle: u32, weights: V3) -> V2 {
        let mut uv = v2(0.0, 0.0);
        if comptime!(self.features.textured) {
            let rows = self.uv_rows(triangle);
            if rows.exist() {
                let a = self.uv_of(rows.a);
                let b = self.uv_of(rows.b);
                let c = self.uv_of(rows.c);
                uv = v2(
                    a.x * weights.x + b.x * weights.y + c.x * weights.z,
                    a.y * weights.x + b.y * weights.y + c.y * weights.z,
                );
            }
        }
        uv
    }

    /// Returns the rows of the vertex colors that a triangle's diffuse albedo is multiplied by.
    #[inline(always)]
    pub fn rows_of_colors(&self, triangle: u32) -> Rows {
        rows_at(self.color_rows, 3 * triangle)
    }

    /// Returns the interpolated normal on the side of the geometric normal, or the geometric normal if the triangle
    /// has no normals.
    #[inline(always)]
    pub fn normal_at(&self, triangle: u32, weights: V3, geometric: V3) -> V3 {
        let mut normal = geometric;
        if comptime!(self.features.smooth) {
            let rows = self.normal_rows(triangle);
            if rows.exist() {
                normal = facing(rows.of(self.normals, 3u32).at(weights), geometric).normal;
            }
        }
        normal
    }

    /// Returns the tilt of a normal on the front side by the normal map of the material. It exists if there is a map
    /// and the triangle has tangents.
    #[inline(always)]
    pub fn tilt_at(&self, triangle: u32, material: u32, weights: V3, uv: V2, normal: V3) -> TiltAt {
        let map = MATERIAL * material + NORMAL_MAP;
        let rows = rows_at(self.tangent_rows, 3 * triangle);
        let mut tilt = Tilt {
            normal,
            tangent: splat(0.0),
            side: 1.0f32.runtime(),
            texel: splat(0.0),
        };
        let exists = self.of_materials[map as usize] != NONE && rows.exist();
        if exists {
            tilt.tangent = rows.of(self.tangents, 4u32).at(weights);
            tilt.side = self.tangents[(4 * rows.a + 3) as usize];
            tilt.texel = self.look_up(map, uv);
        }
        TiltAt {
            tilt,
            exists,
            map,
            rows,
        }
    }

    /// Adds the derivative with respect to the texture coordinates at a point of a triangle.
    #[inline(always)]
    pub fn add_to_uvs(&self, sums: &Sums, triangle: u32, weights: V3, by_uv: V2) {
        if comptime!(sums.of.uvs && self.features.textured) {
            let rows = self.uv_rows(triangle);
            if rows.exist() {
                let mut k = 0u32;
                while k < 3 {
                    let weight = component(weights, k);
                    let at = 2 * rows.row(k);
                    sums.add(at, by_uv.x * weight, UVS);
                    sums.add(at + 1, by_uv.y * weight, UVS);
                    k += 1;
                }
            }
        }
    }

    /// Adds the derivative with respect to a point of a triangle, which moves with the triangle's corners.
    #[inline(always)]
    pub fn add_to_corners(&self, sums: &Sums, triangle: u32, weights: V3, g: V3, time: f32) {
        rows_at(self.vertex_rows, 3 * triangle).add(sums, weights, g, VERTICES);
        if comptime!(sums.of.velocities) {
            sums.add_vector(3 * self.object_of(triangle), g * time, VELOCITIES);
        }
    }

    /// Adds the derivative with respect to the point of a triangle that is at a position, if it is required.
    #[inline(always)]
    pub fn add_to_point(&self, sums: &Sums, triangle: u32, position: V3, g: V3, time: f32) {
        if comptime!(sums.of.objects) && self.is_wanted(self.object_of(triangle)) {
            let at_rest = position - self.shift(triangle, time);
            let weights = self.triangle(triangle).weights(at_rest);
            self.add_to_corners(sums, triangle, weights, g, time);
        }
    }
}

/// A weighted sum, normalized and on the side of a geometric normal, and the factor it was multiplied by.
#[apply(record!)]
pub(super) struct Facing {
    pub normal: V3,
    pub factor: f32,
}

#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn facing(sum: V3, geometric: V3) -> Facing {
    let factor = 1.0 / max(sum.length(), TINY);
    let factor = select(sum.dot(geometric) < 0.0, -factor, factor);
    Facing {
        normal: sum * factor,
        factor,
    }
}

/// The tilt of a normal, if it exists.
#[apply(record!)]
pub struct TiltAt {
    pub tilt: Tilt,
    pub exists: bool,
    /// Index of the words of the normal map, and the rows of tangents.
    pub map: u32,
    pub rows: Rows,
}
