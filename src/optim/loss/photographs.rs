//! Losses between renders and photographs.

use burn::tensor::{Device, Tensor};

use super::check_pair;
use crate::error::{Error, Result};
use crate::geometry::host_values;
use crate::photographs::Photograph;
use crate::render::ImageBatch;

/// The mask above which a pixel shows nothing but the object, and the opacity above which a render does.
const WHOLE: [f32; 2] = [0.99, 0.999];
/// The linear value from which a channel of a photograph counts as clipped.
const CLIPPED: f32 = 0.96;
/// The linear value below which the sRGB curve goes on along its tangent: darker values are mostly noise.
const DARKEST: f64 = 0.02;
/// The exponent and the factor of the sRGB curve.
const CURVE: [f64; 2] = [1.0 / 2.4, 1.055];
/// The error of an sRGB value beyond which a pixel counts as an outlier.
const OUTLIER: f64 = 1.0;

/// A mini-batch of photographs with masks, to compare renders with.
///
/// Colors are compared where the mask and the render show nothing but the object, because a photograph is masked and a render
/// is not. The error of a channel is the difference of sRGB values, so that it counts as it looks; below a linear value of
/// 0.02, where the curve is steep and photographs are noisy, its tangent at 0.02 replaces it. Errors ρ(e) are quadratic up
/// to about 1 and linear beyond (pseudo-Huber, Charbonnier et al. 1997): only a render that is brighter than white is an outlier. A
/// clipped channel says "at least": a brighter render has no error there.
///
/// # Noise
/// The square of a noisy value is too large by its variance, so a fit by it prefers what has less noise: a matt surface to a
/// glossy one. Here two independent renders are multiplied, as in [`mse_unbiased`](super::mse_unbiased): the errors are the
/// values of one render, which is detached, and gradients come from the other one. The first needs no backward pass, so it can
/// have more samples. Noise of variance σ² biases the gradient by the bend of the sRGB curve alone, as if a value v were too
/// dark by about 0.3·σ²/v, and by outliers and clipped channels.
///
/// ```
/// use softray::loss::PhotographLoss;
/// use softray::photographs::{PhotographOptions, Photographs};
/// use softray::prelude::*;
/// let set = Photographs::open("tests/data/photographs")?;
/// let options = PhotographOptions::new().with_longest_side(16).with_black_backdrop(true);
/// let photographs = set.load(&[0], &options)?.photographs;
/// let device = Device::flex().autodiff();
/// let color = Tensor::<1>::from_floats([0.5, 0.5, 0.5], &device).require_grad();
/// let ball = shapes::icosphere(2, &device).scaled(1.3);
/// let ball = Object::new(ball).with_material(Material::diffuse(color));
/// let scene = Scene::new().with_object(ball).with_environment([0.4; 3]);
/// let camera = photographs[0].camera.to_camera()?;
/// let batch = Batch::new(vec![scene], vec![camera])?;
/// let options = RenderOptions::new(16, 16).with_bounces(0).with_opacity();
/// let errors = render_batch(&batch, &options.clone().with_samples(16).with_seed(1))?;
/// let image = render_batch(&batch, &options.with_samples(4))?;
/// let views: Vec<_> = photographs.iter().collect();
/// let errors = PhotographLoss::new(&views, &device)?.forward(&errors, &image, None)?;
/// let loss = errors.color + errors.silhouette;
/// assert!(errors.psnr > 5.0 && loss.into_scalar::<f32>() > 0.0);
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct PhotographLoss {
    color: Tensor<4>,
    mask: Tensor<3>,
    /// The part of each pixel that a photograph shows.
    weight: Tensor<3>,
    /// The weights of pixels `[N, H, W, 1]`: 0 where a photograph shows anything else.
    inside: Tensor<4>,
    /// 1 where a channel is clipped.
    clipped: Tensor<4>,
}

/// What [`PhotographLoss::forward`] returns.
#[derive(Clone, Debug)]
pub struct PhotographErrors {
    /// The mean of ρ(e) over the channels that are compared, `[1]`; about e² for small errors.
    pub color: Tensor<1>,
    /// The mean squared difference of opacity and mask in the pixels that the photographs show, over the mean of the masks
    /// there, `[1]`.
    pub silhouette: Tensor<1>,
    /// −10 log₁₀ of the mean of e² in dB: about the PSNR of sRGB values inside of the masks, less for a noisy render. It is
    /// infinite if no pixel is compared.
    pub psnr: f64,
}

