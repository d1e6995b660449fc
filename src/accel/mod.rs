//! Which triangles can matter to which ray, on the host: a hierarchy of boxes, grown by the reach of
//! the blur while it is traversed, so that it holds for any σ.

mod hierarchy;
mod hits;
mod leaf;
mod simd;
mod triangle;
mod wide;

pub use hierarchy::{Hierarchy, HierarchyCache};
pub(crate) use hits::{Hit, HitRay, NOTHING};
pub(crate) use leaf::{LANES, Lanes};
pub(crate) use simd::{F8, Machine, Mask8, Task, dispatch};
pub use triangle::{HostTriangle, PlaneHit};

/// How far beside a ray triangles matter. `most` bounds the distance; and where `price` is not 0 a hit
/// counts as farther away by that times the squared distance between it and its triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reach {
    pub most: f64,
    pub price: f64,
}

impl Reach {
    /// The distance up to which triangles matter if they are met no more than `left` before the limit.
    #[inline(always)]
    fn within(self, left: f64) -> f64 {
        if self.price > 0.0 {
            self.most.min((left.max(0.0) / self.price).sqrt())
        } else {
            self.most
        }
    }
}
