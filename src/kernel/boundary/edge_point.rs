//! Points of edges drawn as a point sees them, and their derivatives.

use glam::DVec3;

use super::observer::Observer;
use crate::kernel::edges::{Edge, EdgeTree, Kind, Query};
use crate::kernel::gradient::Sums;
use crate::kernel::surface::PointGradient;
use crate::kernel::view::View;
use crate::model::V3;
use crate::model::cone::Bend;
use crate::model::edge::{DirectionEdge, direction_edge};
use crate::model::segment::{clip_to_cone, point_by_angle};
use crate::model::triangle::barycentric;

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

/// The motion of an edge's image across an axis.
pub(super) struct DirectionJump {
    pub edge: DirectionEdge,
    /// The direction towards the + side, at the edge itself.
    pub side: V3,
    /// The normal of the surface at which the rays of the cone were mirrored.
    mirror: Option<V3>,
}

pub(super) fn direction_jump(p: &EdgePoint, bend: &Bend, normal: V3) -> DirectionJump {
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

impl View {
    /// Draws a point of an edge in a cone of directions.
    pub(super) fn edge_point(
        &self,
        o: &Observer,
        tree: &EdgeTree,
        query: &Query,
        [u, v]: [f32; 2],
    ) -> Option<EdgePoint> {
        let (index, per_chance) = tree.sample(self.arch, query, u)?;
        let edge = o.sets.edges[index as usize].at_time(&self.scene, query.time)?;
        if edge.faces.contains(&o.vertex.point.triangle) {
            return None;
        }
        let shift = self.scene.shift(edge.faces[0], query.time);
        let a = edge.a + shift - query.x;
        let part = clip_to_cone(a, edge.along, query.axis, query.cos)?;
        let drawn = point_by_angle(a, edge.along, part, v)?;
        let per_density = drawn.per_density * per_chance;
        let to = a + edge.along * drawn.lambda;
        (per_density > 0.0).then_some(EdgePoint {
            edge,
            lambda: drawn.lambda,
            per_density,
            to,
            position: query.x + to,
        })
    }

    /// Adds the derivatives by an edge's point and by the point that sees it.
    pub(super) fn edge_point_backward(
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
            let by_plane = t.normal * g.dot(dual);
            self.scene
                .add_to_corners(k, weights, by_plane, time, &self.wanted, sums);
        }
    }
}
