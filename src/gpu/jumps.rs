//! Jumps of the light that arrives at a point of a path, in a thread of a GPU. The light beside edges comes from
//! paths that start on both sides: on the faces of the edge, or on the surface behind it.

use softray_kernels::cube::*;

use super::camera::Beginning;
use super::hit::{Memory, Ray, trace};
use super::job::Outputs;
use super::loss::Loss;
use super::packed::OF_TREE;
use super::path::light_of;
use super::records::Room;
use super::sums::of_channel;
use super::walk::Start;
use softray_kernels::accel::Hit;
use softray_kernels::kernel::{Blocks, DrawnEdge, NO_EDGE, Root, draw_edge};
use softray_kernels::model::bsdf::normals_differ;
use softray_kernels::model::choice::decided_by;
use softray_kernels::model::jumps::{SEARCH_SETS, mean_searches, most_searches, usual_searches};
use softray_kernels::model::{Four, Pair};
use softray_kernels::sampling::{Dimensions, Stream};
use softray_kernels::trace::{
    Approach, EdgeView, Jump, LightBeside, NONE, OF_EDGES, OF_SIDES, Observer, PointGradient,
    Scene, Search, Seen, Sums, beside, edge_point, edge_view, hides, is_crease, jump_at,
    looks_for_edges, point_at, reflected_backward, sampler, search, shadow_backward, sky, start_of,
};

/// Returns the mean number of searches of a point. `counts` is the size of the derivative that the point carries,
/// relative to a typical camera ray.
#[cube]
pub(super) fn searches_of(scene: &Scene, counts: f32, #[comptime] of_light: bool) -> f32 {
    mean_searches(usual_searches(of_light, scene.samples_log), counts)
}

/// The possible searches of a point, one after another: for shadow edges of emitters, or for edges in reflected
/// light.
#[apply(record!)]
pub(super) struct Searches {
    /// The number of possible searches so far, made or skipped.
    before: u32,
    /// The mean number of searches that are made.
    mean: f32,
    /// Whether another search is made, the maximum number of searches, the search's first set of random numbers, and the
    /// numbers by which it was decided.
    pub made: bool,
    pub count: u32,
    set: u32,
    pub decided: Four,
}

#[cube]
impl Searches {
    /// Creates the state before the first search of a point that makes `mean` searches on average.
    pub fn new(mean: f32) -> Searches {
        Searches {
            before: 0u32,
            made: false,
            mean,
            count: most_searches(mean),
            set: 0u32,
            decided: Four::default(),
        }
    }

    /// Advances to the next search that is made.
    pub fn next(
        &mut self,
        scene: &Scene,
        numbers: &Stream,
        bounce: u32,
        #[comptime] of_light: bool,
    ) {
        let chance = self.mean / self.count as f32;
        self.made = false;
        while self.before < self.count && !self.made {
            self.set = 3 * bounce + SEARCH_SETS * self.before;
            let set = self.set + comptime!(if of_light { 1u32 } else { 2u32 });
            self.decided = numbers.draw(scene.points, Dimensions::of_set(set));
            let mut u = self.decided.x;
            if of_light {
                u = self.decided.y;
            }
            self.made = looks_for_edges(scene, bounce, chance, of_light, u);
            self.before += 1;
        }
    }

    /// Returns the random numbers by which an edge is drawn.
    fn drawn(&self, scene: &Scene, numbers: &Stream, #[comptime] of_light: bool) -> Four {
        let mut drawn = self.decided;
        if of_light {
            drawn = numbers.draw(scene.points, Dimensions::of_set(self.set));
        }
        drawn
    }
}

/// Returns a tree over edges: tree 0 has all edges, tree 1 the moving edges.
#[cube]
fn root_of<'a>(scene: &Scene<'a>, tree: u32, #[comptime] has_nodes: bool) -> Root<'a> {
    let list = &scene.edge_trees[(OF_TREE * tree) as usize..];
    let nodes = Blocks::<'a> {
        list: scene.edge_nodes,
        fours: scene.fours,
        first: start_of(scene.fours, scene.first_edge_node),
    };
    let leaves = Blocks::<'a> {
        list: &scene.edge_leaves[list[0] as usize..],
        fours: scene.fours,
        first: start_of(scene.fours, scene.first_edge_leaf + list[0] / 4),
    };
    Root::<'a> {
        nodes,
        children: scene.edge_children,
        leaves,
        edges: &scene.edges_of_leaves[list[1] as usize..],
        start: list[2],
        count: list[3],
        has_nodes,
        moves: comptime!(scene.features.moves),
    }
}

