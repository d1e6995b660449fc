//! Renders against references of an independent, unblurred renderer.

use burn::tensor::Device;
use softray::prelude::*;

use crate::common::reference;
use crate::common::scenes::scene_file;

/// How an image compares with its reference.
#[derive(Clone, Copy, Debug)]
pub struct Comparison {
    /// Σ rendered / Σ reference.
    pub mean_ratio: f64,
    /// Root mean square difference of values clipped to [0, 1].
    pub rmse_clipped: f64,
}

/// The images of the reference folder: scene and bounces.
pub const REFERENCES: [(&str, u32); 9] = [
    ("cornell", 0),
    ("cornell", 1),
    ("cornell", 3),
    ("shadow", 0),
    ("sphere", 1),
    ("glossy_sphere", 1),
    ("lens", 1),
    ("motion", 0),
    ("motion", 1),
];

/// The image of an independent renderer.
pub fn target(name: &str, bounces: u32) -> HostImage {
    HostImage::read(reference(&format!("{name}/bounces-{bounces}.exr"))).expect("a reference")
}

/// A render of the scene of a reference, with samples and a seed.
pub fn image(
    name: &str,
    bounces: u32,
    (samples, seed): (u32, u64),
    visibility: Visibility,
    device: &Device,
) -> HostImage {
    let file = scene_file(name, device);
    let options = RenderOptions::new(file.width, file.height)
        .with_samples(samples)
        .with_bounces(bounces)
        .with_visibility(visibility)
        .with_seed(seed);
    let image = render(&file.scene, &file.camera, &options).expect("an image");
    HostImage::from_tensor(&image.radiance).expect("values")
}

/// Renders a reference scene and compares.
pub fn compare(
    name: &str,
    bounces: u32,
    samples: u32,
    visibility: Visibility,
    device: &Device,
) -> Comparison {
    let target = target(name, bounces);
    let image = image(name, bounces, (samples, 5), visibility, device);
    let found = Comparison {
        mean_ratio: image.mean_ratio(&target),
        rmse_clipped: image.rmse(&target, true).expect("the same size"),
    };
    println!("{name} bounces {bounces}, {samples} samples, {visibility:?}: {found:?}");
    found
}

/// The share of pixels (of 3 channels) within 1e-3 relative.
pub fn share_of_close_pixels(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let close = a
        .chunks_exact(3)
        .zip(b.chunks_exact(3))
        .filter(|(p, q)| {
            p.iter()
                .zip(q.iter())
                .all(|(x, y)| (x - y).abs() <= 1e-3 * x.abs().max(y.abs()).max(1e-6))
        })
        .count();
    close as f64 / (a.len() / 3) as f64
}
