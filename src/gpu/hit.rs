//! Traversal of the BVH for rays: the nearest hit, or any hit. It uses the same tests as `accel/hits`, for one
//! triangle at a time.

use crate::cube::*;

use crate::accel::{HIT_STRIDE, Hit, LEAF, ROUNDING};
use crate::model::lists::vector;
use crate::model::{V3, v3};
use crate::trace::{Faces, NONE, Scene};

/// The memory of a thread: a stack of BVH nodes with the entry distances of their bounding boxes, and space for the
/// choice of an emitter.
#[derive(CubeType)]
pub(super) struct Memory {
    pub stack: Array<u32>,
    pub distances: Array<f32>,
    pub choice: Array<u32>,
}

#[cube]
impl Memory {
    pub fn new(scene: &Scene) -> Memory {
        Memory {
            stack: Array::<u32>::new(scene.features.stack),
            distances: Array::<f32>::new(scene.features.stack),
            choice: Array::<u32>::new(scene.features.of_emitters.room),
        }
    }
}

/// A ray, and the maximum distance of hits.
#[apply(record!)]
pub(super) struct Ray {
    pub origin: V3,
    pub direction: V3,
    pub time: f32,
    pub limit: f32,
}

/// A ray during traversal.
#[apply(record!)]
struct Cast {
    ray: Ray,
    /// Hits must be farther than this distance.
    from: f32,
    /// The margin by which triangles and boxes are enlarged.
    margin: f32,
    unseen: Faces,
    /// Whether the first hit ends the traversal, even if it is not the nearest.
    any: bool,
}

/// Returns the distance at which a ray hits a triangle, or `limit` if it misses.
#[cube]
fn meet(scene: &Scene, at: u32, cast: Cast, limit: f32) -> f32 {
    let ray = cast.ray;
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
        if distance > cast.from && distance < limit {
            let p = origin + ray.direction * distance;
            let ab = vector(scene.hits, at + 4).dot(p) + scene.hits[i + 7];
            let bc = vector(scene.hits, at + 8).dot(p) + scene.hits[i + 11];
            let ca = vector(scene.hits, at + 12).dot(p) + scene.hits[i + 15];
            t = select(
                ab.min(bc.min(ca)) > -cast.margin - scene.hits[i + 16],
                distance,
                t,
            );
        }
    }
    t
}

/// Returns the distance at which a ray enters a box, or `f32::MAX` if it misses.
#[cube]
fn enter(scene: &Scene, at: u32, cast: Cast, inverse: V3, limit: f32) -> f32 {
    let low = vector(scene.boxes, at) - cast.ray.origin;
    let high = vector(scene.boxes, at + 3) - cast.ray.origin;
    let ax = (low.x - cast.margin) * inverse.x;
    let bx = (high.x + cast.margin) * inverse.x;
    let ay = (low.y - cast.margin) * inverse.y;
    let by = (high.y + cast.margin) * inverse.y;
    let az = (low.z - cast.margin) * inverse.z;
    let bz = (high.z + cast.margin) * inverse.z;
    let near = cast.from.max(ax.min(bx)).max(ay.min(by)).max(az.min(bz));
    let far = limit.min(ax.max(bx)).min(ay.max(by)).min(az.max(bz));
    select(near <= far, near, f32::MAX)
}

/// Intersects a ray with triangles that are consecutive in the tree, and updates the nearest hit. With `any`, the
/// first hit ends the loop.
#[cube]
fn meet_all(
    scene: &Scene,
    cast: Cast,
    first: u32,
    past: u32,
    nearest: &mut Hit,
    #[comptime] selects: bool,
) {
    let mut k = first;
    while k < past {
        let at = k * HIT_STRIDE;
        let t = meet(scene, at, cast, nearest.t);
        if t < nearest.t {
            let triangle = scene.hit_numbers[k as usize];
            if !selects || !cast.unseen.contains(triangle) {
                let place = cast.ray.origin + cast.ray.direction * t;
                if !scene.is_open_at(triangle, place, cast.ray.time) {
                    nearest.t = t;
                    nearest.triangle = triangle;
                    if cast.any {
                        k = past - 1;
                    }
                }
            }
        }
        k += 1;
    }
}

/// Returns 1/d, where d is replaced by ±1e-12 if its size is smaller.
#[cube]
fn safe_inverse(d: f32) -> f32 {
    let least = select(d < 0.0, -1e-12f32, 1e-12f32);
    1.0 / select(d.abs() < 1e-12, least, d)
}

/// Returns the nearest hit of a ray. With `any`, it returns any hit, which takes less time. With `selects`, the
/// triangles in `unseen` are skipped; otherwise no triangle is.
#[cube]
pub(super) fn trace(
    scene: &Scene,
    memory: &mut Memory,
    asked: Ray,
    unseen: Faces,
    any: bool,
    #[comptime] selects: bool,
) -> Hit {
    // The rounding error of a distant origin would exceed the size of triangles. So the ray starts where it is
    // nearest to the origin of coordinates.
    let along = -asked.origin.dot(asked.direction);
    let skipped = select(along * along > 256.0, along, 0.0f32);
    let origin = asked.origin + asked.direction * skipped;
    let cast = Cast {
        ray: Ray {
            origin,
            direction: asked.direction,
            time: asked.time,
            limit: asked.limit,
        },
        from: -skipped,
        margin: ROUNDING * (1.0 + origin.abs().max_element()),
        unseen,
        any,
    };
    let mut nearest = Hit {
        t: (asked.limit - skipped).min(f32::MAX),
        triangle: NONE.runtime(),
    };
    if comptime!(scene.features.boxes) {
        let inverse = v3(
            safe_inverse(asked.direction.x),
            safe_inverse(asked.direction.y),
            safe_inverse(asked.direction.z),
        );
        let mut top = 0u32;
        let mut node = scene.root;
        let mut going = true;
        while going {
            let mut popped = true;
            if node >= LEAF {
                let leaf = (2 * (node - LEAF)) as usize;
                let first = scene.leaves[leaf];
                let past = first + scene.leaves[leaf + 1];
                meet_all(scene, cast, first, past, &mut nearest, selects);
                if any && nearest.triangle != NONE {
                    top = 0;
                }
            } else {
                let at = 12 * node;
                let first = enter(scene, at, cast, inverse, nearest.t);
                let second = enter(scene, at + 6, cast, inverse, nearest.t);
                let children = (2 * node) as usize;
                let one = scene.children[children];
                let other = scene.children[children + 1];
                let near = select(second < first, other, one);
                let far = select(second < first, one, other);
                if first.min(second) < f32::MAX {
                    node = near;
                    popped = false;
                    if first.max(second) < f32::MAX {
                        memory.stack[top as usize] = far;
                        memory.distances[top as usize] = first.max(second);
                        top += 1;
                    }
                }
            }
            if popped {
                // Pop the last node whose box is not behind the hit.
                going = false;
                while top > 0 && !going {
                    top -= 1;
                    going = memory.distances[top as usize] <= nearest.t;
                    node = memory.stack[top as usize];
                }
            }
        }
    } else {
        meet_all(scene, cast, 0u32, scene.hit_count, &mut nearest, selects);
    }
    nearest.t += skipped;
    nearest
}
