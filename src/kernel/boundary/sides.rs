//! The two sides of an edge: the faces seen there, the surface behind, and paths that start from them.

use super::edge_point::EdgePoint;
use crate::accel::{Hit, HitRay, NOTHING};
use crate::kernel::edges::{FACES, Kind, TOUCHING};
use crate::kernel::surface::Point;
use crate::kernel::view::View;
use crate::kernel::walk::{Walk, Walks};
use crate::model::V3;
use crate::model::edge::half_plane;

/// The faces seen on the two sides of an edge's point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sides {
    /// The triangle of the edge that is seen on the − and + side, or [`NOTHING`] where one sees past it.
    pub faces: [u32; 2],
    /// The direction of a ray that passes the edge right beside it, on that side if there is one.
    pub past: V3,
}

/// Points beside an edge are this far from it, over the largest coordinate.
const BESIDE: f32 = 2e-5;

impl View {
    /// The faces of an edge that are seen on its two sides, the second towards `side`.
    pub(super) fn sides(&self, p: &EdgePoint, view: V3, side: V3) -> Sides {
        let mut faces = [NOTHING; 2];
        let mut least = [f32::INFINITY; 2];
        // Across the plane of the edge and the view, so that lateral places are comparable.
        let across = p.edge.along.cross(view);
        let across = across * if across.dot(side) < 0.0 { -1.0 } else { 1.0 };
        let mut halves = [(NOTHING, V3::ZERO); FACES];
        for (half, &face) in halves.iter_mut().zip(&p.edge.faces) {
            if face == NOTHING {
                continue;
            }
            let corners = self.scene.triangles[face as usize].corners;
            // The corner that is farthest from the edge's line.
            let from_a = corners.map(|c| c - p.edge.a);
            let far = from_a.map(|d| d.cross(p.edge.along).length_squared());
            let k = if far[0] >= far[1] && far[0] >= far[2] {
                0
            } else if far[1] >= far[2] {
                1
            } else {
                2
            };
            *half = (face, from_a[k]);
        }
        for &(face, inward) in halves.iter().filter(|h| h.0 != NOTHING) {
            let both = if p.edge.kind == Kind::Crossing { 2 } else { 1 };
            for inward in [inward, -inward].into_iter().take(both) {
                let [lateral, depth] = half_plane(inward, p.edge.along, view, across);
                let to = usize::from(lateral > 0.0);
                if depth < least[to] {
                    least[to] = depth;
                    faces[to] = face;
                }
            }
        }
        let towards = match faces {
            [NOTHING, _] => -1.0,
            [_, NOTHING] => 1.0,
            _ => 0.0,
        };
        let step = BESIDE * (0.1 + p.position.abs().max_element()) * towards / across.length();
        Sides {
            faces,
            past: (p.to + across * step).normalize(),
        }
    }

    /// The hit behind an edge's point, seen from a point; None where something hides the edge.
    pub(super) fn behind(&self, p: &EdgePoint, start: V3, view: V3, time: f32) -> Option<Hit> {
        let ray = HitRay {
            origin: start,
            direction: view,
            time,
            from: 0.0,
            limit: f32::INFINITY,
            unseen: p.edge.faces,
        };
        let hit = self.scene.hierarchy.hit_seen::<false>(self.arch, &ray);
        if hit.triangle != NOTHING && hit.t < p.to.length() {
            let tri = &self.scene.triangles[hit.triangle as usize];
            let at_rest = p.position - self.scene.shift(hit.triangle, time);
            let off = tri.normal.dot(at_rest) - tri.plane;
            if off.abs() > TOUCHING * (0.1 + p.position.abs().max_element()) {
                return None;
            }
        }
        Some(hit)
    }

    /// Starts the paths that see the two sides of an edge's point, from a ray's origin along `view`. One that
    /// meets no surface sees the environment.
    #[inline(always)]
    pub(super) fn walks_beside(
        &self,
        p: &EdgePoint,
        sides: &Sides,
        behind: Hit,
        (origin, view): (V3, V3),
        time: f32,
        walks: &mut Walks,
    ) {
        walks.clear();
        for &face in &sides.faces {
            let mut walk = Walk::new();
            if face != NOTHING {
                walk.seen = face;
                walk.begin_at(self.beside(p, face, view, time));
            } else if behind.triangle != NOTHING {
                walk.seen = behind.triangle;
                walk.begin_at(self.scene.point(behind, origin, sides.past, time));
            }
            walks.list.push(walk);
        }
        if !sides.faces.contains(&NOTHING) {
            self.pair(&mut walks.list);
        }
    }

    /// The point of a face of an edge right beside the edge's point, seen along a direction: so far inside
    /// that no ray from it meets the other faces of the edge by rounding.
    fn beside(&self, p: &EdgePoint, face: u32, view: V3, time: f32) -> Point {
        let [a, b, c] = self.scene.triangles[face as usize].corners;
        let middle = (a + b + c) * (1.0 / 3.0) + self.scene.shift(face, time);
        let inward = middle - p.position;
        let distance = inward.length().max(f32::MIN_POSITIVE);
        let step = (BESIDE * (0.1 + p.position.abs().max_element()) / distance).min(0.1);
        let t = p.to.length();
        self.scene
            .point_at(face, p.position + inward * step, t, view, time)
    }

    /// Lets the paths on both sides of a crease go the same ways if these are of one material.
    fn pair(&self, walks: &mut [Walk]) {
        let [minus, plus] = walks else { return };
        let material = |w: &Walk| self.scene.triangles[w.point.triangle as usize].material;
        if !(minus.on_surface && plus.on_surface) || material(minus) != material(plus) {
            return;
        }
        let pair = [minus.point.shading.normal, plus.point.shading.normal];
        for walk in [minus, plus] {
            walk.point.shading.pair = pair;
            walk.point.shading.paired = true;
        }
    }
}
