use burn::config::Config;
use burn::module::{Module, Param};
use burn::tensor::{Device, Int, Tensor};

use super::values::{leaf, positive};
use crate::error::{Error, Result};

/// The configuration of [`ExposureParams`], which start with equal factors.
#[derive(Config, Debug)]
pub struct ExposureParamsConfig {
    /// The number of photographs.
    pub count: usize,
}

impl ExposureParamsConfig {
    /// Creates the factors, in the device's default float type.
    ///
    /// # Errors
    /// If there is no photograph.
    pub fn init(&self, device: &Device) -> Result<ExposureParams> {
        let expected = "at least one";
        Error::unless(self.count > 0, "exposure", "count", self.count, expected)?;
        Ok(ExposureParams {
            log_factors: leaf(vec![0.0; 3 * self.count], [self.count, 3], device),
        })
    }
}

/// The exposure and white balance of photographs, as a factor for each channel of each of them. All factors of a channel
/// have a product of 1, because a common one belongs to the light.
///
/// ```
/// use softray::modules::ExposureParamsConfig;
/// use softray::prelude::*;
/// let exposure = ExposureParamsConfig::new(40).init(&Device::flex().autodiff())?;
/// assert_eq!(exposure.factors(&[3, 5])?.dims(), [2, 3]);
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module)]
pub struct ExposureParams {
    /// Logarithms of the factors, up to a number for each channel, `[N, 3]`.
    pub log_factors: Param<Tensor<2>>,
}

impl ExposureParams {
    /// Returns the factors of some photographs, `[views.len(), 3]`, in the graph of the parameters.
    ///
    /// # Errors
    /// If there is no photograph of an index.
    pub fn factors(&self, views: &[usize]) -> Result<Tensor<2>> {
        let all = self.log_factors.val();
        let [count, _] = all.dims();
        if let Some(view) = views.iter().find(|&&view| view >= count) {
            let expected = format!("less than {count}");
            return Err(Error::invalid("exposure", "view", view, expected));
        }
        let rows: Vec<i32> = views.iter().map(|&view| view as i32).collect();
        let rows = Tensor::<1, Int>::from_ints(rows.as_slice(), &all.device());
        Ok(positive((all.clone() - all.mean_dim(0)).select(0, rows)))
    }
}
