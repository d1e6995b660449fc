//! The backward pass along a path that stored records, in a thread of a GPU.

use softray_kernels::cube::*;

use super::camera::{Beginning, begin, camera};
use super::hit::Memory;
use super::job::PathAt;
use super::records::{
    ESCAPED, MAX_BIT_ALONG, OF_BITS, OF_SURVIVAL, Room, SAW_ALONG, SAW_EMITTER, SAW_MAP,
    SAW_MAP_ALONG, WENT_ON,
};
use softray_kernels::model::bsdf::Scatter;
use softray_kernels::model::camera::CameraGradient;
use softray_kernels::model::cone::bend;
use softray_kernels::model::connection::Target;
use softray_kernels::model::numbers::is_nonzero;
use softray_kernels::model::{Four, V3, splat};
use softray_kernels::sampling::EmitterPlace;
use softray_kernels::trace::{
    Arrived, CONE, FilmSlopes, NONE, Point, PointGradient, RayGradient, Scene, Seen, Sums,
    add_to_camera, emitters_of, follow_backward, follow_on_film, leave_backward, light_backward,
    map_backward, map_of, middle_of, point_backward, receiver_of, seen_backward, sky_backward,
    target_of,
};

/// A point of a path in the backward pass.
#[apply(record!)]
struct Vertex {
    number: u32,
    point: Point,
    /// The throughput at the point, and the derivative of the loss with respect to the light that leaves the path's
    /// first point.
    throughput: V3,
    g: V3,
    /// The bits of lights visible from the point ([`SAW_EMITTER`] and others).
    bits: u32,
    /// The sampled BSDF direction, and random numbers for the choice of a lobe and of directions to the map.
    scatter: Scatter,
    choices: Four,
}

#[cube]
impl Vertex {
    /// Returns the reflected part and the density for light of a target. The target was drawn with a density or hit
    /// by the sampled BSDF direction.
    fn arrived(&self, target: &Target, chance: f32, by_scattering: bool) -> Arrived {
        let shading = self.point.shading;
        Arrived {
            reflected: shading.evaluate(target.direction),
            density: target.divisor(&shading, chance, by_scattering),
        }
    }
}

/// Returns the i-th point of a path.
#[cube]
fn vertex(
    scene: &Scene,
    records: &mut [u32],
    room: Room,
    path: &Beginning,
    i: u32,
    g: V3,
) -> Vertex {
    let arrival = room.arrival(records, i);
    let bits = records[room.at(i, OF_BITS)];
    let point = arrival.point(scene, path.time, i);
    let mut choices = path.film;
    let mut scatter = Scatter::default();
    if bits != 0 {
        let drawn = path.direction(scene, i);
        if comptime!(scene.features.glossy || scene.features.gathers_map) {
            choices = path.choices(scene, i);
        }
        scatter = point.shading.sample(drawn.x, drawn.y, choices.x);
    }
    Vertex {
        number: i,
        point,
        throughput: arrival.throughput,
        g,
        bits,
        scatter,
        choices,
    }
}

/// Runs the backward pass along a path of a pixel: adds the derivatives of the path's light, times `upstream`, to the
/// sums. In forward mode `upstream` and the sums are those of a channel.
#[cube]
pub(super) fn path_backward(
    scene: &Scene,
    records: &mut [u32],
    sums: &Sums,
    room: Room,
    which: PathAt,
    upstream: Seen,
    slopes: &FilmSlopes,
    channel: u32,
) {
    let mut memory = Memory::new(scene);
    let path = begin(scene, which.pixel, which.sample);
    let g = upstream.radiance;
    let points = records[room.points()];
    let mut by_throughput = splat(0.0);
    let mut by_ray = RayGradient::default();
    if points == 0 {
        by_ray.direction = sky_backward(scene, sums, path.ray.direction, g);
    }
    // Only the first point has derivatives of other outputs than radiance.
    let mut left = select(is_nonzero(g.abs().element_sum()), points, points.min(1));
    while left > 0 {
        left -= 1;
        let i = left;
        let v: Vertex = vertex(scene, records, room, &path, i, g);
        let mut by = PointGradient::default();
        let mut by_before = splat(0.0);
        if v.bits & WENT_ON != 0 {
            let cone = path.cone(scene, i);
            let way = v.scatter.direction;
            let outer = v.point.shading.outer(way);
            let bent = bend(way, outer, scene.settings[CONE], cone.x, cone.y);
            by_before += leave_backward(
                scene,
                sums,
                &v.point,
                &v.scatter,
                &bent,
                room.number(records, i, OF_SURVIVAL),
                v.bits & ESCAPED != 0,
                v.throughput,
                by_throughput,
                by_ray,
                g,
                &mut by,
            );
        }
        if comptime!(scene.features.emitters) {
            by_before += emitters_backward(scene, &mut memory, sums, &path, &v, &mut by);
        }
        if comptime!(scene.features.gathers_map) {
            by_before += light_of_map_backward(scene, sums, &v, &mut by);
        }
        by_throughput = by_before;
        if comptime!(sums.of.jumps) {
            if is_nonzero(g.abs().element_sum()) {
                room.add_jumped(records, i, channel, &mut by);
            }
        }
        let mut by_t = 0.0f32;
        if i == 0 {
            by_t = seen_backward(scene, sums, &v.point, &upstream, &mut by);
        }
        by_ray = point_backward(scene, sums, &v.point, path.time, &by, by_t);
        if comptime!(scene.features.glossy && sums.of.rays) {
            by_ray = followed_backward(
                scene,
                records,
                sums,
                room,
                &path,
                &v,
                &upstream,
                slopes,
                by_throughput,
                by_ray,
            );
        }
    }
    if comptime!(sums.of.camera) {
        let mut by_camera = CameraGradient::default();
        camera(scene).ray_backward(
            &path.ray,
            middle_of(scene, which.pixel),
            by_ray.origin,
            by_ray.direction,
            &mut by_camera,
        );
        add_to_camera(sums, &by_camera);
    }
}

