//! Paths, forward: from a camera ray to what it brings back.

use std::ops::Range;

use glam::Vec3;

use super::View;
use super::records::{Leave, LightSample, SkySample, Vertex, Work};
use super::sky::SkyMap;
use super::surface::Point;
use crate::accel::{HitRay, NOTHING};
use crate::model::bsdf::Scatter;
use crate::model::camera::CameraRay;
use crate::model::cone::{Bend, bend, up_to_plane};
use crate::model::triangle::at;
use crate::model::{V3, v3};
use crate::transport::sampler::Numbers;

/// What stays the same along a path.
#[derive(Clone, Copy)]
pub(crate) struct Path<'a> {
    pub numbers: Numbers<'a>,
    /// For the kernels of cones.
    pub cones: Option<Numbers<'a>>,
    /// Time in the shutter.
    pub time: f32,
}

/// A path on its way.
#[derive(Clone)]
pub(crate) struct Walk {
    pub camera: CameraRay,
    /// What the camera ray hit.
    pub seen: u32,
    /// Where the path is, if it came to a surface.
    pub point: Point,
    /// Where rays from there start.
    start: V3,
    pub on_surface: bool,
    /// Distance and geometric normal of the first surface.
    pub first: (f32, V3),
    pub throughput: V3,
    /// What it brought back so far.
    pub radiance: V3,
    /// Random numbers for the next emitter.
    emitter: [f32; 2],
    scatter: Scatter,
    bend: Bend,
    /// Its last point among those that are kept.
    pub vertex: usize,
}

impl Walk {
    pub fn new() -> Self {
        Self {
            camera: CameraRay::default(),
            seen: NOTHING,
            point: Point::default(),
            start: V3::ZERO,
            on_surface: false,
            first: (0.0, V3::ZERO),
            throughput: V3::ONE,
            radiance: V3::ZERO,
            emitter: [0.0; 2],
            scatter: Scatter::default(),
            bend: Bend::default(),
            vertex: usize::MAX,
        }
    }

    #[inline(always)]
    fn come_to(&mut self, point: Point) {
        self.start = point.start();
        self.point = point;
    }

    /// At a surface point.
    #[inline(always)]
    pub fn start(&mut self, point: Point) {
        self.first = (point.t, point.shading.geometric);
        self.come_to(point);
        self.on_surface = true;
    }
}

/// Paths that go together.
#[derive(Default)]
pub(crate) struct Walks {
    pub list: Vec<Walk>,
    alive: Vec<u32>,
}

impl Walks {
    pub fn clear(&mut self) {
        self.list.clear();
        self.alive.clear();
    }
}

/// A point that looks for light.
struct From<'a> {
    walk: u32,
    time: f32,
    point: &'a Point,
    start: V3,
}

/// Light that arrives if nothing is in between.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    walk: u32,
    light: V3,
    sample: Sample,
}

#[derive(Clone, Copy, Debug)]
enum Sample {
    Light(LightSample),
    Sky(SkySample),
}

/// What a camera ray sees, and what its path brings back.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Seen {
    pub radiance: V3,
    /// 1 where there is a surface.
    pub opacity: f32,
    /// The distance to it.
    pub depth: f32,
    /// Its geometric normal on the side that is seen.
    pub normal: V3,
}

impl Seen {
    /// Adds what a path's camera ray saw and what it brought back.
    #[inline(always)]
    pub fn add(&mut self, walk: &Walk) {
        self.radiance += walk.radiance;
        if walk.seen != NOTHING {
            let first = &walk.first;
            self.opacity += 1.0;
            self.depth += first.0;
            self.normal += first.1;
        }
    }
}

pub(super) fn glam3(v: V3) -> Vec3 {
    Vec3::new(v.x, v.y, v.z)
}

impl View {
    /// The camera ray of a path.
    #[inline(always)]
    pub(super) fn camera_ray(&self, numbers: &Numbers, pixel: u32) -> CameraRay {
        let [u, v, ..] = numbers.film();
        let x = (pixel % self.width) as f32 + 0.5 + self.filter.sample(u);
        let y = (pixel / self.width) as f32 + 0.5 + self.filter.sample(v);
        let [lens_x, lens_y] = self.lens_point(numbers);
        self.camera.ray(x, y, lens_x, lens_y)
    }

    /// A point of the lens, on the unit disk.
    #[inline(always)]
    pub(super) fn lens_point(&self, numbers: &Numbers) -> [f32; 2] {
        if self.camera.aperture == 0.0 {
            return [0.0; 2];
        }
        let [radius, angle] = numbers.lens();
        let [sin, cos] = crate::model::frame::sin_cos_of_turns(angle);
        [radius.sqrt() * cos, radius.sqrt() * sin]
    }

