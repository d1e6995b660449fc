//! Paths, forward: from camera rays to the light that they bring back. Each stage goes over all paths of a block before the
//! next begins.

use macro_rules_attribute::apply;

use super::direct::{direct_from_emitters, direct_from_map};
use super::eights::{self, Eight};
use super::view::Tracer;
use super::walk::{Level, Path, Walk, Walks, Way, Work};
use crate::accel::{Hit, HitRay, NOTHING, stage};
use crate::lanes::{LANES, Record};
use crate::model::{V3, v2};
use crate::sampling::{Dimensions, Four};
use crate::trace::{
    HitTriangle, Point, Triangle, emitted, hit_triangle, leave, middle_of, point_at, sky,
};

impl Tracer<'_> {
    /// Traces paths from their camera rays to their ends; all levels stay, if they are to be kept.
    pub(super) fn camera_walks(
        &self,
        paths: &[Path],
        walks: &mut Walks,
        keep: bool,
        work: &mut Work,
    ) {
        walks.clear(paths.len());
        leave_cameras(self, paths, walks, work);
        self.find_hits::<false>(work);
        work.counts.rays += paths.len() as u64;
        work.counts.add_bounces_at(0, paths.len());
        begin(self, paths, walks, work);
        self.reflected(paths, walks, 0, keep, work);
    }

    /// The hits of all rays.
    fn find_hits<const ANY: bool>(&self, work: &mut Work) {
        let (scene, hits) = (&self.scene, &mut work.hits);
        let holes = scene.holes.as_deref();
        (scene.hierarchy).hits::<ANY, false>(self.arch, holes, &work.rays, hits);
    }

    /// Adds the light that the surface points of the first level reflect towards the points that see them, after some
    /// bounces, times their throughputs.
    pub(super) fn reflected(
        &self,
        paths: &[Path],
        walks: &mut Walks,
        bounce: u32,
        keep: bool,
        work: &mut Work,
    ) {
        if self.features.dark {
            return;
        }
        let (mut bounce, mut at) = (bounce, 0);
        draw_emitters(paths, &mut walks.levels[0], bounce);
        while walks.levels[at].len > 0 {
            let last = bounce >= self.settings.bounces;
            let goes_on = !last || self.features.sees_sky;
            let level = &mut walks.levels[at];
            scatter(self, paths, level, bounce, goes_on);
            self.gather_lights(paths, level, &mut walks.list, bounce, keep, work);
            if !goes_on {
                return;
            }
            leave_surfaces(self, paths, level, bounce, last, work);
            work.counts.rays += work.rays.len() as u64;
            if last {
                self.find_hits::<true>(work);
                escape(self, level, &mut walks.list, work);
                return;
            }
            bounce += 1;
            self.find_hits::<false>(work);
            work.counts.add_bounces_at(bounce, work.rays.len());
            let next = if keep { at + 1 } else { 1 - at };
            let [from, to] = walks.levels_at(at, next);
            arrive(self, from, to, work);
            if self.features.sees_sky {
                escape(self, &mut walks.levels[at], &mut walks.list, work);
            }
            at = next;
            walks.depth = at + 1;
        }
    }

    /// Adds the light of lights that paths are connected to where they are.
    fn gather_lights(
        &self,
        paths: &[Path],
        level: &mut Level,
        list: &mut [Walk],
        bounce: u32,
        keep: bool,
        work: &mut Work,
    ) {
        work.rays.clear();
        work.candidates.clear();
        work.samples.clear();
        if self.features.emitters {
            direct_from_emitters(self, paths, level, bounce, keep, work);
        }
        if self.features.gathers_map {
            direct_from_map(self, paths, level, bounce, keep, work);
        }
        self.find_hits::<true>(work);
        work.counts.rays += work.rays.len() as u64;
        for (candidate, blocker) in work.candidates.iter().zip(&work.hits) {
            if blocker.triangle == NOTHING {
                list[candidate.path as usize].radiance += candidate.light;
            }
        }
        for (sample, blocker) in work.samples.iter().zip(&work.hits) {
            if blocker.triangle == NOTHING {
                level.lights.push(*sample);
            }
        }
    }

    /// The point that a ray hit.
    #[inline(always)]
    fn point(&self, hit: Hit, ray: &HitRay) -> Point {
        let (origin, direction, t) = (V3::from(ray.origin), V3::from(ray.direction), hit.t);
        let near = origin + direction * t;
        point_at(&self.lists, hit.triangle, near, t, direction, ray.time)
    }

    /// Two pairs of random numbers, for the cones of a bounce and of a shadow ray.
    #[inline(always)]
    pub(super) fn cone_numbers(&self, path: &Path, bounce: u32) -> Four {
        match &path.cones {
            Some(numbers) => numbers.draw(Dimensions::of_set(bounce)),
            None => Four::default(),
        }
    }
}

