//! What optimising a scene takes beside a renderer.

mod conjugate_gradient;
mod connectivity;
mod large_steps;
pub mod loss;
mod mesh;
mod schedule;

pub use large_steps::{LargeSteps, LargeStepsConfig, LargeStepsState};
pub use mesh::MeshRegulariser;
pub use schedule::{BlurSchedule, pixel_footprint};
