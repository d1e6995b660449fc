//! The Cornell box by the kernels for GPUs, in a browser that has WebGPU.

use softray::prelude::*;
use wasm_bindgen::prelude::*;

/// Renders an image of some columns and rows on the browser's GPU. Returns its linear RGB, and after it the derivatives
/// of its mean by the camera's place.
#[wasm_bindgen]
pub async fn on_gpu(width: usize, height: usize, samples: u32) -> Result<Vec<f32>, JsError> {
    let device = Device::wgpu_options().init_async().await?;
    let (scene, mut camera) = cornell_box(&device);
    let eye = camera.eye.values()?.map(|x| x as f32);
    let eye = Tensor::<1>::from_floats(eye, &device).autodiff();
    let eye = eye.require_grad();
    camera.eye = eye.clone().into();
    let options = RenderOptions::new(width, height)
        .with_samples(samples)
        .with_bounces(1);
    let image = render_async(&scene, &camera, &options).await?.radiance;
    let gradients = image.clone().mean().backward();
    let by_eye = eye.grad(&gradients).ok_or(JsError::new("no gradient"))?;
    let image = image.inner().into_data_async().await?;
    let by_eye = by_eye.into_data_async().await?;
    Ok(image.iter::<f32>().chain(by_eye.iter()).collect())
}
