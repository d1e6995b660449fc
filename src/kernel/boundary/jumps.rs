//! Jumps of the light that arrives at points of paths, and the light beside edges.

use crate::accel::{Hit, HitRay, NOTHING};
use crate::kernel::view::Tracer;
use crate::kernel::walk::{Path, Vertex, Walk, Work};
use crate::model::choice::decided_by;
use crate::model::jumps::Sides;
use crate::model::{Pair, V3};
use crate::sampling::{Dimensions, Four};
use crate::trace::{
    Behind, EdgePoint, Observer, PointGradient, SideLight, Sums, beside, edge_point, edge_view,
    emitted, hides, is_crease, jump_at, looks_for_edges, point_at, reflected_backward, search,
    shadow_backward, sky,
};

/// A ray that comes to an edge's point, and the faces that are seen beside it.
pub(super) struct Approach<'a> {
    pub point: &'a EdgePoint,
    pub origin: V3,
    pub view: V3,
    pub sides: &'a Sides,
}

impl Tracer<'_> {
    /// Adds the derivatives by jumps at edges seen from a point of a path, times `g`, whose channels add up
    /// to `typical` on average.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)] // one place, called once
    pub(in crate::kernel) fn edges_backward(
        &self,
        path: &Path,
        vertex: &Vertex,
        bounce: u32,
        moves: bool,
        (g, typical): (V3, f32),
        work: &mut Work,
        by: &mut PointGradient,
        sums: &Sums,
    ) {
        let carried = g * vertex.throughput;
        let counts = carried.abs().element_sum() / typical;
        if counts.is_nan() || counts <= 0.0 {
            return;
        }
        let numbers = self.edges.numbers(path.numbers.path());
        for of_light in [true, false] {
            if !self.features.emitters && of_light {
                continue;
            }
            let set = Dimensions::of_set(3 * bounce + if of_light { 1 } else { 2 });
            let pair = numbers.draw(set);
            let pick = if of_light { pair.y } else { pair.x };
            if !looks_for_edges(&self.lists, bounce, counts, of_light, pick) {
                continue;
            }
            let mut drawn = pair;
            if of_light {
                drawn = numbers.draw(Dimensions::of_set(3 * bounce));
            }
            let observer = Observer {
                point: vertex.point,
                bounce,
                moves,
                carried,
                counts,
            };
            self.jumps(path, &observer, of_light, [drawn, pair], work, by, sums);
        }
    }

    /// Those of the light of emitters, or of reflected light.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)] // one place, called once
    fn jumps(
        &self,
        path: &Path,
        o: &Observer,
        of_light: bool,
        [drawn, more]: [Four; 2],
        work: &mut Work,
        by: &mut PointGradient,
        sums: &Sums,
    ) {
        let Some(sets) = &self.edge_sets else {
            return;
        };
        let (lists, time) = (&self.lists, path.time);
        let s = search(lists, drawn, more, o, of_light, time, &mut work.room, sums);
        if !s.asked {
            return;
        }
        let tree = sets.seen_by(s.moves);
        if tree.is_empty() {
            return;
        }
        let random = decided_by(s.u, s.v);
        let Some((edge, per_chance)) = tree.sample(self.arch, &s.query, random) else {
            return;
        };
        let p = edge_point(lists, edge, per_chance, &s.query, &o.point.shading, s.v);
        if p.per_density <= 0.0 {
            return;
        }
        let e = edge_view(lists, o, &s, p);
        for k in e.first..e.past {
            let jump = jump_at(lists, o, &s, &e, k, time);
            if jump.limit <= 0.0 {
                continue;
            }
            let ray = HitRay::new(e.start, jump.sides.past, time, jump.limit);
            if of_light {
                if self.hit_beside::<true>(ray, &p).triangle == NOTHING {
                    shadow_backward(lists, sums, o, &s, &e, &jump, time, by);
                }
                continue;
            }
            let approach = Approach {
                point: &p,
                origin: e.start,
                view: e.view,
                sides: &jump.sides,
            };
            let path = Path {
                numbers: self.sides.numbers(path.numbers.path()),
                ..*path
            };
            let goes_on = o.bounce < self.settings.bounces;
            let bounce = goes_on.then_some(o.bounce + 1);
            if let Some(light) = self.light_beside(&approach, &path, bounce, false, work) {
                reflected_backward(lists, sums, o, &s, &e, &jump, &light, time, by);
            }
        }
    }

    /// The hit of a ray on all but the faces of an edge: the nearest, or with `ANY` any.
    fn hit_beside<const ANY: bool>(&self, ray: HitRay, p: &EdgePoint) -> Hit {
        let unseen = [p.faces.a, p.faces.b, p.faces.c, p.faces.d];
        let ray = HitRay { unseen, ..ray };
        let holes = self.scene.holes.as_deref();
        self.scene.hierarchy.hit_seen::<ANY>(self.arch, holes, &ray)
    }

    /// The light beside an edge's point, of paths that begin there at a bounce if they go on; with `film` what the camera
    /// sees of it. None where something hides the edge.
    #[inline(always)]
    pub(super) fn light_beside(
        &self,
        approach: &Approach,
        path: &Path,
        bounce: Option<u32>,
        film: bool,
        work: &mut Work,
    ) -> Option<SideLight> {
        let (lists, time) = (&self.lists, path.time);
        let Approach {
            point: p,
            origin,
            view,
            sides,
        } = *approach;
        let ray = HitRay::new(origin, sides.past, time, f32::INFINITY);
        let hit = self.hit_beside::<false>(ray, p);
        if hides(lists, hit.triangle, hit.t, p, time) {
            return None;
        }
        let behind = Behind {
            triangle: hit.triangle,
            distance: hit.t,
        };
        let mut walks = std::mem::take(&mut work.side_walks);
        walks.clear();
        for on_plus in [false, true] {
            let at = beside(lists, p, sides, origin, &behind, on_plus, time);
            let mut walk = Walk::new();
            if at.triangle != NOTHING {
                let (k, near) = (at.triangle, at.near);
                walk.seen = k;
                walk.begin_at(point_at(lists, k, near, at.distance, at.direction, time));
                if film {
                    walk.radiance = emitted(lists, &walk.point);
                }
            } else if film || self.features.sees_sky {
                walk.radiance = sky(lists, view);
            }
            walks.list.push(walk);
        }
        if is_crease(lists, sides) {
            // Paths on both sides of a crease go the same ways.
            let pair = Pair {
                first: walks.list[0].point.shading.normal,
                second: walks.list[1].point.shading.normal,
            };
            for walk in &mut walks.list {
                walk.point.shading.pair = pair;
                walk.point.shading.paired = true;
            }
        }
        if let Some(bounce) = bounce {
            self.reflected::<false>(&[*path; 2], &mut walks, bounce, work);
        }
        let (minus, plus) = (&walks.list[0], &walks.list[1]);
        let sky_of = |walk: &Walk| if walk.seen == NOTHING { 1.0 } else { 0.0 };
        let light = SideLight {
            radiance: minus.radiance - plus.radiance,
            sky: sky_of(minus) - sky_of(plus),
            depth: minus.first.0 - plus.first.0,
            normal: minus.first.1 - plus.first.1,
        };
        work.side_walks = walks;
        Some(light)
    }
}
