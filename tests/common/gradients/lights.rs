//! Cases of lights without a surface.

use burn::tensor::{DType, Device, Tensor};
use softray::prelude::*;

use super::{Case, camera, change, objects, offset, scene, vector};

fn case(
    name: &'static str,
    value: f64,
    step: f64,
    bounces: u32,
    build: fn(&Device, DType, Tensor<1>) -> (Scene, Camera),
) -> Case {
    Case {
        name,
        value,
        step,
        bounces,
        build,
        weight: |x, y| 0.8 + 0.6 * x + 0.3 * y,
    }
}

/// The scene with a light and nothing else that shines.
fn lit_by(light: Light, device: &Device, dtype: DType) -> Scene {
    scene(objects(device, dtype))
        .map_object("light", |o| o.material(Material::diffuse([0.2; 3])))
        .expect("the object")
        .environment([0.0; 3])
        .light(light)
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
            (scene(objects(d, t)).light(light), camera())
        }),
        case("irradiance", 2.0, 0.2, 1, |d, t, p| {
            let light = Light::directional([-0.4, -1.0, -0.6], vector(p, [1.0, 0.9, 0.8], d, t));
            (lit_by(light, d, t), camera())
        }),
        case("inner angle", 0.2, 0.02, 0, |d, t, p| {
            let light = spot([-0.4, -1.0, -0.4], [p.into(), 0.7.into()]);
            (lit_by(light, d, t), camera())
        }),
        case("outer angle", 0.6, 0.02, 0, |d, t, p| {
            let light = spot([-0.4, -1.0, -0.4], [0.2.into(), p.into()]);
            (lit_by(light, d, t), camera())
        }),
        case("spot direction", 0.0, 0.02, 1, |d, t, p| {
            let direction = offset(p, [-0.4, -1.0, -0.4], [0.6, 0.1, -0.3], d, t);
            let light = spot(direction, [0.2.into(), 0.7.into()]);
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
            let light = spot([-0.4, -1.0, -0.4], [0.2.into(), 0.7.into()]);
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
