//! Jumps of the light that arrives at points of paths.

use macro_rules_attribute::apply;

use super::beside::{find_beside, light_beside};
use crate::accel::{NOTHING, stage};
use crate::kernel::backward::Return;
use crate::kernel::edges::{DrawnEdge, NO_EDGE, ROOM, Root, draw_edge};
use crate::kernel::eights::Eight;
use crate::kernel::path::drawn_by;
use crate::kernel::shares::{IN_GLOSS, REFLECTED, SEARCH, SHADOWS};
use crate::kernel::walk::{Back, Level, Path, Work};
use crate::lanes::{LANES, Record};
use crate::model::Four;
use crate::model::choice::{Uniform, decided_by};
use crate::model::edge_weight::Query;
use crate::model::jumps::{SEARCH_SETS, counts_of, mean_searches, most_searches};
use crate::sampling::{Dimensions, Stream};
use crate::trace::{
    Approach, EdgeView, Jump, OF_EDGES, OF_SIDES, Observer, Point, Search, edge_point, edge_view,
    jump_at, looks_for_edges, reflected_backward, sampler, search, shadow_backward,
};

/// A jump at an edge that the point of a lane sees.
struct EdgeJump {
    lane: usize,
    observer: Observer,
    search: Search,
    view: EdgeView,
    jump: Jump,
}

impl EdgeJump {
    fn approach(&self) -> Approach {
        (self.view).approach(&self.observer, &self.search, self.jump.sides)
    }
}

impl Return<'_> {
    /// Begins the random numbers for edges of all paths.
    pub(in crate::kernel) fn begin_edges(&self, edges: &mut Vec<Stream>) {
        let sampler = sampler(&self.lists, OF_EDGES);
        edges.clear();
        for path in self.paths {
            let (pixel, sample) = (path.numbers.pixel, path.numbers.sample);
            edges.push(match edges.last() {
                // Samples of a pixel are contiguous.
                Some(last) if last.pixel == pixel && last.sample < sample => {
                    last.after(sample - last.sample)
                }
                _ => sampler.stream(pixel, sample),
            });
        }
    }

    /// Adds the derivatives from jumps at edges that points of paths see.
    pub(in crate::kernel) fn edges_backward(
        &self,
        level: &Level,
        bounce: u32,
        back: &mut Back,
        work: &mut Work,
    ) {
        let [reflections, shadows] = find_jumps(self, level, bounce, back, work);
        work.rays.clear();
        for shadow in &shadows {
            let time = self.path(level, shadow.lane).time;
            let ray = shadow.approach().ray(time, shadow.jump.limit);
            work.rays.push(ray);
        }
        find_beside::<true>(self, work);
        let squares = shadows_backward(self, level, &shadows, back, work);
        work.yields.edges[SHADOWS].add(squares, shadows.len() as f64);
        let approaches: Vec<Approach> = reflections.iter().map(EdgeJump::approach).collect();
        let sides = sampler(&self.lists, OF_SIDES);
        let beside = |reflection: &EdgeJump| {
            let path = self.path(level, reflection.lane);
            Path {
                numbers: sides.stream(path.numbers.pixel, path.numbers.sample),
                ..*path
            }
        };
        let beside: Vec<Path> = reflections.iter().map(beside).collect();
        let bounce = (bounce < self.settings.bounces).then_some(bounce + 1);
        let paths = (&*beside, self.cones);
        let rays = light_beside(self, &approaches, paths, bounce, false, work);
        let rays_each = rays / reflections.len().max(1) as f64;
        reflections_backward(self, level, &reflections, &beside, rays_each, back, work);
    }
}

/// Draws edges that points of paths see, and computes their jumps of reflected light and of the light of emitters.
#[apply(stage!)]
fn find_jumps<'a>(
    to: &'a Return<'a>,
    level: &'a Level,
    bounce: u32,
    back: &'a Back,
    work: &'a mut Work,
) -> [Vec<EdgeJump>; 2] {
    let mut jumps = [Vec::new(), Vec::new()];
    let mut numbers = [Eight::<Four>::default(); 2];
    for lane in 0..level.len() {
        let stream = |lane: usize| &back.edges[level.paths[lane] as usize];
        if lane % LANES == 0 {
            let lanes = lane..level.len().min(lane + LANES);
            numbers = [2, 1].map(|k| {
                let set = Dimensions::of_set(3 * bounce + k);
                drawn_by(stream, lanes.clone(), set)
            });
        }
        let carried = to.by_light(level, lane) * level.throughputs.get(lane);
        let counts = counts_of(carried, to.typical);
        let reflects = level.points.lanes(lane).reflects[lane % LANES];
        if !reflects || counts.is_nan() || counts <= 0.0 {
            continue;
        }
        let time = to.time(level, lane);
        let observer = |searches: f32, count: u32| {
            let o = Observer {
                point: level.points.get(lane),
                bounce,
                moves: back.moves[bounce as usize][lane],
                carried,
                searches,
            };
            o.part(count)
        };
        for of_light in [true, false] {
            if !to.features.emitters && of_light {
                continue;
            }
            let kind = if of_light {
                SHADOWS
            } else {
                kind_of_reflection(&level.points.get(lane))
            };
            let mean = mean_searches(to.searches[kind], counts);
            let count = most_searches(mean);
            for again in 0..count {
                let set = |k| Dimensions::of_set(3 * bounce + SEARCH_SETS * again + k);
                let more = match again {
                    0 => Four::get(&numbers[usize::from(of_light)], lane),
                    _ => stream(lane).numbers(set(if of_light { 1 } else { 2 })),
                };
                let pick = if of_light { more.y } else { more.x };
                let chance = mean / count as f32;
                if !looks_for_edges(&to.lists, bounce, chance, of_light, pick) {
                    continue;
                }
                work.yields.edges[kind].cost += SEARCH;
                let drawn = match of_light {
                    true => stream(lane).numbers(set(0)),
                    false => more,
                };
                let jumps = &mut jumps[usize::from(of_light)];
                let (o, numbers) = (observer(mean, count), [drawn, more]);
                find_jump(to, (lane, time), o, of_light, numbers, work, jumps);
            }
        }
    }
    jumps
}

