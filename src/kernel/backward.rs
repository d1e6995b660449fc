//! Paths, backward: derivatives by everything that they hit, level by level from their last points to the camera.

use macro_rules_attribute::apply;

use super::view::Tracer;
use super::walk::{Back, Level, LightSample, Path, Seen, Walks, Way, Work};
use crate::accel::{NOTHING, stage};
use crate::model::V3;
use crate::model::camera::CameraGradient;
use crate::model::connection::Target;
use crate::trace::{
    NONE, PointGradient, RayGradient, Sums, add_to_camera, leave_backward, light_backward,
    map_backward, middle_of, point_backward, seen_backward, sky_backward, target_of,
};

impl Tracer<'_> {
    /// Goes back along paths that were kept: adds the derivatives of the light that each brought, times its part of
    /// `upstream`. `typical` is how much the loss depends on a camera ray's light on average.
    pub(super) fn walks_backward(
        &self,
        paths: &[Path],
        walks: &Walks,
        upstream: &[&Seen],
        typical: f32,
        work: &mut Work,
        sums: &Sums,
    ) {
        let mut back = std::mem::take(&mut work.back);
        find_moving(self, walks, &mut back);
        let last = &walks.levels[walks.depth - 1];
        back.begin(last.len);
        for at in (0..walks.depth).rev() {
            let level = &walks.levels[at];
            back.points.clear();
            back.points.resize(level.len, PointGradient::default());
            ways_backward(self, level, upstream, &mut back, sums);
            if self.settings.interior {
                lights_backward(self, paths, level, upstream, &mut back, sums);
            }
            if self.has_edges && !self.features.dark {
                let g = (upstream, typical);
                self.edges_backward(paths, level, at as u32, g, &mut back, work, sums);
            }
            let before = match at {
                0 => paths.len(),
                _ => walks.levels[at - 1].len,
            };
            back.step(before);
            points_backward(self, paths, level, at == 0, upstream, &mut back, sums);
        }
        cameras_backward(self, paths, walks, upstream, &back, sums);
        work.back = back;
    }
}

/// Finds the points of paths that move, or from which the rays on turn: those behind a point that moves do.
#[apply(stage!)]
fn find_moving<'a>(tracer: &'a Tracer<'a>, walks: &'a Walks, back: &'a mut Back) {
    let of = &tracer.wanted.of;
    back.moves.resize_with(walks.depth, Vec::new);
    for (at, level) in walks.levels[..walks.depth].iter().enumerate() {
        let (before, rest) = back.moves.split_at_mut(at);
        let moves = &mut rest[0];
        moves.clear();
        for lane in 0..level.len {
            let followed = match before.last() {
                Some(before) => of.turns || before[level.before[lane] as usize],
                None => of.camera,
            };
            let point = level.points.get(lane);
            moves.push(followed || tracer.lists.is_wanted(point.object));
        }
    }
}

/// Back over the rays with which paths leave their points.
#[apply(stage!)]
fn ways_backward<'a>(
    tracer: &'a Tracer<'a>,
    level: &'a Level,
    upstream: &'a [&'a Seen],
    back: &'a mut Back,
    sums: &'a Sums<'a>,
) {
    for lane in 0..level.len {
        let (by_next, by_leaving) = (back.throughputs[lane], back.rays[lane]);
        back.throughputs[lane] = V3::ZERO;
        if level.ways[lane] == Way::Ends {
            continue;
        }
        let left = level.leavings.get(lane);
        let escaped = level.ways[lane] == Way::Escaped && tracer.settings.interior;
        back.throughputs[lane] = leave_backward(
            &tracer.lists,
            sums,
            &level.points.get(lane),
            &level.scatters.get(lane),
            &left.bend,
            left.survival,
            escaped,
            level.throughputs.get(lane),
            by_next,
            by_leaving,
            upstream[level.paths[lane] as usize].radiance,
            &mut back.points[lane],
        );
    }
}

/// Back over light from emitters, delta lights and maps.
#[apply(stage!)]
fn lights_backward<'a>(
    tracer: &'a Tracer<'a>,
    paths: &'a [Path<'a>],
    level: &'a Level,
    upstream: &'a [&'a Seen],
    back: &'a mut Back,
    sums: &'a Sums<'a>,
) {
    for light in &level.lights {
        let path = level.paths[light.lane as usize] as usize;
        let (g, time) = (upstream[path].radiance, paths[path].time);
        let by_throughput = if light.emitter == NONE {
            of_map(tracer, level, light, g, back, sums)
        } else {
            of_emitter(tracer, level, light, time, g, back, sums)
        };
        back.throughputs[light.lane as usize] += by_throughput;
    }
}

