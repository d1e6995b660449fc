//! Points of surfaces that rays hit: position, normals, and what their material is there.

use super::gradient::{Sums, Wanted};
use super::scene::{Colour, KernelScene, Texels, Texture};
use crate::accel::Hit;
use crate::model::V3;
use crate::model::bsdf::{Shading, ShadingGradient};
use crate::model::cone::lifted;
use crate::model::triangle::{barycentric, barycentric_slopes, hit_backward};
use crate::scene::CHANNELS;

/// Normals of corners may cancel where they are interpolated.
const TINY: f32 = 1e-15;

/// A point that a ray hit.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Point {
    pub triangle: u32,
    /// Distance along the ray.
    pub t: f32,
    /// Where it is at the ray's time.
    pub position: V3,
    /// Weights of the triangle's corners in it.
    pub weights: [f32; 3],
    /// 1 if the ray came from the triangle's front, else −1.
    pub side: f32,
    pub uv: [f32; 2],
    pub shading: Shading,
}

impl Point {
    /// Where rays that leave it start: above it by what it may be off by.
    #[inline(always)]
    pub fn start(&self) -> V3 {
        lifted(self.position, self.shading.geometric)
    }
}

/// Derivatives by a ray.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RayGradient {
    pub origin: V3,
    pub direction: V3,
}

/// Texels of a bilinear look-up, and where in their cell a point lies.
#[derive(Clone, Copy, Debug)]
struct Cell {
    texels: [usize; 4],
    at: [f32; 2],
}

impl Cell {
    /// Texel centres at half-integers, row 0 at the top (v = 1).
    fn new(texture: &Texture, uv: [f32; 2]) -> Self {
        let x = uv[0] * texture.width as f32 - 0.5;
        let y = (1.0 - uv[1]) * texture.height as f32 - 0.5;
        let (left, top) = (x.floor(), y.floor());
        let texel = |dx: i64, dy: i64| {
            let column = texture.wrap.texel(left as i64 + dx, texture.width);
            let row = texture.wrap.texel(top as i64 + dy, texture.height);
            texture.offset + row * texture.width + column
        };
        Self {
            texels: [texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1)],
            at: [x - left, y - top],
        }
    }

    fn weights(&self) -> [f32; 4] {
        let [x, y] = self.at;
        [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y]
    }
}

impl Colour {
    #[inline(always)]
    fn at(&self, texels: &Texels, uv: [f32; 2]) -> V3 {
        match &self.texture {
            None => self.constant,
            Some(texture) => texture.look_up(texels, uv),
        }
    }

    /// Adds the derivatives of g·colour by the constant or the texels; returns that by the coordinates.
    #[inline(always)]
    fn backward(
        &self,
        texels: &Texels,
        uv: [f32; 2],
        g: V3,
        (constant, by_texel): (&mut glam::DVec3, &mut [glam::DVec3]),
    ) -> [f32; 2] {
        match &self.texture {
            None => {
                *constant += glam::DVec3::from(g);
                [0.0; 2]
            }
            Some(texture) => texture.backward(texels, uv, g, by_texel),
        }
    }
}

impl Texture {
    #[inline(never)]
    fn look_up(&self, texels: &Texels, uv: [f32; 2]) -> V3 {
        let cell = Cell::new(self, uv);
        let mut sum = V3::ZERO;
        for (&t, w) in cell.texels.iter().zip(cell.weights()) {
            sum += texels.at(t) * w;
        }
        sum
    }

    #[inline(never)]
    fn backward(
        &self,
        texels: &Texels,
        uv: [f32; 2],
        g: V3,
        by_texel: &mut [glam::DVec3],
    ) -> [f32; 2] {
        let cell = Cell::new(self, uv);
        if !by_texel.is_empty() {
            for (&t, w) in cell.texels.iter().zip(cell.weights()) {
                by_texel[t] += glam::DVec3::from(g * w);
            }
        }
        let [a, b, c, d] = cell.texels.map(|t| texels.at(t).dot(g));
        let [x, y] = cell.at;
        let by_x = (1.0 - y) * (b - a) + y * (d - c);
        let by_y = (1.0 - x) * (c - a) + x * (d - b);
        [by_x * self.width as f32, -by_y * self.height as f32]
    }
}

impl KernelScene {
    /// The point that a ray hit, which came with a time in the shutter.
    #[inline(always)]
    pub fn point(&self, hit: Hit, origin: V3, direction: V3, time: f32) -> Point {
        self.point_at(
            hit.triangle,
            origin + direction * hit.t,
            hit.t,
            direction,
            time,
        )
    }

    /// A point of a triangle, about there, seen along a direction.
    #[inline(always)]
    pub fn point_at(&self, triangle: u32, near: V3, t: f32, direction: V3, time: f32) -> Point {
        let k = triangle as usize;
        let tri = &self.triangles[k];
        let shift = self.shift(triangle, time);
        let at_rest = near - shift;
        // Back onto the plane: how far off it is was rounded by the ray's length.
        let off = tri.normal.dot(at_rest) - tri.plane;
        let at_rest = at_rest - tri.normal * off;
        let side = if tri.normal.dot(direction) < 0.0 {
            1.0
        } else {
            -1.0
        };
        let weights = barycentric(tri.corners, tri.normal, tri.area, at_rest);
        let geometric = tri.normal * side;
        let mut uv = [0.0; 2];
        let uv_rows = self.uv_rows[k];
        if self.textured && uv_rows[0] != u32::MAX {
            for (&row, w) in uv_rows.iter().zip(weights) {
                let [u, v] = self.uvs[row as usize];
                uv[0] += u * w;
                uv[1] += v * w;
            }
        }
        let smooth = self.smooth && self.normal_rows[k][0] != u32::MAX;
        let mut normal = geometric;
        if smooth {
            let sum = self.sum_of_normals(k, weights);
            let facing = if sum.dot(geometric) >= 0.0 { 1.0 } else { -1.0 };
            normal = sum * (facing / sum.length().max(TINY));
        }
        let m = &self.materials[tri.material as usize];
        let mut values = [V3::ZERO; CHANNELS];
        let mut i = 0;
        while i < m.kind.shading() {
            values[i] = m.channels[i].at(&self.texels, uv);
            i += 1;
        }
        let shading = Shading {
            geometric,
            normal,
            incoming: direction,
            smooth,
            ..Shading::of(values, m.kind)
        };
        Point {
            triangle,
            t,
            position: at_rest + shift,
            weights,
            side,
            uv,
            shading,
        }
    }