/// Draws an edge for a point and adds the jumps at it.
#[inline(always)]
fn find_jump(
    to: &Return,
    (lane, time): (usize, f32),
    observer: Observer,
    of_light: bool,
    numbers: [Four; 2],
    work: &mut Work,
    jumps: &mut Vec<EdgeJump>,
) {
    let edge = seen_edge(to, time, &observer, of_light, numbers, work);
    let Some((search, view)) = edge else {
        return;
    };
    for k in view.first..view.past {
        let jump = jump_at(&to.lists, &observer, &search, &view, k);
        if jump.limit > 0.0 {
            jumps.push(EdgeJump {
                lane,
                observer,
                search,
                view,
                jump,
            });
        }
    }
}

/// Draws an edge that a point sees, for the light of emitters or for reflected light.
#[inline(always)]
fn seen_edge(
    to: &Return,
    time: f32,
    o: &Observer,
    of_light: bool,
    [drawn, more]: [Four; 2],
    work: &mut Work,
) -> Option<(Search, EdgeView)> {
    let (lists, room) = (&to.lists, &mut work.room);
    let s = search(lists, drawn, more, o, of_light, time, room, to.sums);
    if !s.is_made {
        return None;
    }
    let tree = to.edge_sets.as_ref()?.seen_by(s.moves);
    if tree.count == 0 {
        return None;
    }
    let random = decided_by(s.u, s.v);
    let DrawnEdge { edge, per_chance } = draw(to, &tree, &s.query, random);
    if edge == NO_EDGE {
        return None;
    }
    let p = edge_point(lists, edge, per_chance, &s.query, &o.point.shading, s.v);
    (p.per_density > 0.0).then(|| (s, edge_view(lists, o, &s, p)))
}

/// Draws an edge from a tree.
#[apply(stage!)]
fn draw<'a>(
    to: &'a Return<'a>,
    tree: &'a Root<'a>,
    query: &'a Query,
    random: Uniform,
) -> DrawnEdge {
    // With copies, compilers see that nothing writes to them while the weights of eight edges are computed at once.
    let (tree, query) = (*tree, *query);
    draw_edge(&tree, &mut [0; ROOM], &query, random)
}

/// Adds the derivatives from jumps of the light of emitters, where no other occluder blocks it. Returns the sum of the
/// squared derivatives with respect to points of edges.
#[apply(stage!)]
fn shadows_backward<'a>(
    to: &'a Return<'a>,
    level: &'a Level,
    list: &'a [EdgeJump],
    back: &'a mut Back,
    work: &'a Work,
) -> f64 {
    let mut squares = 0.0;
    for (f, (ray, hit)) in list.iter().zip(work.rays.iter().zip(&work.hits)) {
        if hit.triangle == NOTHING {
            let (o, s, time) = (&f.observer, &f.search, ray.time);
            for (channel, lanes) in back.channels.iter_mut().enumerate() {
                to.select(channel, level.paths[f.lane] as usize);
                let sums = to.sums;
                let (e, by) = (f.view.of_channel(sums, channel), &mut lanes.points[f.lane]);
                let largest = shadow_backward(&to.lists, sums, o, s, &e, &f.jump, time, by);
                squares += f64::from(largest).powi(2);
            }
        }
    }
    squares
}

/// Returns the kind of the edges that a point sees in reflected light.
#[inline(always)]
fn kind_of_reflection(point: &Point) -> usize {
    if point.shading.scatters_evenly() {
        REFLECTED
    } else {
        IN_GLOSS
    }
}

/// Adds the derivatives from jumps of light that surfaces reflect, and of the environment, and their variance and cost:
/// `rays` each.
#[apply(stage!)]
fn reflections_backward<'a>(
    to: &'a Return<'a>,
    level: &'a Level,
    list: &'a [EdgeJump],
    beside: &'a [Path],
    rays: f64,
    back: &'a mut Back,
    work: &'a mut Work,
) {
    for ((f, path), light) in list.iter().zip(beside).zip(&work.side_lights) {
        let mut squares = 0.0;
        if let Some(light) = light {
            let (o, s, j, time) = (&f.observer, &f.search, &f.jump, path.time);
            for (channel, lanes) in back.channels.iter_mut().enumerate() {
                to.select(channel, level.paths[f.lane] as usize);
                let sums = to.sums;
                let (e, by) = (f.view.of_channel(sums, channel), &mut lanes.points[f.lane]);
                let largest = reflected_backward(&to.lists, sums, o, s, &e, j, light, time, by);
                squares += f64::from(largest).powi(2);
            }
        }
        work.yields.edges[kind_of_reflection(&f.observer.point)].add(squares, rays);
    }
}
