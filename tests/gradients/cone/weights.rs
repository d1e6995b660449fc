//! What the derivatives beside references are weighted by.

use std::path::Path;

use softray::prelude::HostImage;

/// Pixels of a side of the references of derivatives.
pub const SIZE: usize = 64;

/// From a reference derivative (a file): what each pixel's channels are weighted by, the reference's means
/// over blocks of 8 × 8 pixels, and Σ weights·reference.
pub fn block_weights(file: &Path) -> (Vec<f32>, f64) {
    let reference = HostImage::read(file).expect("a reference");
    let sums: Vec<f64> = reference
        .pixels
        .chunks(3)
        .map(|p| p.iter().map(|&v| f64::from(v)).sum())
        .collect();
    let mut blocks = [[0.0; SIZE / 8]; SIZE / 8];
    for (i, sum) in sums.iter().enumerate() {
        blocks[i / SIZE / 8][i % SIZE / 8] += sum / 64.0;
    }
    let weights: Vec<f32> = (0..SIZE * SIZE)
        .map(|i| blocks[i / SIZE / 8][i % SIZE / 8] as f32)
        .collect();
    let products = sums.iter().zip(&weights).map(|(s, &w)| s * f64::from(w));
    let exact = products.sum();
    (weights, exact)
}
