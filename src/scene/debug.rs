//! `Debug` of a scene and its parts shows names, sizes and a few numbers. It does not panic, whatever
//! the shapes of the tensors are.

use std::fmt::{Debug, Formatter, Result};

use super::texture::Value;
use super::{
    ColorTexture, CornerAttribute, Described, Environment, Material, Mesh, Object, Parameter,
    ScalarTexture, Scene,
};
use crate::debug::{Text, graph, place, tensor};
use softray_kernels::host::{BsdfKind, Channel};

/// The most objects of a scene, and materials of an object, that are shown.
const MAX_SHOWN: usize = 32;

impl<const C: usize> Debug for Parameter<C> {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        match self {
            Self::Constant(v) if C == 1 => write!(f, "{:?}", v[0]),
            Self::Constant(v) => write!(f, "{v:?}"),
            Self::Tensor(t) if t.dims() != [C] => {
                write!(f, "a tensor of shape {:?}, not [{C}]", t.dims())
            }
            Self::Tensor(t) => tensor(t).fmt(f),
        }
    }
}

impl Debug for Value<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        match self {
            Self::Color(p) => p.fmt(f),
            Self::Scalar(p) => p.fmt(f),
            Self::Image(texels, wrap) => write!(f, "texture {:?}, {wrap:?}", tensor(texels)),
            Self::ScalarImage(texels, wrap) => write!(f, "texture {:?}, {wrap:?}", tensor(texels)),
        }
    }
}

impl Debug for ColorTexture {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        self.clone().value().fmt(f)
    }
}

impl Debug for ScalarTexture {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        self.clone().value().fmt(f)
    }
}

impl Debug for Environment {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        match self {
            Self::Constant(p) => p.fmt(f),
            Self::Map(texels) => write!(f, "map {:?}", tensor(texels)),
        }
    }
}

impl Debug for CornerAttribute {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        f.debug_struct("CornerAttribute")
            .field("values", &tensor(&self.values))
            .field("faces", &Text(self.faces.len().to_string()))
            .finish()
    }
}

impl Debug for Mesh {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let [count, width] = self.vertices.dims();
        let vertices = &self.vertices;
        match width {
            3 => write!(f, "Mesh {{ {count} vertices")?,
            _ => write!(f, "Mesh {{ vertices of shape [{count}, {width}]")?,
        }
        write!(f, "{}, {} faces", graph(vertices), self.faces.len())?;
        for (name, _, attribute) in self.attributes() {
            if let Some(a) = attribute {
                write!(f, ", {name}{}", graph(&a.values))?;
            }
        }
        write!(f, ", on {} }}", place(&vertices.device(), vertices.dtype()))
    }
}

impl Debug for Material {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let name = format!("Material {:?}", self.name);
        let mut all = f.debug_struct(&name);
        let kind = self.bsdf.kind();
        if kind != BsdfKind::Phong {
            all.field("bsdf", &kind);
        }
        for (channel, value) in self.clone().channels() {
            let is_shown = match channel {
                Channel::Specular | Channel::Shininess => self.bsdf.lobe().is_some(),
                _ if channel.place() >= Channel::Emission.place() => {
                    value.constants().is_empty() || value.constants().iter().any(|&v| v != 0.0)
                }
                _ => true,
            };
            if is_shown {
                all.field(channel.name(), &value);
            }
        }
        if let Some(map) = &self.normal_map {
            all.field("normal_map", &tensor(&map.texels));
        }
        if let Some(mask) = &self.alpha_mask {
            all.field("alpha_mask", &tensor(&mask.alpha));
        }
        all.finish()
    }
}

impl Debug for Object {
    /// Writes one line, also for `{:#?}`, so that a scene has one line for each object.
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        write!(f, "{:?}: {:?}", self.name, self.mesh)?;
        for material in self.materials.iter().take(MAX_SHOWN) {
            write!(f, ", {material:?}")?;
        }
        if self.materials.len() > MAX_SHOWN {
            write!(
                f,
                ", and {} more materials",
                self.materials.len() - MAX_SHOWN
            )?;
        }
        match &self.velocity {
            Some(v) => write!(f, ", velocity {v:?}"),
            None => Ok(()),
        }
    }
}

impl Debug for Scene {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let mut all = f.debug_struct("Scene");
        all.field("objects", &shown(&self.objects, "objects"));
        if !self.lights.is_empty() {
            all.field("lights", &shown(&self.lights, "lights"));
        }
        all.field("environment", &self.environment).finish()
    }
}

/// The first of a list, and how many more there are.
fn shown(list: &[impl Debug], what: &str) -> Vec<Text> {
    let mut shown: Vec<Text> = (list.iter().take(MAX_SHOWN))
        .map(|entry| Text(format!("{entry:?}")))
        .collect();
    if list.len() > MAX_SHOWN {
        shown.push(Text(format!("and {} more {what}", list.len() - MAX_SHOWN)));
    }
    shown
}
