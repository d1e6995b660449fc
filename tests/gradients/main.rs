//! Gradients against central differences, between the engines, and what they take.

#[path = "../common/mod.rs"]
mod common;

mod candidates;
mod classes;
mod cone;
mod cornell;
mod engines;
mod forward;
mod gloss;
mod memory;
mod outputs;
mod regularized;
mod replay;
mod shadow;
mod shares;
mod tilts;
