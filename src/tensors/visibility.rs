//! The forms of visibility: hard surfaces along the rays of cones, or the paper's blurred triangles (Eq. 1),
//! which share a ray by a softmax over depth (Eq. 3).

use std::fmt;

use serde::{Deserialize, Serialize};

use super::softmax::Softmax;
use crate::error::{Error, Result};

/// The form of visibility in a render. Its gradients are derivatives of the image in that form.
///
/// `docs/VISIBILITY.md` compares both forms by measurement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Visibility {
    /// Hard surfaces, blurred by rays that are jittered within cones: the default.
    ///
    /// A camera ray passes its pixel's point through a filter; a bounce or shadow ray leaves its surface
    /// about the direction that was sampled for it. Both have a smooth kernel, so that an image is a
    /// differentiable function of the geometry. Gradients are those of the image that is rendered:
    /// silhouettes, borders, creases, and lines in which surfaces pass through each other are sampled
    /// for them on their own, so that they are right, and not noisier, at an angle of 0.
    Cone {
        /// Half-angle of the cones of bounce and shadow rays, radians, from 0 on and under 1.2. It
        /// softens shadows and reflections by 0.35 of it (a standard deviation).
        angle: f64,
        /// Radius of the pixel filter beyond the pixel itself, in pixels, from 0 on. The kernel is
        /// (1 − r²)² in x and in y.
        pixels: f64,
    },
    /// The paper's form (Eq. 1 and 3, corrected): each triangle counts by p = sigmoid(±D/σ), with D the
    /// squared distance of a ray's hit from the border in the triangle's plane; the triangles of a ray
    /// share it by a softmax over log p_k + z_k/γ and ε/γ for the background, z_k = (far − t_k)/(far −
    /// near); light passes by ∏(1 − p_k).
    Softmax {
        /// Blur of edges σ, in scene units squared.
        sigma: f64,
        /// Blur in depth γ, in units of the scene's depth.
        gamma: f64,
        /// ε, the score of the background.
        epsilon: f64,
    },
}

/// What is computed for a form of visibility.
pub(crate) enum VisibilityForm {
    Cones { angle: f64, pixels: f64 },
    Softmax(Softmax),
}

impl Default for Visibility {
    /// Cones without an angle, and a pixel filter with a radius of half a pixel.
    fn default() -> Self {
        Self::cone(0.0)
    }
}

impl fmt::Display for Visibility {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cone { angle, pixels } => {
                write!(f, "cones of {angle} rad, filter of {pixels} px")
            }
            Self::Softmax {
                sigma,
                gamma,
                epsilon,
            } => write!(f, "softmax of σ {sigma}, γ {gamma}, ε {epsilon}"),
        }
    }
}

impl Visibility {
    /// Cones of a half-angle in radians, with a pixel filter of half a pixel.
    pub fn cone(angle: f64) -> Self {
        Self::Cone { angle, pixels: 0.5 }
    }

    /// The softmax form with ε = 1e-3; σ in scene units squared, γ in units of the scene's depth.
    pub fn softmax(sigma: f64, gamma: f64) -> Self {
        Self::Softmax {
            sigma,
            gamma,
            epsilon: 1e-3,
        }
    }

    /// What is computed for it, with lengths in a unit.
    pub(crate) fn form(&self, unit: f64) -> VisibilityForm {
        match *self {
            Self::Cone { angle, pixels } => VisibilityForm::Cones { angle, pixels },
            Self::Softmax {
                sigma,
                gamma,
                epsilon,
            } => VisibilityForm::Softmax(Softmax {
                sigma: sigma / (unit * unit),
                gamma,
                epsilon,
            }),
        }
    }

    pub(crate) fn is_softmax(&self) -> bool {
        matches!(self.form(1.0), VisibilityForm::Softmax(_))
    }

    /// Sets the blur of rays: the half-angle of cones, or σ.
    pub(crate) fn set_blur(&mut self, blur: f64) {
        match self {
            Self::Cone { angle, .. } => *angle = blur,
            Self::Softmax { sigma, .. } => *sigma = blur,
        }
    }

    pub(crate) fn check(&self) -> Result<()> {
        let invalid =
            |field, value, expected| Err(Error::invalid("options", field, value, expected));
        match *self {
            Self::Cone { angle, pixels } => {
                if !(0.0..1.2).contains(&angle) {
                    return invalid("blur angle", angle, "radians in [0, 1.2)");
                }
                if !(pixels.is_finite() && pixels >= 0.0) {
                    return invalid("pixels", pixels, "a finite number ≥ 0");
                }
            }
            Self::Softmax {
                sigma,
                gamma,
                epsilon,
            } => {
                for (field, value) in [("blur sigma", sigma), ("gamma", gamma)] {
                    if !(value.is_finite() && value > 0.0) {
                        return invalid(field, value, "a finite number > 0");
                    }
                }
                if !(epsilon.is_finite() && epsilon >= 0.0) {
                    return invalid("epsilon", epsilon, "a finite number ≥ 0");
                }
            }
        }
        Ok(())
    }
}
