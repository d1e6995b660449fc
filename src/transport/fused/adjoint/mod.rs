//! Back along the paths of a pixel: derivatives by everything that they met.

mod hit;

use glam::DVec3;

use super::records::{Branch, CameraRay, Ray, Work};
use super::sums::Sums;
use super::{Fused, Gradient, Pixel};
use crate::visibility::{PullScratch, Surface, Weighed};

/// Derivatives by the origin and direction of a ray.
#[derive(Clone, Copy, Debug, Default)]
struct ByRay {
    origin: DVec3,
    direction: DVec3,
}

impl Fused {
    /// Adds derivatives of what the pixel in `work` brings back, times what comes from above.
    #[inline(always)]
    pub(super) fn pull_pixel(&self, above: &Pixel, work: &mut Work, sums: &mut Sums) {
        let upstream = above.radiance;
        let stride = work.bounces + 1;
        // Light of all later bounces too, along `upstream`.
        let samples = work.cameras.len();
        let mut later: Vec<f64> = work.light.iter().map(|l| l.dot(upstream)).collect();
        for slot in later.chunks_exact_mut(stride) {
            for bounce in (0..slot.len() - 1).rev() {
                slot[bounce] += slot[bounce + 1];
            }
        }
        // The mean of what the other samples brought back: a leave-one-out baseline of the
        // score-function estimator, which a draw does not change (`transport/path.rs`).
        let total: Vec<f64> = (0..stride)
            .map(|b| later.iter().skip(b).step_by(stride).sum())
            .collect();
        let others = |sample: usize, bounce: usize| {
            if samples < 2 {
                return 0.0;
            }
            (total[bounce] - later[sample * stride + bounce]) / (samples - 1) as f64
        };
        let mut scratch = std::mem::take(&mut work.scratch);
        let mut values = std::mem::take(&mut work.values);
        for (sample, camera) in work.cameras.iter().enumerate() {
            let mut by_ray = ByRay::default();
            let surfaces = &work.surfaces[camera.ray.surfaces.clone()];
            values.clear();
            for s in surfaces {
                let normal = self.hierarchy.triangles[s.triangle as usize].normal;
                let side = s.side();
                values.push(
                    self.emission(s).dot(upstream)
                        + above.depth * s.t
                        + above.normal.dot(normal) * side,
                );
                self.pull_emission(s, upstream * s.weight, sums);
            }
            let mut background = 0.0;
            if let Some(sky) = &self.tables.host.sky {
                let direction = camera.ray.direction;
                background = sky.at(direction).dot(upstream);
                let g = upstream * camera.ray.background;
                by_ray.direction += sky.pull(direction, g, &mut sums.sky);
            }
            background -= above.opacity;
            for branch in &work.branches[camera.branches.clone()] {
                let baseline = |bounce: usize| branch.share * others(sample, bounce);
                let back = Back {
                    work,
                    upstream,
                    camera,
                };
                let (by_throughput, by) =
                    self.pull_branch(&back, branch, &baseline, &mut scratch, sums);
                by_ray.origin += by.origin;
                by_ray.direction += by.direction;
                let mut score = by_throughput;
                if branch.alone {
                    score -= others(sample, 0);
                }
                match branch.drawn {
                    Some(i) => {
                        let s = &work.surfaces[i];
                        if s.weight > 0.0 {
                            values[i - camera.ray.surfaces.start] += score / s.weight;
                        }
                    }
                    None if camera.ray.background > 0.0 => {
                        background += score / camera.ray.background;
                    }
                    None => {}
                }
            }
            if self.rays {
                let by = self.pull_weights(
                    &camera.ray,
                    surfaces,
                    camera.time,
                    (&values, background),
                    &mut scratch,
                    sums,
                );
                by_ray.origin += by.origin;
                by_ray.direction += by.direction;
                let shapes = above.depth != 0.0 || above.normal != DVec3::ZERO;
                for s in surfaces.iter().filter(|_| shapes) {
                    sums.normal[s.triangle as usize] += above.normal * (s.side() * s.weight);
                    let along = (camera.ray.direction, camera.time);
                    let by_t = (0.0, above.depth * s.weight, 0.0);
                    self.pull_surface(s, along, by_t, &mut by_ray, sums);
                }
                if self.camera.tracked {
                    self.pull_camera(camera, by_ray, sums);
                }
            }
        }
        work.scratch = scratch;
        work.values = values;
    }

