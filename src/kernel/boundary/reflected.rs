//! Edges that surfaces reflect: jumps of the light of other surfaces and of the environment.

use super::edge_point::Sides;
use super::edge_point::{EdgePoint, Observer};
use crate::accel::{Hit, NOTHING};
use crate::kernel::edges::Query;
use crate::kernel::gradient::Sums;
use crate::kernel::surface::PointGradient;
use crate::kernel::view::View;
use crate::kernel::walk::Path;
use crate::kernel::walk::Work;
use crate::model::V3;
use crate::model::cone::widened;
use crate::model::edge::direction_jump;
use crate::model::frame::SinCos;

/// The probability with which edges of reflected light are looked for at a point of a path that counts as
/// much as a camera ray does on average: half that of the lights' shadows, since it takes two more paths.
const RATE: f32 = 0.125;

/// Lobes of a greater half-angle are looked for over the whole hemisphere.
const WIDEST: f32 = 1.2;
/// The probability of the inner part of a lobe that is split.
const INNER: f32 = 0.75;

/// Directions within a cone or outside of it: lobes of facets have long tails.
struct Region {
    axis: V3,
    cos: f32,
    inside: bool,
    /// The probability with which it was chosen, and a uniform number that is left.
    chance: f32,
    rest: f32,
}

impl Region {
    /// Chooses a cone or what is outside of it.
    fn split(&mut self, axis: V3, cos: f32) {
        (self.axis, self.cos) = (axis, cos);
        self.inside = self.rest < INNER;
        (self.chance, self.rest) = if self.inside {
            (INNER, self.rest / INNER)
        } else {
            (1.0 - INNER, (self.rest - INNER) / (1.0 - INNER))
        };
    }

    fn holds(&self, direction: V3) -> bool {
        (direction.dot(self.axis) >= self.cos) == self.inside
    }
}

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
        let [pick, u, v, cone_v] = o.numbers.set(3 * o.bounce + 2);
        let rate = (RATE * o.counts).min(1.0);
        if pick >= rate || tree.is_empty() {
            return;
        }
        let lobe = pick / rate;
        let carried = o.carried * (1.0 / rate);
        let (point, time) = (&o.vertex.point, o.path.time);
        let shading = &point.shading;
        let gloss = shading.gloss();
        let of_gloss = lobe < gloss;
        // Beside the lobe's probability, the rest of the first number, uniform again.
        let (chance, cone_u) = if of_gloss {
            (gloss, lobe / gloss)
        } else {
            (1.0 - gloss, (lobe - gloss) / (1.0 - gloss))
        };
        let (query, region) = self.lobe_query(o, of_gloss, cone_u);
        let (chance, cone_u) = (chance * region.chance, region.rest);
        let Some(p) = self.edge_point(o, tree, &query, [u, v]) else {
            return;
        };
        let view = p.to.normalize();
        let outer = shading.outer(view);
        let bend = self.bend(view, outer, cone_u.clamp(0.0, 1.0), cone_v);
        let axis = bend.direction;
        let mut reflected = shading.evaluate(axis);
        if shading.glossy {
            reflected *= shading.share_of_lobe(axis, of_gloss);
        }
        if reflected == V3::ZERO || !region.holds(axis) {
            return;
        }
        let jump = direction_jump(p.to, p.edge.along, &bend, shading.geometric);
        let sides = self.sides(&p, view, jump.side);
        if last && !sides.faces.contains(&NOTHING) {
            return;
        }
        let Some(behind) = self.behind(&p, point.start(view), sides.past, time) else {
            return;
        };
        let light = self.light_beside(o, &p, &sides, behind, view, work);
        let scale = carried * reflected * (p.per_density / chance);
        let jumps = scale.dot(light.radiance[0] - light.radiance[1]);
        if jumps != 0.0 {
            self.edge_point_backward(&p, &jump, (point, time), jumps, by, sums);
            // Directions turn with the frame of the lobe.
            let scatter = shading.as_drawn(axis, of_gloss);
            shading.direction_backward(&scatter, jump.edge.by_axis * jumps, &mut by.shading);
        }
        let [minus, plus] = light.sky;
        if self.gathers_map && minus != plus {
            // Directions to a map stay where they are.
            let radiance = self.scene.sky.at(axis);
            let jumps = (carried * reflected).dot(radiance) * (p.per_density / chance);
            self.edge_point_backward(&p, &jump, (point, time), jumps * (minus - plus), by, sums);
        }
    }

    /// The hemisphere over a point, or the cone of its glossy lobe, widened by that of the rays; and the part of
    /// directions that are looked for there, chosen by a uniform number.
    fn lobe_query(&self, o: &Observer, of_gloss: bool, choice: f32) -> (Query, Region) {
        let point = &o.vertex.point;
        let shading = &point.shading;
        let mut region = Region {
            axis: V3::ZERO,
            cos: f32::MIN,
            inside: true,
            chance: 1.0,
            rest: choice,
        };
        let mut query = Query {
            x: point.position,
            time: o.path.time,
            axis: shading.normal,
            cos: 0.0,
            sin: 1.0,
            exponent: 1.0,
            shadows: false,
        };
        if let Some(lobe) = shading.lobe_of_facets(of_gloss) {
            query.axis = lobe.side;
            let cos = lobe.half_angle.cos();
            if lobe.half_angle < WIDEST {
                region.split(lobe.axis, cos);
                if region.inside {
                    query.axis = lobe.axis;
                    query.exponent = lobe.exponent;
                    self.narrow(&mut query, cos);
                }
            }
        } else if of_gloss && !shading.facets {
            query.axis = shading.mirror();
            query.exponent = shading.exponent;
            // The lobe has fallen to 1e-4 there.
            self.narrow(&mut query, (-9.2 / shading.exponent.max(1e-3)).exp());
        }
        (query, region)
    }

    /// Narrows a query to a cone, widened by that of the rays.
    fn narrow(&self, query: &mut Query, cos: f32) {
        let half = SinCos {
            sin: (1.0 - cos * cos).sqrt(),
            cos,
        };
        query.cos = widened(half, self.cone).cos.max(0.0);
        query.sin = (1.0 - query.cos * query.cos).sqrt();
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
