//! Paths, backward: derivatives by everything that they hit.

use super::view::Tracer;
use super::walk::{LightSample, Vertex, Work};
use super::walk::{Path, Seen, Walk};
use crate::accel::NOTHING;
use crate::model::camera::{CameraGradient, CameraRay};
use crate::model::connection::Target;
use crate::model::{V3, v2};
use crate::trace::{
    EMITS, NONE, PointGradient, RayGradient, Sums, add_to_camera, emission_backward, glows,
    leave_backward, light_backward, map_backward, middle_of, point_backward, sky_backward,
    target_of,
};

impl Tracer<'_> {
    /// Goes back along a path that was kept: adds the derivatives of the light that it brought, times
    /// `upstream`. `typical` is how much the loss depends on a camera ray's light on average.
    #[inline(always)]
    pub(super) fn walk_backward(
        &self,
        path: &Path,
        walk: &Walk,
        (upstream, typical): (&Seen, f32),
        work: &mut Work,
        sums: &Sums,
    ) {
        let (lists, of) = (&self.lists, &self.wanted.of);
        let camera = &walk.camera;
        let g = upstream.radiance;
        let interior = self.settings.interior;
        if walk.seen == NOTHING {
            if !interior {
                return;
            }
            if of.sky || (of.camera && self.features.sky_map) {
                let by_ray = RayGradient {
                    origin: V3::ZERO,
                    direction: sky_backward(lists, sums, camera.direction, g),
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
        let moves = |&v: &usize| lists.is_wanted(work.vertices[v].point.object);
        let still = if of.camera {
            0
        } else {
            vertices.iter().position(moves).unwrap_or(usize::MAX)
        };
        let turned = if of.turns { 1 } else { usize::MAX };
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
            by_ray = point_backward(lists, sums, &vertex.point, path.time, &by, by_t);
        }
        let more = upstream.depth != 0.0 || upstream.normal != V3::ZERO || by_emission != V3::ZERO;
        if interior && vertices.is_empty() && more {
            let by = PointGradient {
                geometric: upstream.normal,
                emission: by_emission,
                ..PointGradient::default()
            };
            let (time, by_t) = (path.time, upstream.depth);
            by_ray = point_backward(lists, sums, &walk.point, time, &by, by_t);
        }
        work.chain = vertices;
        self.camera_backward(path, camera, by_ray, sums);
    }

    #[inline(always)]
    fn camera_backward(&self, path: &Path, camera: &CameraRay, by: RayGradient, sums: &Sums) {
        if self.wanted.of.camera {
            let mut gradient = CameraGradient::default();
            let (pixel, _) = path.numbers.path();
            let pixel = middle_of(&self.lists, pixel);
            self.camera
                .ray_backward(camera, pixel, by.origin, by.direction, &mut gradient);
            add_to_camera(sums, &gradient);
        }
    }

    /// Adds the derivatives of g times the light that a camera ray sees of an emitter; where that is a texture, returns
    /// g, since there the point's place counts.
    #[inline(always)]
    fn seen_backward(&self, walk: &Walk, g: V3, sums: &Sums) -> V3 {
        let lists = &self.lists;
        let material = lists.material_of(walk.seen);
        let front = lists.triangle(walk.seen).normal.dot(walk.first.1) > 0.0;
        if !front || lists.bits_of(material) & EMITS == 0 {
            return V3::ZERO;
        }
        if glows(lists, material) {
            return g;
        }
        emission_backward(lists, sums, material, v2(0.0, 0.0), g);
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
        sums: &Sums,
    ) -> V3 {
        let point = &vertex.point;
        let mut by_throughput = V3::ZERO;
        if let Some(leave) = &vertex.leave {
            let escaped = leave.escaped && self.settings.interior;
            by_throughput = leave_backward(
                &self.lists,
                sums,
                point,
                &leave.scatter,
                &leave.bend,
                leave.survival,
                escaped,
                vertex.throughput,
                by_next,
                by_leaving,
                g,
                by,
            );
        }
        if !self.settings.interior {
            return by_throughput;
        }
        let lights = vertex.lights.clone();
        for light in &work.lights[lights.start as usize..lights.end as usize] {
            by_throughput += if light.emitter == NONE {
                self.map_backward(vertex, light, g, by, sums)
            } else {
                self.light_backward(vertex, path, light, g, by, sums)
            };
        }
        by_throughput
    }

    /// Back over light from an emitter or a delta light.
    #[inline(always)]
    fn light_backward(
        &self,
        vertex: &Vertex,
        path: &Path,
        light: &LightSample,
        g: V3,
        by: &mut PointGradient,
        sums: &Sums,
    ) -> V3 {
        let (lists, point) = (&self.lists, &vertex.point);
        let (k, weights) = (light.emitter, light.weights);
        let (carried, arrived, time) = (vertex.throughput, light.arrived, path.time);
        let target = target_of(lists, k, weights, point.position, time, false);
        light_backward(
            lists, sums, point, k, weights, target, arrived, carried, time, g, by,
        )
    }

    /// Back over light of a map along a direction.
    #[inline(never)]
    fn map_backward(
        &self,
        vertex: &Vertex,
        sample: &LightSample,
        g: V3,
        by: &mut PointGradient,
        sums: &Sums,
    ) -> V3 {
        let (lists, point) = (&self.lists, &vertex.point);
        let target = Target::of_map(sample.direction);
        let (arrived, throughput) = (sample.arrived, vertex.throughput);
        map_backward(lists, sums, point, target, arrived, throughput, g, by)
    }
}
