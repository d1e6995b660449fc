//! A scene as lists of numbers, without tensors: what the kernels take.

mod bounds;
mod holes;
mod light;
mod material;
mod parameter_id;
mod projection;
mod scene;
mod texture;
mod weld;
mod wrap;

pub use bounds::Bounds;
pub(crate) use holes::{Holes, Mask, OF_MASKED};
pub(crate) use light::{HostLight, LightKind, LightPart};
pub(crate) use material::{
    BsdfKind, CHANNELS, Channel, MAX_IOR, MAX_METAL_IOR, MIN_CONTRAST, MIN_IOR, MaterialKind,
};
pub(crate) use parameter_id::ParameterId;
pub(crate) use projection::HostProjection;
pub(crate) use scene::{HostAttribute, HostMaterial, HostObject, HostScene, SceneFrame};
pub(crate) use texture::HostTexture;
pub(crate) use weld::Weld;
pub use wrap::Wrap;