/// Adds the derivatives due to a ray that follows the material at its point. Returns those with respect to the ray.
#[cube]
fn followed_backward(
    scene: &Scene,
    records: &mut [u32],
    sums: &Sums,
    room: Room,
    path: &Beginning,
    v: &Vertex,
    upstream: &Seen,
    slopes: &FilmSlopes,
    by_throughput: V3,
    by_ray: RayGradient,
) -> RayGradient {
    let mut by = by_ray;
    if v.number == 0 {
        let (c, light) = (camera(scene), room.light(records));
        follow_on_film(
            scene, sums, &c, &path.ray, &v.point, upstream, slopes, light, path.time, &by_ray,
        );
    } else {
        let before = v.number - 1;
        let x = room
            .arrival(records, before)
            .point(scene, path.time, before);
        by = follow_backward(
            scene,
            sums,
            &x,
            &v.point,
            v.throughput,
            by_throughput,
            v.g,
            path.time,
            by_ray,
        );
    }
    by
}

/// Adds the derivatives from the light of visible emitters: the sampled emitter first, then the emitters along the
/// BSDF direction. Returns the derivative of the loss with respect to the throughput.
#[cube]
fn emitters_backward(
    scene: &Scene,
    memory: &mut Memory,
    sums: &Sums,
    path: &Beginning,
    v: &Vertex,
    by: &mut PointGradient,
) -> V3 {
    let mut by_throughput = splat(0.0);
    let seen_along = (v.bits >> 1) & ((1u32 << MAX_BIT_ALONG) - 1);
    if v.bits & SAW_EMITTER != 0 || seen_along != 0 {
        let x = v.point.position;
        let at = receiver_of(&v.point, path.time);
        let emitters = emitters_of(scene);
        let choice = memory.choice.as_mut_slice();
        let share = emitters.look(&at, choice);
        let combined = comptime!(scene.features.combined) && v.point.shading.glossy;
        let mut next = 0u32;
        let mut bit = SAW_EMITTER.runtime();
        while bit < (2u32 << MAX_BIT_ALONG) && next != NONE {
            let along = bit >= SAW_ALONG;
            let mut place = EmitterPlace::none();
            if along {
                place = emitters.place_along(next, v.scatter.direction, &at, share, choice);
                next = place.emitter;
                if place.emitter != NONE {
                    next = place.emitter + 1;
                }
            } else {
                let mut drawn = path.film;
                if v.number > 0 {
                    drawn = path.direction(scene, v.number - 1);
                }
                place = emitters.choose_place(drawn.z, drawn.w, &at, share, choice);
            }
            if place.emitter != NONE && v.bits & bit != 0 {
                let k = place.emitter;
                let weights = place.weights;
                let target = target_of(scene, k, weights, x, path.time, combined);
                let arrived = v.arrived(&target, place.chance, along);
                by_throughput += light_backward(
                    scene,
                    sums,
                    &v.point,
                    k,
                    weights,
                    target,
                    arrived,
                    v.throughput,
                    path.time,
                    v.g,
                    by,
                );
            }
            bit *= 2;
            if seen_along == 0 {
                next = NONE;
            }
        }
    }
    by_throughput
}

/// Adds the derivatives from the visible light of the map: in the sampled direction first, then along the BSDF
/// direction. Returns the derivative of the loss with respect to the throughput.
#[cube]
fn light_of_map_backward(scene: &Scene, sums: &Sums, v: &Vertex, by: &mut PointGradient) -> V3 {
    let mut by_throughput = splat(0.0);
    let mut bit = SAW_MAP.runtime();
    while bit <= SAW_MAP_ALONG {
        if v.bits & bit != 0 {
            let along = bit == SAW_MAP_ALONG;
            let map = map_of(scene);
            let mut towards = v.scatter.direction;
            if !along {
                towards = map.choose(scene.sky_density, v.choices.z, v.choices.w);
            }
            let target = Target::of_map(towards);
            let p = map.density(scene.sky_density, towards);
            let arrived = v.arrived(&target, p, along);
            by_throughput += map_backward(
                scene,
                sums,
                &v.point,
                target,
                arrived,
                v.throughput,
                v.g,
                by,
            );
        }
        bit *= 2;
    }
    by_throughput
}
