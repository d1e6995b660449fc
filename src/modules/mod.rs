//! Parts of scenes as burn modules: parameters that optimisers, records and files know, a renderer and a loss.
//!
//! Each type turns its parameters into a part of a [`Scene`](crate::scene::Scene): [`MeshParams`] and
//! [`MeshOffsets`] into a mesh, [`RigidTransform`] into a transform, [`CameraParams`] into a camera,
//! [`TextureParams`] into an albedo, [`EnvironmentParams`] into an environment, [`MaterialParams`] into a
//! material. What has a range is kept in it by what the parameter means (a logarithm, a logit), so that
//! no step of an optimiser leads out of it.
//!
//! They are like burn's own modules: on a device with autodiff their parameters are trained; on a plain
//! one they are once `.train()` was called. They can be fields of a module, frozen, saved and loaded:
//!
//! ```
//! use burn::module::Module;
//! use softray::modules::{MaterialParams, MaterialParamsConfig, RigidTransform};
//! use softray::modules::{RenderLoss, RenderLossConfig, Renderer};
//! use softray::prelude::*;
//!
//! #[derive(Module, Debug)]
//! struct Ball {
//!     pose: RigidTransform,
//!     surface: MaterialParams,
//!     renderer: Renderer,
//!     loss: RenderLoss,
//! }
//!
//! impl Ball {
//!     /// What a training step takes backward: burn's `TrainStep` is this and a call of `TrainOutput::new`.
//!     fn forward(&self, target: Tensor<3>, seed: u64) -> softray::Result<Tensor<1>> {
//!         let mesh = shapes::icosahedron(&Device::flex());
//!         let object = Object::new(self.pose.apply(mesh)).material(self.surface.material());
//!         let scene = Scene::new().with(object).environment([1.0, 1.0, 1.0]);
//!         let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0]);
//!         let [a, b] = self.renderer.pair(&scene, &camera, seed)?;
//!         Ok(self.loss.forward_unbiased(a.radiance, b.radiance, target))
//!     }
//! }
//!
//! let device = Device::flex().autodiff();
//! let ball = Ball {
//!     pose: RigidTransform::new(&device),
//!     surface: MaterialParamsConfig::new().init(&device)?,
//!     renderer: Renderer::new(RenderOptions::new(8, 8).samples(2))?,
//!     loss: RenderLossConfig::new().init()?,
//! };
//! let loss = ball.forward(Tensor::zeros([8, 8, 3], &Device::flex()), 0)?;
//! let gradients = loss.backward();
//! assert!(ball.pose.translation.val().grad(&gradients).is_some());
//! # Ok::<(), softray::Error>(())
//! ```
//!
//! Records and files hold the parameters alone: what is constant (faces, texture coordinates, the form of
//! a rotation) comes from the module that they are loaded into, and its parameters must have the shapes
//! of those that were saved. `save_file` and `try_load_file` of burn's `Module` write and read burnpack,
//! `save_safetensors` and `load_safetensors` here (feature `safetensors`) the format that other frameworks read as well.

mod camera;
mod debug;
mod loss;
mod material;
mod mesh;
mod renderer;
#[cfg(feature = "safetensors")]
mod store;
mod texture;
mod transform;
mod values;

pub use camera::{Aim, AimForm, CameraParams, CameraParamsConfig, LensParams};
pub use loss::{RenderLoss, RenderLossConfig};
pub use material::{MaterialParams, MaterialParamsConfig};
pub use mesh::{MeshOffsets, MeshParams};
pub use renderer::Renderer;
#[cfg(feature = "safetensors")]
pub use store::{load_safetensors, save_safetensors};
pub use texture::{EnvironmentParams, NormalMapParams, TextureParams};
pub use transform::{RigidTransform, RigidTransformConfig, RotationForm};
pub use values::cast;
