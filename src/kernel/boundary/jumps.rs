//! Jumps of the light that arrives at points of paths, and the light beside edges.

use macro_rules_attribute::apply;

use crate::accel::{Hit, HitRay, NOTHING, stage};
use crate::kernel::backward::Return;
use crate::kernel::edges::{DrawnEdge, NO_EDGE, ROOM, Root, draw_edge};
use crate::kernel::eights::Eight;
use crate::kernel::path::{draw_emitters, drawn_by};
use crate::kernel::view::{Tracer, View};
use crate::kernel::walk::{Back, Kept, Level, Path, PathBlock, Walks, Work};
use crate::lanes::{LANES, Record};
use crate::model::bsdf::normals_differ;
use crate::model::choice::{Uniform, decided_by};
use crate::model::edge_weight::Query;
use crate::model::jumps::{SEARCH_SETS, counts_of, searches};
use crate::model::{Pair, V3};
use crate::sampling::{Dimensions, Four, Stream};
use crate::trace::{
    Approach, EdgeView, Jump, OF_EDGES, OF_SIDES, Observer, Point, Search, Seen, beside,
    edge_point, edge_view, emitted, hides, is_crease, jump_at, looks_for_edges, point_at,
    reflected_backward, sampler, search, shadow_backward, sky,
};

impl Approach {
    /// A ray past the edge, which does not see its faces.
    #[inline(always)]
    fn ray(&self, time: f32, limit: f32) -> HitRay {
        let faces = self.point.faces;
        HitRay {
            unseen: [faces.a, faces.b, faces.c, faces.d],
            ..HitRay::new(self.origin, self.sides.past, time, limit)
        }
    }
}

/// Paths beside an edge: on its − and + side, and at a crease two whose first directions are mirrored.
const WALKS: usize = 4;

/// A jump at an edge that the point in a lane sees.
struct Found {
    lane: usize,
    observer: Observer,
    search: Search,
    view: EdgeView,
    jump: Jump,
}

impl Found {
    fn approach(&self) -> Approach {
        self.view.approach(self.jump.sides)
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
                // Samples of a pixel lie side by side.
                Some(last) if last.pixel == pixel && last.sample < sample => {
                    last.after(sample - last.sample)
                }
                _ => sampler.stream(pixel, sample),
            });
        }
    }

    /// Adds the derivatives by jumps at edges seen from points of paths.
    pub(in crate::kernel) fn edges_backward(
        &self,
        level: &Level,
        bounce: u32,
        back: &mut Back,
        work: &mut Work,
    ) {
        let [reflections, shadows] = find_jumps(self, level, bounce, back, work);
        work.rays.clear();
        for found in &shadows {
            let time = self.path(level, found.lane).time;
            let ray = found.approach().ray(time, found.jump.limit);
            work.rays.push(ray);
        }
        find_beside::<true>(self, work);
        shadows_backward(self, &shadows, back, work);
        let approaches: Vec<Approach> = reflections.iter().map(Found::approach).collect();
        let sides = sampler(&self.lists, OF_SIDES);
        let beside = |found: &Found| {
            let path = self.path(level, found.lane);
            Path {
                numbers: sides.stream(path.numbers.pixel, path.numbers.sample),
                ..*path
            }
        };
        let beside: Vec<Path> = reflections.iter().map(beside).collect();
        let bounce = (bounce < self.settings.bounces).then_some(bounce + 1);
        let paths = (&*beside, self.cones);
        light_beside(self, &approaches, paths, bounce, false, work);
        reflections_backward(self, &reflections, &beside, back, work);
    }
}

/// The hits of rays past edges. Apart from those of paths, so that compilers inline both.
fn find_beside<const ANY: bool>(view: &View, work: &mut Work) {
    let holes = view.scene.holes.as_deref();
    (view.scene.hierarchy).hits::<ANY, true>(view.arch, holes, &work.rays, &mut work.hits);
}

