//! The paths of one pixel: camera rays, what they see, and which of their surfaces paths go on from.

use glam::DVec3;

use super::records::{Branch, CameraRay, Ray, Work};
use super::shading::sin_cos_of_turns;
use super::{Finders, Fused, Pixel};
use crate::transport::SurfaceSampling;
use crate::transport::sampler::{Numbers, RUN};
use crate::transport::tracer::SPLIT;
use crate::visibility::{HostRay, Surface};

/// What stays the same along a path.
pub(super) struct Path<'a> {
    pub numbers: Numbers<'a>,
    pub time: f64,
    /// Where its light is added.
    slot: usize,
    /// Random numbers for the first emitter.
    pub emitter: [f64; 2],
}

impl Path<'_> {
    /// Adds light that it brought back after some bounces.
    #[inline(always)]
    pub fn bring<const KEEP: bool>(&self, bounce: u32, light: DVec3, work: &mut Work) {
        if KEEP {
            work.light[self.slot + bounce as usize] += light;
        } else {
            work.brought += light;
        }
    }
}

impl Fused {
    /// The sum over a pixel's samples. With `KEEP` all that they met stays in `work`.
    #[inline(always)]
    pub(super) fn pixel<const KEEP: bool>(
        &self,
        finders: &Finders,
        pixel: u32,
        (from, to): (u32, u32),
        work: &mut Work,
    ) -> Pixel {
        let mut sum = Pixel::default();
        let mut first = from - from % RUN as u32;
        while first < to {
            let past = first + RUN as u32;
            let run = self.sampler.run(pixel, first..past, self.drawn);
            for sample in first.max(from)..past.min(to) {
                let slot = work.light.len();
                if KEEP {
                    work.light.resize(slot + work.bounces + 1, DVec3::ZERO);
                }
                work.brought = DVec3::ZERO;
                let seen = self.sample::<KEEP>(finders, run.numbers(sample), pixel, slot, work);
                sum.radiance += seen.radiance + work.brought;
                sum.opacity += seen.opacity;
                sum.depth += seen.depth;
                sum.normal += seen.normal;
                if !KEEP {
                    work.forget();
                }
            }
            first = past;
        }
        sum
    }

    /// One camera ray and its paths; returns what it sees of emitters and environment.
    #[inline(always)]
    fn sample<const KEEP: bool>(
        &self,
        finders: &Finders,
        numbers: Numbers,
        pixel: u32,
        slot: usize,
        work: &mut Work,
    ) -> Pixel {
        let mut camera = self.camera_ray(&numbers, pixel);
        let path = Path {
            time: camera.time,
            numbers,
            slot,
            emitter: camera.emitter,
        };
        let (origin, direction) = (camera.ray.origin, camera.ray.direction);
        camera.ray = self.weigh::<KEEP>(finders, &path, (origin, direction), None, work);
        work.census.bounces[0] += 1;
        let seen = self.seen(&camera.ray, work);
        let first = work.branches.len();
        if !self.scene.emitters.is_empty() || self.tables.host.sky.is_some() {
            let split = self.settings.sampling.surfaces == SurfaceSampling::Split;
            let random = || f64::from(path.numbers.surface(0));
            let mut entries = std::mem::take(&mut work.entries);
            entries.clear();
            if split {
                self.split(&camera.ray, random, work, &mut entries);
            } else {
                entries.push((self.draw(&camera.ray, random, work), 1.0));
            }
            for &(drawn, share) in &entries {
                let begin = work.vertices.len();
                let useful = drawn.is_some_and(|s| self.useful(work.surfaces[s].triangle));
                if useful {
                    self.walk::<KEEP>(finders, &path, &camera.ray, drawn, share, work);
                } else if split {
                    continue;
                }
                if KEEP {
                    work.branches.push(Branch {
                        drawn,
                        alone: !split,
                        share,
                        vertices: begin..work.vertices.len(),
                    });
                }
            }
            work.entries = entries;
        }
        if KEEP {
            camera.branches = first..work.branches.len();
            work.cameras.push(camera);
        }
        seen
    }

    /// Black surfaces end a path.
    #[inline(always)]
    pub(super) fn useful(&self, triangle: u32) -> bool {
        let material = self.scene.topology.material[triangle as usize];
        self.scene.materials.reflects[material as usize]
    }

    #[inline(always)]
    fn camera_ray(&self, numbers: &Numbers, pixel: u32) -> CameraRay {
        let c = &self.camera;
        let [width, height] = self.size;
        let [x, y, u, v] = numbers.film().map(f64::from);
        let x = (f64::from(pixel % width as u32) + x) / width as f64;
        let y = (f64::from(pixel / width as u32) + y) / height as f64;
        let film = [
            (2.0 * x - 1.0) * (width as f64 / height as f64),
            1.0 - 2.0 * y,
        ];
        let through = (c.right * film[0] + c.up * film[1]) * c.half_height + c.forward;
        let mut disk = [0.0; 2];
        let (origin, along) = match c.lens {
            Some([aperture, focus]) => {
                let [radius, angle] = numbers.lens().map(f64::from);
                let (sin, cos) = sin_cos_of_turns(angle);
                disk = [radius.sqrt() * cos, radius.sqrt() * sin];
                let on_lens = (c.right * disk[0] + c.up * disk[1]) * aperture;
                (c.eye + on_lens, through * focus - on_lens)
            }
            None => (c.eye, through),
        };
        let length = along.length();
        CameraRay {
            ray: Ray {
                origin,
                direction: along * length.recip(),
                surfaces: 0..0,
                background: 1.0,
                depth: 1.0,
            },
            time: if self.tables.host.moves {
                numbers.time().into()
            } else {
                0.0
            },
            film,
            disk,
            length,
            emitter: [u, v],
            branches: 0..0,
        }
    }

