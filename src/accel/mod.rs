//! Which triangles can matter to which ray, on the host: a hierarchy of boxes, grown by the reach of
//! the blur while it is traversed, so that it holds for any σ.

mod hierarchy;
mod leaf;
mod machine;
mod triangle;
mod wide;

pub use hierarchy::{Hierarchy, HierarchyCache};
pub(crate) use machine::{Machine, Task, dispatch};
pub use triangle::{HostTriangle, PlaneHit};
