//! Jumps of the light that arrives at a point of a path.

use super::observer::Observer;
use crate::kernel::gradient::Sums;
use crate::kernel::records::{Vertex, Work};
use crate::kernel::surface::PointGradient;
use crate::kernel::view::View;
use crate::kernel::walk::Path;
use crate::model::V3;

/// Points count at least for this share of an average camera ray.
const LEAST: f32 = 0.05;

impl View {
    /// Adds the derivatives by jumps at edges seen from a point of a path, times `g`, whose channels add up
    /// to `typical` on average.
    #[allow(clippy::too_many_arguments)] // one place, called once
    pub(in crate::kernel) fn edges_backward(
        &self,
        path: &Path,
        vertex: &Vertex,
        bounce: u32,
        moves: bool,
        (g, typical): (V3, f32),
        work: &mut Work,
        by: &mut PointGradient,
        sums: &mut Sums,
    ) {
        let Some(sets) = &self.edge_sets else {
            return;
        };
        let carried = g * vertex.throughput;
        let counts = carried.abs().element_sum() / typical;
        if counts.is_nan() || counts <= 0.0 {
            return;
        }
        let observer = Observer {
            path,
            vertex,
            bounce,
            moves,
            carried,
            counts: counts.max(LEAST),
            numbers: self.edges.numbers(path.numbers.path()),
            sets,
        };
        self.light_edges(&observer, work, by, sums);
        self.reflected_edges(&observer, work, by, sums);
    }
}
