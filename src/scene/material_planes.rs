//! Material parameters as planes.

use burn::tensor::{Bool, Tensor};

use super::parameter::without_tape;
use super::texture::Value;
use super::{Material, Parameter, Wrap};
use crate::geometry::{Context, Vec3};
use softray_kernels::host::{CHANNELS, Channel, MaterialKind};

/// The location of a texture in the atlas.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TextureSlot {
    /// The index of the first texel.
    pub offset: usize,
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// The continuation outside of the unit square.
    pub wrap: Wrap,
}

/// One parameter of all materials.
#[derive(Clone, Debug)]
pub(crate) struct ChannelPlanes {
    /// Values `[1, M]`, 0 where the material has a texture. A scalar parameter is stored in x.
    pub constant: Vec3,
    /// The texture of each material, if it has one.
    pub texture: Vec<Option<TextureSlot>>,
    /// All texels `[1, A]`, if there are textures.
    pub atlas: Option<Vec3>,
}

/// All materials of a scene.
#[derive(Clone, Debug)]
pub(crate) struct Materials {
    /// The parameters, indexed by [`Channel::place`].
    channels: Vec<ChannelPlanes>,
    pub kinds: Vec<MaterialKind>,
}

impl Materials {
    pub fn new(mut materials: Vec<Material>, context: &Context) -> Self {
        let kinds = materials.iter().map(Material::kind).collect();
        let channels = (0..CHANNELS).map(|place| {
            let all = materials.iter_mut();
            let values = all.filter_map(|m| Some(m.channels().nth(place)?.1));
            planes(values.collect(), context)
        });
        Self {
            channels: channels.collect(),
            kinds,
        }
    }

    /// Returns the parameter with this [`Channel::place`].
    pub fn channel(&self, place: usize) -> &ChannelPlanes {
        &self.channels[place]
    }

    /// Returns the radiance `[1, M]` of fronts that emit the same everywhere and in all directions; 0 for other
    /// materials.
    pub fn even_emission(&self) -> Vec3 {
        let emission = &self.channel(Channel::Emission.place()).constant;
        if !self.kind().glows {
            return emission.clone();
        }
        let glows = self.kinds.iter().map(|kind| kind.glows);
        let glows = Tensor::<1, Bool>::from_data(
            glows.collect::<Vec<_>>().as_slice(),
            &emission.x.device(),
        );
        emission.map(|x| x.mask_fill(glows.clone().unsqueeze(), 0.0))
    }

    /// The parts that any of the materials has.
    pub fn kind(&self) -> MaterialKind {
        self.kinds
            .iter()
            .fold(MaterialKind::default(), |a, b| a.or(*b))
    }

    /// Whether any material has a texture.
    pub fn textured(&self) -> bool {
        self.channels.iter().any(|c| c.atlas.is_some())
    }
}

/// Returns scalar texels as planes `[1, H·W]`: x has the values, y and z are 0.
fn scalar_rows(image: &Tensor<2>) -> Vec3 {
    let [height, width] = image.dims();
    let x = without_tape(image).reshape([1, height * width]);
    let zero = x.zeros_like().detach();
    Vec3::new(x, zero.clone(), zero)
}

/// Returns the texels of an image as planes `[1, H·W]`.
pub(super) fn texel_rows(image: &Tensor<3>) -> Vec3 {
    let [height, width, _] = image.dims();
    let rows = image.clone().reshape([height * width, 3]).transpose();
    Vec3::from_rows(without_tape(&rows))
}

/// Returns the values of one parameter of all materials as planes.
pub(super) fn planes(values: Vec<Value<'_>>, context: &Context) -> ChannelPlanes {
    let (mut constant, mut texture, mut atlas) = (Vec::new(), Vec::new(), Vec::new());
    let mut offset = 0;
    let zero = || Parameter::Constant([0.0; 3]).vector(context);
    for value in values {
        let mut slot = None;
        let mut add_texture = |[height, width]: [usize; 2], wrap, texels| {
            slot = Some(TextureSlot {
                offset,
                height,
                width,
                wrap,
            });
            offset += height * width;
            atlas.push(texels);
            zero()
        };
        constant.push(match value {
            Value::Color(p) => p.vector(context),
            Value::Scalar(p) => {
                let [x] = p.planes(context);
                Vec3 { x, ..zero() }
            }
            Value::Image(texels, wrap) => {
                let [height, width, _] = texels.dims();
                add_texture([height, width], wrap, texel_rows(texels))
            }
            Value::ScalarImage(texels, wrap) => {
                add_texture(texels.dims(), wrap, scalar_rows(texels))
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