/// Finds the light beside points of edges, of paths that begin there at a bounce if they go on; with `film` what the
/// camera sees of it. None where something hides the edge.
pub(super) fn light_beside(
    tracer: &Tracer,
    approaches: &[Approach],
    (paths, cones): (&[Path], &[Stream]),
    bounce: Option<u32>,
    film: bool,
    work: &mut Work,
) {
    work.rays.clear();
    for (approach, path) in approaches.iter().zip(paths) {
        let ray = approach.ray(path.time, f32::INFINITY);
        work.rays.push(ray);
    }
    find_beside::<false>(tracer, work);
    let mut walks = std::mem::take(&mut work.side_walks);
    walks.clear(WALKS * approaches.len());
    begin_beside(tracer, approaches, paths, film, &mut walks, work);
    if let Some(bounce) = bounce {
        let both: Vec<Path> = paths.iter().flat_map(|path| [*path; WALKS]).collect();
        let mut of = PathBlock {
            tracer,
            paths: &both,
            cones,
            bounce,
            kept: Kept::default(),
        };
        draw_emitters(&of, &mut walks.levels[0]);
        of.reflected(&mut walks, work);
    }
    let all = walks.list.as_chunks::<WALKS>().0;
    for (light, [minus, plus, others @ ..]) in work.side_lights.iter_mut().zip(all) {
        let Some(light) = light else { continue };
        // What is seen on the − side of the edge less that on the + side.
        *light = minus.light;
        light.add(&plus.light, -1.0);
        if others[0].seen != NOTHING {
            let other = others[0].light.radiance - others[1].light.radiance;
            light.radiance = (light.radiance + other) * 0.5;
        }
    }
    work.side_walks = walks;
}

/// Draws edges that points of paths see, and finds the jumps there of reflected light and of the light of emitters.
#[apply(stage!)]
fn find_jumps<'a>(
    to: &'a Return<'a>,
    level: &'a Level,
    bounce: u32,
    back: &'a Back,
    work: &'a mut Work,
) -> [Vec<Found>; 2] {
    let mut found = [Vec::new(), Vec::new()];
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
        let counts = counts_of(carried, to.typical, to.lists.samples_log);
        let reflects = level.points.lanes(lane).reflects[lane % LANES];
        if !reflects || counts.is_nan() || counts <= 0.0 {
            continue;
        }
        let time = to.time(level, lane);
        let observer = |count: u32| {
            let o = Observer {
                point: level.points.get(lane),
                bounce,
                moves: back.moves[bounce as usize][lane],
                carried,
                counts,
                searches: 1,
            };
            o.part(count)
        };
        for of_light in [true, false] {
            if !to.features.emitters && of_light {
                continue;
            }
            let count = searches(of_light, counts);
            for again in 0..count {
                let set = |k| Dimensions::of_set(3 * bounce + SEARCH_SETS * again + k);
                let more = match again {
                    0 => Four::get(&numbers[usize::from(of_light)], lane),
                    _ => stream(lane).numbers(set(if of_light { 1 } else { 2 })),
                };
                let pick = if of_light { more.y } else { more.x };
                if !looks_for_edges(&to.lists, bounce, counts, count, of_light, pick) {
                    continue;
                }
                let drawn = match of_light {
                    true => stream(lane).numbers(set(0)),
                    false => more,
                };
                let found = &mut found[usize::from(of_light)];
                let (o, numbers) = (observer(count), [drawn, more]);
                find_jump(to, (lane, time), o, of_light, numbers, work, found);
            }
        }
    }
    found
}

