//! A hierarchy of bounding boxes over triangles, on the host. For the softmax, boxes grow by the reach of the blur
//! during traversal, so that one hierarchy serves any σ.

mod build;
mod candidates;
pub mod eights;
mod gather;
#[cfg(feature = "gpu")]
mod gpu;
mod hierarchy;
mod hits;
mod nearest;
mod overlaps;
mod rays;
mod shaft;
mod simd;
mod triangle;
mod wide;

pub use build::Spare;
pub use candidates::{Counts, Reach};
#[cfg(feature = "gpu")]
pub use gpu::{CHILD, CHILDREN, GpuTree, LEAF, OF_NODE, OTHERS, Parts, hit_stride};
pub use hierarchy::{Hierarchy, LastHierarchy};
pub use overlaps::Overlaps;
pub use rays::{Hit, HitRay, NOTHING};
pub(crate) use simd::stage;
pub use simd::{LANES, Machine, Task, dispatch};
pub use triangle::HostTriangle;
#[cfg(feature = "gpu")]
pub use wide::ROUNDING;
