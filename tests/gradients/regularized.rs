//! Path-space regularization: the engines agree, gradients are those of the regularized image, and caustics have less
//! noise.

use crate::common::errors::{message, says};
use crate::common::facets::{ETA, EXTINCTION, facet_cases};
use crate::common::gradients::{CONES, Effort, Setup, all_classes, assert_agreement};
use crate::common::long;
use crate::common::numbers::mean_and_error;
use crate::common::scenes::{diffuse, emitting, facing_down, floor};
use crate::common::tensors::{gradient, leaf, radiance, scalar};
use burn::tensor::{DType, Device};
use rayon::prelude::*;
use softray::gradcheck::{Checked, GradCheck, gradcheck};
use softray::prelude::*;

/// All BSDFs of facets are smoother than the least roughness here.
#[test]
fn engines_agree_with_a_least_roughness() {
    let flex = Device::flex();
    let setups: [Setup; 2] = [
        (&flex, |o| o.with_path_regularization(0.9)),
        (&flex, |o| {
            o.with_path_regularization(0.9).with_engine(Engine::Tensors)
        }),
    ];
    let effort = Effort {
        samples: 16,
        ..CONES
    };
    let mut cases = facet_cases();
    let of_phong = all_classes().into_iter();
    cases.extend(of_phong.filter(|case| ["specular", "shininess"].contains(&case.name)));
    assert_agreement(&cases, setups, DType::F64, effort, |_| 1e-3);
}

/// Polished metal, plastic and glass over a matt floor, below a small lamp.
fn polished(
    d: &Device,
    dtype: DType,
    [x, roughness, x_of_plastic]: [Tensor<1>; 3],
    lamp: f64,
) -> (Scene, Camera) {
    let ball = |at: [f64; 3]| shapes::icosphere(1, d).scaled(0.45).translated(at);
    let metal = Material::conductor(ETA, EXTINCTION, roughness);
    let along = Tensor::<1>::from_floats([1.0, 0.0, 0.0], d).cast(dtype);
    let moved = |ball: Mesh, x| ball.cast(dtype).translated(x * along.clone());
    let lamp_mesh = facing_down([-lamp, lamp], [-lamp, lamp], 3.0, d).cast(dtype);
    let power = 0.5 / (lamp * lamp);
    let gold = moved(ball([-0.6, 0.5, 0.0]), x);
    let glass = ball([0.6, 0.5, 0.0]).cast(dtype);
    let plastic = moved(ball([0.0, 0.5, -0.9]), x_of_plastic);
    let scene = Scene::new()
        .with_object(diffuse(floor(2.0, 0.0, d).cast(dtype), [0.7; 3]))
        .with_object(Object::new(gold).with_material(metal))
        .with_object(Object::new(glass).with_material(Material::dielectric(1.5, 0.1)))
        .with_object(Object::new(plastic).with_material(Material::phong([0.2; 3], [0.7; 3], 200.0)))
        .with_object(emitting(lamp_mesh, [power; 3]))
        .with_environment([0.2; 3]);
    let camera = Camera::look_at([0.3, 2.0, 3.6], [0.0, 0.4, 0.0]).with_fov_y(40.0);
    (scene, camera)
}

#[test]
fn gradients_are_those_of_the_regularized_image() {
    let options = RenderOptions::new(8, 8)
        .with_samples(64)
        .with_bounces(2)
        .with_path_regularization(0.5);
    let (precision, seeds) = if long() { (0.02, 8192) } else { (0.08, 2048) };
    let settings = GradCheck::new(options, &Device::flex())
        .with_precision(precision)
        .with_seeds(32, seeds);
    let parameters = [
        Checked::new("x", [0.0], 0.05),
        Checked::new("x of plastic", [0.0], 0.05),
    ];
    let report = gradcheck(&parameters, &settings, |point| {
        let [x, plastic] = ["x", "x of plastic"].map(|name| point.get(name));
        let roughness = Tensor::from_data([0.2], (&point.device, point.dtype));
        Ok(polished(
            &point.device,
            point.dtype,
            [x?, roughness, plastic?],
            0.3,
        ))
    });
    let report = report.expect("a report");
    println!("{report}");
    assert!(report.agrees(), "{report}");
}

/// Light that polished balls throw on the floor, from a small lamp.
#[test]
fn caustics_have_less_noise() {
    let d = Device::flex();
    let of = |options: &RenderOptions, seed| {
        let x = leaf(&[0.0], &d);
        let constant = |v: f32| leaf(&[v], &d).inner();
        let numbers = [x.clone(), constant(0.05), constant(0.0)];
        let (scene, camera) = polished(&d, DType::F32, numbers, 0.02);
        let image = render(&scene, &camera, &options.clone().with_seed(seed)).expect("an image");
        let sum = image.radiance.mean();
        let value = scalar(&sum);
        [value, gradient(&x, &sum.backward())[0]]
    };
    let sharp = RenderOptions::new(16, 16).with_samples(16).with_bounces(2);
    let regularized = sharp.clone().with_path_regularization(0.3);
    let noise = |options: &RenderOptions| {
        let found: Vec<[f64; 2]> = (0..64).into_par_iter().map(|s| of(options, s)).collect();
        [0, 1].map(|i| mean_and_error(&found.iter().map(|f| f[i]).collect::<Vec<_>>()).1)
    };
    let (before, after) = (noise(&sharp), noise(&regularized));
    println!("noise of image and gradient: {before:?}, regularized {after:?}");
    assert!(after[0] < 0.5 * before[0] && after[1] < 0.5 * before[1]);
}

/// What a camera ray meets first keeps its roughness: direct light is the same to the bit.
#[test]
fn the_first_surface_keeps_its_roughness() {
    let d = Device::flex();
    let constant = |v: f32| leaf(&[v], &d).inner();
    let numbers = [constant(0.0), constant(0.05), constant(0.0)];
    let (scene, camera) = polished(&d, DType::F32, numbers, 0.3);
    let options = RenderOptions::new(16, 16).with_samples(4).with_bounces(0);
    let regularized = options.clone().with_path_regularization(1.0);
    let [a, b] = [&options, &regularized].map(|o| radiance(&scene, &camera, o));
    assert_eq!(a, b);
    let [a, b] = [options, regularized].map(|o| radiance(&scene, &camera, &o.with_bounces(1)));
    assert_ne!(a, b);
}

#[test]
fn a_least_roughness_is_between_0_and_1() {
    for least in [0.0, 1.5, f64::NAN] {
        let options = RenderOptions::new(4, 4).with_path_regularization(least);
        says(message(options.check()), ["path_regularization", "(0, 1]"]);
    }
}
