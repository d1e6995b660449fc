//! Points of surfaces that rays hit: position, normals, and what their material is there.

use glam::DVec3;

use super::gradient::Sums;
use super::scene::KernelScene;
use super::view::View;
use crate::accel::Hit;
use crate::model::V3;
use crate::model::bsdf::{Shading, ShadingGradient};
use crate::model::cone::lifted;
use crate::model::emitter::Emission;
use crate::model::triangle::{barycentric, barycentric_slopes, hit_backward};
use crate::sampling::Receiver;
use crate::scene::{CHANNELS, Channel};

/// Normals of corners may cancel where they are interpolated.
const TINY: f32 = 1e-15;

/// A point that a ray hit.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Point {
    pub triangle: u32,
    /// Distance along the ray.
    pub t: f32,
    /// Its position at the ray's time.
    pub position: V3,
    /// Weights of the triangle's corners in it.
    pub weights: [f32; 3],
    /// 1 if the ray came from the triangle's front, else −1.
    pub side: f32,
    pub uv: [f32; 2],
    pub shading: Shading,
}

impl Point {
    /// The start of rays that leave it along a direction: above it by what it may be off by.
    #[inline(always)]
    pub fn start(&self, direction: V3) -> V3 {
        lifted(self.position, self.shading.outer(direction))
    }

    /// As a point that emitters are chosen for.
    #[inline(always)]
    pub fn receiver(&self, time: f32) -> Receiver {
        Receiver {
            position: self.position,
            normal: self.shading.geometric,
            time,
        }
    }
}

/// Derivatives by a surface point, but for those that its incoming ray takes part in.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PointGradient {
    pub position: V3,
    pub geometric: V3,
    pub shading: ShadingGradient,
    /// By the radiance that it emits, where that is a texture.
    pub emission: V3,
}

/// Derivatives by a ray.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RayGradient {
    pub origin: V3,
    pub direction: V3,
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
        let uv = self.uv_at(k, weights);
        let smooth = self.smooth && self.normal_rows[k][0] != u32::MAX;
        let mut normal = geometric;
        if smooth {
            let sum = self.sum_of_normals(k, weights);
            let facing = if sum.dot(geometric) >= 0.0 { 1.0 } else { -1.0 };
            normal = sum * (facing / sum.length().max(TINY));
        }
        let m = &self.materials[tri.material as usize];
        let mut values = [V3::ZERO; CHANNELS];
        let count = m.kind.shading();
        // As many turns whatever the material, so that the loop is unrolled.
        let mut i = 0;
        while i < CHANNELS {
            if i < count {
                values[i] = m.channels[i].at(&self.texels, uv);
            }
            i += 1;
        }
        let shading = Shading {
            geometric,
            normal,
            incoming: direction,
            smooth,
            inside: side < 0.0,
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

    #[inline(always)]
    fn sum_of_normals(&self, k: usize, weights: [f32; 3]) -> V3 {
        let mut sum = V3::ZERO;
        for (&row, w) in self.normal_rows[k].iter().zip(weights) {
            sum += self.normals[row as usize] * w;
        }
        sum
    }
}

impl View {
    /// Adds the derivatives by the scene's parts of a point that has derivatives by its position, geometric
    /// normal, distance and shading; returns those by the ray that hit it.
    #[inline(always)]
    pub fn point_backward(
        &self,
        p: &Point,
        time: f32,
        by: &PointGradient,
        by_t: f32,
        sums: &mut Sums,
    ) -> RayGradient {
        let (k, shade) = (p.triangle as usize, &by.shading);
        let tri = &self.scene.triangles[k];
        let index = tri.material as usize;
        let m = &self.scene.materials[index];
        let mut by_uv = [0.0; 2];
        if self.wanted.materials || (self.wanted.rays && self.scene.textured) {
            let to = &mut sums.materials[index];
            let channels = shade.channels();
            let mut i = 0;
            while i < m.kind.shading() {
                let into = (&mut to[i], &mut sums.texels[..]);
                let more = m.channels[i].backward(&self.scene.texels, p.uv, channels[i], into);
                by_uv = [by_uv[0] + more[0], by_uv[1] + more[1]];
                i += 1;
            }
        }
        if by.emission != V3::ZERO {
            let more = self.emission_backward(k, p.uv, p.side, by.emission, sums);
            by_uv = [by_uv[0] + more[0], by_uv[1] + more[1]];
        }
        if !self.wanted.rays {
            return RayGradient::default();
        }
        let by_place = self.attributes_backward(p, by_uv, shade.normal, sums);
        let flat = if p.shading.smooth {
            V3::ZERO
        } else {
            shade.normal
        };
        let by_normal = flat + shade.geometric + by.geometric;
        let direction = p.shading.incoming;
        // Barycentric coordinates see the point from the corners, which are where the triangle is.
        let by_point = by.position + by_place + direction * by_t;
        let with_plane = hit_backward(tri.normal, direction, by_point);
        if self.wanted.objects[tri.object as usize] {
            sums.triangles[k].normal += DVec3::from(by_normal * p.side);
            let by_corners = with_plane - by_place;
            self.add_to_corners(k, p.weights, by_corners, time, sums);
        }
        let by_ray = by_point - with_plane;
        RayGradient {
            origin: by_ray - direction * by_t,
            direction: by_ray * p.t + shade.incoming,
        }
    }

