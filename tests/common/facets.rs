//! Scenes that depend on one number of a BSDF of facets.

use burn::tensor::{DType, Device, Tensor};
use softray::prelude::*;

use super::gradients::{Case, camera, case, change, vector};
use super::tensors::tensor as constant;

/// Gold.
pub const ETA: [f64; 3] = [0.14, 0.37, 1.44];
pub const EXTINCTION: [f64; 3] = [3.98, 2.39, 1.60];

/// A floor of a material, or a ball of it.
fn with(name: &'static str, m: Material, d: &Device, t: DType) -> (Scene, Camera) {
    (change(name, |o| o.material(m.clone()), d, t), camera())
}

/// Every parameter of the models of facets.
pub fn facet_cases() -> Vec<Case> {
    vec![
        case("base colour", 0.5, 0.05, 1, |d, t, p| {
            let base = vector(p, [0.9, 0.6, 0.3], d, t);
            with("floor", Material::metallic_roughness(base, 0.4, 0.5), d, t)
        }),
        case("metallic", 0.5, 0.1, 1, |d, t, p| {
            let m = Material::metallic_roughness([0.7, 0.5, 0.2], p, 0.5);
            with("floor", m, d, t)
        }),
        case("metal's roughness", 0.6, 0.03, 1, |d, t, p| {
            let m = Material::metallic_roughness([0.7, 0.5, 0.2], 0.8, p);
            with("floor", m, d, t)
        }),
        case("texels of roughness", 0.5, 0.03, 1, |d, t, p| {
            let base = constant(&[0.1, 0.3, 0.2, 0.4], [2, 2], d, t);
            let one = constant(&[1.0, 0.5, 0.8, 0.2], [2, 2], d, t);
            let roughness = ScalarTexture::texture(base + one * p.reshape([1, 1]));
            let m = Material::metallic_roughness([0.7, 0.5, 0.2], 0.8, roughness);
            with("floor", m, d, t)
        }),
        case("eta", 0.5, 0.03, 1, |d, t, p| {
            let eta = vector(p, [0.4, 0.8, 2.0], d, t);
            with("floor", Material::conductor(eta, EXTINCTION, 0.5), d, t)
        }),
        case("extinction", 1.0, 0.1, 1, |d, t, p| {
            let k = vector(p, EXTINCTION, d, t);
            with("floor", Material::conductor(ETA, k, 0.5), d, t)
        }),
        case("conductor's roughness", 0.6, 0.03, 1, |d, t, p| {
            let m = Material::conductor(ETA, EXTINCTION, p).compensated(false);
            with("ball", m, d, t)
        }),
        case("ior", 1.5, 0.03, 2, |d, t, p| {
            with("ball", Material::dielectric(p, 0.6), d, t)
        }),
        case("glass's roughness", 0.6, 0.03, 2, |d, t, p| {
            with("ball", Material::dielectric(1.5, p), d, t)
        }),
        case("glass's colour", 0.8, 0.1, 2, |d, t, p| {
            let mut m = Material::dielectric(1.5, 0.4);
            m.diffuse = vector(p, [1.0, 0.7, 0.5], d, t).into();
            with("ball", m, d, t)
        }),
        case("metal that moves", 0.0, 0.012, 1, |d, t, p| {
            let m = Material::metallic_roughness([0.7, 0.5, 0.2], 0.8, 0.5);
            moved(p, m, d, t)
        }),
        // What is seen through it moves at every bounce.
        Case {
            noisy: true,
            ..case("glass that moves", 0.0, 0.012, 2, |d, t, p| {
                moved(p, Material::dielectric(1.5, 0.6), d, t)
            })
        },
    ]
}

/// A ball of a material that moves.
fn moved(p: Tensor<1>, m: Material, d: &Device, t: DType) -> (Scene, Camera) {
    let by = vector(p, [1.0, 0.3, 0.2], d, t);
    let ball = |o: Object| {
        o.material(m.clone())
            .map_mesh(|mesh| mesh.translated(by.clone()))
    };
    (change("ball", ball, d, t), camera())
}
