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
pub use holes::{Holes, Mask, OF_MASKED};
pub use light::{HostLight, LightKind, LightPart};
pub use material::{
    BsdfKind, CHANNELS, Channel, MAX_IOR, MAX_METAL_IOR, MIN_CONTRAST, MIN_IOR, MaterialKind,
};
pub use parameter_id::ParameterId;
pub use projection::HostProjection;
pub use scene::{HostAttribute, HostMaterial, HostObject, HostScene, SceneFrame};
pub use texture::HostTexture;
pub use weld::Weld;
pub use wrap::Wrap;
