//! Parameters of any module by name: their values, gradients and steps.

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Gradients, Tensor};

use crate::common::values;

/// A parameter of a module.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedParameter {
    pub name: String,
    pub values: Vec<f64>,
    pub trained: bool,
    pub gradient: Option<Vec<f64>>,
}

/// All float parameters of a module, with their gradients where some are given.
pub fn parameters<M: Module>(module: &M, gradients: Option<&Gradients>) -> Vec<NamedParameter> {
    struct Visit<'a> {
        path: Vec<String>,
        gradients: Option<&'a Gradients>,
        parameters: Vec<NamedParameter>,
    }
    impl ModuleVisitor for Visit<'_> {
        fn enter_module(&mut self, name: &str, _: &str) {
            self.path.push(name.into());
        }
        fn exit_module(&mut self, _: &str, _: &str) {
            self.path.pop();
        }
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let tensor = param.val();
            let gradient = self.gradients.and_then(|g| tensor.grad(g));
            self.parameters.push(NamedParameter {
                name: self.path.join("."),
                values: values(&tensor),
                trained: tensor.is_require_grad(),
                gradient: gradient.map(|g| values(&g)),
            });
        }
    }
    let mut visit = Visit {
        path: Vec::new(),
        gradients,
        parameters: Vec::new(),
    };
    module.visit(&mut visit);
    visit.parameters
}

/// A module whose parameters are changed by a function of name, component and value.
pub fn changed<M: Module>(module: M, change: impl Fn(&str, usize, f64) -> f64) -> M {
    struct Change<'a> {
        path: Vec<String>,
        change: &'a dyn Fn(&str, usize, f64) -> f64,
    }
    impl ModuleMapper for Change<'_> {
        fn enter_module(&mut self, name: &str, _: &str) {
            self.path.push(name.into());
        }
        fn exit_module(&mut self, _: &str, _: &str) {
            self.path.pop();
        }
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            let (name, old, id) = (self.path.join("."), param.val(), param.id);
            let new: Vec<f64> = values(&old)
                .into_iter()
                .enumerate()
                .map(|(i, v)| (self.change)(&name, i, v))
                .collect();
            let data = burn::tensor::TensorData::new(new, old.dims());
            let new = Tensor::from_data(data, (&old.device(), old.dtype()));
            param.transform_for_load(new, id)
        }
    }
    module.map(&mut Change {
        path: Vec::new(),
        change: &change,
    })
}
