//! The trained numbers of a module as one list.

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::optim::GradientsParams;
use burn::tensor::{Tensor, TensorData};

use crate::error::Result;
use crate::geometry::host_values;

/// Returns the trained numbers of a module.
pub(super) fn numbers<M: Module>(module: &M) -> Result<Vec<f64>> {
    let mut read = Read {
        all: Ok(Vec::new()),
    };
    module.visit(&mut read);
    read.all
}

struct Read {
    all: Result<Vec<f64>>,
}

impl ModuleVisitor for Read {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if let Ok(all) = &mut self.all
            && is_trained(param)
        {
            match host_values(&param.val()) {
                Ok(values) => all.extend(values),
                Err(error) => self.all = Err(error),
            }
        }
    }
}

fn is_trained<const D: usize>(param: &Param<Tensor<D>>) -> bool {
    let tensor = param.base();
    tensor.is_autodiff() && tensor.is_require_grad()
}

/// Returns the module with other trained numbers, which are not tracked.
pub(super) fn with_numbers<M: Module>(module: &M, numbers: &[f64]) -> M {
    module.clone().map(&mut Write { numbers })
}

struct Write<'a> {
    numbers: &'a [f64],
}

impl ModuleMapper for Write<'_> {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        if !is_trained(&param) {
            return param;
        }
        param.map(|tensor| take(&mut self.numbers, &tensor).autodiff())
    }
}

/// Takes the next numbers as a tensor like another one, without autodiff.
fn take<const D: usize>(numbers: &mut &[f64], like: &Tensor<D>) -> Tensor<D> {
    let like = like.clone().inner();
    let (own, rest) = numbers.split_at(like.shape().num_elements());
    *numbers = rest;
    let data = TensorData::new(own.to_vec(), like.shape());
    Tensor::from_data(data, (&like.device(), like.dtype()))
}

/// Returns the gradients with which a step of rate 1 moves the trained numbers by `step`. Parameters have none if `moves` is
/// false for all of their numbers.
pub(super) fn gradients<M: Module>(
    module: &M,
    step: &[f64],
    moves: impl Fn(usize) -> bool,
) -> GradientsParams {
    let mut gradients = Gradients {
        step,
        next: 0,
        moves: &moves,
        all: GradientsParams::new(),
    };
    module.visit(&mut gradients);
    gradients.all
}

struct Gradients<'a> {
    step: &'a [f64],
    next: usize,
    moves: &'a dyn Fn(usize) -> bool,
    all: GradientsParams,
}

impl ModuleVisitor for Gradients<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if is_trained(param) {
            let own = take(&mut self.step, &param.val());
            let own_numbers = self.next..self.next + own.shape().num_elements();
            self.next = own_numbers.end;
            if own_numbers.into_iter().any(self.moves) {
                self.all.register(param.id, -own);
            }
        }
    }
}
