//! The forward pass: from camera rays to the light that paths collect. Each stage processes all paths of a block before
//! the next stage begins.

use std::ops::Range;

use macro_rules_attribute::apply;

use super::direct::{direct_from_emitters, direct_from_map, escape, limit_lights, see_map};
use super::eights::{self, Eight};
use super::walk::{Level, PathBlock, Walk, Walks, Way, Work};
use crate::accel::{Hit, HitRay, NOTHING, stage};
use crate::lanes::{LANES, Record};
use crate::model::triangle::{Plane, Triangle};
use crate::model::{Four, V2, V3, v2};
use crate::sampling::{Dimensions, Stream, draw_eight};
use crate::trace::{HitTriangle, Point, emitted, hit_triangle, leave, middle_of, point_at, sky};

impl PathBlock<'_> {
    /// Traces paths from their camera rays to their ends.
    pub(super) fn camera_walks(&mut self, walks: &mut Walks, work: &mut Work) {
        let count = self.paths.len();
        walks.clear(count);
        leave_cameras(self, walks, work);
        self.find_hits::<false>(work);
        work.counts.rays += count as u64;
        work.counts.add_bounces_at(0, count);
        begin(self, walks, work);
        if self.features.albedo {
            walks.see_albedos(&self.lists);
        }
        self.reflected(walks, work);
    }

    /// Computes the hits of all rays.
    fn find_hits<const ANY: bool>(&self, work: &mut Work) {
        let (scene, hits) = (&self.scene, &mut work.hits);
        let holes = scene.holes.as_deref();
        (scene.hierarchy).hits::<ANY, false>(self.arch, holes, &work.rays, hits);
    }

    /// Adds the light that the surface points of the first level reflect towards the viewing points, times the
    /// throughputs.
    pub(super) fn reflected(&mut self, walks: &mut Walks, work: &mut Work) {
        if self.features.dark {
            return;
        }
        let mut at = 0;
        while walks.levels[at].len() > 0 {
            let last = self.bounce >= self.settings.bounces;
            let goes_on = !last || self.features.sees_sky;
            let level = &mut walks.levels[at];
            draw(self, level, last);
            scatter(self, level);
            self.gather_lights(level, last, &mut walks.list, work);
            if !goes_on {
                return;
            }
            leave_surfaces(self, level, last, work);
            work.counts.rays += work.rays.len() as u64;
            if self.kept.counts {
                let paths = work.lanes.iter().map(|&lane| level.paths[lane as usize]);
                paths.for_each(|path| walks.list[path as usize].rays += 1);
            }
            if last {
                self.find_hits::<true>(work);
                escape(self, level, &mut walks.list, work);
                return;
            }
            self.find_hits::<false>(work);
            work.counts.add_bounces_at(self.bounce + 1, work.rays.len());
            let next = if self.kept.levels { at + 1 } else { 1 - at };
            let mut to = std::mem::take(walks.level(next));
            arrive(self, &walks.levels[at], &mut to, work);
            walks.levels[next] = to;
            if self.features.sees_sky {
                escape(self, &mut walks.levels[at], &mut walks.list, work);
            } else if self.features.gathers_map {
                see_map(&mut walks.levels[at], &mut walks.list, work);
            }
            self.bounce += 1;
            at = next;
            walks.depth = at + 1;
        }
    }

    /// Returns whether Russian roulette may end paths that leave their points.
    pub(super) fn plays(&self, last: bool) -> bool {
        self.features.roulette && self.bounce >= self.lists.roulette_after && !last
    }

    /// Adds the direct light at the points of a level.
    fn gather_lights(&self, level: &mut Level, last: bool, list: &mut [Walk], work: &mut Work) {
        work.rays.clear();
        work.candidates.clear();
        work.samples.clear();
        work.waiting.clear();
        if self.features.emitters {
            direct_from_emitters(self, level, work);
        }
        if self.features.gathers_map {
            direct_from_map(self, level, last, work);
        }
        if self.features.clamp {
            limit_lights(self, work);
        }
        self.find_hits::<true>(work);
        work.counts.rays += work.rays.len() as u64;
        if self.kept.counts {
            let paths = work.candidates.iter().map(|candidate| candidate.path);
            paths.for_each(|path| list[path as usize].rays += 1);
        }
        for (candidate, blocker) in work.candidates.iter().zip(&work.hits) {
            if blocker.triangle == NOTHING {
                list[candidate.path as usize].light.radiance += candidate.light;
            }
        }
        let seen = work.samples.iter().zip(&work.hits);
        let seen = seen.filter(|(_, blocker)| blocker.triangle == NOTHING);
        level.lights.extend(seen.map(|(sample, _)| *sample));
    }

    /// Returns the point that a ray hit.
    #[inline(always)]
    fn point(&self, hit: Hit, ray: &HitRay, bounce: u32) -> Point {
        let (direction, Hit { t, triangle }) = (V3::from(ray.direction), hit);
        let near = V3::from(ray.origin) + direction * t;
        let (lists, time) = (&self.lists, ray.time);
        point_at(lists, triangle, near, t, direction, time, bounce)
    }
}

