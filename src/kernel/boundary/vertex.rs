//! Jumps of the light that arrives at a point of a path.

use std::f32::consts::TAU;

use glam::DVec3;

use super::edges::{Edge, FACES, Kind};
use super::tree::{EdgeTree, Query};
use crate::accel::{Hit, HitRay, NOTHING};
use crate::kernel::View;
use crate::kernel::backward::PointGradient;
use crate::kernel::gradient::Sums;
use crate::kernel::path::{Path, Walk, glam3};
use crate::kernel::records::{Vertex, Work};
use crate::kernel::surface::Point;
use crate::model::V3;
use crate::model::bsdf::Scatter;
use crate::model::cone::{Bend, up_to_plane};
use crate::model::edge::{DirectionEdge, direction_edge, half_plane};
use crate::model::frame::to_local;
use crate::model::triangle::barycentric;

/// A point of an edge that is seen from a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct EdgePoint {
    pub edge: Edge,
    /// Where on the edge, from a to b, and over what density.
    pub lambda: f32,
    pub per_density: f32,
    /// From the point that sees it.
    pub to: V3,
    pub position: V3,
}

/// What is seen on the two sides of an edge's point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sides {
    /// The triangle of the edge that is seen on the − and + side, or [`NOTHING`] where one sees past it.
    pub faces: [u32; 2],
    /// The direction of a ray that passes the edge right beside it, on that side if there is one.
    pub past: V3,
}

/// What lies behind an edge's point within this share of coordinates touches it.
pub(super) const TOUCHING: f32 = 4e-6;
/// Points beside an edge are this far from it, over the largest coordinate.
const BESIDE: f32 = 2e-5;

/// The probability with which edges of the lights' shadows are looked for at a point of a path that counts
/// as much as a camera ray does on average; those that count for less are asked less often.
const LIGHT: f32 = 0.25;
/// The same of reflected light, which takes two more paths.
const REFLECTED: f32 = 0.125;
/// At least this share of it.
const LEAST: f32 = 0.05;

