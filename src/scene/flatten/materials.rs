//! Materials and environments as planes.

use burn::tensor::Tensor;

use crate::geometry::{Context, Vec3};
use crate::scene::material::{Channel, MaterialKind, Value};
use crate::scene::parameter::without_tape;
use crate::scene::{Environment, Material, Parameter, Wrap};

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
    pub(super) fn new(mut materials: Vec<Material>, context: &Context) -> Self {
        let kinds = materials.iter().map(Material::kind).collect();
        let channels = Channel::ALL.map(|channel| {
            let all = materials.iter_mut();
            let values = all.filter_map(|m| m.channels().into_iter().nth(channel as usize));
            planes(values.collect(), context)
        });
        Self {
            channels: channels.into(),
            kinds,
        }
    }

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
            Environment::Constant(p) => Self::Constant(p.vector(context)),
            Environment::Map(texels) => {
                let [height, width, _] = texels.dims();
                Self::Map(EnvironmentMap {
                    texels: texel_rows(texels),
                    height,
                    width,
                })
            }
        }
    }
}

/// The texels of an image as planes `[1, H·W]`.
fn texel_rows(image: &Tensor<3>) -> Vec3 {
    let [height, width, _] = image.dims();
    let rows = image.clone().reshape([height * width, 3]).transpose();
    Vec3::from_rows(without_tape(&rows))
}

fn planes(values: Vec<Value<'_>>, context: &Context) -> ChannelPlanes {
    let (mut constant, mut texture, mut atlas) = (Vec::new(), Vec::new(), Vec::new());
    let mut offset = 0;
    let zero = || Parameter::Constant([0.0; 3]).vector(context);
    for value in values {
        let mut slot = None;
        constant.push(match value {
            Value::Colour(p) => p.vector(context),
            Value::Scalar(p) => {
                let [x] = p.planes(context);
                Vec3 { x, ..zero() }
            }
            Value::Image(texels, wrap) => {
                let [height, width, _] = texels.dims();
                slot = Some(TextureSlot {
                    offset,
                    height,
                    width,
                    wrap,
                });
                offset += height * width;
                atlas.push(texel_rows(texels));
                zero()
            }
        });
        texture.push(slot);
    }
    ChannelPlanes {
        constant: Vec3::cat(&constant, 1),
        texture,
        atlas: (!atlas.is_empty()).then(|| Vec3::cat(&atlas, 1)),
    }
}