/// Draws random numbers for up to eight paths. The lanes outside the given range repeat the first path.
#[inline(always)]
pub(super) fn drawn_by<'a>(
    stream: impl Fn(usize) -> &'a Stream,
    lanes: Range<usize>,
    what: Dimensions,
) -> Eight<Four> {
    let mut streams = [stream(lanes.start); LANES];
    for lane in lanes {
        streams[lane % LANES] = stream(lane);
    }
    draw_eight(streams, what)
}

/// Makes the camera rays of all paths.
#[apply(stage!)]
fn leave_cameras<'a>(of: &'a PathBlock<'a>, walks: &'a mut Walks, work: &'a mut Work) {
    work.rays.clear();
    let (mut pixel, mut middle) = (0, middle_of(&of.lists, 0));
    for first in (0..of.paths.len()).step_by(LANES) {
        let lanes = first..of.paths.len().min(first + LANES);
        let stream = |lane: usize| &of.paths[lane].numbers;
        let drawn = drawn_by(stream, lanes.clone(), Dimensions::film());
        let mut lens = Eight::<V2>::default();
        if of.features.lens {
            lens =
                eights::lens_points(drawn_by(stream, lanes.clone(), Dimensions::lens_and_time()));
        }
        let mut middles = Eight::<V2>::default();
        for lane in lanes.clone() {
            let own = of.paths[lane].numbers.pixel;
            if own != pixel {
                (pixel, middle) = (own, middle_of(&of.lists, own));
            }
            middle.set(&mut middles, lane);
        }
        let places = Eight::<V2> {
            x: eights::filter_of(&of.filter.table, drawn.x),
            y: eights::filter_of(&of.filter.table, drawn.y),
        };
        let rays = eights::camera_rays(of.camera, middles, places, lens);
        for lane in lanes {
            let (origin, direction) = (V3::get(&rays.origin, lane), V3::get(&rays.direction, lane));
            let time = of.paths[lane].time;
            let on = HitRay::new(origin, direction, time, f32::INFINITY);
            work.rays.push(on);
        }
        *walks.film.lanes_mut(first) = drawn;
        *walks.cameras.lanes_mut(first) = rays;
    }
}

/// Draws the random numbers for the emitters to which the first points are connected.
#[apply(stage!)]
pub(super) fn draw_emitters<'a>(of: &'a PathBlock<'a>, level: &'a mut Level) {
    for first in (0..level.len()).step_by(LANES) {
        let lanes = first..level.len().min(first + LANES);
        let stream = |lane: usize| &of.path(level, lane).numbers;
        let drawn = drawn_by(stream, lanes, Dimensions::emitter(of.bounce));
        *level.emitters.lanes_mut(first) = Eight::<V2> {
            x: drawn.z,
            y: drawn.w,
        };
    }
}