impl PhotographLoss {
    /// Puts N photographs of the same size on a device.
    ///
    /// # Errors
    /// If there is none, sizes differ, the lists of one are not those of its camera's image, or none of their pixels is inside
    /// of a mask.
    pub fn new(photographs: &[&Photograph], device: &Device) -> Result<Self> {
        let device = &device.clone().inner();
        let size = photographs.first().map(|p| p.camera.size);
        let expected = "at least one, all of the same size";
        let same = size.is_some() && photographs.iter().all(|p| Some(p.camera.size) == size);
        let count = photographs.len();
        Error::unless(same, "photographs", "number", count, expected)?;
        photographs.iter().try_for_each(|p| p.check())?;
        let [width, height] = size.unwrap_or_default();
        let of = |value: &dyn Fn(&Photograph) -> Vec<f32>| {
            let values: Vec<f32> = photographs.iter().flat_map(|p| value(p)).collect();
            Tensor::<1>::from_floats(values.as_slice(), device)
        };
        let color = of(&|p| p.color.pixels.clone()).reshape([count, height, width, 3]);
        let inside = of(&|p| {
            let pixels = p.mask.iter().zip(&p.weight);
            pixels
                .map(|(&m, &w)| if m > WHOLE[0] { w } else { 0.0 })
                .collect()
        });
        let any = host_values(&inside.clone().max())?.iter().any(|&w| w > 0.0);
        Error::unless(any, "photographs", "masks", "empty", "pixels of the object")?;
        Ok(Self {
            mask: of(&|p| p.mask.clone()).reshape([count, height, width]),
            weight: of(&|p| p.weight.clone()).reshape([count, height, width]),
            inside: inside.reshape([count, height, width, 1]),
            clipped: color.clone().greater_equal_elem(CLIPPED).float(),
            color,
        })
    }

    /// Compares two independent renders (of other seeds) with opacities: `errors`, of which values alone are used, and
    /// `image`, of which derivatives alone are. `factors` `[N, 3]` multiply the radiance of each view, as those of
    /// [`ExposureParams`](crate::modules::ExposureParams). The losses have the values of `errors`.
    ///
    /// # Errors
    /// If a render has no opacity, or shapes or float types differ from those of the photographs.
    pub fn forward(
        &self,
        errors: &ImageBatch,
        image: &ImageBatch,
        factors: Option<Tensor<2>>,
    ) -> Result<PhotographErrors> {
        let [count, ..] = self.color.dims();
        let ones = || Tensor::<2>::ones([count, 3], &image.radiance.device());
        let factors = factors.unwrap_or_else(ones);
        check_pair("photographs", &factors, &ones().cast(self.color.dtype()))?;
        let factors = factors.reshape([count, 1, 1, 3]);
        let shown = |image: &ImageBatch, factors: Tensor<4>| {
            check_pair("photographs", &image.radiance, &self.color)?;
            let missing = || Error::invalid("photographs", "opacity", "none", "with_opacity");
            let opacity = image.opacity.clone().ok_or_else(missing)?;
            check_pair("photographs", &opacity, &self.mask)?;
            Ok((image.radiance.clone() * factors, opacity))
        };
        let (seen, covered) = shown(errors, factors.clone().detach())?;
        let (seen, covered) = (seen.detach().inner(), covered.detach().inner());
        let (color, opacity) = shown(image, factors)?;
        let whole = covered.clone().greater_equal_elem(WHOLE[1]).float()
            * opacity
                .clone()
                .detach()
                .inner()
                .greater_equal_elem(WHOLE[1])
                .float();
        let inside = self.inside.clone() * whole.unsqueeze_dim(3);
        let total = (inside.clone().sum() * 3.0).clamp_min(1.0);

        let (looks, slopes) = curve(seen);
        let error = looks - curve(self.color.clone()).0;
        let brighter = error.clone().greater_elem(0.0).float() * self.clipped.clone();
        let weight = (brighter.neg() + 1.0) * inside / total.unsqueeze();
        let root = ((error.clone() / OUTLIER).powi_scalar(2) + 1.0).sqrt();
        let value = ((root.clone() - 1.0) * weight.clone()).sum() * (2.0 * OUTLIER * OUTLIER);
        let slope = error.clone() * slopes * weight.clone() / root * 2.0;
        let squared = host_values(&(error.powi_scalar(2) * weight).sum())?;

        let off = covered - self.mask.clone();
        let area = (self.mask.clone() * self.weight.clone()).sum();
        let weight = self.weight.clone() / area.unsqueeze();
        let by_opacity = off.clone() * weight.clone() * 2.0;
        let silhouette = (off.powi_scalar(2) * weight).sum();
        Ok(PhotographErrors {
            color: with_gradient(value, color, slope),
            silhouette: with_gradient(silhouette, opacity, by_opacity),
            psnr: -10.0 * squared.first().copied().map_or(f64::NAN, f64::from).log10(),
        })
    }
}

/// The sRGB curve of linear values, with its tangent below [`DARKEST`], and its slope.
fn curve(linear: Tensor<4>) -> (Tensor<4>, Tensor<4>) {
    let [exponent, factor] = CURVE;
    let bright = linear.clone().clamp_min(DARKEST);
    let value = bright.clone().powf_scalar(exponent) * factor;
    let slope = value.clone() / bright.clone() * exponent;
    (value + (linear - bright) * slope.clone(), slope)
}

/// A constant with a given derivative by the elements of `of`.
fn with_gradient<const D: usize>(value: Tensor<1>, of: Tensor<D>, by: Tensor<D>) -> Tensor<1> {
    let linear = (of * Tensor::from_inner(by)).sum();
    linear.clone() - linear.detach() + Tensor::from_inner(value)
}
