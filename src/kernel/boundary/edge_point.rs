//! Points of edges drawn as a point sees them, their derivatives, and their two sides: the faces seen there, the
//! surface behind, and paths that start from them.

use glam::DVec3;

use crate::accel::{Hit, HitRay, NOTHING};
use crate::kernel::edges::{Edge, EdgeSets, FACES, Kind, Root};
use crate::kernel::gradient::Sums;
use crate::kernel::surface::{Point, PointGradient};
use crate::kernel::view::View;
use crate::kernel::walk::{Path, Vertex, Walk, Walks};
use crate::model::choice::decided_by;
use crate::model::edge::{DirectionJump, TOUCHING, half_plane, is_above};
use crate::model::edge_weight::Query;
use crate::model::segment::{OnSegment, clip_to_cone, point_by_angle};
use crate::model::triangle::barycentric;
use crate::model::{Pair, V2, V3};
use crate::sampling::Numbers;

/// A point of a path that looks at edges.
pub(super) struct Observer<'a> {
    pub path: &'a Path<'a>,
    pub vertex: &'a Vertex,
    pub bounce: u32,
    /// Whether it moves, or the directions that it looks in turn.
    pub moves: bool,
    /// The derivative of the loss by the light that leaves it, times the path's throughput.
    pub carried: V3,
    /// The sum of the channels of that, over the average of camera rays.
    pub counts: f32,
    pub numbers: Numbers<'a>,
    pub sets: &'a EdgeSets,
}

/// A point of an edge that is seen from a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct EdgePoint {
    pub edge: Edge,
    /// Its place on the edge, from a to b, and 1 over the density with which it was drawn.
    pub lambda: f32,
    pub per_density: f32,
    /// The vector from the point that sees it.
    pub to: V3,
    pub position: V3,
}

impl View {
    /// Draws a point of an edge in a cone of directions, above the surface that sees it.
    pub(super) fn edge_point(
        &self,
        o: &Observer,
        tree: &Root,
        query: &Query,
        [u, v]: [f32; 2],
    ) -> Option<EdgePoint> {
        let (index, per_chance) = tree.sample(self.arch, query, decided_by(u, v))?;
        let edge = o.sets.edges[index as usize].at_time(&self.scene, query.time)?;
        let shift = self.scene.shift(edge.faces[0], query.time);
        let a = edge.a + shift - query.x;
        let part = clip_to_cone(a, edge.along, query.axis, query.cos);
        if part.from >= part.to {
            return None;
        }
        let OnSegment {
            lambda,
            per_density,
        } = point_by_angle(a, edge.along, part, v);
        let per_density = per_density * per_chance;
        let to = a + edge.along * lambda;
        let position = query.x + to;
        (per_density > 0.0 && is_above(&o.vertex.point.shading, to, position)).then_some(
            EdgePoint {
                edge,
                lambda,
                per_density,
                to,
                position,
            },
        )
    }

    /// Adds the derivatives by an edge's point and by the point that sees it.
    pub(super) fn edge_point_backward(
        &self,
        p: &EdgePoint,
        jump: &DirectionJump,
        (point, time): (&Point, f32),
        scale: f32,
        by: &mut PointGradient,
        sums: &mut Sums,
    ) {
        let normal = point.shading.geometric;
        let by_to = jump.by_point(p.to, normal, scale, &mut by.geometric);
        by.position -= by_to;
        self.add_to_edge(p, by_to, time, sums);
    }

    /// Adds a derivative by an edge's point, to what the edge moves with.
    pub(super) fn add_to_edge(&self, p: &EdgePoint, g: V3, time: f32, sums: &mut Sums) {
        let edge = &p.edge;
        if edge.kind == Kind::Crossing {
            self.add_to_crossing(p, g, time, sums);
            return;
        }
        if !self.wanted.objects[edge.object as usize] {
            return;
        }
        for rows in edge.rows {
            for (row, w) in rows.into_iter().zip([1.0 - p.lambda, p.lambda]) {
                sums.vertices[row as usize] += DVec3::from(g * (0.5 * w));
            }
        }
        if self.wanted.velocities {
            sums.velocities[edge.object as usize] += DVec3::from(g * time);
        }
    }

