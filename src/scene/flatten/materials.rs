//! Materials and environments as planes.

use burn::tensor::Tensor;

use super::attached::cat;
use crate::geometry::{Context, Vec3};
use crate::scene::{Albedo, Environment, Material, Parameter, Wrap};

/// Where a texture lies in the atlas.
#[derive(Clone, Copy, Debug)]
pub struct TextureSlot {
    /// Its first texel.
    pub offset: usize,
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// Outside of the unit square.
    pub wrap: Wrap,
}

/// The diffuse or specular albedos of all materials.
#[derive(Clone, Debug)]
pub struct Albedos {
    /// `[1, M]`; 0 where the material has a texture.
    pub constant: Vec3,
    /// The texture of each material.
    pub texture: Vec<Option<TextureSlot>>,
    /// All texels `[1, A]`, if there are textures.
    pub atlas: Option<Vec3>,
}

/// All materials of a scene; planes are rows `[1, M]`.
#[derive(Clone, Debug)]
pub struct Materials {
    /// k_d.
    pub diffuse: Albedos,
    /// k_s and the exponent, if any material is glossy.
    pub specular: Option<(Albedos, Tensor<2>)>,
    /// Emitted radiance.
    pub emission: Vec3,
    /// Whether a material reflects.
    pub reflects: Vec<bool>,
    /// Whether a material has a specular part.
    pub glossy: Vec<bool>,
    /// Whether a material emits.
    pub emits: Vec<bool>,
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
    let planes = |f: &dyn Fn(&Material) -> [Tensor<2>; 3]| {
        cat(
            materials
                .iter()
                .map(|m| {
                    let [x, y, z] = f(m);
                    Vec3::new(x, y, z)
                })
                .collect(),
            1,
        )
    };
    let glossy = materials.iter().any(|m| m.specular.reflects());
    Materials {
        diffuse: albedos(materials.iter().map(|m| &m.diffuse), context),
        specular: glossy.then(|| {
            let exponent = materials
                .iter()
                .map(|m| {
                    let [n] = m.shininess.planes(context);
                    n
                })
                .collect();
            (
                albedos(materials.iter().map(|m| &m.specular), context),
                Tensor::cat(exponent, 1),
            )
        }),
        emission: planes(&|m| m.emission.planes(context)),
        reflects: materials.iter().map(|m| m.reflects()).collect(),
        glossy: materials.iter().map(|m| m.specular.reflects()).collect(),
        emits: materials.iter().map(|m| m.emits()).collect(),
    }
}

fn albedos<'a>(list: impl Iterator<Item = &'a Albedo>, context: &Context) -> Albedos {
    let (mut constant, mut texture, mut atlas) = (Vec::new(), Vec::new(), Vec::new());
    let mut offset = 0;
    for albedo in list {
        let [r, g, b] = match albedo {
            Albedo::Constant(p) => {
                texture.push(None);
                p.planes(context)
            }
            Albedo::Texture { texels, wrap } => {
                let [height, width, _] = texels.dims();
                texture.push(Some(TextureSlot {
                    offset,
                    height,
                    width,
                    wrap: *wrap,
                }));
                offset += height * width;
                let texels = if texels.is_tracked() {
                    texels.clone()
                } else {
                    texels.clone().inner()
                };
                atlas.push(Vec3::from_rows(
                    texels.reshape([height * width, 3]).transpose(),
                ));
                Parameter::Constant([0.0; 3]).planes(context)
            }
        };
        constant.push(Vec3::new(r, g, b));
    }
    Albedos {
        constant: cat(constant, 1),
        texture,
        atlas: (!atlas.is_empty()).then(|| cat(atlas, 1)),
    }
}
