//! Tensors from numbers and back, and gradients of them.

use burn::tensor::{DType, Device, Gradients, Tensor, TensorData};
use glam::DVec3;
use softray::prelude::*;

/// A tensor's values.
pub fn values<const D: usize>(t: &Tensor<D>) -> Vec<f64> {
    t.clone().inner().into_data().iter::<f64>().collect()
}

/// The value of a tensor `[1]`.
#[track_caller]
pub fn scalar(t: &Tensor<1>) -> f64 {
    assert_eq!(t.dims(), [1]);
    values(t)[0]
}

/// A constant.
pub fn tensor<const D: usize>(
    values: &[f64],
    shape: [usize; D],
    device: &Device,
    dtype: DType,
) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values.to_vec(), shape), (device, dtype))
}

/// A constant `[N]` in f32.
pub fn row(values: &[f32], device: &Device) -> Tensor<1> {
    Tensor::from_floats(values, device)
}

/// A tensor `[N]` in f32 that records gradients.
pub fn leaf(values: &[f32], device: &Device) -> Tensor<1> {
    row(values, device).autodiff().require_grad()
}

/// A leaf's gradient.
#[track_caller]
pub fn gradient<const D: usize>(leaf: &Tensor<D>, gradients: &Gradients) -> Vec<f64> {
    values(&leaf.grad(gradients).expect("a gradient"))
}

/// The rows of a tensor `[N, 3]`.
pub fn points(rows: &Tensor<2>) -> Vec<DVec3> {
    let values = values(rows);
    values.chunks_exact(3).map(DVec3::from_slice).collect()
}

/// The values of an image, `[H, W, 3]`.
#[track_caller]
pub fn radiance(scene: &Scene, camera: &Camera, options: &RenderOptions) -> Vec<f64> {
    values(&render(scene, camera, options).expect("an image").radiance)
}

/// The scene with the vertices of all of its objects as leaves.
pub fn with_leaves(mut scene: Scene) -> Scene {
    for object in &mut scene.objects {
        let vertices = object.mesh.vertices.clone().autodiff().require_grad();
        object.mesh = object.mesh.clone().with_vertices(vertices);
    }
    scene
}

/// That autodiff agrees with central differences of a function of numbers at every one of them, in f64.
#[track_caller]
pub fn gradients_agree(x: &[f64], f: impl Fn(Tensor<1>) -> Tensor<1>) {
    let constant = |x: &[f64]| tensor(x, [x.len()], &Device::flex(), DType::F64);
    let leaf = constant(x).autodiff().require_grad();
    let gradient = gradient(&leaf, &f(leaf.clone()).backward());
    let h = 1e-6;
    for (i, found) in gradient.iter().enumerate() {
        let at = |step: f64| {
            let mut moved = x.to_vec();
            moved[i] += step;
            values(&f(constant(&moved)))[0]
        };
        let difference = (at(h) - at(-h)) / (2.0 * h);
        let apart = (found - difference).abs();
        let bound = 1e-6 * difference.abs().max(1.0);
        assert!(apart < bound, "{i}: {found} {difference}");
    }
    assert!(gradient.iter().any(|g| g.abs() > 1e-3), "{gradient:?}");
}
