use std::time::Instant;

use serde::Deserialize;
use serde_json::json;
use softray::prelude::*;

use crate::Answer;
use crate::scenes::{Motion, View};

/// Blocks of a side: derivatives of an image are sums over the channels and pixels of each.
const BLOCKS: usize = 8;

#[derive(Deserialize)]
pub struct Request {
    #[serde(flatten)]
    view: View,
    motion: Motion,
    /// What each block counts in the scalar; without it the derivatives of all blocks are returned.
    weights: Option<Vec<f32>>,
    /// Samples a pixel, one series of estimates for each.
    samples: Vec<u32>,
    /// Seconds for each series; at least three estimates.
    seconds: f64,
    seed: u64,
    /// Central differences with this step in place of gradients.
    differences: Option<f64>,
}

impl Request {
    pub fn answer(&self) -> Answer {
        let file = self.view.load()?;
        let mut series = Vec::new();
        for &samples in &self.samples {
            let start = Instant::now();
            self.estimate(&file, samples, self.seed)?;
            let first = start.elapsed().as_secs_f64();
            let (mut times, mut values) = (Vec::new(), Vec::new());
            while times.len() < 3 || times.iter().sum::<f64>() < self.seconds {
                let start = Instant::now();
                let seed = self.seed + 1 + times.len() as u64;
                values.push(self.estimate(&file, samples, seed)?);
                times.push(start.elapsed().as_secs_f64());
            }
            series.push(
                json!({ "samples": samples, "first": first, "times": times, "values": values }),
            );
        }
        Ok(json!({ "series": series }))
    }

    /// The derivative of the weighted image, or those of all blocks.
    fn estimate(&self, file: &SceneFile, samples: u32, seed: u64) -> softray::Result<Vec<f64>> {
        let options = self.view.options().with_samples(samples).with_seed(seed);
        if let Some(step) = self.differences {
            let [left, right] = [-step, step].map(|x| self.blocks(file, x, &options));
            let pairs = left?.into_iter().zip(right?);
            return Ok(pairs.map(|(l, r)| (r - l) / (2.0 * step)).collect());
        }
        match &self.weights {
            Some(weights) => Ok(vec![self.scalar(file, weights, &options)?]),
            None => self.of_blocks(file, &options),
        }
    }

    fn scalar(
        &self,
        file: &SceneFile,
        weights: &[f32],
        options: &RenderOptions,
    ) -> softray::Result<f64> {
        let x = leaf(file);
        let scene = self.motion.apply(&file.scene, &x)?;
        let image = render(&scene, &file.camera, options)?;
        let size = self.view.size;
        let weights: Vec<f32> = (0..size * size)
            .map(|p| weights[self.block_of(p)])
            .collect();
        let weights = Tensor::<1>::from_floats(weights.as_slice(), &x.device().inner());
        let loss = (image.radiance * weights.reshape([size, size, 1])).sum();
        derivative(&x, loss)
    }

    /// Of all blocks, from one derivative image.
    fn of_blocks(&self, file: &SceneFile, options: &RenderOptions) -> softray::Result<Vec<f64>> {
        let device = self.view.device()?;
        let build = |values: &[f64]| {
            let x = Tensor::<1>::from_floats([values[0] as f32], &device);
            Ok((self.motion.apply(&file.scene, &x)?, file.camera.clone()))
        };
        let (scene, camera, tangents) = Tangent::of_numbers(&[0.0], build)?;
        let derivative = render_derivative(&scene, &camera, options, &tangents)?;
        self.sums(&derivative.tangents.view(0).radiance)
    }

    fn block_of(&self, pixel: usize) -> usize {
        let size = self.view.size;
        let side = size / BLOCKS;
        pixel / size / side * BLOCKS + pixel % size / side
    }

    /// The sums of the image's blocks with the object at x.
    fn blocks(
        &self,
        file: &SceneFile,
        x: f64,
        options: &RenderOptions,
    ) -> softray::Result<Vec<f64>> {
        let x = Tensor::<1>::from_floats([x as f32], &self.view.device()?);
        let scene = self.motion.apply(&file.scene, &x)?;
        let image = render(&scene, &file.camera, options)?;
        self.sums(&image.radiance)
    }

    /// The sums of an image's blocks.
    fn sums(&self, image: &Tensor<3>) -> softray::Result<Vec<f64>> {
        let image = HostImage::from_tensor(image)?;
        let mut sums = vec![0.0; BLOCKS * BLOCKS];
        for (p, channels) in image.pixels.chunks(3).enumerate() {
            sums[self.block_of(p)] += channels.iter().map(|&c| f64::from(c)).sum::<f64>();
        }
        Ok(sums)
    }
}

fn leaf(file: &SceneFile) -> Tensor<1> {
    let device = file.scene.objects[0].mesh.vertices.device();
    Tensor::zeros([1], &device).autodiff().require_grad()
}

/// The derivative of a loss `[1]` by x; 0 where x is not in its graph.
fn derivative(x: &Tensor<1>, loss: Tensor<1>) -> softray::Result<f64> {
    let gradients = loss.backward();
    Ok(x.grad(&gradients)
        .map_or(0.0, |g| f64::from(g.into_scalar::<f32>())))
}
