//! Creation and update of parameters, and functions that keep values in their range.

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{DType, Device, Tensor, TensorData};

/// Logarithms beyond ± this value count as this value, so that squares of the exponentials stay finite in f32.
const LARGEST_LOG: f64 = 30.0;

/// Casts all float parameters of a module to a float type. Their ids are kept, and trained parameters stay
/// trained. Use f64 for exact gradients, on devices that support it.
///
/// ```
/// use burn::tensor::DType;
/// use softray::modules::cast;
/// use softray::prelude::*;
/// let pose = RigidTransformConfig::new().init(&Device::flex())?;
/// assert_eq!(cast(pose, DType::F64).translation.val().dtype(), DType::F64);
/// # Ok::<(), softray::Error>(())
/// ```
pub fn cast<M: Module>(module: M, dtype: DType) -> M {
    struct Cast(DType);
    impl ModuleMapper for Cast {
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            param.map(|tensor| {
                let trained = tensor.is_require_grad();
                // Detached last, because the result of an operation is not a leaf tensor.
                tensor.cast(self.0).detach().set_require_grad(trained)
            })
        }
    }
    module.map(&mut Cast(dtype))
}

/// Creates a parameter in the device's default float type.
pub(super) fn leaf<const D: usize>(
    values: Vec<f64>,
    shape: [usize; D],
    device: &Device,
) -> Param<Tensor<D>> {
    Param::from_tensor(Tensor::from_data(TensorData::new(values, shape), device))
}

/// Replaces the values of a parameter. Its id, shape, device and float type stay, and a trained parameter stays
/// trained.
pub(super) fn set<const D: usize>(param: Param<Tensor<D>>, values: Vec<f64>) -> Param<Tensor<D>> {
    let (id, old) = (param.id, param.val());
    let data = TensorData::new(values, old.dims());
    let new = Tensor::from_data(data, (&old.device(), old.dtype()));
    param.transform_for_load(new, id)
}

/// Returns e^x of a logarithm: more than 0 and finite for any parameter.
pub(super) fn positive<const D: usize>(log: Tensor<D>) -> Tensor<D> {
    log.clamp(-LARGEST_LOG, LARGEST_LOG).exp()
}

/// Returns ln(p/(1 − p)).
pub(super) fn logit(p: f64) -> f64 {
    (p / (1.0 - p)).ln()
}
