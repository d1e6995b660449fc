//! Points of paths that look at edges.

use crate::kernel::edges::EdgeSets;
use crate::kernel::records::Vertex;
use crate::kernel::walk::Path;
use crate::model::V3;
use crate::sampling::Numbers;

/// A point of a path that looks at edges.
pub(super) struct Observer<'a> {
    pub path: &'a Path<'a>,
    pub vertex: &'a Vertex,
    pub bounce: u32,
    /// Whether it moves, or the directions that it looks in turn.
    pub moves: bool,
    /// The derivative of the loss by the light that leaves it, times the path's throughput.
    pub carried: V3,
    /// The sum of the channels of that, over the average of camera rays.
    pub counts: f32,
    pub numbers: Numbers<'a>,
    pub sets: &'a EdgeSets,
}
