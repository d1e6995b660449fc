//! Stages for eight paths at once, as loops that compilers vectorize. They cover matt surfaces, for which all paths
//! take the same steps. Everything else is computed path by path.
//!
//! Lanes are passed and returned by value. To vectorize a loop, the compiler must prove that its outputs do not overlap
//! its inputs, which it cannot do for references once functions are inlined.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over lanes are alike, whatever they read"
)]

use crate::lanes::{LANES, Record};
use crate::model::bsdf::{Scatter, Shading};
use crate::model::camera::{Camera, CameraRay};
use crate::model::cone::{self, Bend};
use crate::model::connection::{ConeKernel, Connection};
use crate::model::filter::{filter_between, filter_entries, filter_place, uniform_disk};
use crate::model::triangle::{Plane, Triangle, uniform_point};
use crate::model::{Four, V2, V3};
use crate::sampling::{Choosing, Chosen, EmitterLists, EmitterTriangle, Receiver};
use crate::trace::{HitTriangle, Leaving, Point, leave_sharply, on_plane, plain_point, target_on};

/// The lanes of a record.
pub(super) type Eight<T> = <T as Record>::Lanes;

/// Computes the records of all lanes from their indices. It is a macro that writes out the loop, because a closure may
/// not be inlined.
macro_rules! each_lane {
    ($record:ty, |$i:ident| $value:expr) => {{
        let mut out = Eight::<$record>::default();
        for $i in 0..LANES {
            let value: $record = $value;
            value.set(&mut out, $i);
        }
        out
    }};
}

/// Returns whether the first `lanes` lanes are all on matt surfaces.
#[inline(always)]
pub(super) fn are_matt(points: &Eight<Point>, lanes: usize) -> bool {
    (0..lanes).all(|i| Point::get(points, i).shading.is_matt())
}

/// Computes the points at which rays hit planes, from approximate points. Requires [`Features::plain_points`].
///
/// [`Features::plain_points`]: crate::trace::Features::plain_points
#[inline(always)]
pub(super) fn plain_points(
    planes: Eight<Plane>,
    shifts: Eight<V3>,
    nears: Eight<V3>,
    hits: Eight<HitTriangle>,
) -> Eight<Point> {
    each_lane!(Point, |i| {
        let hit = HitTriangle::get(&hits, i);
        let (near, shift) = (V3::get(&nears, i), V3::get(&shifts, i));
        let on = on_plane(&Plane::get(&planes, i), shift, near, hit.direction);
        plain_point(&on, &hit)
    })
}

/// Computes the barycentric weights of the hit points in their triangles.
#[inline(always)]
pub(super) fn weights(
    triangles: Eight<Triangle>,
    shifts: Eight<V3>,
    nears: Eight<V3>,
    directions: Eight<V3>,
) -> Eight<V3> {
    each_lane!(V3, |i| {
        let triangle = Triangle::get(&triangles, i);
        let (near, shift) = (V3::get(&nears, i), V3::get(&shifts, i));
        let on = on_plane(&triangle.plane(), shift, near, V3::get(&directions, i));
        triangle.weights(on.at_rest)
    })
}

/// Maps random numbers to coordinates of points of the pixel filter.
#[inline(always)]
pub(super) fn filter_of(table: &[f32], u: Eight<f32>) -> Eight<f32> {
    let places = each_lane!(f32, |i| filter_place(u[i]));
    let entries = each_lane!(V2, |i| filter_entries(table, 0, places[i]));
    each_lane!(f32, |i| {
        filter_between(V2::get(&entries, i), places[i], u[i])
    })
}

/// Returns points of the lens.
#[inline(always)]
pub(super) fn lens_points(drawn: Eight<Four>) -> Eight<V2> {
    each_lane!(V2, |i| uniform_disk(drawn.x[i], drawn.y[i]))
}

/// Returns the rays from points of the lens through film points, which are given relative to the middles of pixels.
#[inline(always)]
pub(super) fn camera_rays(
    camera: Camera,
    middles: Eight<V2>,
    places: Eight<V2>,
    lens: Eight<V2>,
) -> Eight<CameraRay> {
    each_lane!(CameraRay, |i| {
        let (x, y) = (middles.x[i] + places.x[i], middles.y[i] + places.y[i]);
        camera.ray(x, y, lens.x[i], lens.y[i])
    })
}

/// Computes the rays with which paths leave matt surfaces, without cones and roulette.
#[inline(always)]
pub(super) fn leave(
    points: Eight<Point>,
    scatters: Eight<Scatter>,
    throughputs: Eight<V3>,
) -> Eight<Leaving> {
    each_lane!(Leaving, |i| {
        let mut point = Point::get(&points, i);
        point.shading = point.shading.as_matt();
        let (scatter, throughput) = (Scatter::get(&scatters, i), V3::get(&throughputs, i));
        leave_sharply(&point, &scatter, throughput)
    })
}

/// Draws rays from the cones about the directions in which paths leave matt surfaces.
#[inline(always)]
pub(super) fn bend(
    points: Eight<Point>,
    scatters: Eight<Scatter>,
    tangent: f32,
    numbers: Eight<Four>,
) -> Eight<Bend> {
    each_lane!(Bend, |i| {
        let direction = V3::get(&scatters.direction, i);
        let outer = V3::get(&points.shading.geometric, i);
        cone::bend(direction, outer, tangent, numbers.x[i], numbers.y[i])
    })
}

/// Draws the directions in which paths leave matt surfaces. With `FLAT`, the shading normals are the geometric ones.
#[inline(always)]
pub(super) fn scatter<const FLAT: bool>(
    points: Eight<Shading>,
    numbers: Eight<Four>,
) -> Eight<Scatter> {
    each_lane!(Scatter, |i| {
        let drawn = Four::get(&numbers, i);
        let mut shading = Shading::get(&points, i).as_matt();
        shading.smooth &= !FLAT;
        shading.sample(drawn.x, drawn.y, 0.0)
    })
}

