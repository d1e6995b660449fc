//! `Debug` of modules prints the shapes of their parameters, or their values if they are few. burn prints a
//! learner's modules in this form.

use std::fmt::{self, Debug, Formatter};

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::Tensor;

use super::{
    CameraParams, DMTetParams, EnvironmentParams, ExposureParams, LensParams, MaterialParams,
    MeshOffsets, MeshParams, NormalMapParams, RigidTransform, SurfaceNetwork, TextureParams,
    TexturedMeshParams, ViewpointParams,
};
use crate::debug::{Text, parameter};

/// The parameters, named by the paths of their fields.
#[derive(Default)]
struct Parameters {
    path: Vec<String>,
    shown: Vec<(String, Text)>,
}

impl ModuleVisitor for Parameters {
    fn enter_module(&mut self, name: &str, _container_type: &str) {
        self.path.push(name.into());
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, p: &Param<Tensor<D>>) {
        self.shown.push((self.path.join("."), parameter(p)));
    }
}

fn show<M: Module>(module: &M, name: &str, f: &mut Formatter<'_>) -> fmt::Result {
    let mut parameters = Parameters::default();
    module.visit(&mut parameters);
    let mut all = f.debug_struct(name);
    for (field, value) in &parameters.shown {
        all.field(field, value);
    }
    all.finish()
}

macro_rules! debug {
    ($($module:ident)*) => {$(
        impl Debug for $module {
            fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
                show(self, stringify!($module), f)
            }
        }
    )*};
}

debug!(CameraParams DMTetParams EnvironmentParams ExposureParams LensParams MaterialParams MeshOffsets MeshParams NormalMapParams RigidTransform SurfaceNetwork TextureParams TexturedMeshParams ViewpointParams);
