//! The trained numbers of a module as one list.

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::optim::GradientsParams;
use burn::tensor::{Tensor, TensorData};

use crate::error::Result;
use crate::geometry::host_values;

/// Returns the trained numbers of a module, and the path of the parameter of each.
pub(super) fn numbers<M: Module>(module: &M) -> Result<(Vec<f64>, Vec<String>)> {
    let mut read = Read {
        path: Vec::new(),
        all: Ok(Vec::new()),
    };
    module.visit(&mut read);
    Ok(read.all?.into_iter().unzip())
}

struct Read {
    path: Vec<String>,
    all: Result<Vec<(f64, String)>>,
}

impl ModuleVisitor for Read {
    fn enter_module(&mut self, name: &str, _container_type: &str) {
        self.path.push(name.into());
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if !is_trained(param) {
            return;
        }
        if let Ok(all) = &mut self.all {
            match host_values(&param.val()) {
                Ok(values) => {
                    let path = self.path.join(".");
                    all.extend(values.into_iter().map(|v| (v, path.clone())));
                }
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

/// Returns numbers as the gradients of a module's trained parameters.
pub(super) fn gradients<M: Module>(module: &M, numbers: &[f64]) -> GradientsParams {
    let mut gradients = Gradients {
        numbers,
        all: GradientsParams::new(),
    };
    module.visit(&mut gradients);
    gradients.all
}

struct Gradients<'a> {
    numbers: &'a [f64],
    all: GradientsParams,
}

impl ModuleVisitor for Gradients<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if is_trained(param) {
            let own = take(&mut self.numbers, &param.val());
            self.all.register(param.id, own);
        }
    }
}