/// Back over light from an emitter or a delta light.
#[inline(always)]
fn of_emitter<'a>(
    tracer: &'a Tracer<'a>,
    level: &'a Level,
    light: &'a LightSample,
    time: f32,
    g: V3,
    back: &'a mut Back,
    sums: &'a Sums<'a>,
) -> V3 {
    let (lists, lane) = (&tracer.lists, light.lane as usize);
    let (k, weights, arrived) = (light.emitter, light.weights, light.arrived);
    let (point, carried) = (level.points.get(lane), level.throughputs.get(lane));
    let target = target_of(lists, k, weights, point.position, time, false);
    let by = &mut back.points[lane];
    light_backward(
        lists, sums, &point, k, weights, target, arrived, carried, time, g, by,
    )
}

/// Back over light of a map along a direction.
#[inline(always)]
fn of_map<'a>(
    tracer: &'a Tracer<'a>,
    level: &'a Level,
    light: &'a LightSample,
    g: V3,
    back: &'a mut Back,
    sums: &'a Sums<'a>,
) -> V3 {
    let (lists, lane) = (&tracer.lists, light.lane as usize);
    let target = Target::of_map(light.direction);
    let (point, carried) = (level.points.get(lane), level.throughputs.get(lane));
    let by = &mut back.points[lane];
    map_backward(lists, sums, &point, target, light.arrived, carried, g, by)
}

/// Back over points to the rays that came to them.
#[apply(stage!)]
fn points_backward<'a>(
    tracer: &'a Tracer<'a>,
    paths: &'a [Path<'a>],
    level: &'a Level,
    first: bool,
    upstream: &'a [&'a Seen],
    back: &'a mut Back,
    sums: &'a Sums<'a>,
) {
    let interior = tracer.settings.interior;
    for lane in 0..level.len {
        let point = level.points.get(lane);
        // Light ends where nothing is reflected.
        if !point.reflects && !(first && interior) {
            continue;
        }
        let path = level.paths[lane] as usize;
        let by = &mut back.points[lane];
        let mut by_t = 0.0;
        if first && interior {
            by_t = seen_backward(&tracer.lists, sums, &point, upstream[path], by);
        }
        let time = paths[path].time;
        let before = level.before[lane] as usize;
        back.throughputs_before[before] = back.throughputs[lane];
        back.rays_before[before] = point_backward(&tracer.lists, sums, &point, time, by, by_t);
    }
    back.swap();
}

/// Back over camera rays, with the light of the environment that they see.
#[apply(stage!)]
fn cameras_backward<'a>(
    tracer: &'a Tracer<'a>,
    paths: &'a [Path<'a>],
    walks: &'a Walks,
    upstream: &'a [&'a Seen],
    back: &'a Back,
    sums: &'a Sums<'a>,
) {
    let (lists, of) = (&tracer.lists, &tracer.wanted.of);
    let sky = of.sky || (of.camera && tracer.features.sky_map);
    for (i, path) in paths.iter().enumerate() {
        let ray = walks.cameras.get(i);
        let mut by = back.rays[i];
        if walks.list[i].seen == NOTHING {
            if !tracer.settings.interior || !sky {
                continue;
            }
            by.direction = sky_backward(lists, sums, ray.direction, upstream[i].radiance);
        }
        if of.camera {
            let mut gradient = CameraGradient::default();
            let pixel = middle_of(lists, path.numbers.path().0);
            let (origin, direction) = (by.origin, by.direction);
            (tracer.camera).ray_backward(&ray, pixel, origin, direction, &mut gradient);
            add_to_camera(sums, &gradient);
        }
    }
}

impl Back {
    /// Begins behind the last points of paths.
    fn begin(&mut self, lanes: usize) {
        self.step(lanes);
        self.swap();
    }

    /// Makes room for the derivatives by what comes before points.
    fn step(&mut self, before: usize) {
        self.throughputs_before.clear();
        self.throughputs_before.resize(before, V3::ZERO);
        self.rays_before.clear();
        self.rays_before.resize(before, RayGradient::default());
    }

    /// Goes on with what came before.
    fn swap(&mut self) {
        std::mem::swap(&mut self.throughputs, &mut self.throughputs_before);
        std::mem::swap(&mut self.rays, &mut self.rays_before);
    }
}