/// Makes the camera rays of paths.
#[apply(stage!)]
fn leave_cameras<'a>(
    tracer: &'a Tracer<'a>,
    paths: &'a [Path<'a>],
    walks: &'a mut Walks,
    work: &'a mut Work,
) {
    work.rays.clear();
    for (i, path) in paths.iter().enumerate() {
        let numbers = &path.numbers;
        let drawn = numbers.draw(Dimensions::film());
        let middle = middle_of(&tracer.lists, numbers.path().0);
        let x = middle.x + tracer.filter.sample(drawn.x);
        let y = middle.y + tracer.filter.sample(drawn.y);
        let lens = tracer.lens_point(numbers);
        let ray = tracer.camera.ray(x, y, lens.x, lens.y);
        let (origin, direction) = (ray.origin, ray.direction);
        let on = HitRay::new(origin, direction, path.time, f32::INFINITY);
        work.rays.push(on);
        walks.cameras.set(i, ray);
    }
}

/// Takes paths to the first surfaces that their rays hit, and adds the light that these emit, or that of the environment.
#[apply(stage!)]
fn begin<'a>(
    tracer: &'a Tracer<'a>,
    paths: &'a [Path<'a>],
    walks: &'a mut Walks,
    work: &'a mut Work,
) {
    let lists = &tracer.lists;
    let Walks { list, levels, .. } = walks;
    let first = &mut levels[0];
    let mut rays = std::mem::take(&mut work.arriving);
    rays.clear();
    for i in 0..paths.len() {
        if work.hits[i].triangle == NOTHING {
            list[i].radiance = sky(lists, work.rays[i].direction.into());
        } else {
            rays.push(i as u32);
            first.add(i as u32, i as u32, V3::ONE);
        }
    }
    points(tracer, first, &rays, work);
    work.arriving = rays;
    for (lane, &path) in first.paths.iter().enumerate() {
        let (walk, point) = (&mut list[path as usize], first.points.get(lane));
        walk.see(&point);
        walk.radiance = emitted(lists, &point);
    }
}

/// Finds the points that rays hit, one for each lane of a level.
#[inline(always)]
fn points(tracer: &Tracer, level: &mut Level, rays: &[u32], work: &Work) {
    let lists = &tracer.lists;
    let plain = lists.features.plain_points();
    for first in (0..level.len).step_by(LANES) {
        let lanes = first..level.len.min(first + LANES);
        let of = |lane: usize| {
            let k = rays[lane] as usize;
            (work.hits[k], &work.rays[k])
        };
        if !plain {
            for lane in lanes {
                let (hit, ray) = of(lane);
                level.points.set(lane, tracer.point(hit, ray));
            }
            continue;
        }
        let mut triangles = Eight::<Triangle>::default();
        let mut hits = Eight::<HitTriangle>::default();
        let [mut shifts, mut nears] = [Eight::<V3>::default(); 2];
        for lane in lanes {
            let (Hit { t, triangle }, ray) = of(lane);
            let (origin, direction) = (V3::from(ray.origin), V3::from(ray.direction));
            let hit = hit_triangle(lists, triangle, t, direction);
            lists
                .displacement(hit.object, ray.time)
                .set(&mut shifts, lane);
            lists.triangle(triangle).set(&mut triangles, lane);
            (origin + direction * t).set(&mut nears, lane);
            hit.set(&mut hits, lane);
        }
        *level.points.lanes_mut(first) = eights::plain_points(triangles, shifts, nears, hits);
    }
}

/// Draws the random numbers for the emitters that the first points are connected to.
fn draw_emitters(paths: &[Path], level: &mut Level, bounce: u32) {
    for lane in 0..level.len {
        let numbers = &paths[level.paths[lane] as usize].numbers;
        let drawn = numbers.draw(Dimensions::emitter(bounce));
        level.emitters.set(lane, v2(drawn.z, drawn.w));
    }
}

