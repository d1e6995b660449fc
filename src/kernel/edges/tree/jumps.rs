//! The most that may jump at edges.

use super::query::Query8;
use crate::accel::{F8, Lanes, Machine};
use crate::kernel::edges::edge::{Edge, Kind};

/// The most that may jump at edges, by what makes it jump; of one edge between 0 and 1.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Jumps<T = f32> {
    /// Colours that always jump, and jumps of whether light passes.
    pub seen_always: T,
    pub passes_always: T,
    /// Jumps of folds that are silhouettes.
    pub fold: T,
    /// Jumps where both faces of a fold are seen.
    pub crease: T,
    /// 1 where all folds are of closed objects.
    pub closed: T,
}

impl Jumps {
    pub fn of(e: &Edge) -> Self {
        let mut jumps = Self {
            closed: f32::from(u8::from(e.closed)),
            ..Self::default()
        };
        match e.kind {
            Kind::Fold => {
                jumps.fold = 1.0;
                jumps.crease = e.crease;
            }
            Kind::Border => {
                jumps.seen_always = 1.0;
                jumps.passes_always = 1.0;
            }
            Kind::Crossing => jumps.seen_always = 1.0,
        }
        jumps
    }
}

impl Jumps<Lanes> {
    pub fn set(&mut self, i: usize, of: &Jumps) {
        self.seen_always[i] = of.seen_always;
        self.passes_always[i] = of.passes_always;
        self.fold[i] = of.fold;
        self.crease[i] = of.crease;
        self.closed[i] = of.closed;
    }

    /// The jumps that are there wherever the edge is seen from.
    #[inline(always)]
    pub fn always<M: Machine>(&self, machine: M, q: &Query8<M>) -> F8<M> {
        let load = |lanes: &Lanes| F8::load(machine, lanes);
        q.shadows
            .select(load(&self.passes_always), load(&self.seen_always))
    }
}
