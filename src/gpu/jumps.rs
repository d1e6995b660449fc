//! Jumps of the light that arrives at a point of a path, in a thread of a GPU.
//!
//! Calls are inlined in a kernel, so shadows of emitters and reflected light take turns in one loop.

use crate::cube::*;

use super::camera::{Beginning, SEED_OF_EDGES, SEED_OF_SIDES, sampler};
use super::hit::{Ray, trace};
use super::side_light::{Approach, light_beside};
use crate::kernel::{DrawnEdge, NO_EDGE, Root, draw_edge};
use crate::model::choice::decided_by;
use crate::sampling::Dimensions;
use crate::trace::{
    Behind, EdgeView, Jump, NONE, Observer, PointGradient, Scene, Search, Sums, edge_point,
    edge_view, hides, jump_at, reflected_backward, search, shadow_backward,
};

/// Words of a tree over edges ([`Scene::edge_trees`]).
pub(super) const OF_TREE: u32 = 6;

/// A tree over edges: the first over all, the second over those that move.
#[cube]
fn root_of<'a>(scene: &Scene<'a>, tree: u32, #[comptime] has_nodes: bool) -> Root<'a> {
    let list = &scene.edge_trees[(OF_TREE * tree) as usize..];
    Root::<'a> {
        nodes: &scene.edge_nodes[list[0] as usize..],
        children: &scene.edge_children[list[1] as usize..],
        leaves: &scene.edge_leaves[list[2] as usize..],
        edges: &scene.edges_of_leaves[list[3] as usize..],
        start: list[4],
        count: list[5],
        has_nodes,
        moves: comptime!(scene.features.moves),
    }
}

/// Adds the derivatives by jumps at edges seen from a point of a path. `edges` and `choice` are room for drawing an edge
/// and for the choice of an emitter.
#[cube]
pub(super) fn jumps_seen_from(
    scene: &Scene,
    stack: &mut [u32],
    edges: &mut [u32],
    choice: &mut [u32],
    sums: &Sums,
    path: &Beginning,
    o: &Observer,
    by: &mut PointGradient,
) {
    let numbers = sampler(scene, SEED_OF_EDGES).stream(path.numbers.pixel, path.numbers.sample);
    let time = path.time;
    let last = o.bounce >= scene.bounces;
    let mut turn = 1u32;
    if comptime!(scene.features.emitters) {
        turn = 0u32;
    }
    while turn < 2 {
        let of_light = turn == 0;
        let drawn = numbers.draw(scene.points, Dimensions::of_set(3 * o.bounce + 2 * turn));
        let mut more = drawn;
        if of_light {
            more = numbers.draw(scene.points, Dimensions::of_set(3 * o.bounce + 1));
        }
        turn += 1;
        let s: Search = search(scene, drawn, more, o, of_light, time, choice, sums);
        let mut tree = 0u32;
        if !s.moves {
            tree = 1u32;
        }
        let root = root_of(scene, tree, comptime!(sums.of.edge_nodes));
        if s.asked && root.count > 0 {
            let drawn: DrawnEdge = draw_edge(&root, edges, &s.query, decided_by(s.u, s.v));
            let mut edge = 0u32;
            let mut per_chance = 0.0f32;
            if drawn.edge != NO_EDGE {
                edge = drawn.edge;
                per_chance = drawn.per_chance;
            }
            let p = edge_point(scene, edge, per_chance, &s.query, &o.point.shading, s.v);
            let e: EdgeView = edge_view(scene, o, &s, p);
            let mut k = e.first;
            while k < e.past {
                let jump: Jump = jump_at(scene, o, &s, &e, k, time);
                if jump.limit > 0.0 {
                    let ray = Ray {
                        origin: e.start,
                        direction: jump.sides.past,
                        time,
                        from: 0.0f32,
                        limit: jump.limit,
                    };
                    let hit = trace(scene, stack, ray, p.faces, of_light, true);
                    if of_light {
                        if hit.triangle == NONE {
                            shadow_backward(scene, sums, o, &s, &e, &jump, time, by);
                        }
                    } else if !hides(scene, hit.triangle, hit.t, &p, time) {
                        let approach = Approach {
                            point: p,
                            origin: e.start,
                            view: e.view,
                            sides: jump.sides,
                            behind: Behind {
                                triangle: hit.triangle,
                                distance: hit.t,
                            },
                        };
                        let sides = sampler(scene, SEED_OF_SIDES);
                        let numbers = sides.stream(path.numbers.pixel, path.numbers.sample);
                        let beginning = Beginning {
                            numbers,
                            cones: path.cones,
                            film: numbers.draw(scene.points, Dimensions::direction(o.bounce)),
                            time,
                            ray: path.ray,
                        };
                        let next = o.bounce + 1;
                        let light = light_beside(
                            scene, stack, choice, beginning, next, !last, &approach, false,
                        );
                        reflected_backward(scene, sums, o, &s, &e, &jump, &light, time, by);
                    }
                }
                k += 1;
            }
        }
    }
}
