//! The light on both sides of edge points, from paths that begin there.

use macro_rules_attribute::apply;

use crate::accel::{Hit, HitRay, NOTHING, stage};
use crate::kernel::path::draw_emitters;
use crate::kernel::view::{Tracer, View};
use crate::kernel::walk::{Kept, Path, PathBlock, Walks, Work};
use crate::model::bsdf::normals_differ;
use crate::model::{Pair, V3};
use crate::sampling::Stream;
use crate::trace::{Approach, Point, Seen, beside, emitted, hides, is_crease, point_at, sky};

impl Approach {
    /// Returns a ray past the edge that ignores the edge's faces.
    #[inline(always)]
    pub(super) fn ray(&self, time: f32, limit: f32) -> HitRay {
        let faces = self.point.faces;
        HitRay {
            unseen: [faces.a, faces.b, faces.c, faces.d],
            ..HitRay::new(self.origin, self.sides.past, time, limit)
        }
    }
}

/// The paths beside an edge: one on its − side, one on its + side, and at a crease two more with mirrored first
/// directions.
const WALKS: usize = 4;

/// Computes the hits of rays past edges. It is separate from the function for paths so that compilers inline both.
pub(super) fn find_beside<const ANY: bool>(view: &View, work: &mut Work) {
    let holes = view.scene.holes.as_deref();
    (view.scene.hierarchy).hits::<ANY, true>(view.arch, holes, &work.rays, &mut work.hits);
}

/// Stores the difference of the light on both sides of edge points in `work.side_lights`. Paths begin there at a
/// bounce, if one is given. With `film`, the difference includes what the camera sees directly. It is `None` where an
/// occluder hides the edge. Returns the number of rays.
pub(super) fn light_beside(
    tracer: &Tracer,
    approaches: &[Approach],
    (paths, cones): (&[Path], &[Stream]),
    bounce: Option<u32>,
    film: bool,
    work: &mut Work,
) -> f64 {
    let before = work.counts.rays;
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
        // The light on the − side of the edge minus the light on the + side.
        *light = minus.light;
        light.add(&plus.light, -1.0);
        if others[0].seen != NOTHING {
            let other = others[0].light.radiance - others[1].light.radiance;
            light.radiance = (light.radiance + other) * 0.5;
        }
    }
    work.side_walks = walks;
    approaches.len() as f64 + (work.counts.rays - before) as f64
}

/// Begins paths on both sides of edges that no occluder hides.
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
            // Paths on both sides of a matt crease take the same directions. Otherwise the same random numbers choose
            // directions about each face's own normal: lobes of neighboring faces hardly overlap, but weights are alike.
            let pair = Pair {
                first: minus.shading.normal,
                second: plus.shading.normal,
            };
            for point in [minus, plus] {
                point.shading.pair = pair;
                point.shading.paired = evenly;
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

/// Returns the surface point on one side of an edge point, or `None` if the environment is seen there.
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
