//! The backward pass over paths, level by level from their last points to the camera: derivatives with respect to
//! everything that they hit.

use std::ops::Deref;

use macro_rules_attribute::apply;

use super::pixels::PixelGradients;
use super::shares::SEARCHED;
use super::walk::{Back, Lanes, Level, PathBlock, Seen, Walks, Way, Work};
use crate::accel::{NOTHING, stage};
use crate::model::camera::CameraGradient;
use crate::model::connection::Target;
use crate::model::{V3, v2};
use crate::trace::{
    FilmSlopes, NONE, PointGradient, RayGradient, Sums, add_to_camera, follow_backward,
    follow_on_film, leave_backward, light_backward, map_backward, middle_of, point_backward,
    seen_backward, sky_backward, target_of,
};

/// Paths whose levels were kept, in the backward pass.
pub(super) struct Return<'a> {
    pub of: PathBlock<'a>,
    pub walks: &'a Walks,
    /// The derivatives of the loss with respect to the outputs of each path.
    pub upstream: &'a [&'a Seen],
    /// The derivatives of the loss with respect to all pixels, and their factor for a path. In forward mode there are none.
    pub around: Option<(&'a PixelGradients, f32)>,
    /// The average derivative of the loss with respect to the light of a camera ray.
    pub typical: f32,
    /// The number of searches of each kind that a point makes whose light counts as much as an average camera ray.
    pub searches: [f32; SEARCHED],
    pub sums: &'a Sums<'a>,
}

impl<'a> Deref for Return<'a> {
    type Target = PathBlock<'a>;

    #[inline(always)]
    fn deref(&self) -> &PathBlock<'a> {
        &self.of
    }
}

impl Return<'_> {
    /// Returns the derivative of the loss with respect to the light of a lane's path.
    #[inline(always)]
    pub fn by_light(&self, level: &Level, lane: usize) -> V3 {
        self.upstream[level.paths[lane] as usize].radiance
    }

    /// Returns the part of this derivative that belongs to a channel, and selects the sums of the channel.
    #[inline(always)]
    fn of_channel(&self, channel: usize, level: &Level, lane: usize) -> V3 {
        self.select(channel, level.paths[lane] as usize);
        self.sums.radiance_of(self.by_light(level, lane), channel)
    }

    /// Selects the sums for a channel of a path.
    #[inline(always)]
    pub fn select(&self, channel: usize, path: usize) {
        self.sums.select(self.paths[path].numbers.pixel, channel);
    }

    /// Returns the slope of the derivative of the loss at the film point of a path, whose pixel has the derivatives `g`.
    fn slopes(&self, path: usize, g: &Seen) -> FilmSlopes {
        let at = self.camera.film_point(&self.walks.cameras.get(path));
        let around = self.around.and_then(|(pixels, factor)| {
            let slopes = pixels.slopes(&self.lists, at)?;
            Some(slopes.times(factor))
        });
        around.unwrap_or_else(|| {
            let middle = middle_of(&self.lists, self.paths[path].numbers.pixel);
            let mut own = FilmSlopes::default();
            own.add(&self.lists, g, v2(at.x - middle.x, at.y - middle.y));
            own
        })
    }

    /// Goes back along the paths and adds the derivatives of the light of each path, times its upstream gradient.
    pub fn go_back(&self, work: &mut Work) {
        work.yields.paths += std::mem::take(&mut work.counts.rays) as f64;
        let mut back = std::mem::take(&mut work.back);
        let walks = self.walks;
        let jumps = self.wanted.of.jumps;
        if jumps {
            find_moving(self, &mut back);
            self.begin_edges(&mut back.edges);
        }
        let channels = self.sums.channels();
        back.channels.resize_with(channels, Lanes::default);
        for lanes in &mut back.channels {
            // Nothing comes after the last points.
            lanes.step(walks.levels[walks.depth - 1].len());
            lanes.swap();
        }
        for at in (0..walks.depth).rev() {
            let level = &walks.levels[at];
            for (channel, lanes) in back.channels.iter_mut().enumerate() {
                lanes.points.clear();
                lanes.points.resize(level.len(), PointGradient::default());
                ways_backward(self, channel, level, lanes);
                if self.settings.interior {
                    lights_backward(self, channel, level, lanes);
                }
            }
            if jumps {
                self.edges_backward(level, at as u32, &mut back, work);
            }
            let before = match at {
                0 => self.paths.len(),
                _ => walks.levels[at - 1].len(),
            };
            for (channel, lanes) in back.channels.iter_mut().enumerate() {
                lanes.step(before);
                let from = at.checked_sub(1).map(|before| &walks.levels[before]);
                points_backward(self, channel, level, from, lanes);
            }
        }
        for (channel, lanes) in back.channels.iter().enumerate() {
            cameras_backward(self, channel, lanes);
        }
        work.counts.rays = 0;
        work.back = back;
    }
}

/// Marks the points that move, and the points from which the next rays turn. Points behind a marked point are marked,
/// too.
#[apply(stage!)]
fn find_moving<'a>(to: &'a Return<'a>, back: &'a mut Back) {
    let walks = to.walks;
    let of = &to.wanted.of;
    back.moves.resize_with(walks.depth, Vec::new);
    for (at, level) in walks.levels[..walks.depth].iter().enumerate() {
        let (before, rest) = back.moves.split_at_mut(at);
        let moves = &mut rest[0];
        moves.clear();
        for lane in 0..level.len() {
            let followed = match before.last() {
                Some(before) => of.turns || before[level.before[lane] as usize],
                None => of.camera,
            };
            let point = level.points.get(lane);
            moves.push(followed || to.lists.is_wanted(point.object));
        }
    }
}

