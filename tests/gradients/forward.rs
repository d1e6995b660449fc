//! Forward mode: the derivatives of images beside gradients by the backward pass.

use burn::tensor::DType;
use softray::prelude::*;

use crate::common::errors::{message, says};
use crate::common::facets::facet_cases;
use crate::common::gradients::{CONES, Case, SHARP, all_classes, lights};
use crate::common::numbers::mean_and_error;
use crate::common::tensors::{gradient, leaf, tensor, values};

const SIZE: usize = 12;

/// The options of a case. With a list of edges that does not adapt, both modes draw the same samples.
fn options(case: &Case, visibility: Visibility, samples: u32) -> RenderOptions {
    RenderOptions::new(SIZE, SIZE)
        .with_samples(samples)
        .with_bounces(case.bounces)
        .with_visibility(visibility)
        .with_adaptive_edges(false)
        .with_seed(3)
}

/// Signs that follow no pattern.
fn signs(count: usize) -> Vec<f64> {
    let sign = |i: usize| f64::from((i * i * 7 + i * 13) % 11 < 5) * 2.0 - 1.0;
    (0..count).map(sign).collect()
}

/// ⟨w, J·v⟩ = ⟨Jᵀ·w, v⟩ at equal seeds for every class of parameter, with w of ±1 for all channels of all pixels. Where
/// the sum cancels, the derivatives of pixels set the scale.
#[test]
fn products_agree_with_the_backward_pass() {
    let device = Device::flex();
    let every = [
        all_classes(),
        facet_cases(),
        lights::still(),
        lights::moving(),
        lights::glowing(),
        lights::crossings(),
    ];
    let mut failures = Vec::new();
    for case in every.iter().flatten() {
        for visibility in [SHARP, CONES.visibility] {
            let options = options(case, visibility, 8).with_opacity();
            let number = |v: f64| tensor(&[v], [1], &device, DType::F64);
            let build = |v: &[f64]| Ok((case.build)(&device, DType::F64, number(v[0])));
            let (scene, camera, tangents) =
                Tangent::of_numbers(&[case.value], build).expect(case.name);
            let derivative =
                render_derivative(&scene, &camera, &options, &tangents).expect(case.name);
            let image = derivative.tangents.view(0);
            let by_pixel = [values(&image.radiance), values(&image.opacity.expect("it"))].concat();
            let w = signs(by_pixel.len());
            let forward: f64 = by_pixel.iter().zip(&w).map(|(by, w)| by * w).sum();

            let p = number(case.value).autodiff().require_grad();
            let (scene, camera) = (case.build)(&device, DType::F64, p.clone());
            let image = render(&scene, &camera, &options).expect(case.name);
            let plain = derivative.image.radiance.clone();
            let apart = values(&(image.radiance.clone().inner() - plain).abs().max())[0];
            assert!(apart < 1e-5, "{}: images differ by {apart}", case.name);
            let count = 3 * SIZE * SIZE;
            let of_color = tensor(&w[..count], [SIZE, SIZE, 3], &device, DType::F64);
            let of_opacity = tensor(&w[count..], [SIZE, SIZE], &device, DType::F64);
            let loss =
                (image.radiance * of_color).sum() + (image.opacity.expect("it") * of_opacity).sum();
            let backward = gradient(&p, &loss.backward())[0];

            let scale = by_pixel.iter().map(|v| v * v).sum::<f64>().sqrt().max(1e-6);
            let apart = (forward - backward).abs() / scale;
            println!(
                "{}: {forward:.6} {backward:.6}, apart {apart:.1e}",
                case.name
            );
            if apart.is_nan() || apart > 2e-6 {
                failures.push((case.name, visibility, forward, backward, apart));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}