    /// A point of a line in which two planes cross moves with both: n₁·dP and n₂·dP are those of the
    /// planes.
    fn add_to_crossing(&self, p: &EdgePoint, g: V3, time: f32, sums: &mut Sums) {
        let [k, l] = [p.edge.faces[0] as usize, p.edge.faces[1] as usize];
        let (t, s) = (&self.scene.triangles[k], &self.scene.triangles[l]);
        let cosine = t.normal.dot(s.normal);
        let inverse = 1.0 / (1.0 - cosine * cosine).max(1e-12);
        for (k, t, other) in [(k, t, s.normal), (l, s, t.normal)] {
            if !self.wanted.objects[t.object as usize] {
                continue;
            }
            let dual = (t.normal - other * cosine) * inverse;
            let at_rest = p.position - self.scene.shift(k as u32, time);
            let weights = barycentric(t.corners, t.normal, t.area, at_rest);
            let by_plane = t.normal * g.dot(dual);
            self.add_to_corners(k, weights, by_plane, time, sums);
        }
    }
}

/// The faces seen on the two sides of an edge's point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sides {
    /// The triangle of the edge that is seen on the − and + side, or [`NOTHING`] where one sees past it.
    pub faces: [u32; 2],
    /// Points from the − side to the + side, at a right angle to the edge and to the direction in which it is seen.
    across: V3,
    /// The direction of a ray that passes the edge right beside it, on that side if there is one.
    pub past: V3,
}

/// Points beside an edge are this far from it, over the largest coordinate.
const BESIDE: f32 = 2e-5;

impl View {
    /// The faces of an edge that are seen on its two sides, the second towards `side`.
    pub(super) fn sides(&self, p: &EdgePoint, view: V3, side: V3, time: f32) -> Sides {
        let mut faces = [NOTHING; 2];
        let mut least = [f32::INFINITY; 2];
        // Across the plane of the edge and the view, so that lateral places are comparable.
        let across = p.edge.along.cross(view);
        let across = across * if across.dot(side) < 0.0 { -1.0 } else { 1.0 };
        let mut halves = [(NOTHING, V3::ZERO); FACES];
        for (half, &face) in halves.iter_mut().zip(&p.edge.faces) {
            if face == NOTHING || self.is_open_at(face, p.position, time) {
                continue;
            }
            let corners = self.scene.triangles[face as usize].corners;
            // The corner that is farthest from the edge's line, on which its point is where the face was at rest.
            let on_line = if p.edge.apart {
                p.position - self.scene.shift(face, time)
            } else {
                p.edge.a
            };
            let from_a = corners.map(|c| c - on_line);
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
                let V2 {
                    x: lateral,
                    y: depth,
                } = half_plane(inward, p.edge.along, view, across);
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
            across,
            past: (p.to + across * step).normalize(),
        }
    }

    /// Whether a triangle has a hole at a point of it.
    fn is_open_at(&self, k: u32, position: V3, time: f32) -> bool {
        if self.scene.holes.is_none() {
            return false;
        }
        let t = &self.scene.triangles[k as usize];
        let at_rest = position - self.scene.shift(k, time);
        let weights = barycentric(t.corners, t.normal, t.area, at_rest);
        self.scene.is_open(k, weights)
    }

    /// The hit of a ray on all but its unseen triangles: the nearest, or with `ANY` any.
    pub(super) fn hit_seen<const ANY: bool>(&self, ray: &HitRay) -> Hit {
        let holes = self.scene.holes.as_deref();
        self.scene.hierarchy.hit_seen::<ANY>(self.arch, holes, ray)
    }

    /// The hit behind an edge's point, seen from a point; None where something hides the edge.
    pub(super) fn behind(&self, p: &EdgePoint, start: V3, view: V3, time: f32) -> Option<Hit> {
        let ray = HitRay {
            unseen: p.edge.faces,
            ..HitRay::new(start, view, time, f32::INFINITY)
        };
        let hit = self.hit_seen::<false>(&ray);
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
        for (&face, across) in sides.faces.iter().zip([-sides.across, sides.across]) {
            let mut walk = Walk::new();
            if face != NOTHING {
                walk.seen = face;
                walk.begin_at(self.beside(p, (face, across), view, time));
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
    /// that no ray from it meets the other faces of the edge by rounding. The line of a crossing divides the face:
    /// of its halves the one towards `across` is seen.
    fn beside(&self, p: &EdgePoint, (face, across): (u32, V3), view: V3, time: f32) -> Point {
        let tri = &self.scene.triangles[face as usize];
        let inward = if p.edge.kind == Kind::Crossing {
            let half = tri.normal.cross(p.edge.along);
            half * half.dot(across).signum()
        } else {
            let [a, b, c] = tri.corners;
            (a + b + c) * (1.0 / 3.0) + self.scene.shift(face, time) - p.position
        };
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
        let pair = Pair {
            first: minus.point.shading.normal,
            second: plus.point.shading.normal,
        };
        for walk in [minus, plus] {
            walk.point.shading.pair = pair;
            walk.point.shading.paired = true;
        }
    }
}
