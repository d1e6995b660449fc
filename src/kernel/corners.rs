//! Values at the corners of triangles, interpolated at points of them: texture coordinates, normals, colours and
//! tangents, and their derivatives.

use glam::DVec3;

use super::gradient::Sums;
use super::scene::{Corners, KernelScene};
use super::surface::Point;
use super::view::View;
use crate::model::V3;
use crate::model::normal_map::Tilt;
use crate::model::texture::Texture;
use crate::model::triangle::barycentric_slopes;

/// Normals of corners may cancel where they are interpolated.
const TINY: f32 = 1e-15;

impl Corners {
    /// Whether a triangle has values.
    #[inline(always)]
    fn has(&self, k: usize) -> bool {
        self.rows.get(k).is_some_and(|rows| rows[0] != u32::MAX)
    }

    #[inline(always)]
    fn of(&self, k: usize) -> [V3; 3] {
        self.rows[k].map(|row| self.values[row as usize])
    }

    #[inline(always)]
    fn at(&self, k: usize, weights: [f32; 3]) -> V3 {
        let [a, b, c] = self.of(k);
        a * weights[0] + b * weights[1] + c * weights[2]
    }

    /// Adds the derivatives by the values at a triangle's corners, unless that list is empty.
    #[inline(always)]
    fn backward(&self, k: usize, weights: [f32; 3], g: V3, sums: &mut [DVec3]) {
        if !sums.is_empty() {
            for (&row, w) in self.rows[k].iter().zip(weights) {
                sums[row as usize] += DVec3::from(g * w);
            }
        }
    }
}

/// Derivatives by the weights of a point's second and third corner.
#[derive(Default)]
struct ByWeights {
    b: f32,
    c: f32,
}

impl ByWeights {
    #[inline(always)]
    fn add(&mut self, [a, b, c]: [V3; 3], g: V3) {
        self.b += g.dot(b - a);
        self.c += g.dot(c - a);
    }
}

impl KernelScene {
    /// Texture coordinates at a point of a triangle; 0 where nothing has a texture.
    #[inline(always)]
    pub fn uv_at(&self, k: usize, weights: [f32; 3]) -> [f32; 2] {
        let mut uv = [0.0; 2];
        let uv_rows = self.uv_rows[k];
        if self.textured && uv_rows[0] != u32::MAX {
            for (&row, w) in uv_rows.iter().zip(weights) {
                let [u, v] = self.uvs[row as usize];
                uv[0] += u * w;
                uv[1] += v * w;
            }
        }
        uv
    }

    /// The colour that the diffuse albedo is multiplied by, if the triangle has colours.
    #[inline(always)]
    pub(super) fn colour_at(&self, k: usize, weights: [f32; 3]) -> Option<V3> {
        let tinted = || self.material(k as u32).kind.bsdf.is_tinted();
        (self.colours.has(k) && tinted()).then(|| self.colours.at(k, weights))
    }

    #[inline(always)]
    pub(super) fn has_normals(&self, k: usize) -> bool {
        self.smooth && self.normal_rows[k][0] != u32::MAX
    }

    /// The interpolated normal, of unit length, on the side of the geometric one.
    #[inline(always)]
    pub(super) fn normal_at(&self, k: usize, weights: [f32; 3], geometric: V3) -> V3 {
        let sum = self.sum_of_normals(k, weights);
        let facing = if sum.dot(geometric) >= 0.0 { 1.0 } else { -1.0 };
        sum * (facing / sum.length().max(TINY))
    }

    #[inline(always)]
    fn sum_of_normals(&self, k: usize, weights: [f32; 3]) -> V3 {
        let mut sum = V3::ZERO;
        for (&row, w) in self.normal_rows[k].iter().zip(weights) {
            sum += self.normals[row as usize] * w;
        }
        sum
    }

    /// The tilt of a normal on the front side by a map, if the triangle has tangents.
    #[inline(always)]
    pub(super) fn tilt_at(
        &self,
        map: &Texture,
        k: usize,
        (weights, uv): ([f32; 3], [f32; 2]),
        normal: V3,
    ) -> Option<Tilt> {
        self.tangents.has(k).then(|| Tilt {
            normal,
            tangent: self.tangents.at(k, weights),
            side: self.tangent_sides[self.tangents.rows[k][0] as usize],
            texel: map.look_up(&self.texels, uv),
        })
    }
}

