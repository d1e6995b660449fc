//! The paper's form of visibility: surfaces are blurred (Eq. 1) and share a ray by a softmax over depth (Eq. 2 and 3).
//!
//! `coverage` computes Eq. 1 for pairs of a ray and a triangle, and how much light passes them; `weights` computes Eq.
//! 2 and 3. `pairs` pairs a ray with all triangles, or with its own, which `candidates` lists by a BVH. `shares` holds
//! the weights of rays in groups, by the number of triangles with which they are paired.

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