/// The backward pass of the rays with which paths leave their points.
#[apply(stage!)]
fn ways_backward<'a>(to: &'a Return<'a>, channel: usize, level: &'a Level, back: &'a mut Lanes) {
    for lane in 0..level.len() {
        let (by_next, by_leaving) = (back.throughputs[lane], back.rays[lane]);
        back.throughputs[lane] = V3::ZERO;
        if level.ways[lane] == Way::Ends {
            continue;
        }
        let left = level.leavings.get(lane);
        let escaped = level.ways[lane] == Way::Escaped && to.settings.interior;
        let by_light = to.of_channel(channel, level, lane);
        back.throughputs[lane] = leave_backward(
            &to.lists,
            to.sums,
            &level.points.get(lane),
            &level.scatters.get(lane),
            &left.bend,
            left.survival,
            escaped,
            level.throughputs.get(lane),
            by_next,
            by_leaving,
            by_light,
            &mut back.points[lane],
        );
    }
}

/// The backward pass of light from emitters, delta lights and environment maps.
#[apply(stage!)]
fn lights_backward<'a>(to: &'a Return<'a>, channel: usize, level: &'a Level, back: &'a mut Lanes) {
    let lists = &to.lists;
    for light in &level.lights {
        let lane = light.lane as usize;
        let (g, time) = (
            to.of_channel(channel, level, lane),
            to.path(level, lane).time,
        );
        let (point, carried) = (&level.points.get(lane), level.throughputs.get(lane));
        let (k, weights, arrived) = (light.emitter, light.weights, light.arrived);
        let (by, sums) = (&mut back.points[lane], to.sums);
        back.throughputs[lane] += if k == NONE {
            let target = Target::of_map(light.direction);
            map_backward(lists, sums, point, target, arrived, carried, g, by)
        } else {
            let target = target_of(lists, k, weights, point.position, time, false);
            light_backward(
                lists, sums, point, k, weights, target, arrived, carried, time, g, by,
            )
        };
    }
}

/// The backward pass from points to the rays that reached them, from the points of a level before or from cameras.
#[apply(stage!)]
fn points_backward<'a>(
    to: &'a Return<'a>,
    channel: usize,
    level: &'a Level,
    from: Option<&'a Level>,
    back: &'a mut Lanes,
) {
    let interior = to.settings.interior;
    let first = from.is_none();
    for lane in 0..level.len() {
        let point = level.points.get(lane);
        // Light ends at surfaces that do not reflect.
        let seen = first && interior;
        if !point.reflects && !seen {
            continue;
        }
        let path = level.paths[lane] as usize;
        let (by, sums) = (&mut back.points[lane], to.sums);
        to.select(channel, path);
        let mut by_t = 0.0;
        if seen {
            let upstream = sums.of_channel(to.upstream[path], channel);
            by_t = seen_backward(&to.lists, sums, &point, &upstream, by);
        }
        let time = to.paths[path].time;
        let before = level.before[lane] as usize;
        back.throughputs_before[before] = back.throughputs[lane];
        let mut by_ray = point_backward(&to.lists, sums, &point, time, by, by_t);
        let (upstream, by_light) = (to.upstream[path], back.throughputs[lane]);
        if let Some(from) = from {
            let (x, throughput) = (from.points.get(before), level.throughputs.get(lane));
            let g = sums.radiance_of(upstream.radiance, channel);
            by_ray = follow_backward(
                &to.lists, sums, &x, &point, throughput, by_light, g, time, by_ray,
            );
        } else if interior {
            let (c, ray) = (&to.camera, &to.walks.cameras.get(path));
            let g = &sums.of_channel(upstream, channel);
            if to.lists.follows_on_film() && to.lists.is_followed(point.material) {
                let slopes = &to.slopes(path, g);
                let radiance = to.walks.list[path].light.radiance;
                follow_on_film(
                    &to.lists, sums, c, ray, &point, g, slopes, radiance, time, &by_ray,
                );
            }
        }
        back.rays_before[before] = by_ray;
    }
    back.swap();
}

/// The backward pass of camera rays, and of the light of the environment that they see.
#[apply(stage!)]
fn cameras_backward<'a>(to: &'a Return<'a>, channel: usize, back: &'a Lanes) {
    let (lists, of) = (&to.lists, &to.wanted.of);
    let sky = of.sky || (of.camera && to.features.sky_map);
    for (i, path) in to.paths.iter().enumerate() {
        let ray = to.walks.cameras.get(i);
        let (mut by, sums) = (back.rays[i], to.sums);
        to.select(channel, i);
        if to.walks.list[i].seen == NOTHING {
            if !to.settings.interior || !sky {
                continue;
            }
            let by_light = sums.radiance_of(to.upstream[i].radiance, channel);
            by.direction = sky_backward(lists, sums, ray.direction, by_light);
        }
        if of.camera {
            let mut gradient = CameraGradient::default();
            let pixel = middle_of(lists, path.numbers.pixel);
            let (origin, direction) = (by.origin, by.direction);
            (to.camera).ray_backward(&ray, pixel, origin, direction, &mut gradient);
            add_to_camera(sums, &gradient);
        }
    }
}

impl Lanes {
    /// Makes room for the derivatives of the previous level.
    fn step(&mut self, before: usize) {
        self.throughputs_before.clear();
        self.throughputs_before.resize(before, V3::ZERO);
        self.rays_before.clear();
        self.rays_before.resize(before, RayGradient::default());
    }

    /// Continues with the derivatives of the previous level.
    fn swap(&mut self) {
        std::mem::swap(&mut self.throughputs, &mut self.throughputs_before);
        std::mem::swap(&mut self.rays, &mut self.rays_before);
    }
}
