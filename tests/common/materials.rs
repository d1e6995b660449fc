//! Parts of materials, for tests that look at them.

use softray::prelude::*;

/// The name of its model.
pub fn model(material: &Material) -> &'static str {
    match material.bsdf {
        Bsdf::Phong { .. } => "phong",
        Bsdf::MetallicRoughness { .. } => "metallic roughness",
        Bsdf::Conductor { .. } => "conductor",
        Bsdf::Dielectric { .. } => "dielectric",
        _ => panic!("a model that the tests do not know"),
    }
}

/// Its diffuse albedo, base color or tint.
pub fn base(material: &Material) -> &ColorTexture {
    match &material.bsdf {
        Bsdf::Phong { diffuse, .. } => diffuse,
        Bsdf::MetallicRoughness { base_color, .. } => base_color,
        Bsdf::Dielectric { tint, .. } => tint,
        _ => panic!("{material:?} has no base color"),
    }
}

/// The roughness of its microfacets.
pub fn roughness(material: &Material) -> &ScalarTexture {
    match &material.bsdf {
        Bsdf::MetallicRoughness { roughness, .. }
        | Bsdf::Conductor { roughness, .. }
        | Bsdf::Dielectric { roughness, .. } => roughness,
        _ => panic!("{material:?} has no roughness"),
    }
}

/// Its share of metal.
pub fn metallic(material: &Material) -> &ScalarTexture {
    let Bsdf::MetallicRoughness { metallic, .. } = &material.bsdf else {
        panic!("{material:?} has no metallic");
    };
    metallic
}

/// The albedo of its Phong lobe.
pub fn specular(material: &Material) -> &ColorTexture {
    let Bsdf::Phong { specular, .. } = &material.bsdf else {
        panic!("{material:?} has no Phong lobe");
    };
    specular
}