/// Moves paths to the first surfaces that their rays hit, and adds the light that these emit, or the light of the
/// environment.
#[apply(stage!)]
fn begin<'a>(of: &'a PathBlock<'a>, walks: &'a mut Walks, work: &'a mut Work) {
    let lists = &of.lists;
    let Walks {
        list, levels, film, ..
    } = walks;
    let first = &mut levels[0];
    work.arriving.clear();
    for (i, (hit, ray)) in work.hits.iter().zip(&work.rays).enumerate() {
        if hit.triangle == NOTHING {
            list[i].light.radiance = sky(lists, ray.direction.into());
        } else {
            work.arriving.push(i as u32);
            let drawn = film.get(i);
            first.emitters.set(first.len(), v2(drawn.z, drawn.w));
            first.add(i as u32, i as u32, V3::ONE);
        }
    }
    points(of, first, 0, work);
    for (lane, &path) in first.paths.iter().enumerate() {
        let (walk, point) = (&mut list[path as usize], first.points.get(lane));
        walk.see(&point);
        walk.light.radiance = emitted(lists, &point);
    }
}

/// Computes the points that arriving rays hit after `bounce` bounces, one for each lane of a level.
#[inline(always)]
fn points(of: &PathBlock, level: &mut Level, bounce: u32, work: &Work) {
    let lists = &of.lists;
    let plain = lists.features.plain_points();
    for first in (0..level.len()).step_by(LANES) {
        let lanes = first..level.len().min(first + LANES);
        let hit_of = |lane: usize| {
            let k = work.arriving[lane] as usize;
            (work.hits[k], &work.rays[k])
        };
        if !plain {
            for lane in lanes {
                let (hit, ray) = hit_of(lane);
                level.points.set(lane, of.point(hit, ray, bounce));
            }
            continue;
        }
        let mut planes = Eight::<Plane>::default();
        let mut hits = Eight::<HitTriangle>::default();
        let [mut shifts, mut nears] = [Eight::<V3>::default(); 2];
        for lane in lanes.clone() {
            let (Hit { t, triangle }, ray) = hit_of(lane);
            let (origin, direction) = (V3::from(ray.origin), V3::from(ray.direction));
            let hit = hit_triangle(lists, triangle, t, direction);
            if lists.features.moves {
                let shift = lists.shift(triangle, ray.time);
                shift.set(&mut shifts, lane);
            }
            lists.plane(triangle).set(&mut planes, lane);
            (origin + direction * t).set(&mut nears, lane);
            hit.set(&mut hits, lane);
        }
        let points = level.points.lanes_mut(first);
        *points = eights::plain_points(planes, shifts, nears, hits);
        // Only derivatives use the weights.
        if of.kept.levels {
            let mut triangles = Eight::<Triangle>::default();
            for lane in lanes {
                let triangle = lists.triangle(hits.triangle[lane % LANES]);
                triangle.set(&mut triangles, lane);
            }
            points.weights = eights::weights(triangles, shifts, nears, hits.direction);
        }
    }
}

/// Draws the random numbers that paths use at their points.
#[apply(stage!)]
fn draw<'a>(of: &'a PathBlock<'a>, level: &'a mut Level, last: bool) {
    let features = &of.features;
    let always = !last || features.sees_sky || features.gathers_map;
    let choices = features.gathers_map || of.plays(last);
    let paths = &level.paths;
    for first in (0..paths.len()).step_by(LANES) {
        let lanes = first..paths.len().min(first + LANES);
        let matt = eights::are_matt(level.points.lanes(first), lanes.len());
        level.matt.push(matt);
        if features.cones {
            let stream = |lane: usize| &of.cones[of.paths[paths[lane] as usize].cones as usize];
            let drawn = drawn_by(stream, lanes.clone(), Dimensions::of_set(of.bounce));
            *level.cones.lanes_mut(first) = drawn;
        }
        let stream = |lane: usize| &of.paths[paths[lane] as usize].numbers;
        if always || (!matt && features.combined) {
            let drawn = drawn_by(stream, lanes.clone(), Dimensions::direction(of.bounce));
            *level.numbers.lanes_mut(first) = drawn;
            if choices || !matt {
                let drawn = drawn_by(stream, lanes, Dimensions::choices(of.bounce));
                *level.choices.lanes_mut(first) = drawn;
            }
        }
    }
}

