//! Back over a surface point and the light that arrives there.

use glam::DVec3;

use super::{Back, ByRay};
use crate::transport::fused::Fused;
use crate::transport::fused::records::{Gathered, Hit, Lit, Ray, Vertex};
use crate::transport::fused::shading::ShadeSums;
use crate::transport::fused::sums::Sums;
use crate::transport::fused::surface::Place;
use crate::visibility::PullScratch;

impl Fused {
    /// Back over a surface point: from derivatives by the throughput after it and the ray that leaves
    /// it to those by the throughput before it and the ray that comes.
    #[allow(clippy::too_many_arguments)] // one place; all of it is what a vertex has
    #[inline(always)]
    pub(super) fn pull_hit(
        &self,
        back: &Back,
        vertex: &Vertex,
        hit: &Hit,
        ray: &Ray,
        by_next: DVec3,
        by_leaving: ByRay,
        scratch: &mut PullScratch,
        sums: &mut Sums,
    ) -> (DVec3, ByRay) {
        let work = back.work;
        let mut shade = ShadeSums::default();
        let mut by_throughput = DVec3::ZERO;
        let mut by_position = by_leaving.origin;
        let mut by_incoming = DVec3::ZERO;
        if let Some(next) = &vertex.next {
            let scatter = &next.scatter;
            let mut by_direction = by_leaving.direction;
            let mut by_next = by_next / next.survival;
            if let (Some(end), Some(sky)) = (&next.end, self.missed()) {
                let light = back.upstream * sky.at(end.direction);
                let throughput = vertex.throughput * scatter.weight;
                by_next += light * end.background;
                let g = back.upstream * throughput * end.background;
                by_direction += sky.pull(end.direction, g, &mut sums.sky);
                if self.rays {
                    let surfaces = &work.surfaces[end.surfaces.clone()];
                    let zeros = vec![0.0; surfaces.len()];
                    let by = self.pull_weights(
                        end,
                        surfaces,
                        back.camera.time,
                        (&zeros, light.dot(throughput)),
                        scratch,
                        sums,
                    );
                    by_position += by.origin;
                    by_direction += by.direction;
                }
            }
            by_throughput += by_next * scatter.weight;
            let epsilon = self.scene.context.epsilon();
            let by_weight = by_next * vertex.throughput;
            hit.shade
                .pull_sample(scatter, by_weight, by_direction, epsilon, &mut shade);
        }
        for lit in &work.lit[vertex.lit.clone()] {
            let (by, by_x) = self.pull_lit(back, vertex, hit, lit, &mut shade, sums);
            by_throughput += by;
            by_position += by_x;
        }
        for gathered in &work.gathered[vertex.gathered.clone()] {
            let (by, by_x) =
                self.pull_gathered(back, vertex, hit, gathered, scratch, (&mut shade, sums));
            by_throughput += by;
            by_position += by_x;
        }
        let m = hit.material as usize;
        let host = &self.tables.host;
        let into = (&mut sums.diffuse[..], &mut sums.diffuse_texels[..]);
        let mut by_uv = host.diffuse.pull(m, hit.uv, shade.diffuse, into);
        if let (Some((albedos, _)), Some(_)) = (&host.specular, hit.shade.specular) {
            let into = (&mut sums.specular[..], &mut sums.specular_texels[..]);
            by_uv += albedos.pull(m, hit.uv, shade.specular, into);
            sums.exponent[m] += shade.exponent;
        }
        by_incoming += shade.incoming;
        let s = &work.surfaces[hit.surface];
        let k = s.triangle as usize;
        let triangle = &self.hierarchy.triangles[k];
        let by_normal = if hit.smooth {
            shade.normal
        } else {
            DVec3::ZERO
        };
        let by_place = if host.uvs.is_some() || host.normals.is_some() {
            let place = Place::of(s, hit.shade.geometric);
            place.pull(host, triangle, by_uv, by_normal, sums)
        } else {
            DVec3::ZERO
        };
        by_position += by_place;
        if !self.rays {
            return (by_throughput, ByRay::default());
        }
        if !hit.smooth {
            sums.normal[k] += shade.normal * s.side();
        }
        // x = o + t·d with n·d dt = n·(Σ w_i dv_i − do − t dd).
        // Barycentric coordinates see the point from the corners, which are where the triangle is.
        let m = triangle.normal * (by_position.dot(ray.direction) / s.cosine);
        for (c, sum) in sums.corners[k].iter_mut().enumerate() {
            *sum += (m - by_place) * s.hit[c];
        }
        if self.tables.host.moves {
            sums.velocity[k] += (m - by_place) * back.camera.time;
        }
        let by_ray = by_position - m;
        let by_ray = ByRay {
            origin: by_ray,
            direction: by_ray * s.t + by_incoming,
        };
        (by_throughput, by_ray)
    }