impl View {
    /// Adds the derivatives by a surface point's texture coordinates, colour and shading normal to those of the
    /// values at its triangle's corners and of its normal map. Returns those by the point, which each corner takes
    /// less by its weight, and by the geometric normal.
    #[inline(always)]
    pub(super) fn corners_backward(
        &self,
        p: &Point,
        (mut by_uv, by_colour): ([f32; 2], V3),
        mut by_normal: V3,
        sums: &mut Sums,
    ) -> (V3, V3) {
        let (scene, k) = (&*self.scene, p.triangle as usize);
        let mut by = ByWeights::default();
        let geometric = p.shading.geometric;
        let material = &scene.materials[scene.triangles[k].material as usize];
        if scene.tilted
            && let Some(map) = &material.normal_map
        {
            let normal = scene.interpolated(p, k);
            if let Some(tilt) = scene.tilt_at(map, k, (p.weights, p.uv), normal * p.side) {
                let by_tilt = tilt.backward(by_normal * p.side);
                by_normal = by_tilt.normal * p.side;
                let more = map.backward(&scene.texels, p.uv, by_tilt.texel, &mut sums.texels);
                by_uv = [by_uv[0] + more[0], by_uv[1] + more[1]];
                by.add(scene.tangents.of(k), by_tilt.tangent);
                let to = &mut sums.tangents;
                scene.tangents.backward(k, p.weights, by_tilt.tangent, to);
            }
        }
        if by_colour != V3::ZERO {
            by.add(scene.colours.of(k), by_colour);
        }
        if by_uv != [0.0; 2] && scene.uv_rows[k][0] != u32::MAX {
            let [a, b, c] = scene.uv_rows[k].map(|row| scene.uvs[row as usize]);
            by.b += by_uv[0] * (b[0] - a[0]) + by_uv[1] * (b[1] - a[1]);
            by.c += by_uv[0] * (c[0] - a[0]) + by_uv[1] * (c[1] - a[1]);
            self.add_to_uvs(k, p.weights, by_uv, sums);
        }
        let mut by_geometric = by_normal;
        if scene.has_normals(k) {
            by_geometric = V3::ZERO;
            let sum = scene.sum_of_normals(k, p.weights);
            let inverse = 1.0 / sum.length().max(TINY);
            let unit = sum * inverse;
            let facing = if sum.dot(geometric) >= 0.0 { 1.0 } else { -1.0 };
            let by_sum = by_normal.reject_from_normalized(unit) * (facing * inverse);
            by.add(
                scene.normal_rows[k].map(|row| scene.normals[row as usize]),
                by_sum,
            );
            if self.wanted.normals {
                for (&row, w) in scene.normal_rows[k].iter().zip(p.weights) {
                    sums.normals[row as usize] += DVec3::from(by_sum * w);
                }
            }
        }
        if by.b == 0.0 && by.c == 0.0 {
            return (V3::ZERO, by_geometric);
        }
        let tri = &scene.triangles[k];
        let [a, b, c] = tri.corners;
        let slopes = barycentric_slopes(a, b, c, tri.normal, tri.area);
        (slopes.first * by.b + slopes.second * by.c, by_geometric)
    }

    /// Adds a derivative by the texture coordinates at a point of a triangle, which has some.
    #[inline(always)]
    pub fn add_to_uvs(&self, k: usize, weights: [f32; 3], by_uv: [f32; 2], sums: &mut Sums) {
        if self.wanted.uvs {
            for (&row, w) in self.scene.uv_rows[k].iter().zip(weights) {
                let to = &mut sums.uvs[row as usize];
                to[0] += f64::from(by_uv[0] * w);
                to[1] += f64::from(by_uv[1] * w);
            }
        }
    }

    /// Adds the derivatives by the colours at a point's corners.
    #[inline(always)]
    pub(super) fn colours_backward(&self, p: &Point, by_colour: V3, sums: &mut Sums) {
        let k = p.triangle as usize;
        self.scene
            .colours
            .backward(k, p.weights, by_colour, &mut sums.colours);
    }
}

impl KernelScene {
    /// The normal of a point before a map tilts it.
    #[inline(always)]
    fn interpolated(&self, p: &Point, k: usize) -> V3 {
        if self.has_normals(k) {
            self.normal_at(k, p.weights, p.shading.geometric)
        } else {
            p.shading.geometric
        }
    }
}
