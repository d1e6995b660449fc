//! Candidates by a hierarchy against all triangles in tensors, the specification: images and
//! gradients differ by what the cutoff allows.

mod common;

use burn::tensor::{DType, Device};
use common::stress::{Outcome, Thing, World};
use softray::prelude::*;

fn worlds() -> Vec<(&'static str, World)> {
    let device = Device::flex();
    let ball = |subdivisions| {
        World::new().with(|w| {
            let fine = shapes::icosphere(subdivisions, &device);
            let Thing { gloss, .. } = w.thing("ball").clone();
            *w.thing("ball") = Thing::shape("ball", fine, [0.4, 0.7, 0.0], 0.6);
            w.thing("ball").gloss = gloss;
        })
    };
    let moving = ball(1).with(|w| {
        w.thing("ball").velocity = Some([0.4, 0.2, 0.1]);
        w.thing("light").velocity = Some([-0.2, 0.0, 0.3]);
        w.lens = Some((0.1, 4.0));
    });
    let textured = World::new().with(|w| {
        let uvs = vec![[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]];
        let texels = (0..12).map(|i| 0.1 + 0.05 * f64::from(i)).collect();
        w.thing("floor").texture = Some(([2, 2], texels, uvs));
    });
    vec![
        ("few", World::new()),
        ("80 faces, moving, lens", moving),
        ("320 faces", ball(2)),
        ("textured", textured),
    ]
}

/// Σ|a − b|/Σ|b| over the gradients of a parameter.
fn apart(a: &[f64], b: &[f64]) -> f64 {
    let sum = |f: &dyn Fn(usize) -> f64| (0..a.len()).map(f).sum::<f64>();
    let scale = sum(&|i| b[i].abs());
    let difference = sum(&|i| (a[i] - b[i]).abs());
    if scale == 0.0 {
        difference
    } else {
        difference / scale
    }
}

fn rmse(a: &[f64], b: &[f64]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum();
    (sum / a.len() as f64).sqrt()
}

fn both(world: &World, form: Visibility, sigma: f64, cutoff: f64) -> [Outcome; 2] {
    let options = RenderOptions::new(10, 10)
        .samples(4)
        .bounces(1)
        .sigma(sigma)
        .visibility(form)
        .cutoff(cutoff)
        .seed(4);
    [options.clone().brute_force(), options].map(|options| {
        let world = World {
            options,
            ..world.clone()
        };
        world.run(&Device::flex(), DType::F64).expect("an image")
    })
}

fn forms() -> [Visibility; 2] {
    [Visibility::Layered, Visibility::softmax(1e-2)]
}

/// With next to no cutoff both are the same up to rounding: value and every gradient.
#[test]
fn without_a_cutoff_they_are_the_same() {
    for (name, world) in worlds() {
        for form in forms() {
            for sigma in [1e-6, 1e-3, 2e-2] {
                let [expected, found] = both(&world, form, sigma, 1e-18);
                let image = rmse(&found.image, &expected.image);
                assert!(image < 1e-9, "{name}, {form:?}, σ {sigma}: {image:e}");
                for (parameter, gradient) in &expected.gradients {
                    let far = apart(found.gradient(parameter), gradient);
                    assert!(
                        far < 1e-6,
                        "{name}, {form:?}, σ {sigma}, {parameter}: {far:e}"
                    );
                }
            }
        }
    }
}

/// The error falls with the cutoff. A draw that it tips changes a path altogether, so the bound on
/// an image is a multiple of its noise for the share of draws tipped.
#[test]
fn the_cutoff_bounds_the_error() {
    for (name, world) in worlds() {
        for form in forms() {
            for (cutoff, value, slope) in [(1e-2, 0.1, 1.0), (1e-4, 0.02, 0.05), (1e-8, 1e-5, 1e-3)]
            {
                let [expected, found] = both(&world, form, 1e-3, cutoff);
                let mean = expected.mean();
                let image = rmse(&found.image, &expected.image) / mean;
                println!("{name}, {form:?}, cutoff {cutoff:e}: image {image:e}");
                assert!(
                    image < value,
                    "{name}, {form:?}, cutoff {cutoff:e}: {image:e}"
                );
                for parameter in ["ball vertices", "light emission", "eye", "floor vertices"] {
                    let far = apart(found.gradient(parameter), expected.gradient(parameter));
                    assert!(
                        far < slope,
                        "{name}, {form:?}, cutoff {cutoff:e}, {parameter}: {far:e}"
                    );
                }
            }
        }
    }
}
