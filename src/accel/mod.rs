//! A hierarchy of bounding boxes over triangles, on the host. For the softmax, boxes grow by the reach of the blur
//! during traversal, so that one hierarchy serves any σ.

mod build;
mod candidates;
pub(crate) mod eights;
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

pub(crate) use build::Spare;
pub(crate) use candidates::{Counts, Reach};
#[cfg(feature = "gpu")]
pub(crate) use gpu::{CHILD, CHILDREN, GpuTree, LEAF, OF_NODE, OTHERS, Parts, hit_stride};
pub(crate) use hierarchy::{Hierarchy, LastHierarchy};
pub(crate) use overlaps::Overlaps;
pub(crate) use rays::{Hit, HitRay, NOTHING};
pub(crate) use simd::{LANES, Machine, Task, dispatch, stage};
pub(crate) use triangle::HostTriangle;
#[cfg(feature = "gpu")]
pub(crate) use wide::ROUNDING;
