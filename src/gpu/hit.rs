//! Traversal of the BVH for rays: the nearest hit, or any hit. It uses the same tests as `accel/hits`, for one
//! triangle at a time.

use softray_kernels::cube::*;

use softray_kernels::accel::{CHILD, Hit, LEAF, OTHERS, ROUNDING, hit_stride};
use softray_kernels::model::{Four, V3, v3};
use softray_kernels::trace::{Faces, NONE, Scene, four, start_of};

/// Marks the end of the stack: no child.
const END: u32 = LEAF;

/// The distance of a ray's origin from the point of the ray that is nearest to the origin of coordinates, beyond which
/// the ray starts at this point.
pub(super) const FAR: f32 = 16.0;

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
    /// The least distance of a hit from the lines through a triangle's edges: minus the margin.
    least: f32,
    unseen: Faces,
    /// Whether the first hit ends the traversal, even if it is not the nearest. Its distance is then −[`f32::MAX`].
    any: bool,
}

/// Returns the signed distance of a point from a plane or line.
#[cube]
fn distance(from: Four, p: V3) -> f32 {
    from.x * p.x + (from.y * p.y + (from.z * p.z + from.w))
}

/// Whether a ray meets a box, and the distance at which it enters it.
#[apply(record!)]
struct Entry {
    is_met: bool,
    distance: f32,
}

/// A ray for intersection with boxes: the inverse of its direction, the absolute values of the inverse, these negated, and
/// the negated origin times the inverse.
#[apply(record!)]
struct Slabs {
    inverse: V3,
    size: V3,
    minus: V3,
    start: V3,
}

#[cube]
impl Slabs {
    fn new(origin: V3, direction: V3) -> Slabs {
        let inverse = v3(
            safe_inverse(direction.x),
            safe_inverse(direction.y),
            safe_inverse(direction.z),
        );
        Slabs {
            inverse,
            size: inverse.abs(),
            minus: -inverse.abs(),
            start: -origin.times(inverse),
        }
    }

    /// Returns the entry into a box, given by its center and half its extents.
    fn enter(&self, center: V3, half: V3, from: f32, limit: f32) -> Entry {
        let middle = center.times(self.inverse) + self.start;
        let near = half.times(self.minus) + middle;
        let far = half.times(self.size) + middle;
        let distance = from.max(near.max_element());
        Entry {
            is_met: distance <= limit.min(far.x).min(far.y).min(far.z),
            distance,
        }
    }
}