impl View {
    /// Adds what jumps at edges seen from a point of a path contribute, times `g`, whose channels add up
    /// to `typical` on average.
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
        sums: &mut Sums,
    ) {
        let Some(sets) = &self.edge_sets else {
            return;
        };
        let carried = g.times(vertex.throughput);
        let counts = carried.sum_abs() / typical;
        if counts.is_nan() || counts <= 0.0 {
            return;
        }
        let counts = counts.max(LEAST);
        let numbers = self.edges.numbers(path.numbers.path());
        let emitters = &self.scene.emitters;
        if !emitters.is_empty() {
            let [choice, u, v, w] = numbers.set(3 * bounce);
            let [extra, pick, ..] = numbers.set(3 * bounce + 1);
            let rate = (LIGHT * counts).min(1.0);
            if pick < rate {
                let carried = carried * (1.0 / rate);
                let x = vertex.point.position;
                let (group, chance) =
                    emitters.choose_group(x, path.time, choice, &mut work.chances);
                let light_moves = emitters.members(group).any(|k| {
                    let k = emitters.get(k).triangle as usize;
                    self.wanted.objects[self.scene.triangles[k].object as usize]
                });
                let tree = sets.seen_by(moves || light_moves);
                if !tree.is_empty() {
                    let carried = carried * (1.0 / chance);
                    let numbers = [u, v, w, extra];
                    self.light_edges(
                        path,
                        vertex,
                        (sets, tree),
                        group,
                        carried,
                        numbers,
                        by,
                        sums,
                    );
                }
            }
        }
        let last = bounce >= self.bounces;
        if !last || self.sees_sky || self.gathers_map {
            let tree = sets.seen_by(moves || self.wanted.turns());
            let [pick, u, v, w] = numbers.set(3 * bounce + 2);
            let rate = (REFLECTED * counts).min(1.0);
            if pick < rate && !tree.is_empty() {
                let lobe = pick / rate;
                let carried = carried * (1.0 / rate);
                let numbers = [lobe, u, v, w];
                self.reflected_edges(
                    path,
                    vertex,
                    bounce,
                    (sets, tree),
                    carried,
                    numbers,
                    work,
                    by,
                    sums,
                );
            }
        }
    }

    /// Jumps of the light of a group of emitters.
    #[allow(clippy::too_many_arguments)] // one place, called once
    fn light_edges(
        &self,
        path: &Path,
        vertex: &Vertex,
        (sets, tree): (&super::EdgeSets, &EdgeTree),
        group: usize,
        carried: V3,
        [u, v, cone_u, cone_v]: [f32; 4],
        by: &mut PointGradient,
        sums: &mut Sums,
    ) {
        let emitters = &self.scene.emitters;
        let point = &vertex.point;
        let x = point.position;
        let seen = &emitters.groups[group];
        let to = seen.centre + seen.velocity * path.time - x;
        let distance = to.length();
        // The cone that the group fills, widened by that of the rays.
        let sin = seen.radius / distance.max(seen.radius);
        let cos = (1.0 - sin * sin).max(0.0).sqrt();
        let wide = (1.0 + self.cone * self.cone).sqrt();
        let (cos, sin) = (
            (cos - sin * self.cone) / wide,
            (sin + cos * self.cone) / wide,
        );
        let (cos, sin) = if cos > 0.0 { (cos, sin) } else { (0.0, 1.0) };
        let mut query = Query {
            x,
            time: path.time,
            axis: to * (1.0 / distance),
            cos,
            sin,
            exponent: 0.0,
            shadows: true,
        };
        if cos == 0.0 {
            query.axis = point.shading.geometric;
        }
        let Some(p) = self.edge_point(sets, tree, &query, point.triangle, u, v) else {
            return;
        };
        let view = p.to.normalized();
        let bend = self.bend(view, point.shading.geometric, cone_u, cone_v);
        let axis = bend.direction;
        let shading = &point.shading;
        let reflected = shading.evaluate(axis);
        if reflected.is_zero() {
            return;
        }
        let jump = direction_jump(&p, &bend, point.shading.geometric);
        let sides = self.sides(&p, view, jump.side);
        // Light passes on one side or on none.
        let [minus, plus] = sides.faces;
        let sign = match (minus == NOTHING, plus == NOTHING) {
            (true, false) => 1.0,
            (false, true) => -1.0,
            _ => return,
        };
        let start = point.start();
        emitters.met(
            emitters.members(group),
            x,
            path.time,
            axis,
            |k, distance, [b, c]| {
                let e = emitters.get(k);
                if p.edge.faces.contains(&e.triangle) {
                    return;
                }
                let light = x + axis * distance;
                let limit = up_to_plane(start, sides.past, e.normal, light);
                if p.to.length() >= limit {
                    return;
                }
                let ray = HitRay {
                    origin: glam3(start),
                    direction: glam3(sides.past),
                    time: path.time,
                    from: 0.0,
                    limit,
                    unseen: p.edge.faces,
                };
                let hierarchy = &self.scene.hierarchy;
                if hierarchy.hit_seen::<true>(self.arch, &ray).triangle != NOTHING {
                    return;
                }
                let tri = &self.scene.triangles[e.triangle as usize];
                let emission = self.scene.materials[tri.material as usize].emission();
                let scale = carried.times(reflected).dot(emission) * sign * p.per_density;
                let by_axis = jump.edge.by_axis * scale;
                self.edge_point_backward(&p, &jump, scale, path.time, by, sums);
                // The axis points to a point of the light, which stays where it is on it.
                let by_to = by_axis.across(axis) * (1.0 / distance);
                by.position -= by_to;
                if self.wanted.objects[tri.object as usize] {
                    let weights = [1.0 - b - c, b, c];
                    self.add_to_corners(e.triangle as usize, weights, by_to, path.time, sums);
                }
            },
        );
    }

    /// Jumps of the light that surfaces reflect, and of an environment.
    #[allow(clippy::too_many_arguments)] // one place, called once
    fn reflected_edges(
        &self,
        path: &Path,
        vertex: &Vertex,
        bounce: u32,
        (sets, tree): (&super::EdgeSets, &EdgeTree),
        carried: V3,
        [lobe, u, v, w]: [f32; 4],
        work: &mut Work,
        by: &mut PointGradient,
        sums: &mut Sums,
    ) {
        let point = &vertex.point;
        let shading = &point.shading;
        let gloss = shading.gloss();
        let of_gloss = lobe < gloss;
        let chance = if of_gloss { gloss } else { 1.0 - gloss };
        let mut query = Query {
            x: point.position,
            time: path.time,
            axis: shading.normal,
            cos: 0.0,
            sin: 1.0,
            exponent: 1.0,
            shadows: false,
        };
        if of_gloss {
            query.axis = shading.mirror();
            query.exponent = shading.exponent;
            // Where the lobe has fallen to 1e-4.
            query.cos = (-9.2 / shading.exponent.max(1e-3)).exp();
            let wide = (1.0 + self.cone * self.cone).sqrt();
            query.sin = (1.0 - query.cos * query.cos).sqrt();
            query.cos = ((query.cos - query.sin * self.cone) / wide).max(0.0);
            query.sin = (1.0 - query.cos * query.cos).sqrt();
        }
        let Some(p) = self.edge_point(sets, tree, &query, point.triangle, u, v) else {
            return;
        };
        let view = p.to.normalized();
        // What is left of the first number, uniform again.
        let cone_u = if of_gloss {
            lobe / gloss
        } else {
            (lobe - gloss) / (1.0 - gloss)
        };
        let bend = self.bend(view, shading.geometric, cone_u.clamp(0.0, 1.0), w);
        let axis = bend.direction;
        let mut reflected = shading.evaluate(axis);
        if shading.glossy {
            reflected = reflected * shading.share_of_lobe(axis, of_gloss);
        }
        if reflected.is_zero() {
            return;
        }
        let jump = direction_jump(&p, &bend, shading.geometric);
        let sides = self.sides(&p, view, jump.side);
        let last = bounce >= self.bounces;
        if last && !sides.faces.contains(&NOTHING) {
            return;
        }
        let Some(behind) = self.behind(&p, point.start(), sides.past, path.time) else {
            return;
        };
        // The light of both sides, and whether a map is seen.
        let mut light = [V3::ZERO; 2];
        let mut sky = [0.0; 2];
        let mut walks = std::mem::take(&mut work.side_walks);
        walks.clear();
        for side in 0..2 {
            let mut walk = Walk::new();
            let face = sides.faces[side];
            let past = face == NOTHING;
            if past && behind.triangle == NOTHING {
                if self.sees_sky {
                    light[side] = self.scene.sky.at(view);
                }
                sky[side] = 1.0;
            } else if past {
                let start = point.start();
                walk.start(self.scene.point(behind, start, sides.past, path.time));
            } else {
                walk.start(self.beside(&p, face, view, path.time));
            }
            walks.list.push(walk);
        }
        if !sides.faces.contains(&NOTHING) {
            self.pair(&mut walks.list);
        }
        if !last {
            let path = Path {
                numbers: self.sides.numbers(path.numbers.path()),
                ..*path
            };
            self.reflected::<false>(&[path; 2], &mut walks, bounce + 1, work);
        }
        for (light, walk) in light.iter_mut().zip(&walks.list) {
            *light += walk.radiance;
        }
        work.side_walks = walks;
        let scale = carried.times(reflected) * (p.per_density / chance);
        let scale = scale.dot(light[0] - light[1]);
        if scale != 0.0 {
            self.edge_point_backward(&p, &jump, scale, path.time, by, sums);
            // Directions turn with the frame of the lobe.
            let by_axis = jump.edge.by_axis * scale;
            let axis_of_lobe = if of_gloss {
                shading.mirror()
            } else {
                shading.normal
            };
            let local = to_local(axis_of_lobe, axis);
            let turn = local.y.atan2(local.x) / TAU;
            let scatter = Scatter {
                direction: axis,
                local,
                of_gloss,
                u: local.z.max(0.0).powf(shading.exponent + 1.0),
                v: if turn < 0.0 { turn + 1.0 } else { turn },
                ..Scatter::default()
            };
            shading.direction_backward(&scatter, by_axis, &mut by.shading);
        }
        if self.gathers_map && sky[0] != sky[1] {
            // Directions to a map stay where they are.
            let radiance = self.scene.sky.at(axis);
            let scale = carried.times(reflected).dot(radiance) * (p.per_density / chance);
            self.edge_point_backward(&p, &jump, scale * (sky[0] - sky[1]), path.time, by, sums);
        }
    }

    /// An edge as it is at a time, but for its object's motion. None where there is none then.
    pub(super) fn edge_at(&self, edge: &Edge, time: f32) -> Option<Edge> {
        if !edge.apart {
            return Some(*edge);
        }
        let [k, l] = [edge.faces[0], edge.faces[1]];
        let [a, b] = super::crossings::segment(&self.scene, k, l, time)?;
        Some(Edge {
            a: a - self.scene.shift(k, time),
            along: b - a,
            ..*edge
        })
    }

    /// A point of an edge in a cone of directions.
    fn edge_point(
        &self,
        sets: &super::EdgeSets,
        tree: &EdgeTree,
        query: &Query,
        own: u32,
        u: f32,
        v: f32,
    ) -> Option<EdgePoint> {
        let (index, per_chance) = tree.sample(self.arch, query, u)?;
        let edge = self.edge_at(&sets.edges[index as usize], query.time)?;
        if edge.faces.contains(&own) {
            return None;
        }
        let shift = self.scene.shift(edge.faces[0], query.time);
        let a = edge.a + shift - query.x;
        let [from, to] = clip_to_cone(a, edge.along, query.axis, query.cos)?;
        // By the angle under which it is seen.
        let squared = edge.along.length_squared();
        let length = squared.sqrt();
        let nearest = -a.dot(edge.along) / squared;
        let away = (a + edge.along * nearest).length();
        if away <= 1e-7 * (a.length() + length) {
            return None;
        }
        let angle = |lambda: f32| ((lambda - nearest) * length / away).atan();
        let (first, last) = (angle(from), angle(to));
        let tangent = (first + (last - first) * v).tan();
        let lambda = (nearest + tangent * away / length).clamp(from, to);
        let per_density = (1.0 + tangent * tangent) * away / length * (last - first) * per_chance;
        let to = a + edge.along * lambda;
        (per_density > 0.0).then_some(EdgePoint {
            edge,
            lambda,
            per_density,
            to,
            position: query.x + to,
        })
    }

    /// The point of a face of an edge right beside the edge's point, seen along a direction: so far inside
    /// that no ray from it meets the other faces of the edge by rounding.
    pub(super) fn beside(&self, p: &EdgePoint, face: u32, view: V3, time: f32) -> Point {
        let [a, b, c] = self.scene.triangles[face as usize].corners;
        let middle = (a + b + c) * (1.0 / 3.0) + self.scene.shift(face, time);
        let inward = middle - p.position;
        let distance = inward.length().max(f32::MIN_POSITIVE);
        let step = (BESIDE * (0.1 + p.position.max_abs()) / distance).min(0.1);
        let t = p.to.length();
        self.scene
            .point_at(face, p.position + inward * step, t, view, time)
    }

    /// Where both sides of a crease are of one material, lets their paths go the same ways.
    pub(super) fn pair(&self, walks: &mut [Walk]) {
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

    /// Which faces of an edge are seen on its two sides, the second towards `side`.
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
        let step = BESIDE * (0.1 + p.position.max_abs()) * towards / across.length();
        Sides {
            faces,
            past: (p.to + across * step).normalized(),
        }
    }

    /// What lies behind an edge's point, seen from a point; None where something hides it.
    pub(super) fn behind(&self, p: &EdgePoint, start: V3, view: V3, time: f32) -> Option<Hit> {
        let ray = HitRay {
            origin: glam3(start),
            direction: glam3(view),
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
            if off.abs() > TOUCHING * (0.1 + p.position.max_abs()) {
                return None;
            }
        }
        Some(hit)
    }

    /// Adds the derivatives by an edge's point and by the point that sees it.
    fn edge_point_backward(
        &self,
        p: &EdgePoint,
        jump: &DirectionJump,
        scale: f32,
        time: f32,
        by: &mut PointGradient,
        sums: &mut Sums,
    ) {
        let mut by_to = jump.edge.by_point * scale;
        if let Some(normal) = jump.mirror {
            // r̃ = r − 2 (r·n) n.
            by.geometric -= by_to * (2.0 * p.to.dot(normal)) + p.to * (2.0 * by_to.dot(normal));
            by_to -= normal * (2.0 * by_to.dot(normal));
        }
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
            self.add_to_corners(k, weights, t.normal * g.dot(dual), time, sums);
        }
    }
}

