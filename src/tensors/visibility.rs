//! The forms of visibility: hard surfaces along the rays of cones, or the paper's blurred triangles (Eq. 1),
//! which share a ray by a softmax over depth (Eq. 3).

use std::fmt;

use serde::{Deserialize, Serialize};

use super::softmax::Softmax;
use crate::error::{Error, Result};
use crate::scene::Bounds;

/// The form of visibility in a render. Gradients are derivatives of the image in this form.
///
/// `docs/VISIBILITY.md` compares both forms by measurement.
///
/// ```
/// use softray::prelude::*;
/// let (room, camera) = cornell_box(&Device::flex());
/// let options = RenderOptions::new(8, 8).with_samples(1).with_bounces(0);
/// let cones = options.clone().with_visibility(Visibility::cone(1.0));
/// assert!(render(&room, &camera, &cones)?.statistics.rays > 0);
/// let softmax = SoftmaxOptions::new(1e-3, 1e-2).with_cutoff(1e-3);
/// let image = render(&room, &camera, &options.with_visibility(softmax))?;
/// println!("{} surfaces per ray", image.statistics.surfaces.mean);
/// # Ok::<(), softray::Error>(())
/// ```
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
        /// Half-angle of the cones of bounce and shadow rays in degrees, at least 0 and less than 68. It softens
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
    Softmax(SoftmaxOptions),
}

/// The settings of [`Visibility::Softmax`].
///
/// [`Visibility`] has an example.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct SoftmaxOptions {
    /// Blur of edges σ, in squared scene units, more than 0.
    pub sigma: f64,
    /// Blur in depth γ, in units of the scene's depth, more than 0.
    pub gamma: f64,
    /// ε ≥ 0, which sets the score ε/γ of the background; 1e-3 by default.
    #[serde(default = "epsilon")]
    pub epsilon: f64,
    /// In (0, 0.5); 1e-4 by default. A ray may skip triangles that cover less of it than the cutoff, and surfaces
    /// behind an opacity of more than 1 − cutoff.
    #[serde(default = "cutoff")]
    pub cutoff: f64,
    /// Whether every triangle is tested for every ray, in tensors, as renders on GPUs always do; false by default. It
    /// is slow, and the specification of the BVH.
    #[serde(default)]
    pub brute_force: bool,
    /// The bounding box (scene units) whose circumscribed sphere sets the scale of depths and tolerances; by default
    /// the sphere around the scene's vertices. Finite differences need the same bounds on both sides; see
    /// [`Scene::bounds`](crate::scene::Scene::bounds).
    #[serde(default)]
    pub bounds: Option<Bounds>,
}

/// The default of [`SoftmaxOptions::with_epsilon`].
const fn epsilon() -> f64 {
    1e-3
}

/// The default of [`SoftmaxOptions::with_cutoff`].
const fn cutoff() -> f64 {
    1e-4
}

impl SoftmaxOptions {
    /// Creates settings with defaults for all but σ and γ.
    pub const fn new(sigma: f64, gamma: f64) -> Self {
        Self {
            sigma,
            gamma,
            epsilon: epsilon(),
            cutoff: cutoff(),
            brute_force: false,
            bounds: None,
        }
    }

    /// Sets ε.
    pub const fn with_epsilon(mut self, epsilon: f64) -> Self {
        self.epsilon = epsilon;
        self
    }

    /// Sets the cutoff.
    pub const fn with_cutoff(mut self, cutoff: f64) -> Self {
        self.cutoff = cutoff;
        self
    }

    /// Tests every triangle for every ray.
    pub const fn with_brute_force(mut self) -> Self {
        self.brute_force = true;
        self
    }

    /// Sets the bounds.
    pub const fn with_bounds(mut self, bounds: Bounds) -> Self {
        self.bounds = Some(bounds);
        self
    }

    fn check(&self) -> Result<()> {
        let valid = |field, value: f64, valid: bool, expected: &str| {
            Error::unless(valid, "options", field, value, expected)
        };
        for (field, value) in [("sigma", self.sigma), ("gamma", self.gamma)] {
            let positive = value.is_finite() && value > 0.0;
            valid(field, value, positive, "a finite number > 0")?;
        }
        let epsilon = self.epsilon.is_finite() && self.epsilon >= 0.0;
        valid("epsilon", self.epsilon, epsilon, "a finite number ≥ 0")?;
        let cutoff = self.cutoff > 0.0 && self.cutoff < 0.5;
        valid("cutoff", self.cutoff, cutoff, "a number in (0, 0.5)")?;
        let Some(b) = self.bounds else {
            return Ok(());
        };
        let is_box = b.size().iter().all(|&s| s >= 0.0) && b.radius().is_finite();
        let is_valid = is_box && b.radius() > 0.0 && b.center().iter().all(|c| c.is_finite());
        let expected = "a finite box, min <= max, that is more than a point";
        Error::unless(is_valid, "options", "bounds", format!("{b:?}"), expected)
    }
}

impl From<SoftmaxOptions> for Visibility {
    fn from(options: SoftmaxOptions) -> Self {
        Self::Softmax(options)
    }
}

/// The parameters with which a form of visibility is computed.
pub(crate) enum VisibilityForm {
    /// Cones of a half-angle in radians.
    Cones {
        angle: f64,
        pixels: f64,
    },
    Softmax(Softmax, SoftmaxOptions),
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
                write!(f, "cones of {angle}°, filter of {pixels} px")
            }
            Self::Softmax(SoftmaxOptions {
                sigma,
                gamma,
                epsilon,
                ..
            }) => write!(f, "softmax of σ {sigma}, γ {gamma}, ε {epsilon}"),
        }
    }
}

impl Visibility {
    /// Returns cones of a half-angle in degrees, with a pixel filter of radius half a pixel.
    pub const fn cone(angle: f64) -> Self {
        Self::Cone { angle, pixels: 0.5 }
    }

    /// Returns the softmax form with ε = 1e-3. `sigma` is in squared scene units, `gamma` in units of the scene's
    /// depth.
    pub const fn softmax(sigma: f64, gamma: f64) -> Self {
        Self::Softmax(SoftmaxOptions::new(sigma, gamma))
    }

    /// Returns the parameters of the form, with lengths in units of `unit`.
    pub(crate) fn form(&self, unit: f64) -> VisibilityForm {
        match *self {
            Self::Cone { angle, pixels } => VisibilityForm::Cones {
                angle: angle.to_radians(),
                pixels,
            },
            Self::Softmax(options) => {
                let parameters = Softmax {
                    sigma: options.sigma / (unit * unit),
                    gamma: options.gamma,
                    epsilon: options.epsilon,
                };
                VisibilityForm::Softmax(parameters, options)
            }
        }
    }

    pub(crate) fn softmax_options(&self) -> Option<&SoftmaxOptions> {
        match self {
            Self::Cone { .. } => None,
            Self::Softmax(options) => Some(options),
        }
    }

    pub(crate) fn is_softmax(&self) -> bool {
        self.softmax_options().is_some()
    }

    pub(crate) fn check(&self) -> Result<()> {
        let invalid =
            |field, value, expected| Err(Error::invalid("options", field, value, expected));
        match *self {
            Self::Cone { angle, pixels } => {
                if !(0.0..68.0).contains(&angle) {
                    return invalid("blur angle", angle, "degrees in [0, 68)");
                }
                if !(pixels.is_finite() && pixels >= 0.0) {
                    return invalid("pixels", pixels, "a finite number ≥ 0");
                }
            }
            Self::Softmax(options) => options.check()?,
        }
        Ok(())
    }
}