/// Intersects a ray with triangles that are consecutive in the tree, and updates the nearest hit.
#[cube]
fn meet_triangles(
    scene: &Scene,
    cast: Cast,
    first: u32,
    past: u32,
    nearest: &mut Hit,
    #[comptime] selects: bool,
) {
    let (hits, fours, ray) = (scene.hits, scene.fours, cast.ray);
    let stride = comptime!(hit_stride(scene.features.moves) / 4);
    let start = start_of(fours, scene.first_hit);
    let mut k = first;
    while k < past {
        let at = start + k * stride;
        let mut origin = ray.origin;
        if comptime!(scene.features.moves) {
            origin -= four(hits, fours, at + 4).vector() * ray.time;
        }
        let plane = four(hits, fours, at);
        let cosine = plane.vector().dot(ray.direction);
        // This is not a number if the ray is in the plane.
        let t = -distance(plane, origin) / cosine;
        if cosine.abs() > 1e-30 && t > cast.from && t < nearest.t {
            let p = origin + ray.direction * t;
            let ab = distance(four(hits, fours, at + 1), p);
            let bc = distance(four(hits, fours, at + 2), p);
            let ca = distance(four(hits, fours, at + 3), p);
            if ab.min(bc.min(ca)) > cast.least {
                let triangle = scene.hit_numbers[k as usize];
                if !selects || !cast.unseen.contains(triangle) {
                    let place = ray.origin + ray.direction * t;
                    if !scene.is_open_at(triangle, place, ray.time) {
                        nearest.t = select(cast.any, -f32::MAX, t);
                        nearest.triangle = triangle;
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

/// Returns the place of the last child on a stack of `top` children whose box is not behind the nearest hit. With
/// `shadow` it is the last child, since the first hit ends the traversal.
#[cube]
fn last(distances: &Array<f32>, top: u32, limit: f32, #[comptime] shadow: bool) -> u32 {
    let mut at = top - 1;
    if comptime!(!shadow) {
        while distances[at as usize] > limit {
            at -= 1;
        }
    }
    at
}

/// Returns the nearest hit of a ray. With `any` or `shadow`, it returns any hit, without its distance. A kernel may compute
/// `any`; with `shadow` it does not order the children of a node by distance. With `selects`, the triangles in `unseen`
/// are skipped; otherwise no triangle is.
#[cube]
pub(super) fn trace(
    scene: &Scene,
    memory: &mut Memory,
    ray: Ray,
    unseen: Faces,
    any: bool,
    #[comptime] shadow: bool,
    #[comptime] selects: bool,
) -> Hit {
    // The rounding error of a distant origin would exceed the size of triangles. So the ray starts where it is
    // nearest to the origin of coordinates.
    let along = -ray.origin.dot(ray.direction);
    let skipped = select(along * along > FAR * FAR, along, 0.0f32);
    let origin = ray.origin + ray.direction * skipped;
    let margin = ROUNDING * (1.0 + origin.abs().max_element());
    let cast = Cast {
        ray: Ray {
            origin,
            direction: ray.direction,
            time: ray.time,
            limit: ray.limit,
        },
        from: -skipped,
        least: -margin,
        unseen,
        any: any || shadow,
    };
    let mut nearest = Hit {
        t: (ray.limit - skipped).min(f32::MAX),
        triangle: NONE.runtime(),
    };
    if comptime!(scene.features.boxes) {
        let slabs = Slabs::new(origin, ray.direction);
        let (nodes, fours) = (scene.nodes, scene.fours);
        let start = start_of(fours, scene.first_node) - CHILD;
        // The end of the stack, which no hit is nearer than.
        memory.stack[0usize] = END;
        if comptime!(!shadow) {
            memory.distances[0usize] = -f32::MAX;
        }
        let mut top = 1u32;
        let mut child = CHILD.runtime();
        while child != END {
            // The threads of a group go on to leaves together.
            while child < LEAF {
                let at = start + child;
                let x = four(nodes, fours, at);
                let y = four(nodes, fours, at + 1);
                let z = four(nodes, fours, at + 2);
                let children = four(nodes, fours, at + 3);
                let (from, limit) = (cast.from, nearest.t);
                let (center, half) = (v3(x.x, y.x, z.x), v3(x.z, y.z, z.z));
                let first = slabs.enter(center, half, from, limit);
                let (center, half) = (v3(x.y, y.y, z.y), v3(x.w, y.w, z.w));
                let second = slabs.enter(center, half, from, limit);
                let one = children.x.to_bits();
                let other = children.y.to_bits();
                if first.is_met || second.is_met {
                    child = select(first.is_met, one, other);
                    if first.is_met && second.is_met {
                        let mut later = other;
                        if comptime!(!shadow) {
                            let swaps = second.distance < first.distance;
                            child = select(swaps, other, one);
                            later = select(swaps, one, other);
                            let distance = first.distance.max(second.distance);
                            memory.distances[top as usize] = distance;
                        }
                        memory.stack[top as usize] = later;
                        top += 1;
                    }
                } else {
                    top = last(&memory.distances, top, nearest.t, shadow);
                    child = memory.stack[top as usize];
                }
            }
            if child != END {
                let first = child & comptime!((1u32 << OTHERS) - 1);
                let count = (child >> OTHERS) - comptime!(((CHILD | LEAF) >> OTHERS) - 1);
                meet_triangles(scene, cast, first, first + count, &mut nearest, selects);
                top = last(&memory.distances, top, nearest.t, shadow);
                child = memory.stack[top as usize];
                if comptime!(shadow) {
                    child = select(nearest.triangle == NONE, child, END);
                }
            }
        }
    } else {
        meet_triangles(scene, cast, 0u32, scene.hit_count, &mut nearest, selects);
    }
    nearest.t += skipped;
    nearest
}