    /// A camera or bounce ray with its surfaces.
    #[inline(always)]
    pub(super) fn weigh<const KEEP: bool>(
        &self,
        finders: &Finders,
        path: &Path,
        (origin, direction): (DVec3, DVec3),
        departure: Option<u32>,
        work: &mut Work,
    ) -> Ray {
        let span = self.span(origin);
        let ray = HostRay {
            origin,
            direction,
            time: path.time,
            departure,
            emitter: None,
            distance: None,
        };
        let first = work.surfaces.len();
        let offered = work.log.meet(&finders.rays, &ray, span, &mut work.surfaces);
        let background = finders.rays.weigh(span, &mut work.surfaces, first);
        if !KEEP {
            let count = work.surfaces.len() - first;
            work.census.add_ray(u64::from(offered), count);
        }
        Ray {
            origin,
            direction,
            surfaces: first..work.surfaces.len(),
            background,
            depth: span.depth(),
        }
    }

    /// Emission on fronts and environment, weighted, and what else a camera ray sees.
    #[inline(always)]
    fn seen(&self, ray: &Ray, work: &mut Work) -> Pixel {
        let sky = self.tables.host.sky.as_ref();
        let sky = sky.map_or(DVec3::ZERO, |sky| sky.at(ray.direction));
        let mut seen = Pixel {
            radiance: sky * ray.background,
            opacity: 1.0 - ray.background,
            ..Pixel::default()
        };
        for s in &work.surfaces[ray.surfaces.clone()] {
            let side = s.side() * s.weight;
            seen.radiance += self.emission(s) * s.weight;
            seen.depth += s.weight * s.t;
            seen.normal += self.hierarchy.triangles[s.triangle as usize].normal * side;
        }
        if let Some(objects) = &mut work.objects {
            for s in &work.surfaces[ray.surfaces.clone()] {
                objects[self.scene.topology.object[s.triangle as usize] as usize] += s.weight;
            }
            if let Some(last) = objects.last_mut() {
                *last += ray.background;
            }
        }
        seen
    }

    /// What a surface sends back along a ray.
    #[inline(always)]
    pub(super) fn emission(&self, s: &Surface) -> DVec3 {
        let m = self.scene.topology.material[s.triangle as usize] as usize;
        if s.cosine < 0.0 && self.scene.materials.emits[m] {
            self.tables.host.emission[m]
        } else {
            DVec3::ZERO
        }
    }

    /// Surfaces with their weights in order of triangles, the background last.
    fn ordered(&self, ray: &Ray, work: &mut Work) -> f64 {
        let surfaces = ray.surfaces.clone();
        work.order.clear();
        for i in surfaces {
            let s = &work.surfaces[i];
            work.order.push((s.triangle, Some(i), s.weight));
        }
        work.order.sort_unstable_by_key(|s| s.0);
        let total = work.order.iter().map(|s| s.2).sum::<f64>() + ray.background;
        work.order.push((u32::MAX, None, ray.background));
        total
    }

    /// One surface, drawn with its weight.
    #[inline(always)]
    pub(super) fn draw(
        &self,
        ray: &Ray,
        random: impl Fn() -> f64,
        work: &mut Work,
    ) -> Option<usize> {
        if ray.surfaces.len() == 1 && ray.background <= 0.0 {
            return Some(ray.surfaces.start);
        }
        let threshold = self.ordered(ray, work) * random();
        let mut passed = 0.0;
        for &(_, surface, weight) in &work.order {
            passed += weight;
            if passed > threshold {
                return surface;
            }
        }
        None
    }

    /// Several surfaces, each with its weight over its probability.
    #[inline(always)]
    fn split(
        &self,
        ray: &Ray,
        random: impl Fn() -> f64,
        work: &mut Work,
        entries: &mut Vec<(Option<usize>, f64)>,
    ) {
        if ray.surfaces.len() == 1 && ray.background <= 0.0 {
            let first = ray.surfaces.start;
            entries.push((Some(first), work.surfaces[first].weight));
            return;
        }
        let least = 1.0 / SPLIT as f64;
        let total = self.ordered(ray, work);
        // The next number of the comb u, u + 1, … over cumulative weights in units of 1/draws.
        let (mut passed, mut next) = (0.0, total * random() * least);
        for &(_, surface, weight) in &work.order {
            passed += weight;
            if passed > next {
                entries.push((surface, weight.max(least)));
                while passed > next {
                    next += total * least;
                }
            }
        }
    }
}
