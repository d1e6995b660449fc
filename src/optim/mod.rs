//! Tools to optimize scenes: losses, measures for reports, mesh regularizers, points on meshes and blur schedules. The
//! feature `fit` adds a loop that fits parameters, and large steps for meshes.

#[cfg(all(feature = "photographs", not(target_family = "wasm")))]
mod comparison;
#[cfg(feature = "fit")]
mod conjugate_gradient;
mod connectivity;
#[cfg(feature = "fit")]
mod fit;
#[cfg(feature = "fit")]
mod large_steps;
pub mod loss;
mod mesh;
pub mod metrics;
mod nearest;
mod samples;
mod schedule;

#[cfg(all(feature = "photographs", not(target_family = "wasm")))]
pub use comparison::Comparison;
#[cfg(feature = "fit")]
pub use fit::{
    Evaluation, Fit, Fitted, History, LeastSquares, Part, Rate, Report, Residual, Row, Step, Stop,
    Warning,
};
#[cfg(feature = "fit")]
pub use large_steps::{LargeSteps, LargeStepsConfig, LargeStepsState};
pub use mesh::MeshRegularizer;
pub use samples::{sample_points, sample_points_and_normals};
pub use schedule::{Blur, BlurSchedule, PlateauBlur, pixel_angle};
