//! Holes by alpha masks.

use crate::common::scenes::{facing_down, floor};
use crate::common::tensors::{gradient, leaf, radiance};
use crate::detail::{ENGINES, constant, half_open, lit, options, share_of_close, wall};
use burn::tensor::Device;
use softray::prelude::*;

/// A plate with a hole in its half is the other half: what is behind is seen, light falls through, and so do
/// rays of bounces.
#[test]
fn holes_show_what_is_behind_and_let_light_through() {
    let device = Device::flex();
    let plate = |left: f64| {
        let [a, b, c, d] = [[left, 0.6], [1.0, 0.6], [1.0, 0.9], [left, 0.9]];
        shapes::quad(
            [a[0], a[1], 1.0],
            [b[0], b[1], 1.0],
            [c[0], c[1], -1.0],
            [d[0], d[1], -1.0],
            &device,
        )
    };
    let gray = Material::diffuse([0.6; 3]);
    for (engine, more) in [
        (Engine::Kernels, 0),
        (Engine::Kernels, 60),
        (Engine::Tensors, 0),
    ] {
        let image = |mesh: Mesh, material: Material| {
            let (mut scene, camera) = lit(Object::new(mesh).with_material(material));
            // Few triangles are tested one by one, many by boxes.
            for i in 0..more {
                let at = constant(&[-3.0 + 0.1 * f64::from(i), -1.1, -2.0], [3]);
                let small = shapes::cube(&device).scaled(0.03).translated(at);
                scene = scene.with_object(Object::new(small));
            }
            radiance(&scene, &camera, &options(engine))
        };
        let holed = image(plate(-1.0), half_open(gray.clone()));
        let half = image(plate(0.0), gray.clone());
        let whole = image(plate(-1.0), gray.clone());
        let close = |a: &[f64], b: &[f64]| share_of_close(a, b, 1e-4);
        assert!(close(&holed, &half) > 0.99, "{}", close(&holed, &half));
        assert!(close(&holed, &whole) < 0.8, "{}", close(&holed, &whole));
    }
}

/// An emitter shines from where it is.
#[test]
fn holes_do_not_shine() {
    let device = Device::flex();
    let lamp = |left: f64| facing_down([left, 1.0], [-1.0, 1.0], 2.0, &device);
    let image = |mesh: Mesh, half: bool, engine: Engine| {
        let light = Material::emitter([5.0; 3]);
        let light = if half { half_open(light) } else { light };
        let gloss = Material::phong([0.4; 3], [0.4; 3], 10.0);
        let scene = Scene::new()
            .with_object(Object::new(mesh).with_material(light))
            .with_object(Object::new(floor(2.0, 0.0, &device)).with_material(gloss));
        let camera = Camera::look_at([0.0, 1.5, 5.0], [0.0, 0.6, 0.0]);
        let options = options(engine).with_samples(256);
        let image = radiance(&scene, &camera, &options);
        image.iter().sum::<f64>() / image.len() as f64
    };
    for engine in ENGINES {
        let found = image(lamp(-1.0), true, engine);
        let expected = image(lamp(0.0), false, engine);
        assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
    }
}

/// No edge of what is not there jumps, and that of what is there does.
#[test]
fn edges_in_holes_do_not_jump() {
    let device = Device::flex();
    let by = |alpha: f64| {
        let place = leaf(&[0.1, 0.0, 0.5], &device);
        let mesh = wall().scaled(0.5).translated(place.clone());
        let masked = Material::diffuse([0.1; 3]).with_alpha_mask(constant(&[alpha], [1, 1]), 0.5);
        let (scene, camera) = lit(Object::new(mesh).with_material(masked));
        let image = render(&scene, &camera, &options(Engine::Kernels)).expect("an image");
        gradient(
            &place,
            &image.radiance.slice([0..24, 0..12]).sum().backward(),
        )
    };
    assert_eq!(by(0.0), [0.0; 3]);
    assert!(by(1.0)[0].abs() > 1.0);
}