    /// Back over light from a point of an emitter: derivatives by throughput and surface point.
    #[inline(always)]
    fn pull_lit(
        &self,
        back: &Back,
        vertex: &Vertex,
        hit: &Hit,
        lit: &Lit,
        shade: &mut ShadeSums,
        sums: &mut Sums,
    ) -> (DVec3, DVec3) {
        let (way, reflected) = (&lit.way, lit.reflected);
        let e = lit.emitter as usize;
        let material = self.scene.topology.material[e] as usize;
        let emission = self.tables.host.emission[material];
        let per_area = way.facing / way.squared * way.area;
        let scale = per_area * lit.passed / lit.density;
        let g = back.upstream;
        let by_throughput = g * reflected * emission * scale;
        sums.emission[material] += g * vertex.throughput * reflected * scale;
        let by_reflected = g * vertex.throughput * emission * scale;
        let mut by_direction = hit.shade.pull_scattered(way.direction, by_reflected, shade);
        if !self.rays {
            return (by_throughput, DVec3::ZERO);
        }
        let by_scale = (g * vertex.throughput).dot(reflected * emission);
        // What is in between.
        let by_passed = by_scale * per_area / lit.density;
        let mut by_shadow = ByRay::default();
        let (shadows, by_p) = (&back.work.shadows, &back.work.by_p);
        let range = lit.shadows.clone();
        for (s, g) in shadows[range.clone()].iter().zip(&by_p[range]) {
            let slope = by_passed * g;
            let along = (way.direction, back.camera.time);
            let terms = (slope * s.slope, slope * s.slope_t, self.cutoff);
            self.pull_surface(s, along, terms, &mut by_shadow, sums);
        }
        by_direction += by_shadow.direction;
        // facing·area/r²
        let by_per_area = by_scale * lit.passed / lit.density;
        let normal = self.hierarchy.triangles[e].normal;
        let by_facing = by_per_area * way.area / way.squared;
        sums.area[e] += by_per_area * way.facing / way.squared;
        sums.normal[e] -= way.direction * by_facing;
        by_direction -= normal * by_facing;
        let mut by_to = by_direction;
        if !way.held {
            // The length that the direction was divided by, and r².
            by_to -= way.direction * way.direction.dot(by_direction);
            by_to -= way.direction * (2.0 * by_per_area * way.facing * way.area / way.squared);
        }
        by_to /= way.distance;
        for (c, sum) in sums.corners[e].iter_mut().enumerate() {
            *sum += by_to * lit.corners[c];
        }
        if self.tables.host.moves {
            sums.velocity[e] += by_to * back.camera.time;
        }
        (by_throughput, by_shadow.origin - by_to)
    }

    /// Back over light of a map along a direction, which is fixed: derivatives by throughput and surface
    /// point.
    #[inline(never)]
    fn pull_gathered(
        &self,
        back: &Back,
        vertex: &Vertex,
        hit: &Hit,
        gathered: &Gathered,
        scratch: &mut PullScratch,
        (shade, sums): (&mut ShadeSums, &mut Sums),
    ) -> (DVec3, DVec3) {
        let Some(map) = self.gathered() else {
            return (DVec3::ZERO, DVec3::ZERO);
        };
        let ray = &gathered.ray;
        let reflected = hit.shade.scattered(ray.direction);
        let radiance = map.at(ray.direction);
        let scale = ray.background / gathered.density;
        let g = back.upstream;
        let by_throughput = g * reflected * radiance * scale;
        map.pull(
            ray.direction,
            g * vertex.throughput * reflected * scale,
            &mut sums.sky,
        );
        let by_reflected = g * vertex.throughput * radiance * scale;
        hit.shade.pull_scattered(ray.direction, by_reflected, shade);
        if !self.rays {
            return (by_throughput, DVec3::ZERO);
        }
        let by_background = (g * vertex.throughput).dot(reflected * radiance) / gathered.density;
        let surfaces = &back.work.surfaces[ray.surfaces.clone()];
        let zeros = vec![0.0; surfaces.len()];
        let values = (&zeros[..], by_background);
        let by = self.pull_weights(ray, surfaces, back.camera.time, values, scratch, sums);
        (by_throughput, by.origin)
    }
}
