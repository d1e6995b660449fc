//! Edges that surfaces reflect: jumps of the light of other surfaces and of the environment.

use super::edge_point::{EdgePoint, Observer};
use crate::accel::{Hit, NOTHING};
use crate::kernel::gradient::Sums;
use crate::kernel::surface::PointGradient;
use crate::kernel::view::View;
use crate::kernel::walk::Path;
use crate::kernel::walk::Work;
use crate::model::V3;
use crate::model::edge::direction_jump;
use crate::model::jumps::{OF_REFLECTED, Sides, of_lobe, probability};
use crate::sampling::Dimensions;

/// The light beside an edge, on its − and + side.
struct SideLight {
    radiance: [V3; 2],
    /// 1 where the environment is seen.
    sky: [f32; 2],
}

impl View {
    /// Adds the derivatives by jumps of the light that surfaces reflect, and of an environment.
    pub(super) fn reflected_edges(
        &self,
        o: &Observer,
        work: &mut Work,
        by: &mut PointGradient,
        sums: &mut Sums,
    ) {
        let last = o.bounce >= self.settings.bounces;
        if last && !self.sees_sky && !self.gathers_map {
            return;
        }
        let tree = o.sets.seen_by(o.moves || self.wanted.turns());
        let drawn = o.numbers.draw(Dimensions::of_set(3 * o.bounce + 2));
        let (pick, u, v, cone_v) = (drawn.x, drawn.y, drawn.z, drawn.w);
        let rate = probability(OF_REFLECTED, o.counts);
        if pick >= rate || tree.is_empty() {
            return;
        }
        let carried = o.carried * (1.0 / rate);
        let (point, time) = (&o.vertex.point, o.path.time);
        let shading = &point.shading;
        let s = of_lobe(shading, point.position, time, pick / rate, self.cone);
        let Some(p) = self.edge_point(o, &tree, &s.query, [u, v]) else {
            return;
        };
        let view = p.to.normalize();
        let outer = shading.outer(view);
        let bend = self.bend(view, outer, s.cone_u, cone_v);
        let axis = bend.direction;
        let mut reflected = shading.evaluate(axis);
        if shading.glossy {
            reflected *= shading.share_of_lobe(axis, s.of_gloss);
        }
        if reflected == V3::ZERO || !s.lobe.holds(axis) {
            return;
        }
        let jump = direction_jump(p.to, p.edge.along, &bend, shading.geometric);
        let sides = self.sides(&p, view, jump.side, time);
        if last && sides.minus != NOTHING && sides.plus != NOTHING {
            return;
        }
        let Some(behind) = self.behind(&p, point.start(view), sides.past, time) else {
            return;
        };
        let light = self.light_beside(o, &p, &sides, behind, view, work);
        let scale = carried * reflected * (p.per_density / s.chance);
        let jumps = scale.dot(light.radiance[0] - light.radiance[1]);
        if jumps != 0.0 {
            self.edge_point_backward(&p, &jump, (point, time), jumps, by, sums);
            // Directions turn with the frame of the lobe.
            let scatter = shading.as_drawn(axis, s.of_gloss);
            shading.direction_backward(&scatter, jump.edge.by_axis * jumps, &mut by.shading);
        }
        let [minus, plus] = light.sky;
        if self.gathers_map && minus != plus {
            // Directions to a map stay where they are.
            let radiance = self.scene.sky.at(axis);
            let jumps = (carried * reflected).dot(radiance) * (p.per_density / s.chance);
            self.edge_point_backward(&p, &jump, (point, time), jumps * (minus - plus), by, sums);
        }
    }

    /// The light that arrives beside an edge's point.
    fn light_beside(
        &self,
        o: &Observer,
        p: &EdgePoint,
        sides: &Sides,
        behind: Hit,
        view: V3,
        work: &mut Work,
    ) -> SideLight {
        let rays = (o.vertex.point.start(view), view);
        let mut walks = std::mem::take(&mut work.side_walks);
        self.walks_beside(p, sides, behind, rays, o.path.time, &mut walks);
        if o.bounce < self.settings.bounces {
            let path = Path {
                numbers: self.sides.numbers(o.path.numbers.path()),
                ..*o.path
            };
            self.reflected::<false>(&[path; 2], &mut walks, o.bounce + 1, work);
        }
        let mut light = SideLight {
            radiance: [V3::ZERO; 2],
            sky: [0.0; 2],
        };
        for (k, walk) in walks.list.iter().enumerate() {
            if !walk.on_surface {
                light.sky[k] = 1.0;
                if self.sees_sky {
                    light.radiance[k] = self.scene.sky.at(view);
                }
            }
            light.radiance[k] += walk.radiance;
        }
        work.side_walks = walks;
        light
    }
}
