//! Points of edges drawn as a point sees them, their derivatives, and their two sides: the faces seen there, the
//! surface behind, and paths that start from them.

use glam::DVec3;

use crate::accel::{Hit, HitRay, NOTHING};
use crate::kernel::edges::{Edge, EdgeSets, Kind, Root};
use crate::kernel::gradient::Sums;
use crate::kernel::surface::{Point, PointGradient};
use crate::kernel::view::View;
use crate::kernel::walk::{Path, Vertex, Walk, Walks};
use crate::model::choice::decided_by;
use crate::model::edge::{DirectionJump, TOUCHING, is_above};
use crate::model::edge_weight::Query;
use crate::model::jumps::{Sides, by_crossing_plane, farthest, half_beside, inside};
use crate::model::segment::{OnSegment, clip_to_cone, point_by_angle};
use crate::model::triangle::barycentric;
use crate::model::{Pair, V3};
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

    /// A point of a line in which two planes cross moves with both.
    fn add_to_crossing(&self, p: &EdgePoint, g: V3, time: f32, sums: &mut Sums) {
        let [k, l] = [p.edge.faces[0] as usize, p.edge.faces[1] as usize];
        let (t, s) = (&self.scene.triangles[k], &self.scene.triangles[l]);
        for (k, t, other) in [(k, t, s.normal), (l, s, t.normal)] {
            if !self.wanted.objects[t.object as usize] {
                continue;
            }
            let at_rest = p.position - self.scene.shift(k as u32, time);
            let weights = barycentric(t.corners, t.normal, t.area, at_rest);
            let by_plane = by_crossing_plane(t.normal, other, g);
            self.add_to_corners(k, weights, by_plane, time, sums);
        }
    }
}

impl View {
    /// The faces of an edge that are seen on its two sides, the second towards `side`.
    pub(super) fn sides(&self, p: &EdgePoint, view: V3, side: V3, time: f32) -> Sides {
        let mut sides = Sides::new(p.edge.along, view, side);
        for &face in &p.edge.faces {
            if face == NOTHING || self.is_open_at(face, p.position, time) {
                continue;
            }
            // On the line, where the face was at rest.
            let on_line = if p.edge.apart {
                p.position - self.scene.shift(face, time)
            } else {
                p.edge.a
            };
            let [a, b, c] = self.scene.triangles[face as usize]
                .corners
                .map(|c| c - on_line);
            let inward = farthest(a, b, c, p.edge.along);
            sides.add(face, inward, p.edge.along, view);
            if p.edge.kind == Kind::Crossing {
                sides.add(face, -inward, p.edge.along, view);
            }
        }
        sides.pass(p.to, p.position);
        sides
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
        for (face, across) in [(sides.minus, -sides.across), (sides.plus, sides.across)] {
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
        if sides.minus != NOTHING && sides.plus != NOTHING {
            self.pair(&mut walks.list);
        }
    }

    /// The point of a face of an edge right beside the edge's point, seen along a direction. The line of a crossing
    /// divides the face: of its halves the one towards `across` is seen.
    fn beside(&self, p: &EdgePoint, (face, across): (u32, V3), view: V3, time: f32) -> Point {
        let tri = &self.scene.triangles[face as usize];
        let inward = if p.edge.kind == Kind::Crossing {
            half_beside(tri.normal, p.edge.along, across)
        } else {
            let [a, b, c] = tri.corners;
            (a + b + c) * (1.0 / 3.0) + self.scene.shift(face, time) - p.position
        };
        let t = p.to.length();
        self.scene
            .point_at(face, inside(p.position, inward), t, view, time)
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
