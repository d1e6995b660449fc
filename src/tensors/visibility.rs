//! The forms of visibility: hard surfaces along the rays of cones, or the paper's blurred triangles (Eq. 1),
//! which share a ray by a softmax over depth (Eq. 3).

use std::fmt;

use serde::{Deserialize, Serialize};

use super::softmax::Softmax;
use crate::error::{Error, Result};

/// The form of visibility in a render. Gradients are derivatives of the image in this form.
///
/// `docs/VISIBILITY.md` compares both forms by measurement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Visibility {
    /// Hard surfaces, blurred by rays that are jittered within cones: the default.
    ///
    /// A pixel filter jitters each primary ray. A cone about the sampled direction jitters each bounce or shadow ray.
    /// Both have a smooth kernel, so the image is a differentiable function of the geometry. Gradients are derivatives
    /// of the rendered image. They sample silhouettes, borders, creases, and lines in which surfaces pass through each
    /// other separately, so they are correct at an angle of 0 too, and not noisier there.
    Cone {
        /// Half-angle of the cones of bounce and shadow rays in radians, at least 0 and less than 1.2. It softens
        /// shadows and reflections with a standard deviation of 0.35 of the angle.
        angle: f64,
        /// Radius of the pixel filter beyond the pixel itself, in pixels, at least 0. The kernel is (1 − r²)² in x and
        /// in y.
        pixels: f64,
    },
    /// The paper's form (Eq. 1 and 3, corrected).
    ///
    /// Each triangle counts by p = sigmoid(±D/σ), where D is the squared distance, in the triangle's plane, of a ray's
    /// hit from the border. The triangles of a ray share it by a softmax over log p_k + z_k/γ, with z_k = (far −
    /// t_k)/(far − near), and ε/γ for the background. Light passes by ∏(1 − p_k).
    Softmax {
        /// Blur of edges σ, in squared scene units.
        sigma: f64,
        /// Blur in depth γ, in units of the scene's depth.
        gamma: f64,
        /// ε, which sets the score ε/γ of the background.
        epsilon: f64,
    },
}

/// The parameters with which a form of visibility is computed.
pub(crate) enum VisibilityForm {
    Cones { angle: f64, pixels: f64 },
    Softmax(Softmax),
}

impl Default for Visibility {
    /// Returns cones with an angle of 0, and a pixel filter with a radius of half a pixel.
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
    /// Returns cones of a half-angle in radians, with a pixel filter of half a pixel.
    pub fn cone(angle: f64) -> Self {
        Self::Cone { angle, pixels: 0.5 }
    }

    /// Returns the softmax form with ε = 1e-3. `sigma` is in squared scene units, `gamma` in units of the scene's
    /// depth.
    pub fn softmax(sigma: f64, gamma: f64) -> Self {
        Self::Softmax {
            sigma,
            gamma,
            epsilon: 1e-3,
        }
    }

    /// Returns the parameters of the form, with lengths in units of `unit`.
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

    /// Sets the blur of rays: the half-angle of cones, or σ of the softmax.
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