    #[inline(always)]
    pub(super) fn time(&self, numbers: &Numbers) -> f32 {
        if self.scene.velocities.is_some() {
            numbers.time()
        } else {
            0.0
        }
    }

    /// What camera rays see, and what their paths bring back.
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
                glam3(camera.origin),
                glam3(camera.direction),
                path.time,
                f32::INFINITY,
            ));
            walks.list.push(Walk {
                camera,
                ..Walk::new()
            });
        }
        self.scene
            .hierarchy
            .hits::<false>(self.arch, &work.rays, &mut work.hits);
        work.counts.rays += walks.list.len() as u64;
        let found = walks.list.iter_mut().zip(paths).zip(&work.hits);
        for ((walk, path), &hit) in found {
            work.counts.add_bounce(0);
            walk.seen = hit.triangle;
            let camera = &walk.camera;
            if hit.triangle == NOTHING {
                walk.radiance = self.scene.sky.at(camera.direction);
                continue;
            }
            let (o, d) = (camera.origin, camera.direction);
            walk.start(self.scene.point(hit, o, d, path.time));
            walk.radiance = self.emission(&walk.point);
        }
        self.reflected::<KEEP>(paths, walks, 0, work);
    }

    /// What a surface point emits towards where it is seen from.
    #[inline(always)]
    pub(super) fn emission(&self, point: &Point) -> V3 {
        let m = self.scene.material(point.triangle);
        if point.side > 0.0 && m.kind.emits {
            m.emission()
        } else {
            V3::ZERO
        }
    }

    /// Adds what surface points reflect towards where they are seen from, after some bounces, times their
    /// throughputs. With `KEEP` the paths stay in `work`.
    #[inline(always)]
    pub(super) fn reflected<const KEEP: bool>(
        &self,
        paths: &[Path],
        walks: &mut Walks,
        bounce: u32,
        work: &mut Work,
    ) {
        if self.dark {
            return;
        }
        let mut bounce = bounce;
        for (walk, path) in walks.list.iter_mut().zip(paths) {
            walk.emitter = self.emitter_numbers(path, bounce);
        }
        walks.alive.clear();
        for i in 0..walks.list.len() as u32 {
            if walks.list[i as usize].on_surface {
                walks.alive.push(i);
            }
        }
        while !walks.alive.is_empty() {
            let last = bounce >= self.bounces;
            let goes_on = !last || self.sees_sky;
            work.rays.clear();
            work.candidates.clear();
            let (list, scene) = (&mut walks.list, &*self.scene);
            // Loops with a count of those that stay: what closures do is not compiled for the machine.
            let mut count = 0;
            for k in 0..walks.alive.len() {
                let i = walks.alive[k];
                let walk = &mut list[i as usize];
                if scene.material(walk.point.triangle).kind.reflects {
                    walks.alive[count] = i;
                    count += 1;
                    let path = &paths[i as usize];
                    self.light_candidates::<KEEP>(path, walk, i, bounce, goes_on, work);
                }
            }
            walks.alive.truncate(count);
            scene
                .hierarchy
                .hits::<true>(self.arch, &work.rays, &mut work.hits);
            work.counts.rays += work.rays.len() as u64;
            for (candidate, blocker) in work.candidates.iter().zip(&work.hits) {
                if blocker.triangle != NOTHING {
                    continue;
                }
                let walk = &mut list[candidate.walk as usize];
                walk.radiance += walk.throughput.times(candidate.light);
                if KEEP {
                    let vertex = &mut work.vertices[walk.vertex];
                    match candidate.sample {
                        Sample::Light(sample) => {
                            keep(&mut vertex.lights, &mut work.lights, sample);
                        }
                        Sample::Sky(sample) => keep(&mut vertex.skies, &mut work.skies, sample),
                    }
                }
            }
            if !goes_on {
                return;
            }
            work.rays.clear();
            let mut count = 0;
            for k in 0..walks.alive.len() {
                let i = walks.alive[k];
                let path = &paths[i as usize];
                let walk = &mut list[i as usize];
                let kept = &mut work.vertices;
                if let Some(ray) = self.leave::<KEEP>(path, walk, bounce, last, kept) {
                    work.rays.push(ray);
                    walks.alive[count] = i;
                    count += 1;
                }
            }
            walks.alive.truncate(count);
            work.counts.rays += work.rays.len() as u64;
            if last {
                scene
                    .hierarchy
                    .hits::<true>(self.arch, &work.rays, &mut work.hits);
                for (&i, hit) in walks.alive.iter().zip(&work.hits) {
                    if hit.triangle == NOTHING {
                        self.escape::<KEEP>(&mut list[i as usize], &mut work.vertices);
                    }
                }
                return;
            }
            scene
                .hierarchy
                .hits::<false>(self.arch, &work.rays, &mut work.hits);
            bounce += 1;
            let mut count = 0;
            for k in 0..walks.alive.len() {
                let i = walks.alive[k];
                let (hit, ray) = (work.hits[k], &work.rays[k]);
                let walk = &mut list[i as usize];
                work.counts.add_bounce(bounce);
                if hit.triangle != NOTHING {
                    let origin = v3(ray.origin.x, ray.origin.y, ray.origin.z);
                    let time = paths[i as usize].time;
                    walk.come_to(scene.point(hit, origin, walk.bend.direction, time));
                    walks.alive[count] = i;
                    count += 1;
                } else if self.sees_sky {
                    self.escape::<KEEP>(walk, &mut work.vertices);
                }
            }
            walks.alive.truncate(count);
        }
    }

    /// Where light may come from at a point of a path, and where the path goes on.
    #[inline(always)]
    fn light_candidates<const KEEP: bool>(
        &self,
        path: &Path,
        walk: &mut Walk,
        i: u32,
        bounce: u32,
        goes_on: bool,
        work: &mut Work,
    ) {
        let scene = &*self.scene;
        let point = &walk.point;
        if KEEP {
            let previous = std::mem::replace(&mut walk.vertex, work.vertices.len());
            work.vertices.push(Vertex {
                point: *point,
                throughput: walk.throughput,
                lights: 0..0,
                skies: 0..0,
                leave: None,
                previous,
            });
        }
        let [emitter_u, emitter_v] = walk.emitter;
        let by_scattering = self.combined && point.shading.glossy;
        if goes_on || by_scattering || self.gathers_map {
            let [u, v, a, b] = path.numbers.direction(bounce);
            walk.emitter = [a, b];
            let lobe = if point.shading.glossy {
                path.numbers.lobe(bounce)
            } else {
                0.0
            };
            walk.scatter = point.shading.sample(u, v, lobe);
        }
        let [_, _, cone_u, cone_v] = self.cone_numbers(path, bounce);
        let cone = [cone_u, cone_v];
        let from = From {
            walk: i,
            time: path.time,
            point,
            start: walk.start,
        };
        if !scene.emitters.is_empty() {
            let along = by_scattering.then_some(walk.scatter.direction);
            self.direct(&from, [emitter_u, emitter_v], cone, along, work);
        }
        if let Some(map) = scene.sky.map().filter(|_| self.gathers_map) {
            let drawn = path.numbers.environment(bounce);
            let along = walk.scatter.direction;
            self.direct_of_map(&from, map, drawn, cone, along, work);
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
        if scatter.weight.is_zero() {
            return None;
        }
        walk.throughput = walk.throughput.times(scatter.weight);
        let mut survival = 1.0;
        if !last && self.roulette_after.is_some_and(|after| bounce >= after) {
            survival = walk.throughput.max_component().clamp(0.05, 1.0);
            if path.numbers.roulette(bounce) >= survival {
                return None;
            }
            walk.throughput = walk.throughput * (1.0 / survival);
        }
        let [cone_u, cone_v, ..] = self.cone_numbers(path, bounce);
        let normal = walk.point.shading.geometric;
        walk.bend = self.bend(scatter.direction, normal, cone_u, cone_v);
        if KEEP {
            vertices[walk.vertex].leave = Some(Leave {
                scatter,
                survival,
                bend: walk.bend,
                escaped: false,
            });
        }
        Some(HitRay::new(
            glam3(walk.start),
            glam3(walk.bend.direction),
            path.time,
            f32::INFINITY,
        ))
    }

    /// Light of the environment, which a path came to.
    #[inline(always)]
    fn escape<const KEEP: bool>(&self, walk: &mut Walk, vertices: &mut [Vertex]) {
        let light = self.scene.sky.at(walk.bend.direction);
        walk.radiance += walk.throughput.times(light);
        if KEEP && let Some(leave) = &mut vertices[walk.vertex].leave {
            leave.escaped = true;
        }
    }

    /// Random numbers for the emitter that a path's point at a bounce is connected to.
    #[inline(always)]
    fn emitter_numbers(&self, path: &Path, bounce: u32) -> [f32; 2] {
        let [_, _, u, v] = match bounce {
            0 => path.numbers.film(),
            b => path.numbers.direction(b - 1),
        };
        [u, v]
    }

    /// Two pairs of random numbers, for the cones of a bounce and of a shadow ray.
    #[inline(always)]
    fn cone_numbers(&self, path: &Path, bounce: u32) -> [f32; 4] {
        match &path.cones {
            Some(numbers) => numbers.set(bounce),
            None => [0.0; 4],
        }
    }

    /// A ray of the cone about an axis, on the outer side of a surface.
    #[inline(always)]
    pub(super) fn bend(&self, axis: V3, normal: V3, u: f32, v: f32) -> Bend {
        bend(axis, normal, self.cone, u, v)
    }

    /// Light from one point of one emitter, and from those that lie along another direction.
    #[inline(always)]
    fn direct(
        &self,
        from: &From,
        [u, v]: [f32; 2],
        cone: [f32; 2],
        along: Option<V3>,
        work: &mut Work,
    ) {
        let emitters = &self.scene.emitters;
        let x = from.point.position;
        let (k, chance, u) = emitters.choose(x, from.time, u, &mut work.chances);
        let root = u.sqrt();
        let bc = [root * (1.0 - v), root * v];
        self.arriving(from, (k, bc, chance), along.map(|_| false), cone, work);
        if let Some(direction) = along {
            let mut met = std::mem::take(&mut work.met);
            met.clear();
            emitters.met(emitters.all(), x, from.time, direction, |k, _, bc| {
                met.push((k, bc));
            });
            for &(k, bc) in &met {
                let chance = emitters.chance(x, from.time, k, &mut work.chances);
                self.arriving(from, (k, bc, chance), Some(true), cone, work);
            }
            work.met = met;
        }
    }

    /// Light from a point of an emitter over its density. `combined` says by which of two strategies it
    /// was found, if there are two.
    #[inline(always)]
    fn arriving(
        &self,
        from: &From,
        (emitter, [b, c], chance): (usize, [f32; 2], f32),
        combined: Option<bool>,
        [cone_u, cone_v]: [f32; 2],
        work: &mut Work,
    ) {
        let point = from.point;
        let e = self.scene.emitters.get(emitter);
        let weights = [1.0 - b - c, b, c];
        let light = at(e.corners, weights) + e.velocity * from.time;
        let to = light - point.position;
        let squared = to.length_squared().max(f32::MIN_POSITIVE);
        let distance = squared.sqrt();
        let direction = to * (1.0 / distance);
        let facing = -e.normal.dot(direction);
        if facing <= 0.0 {
            return;
        }
        let reflected = point.shading.evaluate(direction);
        if reflected.is_zero() {
            return;
        }
        let bend = self.bend(direction, point.shading.geometric, cone_u, cone_v);
        let limit = up_to_plane(from.start, bend.direction, e.normal, light);
        let triangle = &self.scene.triangles[e.triangle as usize];
        let per_area = facing / squared * triangle.area;
        let density = match combined {
            Some(by_scattering) => {
                let other = point.shading.density(direction) * per_area;
                power_heuristic(chance, other, by_scattering)
            }
            None => chance,
        };
        let emission = self.scene.materials[triangle.material as usize].emission();
        work.rays.push(HitRay::new(
            glam3(from.start),
            glam3(bend.direction),
            from.time,
            limit,
        ));
        work.candidates.push(Candidate {
            walk: from.walk,
            light: reflected.times(emission) * (per_area / density),
            sample: Sample::Light(LightSample {
                triangle: e.triangle,
                weights,
                direction,
                distance,
                squared,
                facing,
                reflected,
                density,
            }),
        });
    }

    /// Light of a map along a direction drawn from it, and along that in which the path goes on.
    #[inline(never)]
    fn direct_of_map(
        &self,
        from: &From,
        map: &SkyMap,
        [u, v]: [f32; 2],
        [cone_u, cone_v]: [f32; 2],
        along: V3,
        work: &mut Work,
    ) {
        let shading = &from.point.shading;
        let (drawn, chance) = map.drawn.choose(u, v);
        for (by_scattering, direction, chance) in [
            (false, drawn, chance),
            (true, along, map.drawn.density(along)),
        ] {
            let reflected = shading.evaluate(direction);
            if reflected.is_zero() {
                continue;
            }
            let bend = self.bend(direction, shading.geometric, cone_u, cone_v);
            let other = shading.density(direction);
            let density = power_heuristic(chance, other, by_scattering);
            work.rays.push(HitRay::new(
                glam3(from.start),
                glam3(bend.direction),
                from.time,
                f32::INFINITY,
            ));
            work.candidates.push(Candidate {
                walk: from.walk,
                light: reflected.times(map.at(direction)) * (1.0 / density),
                sample: Sample::Sky(SkySample { direction, density }),
            });
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

/// What a sample is divided by where two strategies are combined: w₁ = p₁²/(p₁² + p₂²) makes that
/// (p₁² + p₂²)/p₁ (the power heuristic, Veach and Guibas 1995).
#[inline(always)]
fn power_heuristic(a: f32, b: f32, is_b: bool) -> f32 {
    let own = if is_b { b } else { a };
    (a * a + b * b) / own.max(1e-20)
}