/// Draws the directions in which paths go on.
#[apply(stage!)]
fn scatter<'a>(
    tracer: &'a Tracer<'a>,
    paths: &'a [Path<'a>],
    level: &'a mut Level,
    bounce: u32,
    goes_on: bool,
) {
    let always = goes_on || tracer.features.gathers_map;
    let mut drawn = Eight::<Four>::default();
    for first in (0..level.len).step_by(LANES) {
        let lanes = first..level.len.min(first + LANES);
        let matt = eights::are_matt(level.points.lanes(first), lanes.len());
        if matt && !always {
            continue;
        }
        for lane in lanes.clone() {
            let numbers = &paths[level.paths[lane] as usize].numbers;
            let own = numbers.draw(Dimensions::direction(bounce));
            level.ahead.set(lane, v2(own.z, own.w));
            own.set(&mut drawn, lane);
        }
        if matt {
            let shadings = level.points.lanes(first).shading;
            *level.scatters.lanes_mut(first) = eights::scatter(shadings, drawn);
            continue;
        }
        for lane in lanes {
            let point = level.points.get(lane);
            let glossy = point.shading.glossy;
            if point.reflects && (always || (tracer.features.combined && glossy)) {
                let mut lobe = 0.0;
                if glossy {
                    let numbers = &paths[level.paths[lane] as usize].numbers;
                    lobe = numbers.draw(Dimensions::choices(bounce)).x;
                }
                let own = Four::get(&drawn, lane);
                let scatter = point.shading.sample(own.x, own.y, lobe);
                level.scatters.set(lane, scatter);
            }
        }
    }
}

/// Makes the rays with which paths leave their points.
#[apply(stage!)]
fn leave_surfaces<'a>(
    tracer: &'a Tracer<'a>,
    paths: &'a [Path<'a>],
    level: &'a mut Level,
    bounce: u32,
    last: bool,
    work: &'a mut Work,
) {
    work.rays.clear();
    work.lanes.clear();
    let lists = &tracer.lists;
    let plays = tracer.features.roulette && bounce >= lists.roulette_after && !last;
    let sharp = !plays && !lists.features.cones;
    for first in (0..level.len).step_by(LANES) {
        let lanes = first..level.len.min(first + LANES);
        let points = level.points.lanes(first);
        let at_once = sharp && eights::are_matt(points, lanes.len());
        if at_once {
            let (scatters, before) = (level.scatters.lanes(first), level.throughputs.lanes(first));
            *level.leavings.lanes_mut(first) = eights::leave(*points, *scatters, *before);
        }
        for lane in lanes {
            if !points.reflects[lane % LANES] {
                continue;
            }
            let path = &paths[level.paths[lane] as usize];
            if !at_once {
                let u = if plays {
                    path.numbers.draw(Dimensions::choices(bounce)).y
                } else {
                    0.0
                };
                let cone = tracer.cone_numbers(path, bounce);
                let (point, scatter) = (level.points.get(lane), level.scatters.get(lane));
                let before = level.throughputs.get(lane);
                let left = leave(lists, &point, &scatter, before, bounce, u, cone.x, cone.y);
                level.leavings.set(lane, left);
            }
            let left = level.leavings.get(lane);
            if left.goes_on {
                level.ways[lane] = Way::On;
                work.lanes.push(lane as u32);
                let (start, direction) = (left.start, left.bend.direction);
                let ray = HitRay::new(start, direction, path.time, f32::INFINITY);
                work.rays.push(ray);
            }
        }
    }
}

/// Takes paths to the next surfaces that their rays hit.
#[apply(stage!)]
fn arrive<'a>(tracer: &'a Tracer<'a>, from: &'a Level, to: &'a mut Level, work: &'a mut Work) {
    to.clear(work.rays.len());
    let mut rays = std::mem::take(&mut work.arriving);
    rays.clear();
    for (k, (&lane, hit)) in work.lanes.iter().zip(&work.hits).enumerate() {
        if hit.triangle != NOTHING {
            rays.push(k as u32);
            let from_lane = lane as usize;
            to.emitters.set(to.len, from.ahead.get(from_lane));
            let throughput = from.leavings.get(from_lane).throughput;
            to.add(from.paths[from_lane], lane, throughput);
        }
    }
    points(tracer, to, &rays, work);
    work.arriving = rays;
}

/// Adds the light of the environment where rays hit nothing.
#[apply(stage!)]
fn escape<'a>(tracer: &'a Tracer<'a>, level: &'a mut Level, list: &'a mut [Walk], work: &'a Work) {
    for (&lane, hit) in work.lanes.iter().zip(&work.hits) {
        if hit.triangle == NOTHING {
            let lane = lane as usize;
            let left = level.leavings.get(lane);
            let light = left.throughput * sky(&tracer.lists, left.bend.direction);
            list[level.paths[lane] as usize].radiance += light;
            level.ways[lane] = Way::Escaped;
        }
    }
}
