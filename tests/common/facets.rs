//! Scenes that depend on one number of a BSDF of facets.

use burn::tensor::{DType, Device, Tensor};
use softray::prelude::*;

use super::gradients::{Case, camera, case, change, objects, scene, vector};
use super::tensors::tensor as constant;

/// Gold.
pub const ETA: [f64; 3] = [0.14, 0.37, 1.44];
pub const EXTINCTION: [f64; 3] = [3.98, 2.39, 1.60];

/// A scene and a camera from a number.
type Build = fn(&Device, DType, Tensor<1>) -> (Scene, Camera);

/// A floor of a material, or a ball of it.
fn with(name: &'static str, m: Material, d: &Device, t: DType) -> (Scene, Camera) {
    (change(name, |o| o.with_material(m.clone()), d, t), camera())
}

/// A square floor of a material, of two faces, and nothing else.
fn in_the_open(scene: Scene, m: Material, d: &Device, t: DType) -> (Scene, Camera) {
    let floor = shapes::plane_grid(500.0, 500.0, 1, 1, d).cast(t);
    (
        scene.with_object(Object::new(floor).with_material(m)),
        camera(),
    )
}

/// Every parameter of the models of facets.
pub fn facet_cases() -> Vec<Case> {
    let mut cases = vec![
        case("base color", 0.5, 0.05, 1, |d, t, p| {
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
        case("half a metal's roughness", 0.85, 0.03, 1, |d, t, p| {
            let m = Material::metallic_roughness([0.7, 0.5, 0.2], 0.5, p);
            with("floor", m, d, t)
        }),
        case("texels of roughness", 0.5, 0.03, 1, |d, t, p| {
            let base = constant(&[0.1, 0.3, 0.2, 0.4], [2, 2], d, t);
            let one = constant(&[1.0, 0.5, 0.8, 0.2], [2, 2], d, t);
            let roughness = ScalarTexture::texture(base + one * p.reshape([1, 1]));
            let m = Material::metallic_roughness([0.7, 0.5, 0.2], 0.8, roughness);
            with("floor", m, d, t)
        }),
        // Rays of a cone are mirrored at the plane of a surface, where directions about a tilted normal are many.
        case(
            "roughness under a tilted normal",
            0.87,
            0.03,
            0,
            |d, t, p| {
                let m = Material::metallic_roughness([0.6, 0.6, 0.4], 0.9, p);
                let tilt = constant(&[0.3, 0.0, 1.0], [1, 1, 3], d, t);
                in_the_open(
                    Scene::new().with_environment([1.0; 3]),
                    m.with_normal_map(tilt, 1.0),
                    d,
                    t,
                )
            },
        ),
        case("eta", 0.5, 0.03, 1, |d, t, p| {
            let eta = vector(p, [0.4, 0.8, 2.0], d, t);
            with("floor", Material::conductor(eta, EXTINCTION, 0.5), d, t)
        }),
        case("extinction", 1.0, 0.1, 1, |d, t, p| {
            let k = vector(p, EXTINCTION, d, t);
            with("floor", Material::conductor(ETA, k, 0.5), d, t)
        }),
        case("conductor's roughness", 0.6, 0.03, 1, |d, t, p| {
            let m = Material::conductor(ETA, EXTINCTION, p).with_compensated(false);
            with("ball", m, d, t)
        }),
        case("metal that moves", 0.0, 0.012, 1, |d, t, p| {
            let m = Material::metallic_roughness([0.7, 0.5, 0.2], 0.8, 0.5);
            moved(p, m, d, t)
        }),
    ];
    cases.extend(glass_cases());
    cases
}

fn glass_cases() -> Vec<Case> {
    vec![
        case("ior", 1.5, 0.03, 2, |d, t, p| {
            with("ball", Material::dielectric(p, 0.6), d, t)
        }),
        // What rough glass gives back, by what it reflects: the rest has more noise.
        case("ior of rough glass", 1.5, 0.03, 1, |d, t, p| {
            with("ball", Material::dielectric(p, 0.9), d, t)
        }),
        // Directions to a map are fixed, and facets that stand upright refract light from some of them.
        case(
            "ior of rough glass under a map",
            1.25,
            0.02,
            0,
            |d, t, p| {
                let sky = Scene::new().with_environment(Environment::map(constant(
                    &[1.0; 6],
                    [1, 2, 3],
                    d,
                    t,
                )));
                in_the_open(sky, Material::dielectric(p, 0.75), d, t)
            },
        ),
        case("glass's roughness", 0.6, 0.03, 2, |d, t, p| {
            let m = Material::dielectric(1.5, p).with_compensated(false);
            with("ball", m, d, t)
        }),
        case("glass's color", 0.8, 0.1, 2, |d, t, p| {
            let tint = vector(p, [1.0, 0.7, 0.5], d, t);
            with("ball", Material::dielectric(1.5, 0.4).with_tint(tint), d, t)
        }),
        // What is seen through it moves at every bounce.
        Case {
            precision: 0.2,
            ..case("glass that moves", 0.0, 0.012, 2, |d, t, p| {
                moved(p, Material::dielectric(1.5, 0.6), d, t)
            })
        },
    ]
}

/// Parameters outside of their ranges, which count as the nearest number inside: derivatives are 0.
pub fn clamped_cases() -> Vec<Case> {
    let metallic: Build = |d, t, p| {
        let m = Material::metallic_roughness([0.7, 0.5, 0.2], p, 0.5);
        with("floor", m, d, t)
    };
    let roughness: Build = |d, t, p| {
        let m = Material::metallic_roughness([0.7, 0.5, 0.2], 0.5, p);
        with("floor", m, d, t)
    };
    let eta: Build = |d, t, p| {
        let eta = vector(p, [1.0; 3], d, t);
        with("floor", Material::conductor(eta, EXTINCTION, 0.5), d, t)
    };
    let extinction: Build = |d, t, p| {
        let k = vector(p, [1.0; 3], d, t);
        with("floor", Material::conductor(ETA, k, 0.5), d, t)
    };
    let conductors: Build = |d, t, p| with("floor", Material::conductor(ETA, EXTINCTION, p), d, t);
    let ior: Build = |d, t, p| with("ball", Material::dielectric(p, 0.6), d, t);
    let glass: Build = |d, t, p| with("ball", Material::dielectric(1.5, p), d, t);
    // The cosines of its angles are nearer than what its falloff is divided by.
    let inner: Build = |d, t, p| {
        let spot = Light::spot(
            [0.5, 2.0, 1.0],
            [-0.2, -1.0, -0.4],
            [9.0; 3],
            p * 1f64.to_degrees(),
            0.5005f64.to_degrees(),
        );
        (scene(objects(d, t)).with_light(spot), camera())
    };
    [
        ("metallic over 1", 1.5, metallic),
        ("metallic under 0", -0.3, metallic),
        ("metal's roughness over 1", 1.5, roughness),
        ("metal's roughness under 0", -0.5, roughness),
        ("eta under 0", -0.5, eta),
        ("eta over its range", 2e4, eta),
        ("extinction under 0", -0.5, extinction),
        ("extinction over its range", 1e30, extinction),
        ("conductor's roughness over 1", 1.5, conductors),
        ("ior under its range", 0.02, ior),
        ("ior over its range", 30.0, ior),
        ("ior next to 1", 1.0003, ior),
        ("glass's roughness over 1", 1.5, glass),
        ("a spot's inner angle next to its outer one", 0.5, inner),
    ]
    .map(|(name, value, build)| case(name, value, 0.1, 1, build))
    .into()
}

/// A ball of a material that moves.
fn moved(p: Tensor<1>, m: Material, d: &Device, t: DType) -> (Scene, Camera) {
    let by = vector(p, [1.0, 0.3, 0.2], d, t);
    let ball = |o: Object| {
        o.with_material(m.clone())
            .map_mesh(|mesh| mesh.translated(by.clone()))
    };
    (change("ball", ball, d, t), camera())
}
