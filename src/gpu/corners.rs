//! Values at the corners of triangles, interpolated at points of them: `kernel/corners` in a kernel of a GPU.

use crate::cube::*;

use super::layout::{
    NONE, NORMAL_MAP, NORMALS, OF_MATERIAL, OF_MATERIALS, OF_TRIANGLE, OF_TRIANGLES, TANGENT_ROWS,
    TANGENTS, UVS,
};
use super::reading::Scene;
use super::texture::look_up;
use crate::model::normal_map::Tilt;
use crate::model::{V2, V3, splat, v2};

/// Normals of corners may cancel where they are interpolated.
const TINY: f32 = 1e-15;

/// The place of the rows of a triangle's texture coordinates, which begin with [`NONE`] where it has none.
#[cube]
pub(super) fn uv_rows(scene: &Scene, triangle: u32) -> usize {
    (scene.header[OF_TRIANGLES] + OF_TRIANGLE as u32 * triangle + 2) as usize
}

/// That of the rows of its normals.
#[cube]
pub(super) fn normal_rows(scene: &Scene, triangle: u32) -> usize {
    (scene.header[OF_TRIANGLES] + OF_TRIANGLE as u32 * triangle + 5) as usize
}

/// The vectors at the corners of a triangle.
#[apply(record!)]
pub(super) struct Corners {
    pub a: V3,
    pub b: V3,
    pub c: V3,
}

/// Those of a list with a stride, by their rows.
#[cube]
pub(super) fn corners_of(scene: &Scene, list: u32, rows: usize, stride: u32) -> Corners {
    Corners {
        a: scene.vector(list + stride * scene.words[rows]),
        b: scene.vector(list + stride * scene.words[rows + 1]),
        c: scene.vector(list + stride * scene.words[rows + 2]),
    }
}

#[cube]
impl Corners {
    pub fn at(&self, weights: V3) -> V3 {
        self.a * weights.x + self.b * weights.y + self.c * weights.z
    }
}

/// Texture coordinates at a point of a triangle; 0 where nothing has a texture.
#[cube]
pub(super) fn uv_at(scene: &Scene, triangle: u32, weights: V3, #[comptime] textured: bool) -> V2 {
    let mut uv = v2(0.0, 0.0);
    if textured {
        let rows = uv_rows(scene, triangle);
        if scene.words[rows] != NONE {
            let i = (scene.header[UVS] + 2 * scene.words[rows]) as usize;
            let j = (scene.header[UVS] + 2 * scene.words[rows + 1]) as usize;
            let k = (scene.header[UVS] + 2 * scene.words[rows + 2]) as usize;
            uv = v2(
                scene.floats[i] * weights.x
                    + scene.floats[j] * weights.y
                    + scene.floats[k] * weights.z,
                scene.floats[i + 1] * weights.x
                    + scene.floats[j + 1] * weights.y
                    + scene.floats[k + 1] * weights.z,
            );
        }
    }
    uv
}

/// The interpolated normal, on the side of the geometric one; that itself where the triangle has none.
#[cube]
pub(super) fn normal_at(scene: &Scene, triangle: u32, weights: V3, geometric: V3) -> V3 {
    let mut normal = geometric;
    if comptime!(scene.features.smooth) {
        let rows = normal_rows(scene, triangle);
        if scene.words[rows] != NONE {
            let sum = corners_of(scene, scene.header[NORMALS], rows, 3u32).at(weights);
            let mut inverse = 1.0 / sum.length().max(TINY);
            if sum.dot(geometric) < 0.0 {
                inverse = -inverse;
            }
            normal = sum * inverse;
        }
    }
    normal
}

/// A tilt of a normal, if there is one.
#[apply(record!)]
pub(super) struct TiltAt {
    pub tilt: Tilt,
    pub exists: bool,
    /// The place of the words of the normal map, and of the rows of tangents.
    pub map: usize,
    pub rows: usize,
}

/// The tilt of a normal on the front side by its material's map, if the triangle has tangents.
#[cube]
pub(super) fn tilt_at(
    scene: &Scene,
    triangle: u32,
    material: u32,
    weights: V3,
    uv: V2,
    normal: V3,
) -> TiltAt {
    let map = (scene.header[OF_MATERIALS] + OF_MATERIAL as u32 * material) as usize + NORMAL_MAP;
    let rows = (scene.header[TANGENT_ROWS] + 3 * triangle) as usize;
    let mut tilt = Tilt {
        normal,
        tangent: splat(0.0),
        side: 1.0f32.runtime(),
        texel: splat(0.0),
    };
    let exists = scene.words[map] != NONE && scene.words[rows] != NONE;
    if exists {
        tilt.tangent = corners_of(scene, scene.header[TANGENTS], rows, 4u32).at(weights);
        tilt.side = scene.floats[(scene.header[TANGENTS] + 4 * scene.words[rows] + 3) as usize];
        tilt.texel = look_up(scene, map, uv);
    }
    TiltAt {
        tilt,
        exists,
        map,
        rows,
    }
}
