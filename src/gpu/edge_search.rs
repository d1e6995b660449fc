//! Where points of a path look for edges: those of the shadows of emitters, and those that surfaces reflect.
//! `kernel/boundary/vertex` and `kernel/boundary/reflected` in a kernel of a GPU.

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
use crate::model::cone::widened;
use crate::model::edge_weight::Query;
use crate::model::frame::SinCos;
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

/// Points count at least for this share of an average camera ray.
const LEAST: f32 = 0.05;
/// The probabilities with which edges of the lights' shadows and of reflected light are looked for at a point of a
/// path that counts as much as a camera ray does on average.
const RATE_OF_LIGHT: f32 = 0.25;
const RATE: f32 = 0.125;
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

/// The cone that a group of emitters fills, widened by that of the rays; the hemisphere if it is wider.
#[cube]
fn towards_group(scene: &Scene, group: u32, point: &Point, time: f32) -> Query {
    let at = scene.header[GROUPS] + GROUP_STRIDE * group;
    let to = scene.vector(at) + scene.vector(at + 4) * time - point.position;
    let distance = to.length();
    let radius = scene.floats[at as usize + 3];
    let sin = radius / distance.max(radius);
    let cos = (1.0 - sin * sin).max(0.0).sqrt();
    let half = widened(SinCos { sin, cos }, scene.settings[CONE]);
    let mut query = Query {
        x: point.position,
        time,
        axis: point.shading.outer(to),
        cos: 0.0f32,
        sin: 1.0f32,
        exponent: 0.0f32,
        shadows: true,
    };
    if half.cos > 0.0 {
        query.axis = to * (1.0 / distance);
        query.cos = half.cos;
        query.sin = half.sin;
    }
    query
}

/// The cone of rays to a light without extent.
#[cube]
fn towards_light(scene: &Scene, k: u32, x: V3, time: f32) -> Query {
    let half = widened(
        SinCos {
            sin: 0.0f32,
            cos: 1.0f32,
        },
        scene.settings[CONE],
    );
    Query {
        x,
        time,
        axis: delta_light(scene, k).seen_from(x).direction,
        cos: half.cos,
        sin: half.sin,
        exponent: 0.0f32,
        shadows: true,
    }
}

/// A query of a lobe.
#[cube]
fn within(lobe: &Lobe, x: V3, time: f32) -> Query {
    Query {
        x,
        time,
        axis: lobe.axis,
        cos: lobe.cos,
        sin: lobe.sin,
        exponent: lobe.exponent,
        shadows: false,
    }
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
    let counts = o.counts.max(LEAST);
    let last = o.bounce >= scene.header[BOUNCES];
    let mut turn = 2u32;
    if of_light {
        turn = 0u32;
    }
    let drawn = numbers.draw(scene.points, Dimensions::of_set(3 * o.bounce + turn));
    let mut of_gloss = false;
    let mut chance = 1.0f32;
    // Of light it is a cone about that, and no lobe.
    let mut rest = drawn.x;
    let rate = (RATE * counts).min(1.0);
    if !of_light {
        let choice = drawn.x / rate;
        let gloss = shading.gloss();
        // Beside the lobe's probability, the rest of the first number, uniform again.
        chance = (1.0 - gloss).max(1e-20);
        rest = (choice - gloss) / chance;
        if choice < gloss {
            of_gloss = true;
            chance = gloss;
            rest = choice / gloss;
        }
    }
    let lobe: Lobe = shading.lobe(of_gloss, rest, scene.settings[CONE]);
    let mut s = Search {
        query: within(&lobe, x, time),
        lobe,
        asked: false,
        moves: o.moves,
        u: drawn.y,
        v: drawn.z,
        cone_u: drawn.w,
        cone_v: drawn.w,
        scale: 1.0f32,
        of_gloss,
        first: 0u32,
        past: 1u32,
        is_light: false,
    };
    if of_light {
        if comptime!(scene.features.emitters) {
            let more = numbers.draw(scene.points, Dimensions::of_set(3 * o.bounce + 1));
            let rate = (RATE_OF_LIGHT * counts).min(1.0);
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
                        s.query = towards_light(scene, s.first, x, time);
                        s.asked = scene.settings[CONE] > 0.0;
                    }
                } else {
                    s.query = towards_group(scene, group, &o.point, time);
                }
            }
        }
    } else {
        let sees = comptime!(scene.features.sees_sky || scene.features.gathers_map);
        s.asked = drawn.x < rate && (!last || sees);
        if comptime!(of.turns) {
            s.moves = true;
        }
        s.scale = 1.0 / rate / (chance * lobe.chance);
        s.cone_u = lobe.rest.max(0.0).min(1.0);
    }
    s
}
