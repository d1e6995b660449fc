//! Jumps of the light of lights without extent: edges of their shadows, which cones blur.

use super::edge_point::Observer;
use crate::accel::{HitRay, NOTHING};
use crate::kernel::gradient::Sums;
use crate::kernel::surface::PointGradient;
use crate::kernel::view::View;
use crate::model::V3;
use crate::model::cone::{Bend, cone_density};
use crate::model::edge::{direction_jump, mirrored};
use crate::model::jumps::towards_light;

impl View {
    /// Adds the derivatives by jumps of the light of a light without extent, times `carried`. Edges are drawn in the
    /// cone about the direction to it. That direction is where it is, so that what is left of the integral over those of
    /// an emitter ([`crate::model::edge`]) is the density with which it would be drawn about the edge's.
    pub(super) fn delta_edges(
        &self,
        o: &Observer,
        (light, carried): (usize, V3),
        numbers: [f32; 2],
        by: &mut PointGradient,
        sums: &mut Sums,
    ) {
        let moves = self.wanted.moving_lights[light];
        let tree = o.sets.seen_by(o.moves || moves);
        if self.cone == 0.0 || tree.is_empty() {
            return;
        }
        let (point, time) = (&o.vertex.point, o.path.time);
        let delta = &self.scene.emitters.lights()[light];
        let seen = delta.seen_from(point.position);
        let arrives = point.shading.evaluate(seen.direction) * delta.strength * seen.scale;
        let carried = carried.dot(arrives);
        if carried == 0.0 {
            return;
        }
        let query = towards_light(point.position, time, seen.direction, self.cone);
        let Some(p) = self.edge_point(o, &tree, &query, numbers) else {
            return;
        };
        let normal = point.shading.outer(seen.direction);
        if p.to.dot(normal) <= 0.0 {
            return;
        }
        let (start, view) = (point.start(seen.direction), p.to.normalize());
        // A ray comes to the edge's point straight, or mirrored at the surface.
        for is_mirrored in [false, true] {
            let image = if is_mirrored {
                mirrored(p.to, normal)
            } else {
                p.to
            };
            let density = cone_density(seen.direction, image, self.cone);
            if density == 0.0 {
                continue;
            }
            let bend = Bend {
                offset: V3::ZERO,
                mirrored: is_mirrored,
                direction: seen.direction,
            };
            let jump = direction_jump(p.to, p.edge.along, &bend, normal);
            let sides = self.sides(&p, view, jump.side, time);
            // Light passes on one side or on none.
            let sign = match [sides.minus, sides.plus].map(|face| face == NOTHING) {
                [true, false] => 1.0,
                [false, true] => -1.0,
                _ => return,
            };
            let limit = delta.target(&seen).limit(start, sides.past);
            if p.to.length() >= limit {
                return;
            }
            let ray = HitRay {
                unseen: p.edge.faces,
                ..HitRay::new(start, sides.past, time, limit)
            };
            if self.hit_seen::<true>(&ray).triangle != NOTHING {
                return;
            }
            let scale = carried * density * sign * p.per_density;
            self.edge_point_backward(&p, &jump, (point, time), scale, by, sums);
            let by_axis = jump.edge.by_axis * scale;
            let found = delta.backward(&seen, 0.0, by_axis);
            by.position -= found.position;
            if moves {
                sums.lights[light].add(&found);
            }
        }
    }
}