/// Draws the directions in which paths continue, or would continue.
#[apply(stage!)]
fn scatter<'a>(of: &'a PathBlock<'a>, level: &'a mut Level) {
    for first in (0..level.len()).step_by(LANES) {
        let lanes = first..level.len().min(first + LANES);
        let drawn = *level.numbers.lanes(first);
        if level.matt[first / LANES] {
            let shadings = level.points.lanes(first).shading;
            *level.scatters.lanes_mut(first) = if shadings.smooth.iter().any(|&smooth| smooth) {
                eights::scatter::<false>(shadings, drawn)
            } else {
                eights::scatter::<true>(shadings, drawn)
            };
            continue;
        }
        for lane in lanes {
            let point = level.points.get(lane);
            if point.reflects {
                let (own, mut lobe) = (Four::get(&drawn, lane), 0.0);
                if point.shading.glossy {
                    lobe = level.choices.get(lane).x;
                }
                let scatter = point.shading.sample(own.x, own.y, lobe);
                level.scatters.set(lane, scatter);
            }
        }
    }
}

/// Makes the rays with which paths leave their points.
#[apply(stage!)]
fn leave_surfaces<'a>(of: &'a PathBlock<'a>, level: &'a mut Level, last: bool, work: &'a mut Work) {
    work.rays.clear();
    work.lanes.clear();
    let lists = &of.lists;
    let plays = of.plays(last);
    for first in (0..level.len()).step_by(LANES) {
        let lanes = first..level.len().min(first + LANES);
        let at_once = !plays && level.matt[first / LANES];
        let points = level.points.lanes(first);
        let cones = level.cones.lanes(first);
        if at_once {
            let (scatters, before) = (level.scatters.lanes(first), level.throughputs.lanes(first));
            let mut left = eights::leave(*points, *scatters, *before);
            if of.features.cones {
                left.bend = eights::bend(*points, *scatters, of.cone, *cones);
            }
            *level.leavings.lanes_mut(first) = left;
        }
        for lane in lanes {
            if !points.reflects[lane % LANES] {
                continue;
            }
            if !at_once {
                let u = level.choices.get(lane).y;
                let cone = Four::get(cones, lane);
                let (point, scatter) = (level.points.get(lane), level.scatters.get(lane));
                let before = level.throughputs.get(lane);
                let left = leave(
                    lists, &point, &scatter, before, of.bounce, u, cone.x, cone.y,
                );
                level.leavings.set(lane, left);
            }
            let left = level.leavings.lanes(first);
            if left.goes_on[lane % LANES] {
                level.ways[lane] = Way::On;
                work.lanes.push(lane as u32);
                let start = V3::get(&left.start, lane);
                let direction = V3::get(&left.bend.direction, lane);
                let time = of.time(level, lane);
                let ray = HitRay::new(start, direction, time, f32::INFINITY);
                work.rays.push(ray);
            }
        }
    }
}

/// Moves paths to the next surfaces that their rays hit.
#[apply(stage!)]
fn arrive<'a>(of: &'a PathBlock<'a>, from: &'a Level, to: &'a mut Level, work: &'a mut Work) {
    to.clear(work.rays.len());
    work.arriving.clear();
    for (k, (&lane, hit)) in work.lanes.iter().zip(&work.hits).enumerate() {
        if hit.triangle != NOTHING {
            work.arriving.push(k as u32);
            let from_lane = lane as usize;
            let numbers = from.numbers.get(from_lane);
            to.emitters.set(to.len(), v2(numbers.z, numbers.w));
            let throughput = from.leavings.get(from_lane).throughput;
            to.add(from.paths[from_lane], lane, throughput);
        }
    }
    points(of, to, of.bounce + 1, work);
}