    #[inline(always)]
    fn pull_emission(&self, s: &Surface, g: DVec3, sums: &mut Sums) {
        let m = self.scene.topology.material[s.triangle as usize] as usize;
        if s.cosine < 0.0 && self.scene.materials.emits[m] {
            sums.emission[m] += g;
        }
    }

    /// Goes back along one path. Returns the derivative by the logarithm of its share, and those by
    /// the camera ray.
    #[inline(always)]
    fn pull_branch(
        &self,
        back: &Back,
        branch: &Branch,
        baseline: &impl Fn(usize) -> f64,
        scratch: &mut PullScratch,
        sums: &mut Sums,
    ) -> (f64, ByRay) {
        let work = back.work;
        let mut by_ray = ByRay::default();
        let mut by_throughput = DVec3::ZERO;
        let vertices = &work.vertices[branch.vertices.clone()];
        let mut by_share = 0.0;
        let mut values = std::mem::take(&mut scratch.values);
        for (bounce, vertex) in vertices.iter().enumerate().rev() {
            let ray = vertex.ray.as_ref().unwrap_or(&back.camera.ray);
            (by_throughput, by_ray) = match &vertex.hit {
                Some(hit) => {
                    self.pull_hit(back, vertex, hit, ray, by_throughput, by_ray, scratch, sums)
                }
                None => {
                    let (mut by, mut by_ray) = (DVec3::ZERO, ByRay::default());
                    if let (Some(sky), None) = (self.missed(), vertex.drawn) {
                        let g = back.upstream * vertex.throughput;
                        by_ray.direction = sky.pull(ray.direction, g, &mut sums.sky);
                        by = back.upstream * sky.at(ray.direction);
                    }
                    (by, by_ray)
                }
            };
            by_share = by_throughput.dot(vertex.throughput);
            let Some(ray) = &vertex.ray else {
                continue;
            };
            if !self.rays || ray.is_whole() {
                continue;
            }
            // The drawn weight's logarithm, less what the others' mean takes off.
            let score = by_share - baseline(bounce);
            let surfaces = &work.surfaces[ray.surfaces.clone()];
            values.clear();
            values.resize(surfaces.len(), 0.0);
            let mut background = 0.0;
            match vertex.drawn {
                Some(i) => {
                    let k = i - ray.surfaces.start;
                    if surfaces[k].weight > 0.0 {
                        values[k] = score / surfaces[k].weight;
                    }
                }
                None if ray.background > 0.0 => background = score / ray.background,
                None => {}
            }
            let by = self.pull_weights(
                ray,
                surfaces,
                back.camera.time,
                (&values, background),
                scratch,
                sums,
            );
            by_ray.origin += by.origin;
            by_ray.direction += by.direction;
        }
        scratch.values = values;
        (by_share, by_ray)
    }

    /// Derivatives of Σ v·W + v·W_background.
    #[inline(always)]
    fn pull_weights(
        &self,
        ray: &Ray,
        surfaces: &[Surface],
        time: f64,
        (values, background): (&[f64], f64),
        scratch: &mut PullScratch,
        sums: &mut Sums,
    ) -> ByRay {
        let mut by_ray = ByRay::default();
        if ray.is_whole() {
            return by_ray;
        }
        let first = values.first().copied().unwrap_or(0.0);
        let all_alike = first == background && values.iter().all(|&v| v == first);
        if surfaces.is_empty() || all_alike {
            return by_ray;
        }
        let finder_full = self.full();
        let weighed = Weighed {
            form: self.settings.visibility,
            surfaces,
            background: ray.background,
            depth: ray.depth,
            inside: 2.0 * ray.origin.length() <= ray.depth,
            full: finder_full,
            cutoff: self.cutoff,
        };
        let by_far = weighed.pull(values, background, scratch, |s, a, b, least| {
            self.pull_surface(s, (ray.direction, time), (a, b, least), &mut by_ray, sums);
        });
        if by_far != 0.0 {
            let least = 1e-6 * self.scene.radius();
            by_ray.origin += ray.origin * (by_far / ray.origin.length().max(least));
        }
        by_ray
    }