/// How an edge's image moves across an axis.
struct DirectionJump {
    edge: DirectionEdge,
    /// Towards the + side, at the edge itself.
    side: V3,
    /// The normal of the surface at which the rays of the cone were mirrored.
    mirror: Option<V3>,
}

fn direction_jump(p: &EdgePoint, bend: &Bend, normal: V3) -> DirectionJump {
    let axis = bend.direction;
    if !bend.mirrored {
        let edge = direction_edge(p.to, p.edge.along, axis);
        return DirectionJump {
            edge,
            side: edge.across,
            mirror: None,
        };
    }
    // The axis sees the edge's mirror image.
    let mirror = |v: V3| v - normal * (2.0 * v.dot(normal));
    let edge = direction_edge(mirror(p.to), mirror(p.edge.along), axis);
    DirectionJump {
        edge,
        side: mirror(edge.across),
        mirror: Some(normal),
    }
}

/// The part of a segment a + λe that lies in a cone about an axis of a half-angle of at most 90°.
fn clip_to_cone(a: V3, e: V3, axis: V3, cos: f32) -> Option<[f32; 2]> {
    let (p, q) = (a.dot(axis), e.dot(axis));
    // Before the plane across the axis through the apex.
    let (mut from, mut to) = (0.0f32, 1.0f32);
    if q > 0.0 {
        from = from.max(-p / q);
    } else if q < 0.0 {
        to = to.min(-p / q);
    } else if p <= 0.0 {
        return None;
    }
    if cos > 0.0 {
        let square = cos * cos;
        let second = q * q - square * e.length_squared();
        let first = p * q - square * a.dot(e);
        let zeroth = p * p - square * a.length_squared();
        let discriminant = first * first - second * zeroth;
        if discriminant <= 0.0 {
            // All of the line or nothing.
            if second < 0.0 || zeroth < 0.0 {
                return None;
            }
        } else {
            let root = discriminant.sqrt();
            // The two roots without cancellation.
            let sum = -(first + root.copysign(first));
            let (mut low, mut high) = (sum / second, zeroth / sum);
            if low > high {
                std::mem::swap(&mut low, &mut high);
            }
            if second < 0.0 {
                from = from.max(low);
                to = to.min(high);
            } else if q > 0.0 {
                from = from.max(high);
            } else {
                to = to.min(low);
            }
        }
    }
    (from < to).then_some([from, to])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::v3;

    #[test]
    fn segments_clipped_to_cones() {
        let axis = v3(0.0, 0.0, 1.0);
        let inside = |a: V3, e: V3, cos: f32, l: f32| {
            let r = a + e * l;
            r.dot(axis) > cos * r.length()
        };
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 * 2.0 - 1.0
        };
        for i in 0..2000 {
            let a = v3(random(), random(), random());
            let e = v3(random(), random(), random()) * 2.0;
            let cos = [0.0, 0.3, 0.9, 0.999][i % 4];
            let found = clip_to_cone(a, e, axis, cos);
            for j in 0..200 {
                let l = (j as f32 + 0.5) / 200.0;
                let is = found.is_some_and(|[from, to]| from < l && l < to);
                let near =
                    found.is_some_and(|[from, to]| (l - from).abs().min((l - to).abs()) < 1e-3);
                assert!(
                    near || is == inside(a, e, cos, l),
                    "{a:?} {e:?} {cos} {l} {found:?}"
                );
            }
        }
    }
}
