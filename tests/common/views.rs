//! Views of a ball from several directions.

use softray::prelude::*;

/// The sum over directions, in degrees, of the mean squares of images.
pub fn squares<'a>(
    scene: &Scene,
    views: impl IntoIterator<Item = &'a f64>,
    options: &RenderOptions,
) -> softray::Result<Tensor<1>> {
    let device = scene.objects[0].mesh.vertices.device().inner();
    let mut loss = Tensor::zeros([1], &device.autodiff());
    for &degrees in views {
        let camera = Camera::orbit([0.0; 3], 4.0, degrees, 7.0)?;
        let image = render(scene, &camera, &options.clone().with_seed(degrees as u64))?;
        loss = loss + image.radiance.powf_scalar(2.0).mean();
    }
    Ok(loss)
}