/// Adds the derivatives from jumps seen from a point of a path: at shadow edges of emitters, or at edges in reflected
/// light. Those with respect to the point are added to its record.
#[cube]
pub(super) fn jumps_seen_from(
    scene: &Scene,
    memory: &mut Memory,
    records: &mut [u32],
    room: Room,
    loss: &Loss,
    sums: &Sums,
    path: &Beginning,
    observer: &Observer,
    #[comptime] of_light: bool,
) {
    let mut edge_room = Array::<u32>::new(sums.of.edge_room);
    let edges = edge_room.as_mut_slice();
    let numbers = sampler(scene, OF_EDGES).stream(path.numbers.pixel, path.numbers.sample);
    let time = path.time;
    let bounce = observer.bounce;
    let mut all = Searches::new(observer.searches);
    all.next(scene, &numbers, bounce, of_light);
    while all.made {
        let o: Observer = observer.part(all.count);
        let choice = memory.choice.as_mut_slice();
        let drawn = all.drawn(scene, &numbers, of_light);
        let s: Search = search(scene, drawn, all.decided, &o, of_light, time, choice, sums);
        let tree = select(s.moves, 0u32, 1u32);
        let root = root_of(scene, tree, comptime!(sums.of.edge_nodes));
        if s.is_made && root.count > 0 {
            let drawn: DrawnEdge = draw_edge(&root, edges, &s.query, decided_by(s.u, s.v));
            let mut edge = 0u32;
            let mut per_chance = 0.0f32;
            if drawn.edge != NO_EDGE {
                edge = drawn.edge;
                per_chance = drawn.per_chance;
            }
            let p = edge_point(scene, edge, per_chance, &s.query, &o.point.shading, s.v);
            let e: EdgeView = edge_view(scene, &o, &s, p);
            let mut k = e.first;
            while k < e.past {
                let jump: Jump = jump_at(scene, &o, &s, &e, k);
                if jump.limit > 0.0 {
                    add_jump(
                        scene, memory, records, room, loss, sums, path, &o, &s, &e, &jump, of_light,
                    );
                }
                k += 1;
            }
        }
        all.next(scene, &numbers, bounce, of_light);
    }
}

/// Adds the derivatives from a jump of the light of emitters, or of reflected light, unless an occluder hides the
/// edge.
#[cube]
fn add_jump(
    scene: &Scene,
    memory: &mut Memory,
    records: &mut [u32],
    room: Room,
    loss: &Loss,
    sums: &Sums,
    path: &Beginning,
    o: &Observer,
    s: &Search,
    e: &EdgeView,
    jump: &Jump,
    #[comptime] of_light: bool,
) {
    let time = path.time;
    let p = e.point;
    let ray = Ray {
        origin: e.start,
        direction: jump.sides.past,
        time,
        limit: jump.limit,
    };
    let hit = trace(scene, memory, ray, p.faces, false, of_light, true);
    if of_light {
        if hit.triangle == NONE {
            let light = LightBeside::default();
            jump_backward(
                scene, records, room, loss, sums, o, s, e, jump, &light, time, of_light,
            );
        }
    } else if !hides(scene, &hit, &p, time) {
        let approach = e.approach(o, s, jump.sides);
        let sides = sampler(scene, OF_SIDES);
        let numbers = sides.stream(path.numbers.pixel, path.numbers.sample);
        let beginning = Beginning {
            numbers,
            cones: path.cones,
            film: numbers.draw(scene.points, Dimensions::direction(o.bounce)),
            time,
            ray: path.ray,
        };
        let goes_on = o.bounce < scene.bounces;
        let next = o.bounce + 1;
        let light = light_beside(
            scene, memory, beginning, next, goes_on, &approach, &hit, false,
        );
        jump_backward(
            scene, records, room, loss, sums, o, s, e, jump, &light, time, of_light,
        );
    }
}