    fn full(&self) -> f64 {
        crate::visibility::full_room(self.scene.context.epsilon(), self.settings.sigma)
    }

    /// Adds a·dlogit + b·dt of a surface.
    #[inline(always)]
    fn pull_surface(
        &self,
        s: &Surface,
        (direction, time): (DVec3, f64),
        (a, b, least): (f64, f64, f64),
        by_ray: &mut ByRay,
        sums: &mut Sums,
    ) {
        let k = s.triangle as usize;
        let triangle = &self.hierarchy.triangles[k];
        let Some([f, m]) = s.pull(triangle, direction, a, b, least) else {
            return;
        };
        let from_ray = f - m;
        by_ray.origin += from_ray;
        by_ray.direction += from_ray * s.t;
        for (c, sum) in sums.corners[k].iter_mut().enumerate() {
            *sum += m * s.hit[c] - f * s.border[c];
        }
        if self.tables.host.moves {
            sums.velocity[k] -= from_ray * time;
        }
    }

    #[inline(always)]
    fn pull_camera(&self, camera: &CameraRay, by: ByRay, sums: &mut Sums) {
        let c = &self.camera;
        let s = &mut sums.camera;
        let direction = camera.ray.direction;
        let by_along = (by.direction - direction * direction.dot(by.direction)) / camera.length;
        s.eye += by.origin;
        let mut by_through = by_along;
        if let Some([aperture, focus]) = c.lens {
            let by_lens = by.origin - by_along;
            let [x, y] = camera.disk;
            s.right += by_lens * (x * aperture);
            s.up += by_lens * (y * aperture);
            s.lens[0] += by_lens.dot(c.right * x + c.up * y);
            let [x, y] = camera.film;
            let through = (c.right * x + c.up * y) * c.half_height + c.forward;
            s.lens[1] += by_along.dot(through);
            by_through = by_along * focus;
        }
        let [x, y] = camera.film;
        s.right += by_through * (x * c.half_height);
        s.up += by_through * (y * c.half_height);
        s.forward += by_through;
        s.half_height += by_through.dot(c.right * x + c.up * y);
    }

    /// The derivatives by what is in a graph: those by normals and areas go to the corners.
    pub(crate) fn resolve(&self, mut sums: Sums) -> Gradient {
        for (k, t) in self.hierarchy.triangles.iter().enumerate() {
            if !t.valid || sums.corners.is_empty() {
                continue;
            }
            let [a, b, c] = t.corners;
            let (ab, ac) = (b - a, c - a);
            let doubled = 2.0 * t.area();
            let by_normal = sums.normal[k];
            let across = by_normal - t.normal * t.normal.dot(by_normal);
            let by_cross = across / doubled + t.normal * (0.5 * sums.area[k]);
            let (by_ab, by_ac) = (ac.cross(by_cross), by_cross.cross(ab));
            let corners = &mut sums.corners[k];
            corners[0] -= by_ab + by_ac;
            corners[1] += by_ab;
            corners[2] += by_ac;
        }
        Gradient {
            scene: self.tables.flatten(&sums),
            camera: self.camera.flatten(&sums.camera),
        }
    }
}

/// What stays the same on the way back along a path.
struct Back<'a> {
    work: &'a Work,
    upstream: DVec3,
    camera: &'a CameraRay,
}
