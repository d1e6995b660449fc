//! Edge searches from points of a path: edges of emitters' shadows, and edges in the light that surfaces reflect.

use crate::cube::*;

use super::lights::{GroupChoice, choose_group, emitters_of};
use super::scene::{CONE, FOLLOWING, GROUP, Scene};
use super::sums::Sums;
use super::surface::{Point, receiver_of};
use crate::model::bsdf::Lobe;
use crate::model::edge_weight::Query;
use crate::model::jumps::{LobeSearch, of_lobe, towards_group, towards_light};
use crate::model::lists::vector;
use crate::model::{Four, V3};
use crate::sampling::Receiver;

/// The part of searches by points that rest, and of samples on the film, that goes to edges that rest, too.
pub const RARELY: f32 = 0.125;

/// A point of a path from which edges are searched.
#[apply(record!)]
pub struct Observer {
    pub point: Point,
    pub bounce: u32,
    /// Whether it moves, or its search directions turn.
    pub moves: bool,
    /// The derivative of the loss with respect to the light leaving the point, times the path's throughput. Each
    /// search has its share of it.
    pub carried: V3,
    /// Mean number of searches.
    pub searches: f32,
}

#[cfg_attr(feature = "gpu", cube)]
impl Observer {
    /// Returns the observer for each of `most` searches.
    #[inline(always)]
    pub fn part(self, most: u32) -> Observer {
        let mut part = self;
        part.carried = part.carried * (1.0 / most as f32);
        part.searches = part.searches / most as f32;
        part
    }
}

/// A search for an edge, and the use of its result.
#[apply(record!)]
pub struct Search {
    pub query: Query,
    pub lobe: Lobe,
    /// Whether it is made.
    pub is_made: bool,
    /// Whether it is for the light of emitters.
    pub of_light: bool,
    /// Whether it draws from all edges, and whether only those that rest count then.
    pub moves: bool,
    pub of_resting: bool,
    /// Whether directions follow the material.
    pub follows: bool,
    /// Random numbers for the point on the edge, and for the blur of the cone.
    pub u: f32,
    pub v: f32,
    pub cone_u: f32,
    pub cone_v: f32,
    /// Factor of the light's derivative.
    pub scale: f32,
    pub of_gloss: bool,
    /// The emitters whose shadow edges are searched.
    pub first: u32,
    pub past: u32,
    /// Whether that is a delta light.
    pub is_light: bool,
}

/// Returns whether a search of a point is made, for an edge of the light of emitters or of reflected light, by a
/// uniform number. Its probability is min(1, `searches`).
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn looks_for_edges(scene: &Scene, bounce: u32, searches: f32, of_light: bool, u: f32) -> bool {
    // At the end of a path only the environment is visible.
    let sees = comptime!(scene.features.sees_sky || scene.features.gathers_map);
    u < min(searches, 1.0) && (of_light || bounce < scene.bounces || sees)
}

/// Returns a search for an edge of the light of emitters or of reflected light, for the four uniform numbers `drawn`;
/// a search for emitters' light also uses two of `more`. `room` is working memory for the choice of an emitter.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn search(
    scene: &Scene,
    drawn: Four,
    more: Four,
    o: &Observer,
    of_light: bool,
    time: f32,
    room: &mut [u32],
    sums: &Sums,
) -> Search {
    let rate = min(o.searches, 1.0);
    let x = o.point.position;
    let shading = o.point.shading;
    let tangent = scene.settings[CONE];
    let mut s = Search {
        query: towards_light(x, time, shading.geometric, tangent),
        lobe: Lobe::whole(shading.geometric),
        is_made: false,
        of_light,
        moves: o.moves,
        of_resting: false,
        follows: false,
        u: drawn.y,
        v: drawn.z,
        cone_u: drawn.w,
        cone_v: drawn.w,
        scale: 1.0f32,
        of_gloss: false,
        first: 0u32,
        past: 1u32,
        is_light: false,
    };
    if of_light {
        if comptime!(scene.features.emitters) {
            s.is_made = looks_for_edges(scene, o.bounce, o.searches, true, more.y);
            s.cone_v = more.x;
            if s.is_made {
                let at: Receiver = receiver_of(&o.point, time);
                let grouped = comptime!(sums.of.grouped);
                let choice: GroupChoice = choose_group(scene, drawn.x, &at, room, grouped);
                s.first = choice.first;
                s.past = choice.past;
                s.moves = select(choice.moves, true, s.moves);
                s.scale = 1.0 / rate * (1.0 / choice.chance);
                s.is_light = emitters_of(scene).is_light(s.first);
                if s.is_light {
                    if comptime!(scene.features.of_emitters.lights) {
                        let seen = emitters_of(scene).light(s.first).seen_from(x);
                        s.query = towards_light(x, time, seen.direction, tangent);
                        // Without a cone, the edge of its shadow is not a boundary of any integral.
                        s.is_made = tangent > 0.0 && seen.scale > 0.0;
                    }
                } else {
                    let of = &scene.groups[(GROUP * choice.group) as usize..];
                    let to = vector(of, 0u32) + vector(of, 4u32) * time - x;
                    let radius = of[3];
                    s.query = towards_group(&shading, x, time, to, radius, tangent);
                }
            }
        }
    } else {
        s.is_made = looks_for_edges(scene, o.bounce, o.searches, false, drawn.x);
        if comptime!(sums.of.turns) {
            s.moves = true;
        }
        if s.is_made {
            let found: LobeSearch = of_lobe(&shading, x, time, drawn.x / rate, tangent);
            s.query = found.query;
            // Rays of the last bounce end at surfaces.
            s.follows = scene.follows();
            if o.bounce >= scene.bounces {
                s.follows = false;
            }
            if comptime!(scene.features.glossy) && s.follows && shading.scatters_evenly() {
                s.query.following = scene.settings[FOLLOWING];
            }
            s.lobe = found.lobe;
            s.of_gloss = found.of_gloss;
            s.scale = 1.0 / rate / found.chance;
            s.cone_u = found.cone_u;
        }
        let rests = s.follows && !s.moves;
        if comptime!(sums.of.objects && scene.features.glossy) && rests {
            // Edges that rest jump before material that moves and is followed.
            s.of_resting = s.u < RARELY;
            s.moves = s.of_resting;
            let chance = select(s.of_resting, RARELY, 1.0 - RARELY);
            s.u = select(s.of_resting, s.u, s.u - RARELY) / chance;
            s.scale /= chance;
        }
    }
    s
}