/// Adds the jumps at an edge that is drawn for a point.
#[inline(always)]
fn find_jump(
    to: &Return,
    (lane, time): (usize, f32),
    observer: Observer,
    of_light: bool,
    numbers: [Four; 2],
    work: &mut Work,
    found: &mut Vec<Found>,
) {
    let edge = seen_edge(to, time, &observer, of_light, numbers, work);
    let Some((search, view)) = edge else {
        return;
    };
    for k in view.first..view.past {
        let jump = jump_at(&to.lists, &observer, &search, &view, k);
        if jump.limit > 0.0 {
            found.push(Found {
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
    if !s.asked {
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

/// Draws an edge of a tree.
#[apply(stage!)]
fn draw<'a>(
    to: &'a Return<'a>,
    tree: &'a Root<'a>,
    query: &'a Query,
    random: Uniform,
) -> DrawnEdge {
    // Copies, so that compilers see that nothing writes them while edges are weighed, eight at once.
    let (tree, query) = (*tree, *query);
    draw_edge(&tree, &mut [0; ROOM], &query, random)
}

/// Adds the derivatives by jumps of the light of emitters, where nothing else hides it.
#[apply(stage!)]
fn shadows_backward<'a>(to: &'a Return<'a>, list: &'a [Found], back: &'a mut Back, work: &'a Work) {
    for (f, (ray, hit)) in list.iter().zip(work.rays.iter().zip(&work.hits)) {
        if hit.triangle == NOTHING {
            let (o, s, by) = (&f.observer, &f.search, &mut back.points[f.lane]);
            shadow_backward(&to.lists, to.sums, o, s, &f.view, &f.jump, ray.time, by);
        }
    }
}

/// Adds the derivatives by jumps of light that surfaces reflect, and of the environment.
#[apply(stage!)]
fn reflections_backward<'a>(
    to: &'a Return<'a>,
    list: &'a [Found],
    beside: &'a [Path],
    back: &'a mut Back,
    work: &'a Work,
) {
    for ((f, path), light) in list.iter().zip(beside).zip(&work.side_lights) {
        if let Some(light) = light {
            let (o, s, by) = (&f.observer, &f.search, &mut back.points[f.lane]);
            let (lists, sums, time) = (&to.lists, to.sums, path.time);
            reflected_backward(lists, sums, o, s, &f.view, &f.jump, light, time, by);
        }
    }
}

/// Begins paths on both sides of edges that nothing hides.
#[apply(stage!)]
fn begin_beside<'a>(
    tracer: &'a Tracer<'a>,
    approaches: &'a [Approach],
    paths: &'a [Path],
    film: bool,
    walks: &'a mut Walks,
    work: &'a mut Work,
) {
    let lists = &tracer.lists;
    work.side_lights.clear();
    for (i, (approach, path)) in approaches.iter().zip(paths).enumerate() {
        let (hit, p) = (work.hits[i], &approach.point);
        let hidden = hides(lists, &hit, p, path.time);
        work.side_lights.push((!hidden).then_some(Seen::default()));
        if hidden {
            continue;
        }
        let mut points = [
            point_beside(tracer, approach, &hit, false, path.time),
            point_beside(tracer, approach, &hit, true, path.time),
        ];
        let mut count = 2;
        if let [Some(minus), Some(plus)] = &mut points
            && is_crease(lists, &approach.sides)
        {
            let evenly = minus.shading.scatters_evenly() && plus.shading.scatters_evenly();
            // Paths on both sides of a crease go the same ways.
            let pair = Pair {
                first: minus.shading.normal,
                second: plus.shading.normal,
            };
            for point in [minus, plus] {
                point.shading.pair = pair;
                point.shading.paired = true;
            }
            if normals_differ(&pair) && evenly {
                count = WALKS;
            }
        }
        for k in 0..count {
            let (own, point) = (WALKS * i + k, &mut points[k % 2]);
            if let Some(point) = point {
                point.shading.mirrored = k >= 2;
                walks.list[own].see(point);
                let first = &mut walks.levels[0];
                first.points.set(first.len(), *point);
                first.add(own as u32, own as u32, V3::ONE);
            }
            let walk = &mut walks.list[own];
            match point {
                Some(point) if film => walk.light.radiance = emitted(lists, point),
                None if film || tracer.features.sees_sky => {
                    walk.light.radiance = sky(lists, approach.view);
                }
                _ => {}
            }
        }
    }
}

/// The surface point on a side of an edge's point; None where the environment is seen.
#[inline(always)]
fn point_beside(
    tracer: &Tracer,
    approach: &Approach,
    behind: &Hit,
    on_plus: bool,
    time: f32,
) -> Option<Point> {
    let lists = &tracer.lists;
    let at = beside(lists, approach, behind, on_plus, time);
    let (k, near) = (at.triangle, at.near);
    if k == NOTHING {
        return None;
    }
    Some(point_at(lists, k, near, at.distance, at.direction, time))
}