/// Adds the derivatives from a jump, for each channel. `light` is the jump of reflected light.
#[cube]
fn jump_backward(
    scene: &Scene,
    records: &mut [u32],
    room: Room,
    loss: &Loss,
    sums: &Sums,
    o: &Observer,
    s: &Search,
    e: &EdgeView,
    jump: &Jump,
    light: &LightBeside,
    time: f32,
    #[comptime] of_light: bool,
) {
    let channels = comptime!(Outputs::channels_of_radiance(loss.forward));
    #[unroll(channels == 1)]
    for channel in 0..channels {
        let own = of_channel(sums, channel);
        let view: EdgeView = e.with_carried(loss.radiance_of(e.carried, channel));
        let mut by = PointGradient::default();
        room.add_jumped(records, o.bounce, channel, &mut by);
        if of_light {
            shadow_backward(scene, &own, o, s, &view, jump, time, &mut by);
        } else {
            reflected_backward(scene, &own, o, s, &view, jump, light, time, &mut by);
        }
        room.keep_jumped(records, o.bounce, channel, &by);
    }
}

/// The normals on both sides of a crease.
#[apply(zeroed!)]
struct Normals {
    pair: Pair,
    /// Whether both faces are matt.
    evenly: bool,
    /// Whether mirrored directions about the normals are traced too.
    mirrors: bool,
}

/// Returns the normals on both sides of a crease, from the hit of a ray past its edge.
#[cube]
fn normals_beside(scene: &Scene, a: &Approach, behind: &Hit, time: f32, bounce: u32) -> Normals {
    let mut found = Normals::default();
    found.evenly = true;
    let mut side = 0u32;
    while side < 2 {
        let on_plus = side == 1;
        let at = beside(scene, a, behind, on_plus, time);
        let (k, r, direction) = (at.triangle, at.distance, at.direction);
        let point = point_at(scene, k, at.near, r, direction, time, bounce);
        if on_plus {
            found.pair.second = point.shading.normal;
        } else {
            found.pair.first = point.shading.normal;
        }
        found.evenly = found.evenly && point.shading.scatters_evenly();
        side += 1;
    }
    found.mirrors = found.evenly && normals_differ(&found.pair);
    found
}

/// Returns the light on the − side of an edge's point minus the light on the + side. If `goes_on`, paths that start
/// on both sides at a bounce compute the light of surfaces. With `film`, the emission of these surfaces and the
/// environment always count, as the camera sees them.
#[cube]
pub(super) fn light_beside(
    scene: &Scene,
    memory: &mut Memory,
    beginning: Beginning,
    bounce: u32,
    goes_on: bool,
    a: &Approach,
    behind: &Hit,
    #[comptime] film: bool,
) -> LightBeside {
    let time = beginning.time;
    let mut light = LightBeside::default();
    let mut normals = Normals::default();
    if goes_on && is_crease(scene, &a.sides) {
        normals = normals_beside(scene, a, behind, time, bounce);
    }
    // One path on each side; two if directions are mirrored, with the mirrored directions first.
    let mut left = 2u32;
    let mut sign = 1.0f32;
    if normals.mirrors {
        left = 4u32;
        sign = 0.5f32;
    }
    while left > 0 {
        let on_plus = sign < 0.0;
        let at = beside(scene, a, behind, on_plus, time);
        let mut own = Seen::default();
        // CubeCL 0.11 (SPIR-V) loses the light of maps if this condition is merged with the next, or has no `else`.
        if at.triangle == NONE {
            if comptime!(film || scene.features.sees_sky) {
                own.radiance = sky(scene, a.view);
            }
        } else {
            own.opacity = 1.0f32;
        }
        if at.triangle != NONE && goes_on {
            let start = Start {
                at,
                bounce,
                pair: normals.pair,
                paired: normals.evenly,
                mirrored: left > 2,
                emits: film.runtime(),
            };
            own = light_of(scene, memory, beginning, start, true).seen;
        }
        light.add(scene, a, &at, on_plus, &own, sign.abs(), time);
        sign = -sign;
        left -= 1;
    }
    light
}
