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
use crate::model::triangle::{barycentric, hit_backward};
use crate::sampling::Receiver;
use crate::scene::{CHANNELS, Channel};

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
        let mut smooth = self.has_normals(k);
        let mut normal = geometric;
        if smooth {
            normal = self.normal_at(k, weights, geometric);
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
        if let Some(colour) = self.colour_at(k, weights) {
            let base = Channel::Diffuse.place();
            values[base] = values[base] * colour;
        }
        if self.tilted
            && let Some(map) = &m.normal_map
            && let Some(tilt) = self.tilt_at(map, k, (weights, uv), normal * side)
        {
            normal = tilt.tilted() * side;
            smooth = true;
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
        let mut channels = shade.channels();
        let mut by_colour = V3::ZERO;
        if let Some(colour) = self.scene.colour_at(k, p.weights) {
            let base = Channel::Diffuse.place();
            let albedo = m.channels[base].at(&self.scene.texels, p.uv);
            by_colour = channels[base] * albedo;
            channels[base] = channels[base] * colour;
            self.colours_backward(p, by_colour, sums);
        }
        if self.wanted.materials || (self.wanted.rays && self.scene.textured) {
            let to = &mut sums.materials[index];
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
        let (by_place, flat) = self.corners_backward(p, (by_uv, by_colour), shade.normal, sums);
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
}
