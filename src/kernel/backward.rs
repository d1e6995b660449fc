//! Paths, backward: derivatives by everything that they hit.

use glam::DVec3;

use super::gradient::Sums;
use super::surface::{PointGradient, RayGradient};
use super::view::View;
use super::walk::{LightSample, SkySample, Vertex, Work};
use super::walk::{Path, Seen, Walk};
use crate::accel::NOTHING;
use crate::model::V3;
use crate::model::camera::{CameraGradient, CameraRay};
use crate::model::cone::bend_backward;
use crate::model::connection::Target;

impl View {
    /// Goes back along a path that was kept: adds the derivatives of the light that it brought, times
    /// `upstream`. `typical` is how much the loss depends on a camera ray's light on average.
    #[inline(always)]
    pub(super) fn walk_backward(
        &self,
        path: &Path,
        walk: &Walk,
        (upstream, typical): (&Seen, f32),
        work: &mut Work,
        sums: &mut Sums,
    ) {
        let scene = &*self.scene;
        let camera = &walk.camera;
        let g = upstream.radiance;
        let interior = self.settings.interior;
        if walk.seen == NOTHING {
            if !interior {
                return;
            }
            if self.wanted.sky || (self.wanted.camera && scene.sky.map().is_some()) {
                let by_ray = RayGradient {
                    origin: V3::ZERO,
                    direction: scene.sky.backward(camera.direction, g, &mut sums.sky),
                };
                self.camera_backward(path, camera, by_ray, sums);
            }
            return;
        }
        let by_emission = if interior {
            self.seen_backward(walk, g, sums)
        } else {
            V3::ZERO
        };
        let (mut by_throughput, mut by_ray) = (V3::ZERO, RayGradient::default());
        let mut vertices = std::mem::take(&mut work.chain);
        vertices.clear();
        let mut next = walk.vertex;
        while next != usize::MAX {
            vertices.push(next);
            next = work.vertices[next].previous;
        }
        vertices.reverse();
        // The first point of the path that moves.
        let moves = |&v: &usize| {
            let triangle = work.vertices[v].point.triangle;
            self.wanted.objects[scene.triangles[triangle as usize].object as usize]
        };
        let still = if self.wanted.camera {
            0
        } else {
            vertices.iter().position(moves).unwrap_or(usize::MAX)
        };
        let turned = if self.wanted.turns() { 1 } else { usize::MAX };
        for (i, &v) in vertices.iter().enumerate().rev() {
            let vertex = work.vertices[v].clone();
            let mut by = PointGradient::default();
            by_throughput =
                self.vertex_backward(&vertex, path, g, by_throughput, by_ray, work, &mut by, sums);
            if self.has_edges {
                let moves = i >= still.min(turned);
                let g = (g, typical);
                self.edges_backward(path, &vertex, i as u32, moves, g, work, &mut by, sums);
            }
            let mut by_t = 0.0;
            if i == 0 && interior {
                by_t = upstream.depth;
                by.geometric += upstream.normal;
                by.emission = by_emission;
            }
            by_ray = self.point_backward(&vertex.point, path.time, &by, by_t, sums);
        }
        let more = upstream.depth != 0.0 || upstream.normal != V3::ZERO || by_emission != V3::ZERO;
        if interior && vertices.is_empty() && more {
            let by = PointGradient {
                geometric: upstream.normal,
                emission: by_emission,
                ..PointGradient::default()
            };
            let (time, by_t) = (path.time, upstream.depth);
            by_ray = self.point_backward(&walk.point, time, &by, by_t, sums);
        }
        work.chain = vertices;
        self.camera_backward(path, camera, by_ray, sums);
    }

    #[inline(always)]
    fn camera_backward(&self, path: &Path, camera: &CameraRay, by: RayGradient, sums: &mut Sums) {
        if self.wanted.camera {
            let mut gradient = CameraGradient::default();
            let (pixel, _) = path.numbers.path();
            let pixel = self.middle_of(pixel);
            self.camera
                .ray_backward(camera, pixel, by.origin, by.direction, &mut gradient);
            sums.camera += gradient.into();
        }
    }

    /// Adds the derivatives of g times the light that a camera ray sees of an emitter; where that is a texture, returns
    /// g, since there the point's place counts.
    #[inline(always)]
    fn seen_backward(&self, walk: &Walk, g: V3, sums: &mut Sums) -> V3 {
        let k = walk.seen as usize;
        let material = self.scene.material(walk.seen);
        if !material.kind.emits {
            return V3::ZERO;
        }
        if material.glows() {
            return g;
        }
        let cosine = self.scene.triangles[k].normal.dot(walk.first.1);
        self.emission_backward(k, [0.0; 2], cosine, g, sums);
        V3::ZERO
    }