/// Computes the probabilities of few emitters as seen from points ([`EmitterLists::look`]) and stores them in `room`.
#[inline(always)]
pub(super) fn look(emitters: &EmitterLists, at: &Eight<Receiver>, room: &mut [Eight<f32>]) {
    let mut totals = [0.0; LANES];
    for (k, room) in room.iter_mut().enumerate() {
        *room = brings(emitters, k as u32, *at);
        for i in 0..LANES {
            totals[i] += room[i];
        }
    }
    for (k, room) in room.iter_mut().enumerate() {
        for i in 0..LANES {
            room[i] = emitters.chance_of_few(k as u32, room[i], totals[i]);
        }
    }
}

/// Estimates the light that one emitter sends to points.
#[inline(always)]
fn brings(emitters: &EmitterLists, k: u32, at: Eight<Receiver>) -> Eight<f32> {
    if emitters.is_light(k) {
        return each_lane!(f32, |i| emitters.brings(k, &Receiver::get(&at, i)));
    }
    let (at_rest, velocity) = (emitters.at_rest(k), emitters.velocity(k));
    let angles = each_lane!(f32, |i| {
        let at = Receiver::get(&at, i);
        at_rest.moved(velocity * at.time).angle(at.position)
    });
    let brightness = emitters.brightness[k as usize];
    each_lane!(f32, |i| angles[i] * brightness)
}

/// Chooses one of few emitters for each random number.
#[inline(always)]
pub(super) fn choose(numbers: Eight<f32>, room: &[Eight<f32>]) -> Eight<Chosen> {
    let mut choosing = each_lane!(Choosing, |_i| Choosing::begin());
    for (k, &chances) in room.iter().enumerate() {
        for i in 0..LANES {
            let mut own = Choosing::get(&choosing, i);
            own.pass(k as u32, chances[i], numbers[i]);
            own.set(&mut choosing, i);
        }
    }
    each_lane!(Chosen, |i| Choosing::get(&choosing, i).end(numbers[i]))
}

/// Returns points of emitters, from the rest of the number that chose the emitter and from a second number.
#[inline(always)]
pub(super) fn uniform_points(u: Eight<f32>, v: Eight<f32>) -> Eight<V2> {
    each_lane!(V2, |i| uniform_point(u[i], v[i]))
}

/// Returns the chosen triangles of few emitters.
#[inline(always)]
pub(super) fn chosen_triangles(
    emitters: &EmitterLists,
    chosen: Eight<u32>,
    times: Eight<f32>,
) -> Eight<EmitterTriangle> {
    let mut out = Eight::<EmitterTriangle>::default();
    for k in 0..emitters.triangle_count {
        let (at_rest, velocity) = (emitters.at_rest(k), emitters.velocity(k));
        for i in 0..LANES {
            // A factor replaces a condition, because conditional loads are not vectorized.
            let own = if chosen[i] == k { 1.0 } else { 0.0 };
            let to = EmitterTriangle::get(&out, i);
            let on = at_rest.moved(velocity * times[i]);
            let sum = EmitterTriangle {
                a: to.a + on.a * own,
                b: to.b + on.b * own,
                c: to.c + on.c * own,
                normal: to.normal + on.normal * own,
                area: to.area + on.area * own,
            };
            sum.set(&mut out, i);
        }
    }
    out
}

/// Computes the light that connections add to the paths of points if no occluder is in between.
#[inline(always)]
pub(super) fn lights(
    connections: Eight<Connection>,
    radiances: Eight<V3>,
    throughputs: Eight<V3>,
) -> Eight<V3> {
    each_lane!(V3, |i| {
        let (radiance, throughput) = (V3::get(&radiances, i), V3::get(&throughputs, i));
        brought(&Connection::get(&connections, i), radiance, throughput)
    })
}

/// Computes the light that a connection adds to the path of a point.
#[inline(always)]
pub(super) fn brought(connection: &Connection, radiance: V3, throughput: V3) -> V3 {
    throughput * (connection.reflected * radiance * connection.scale)
}

/// Connects matt surfaces to points of emitters, and returns the directions to these points and the connections. With
/// `CONES`, shadow rays are drawn from cones of the given tangent.
#[inline(always)]
pub(super) fn connect<const CONES: bool>(
    points: Eight<Point>,
    on: Eight<EmitterTriangle>,
    weights: Eight<V2>,
    chances: Eight<f32>,
    (tangent, numbers): (f32, Eight<Four>),
) -> (Eight<V3>, Eight<Connection>) {
    let (mut directions, mut out) = (Eight::<V3>::default(), Eight::<Connection>::default());
    for i in 0..LANES {
        let point = Point::get(&points, i);
        let on = EmitterTriangle::get(&on, i);
        let target = target_on(&on, V2::get(&weights, i), point.position);
        let cone = ConeKernel {
            tangent: if CONES { tangent } else { 0.0 },
            u: numbers.z[i],
            v: numbers.w[i],
        };
        let (shading, x) = (point.shading.as_matt(), point.position);
        // All is computed whether there is a connection or not, because conditional loads are not vectorized.
        let reflected = shading.evaluate(target.direction);
        let mut connection = target.connection(&shading, x, reflected, chances[i], false, cone);
        // The two tests of `Target::connect`, without a branch.
        let arrives = (reflected.abs().max_element() > 0.0) & (target.angle > 0.0);
        connection.limit = if arrives { connection.limit } else { -1.0 };
        target.direction.set(&mut directions, i);
        connection.set(&mut out, i);
    }
    (directions, out)
}
