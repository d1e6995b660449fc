//! Materials and environments as planes.

use crate::geometry::{Context, Vec3};
use crate::scene::material::{CHANNELS, Channel, ChannelValue, MaterialKind};
use crate::scene::{Albedo, Environment, Material, Parameter, Wrap};

/// The place of a texture in the atlas.
#[derive(Clone, Copy, Debug)]
pub struct TextureSlot {
    /// Its first texel.
    pub offset: usize,
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// Its continuation outside of the unit square.
    pub wrap: Wrap,
}

/// A parameter of all materials.
#[derive(Clone, Debug)]
pub(crate) struct ChannelPlanes {
    /// Values `[1, M]`, 0 where the material has a texture. A scalar parameter is in x.
    pub constant: Vec3,
    /// The texture of each material.
    pub texture: Vec<Option<TextureSlot>>,
    /// All texels `[1, A]`, if there are textures.
    pub atlas: Option<Vec3>,
}

/// All materials of a scene.
#[derive(Clone, Debug)]
pub(crate) struct Materials {
    /// The parameters, in the order of [`Channel::ALL`].
    channels: Vec<ChannelPlanes>,
    pub kinds: Vec<MaterialKind>,
}

impl Materials {
    pub fn channel(&self, channel: Channel) -> &ChannelPlanes {
        &self.channels[channel as usize]
    }

    /// Emitted radiance, `[1, M]`.
    pub fn emission(&self) -> &Vec3 {
        &self.channel(Channel::Emission).constant
    }

    /// Whether any is glossy.
    pub fn glossy(&self) -> bool {
        self.kinds.iter().any(|k| k.glossy)
    }

    /// Whether any has a texture.
    pub fn textured(&self) -> bool {
        self.channels.iter().any(|c| c.atlas.is_some())
    }
}

/// An environment as planes.
#[derive(Clone, Debug)]
pub enum SkyTensors {
    /// `[1, 1]`.
    Constant(Vec3),
    /// An equirectangular map.
    Map(EnvironmentMap),
}

/// The texels of an equirectangular map.
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
    /// `[1, H·W]`, row by row.
    pub texels: Vec3,
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
}

impl SkyTensors {
    pub(super) fn new(environment: &Environment, context: &Context) -> Self {
        match environment {
            Environment::Constant(p) => {
                let [r, g, b] = p.planes(context);
                Self::Constant(Vec3::new(r, g, b))
            }
            Environment::Map(texels) => {
                let [height, width, _] = texels.dims();
                let rows = texels.clone().reshape([height * width, 3]).transpose();
                let rows = if rows.is_tracked() {
                    rows
                } else {
                    rows.inner()
                };
                Self::Map(EnvironmentMap {
                    texels: Vec3::from_rows(rows),
                    height,
                    width,
                })
            }
        }
    }
}

pub(super) fn flatten_materials(materials: &[&Material], context: &Context) -> Materials {
    let mut list: Vec<Material> = materials.iter().map(|&m| m.clone()).collect();
    let mut by_channel: Vec<Vec<ChannelValue<'_>>> = Vec::new();
    by_channel.resize_with(CHANNELS, Vec::new);
    for material in &mut list {
        for (values, value) in by_channel.iter_mut().zip(material.channels()) {
            values.push(value);
        }
    }
    let channels = by_channel.into_iter().map(|values| planes(values, context));
    Materials {
        channels: channels.collect(),
        kinds: materials.iter().map(|m| m.kind()).collect(),
    }
}

fn planes(values: Vec<ChannelValue<'_>>, context: &Context) -> ChannelPlanes {
    let (mut constant, mut texture, mut atlas) = (Vec::new(), Vec::new(), Vec::new());
    let mut offset = 0;
    let zero = || Parameter::Constant([0.0; 3]).planes(context);
    for value in values {
        let mut slot = None;
        let [x, y, z] = match value {
            ChannelValue::Colour(Albedo::Constant(p)) | ChannelValue::Numbers(p) => {
                p.planes(context)
            }
            ChannelValue::Scalar(p) => {
                let ([x], [_, y, z]) = (p.planes(context), zero());
                [x, y, z]
            }
            ChannelValue::Colour(Albedo::Texture { texels, wrap }) => {
                let [height, width, _] = texels.dims();
                slot = Some(TextureSlot {
                    offset,
                    height,
                    width,
                    wrap: *wrap,
                });
                offset += height * width;
                let texels = if texels.is_tracked() {
                    texels.clone()
                } else {
                    texels.clone().inner()
                };
                atlas.push(Vec3::from_rows(
                    texels.reshape([height * width, 3]).transpose(),
                ));
                zero()
            }
        };
        texture.push(slot);
        constant.push(Vec3::new(x, y, z));
    }
    ChannelPlanes {
        constant: Vec3::cat(&constant, 1),
        texture,
        atlas: (!atlas.is_empty()).then(|| Vec3::cat(&atlas, 1)),
    }
}
