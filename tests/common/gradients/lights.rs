//! Cases of lights without a surface, of emissive textures, and of bodies that pass through each other.

use burn::tensor::{DType, Device, Tensor};
use softray::prelude::*;

use super::{
    Case, camera, case, change, constant, diffuse, objects, offset, scene, vector, with_lamp,
};

/// The scene with a light and nothing else that shines.
fn lit_by(light: Light, device: &Device, dtype: DType) -> Scene {
    scene(objects(device, dtype))
        .map_object("light", |o| o.with_material(Material::diffuse([0.2; 3])))
        .expect("the object")
        .with_environment([0.0; 3])
        .with_light(light)
}

/// A spot on the floor.
fn spot(direction: impl Into<Parameter<3>>, angles: [Parameter<1>; 2]) -> Light {
    let [inner, outer] = angles;
    Light::spot([0.9, 2.2, 1.1], direction, [9.0, 8.0, 7.0], inner, outer)
}

/// Those whose shadows stay where they are.
pub fn still() -> Vec<Case> {
    vec![
        case("point intensity", 4.0, 0.2, 1, |d, t, p| {
            let light = Light::point([0.9, 2.1, 1.2], vector(p, [1.0, 0.9, 0.8], d, t));
            (scene(objects(d, t)).with_light(light), camera())
        }),
        case("irradiance", 2.0, 0.2, 1, |d, t, p| {
            let light = Light::directional([-0.4, -1.0, -0.6], vector(p, [1.0, 0.9, 0.8], d, t));
            (lit_by(light, d, t), camera())
        }),
        case("inner angle", 0.2, 0.02, 0, |d, t, p| {
            let light = spot(
                [-0.4, -1.0, -0.4],
                [(p * 1f64.to_degrees()).into(), 40.0.into()],
            );
            (lit_by(light, d, t), camera())
        }),
        case("outer angle", 0.6, 0.02, 0, |d, t, p| {
            let light = spot(
                [-0.4, -1.0, -0.4],
                [11.5.into(), (p * 1f64.to_degrees()).into()],
            );
            (lit_by(light, d, t), camera())
        }),
        case("spot direction", 0.0, 0.02, 1, |d, t, p| {
            let direction = offset(p, [-0.4, -1.0, -0.4], [0.6, 0.1, -0.3], d, t);
            let light = spot(direction, [11.5.into(), 40.0.into()]);
            (lit_by(light, d, t), camera())
        }),
    ]
}

/// Those whose shadows move, which has a derivative where a cone blurs them.
pub fn moving() -> Vec<Case> {
    vec![
        case("point position", 0.0, 0.02, 0, |d, t, p| {
            let place = offset(p, [0.6, 2.3, 0.8], [0.5, -0.3, 0.4], d, t);
            (lit_by(Light::point(place, [5.0, 4.0, 3.0]), d, t), camera())
        }),
        case("light direction", 0.0, 0.01, 0, |d, t, p| {
            let direction = offset(p, [-0.4, -1.0, -0.3], [0.5, 0.2, -0.4], d, t);
            let light = Light::directional(direction, [2.0, 1.8, 1.6]);
            (lit_by(light, d, t), camera())
        }),
        case("shadow of a point light", 0.0, 0.012, 1, |d, t, p| {
            let light = Light::point([0.6, 2.3, 0.8], [5.0, 4.0, 3.0]);
            let still = lit_by(light, d, t);
            let moved = change(
                "triangle",
                |o| o.map_mesh(|m| m.translated(vector(p.clone(), [0.6, 0.8, 0.3], d, t))),
                d,
                t,
            );
            let triangle = moved.object("triangle").expect("it").clone();
            let scene = still.map_object("triangle", |_| triangle.clone());
            (scene.expect("the object"), camera())
        }),
        case("shadow of a spot", 0.0, 0.012, 0, |d, t, p| {
            let light = spot([-0.4, -1.0, -0.4], [11.5.into(), 40.0.into()]);
            let still = lit_by(light, d, t);
            let moved = change(
                "ball",
                |o| o.map_mesh(|m| m.translated(vector(p.clone(), [1.0, 0.3, 0.2], d, t))),
                d,
                t,
            );
            let ball = moved.object("ball").expect("it").clone();
            let scene = still.map_object("ball", |_| ball.clone());
            (scene.expect("the object"), camera())
        }),
    ]
}

