//! Where points of a path look for edges: those of the shadows of emitters, and those that surfaces reflect.

use crate::cube::*;

use super::Derivatives;
use super::edge_layout::{GROUP_STRIDE, GROUPS, OF_GROUP, OF_GROUPS};
use super::emitter_choice::{GroupChoice, choose_group, site};
use super::layout::{BOUNCES, CONE};
use super::light::Site;
use super::light::{delta_light, is_light};
use super::reading::Scene;
use super::surface::Point;
use crate::model::V3;
use crate::model::bsdf::Lobe;
use crate::model::edge_weight::Query;
use crate::model::jumps::{
    LobeSearch, OF_REFLECTED, OF_SHADOWS, of_lobe, probability, towards_group, towards_light,
};
use crate::sampling::{Dimensions, Stream};

/// A point of a path that looks at edges.
#[apply(record!)]
pub(super) struct Observer {
    pub point: Point,
    pub bounce: u32,
    /// Whether it moves, or the directions that it looks in turn.
    pub moves: bool,
    /// The derivative of the loss by the light that leaves it, times the path's throughput.
    pub carried: V3,
    /// The sum of the channels of that, over the average of camera rays.
    pub counts: f32,
}

/// A search for an edge, and what is done with it.
#[apply(record!)]
pub(super) struct Search {
    pub query: Query,
    pub lobe: Lobe,
    pub asked: bool,
    pub moves: bool,
    /// For a point of the edge, and for the kernel of the cone.
    pub u: f32,
    pub v: f32,
    pub cone_u: f32,
    pub cone_v: f32,
    /// What the light's derivative is multiplied by.
    pub scale: f32,
    pub of_gloss: bool,
    /// Emitters whose shadow it is of.
    pub first: u32,
    pub past: u32,
    /// Whether that is a light without extent.
    pub is_light: bool,
}

/// A search for an edge of the light of emitters, or of reflected light.
#[cube]
pub(super) fn search(
    scene: &Scene,
    numbers: &Stream,
    o: &Observer,
    of_light: bool,
    time: f32,
    #[comptime] of: Derivatives,
) -> Search {
    let x = o.point.position;
    let shading = o.point.shading;
    let tangent = scene.settings[CONE];
    let last = o.bounce >= scene.header[BOUNCES];
    let mut turn = 2u32;
    if of_light {
        turn = 0u32;
    }
    let drawn = numbers.draw(scene.points, Dimensions::of_set(3 * o.bounce + turn));
    // Of light it is a cone about that, and no lobe.
    let rate = probability(OF_REFLECTED, o.counts);
    let reflected: LobeSearch = of_lobe(&shading, x, time, drawn.x / rate, tangent);
    let mut s = Search {
        query: reflected.query,
        lobe: reflected.lobe,
        asked: false,
        moves: o.moves,
        u: drawn.y,
        v: drawn.z,
        cone_u: drawn.w,
        cone_v: drawn.w,
        scale: 1.0f32,
        of_gloss: reflected.of_gloss,
        first: 0u32,
        past: 1u32,
        is_light: false,
    };
    if of_light {
        if comptime!(scene.features.emitters) {
            let more = numbers.draw(scene.points, Dimensions::of_set(3 * o.bounce + 1));
            let rate = probability(OF_SHADOWS, o.counts);
            s.asked = more.y < rate;
            s.cone_v = more.x;
            if s.asked {
                let mut group = 0u32;
                let mut p = 1.0f32;
                if comptime!(of.grouped) {
                    let at: Site = site(scene, x, shading.geometric, time);
                    let choice: GroupChoice = choose_group(scene, drawn.x, &at);
                    group = choice.group;
                    p = choice.chance;
                }
                let row = (scene.header[OF_GROUPS] + OF_GROUP * group) as usize;
                s.first = scene.words[row];
                s.past = s.first + scene.words[row + 1];
                if scene.words[row + 2] != 0 {
                    s.moves = true;
                }
                s.scale = 1.0 / rate * (1.0 / p);
                s.is_light = is_light(scene, s.first);
                if s.is_light {
                    if comptime!(scene.features.lights) {
                        let axis = delta_light(scene, s.first).seen_from(x).direction;
                        s.query = towards_light(x, time, axis, tangent);
                        s.asked = scene.settings[CONE] > 0.0;
                    }
                } else {
                    let at = scene.header[GROUPS] + GROUP_STRIDE * group;
                    let to = scene.vector(at) + scene.vector(at + 4) * time - x;
                    let radius = scene.floats[at as usize + 3];
                    s.query = towards_group(&shading, x, time, to, radius, tangent);
                }
            }
        }
    } else {
        let sees = comptime!(scene.features.sees_sky || scene.features.gathers_map);
        s.asked = drawn.x < rate && (!last || sees);
        if comptime!(of.turns) {
            s.moves = true;
        }
        s.scale = 1.0 / rate / reflected.chance;
        s.cone_u = reflected.cone_u;
    }
    s
}
