//! Materials from descriptions.

use std::collections::{BTreeSet, HashMap};

use burn::tensor::{Device, Tensor};

use super::description::{Alpha, Color, Description, ExtraBsdf, MaterialDescription, TextureUse};
use super::files::Place;
use super::textures::Textures;
use crate::error::Result;
use crate::geometry::host_values;
use crate::scene::{AlphaMask, ColorTexture, Material, NormalMap, ScalarTexture, Wrap};
use softray_kernels::warning;

/// The channels of an image of metal and roughness.
const ROUGHNESS: usize = 1;
const METALLIC: usize = 2;

/// Indices of refraction that are nearer to 1 are rendered as this one: without a difference nothing is refracted.
const MIN_REFRACTING_IOR: f64 = 1.0011;

const SCALED: &str = "Kd + Ks is above 1 in these materials, so that their Ks is scaled down";

/// An albedo and the largest value of each channel.
struct Bounded {
    albedo: ColorTexture,
    largest: [f64; 3],
}

/// Materials of a scene, each made once.
pub(super) struct Materials<'a> {
    description: &'a Description,
    device: &'a Device,
    textures: Textures<'a>,
    /// Materials that were made, so that objects share textures and unused ones aren't read.
    made: HashMap<Option<usize>, Material>,
}

impl<'a> Materials<'a> {
    /// Those of a file.
    ///
    /// # Errors
    /// If the textures of those that are used are larger than the limits, or an image is. Nothing is
    /// decoded then.
    pub fn new(description: &'a Description, place: Place<'a>) -> Result<Self> {
        let mut this = Self {
            description,
            device: place.device,
            textures: Textures::new(description, place),
            made: HashMap::new(),
        };
        let used = description.objects.iter();
        let used = used.flat_map(|o| &description.meshes[o.mesh].materials);
        for index in used.collect::<BTreeSet<_>>() {
            this.get(*index)?;
        }
        this.made.clear();
        this.textures.decode();
        Ok(this)
    }

    /// A material of the description; None is the default.
    pub fn get(&mut self, index: Option<usize>) -> Result<Material> {
        if let Some(made) = self.made.get(&index) {
            return Ok(made.clone());
        }
        let description = index.and_then(|i| self.description.materials.get(i));
        let made = match description {
            Some(description) => self.make(description)?,
            None => Material::default().with_name("default"),
        };
        self.made.insert(index, made.clone());
        Ok(made)
    }

    fn make(&mut self, from: &MaterialDescription) -> Result<Material> {
        let material = self.bsdf(from)?.with_name(from.name.clone());
        let mut material = material.with_compensated(from.compensated);
        let (map, scale) = from.normal.unzip();
        if let (Some(TextureUse { image, wrap }), Some(scale)) =
            (self.textures.available(map)?, scale)
        {
            let texels = self.textures.tilts(image, scale)?;
            material = material.with_normal_map(texels, 1.0);
            material.normal_map = material.normal_map.map(|map| NormalMap { wrap, ..map });
        }
        material.alpha_mask = self.mask(from)?;
        let emission = self.color(&from.emission)?;
        // Many exporters write a black texture for what does not emit.
        if emission.shines() {
            material.emission = emission;
            if from.double_sided {
                self.drops("emission of back sides");
            }
        }
        Ok(material)
    }

    /// Notes what would change the picture and is not rendered.
    fn drops(&self, part: &str) {
        let notes = &self.description.notes;
        notes.part("these parts are not rendered", part);
    }

    fn bsdf(&mut self, from: &MaterialDescription) -> Result<Material> {
        let base = self.bounded(&from.base_color)?;
        let texture = from.metallic_roughness_texture;
        let roughness = |this: &mut Self| this.number(from.roughness, texture, ROUGHNESS);
        let only_metal = from.metallic == 1.0 && texture.is_none();
        match &from.extra_bsdf {
            Some(ExtraBsdf::Phong { albedo, shininess }) => {
                let specular = self.specular(albedo, &base, &from.name)?;
                return Ok(Material::phong(base.albedo, specular, *shininess));
            }
            Some(ExtraBsdf::Conductor { eta, extinction }) => {
                return Ok(Material::conductor(*eta, *extinction, roughness(self)?));
            }
            None => {}
        }
        let base = base.albedo;
        if from.transmission == 1.0 && from.metallic == 0.0 && from.ior > 0.0 {
            if !from.solid {
                self.drops("walls without thickness, which are the surfaces of solids here");
            }
            let nearly_1 = (from.ior - 1.0).abs() < MIN_REFRACTING_IOR - 1.0;
            let ior = if nearly_1 {
                MIN_REFRACTING_IOR
            } else {
                from.ior
            };
            return Ok(Material::dielectric(ior, roughness(self)?).with_tint(base));
        }
        if from.transmission > 0.0 && !only_metal {
            self.drops("transmission of less than all light, or beside metal");
        }
        if from.specular == 0.0 && from.metallic == 0.0 {
            return Ok(Material::diffuse(base));
        }
        if from.specular != 1.0 && !only_metal {
            self.drops("strengths of reflections");
        }
        if from.ior != 1.5 && !only_metal {
            self.drops("indices of refraction of what lets no light pass");
        }
        let metallic = self.number(from.metallic, texture, METALLIC)?;
        Ok(Material::metallic_roughness(
            base,
            metallic,
            roughness(self)?,
        ))
    }

