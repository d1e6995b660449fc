//! A tree over edges, from which one is drawn in proportion to an estimate of what it contributes: jump
//! times angle over distance times lobe.

mod build;
mod draw;
mod edge_list;
mod jumps;
mod leaf;
mod node;
mod query;

pub(in crate::kernel) use build::EdgeTree;
pub(in crate::kernel) use query::Query;
