//! The moving average of a module's parameters.

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::optim::GradientsParams;
use burn::tensor::Tensor;

/// A moving average of the trained parameters of a module, and the other parameters as they are.
#[derive(Clone)]
pub(super) struct Average<M> {
    pub decay: f64,
    pub module: M,
}

impl<M: Module> Average<M> {
    /// Takes in the parameters after `steps` steps, see [`Fit::with_average`](super::Fit::with_average).
    pub fn take(&mut self, module: &M, steps: usize) {
        let n = steps as f64;
        let mut values = Values(GradientsParams::new());
        module.visit(&mut values);
        let mut mix = Mix {
            values: values.0,
            keep: self.decay.min(n / (n + 9.0)),
        };
        self.module = self.module.clone().map(&mut mix);
    }
}

/// Trained parameters, without autodiff, by the identifiers of parameters.
struct Values(GradientsParams);

impl ModuleVisitor for Values {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let tensor = param.val();
        if tensor.is_require_grad() {
            self.0.register(param.id, tensor.inner());
        }
    }
}

struct Mix {
    values: GradientsParams,
    keep: f64,
}

impl ModuleMapper for Mix {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let Some(value) = self.values.remove::<D>(param.id) else {
            return param;
        };
        let keep = self.keep;
        param.map(|average| {
            let mixed = average.inner() * keep + value * (1.0 - keep);
            mixed.autodiff().require_grad()
        })
    }
}
