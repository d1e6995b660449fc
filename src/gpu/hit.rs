//! Rays through the tree of boxes: the nearest triangle, or whether there is any. The same tests as
//! `accel/hits`, one triangle at a time.

use crate::cube::*;

use crate::accel::{HIT_STRIDE, LEAF};
use crate::model::lists::vector;
use crate::model::{V3, v3};
use crate::trace::{Faces, NONE, Scene, is_open};

/// A ray, and where hits count.
#[apply(record!)]
pub(super) struct Ray {
    pub origin: V3,
    pub direction: V3,
    pub time: f32,
    /// Hits count if they are farther than `from` and nearer than `limit`.
    pub from: f32,
    pub limit: f32,
}

/// A hit: a distance, and a triangle or [`NONE`].
#[apply(record!)]
pub(super) struct Hit {
    pub t: f32,
    pub triangle: u32,
}

/// All triangles are seen.
#[cube]
pub(super) fn see_all() -> Faces {
    Faces {
        a: NONE,
        b: NONE,
        c: NONE,
        d: NONE,
    }
}

/// Triangles are grown by this share of the largest coordinate near the ray.
const ROUNDING: f32 = 4e-7;

/// The distance at which a ray hits a triangle, its limit if it does not.
#[cube]
fn meet(scene: &Scene, at: u32, ray: Ray, margin: f32, limit: f32) -> f32 {
    let mut origin = ray.origin;
    if comptime!(scene.features.moves) {
        origin -= vector(scene.hits, at + 17) * ray.time;
    }
    let i = at as usize;
    let normal = vector(scene.hits, at);
    let cosine = normal.dot(ray.direction);
    let mut t = limit;
    if cosine.abs() > 1e-30 {
        let distance = (scene.hits[i + 3] - normal.dot(origin)) / cosine;
        if distance > ray.from && distance < limit {
            let p = origin + ray.direction * distance;
            let ab = vector(scene.hits, at + 4).dot(p) + scene.hits[i + 7];
            let bc = vector(scene.hits, at + 8).dot(p) + scene.hits[i + 11];
            let ca = vector(scene.hits, at + 12).dot(p) + scene.hits[i + 15];
            if ab.min(bc.min(ca)) > -margin - scene.hits[i + 16] {
                t = distance;
            }
        }
    }
    t
}

/// The distance at which a ray enters a box, a number over its limit if it does not.
#[cube]
fn enter(scene: &Scene, at: u32, ray: Ray, inverse: V3, margin: f32, limit: f32) -> f32 {
    let low = vector(scene.boxes, at) - ray.origin;
    let high = vector(scene.boxes, at + 3) - ray.origin;
    let ax = (low.x - margin) * inverse.x;
    let bx = (high.x + margin) * inverse.x;
    let ay = (low.y - margin) * inverse.y;
    let by = (high.y + margin) * inverse.y;
    let az = (low.z - margin) * inverse.z;
    let bz = (high.z + margin) * inverse.z;
    let near = ray.from.max(ax.min(bx)).max(ay.min(by)).max(az.min(bz));
    let far = limit.min(ax.max(bx)).min(ay.max(by)).min(az.max(bz));
    let mut t = f32::MAX.runtime();
    if near <= far {
        t = near;
    }
    t
}

/// Whether a ray passes a triangle that it meets, since there is a hole.
#[cube]
fn passes(scene: &Scene, at: u32, triangle: u32, ray: Ray, t: f32) -> bool {
    let mut open = false;
    if comptime!(scene.features.holes) {
        let mut point = ray.origin + ray.direction * t;
        if comptime!(scene.features.moves) {
            point -= vector(scene.hits, at + 17) * ray.time;
        }
        open = is_open(scene, triangle, scene.triangle(triangle).weights(point));
    }
    open
}

/// 1/d, of a number that is not too small.
#[cube]
fn safe_inverse(d: f32) -> f32 {
    let mut divisor = d;
    if d.abs() < 1e-12 {
        divisor = 1e-12f32;
        if d < 0.0 {
            divisor = -1e-12f32;
        }
    }
    1.0 / divisor
}

/// The nearest triangle that a ray hits; with `any` any, which takes less time. With `select` some are left out.
#[cube]
pub(super) fn trace(
    scene: &Scene,
    stack: &mut [u32],
    asked: Ray,
    unseen: Faces,
    any: bool,
    #[comptime] select: bool,
) -> Hit {
    // A distant origin would round by more than triangles are large: begin where the ray is nearest to the
    // origin of coordinates.
    let along = -asked.origin.dot(asked.direction);
    let mut skipped = 0.0f32;
    if along * along > 256.0 {
        skipped = along;
    }
    let mut ray = asked;
    ray.origin += asked.direction * skipped;
    ray.from -= skipped;
    ray.limit = (asked.limit - skipped).min(f32::MAX);
    let margin = ROUNDING * (1.0 + ray.origin.abs().max_element());
    let mut t = ray.limit;
    let mut triangle = NONE.runtime();
    if comptime!(scene.features.boxes) {
        let inverse = v3(
            safe_inverse(ray.direction.x),
            safe_inverse(ray.direction.y),
            safe_inverse(ray.direction.z),
        );
        let mut top = 0u32;
        let mut node = scene.root;
        let mut going = true;
        while going {
            let mut popped = true;
            if node >= LEAF {
                let leaf = (2 * (node - LEAF)) as usize;
                let mut k = scene.leaves[leaf];
                let past = k + scene.leaves[leaf + 1];
                while k < past {
                    let at = k * HIT_STRIDE;
                    let found = meet(scene, at, ray, margin, t);
                    if found < t {
                        let number = scene.hit_numbers[k as usize];
                        if !select || !unseen.contains(number) {
                            if !passes(scene, at, number, ray, found) {
                                t = found;
                                triangle = number;
                            }
                        }
                    }
                    k += 1;
                }
                if any && triangle != NONE {
                    top = 0;
                }
            } else {
                let at = 12 * node;
                let first = enter(scene, at, ray, inverse, margin, t);
                let second = enter(scene, at + 6, ray, inverse, margin, t);
                let children = (2 * node) as usize;
                let mut near = scene.children[children];
                let mut far = scene.children[children + 1];
                if second < first {
                    near = scene.children[children + 1];
                    far = scene.children[children];
                }
                if first.min(second) < f32::MAX {
                    node = near;
                    popped = false;
                    if first.max(second) < f32::MAX {
                        stack[top as usize] = far;
                        top += 1;
                    }
                }
            }
            if popped {
                if top == 0 {
                    going = false;
                } else {
                    top -= 1;
                    node = stack[top as usize];
                }
            }
        }
    } else {
        let mut k = 0u32;
        while k < scene.hit_count {
            let at = k * HIT_STRIDE;
            let found = meet(scene, at, ray, margin, t);
            if found < t && (!select || !unseen.contains(k)) {
                if !passes(scene, at, k, ray, found) {
                    t = found;
                    triangle = k;
                    if any {
                        k = scene.hit_count - 1;
                    }
                }
            }
            k += 1;
        }
    }
    Hit {
        t: t + skipped,
        triangle,
    }
}