/// Texels of emission, one of which is a number.
fn patchwork(p: Tensor<1>, device: &Device, dtype: DType) -> Material {
    let base = [4.0, 3.0, 2.0, 0.0, 0.0, 0.0, 0.5, 1.0, 4.0, 1.0, 6.0, 2.0];
    let one = [0.0, 0.0, 0.0, 1.0, 0.9, 0.7, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let [base, one] = [base, one].map(|v| constant(&v, [2, 2, 3], device, dtype));
    Material::emitter(ColorTexture::texture(base + one * p.reshape([1, 1, 1])))
}

/// The lamp of a scene with such texels, whose coordinates move by a number.
fn with_moving_uvs(scene: Scene, name: &str, p: Tensor<1>, d: &Device, t: DType) -> Scene {
    let material = patchwork(constant(&[1.0], [1], d, t), d, t);
    let by = vector(p, [0.6, 0.4, 0.0], d, t)
        .slice([0..2])
        .reshape([1, 2]);
    let changed = scene.map_object(name, |o| {
        o.with_material(material.clone()).map_mesh(|m| {
            let uvs = m.uvs.clone().expect("coordinates").values.cast(t) * 1.3;
            m.with_uvs(uvs + by.clone())
        })
    });
    changed.expect("the object")
}

/// Emissive textures: texels, texture coordinates and what moves under them, by what they light and as the camera sees them.
pub fn glowing() -> Vec<Case> {
    let seen = |case: Case| Case {
        weight: |x, y| (-((x + 0.5).powi(2) + (y - 0.33).powi(2)) / 0.1).exp(),
        ..case
    };
    vec![
        case("texel of a light", 5.0, 0.5, 1, |d, t, p| {
            let m = patchwork(p, d, t);
            (
                change("light", |o| o.with_material(m.clone()), d, t),
                camera(),
            )
        }),
        seen(case("texel that is seen", 5.0, 0.5, 0, |d, t, p| {
            let m = patchwork(p, d, t);
            let scene = with_lamp(d, t).map_object("lamp", |o| o.with_material(m.clone()));
            (scene.expect("the object"), camera())
        })),
        case("uvs of a light", 0.1, 0.05, 0, |d, t, p| {
            let scene = scene(objects(d, t)).with_environment([0.0; 3]);
            (with_moving_uvs(scene, "light", p, d, t), camera())
        }),
        seen(case("uvs that are seen", 0.1, 0.05, 0, |d, t, p| {
            (with_moving_uvs(with_lamp(d, t), "lamp", p, d, t), camera())
        })),
        case("textured light translation", 0.0, 0.01, 0, |d, t, p| {
            let m = patchwork(constant(&[6.0], [1], d, t), d, t);
            let by = vector(p, [0.3, -0.8, 0.4], d, t);
            let light = |o: Object| {
                let o = o.with_material(m.clone());
                o.map_mesh(|mesh| mesh.translated(by.clone()))
            };
            (
                change("light", light, d, t).with_environment([0.0; 3]),
                camera(),
            )
        }),
        seen(case("textured lamp moves", 0.0, 0.02, 0, |d, t, p| {
            let m = patchwork(constant(&[6.0], [1], d, t), d, t);
            let by = vector(p, [0.8, 0.3, 0.4], d, t);
            let scene = with_lamp(d, t).map_object("lamp", |o| {
                let o = o.with_material(m.clone());
                o.map_mesh(|mesh| mesh.translated(by.clone()))
            });
            (scene.expect("the object"), camera())
        })),
    ]
}

/// Bodies that pass through faces of each other whose middles are inside the other one.
pub fn crossings() -> Vec<Case> {
    let cubes = case("cube in a tilted cube", 0.0, 0.012, 0, |d, t, p| {
        let cube = |scale: f64, axis: [f64; 3], turn: f64| {
            let cube = shapes::cube(d).cast(t).scaled(scale);
            diffuse(cube.rotated(axis, turn.to_degrees()), [0.8; 3])
        };
        let at = offset(p, [0.138, 0.687, -0.437], [0.3, 0.2, 1.0], d, t);
        let small = cube(0.3, [0.0, 1.0, 0.0], 0.0).map_mesh(|m| m.translated(at));
        let large = cube(0.55, [-0.153, 1.0, -0.208], 0.823)
            .map_mesh(|m| m.translated([0.946, 0.767, -0.245]));
        let scene = Scene::new().with_object(small).with_object(large);
        (scene.with_environment([0.5; 3]), camera())
    });
    // On GPUs a sample beside a line in which the cubes meet differs by rounding: 2.3e-4.
    vec![Case {
        flips: 8e-4,
        ..cubes
    }]
}