    /// The albedo of Phong's lobe: at most so much that no more light leaves than arrives.
    fn specular(&mut self, color: &Color, base: &Bounded, name: &str) -> Result<ColorTexture> {
        let specular = self.bounded(color)?;
        // While textures are counted nothing is known of their texels.
        if self.textures.counting || !specular.albedo.reflects() {
            return Ok(specular.albedo);
        }
        let share = self.share_of_gloss(base, &specular, color)?;
        if share >= 1.0 - 1e-6 {
            return Ok(specular.albedo);
        }
        self.description.notes.add(SCALED, name);
        let scaled = |color: [f64; 3]| color.map(|v| v * share);
        self.color(&Color {
            plain: scaled(color.plain),
            texture: color.texture.map(|(texture, by)| (texture, scaled(by))),
        })
    }

    /// The share of a specular albedo with which no more light leaves than arrives.
    fn share_of_gloss(&mut self, base: &Bounded, of: &Bounded, color: &Color) -> Result<f64> {
        let share = match (&base.albedo, &of.albedo, color.texture) {
            (
                ColorTexture::Texture { texels: kd, .. },
                ColorTexture::Texture { texels: ks, .. },
                Some((texture, _)),
            ) if kd.dims() == ks.dims() => {
                self.textures.take(texture.image)?;
                let none = ks.clone().lower_equal_elem(0.0);
                let room = (kd.clone().neg() + 1.0).clamp_min(0.0) / ks.clone();
                host_values(&room.mask_fill(none, 1.0).min())?[0]
            }
            // Where the brightest texels of both lie is not compared.
            _ => (0..3)
                .filter(|&c| of.largest[c] > 0.0)
                .map(|c| (1.0 - base.largest[c]) / of.largest[c])
                .fold(1.0, f64::min),
        };
        Ok(share.max(0.0))
    }

    fn color(&mut self, color: &Color) -> Result<ColorTexture> {
        Ok(self.bounded(color)?.albedo)
    }

    fn bounded(&mut self, color: &Color) -> Result<Bounded> {
        // Black times a texture is black.
        let texture = color.texture.filter(|(_, factor)| *factor != [0.0; 3]);
        let (texture, factor) = texture.unzip();
        let available = self.textures.available(texture)?;
        Ok(match available.zip(factor) {
            Some((TextureUse { image, wrap }, factor)) => {
                let texels = self.textures.colors(image, factor)?;
                Bounded {
                    albedo: ColorTexture::Texture {
                        texels: texels.tensor,
                        wrap,
                    },
                    largest: texels.largest,
                }
            }
            None => Bounded {
                albedo: color.plain.into(),
                largest: color.plain,
            },
        })
    }

    /// The mask of what has holes.
    fn mask(&mut self, from: &MaterialDescription) -> Result<Option<AlphaMask>> {
        let (factor, cutoff) = match from.alpha {
            Alpha::Opaque => return Ok(None),
            Alpha::Blend { .. } => {
                self.drops("alphaMode BLEND");
                return Ok(None);
            }
            Alpha::Mask { factor, cutoff } => (factor, cutoff),
        };
        let texture = from.base_color.texture.map(|(texture, _)| texture);
        let (alpha, wrap): (Tensor<2>, _) = match self.textures.available(texture)? {
            Some(TextureUse { image, wrap }) => (self.textures.alpha(image, factor)?, wrap),
            None => (Tensor::full([1, 1], factor, self.device), Wrap::Repeat),
        };
        let least = host_values(&alpha.clone().min())?[0];
        let holes = least < cutoff;
        Ok(holes.then_some(AlphaMask {
            alpha,
            wrap,
            cutoff,
        }))
    }

    /// A number times a channel of a linear texture.
    fn number(
        &mut self,
        factor: f64,
        texture: Option<TextureUse>,
        channel: usize,
    ) -> Result<ScalarTexture> {
        let texture = self.textures.available(texture.filter(|_| factor != 0.0))?;
        let Some(TextureUse { image, wrap }) = texture else {
            return Ok(factor.into());
        };
        let texels = self.textures.channel(image, channel, factor)?;
        Ok(ScalarTexture::Texture { texels, wrap })
    }
}

/// A material without textures for an object that has no coordinates: their means.
pub(super) fn untextured(mut material: Material, object: &str) -> Material {
    let lost = material.take_means();
    if material.normal_map.take().is_some() | material.alpha_mask.take().is_some() {
        let name = &material.name;
        warning!(
            "{object}: material {name} has a normal map or an alpha mask, but the mesh has no coordinates: \
             leaving it out"
        );
    }
    if lost {
        let name = &material.name;
        warning!(
            "{object}: material {name} has a texture, but the mesh has no coordinates: taking its mean"
        );
    }
    material
}
