use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::GradientsParams;
use burn::tensor::Tensor;

use crate::error::Result;
use crate::geometry::host_values;

/// The gradients of a module's parameters before clipping.
pub(super) struct Found {
    /// Their Euclidean norm, None if there are none.
    pub norm: Option<f64>,
    /// The paths of parameters without one that are not frozen.
    pub missing: Vec<String>,
}

/// Scales gradients so that their norm is at most `most`.
pub(super) fn clip<M: Module>(
    module: &M,
    gradients: &mut GradientsParams,
    most: Option<f64>,
) -> Result<Found> {
    let mut squares = Squares {
        gradients,
        sum: Ok(None),
        path: Vec::new(),
        missing: Vec::new(),
    };
    module.visit(&mut squares);
    let Squares { sum, missing, .. } = squares;
    let norm = sum?.map(f64::sqrt);
    if let (Some(norm), Some(most)) = (norm, most)
        && norm > most
        && norm.is_finite()
    {
        let factor = most / norm;
        module.visit(&mut Scale { gradients, factor });
    }
    Ok(Found { norm, missing })
}

struct Squares<'a> {
    gradients: &'a GradientsParams,
    sum: Result<Option<f64>>,
    path: Vec<String>,
    missing: Vec<String>,
}

impl ModuleVisitor for Squares<'_> {
    fn enter_module(&mut self, name: &str, _container_type: &str) {
        self.path.push(name.into());
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let Some(gradient) = self.gradients.get::<D>(param.id) else {
            let tensor = param.base();
            let frozen = tensor.is_autodiff() && !tensor.is_require_grad();
            if !frozen {
                self.missing.push(self.path.join("."));
            }
            return;
        };
        let square = host_values(&gradient).map(|v| v.iter().map(|x| x * x).sum::<f64>());
        match (&mut self.sum, square) {
            (Ok(sum), Ok(square)) => *sum = Some(sum.unwrap_or(0.0) + square),
            (sum, Err(error)) => *sum = Err(error),
            (Err(_), _) => {}
        }
    }
}

struct Scale<'a> {
    gradients: &'a mut GradientsParams,
    factor: f64,
}

impl ModuleVisitor for Scale<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if let Some(gradient) = self.gradients.remove::<D>(param.id) {
            self.gradients.register(param.id, gradient * self.factor);
        }
    }
}