    /// Back over a surface point: from derivatives by the throughput after it and the ray that leaves it
    /// to those by the throughput before it and by the point.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)] // one place, called once
    fn vertex_backward(
        &self,
        vertex: &Vertex,
        path: &Path,
        g: V3,
        by_next: V3,
        by_leaving: RayGradient,
        work: &Work,
        by: &mut PointGradient,
        sums: &mut Sums,
    ) -> V3 {
        let point = &vertex.point;
        let mut by_throughput = V3::ZERO;
        if let Some(leave) = &vertex.leave {
            let scatter = &leave.scatter;
            by.position += by_leaving.origin;
            let mut by_direction = by_leaving.direction;
            let mut by_after = by_next;
            if leave.escaped && self.settings.interior {
                let after = vertex.throughput * scatter.weight * (1.0 / leave.survival);
                by_after += g * self.scene.sky.at(leave.bend.direction);
                by_direction +=
                    self.scene
                        .sky
                        .backward(leave.bend.direction, g * after, &mut sums.sky);
            }
            let by_after = by_after * (1.0 / leave.survival);
            by_throughput += by_after * scatter.weight;
            let by_axis = bend_backward(
                &leave.bend,
                scatter.direction,
                point.shading.geometric,
                by_direction,
                &mut by.geometric,
            );
            let by_weight = by_after * vertex.throughput;
            point
                .shading
                .sample_backward(scatter, by_weight, by_axis, &mut by.shading);
        }
        if !self.settings.interior {
            return by_throughput;
        }
        let (lights, deltas) = (vertex.lights.clone(), vertex.deltas.clone());
        let skies = vertex.skies.clone();
        for light in &work.lights[lights.start as usize..lights.end as usize] {
            by_throughput += self.light_backward(vertex, path, light, g, by, sums);
        }
        for delta in &work.deltas[deltas.start as usize..deltas.end as usize] {
            by_throughput += self.delta_backward(vertex, delta, g, by, sums);
        }
        for sky in &work.skies[skies.start as usize..skies.end as usize] {
            by_throughput += self.sky_backward(vertex, sky, g, by, sums);
        }
        by_throughput
    }

    /// Back over light from a point of an emitter, which stays where it is on it.
    #[inline(always)]
    fn light_backward(
        &self,
        vertex: &Vertex,
        path: &Path,
        light: &LightSample,
        g: V3,
        by: &mut PointGradient,
        sums: &mut Sums,
    ) -> V3 {
        let (k, seen) = (light.triangle as usize, &light.seen);
        let tri = &self.scene.triangles[k];
        let uv = self.scene.uv_at(k, light.weights);
        let material = self.scene.material(light.triangle);
        let emission = material.emission(&self.scene.texels, uv);
        let normal = tri.normal;
        let target = Target {
            radiance: emission.towards(seen.facing),
            ..Target::of_emitter(seen, V3::ZERO, normal, tri.area)
        };
        let by_target = target.backward(
            &vertex.point.shading,
            light.reflected,
            light.density,
            g,
            vertex.throughput,
            &mut by.shading,
        );
        if self.wanted.emission || (self.wanted.uvs && material.glows()) {
            let by_uv = self.emission_backward(k, uv, seen.facing, by_target.radiance, sums);
            if material.glows() {
                self.add_to_uvs(k, light.weights, by_uv, sums);
            }
        }
        if !self.wanted.rays {
            return by_target.throughput;
        }
        let found = seen.backward(normal, tri.area, by_target.angle, by_target.direction);
        if self.wanted.objects[tri.object as usize] {
            let to = &mut sums.triangles[k];
            to.area += f64::from(found.area);
            to.normal += DVec3::from(found.normal);
            self.add_to_corners(k, light.weights, found.position, path.time, sums);
        }
        by.position -= found.position;
        by_target.throughput
    }

    /// Back over light of a map along a direction, which is fixed.
    #[inline(never)]
    fn sky_backward(
        &self,
        vertex: &Vertex,
        sample: &SkySample,
        g: V3,
        by: &mut PointGradient,
        sums: &mut Sums,
    ) -> V3 {
        let target = Target {
            radiance: self.scene.sky.at(sample.direction),
            ..Target::of_map(sample.direction)
        };
        let found = target.backward(
            &vertex.point.shading,
            sample.reflected,
            sample.density,
            g,
            vertex.throughput,
            &mut by.shading,
        );
        if self.wanted.sky {
            let sky = &self.scene.sky;
            sky.backward(sample.direction, found.radiance, &mut sums.sky);
        }
        found.throughput
    }
}
