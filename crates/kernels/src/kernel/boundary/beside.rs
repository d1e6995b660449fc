//! The light on both sides of edge points, from paths that begin there.

use macro_rules_attribute::apply;

use crate::accel::{HitRay, NOTHING, stage};
use crate::kernel::path::draw_emitters;
use crate::kernel::view::{Tracer, View};
use crate::kernel::walk::{Kept, Path, PathBlock, Walks, Work};
use crate::model::bsdf::normals_differ;
use crate::model::{Pair, V3};
use crate::sampling::Stream;
use crate::trace::{
    Approach, Beside, LightBeside, Point, Scene, beside, emitted, hides, is_crease, point_at, sky,
};

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
    let after = bounce.unwrap_or(0);
    begin_beside(tracer, approaches, paths, film, after, &mut walks, work);
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
    let lists = &tracer.lists;
    let all = walks.list.as_chunks::<WALKS>().0;
    let lights = work.side_lights.iter_mut().zip(&work.besides);
    let of_edges = approaches.iter().zip(paths);
    for (((light, at), walks), (approach, path)) in lights.zip(all).zip(of_edges) {
        let Some(light) = light else { continue };
        let mirrors = walks[2].seen != NOTHING;
        for side in 0..2 {
            let mut seen = walks[side].light;
            if mirrors {
                seen.radiance = (seen.radiance + walks[2 + side].light.radiance) * 0.5;
            }
            light.add(lists, approach, &at[side], side == 1, &seen, 1.0, path.time);
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
    bounce: u32,
    walks: &'a mut Walks,
    work: &'a mut Work,
) {
    let lists = &tracer.lists;
    work.side_lights.clear();
    work.besides.clear();
    for (i, (approach, path)) in approaches.iter().zip(paths).enumerate() {
        let (hit, p) = (work.hits[i], &approach.point);
        let hidden = hides(lists, &hit, p, path.time);
        work.side_lights
            .push((!hidden).then_some(LightBeside::default()));
        let at = [false, true].map(|on_plus| beside(lists, approach, &hit, on_plus, path.time));
        work.besides.push(at);
        if hidden {
            continue;
        }
        let mut points = at.map(|at| point_beside(lists, &at, path.time, bounce));
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

/// Returns the surface point beside an edge point, or `None` if the environment is seen there.
#[inline(always)]
fn point_beside(lists: &Scene, at: &Beside, time: f32, bounce: u32) -> Option<Point> {
    let (k, near) = (at.triangle, at.near);
    if k == NOTHING {
        return None;
    }
    let (distance, direction) = (at.distance, at.direction);
    Some(point_at(lists, k, near, distance, direction, time, bounce))
}
