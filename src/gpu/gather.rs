//! The light that arrives at a point of a path directly: connections to emitters and to the environment map, and their
//! shadow rays.

use softray_kernels::cube::*;

use super::camera::Beginning;
use super::hit::{Memory, Ray, trace};
use super::records::SAW_ALONG;
use super::walk::{
    DONE, PathLight, PathVertex, ShadowRay, TO_EMITTER, TO_EMITTERS_ALONG, TO_MAP, TO_MAP_ALONG,
    Walk, has_emitters_along, may_look_along,
};
use softray_kernels::model::connection::{ConeKernel, Target};
use softray_kernels::sampling::EmitterPlace;
use softray_kernels::trace::{
    CONE, Faces, NONE, Scene, emitters_of, limited, map_of, radiance_of, receiver_of, sky,
    target_of,
};

/// Adds the light that arrives at a point directly.
#[cube]
pub(super) fn gather(
    scene: &Scene,
    memory: &mut Memory,
    path: &Beginning,
    walk: &mut Walk,
    vertex: &mut PathVertex,
    light: &mut PathLight,
    #[comptime] keep: bool,
) {
    vertex.next_light = comptime!(if scene.features.emitters {
        TO_EMITTER
    } else {
        TO_MAP
    })
    .runtime();
    vertex.bit = SAW_ALONG;
    if vertex.reflects {
        vertex.cones = path.cone(scene, walk.bounce);
        if comptime!(scene.features.emitters) {
            let at = receiver_of(&vertex.point, path.time);
            vertex.share = emitters_of(scene).look(&at, memory.choice.as_mut_slice());
        }
    }
    if comptime!(may_look_along(&scene.features)) {
        let mut left = vertex.reflects;
        while left {
            add_light(scene, memory, path, walk, vertex, light, keep);
            left = vertex.next_light != DONE;
        }
    } else if comptime!(scene.features.emitters) {
        // There is one light, and a loop would take more registers.
        if vertex.reflects {
            add_light(scene, memory, path, walk, vertex, light, keep);
        }
    }
}

/// Connects a point to its next light, and adds the light that no occluder blocks.
#[cube]
fn add_light(
    scene: &Scene,
    memory: &mut Memory,
    path: &Beginning,
    walk: &mut Walk,
    vertex: &mut PathVertex,
    light: &mut PathLight,
    #[comptime] keep: bool,
) {
    let shadow: ShadowRay = connect(scene, memory, path, walk, vertex);
    if shadow.ray.limit > 0.0 {
        let hit = trace(
            scene,
            memory,
            shadow.ray,
            Faces::default(),
            false,
            true,
            false,
        );
        light.rays += 1;
        if hit.triangle == NONE {
            light.seen.radiance += shadow.light;
            if keep {
                vertex.bits |= vertex.bit_of_light();
            }
        }
    }
    vertex.finish_light(scene);
}

/// Returns the next emitter to which a point is connected, if there is one.
#[cube]
fn next_emitter(
    scene: &Scene,
    memory: &mut Memory,
    path: &Beginning,
    vertex: &mut PathVertex,
) -> EmitterPlace {
    let emitters = emitters_of(scene);
    let at = receiver_of(&vertex.point, path.time);
    let choice = memory.choice.as_mut_slice();
    let mut place = EmitterPlace::none();
    if vertex.next_light == TO_EMITTER {
        let drawn = vertex.emitter;
        place = emitters.choose_place(drawn.x, drawn.y, &at, vertex.share, choice);
    } else if comptime!(has_emitters_along(&scene.features)) {
        let way = vertex.scatter.direction;
        place = emitters.place_along(vertex.next, way, &at, vertex.share, choice);
        vertex.next = place.emitter + 1;
    }
    place
}

/// Returns the shadow ray to the next light of a point. Its limit is not positive if no light arrives, or if the bounce
/// ray tests the visibility.
#[cube]
fn connect(
    scene: &Scene,
    memory: &mut Memory,
    path: &Beginning,
    walk: &mut Walk,
    vertex: &mut PathVertex,
) -> ShadowRay {
    let mut place = EmitterPlace::none();
    let mut target = Target::none();
    let mut chance = 1.0f32;
    let x = vertex.point.position;
    if comptime!(scene.features.emitters) {
        if vertex.next_light < TO_MAP {
            place = next_emitter(scene, memory, path, vertex);
            if place.emitter == NONE {
                vertex.next_light = TO_MAP;
            } else {
                let combined = vertex.looks_along(scene);
                chance = place.chance;
                target = target_of(scene, place.emitter, place.weights, x, path.time, combined);
            }
        }
    }
    if comptime!(scene.features.gathers_map) {
        if vertex.next_light >= TO_MAP {
            let mut towards = vertex.scatter.direction;
            if vertex.next_light == TO_MAP {
                let drawn = path.choices(scene, walk.bounce);
                towards = map_of(scene).choose(scene.sky_density, drawn.z, drawn.w);
            }
            chance = map_of(scene).density(scene.sky_density, towards);
            target = Target::of_map(towards);
        }
    }
    let along = vertex.next_light == TO_EMITTERS_ALONG || vertex.next_light == TO_MAP_ALONG;
    let shading = vertex.point.shading;
    let cone = ConeKernel {
        tangent: scene.settings[CONE],
        u: vertex.cones.z,
        v: vertex.cones.w,
    };
    let mut chosen = target.connect(&shading, x, chance, along, cone);
    if chosen.limit > 0.0 {
        if vertex.next_light < TO_MAP {
            if comptime!(scene.features.emitters) {
                target.radiance = radiance_of(scene, place.emitter, place.weights, target.facing());
            }
        } else if comptime!(scene.features.gathers_map) {
            target.radiance = sky(scene, target.direction);
        }
    }
    let arrived = chosen.reflected.times(target.radiance) * chosen.scale;
    let light = limited(scene, walk.throughput.times(arrived), walk.bounce);
    if comptime!(scene.features.gathers_map) {
        if vertex.next_light == TO_MAP_ALONG
            && chosen.limit > 0.0
            && vertex.goes_straight_on(scene, walk.bounce)
        {
            walk.waits = true;
            walk.waiting = light;
            chosen.limit = -1.0f32;
        }
    }
    ShadowRay {
        ray: Ray {
            origin: chosen.start,
            direction: chosen.direction,
            time: path.time,
            limit: chosen.limit,
        },
        light,
    }
}
