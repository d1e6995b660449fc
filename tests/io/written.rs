//! What tests share that write scenes and read them back.

use crate::common::numbers::largest;
use crate::common::tensors::radiance;
use burn::tensor::TensorData;
use softray::prelude::*;

/// The corners of a square in a texture, beyond its borders.
pub fn uvs() -> Tensor<2> {
    Tensor::from_floats(
        [[-0.3, -0.3], [1.4, -0.3], [1.4, 1.4], [-0.3, 1.4]],
        &Device::flex(),
    )
}

pub fn texels<const D: usize>(shape: [usize; D], f: impl Fn(usize) -> f32) -> Tensor<D> {
    let values: Vec<f32> = (0..shape.iter().product()).map(f).collect();
    Tensor::from_data(TensorData::new(values, shape), &Device::flex())
}

pub fn camera() -> Camera {
    Camera::look_at([0.3, 1.6, 4.0], [0.0, 0.6, 0.0]).with_fov_y(45.0)
}

pub fn image(scene: &Scene) -> Vec<f64> {
    let options = RenderOptions::new(24, 24).with_samples(4).with_bounces(2);
    radiance(scene, &camera(), &options)
}

#[track_caller]
pub fn near(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len(), "{found:?}");
    let most = largest(found.iter().zip(expected).map(|(a, b)| a - b));
    assert!(most < 1e-6, "{found:?} {expected:?}");
}

/// A color that is no texture.
pub fn constant(albedo: &ColorTexture) -> [f64; 3] {
    match albedo {
        ColorTexture::Constant(p) => p.values().expect("values"),
        ColorTexture::Texture { .. } => panic!("a texture"),
    }
}
