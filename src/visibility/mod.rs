//! Blurred visibility: how much each triangle counts along a ray (Eq. 1), how the surfaces of a
//! ray share its weight (Eq. 2–3), and how much light passes along a segment.
//!
//! Every form reduces to values without tape and a *linear* attached part: the derivative of a
//! weight with respect to the logits and distances of its pairs is known in closed form, so only
//! those two enter the graph, multiplied by coefficients that carry no tape.

mod edge;
mod softmax;
mod transmittance;

pub use edge::{Coverage, CoverageSettings, Rays, coverage};
pub use softmax::{DepthRange, Softmax, Weights};
pub use transmittance::transmittance;
