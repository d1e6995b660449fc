//! Parts of scenes as burn modules, with parameters for optimizers, records and files; a renderer and a loss.
//!
//! Each type turns its parameters into a part of a [`Scene`](crate::scene::Scene): [`MeshParams`] and
//! [`MeshOffsets`] into a mesh, [`RigidTransform`] into a transform, [`CameraParams`] into a camera,
//! [`TextureParams`] into an albedo, [`EnvironmentParams`] into an environment, [`MaterialParams`] into a
//! material. A value with a range is stored as a logarithm or a logit, so no step of an optimizer leaves the
//! range.
//!
//! They behave like burn's own modules. On a device with autodiff their parameters are trained. On a device
//! without autodiff they are trained after a call of `.train()`. The modules can be fields of another module,
//! frozen, saved and loaded:
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
//!         let object = Object::new(self.pose.apply(mesh)).with_material(self.surface.material());
//!         let scene = Scene::new().with_object(object).with_environment([1.0, 1.0, 1.0]);
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
//!     renderer: Renderer::new(RenderOptions::new(8, 8).with_samples(2))?,
//!     loss: RenderLossConfig::new().init()?,
//! };
//! let loss = ball.forward(Tensor::zeros([8, 8, 3], &Device::flex()), 0)?;
//! let gradients = loss.backward();
//! assert!(ball.pose.translation.val().grad(&gradients).is_some());
//! # Ok::<(), softray::Error>(())
//! ```
//!
//! Records and files contain only the parameters. Constants (faces, texture coordinates, the form of a
//! rotation) come from the module into which they are loaded. Its parameters must have the same shapes as the
//! saved ones. `save_file` and `try_load_file` of burn's `Module` write and read burnpack. `save_safetensors`
//! and `load_safetensors` of this module (feature `safetensors`) use a format that other frameworks also read.

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
