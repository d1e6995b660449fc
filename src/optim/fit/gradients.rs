use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::GradientsParams;
use burn::tensor::Tensor;

use crate::error::Result;
use crate::geometry::host_values;

/// Scales the gradients of a module's parameters so that their norm is at most `most`; returns what it
/// was, None if there are no gradients.
pub(super) fn clip<M: Module>(
    module: &M,
    gradients: &mut GradientsParams,
    most: Option<f64>,
) -> Result<Option<f64>> {
    let mut squares = Squares {
        gradients,
        sum: Ok(None),
    };
    module.visit(&mut squares);
    let norm = squares.sum?.map(f64::sqrt);
    if let (Some(norm), Some(most)) = (norm, most)
        && norm > most
        && norm.is_finite()
    {
        let factor = most / norm;
        module.visit(&mut Scale { gradients, factor });
    }
    Ok(norm)
}

struct Squares<'a> {
    gradients: &'a GradientsParams,
    sum: Result<Option<f64>>,
}

impl ModuleVisitor for Squares<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let Some(gradient) = self.gradients.get::<D>(param.id) else {
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