    /// Adds a derivative by a point of a triangle, which moves with its corners.
    #[inline(always)]
    pub fn add_to_corners(&self, k: usize, weights: [f32; 3], g: V3, time: f32, sums: &mut Sums) {
        for (&v, w) in self.scene.vertex_rows[k].iter().zip(weights) {
            sums.vertices[v as usize] += DVec3::from(g * w);
        }
        if self.wanted.velocities {
            let object = self.scene.triangles[k].object as usize;
            sums.velocities[object] += DVec3::from(g * time);
        }
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

    /// Adds the derivatives of g times the radiance that a triangle emits in a direction, given by its cosine; returns
    /// that by the texture coordinates.
    #[inline(always)]
    pub fn emission_backward(
        &self,
        k: usize,
        uv: [f32; 2],
        cosine: f32,
        g: V3,
        sums: &mut Sums,
    ) -> [f32; 2] {
        let index = self.scene.triangles[k].material as usize;
        let channel = Channel::Emission.place();
        let colour = &self.scene.materials[index].channels[channel];
        let into = (&mut sums.materials[index][channel], &mut sums.texels[..]);
        let g = Emission::backward(cosine, g);
        colour.backward(&self.scene.texels, uv, g, into)
    }

    /// Adds the derivatives by texture coordinates and shading normals; returns that by the point, which
    /// each corner takes less by its weight.
    #[inline(always)]
    fn attributes_backward(
        &self,
        p: &Point,
        by_uv: [f32; 2],
        by_normal: V3,
        sums: &mut Sums,
    ) -> V3 {
        let k = p.triangle as usize;
        let (mut by_b, mut by_c) = (0.0, 0.0);
        if by_uv != [0.0; 2] && self.scene.uv_rows[k][0] != u32::MAX {
            let [a, b, c] = self.scene.uv_rows[k].map(|row| self.scene.uvs[row as usize]);
            by_b += by_uv[0] * (b[0] - a[0]) + by_uv[1] * (b[1] - a[1]);
            by_c += by_uv[0] * (c[0] - a[0]) + by_uv[1] * (c[1] - a[1]);
            self.add_to_uvs(k, p.weights, by_uv, sums);
        }
        if p.shading.smooth {
            let sum = self.scene.sum_of_normals(k, p.weights);
            let inverse = 1.0 / sum.length().max(TINY);
            let unit = sum * inverse;
            let facing = if sum.dot(p.shading.geometric) >= 0.0 {
                1.0
            } else {
                -1.0
            };
            let by_sum = by_normal.reject_from_normalized(unit) * (facing * inverse);
            let [a, b, c] = self.scene.normal_rows[k].map(|row| self.scene.normals[row as usize]);
            by_b += by_sum.dot(b - a);
            by_c += by_sum.dot(c - a);
            if self.wanted.normals {
                for (&row, w) in self.scene.normal_rows[k].iter().zip(p.weights) {
                    sums.normals[row as usize] += DVec3::from(by_sum * w);
                }
            }
        }
        if by_b == 0.0 && by_c == 0.0 {
            return V3::ZERO;
        }
        let tri = &self.scene.triangles[k];
        let [a, b, c] = tri.corners;
        let slopes = barycentric_slopes(a, b, c, tri.normal, tri.area);
        slopes.first * by_b + slopes.second * by_c
    }
}