    #[inline(always)]
    fn sum_of_normals(&self, k: usize, weights: [f32; 3]) -> V3 {
        let mut sum = V3::ZERO;
        for (&row, w) in self.normal_rows[k].iter().zip(weights) {
            sum += self.normals[row as usize] * w;
        }
        sum
    }

    /// From derivatives by a point, its geometric normal and its shading to those by what the scene is
    /// made of, and by the ray that hit it.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)] // one place, called once
    pub fn point_backward(
        &self,
        p: &Point,
        time: f32,
        by_position: V3,
        by_geometric: V3,
        by_t: f32,
        shade: &ShadingGradient,
        wanted: &Wanted,
        sums: &mut Sums,
    ) -> RayGradient {
        let k = p.triangle as usize;
        let tri = &self.triangles[k];
        let index = tri.material as usize;
        let m = &self.materials[index];
        let mut by_uv = [0.0; 2];
        if wanted.materials || (wanted.rays && self.textured) {
            let to = &mut sums.materials[index];
            let by = shade.channels();
            let mut i = 0;
            while i < m.kind.shading() {
                let into = (&mut to.channels[i], &mut sums.texels[..]);
                let more = m.channels[i].backward(&self.texels, p.uv, by[i], into);
                by_uv = [by_uv[0] + more[0], by_uv[1] + more[1]];
                i += 1;
            }
        }
        if !wanted.rays {
            return RayGradient::default();
        }
        let by_place = self.attributes_backward(p, by_uv, shade.normal, wanted, sums);
        let flat = if p.shading.smooth {
            V3::ZERO
        } else {
            shade.normal
        };
        let by_normal = flat + shade.geometric + by_geometric;
        let direction = p.shading.incoming;
        // Barycentric coordinates see the point from the corners, which are where the triangle is.
        let by_point = by_position + by_place + direction * by_t;
        let with_plane = hit_backward(tri.normal, direction, by_point);
        if wanted.objects[tri.object as usize] {
            sums.triangles[k].normal += glam::DVec3::from(by_normal * p.side);
            let by_corners = with_plane - by_place;
            for (&v, w) in self.vertex_rows[k].iter().zip(p.weights) {
                sums.vertices[v as usize] += glam::DVec3::from(by_corners * w);
            }
            if wanted.velocities {
                sums.velocities[tri.object as usize] += glam::DVec3::from(by_corners * time);
            }
        }
        let by_ray = by_point - with_plane;
        RayGradient {
            origin: by_ray - direction * by_t,
            direction: by_ray * p.t + shade.incoming,
        }
    }

    /// Adds the derivatives by texture coordinates and shading normals; returns that by the point, less
    /// at each corner by its weight.
    #[inline(always)]
    fn attributes_backward(
        &self,
        p: &Point,
        by_uv: [f32; 2],
        by_normal: V3,
        wanted: &Wanted,
        sums: &mut Sums,
    ) -> V3 {
        let k = p.triangle as usize;
        let (mut by_b, mut by_c) = (0.0, 0.0);
        if by_uv != [0.0; 2] && self.uv_rows[k][0] != u32::MAX {
            let [a, b, c] = self.uv_rows[k].map(|row| self.uvs[row as usize]);
            by_b += by_uv[0] * (b[0] - a[0]) + by_uv[1] * (b[1] - a[1]);
            by_c += by_uv[0] * (c[0] - a[0]) + by_uv[1] * (c[1] - a[1]);
            if wanted.uvs {
                for (&row, w) in self.uv_rows[k].iter().zip(p.weights) {
                    let to = &mut sums.uvs[row as usize];
                    to[0] += f64::from(by_uv[0] * w);
                    to[1] += f64::from(by_uv[1] * w);
                }
            }
        }
        if p.shading.smooth {
            let sum = self.sum_of_normals(k, p.weights);
            let inverse = 1.0 / sum.length().max(TINY);
            let unit = sum * inverse;
            let facing = if sum.dot(p.shading.geometric) >= 0.0 {
                1.0
            } else {
                -1.0
            };
            let by_sum = by_normal.across(unit) * (facing * inverse);
            let [a, b, c] = self.normal_rows[k].map(|row| self.normals[row as usize]);
            by_b += by_sum.dot(b - a);
            by_c += by_sum.dot(c - a);
            if wanted.normals {
                for (&row, w) in self.normal_rows[k].iter().zip(p.weights) {
                    sums.normals[row as usize] += glam::DVec3::from(by_sum * w);
                }
            }
        }
        if by_b == 0.0 && by_c == 0.0 {
            return V3::ZERO;
        }
        let tri = &self.triangles[k];
        let [slope_b, slope_c] = barycentric_slopes(tri.corners, tri.normal, tri.area);
        slope_b * by_b + slope_c * by_c
    }
}
