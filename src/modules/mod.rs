//! Parts of scenes as burn modules, with parameters for optimizers, records and files; a renderer and a loss.
//!
//! Each type turns its parameters into a part of a [`Scene`](crate::scene::Scene): [`MeshParams`],
//! [`MeshOffsets`] and, with any topology, [`DMTetParams`] into a mesh, [`RigidTransform`] into a transform, [`CameraParams`] into a camera, [`ViewpointParams`] into
//! the cameras of photographs,
//! [`TextureParams`] into a texture, [`NormalMapParams`] into a normal map, [`EnvironmentParams`] into an
//! environment, [`MaterialParams`] into a material. [`SurfaceNetwork`] computes textures of materials,
//! [`TexturedMeshParams`] is an object with a mesh, textures and such a network, and [`ExposureParams`] are factors of
//! photographs. [`AssetParams`] is all that is fitted to photographs of an object, and [`AssetLevel`] fits it.
//!
//! # Rules
//! - **Constructors**: a part is made from numbers by its configuration, `XConfig::new(…).with_y(…).init(&device)`,
//!   or from a value by `X::from_y(&value, &device)`. Both return a [`Result`](crate::Result), because numbers may be
//!   out of their range and tensors may not be readable. Meshes have no configuration, and transforms are not made
//!   from a value. Parameters are on `device`, in its default float type; [`cast`] changes it.
//! - **Outputs**: a module with an input computes its output by `forward`, as in burn: [`RigidTransform::forward`],
//!   [`Renderer::forward`], [`RenderLoss::forward`]. A part without an input has methods that are named for what they
//!   return ([`MeshParams::mesh`], [`EnvironmentParams::texels`] and [`EnvironmentParams::environment`]), because
//!   `forward()` would not say what it returns, and some parts have two outputs.
//! - **Names of parameters**: `logit_x` is the logit ln(x/(1 − x)) of x, or of x mapped from its range to (0, 1) (of
//!   shares, the softmax). `log_x` is ln x, or ln of x less the end of its range. The documentation of each field says
//!   which. A value with a range is stored in one of these forms, so no step of an optimizer leaves the range. Other
//!   names are values themselves. The names are the format of files.
//!
//! The modules behave like burn's own. On a device with autodiff their parameters are trained. On a device
//! without autodiff they are trained after a call of `.train()`. The modules can be fields of another module,
//! frozen, saved and loaded:
//!
//! ```
//! use burn::module::Module;
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
//!         let object = Object::new(self.pose.forward(mesh)).with_material(self.surface.material());
//!         let scene = Scene::new().with_object(object).with_environment([1.0, 1.0, 1.0]);
//!         let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0]);
//!         let [a, b] = self.renderer.forward_pair(&scene, &camera, seed)?;
//!         self.loss.forward_unbiased(a.radiance, b.radiance, target)
//!     }
//! }
//!
//! let device = Device::flex().autodiff();
//! let ball = Ball {
//!     pose: RigidTransformConfig::new().init(&device)?,
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
//! # Files
//! Records and files contain only the parameters. Constants (faces, texture coordinates, the form of a
//! rotation) come from the module into which they are loaded. Its parameters must have the same shapes as the
//! saved ones.
//!
//! `save_safetensors` and `load_safetensors` of this module (feature `safetensors`) use a format that other
//! frameworks also read. Their files name the version of the parameters' names in the metadata `softray_format`,
//! which is 1. Loading returns an error for a newer version, and for a file with earlier names it says which names
//! changed. A file without the metadata, such as one from another framework, is loaded if its names match.
//!
//! `save_file` and `try_load_file` of burn's `Module` write and read burnpack, in which burn stores no such version:
//! for a record with other names, burn returns an error that lists the missing parameters. Use safetensors for files
//! that should outlive a version of this crate.

#[cfg(all(feature = "photographs", not(target_family = "wasm")))]
mod asset;
mod camera;
mod debug;
mod dmtet;
mod exposure;
mod grid_opacity;
#[cfg(all(feature = "fit", feature = "photographs", not(target_family = "wasm")))]
mod level;
mod loss;
mod material;
mod mesh;
mod renderer;
#[cfg(feature = "safetensors")]
mod store;
mod surface;
mod texture;
mod textured;
mod transform;
mod values;
mod viewpoints;

#[cfg(all(feature = "photographs", not(target_family = "wasm")))]
pub use asset::AssetParams;
pub use camera::{Aim, AimForm, CameraParams, CameraParamsConfig, LensParams};
pub use dmtet::{DMTetParams, DMTetParamsConfig, TetrahedralGrid};
pub use exposure::{ExposureParams, ExposureParamsConfig};
#[cfg(all(feature = "fit", feature = "photographs", not(target_family = "wasm")))]
pub use level::AssetLevel;
pub use loss::{RenderLoss, RenderLossConfig};
pub use material::{MaterialParams, MaterialParamsConfig};
pub use mesh::{MeshOffsets, MeshParams};
pub use renderer::Renderer;
#[cfg(feature = "safetensors")]
pub use store::{load_safetensors, save_safetensors};
pub use surface::{SurfaceNetwork, SurfaceNetworkConfig};
pub use texture::{
    EnvironmentParams, EnvironmentParamsConfig, NormalMapParams, NormalMapParamsConfig,
    TextureParams, TextureParamsConfig,
};
pub use textured::TexturedMeshParams;
pub use transform::{RigidTransform, RigidTransformConfig, RotationForm};
pub use values::cast;
pub use viewpoints::ViewpointParams;
