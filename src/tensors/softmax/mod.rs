//! The paper's form of visibility: surfaces are blurred (Eq. 1) and share a ray by a softmax over depth (Eq. 2 and 3).
//!
//! `coverage` has Eq. 1 of pairs of ray and triangle, and how much light passes these; `weights` has Eq. 2 and 3.
//! `pairs` says which triangles a ray is paired with: all, or its own, which `candidates` finds by a hierarchy of
//! boxes; `shares` has the weights of rays in groups, by how many triangles they are paired with.

mod candidates;
mod coverage;
mod pairs;
mod shares;
#[cfg(test)]
mod tests;
mod weights;

pub(crate) use candidates::{Candidates, Form, grouped, hierarchy_of};
pub(super) use coverage::grazing;
pub(crate) use coverage::{Coverage, CoverageSettings, coverage, transmittance};
pub(crate) use pairs::{List, Pairs};
pub(crate) use shares::{Group, Groups, Shares};
pub(crate) use weights::{Softmax, Weights, weights};
