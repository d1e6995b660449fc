//! Derivatives with respect to a normal map alone, in the light of an environment map: no edges are searched for them.

use softray::prelude::*;

/// The derivative along a change of all texels of the map of a floor below a cube is that of central differences.
#[test]
fn normal_map_in_the_light_of_a_map() -> softray::Result<()> {
    let device = Device::flex();
    let tensor = |values: Vec<f32>, size: [usize; 3]| {
        Tensor::<1>::from_floats(values.as_slice(), &device).reshape(size)
    };
    let sky = |i: usize| {
        let (x, y) = ((i % 32) as f32, (i / 32) as f32);
        let spot = (0.4 * x).sin() * (0.3 * y).cos();
        [0.2 + 3.0 * spot.max(0.0), 0.5, 0.1 + 0.05 * x]
    };
    let sky = tensor((0..512).flat_map(sky).collect(), [16, 32, 3]);
    let corners = [
        [-2.0, 0.0, -2.0],
        [-2.0, 0.0, 2.0],
        [2.0, 0.0, 2.0],
        [2.0, 0.0, -2.0],
    ];
    let [a, b, c, d] = corners;
    let floor = shapes::quad(a, b, c, d, &device);
    let cube = shapes::cube(&device)
        .scaled(0.5)
        .translated([0.0, 0.55, 0.0]);
    let scene = |slopes: Tensor<3>| {
        let up = slopes.ones_like().narrow(2, 0, 1);
        let texels = Tensor::cat(vec![slopes, up], 2);
        let length = texels.clone().powi_scalar(2).sum_dim(2).sqrt();
        let material = Material::metallic_roughness([0.8, 0.6, 0.3], 0.5, 0.3);
        let material = material.with_normal_map(texels / length, 1.0);
        Scene::new()
            .with_object(Object::new(floor.clone()).with_material(material))
            .with_object(Object::new(cube.clone()))
            .with_environment(Environment::map(sky.clone()))
    };
    let camera = Camera::look_at([0.5, 2.5, 3.5], [0.0; 3]);
    let weight = |i: usize| (0.4 * (i / 3 % 16) as f32).sin() + (0.3 * (i / 48) as f32).cos();
    let weights = tensor((0..768).map(weight).collect(), [16, 16, 3]);
    let slope = |i: usize| 0.3 * ((i * 7 % 11) as f32 / 11.0 - 0.5);
    let slopes = tensor((0..128).map(slope).collect(), [8, 8, 2]);
    let along = tensor(
        (0..128).map(|i| (0.7 * i as f32).sin()).collect(),
        [8, 8, 2],
    );
    let loss = |slopes: Tensor<3>, samples: u32, seed: u64| -> softray::Result<Tensor<1>> {
        let options = RenderOptions::new(16, 16).with_bounces(0);
        let options = options.with_samples(samples).with_seed(seed);
        let image = render(&scene(slopes), &camera, &options)?.radiance;
        Ok((image * weights.clone()).sum())
    };
    let (mut gradients, mut differences) = (Vec::new(), Vec::new());
    for seed in 0..16 {
        let leaf = slopes.clone().autodiff().require_grad();
        let by = loss(leaf.clone(), 1024, seed)?.backward();
        let by = leaf.grad(&by).expect("a gradient").inner();
        gradients.push((by * along.clone()).sum().into_scalar::<f64>());
        let at = |step: f64| -> softray::Result<f64> {
            let moved = slopes.clone() + along.clone() * step;
            Ok(loss(moved, 2048, 100 + seed)?.into_scalar::<f64>())
        };
        differences.push((at(0.02)? - at(-0.02)?) / 0.04);
    }
    let of = |all: &[f64]| {
        let count = all.len() as f64;
        let mean = all.iter().sum::<f64>() / count;
        let squares = all.iter().map(|x| (x - mean).powi(2)).sum::<f64>();
        (mean, (squares / (count - 1.0) / count).sqrt())
    };
    let ((gradient, error), (difference, other)) = (of(&gradients), of(&differences));
    println!("{gradient} ± {error}, {difference} ± {other}");
    let error = error.hypot(other);
    assert!(error < 0.06 * difference.abs(), "{error}");
    assert!(
        (gradient - difference).abs() < 3.5 * error,
        "{gradient} {difference}"
    );
    Ok(())
}
