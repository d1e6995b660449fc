//! Paths, forward: from camera rays to the light that they bring back.

use std::ops::Range;

use super::direct::Shaded;
use super::view::Tracer;
use super::walk::{Leave, Vertex, Work};
use super::walk::{Path, Walk, Walks};
use crate::accel::{Hit, HitRay, NOTHING};
use crate::model::V3;
use crate::model::camera::CameraRay;
use crate::model::connection::ConeKernel;
use crate::sampling::{Dimensions, Four, Numbers};
use crate::trace::{Point, emitted, leave, middle_of, point_at, sky};

impl Tracer<'_> {
    /// The camera ray of a path.
    #[inline(always)]
    fn camera_ray(&self, numbers: &Numbers, pixel: u32) -> CameraRay {
        let drawn = numbers.draw(Dimensions::film());
        let middle = middle_of(&self.lists, pixel);
        let (x, y) = (self.filter.sample(drawn.x), self.filter.sample(drawn.y));
        let lens = self.lens_point(numbers);
        self.camera.ray(middle.x + x, middle.y + y, lens.x, lens.y)
    }

    /// Traces paths from their camera rays to their ends. With `KEEP` their records stay in `work`.
    #[inline(always)]
    pub(super) fn camera_walks<const KEEP: bool>(
        &self,
        paths: &[Path],
        walks: &mut Walks,
        work: &mut Work,
    ) {
        walks.clear();
        work.rays.clear();
        for path in paths {
            let (pixel, _) = path.numbers.path();
            let camera = self.camera_ray(&path.numbers, pixel);
            work.rays.push(HitRay::new(
                camera.origin,
                camera.direction,
                path.time,
                f32::INFINITY,
            ));
            walks.list.push(Walk {
                camera,
                ..Walk::new()
            });
        }
        self.find_hits::<false>(work);
        work.counts.rays += walks.list.len() as u64;
        let found = walks.list.iter_mut().zip(paths).zip(&work.hits);
        for ((walk, path), &hit) in found {
            work.counts.add_bounce(0);
            walk.seen = hit.triangle;
            let camera = &walk.camera;
            if hit.triangle == NOTHING {
                walk.radiance = sky(&self.lists, camera.direction);
                continue;
            }
            let (o, d) = (camera.origin, camera.direction);
            walk.begin_at(self.point(hit, o, d, path.time));
            walk.radiance = emitted(&self.lists, &walk.point);
        }
        self.reflected::<KEEP>(paths, walks, 0, work);
    }

    /// The hits of all rays.
    #[inline(always)]
    fn find_hits<const ANY: bool>(&self, work: &mut Work) {
        let (scene, hits) = (&self.scene, &mut work.hits);
        let holes = scene.holes.as_deref();
        scene
            .hierarchy
            .hits::<ANY>(self.arch, holes, &work.rays, hits);
    }

    /// The point that a ray hit, which came with a time in the shutter.
    #[inline(always)]
    pub(super) fn point(&self, hit: Hit, origin: V3, direction: V3, time: f32) -> Point {
        let (near, t) = (origin + direction * hit.t, hit.t);
        point_at(&self.lists, hit.triangle, near, t, direction, time)
    }

    /// Adds the light that surface points reflect towards the points that see them, after some bounces,
    /// times their throughputs. With `KEEP` the records of the paths stay in `work`.
    #[inline(always)]
    pub(super) fn reflected<const KEEP: bool>(
        &self,
        paths: &[Path],
        walks: &mut Walks,
        bounce: u32,
        work: &mut Work,
    ) {
        if self.features.dark {
            return;
        }
        let mut bounce = bounce;
        for (walk, path) in walks.list.iter_mut().zip(paths) {
            let drawn = path.numbers.draw(Dimensions::emitter(bounce));
            walk.emitter = [drawn.z, drawn.w];
        }
        walks.alive.clear();
        for i in 0..walks.list.len() as u32 {
            if walks.list[i as usize].on_surface {
                walks.alive.push(i);
            }
        }
        while !walks.alive.is_empty() {
            let last = bounce >= self.settings.bounces;
            let goes_on = !last || self.features.sees_sky;
            self.gather_lights::<KEEP>(paths, walks, bounce, goes_on, work);
            if !goes_on {
                return;
            }
            self.leave_surfaces::<KEEP>(paths, walks, bounce, last, work);
            if last {
                self.see_environment::<KEEP>(walks, work);
                return;
            }
            bounce += 1;
            self.arrive_at_surfaces::<KEEP>(paths, walks, bounce, work);
        }
    }

    /// Adds the light of lights that paths are connected to where they are; those at surfaces that reflect
    /// nothing end.
    #[inline(always)]
    fn gather_lights<const KEEP: bool>(
        &self,
        paths: &[Path],
        walks: &mut Walks,
        bounce: u32,
        goes_on: bool,
        work: &mut Work,
    ) {
        work.rays.clear();
        work.candidates.clear();
        let list = &mut walks.list;
        // Loops with a count of those that stay: what closures do is not compiled for the machine.
        let mut count = 0;
        for k in 0..walks.alive.len() {
            let i = walks.alive[k];
            let walk = &mut list[i as usize];
            if walk.point.reflects {
                walks.alive[count] = i;
                count += 1;
                let path = &paths[i as usize];
                self.propose_lights::<KEEP>(path, walk, i, bounce, goes_on, work);
            }
        }
        walks.alive.truncate(count);
        self.find_hits::<true>(work);
        work.counts.rays += work.rays.len() as u64;
        for (candidate, blocker) in work.candidates.iter().zip(&work.hits) {
            if blocker.triangle != NOTHING {
                continue;
            }
            let walk = &mut list[candidate.walk as usize];
            walk.radiance += walk.throughput * candidate.light;
            if KEEP {
                let vertex = &mut work.vertices[walk.vertex];
                keep(&mut vertex.lights, &mut work.lights, candidate.sample);
            }
        }
    }

    /// Makes the rays with which paths leave their points, one for each that is still alive.
    #[inline(always)]
    fn leave_surfaces<const KEEP: bool>(
        &self,
        paths: &[Path],
        walks: &mut Walks,
        bounce: u32,
        last: bool,
        work: &mut Work,
    ) {
        work.rays.clear();
        let mut count = 0;
        for k in 0..walks.alive.len() {
            let i = walks.alive[k];
            let path = &paths[i as usize];
            let walk = &mut walks.list[i as usize];
            let kept = &mut work.vertices;
            if let Some(ray) = self.leave::<KEEP>(path, walk, bounce, last, kept) {
                work.rays.push(ray);
                walks.alive[count] = i;
                count += 1;
            }
        }
        walks.alive.truncate(count);
        work.counts.rays += work.rays.len() as u64;
    }

    /// Adds the light of the environment that the last rays of paths see.
    #[inline(always)]
    fn see_environment<const KEEP: bool>(&self, walks: &mut Walks, work: &mut Work) {
        self.find_hits::<true>(work);
        for (&i, hit) in walks.alive.iter().zip(&work.hits) {
            if hit.triangle == NOTHING {
                self.escape::<KEEP>(&mut walks.list[i as usize], &mut work.vertices);
            }
        }
    }

    /// Takes paths to the next surfaces that their rays hit.
    #[inline(always)]
    fn arrive_at_surfaces<const KEEP: bool>(
        &self,
        paths: &[Path],
        walks: &mut Walks,
        bounce: u32,
        work: &mut Work,
    ) {
        self.find_hits::<false>(work);
        let mut count = 0;
        for k in 0..walks.alive.len() {
            let i = walks.alive[k];
            let (hit, ray) = (work.hits[k], &work.rays[k]);
            let walk = &mut walks.list[i as usize];
            work.counts.add_bounce(bounce);
            if hit.triangle != NOTHING {
                let time = paths[i as usize].time;
                walk.point = self.point(hit, ray.origin.into(), walk.bend.direction, time);
                walks.alive[count] = i;
                count += 1;
            } else if self.features.sees_sky {
                self.escape::<KEEP>(walk, &mut work.vertices);
            }
        }
        walks.alive.truncate(count);
    }

    /// Proposes connections of a path's point to lights, and draws the direction in which the path goes on.
    #[inline(always)]
    fn propose_lights<const KEEP: bool>(
        &self,
        path: &Path,
        walk: &mut Walk,
        i: u32,
        bounce: u32,
        goes_on: bool,
        work: &mut Work,
    ) {
        let point = &walk.point;
        if KEEP {
            let previous = std::mem::replace(&mut walk.vertex, work.vertices.len());
            work.vertices.push(Vertex {
                point: *point,
                throughput: walk.throughput,
                lights: 0..0,
                leave: None,
                previous,
            });
        }
        let [emitter_u, emitter_v] = walk.emitter;
        let by_scattering = self.features.combined && point.shading.glossy;
        if goes_on || by_scattering || self.features.gathers_map {
            let drawn = path.numbers.draw(Dimensions::direction(bounce));
            walk.emitter = [drawn.z, drawn.w];
            let lobe = if point.shading.glossy {
                path.numbers.draw(Dimensions::choices(bounce)).x
            } else {
                0.0
            };
            walk.scatter = point.shading.sample(drawn.x, drawn.y, lobe);
        }
        let cone = self.cone_numbers(path, bounce);
        let cone = ConeKernel {
            tangent: self.cone,
            u: cone.z,
            v: cone.w,
        };
        let from = Shaded {
            walk: i,
            time: path.time,
            point,
            cone,
        };
        if self.features.emitters {
            let along = by_scattering.then_some(walk.scatter.direction);
            self.direct_from_emitters(&from, [emitter_u, emitter_v], along, work);
        }
        if self.features.gathers_map {
            let drawn = path.numbers.draw(Dimensions::choices(bounce));
            let along = walk.scatter.direction;
            self.direct_from_map(&from, [drawn.z, drawn.w], along, work);
        }
    }

    /// The ray with which a path leaves a point; None if it ends.
    #[inline(always)]
    fn leave<const KEEP: bool>(
        &self,
        path: &Path,
        walk: &mut Walk,
        bounce: u32,
        last: bool,
        vertices: &mut [Vertex],
    ) -> Option<HitRay> {
        let scatter = walk.scatter;
        if scatter.weight == V3::ZERO {
            return None;
        }
        let plays = self.features.roulette && bounce >= self.lists.roulette_after;
        let u = if plays && !last {
            path.numbers.draw(Dimensions::choices(bounce)).y
        } else {
            0.0
        };
        let cone = self.cone_numbers(path, bounce);
        let (lists, before) = (&self.lists, walk.throughput);
        let left = leave(
            lists,
            &walk.point,
            &scatter,
            before,
            bounce,
            u,
            cone.x,
            cone.y,
        );
        if !left.goes_on {
            return None;
        }
        (walk.throughput, walk.bend) = (left.throughput, left.bend);
        if KEEP {
            vertices[walk.vertex].leave = Some(Leave {
                scatter,
                survival: left.survival,
                bend: left.bend,
                escaped: false,
            });
        }
        let (start, direction) = (left.start, left.bend.direction);
        Some(HitRay::new(start, direction, path.time, f32::INFINITY))
    }

    /// Adds the light of the environment, which a path came to.
    #[inline(always)]
    fn escape<const KEEP: bool>(&self, walk: &mut Walk, vertices: &mut [Vertex]) {
        let light = sky(&self.lists, walk.bend.direction);
        walk.radiance += walk.throughput * light;
        if KEEP && let Some(leave) = &mut vertices[walk.vertex].leave {
            leave.escaped = true;
        }
    }

    /// Two pairs of random numbers, for the cones of a bounce and of a shadow ray.
    #[inline(always)]
    fn cone_numbers(&self, path: &Path, bounce: u32) -> Four {
        match &path.cones {
            Some(numbers) => numbers.draw(Dimensions::of_set(bounce)),
            None => Four::default(),
        }
    }
}

/// Keeps a sample of a point, one after another.
#[inline(always)]
fn keep<T>(range: &mut Range<u32>, list: &mut Vec<T>, sample: T) {
    let next = list.len() as u32;
    if range.start == range.end {
        range.start = next;
    }
    range.end = next + 1;
    list.push(sample);
}
