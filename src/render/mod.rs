//! `render()`: passes, tiles, averaging.

mod film;
mod options;

use std::sync::atomic::{AtomicUsize, Ordering};

use burn::tensor::{Device, Tensor};
use rayon::prelude::*;

use crate::error::Result;
use crate::scene::{Camera, Flattened, Scene};
use crate::transport::{Census, Dimension, PathSettings, Sampler, trace};
use crate::visibility::{Rays, Sparse, Visibility};

pub use crate::transport::Diagnostics;
pub use film::{Image, Statistics};
pub use options::{Progress, RenderOptions};

/// Renders a scene.
///
/// The image is in the graph of every tensor of the scene and camera that requires a gradient:
/// vertices, transforms, velocities, materials, textures, lights, environment, camera pose, field
/// of view and lens. Without any such tensor, tiles run on all cores and no tape is recorded.
///
/// # Errors
/// If the scene, the camera or the options are not valid; nothing is rendered then.
pub fn render(scene: &Scene, camera: &Camera, options: &RenderOptions) -> Result<Image> {
    options.check()?;
    let flattened = Flattened::new(scene, camera, options.bounds)?;
    // The soft order in depth and diagnostics are there in tensors only, and GPUs do without the host.
    let soft = matches!(options.visibility, Visibility::LayeredSoft { .. });
    let dense =
        options.brute_force || options.diagnostics || soft || !is_cpu(&flattened.context.device);
    let sparse = if dense {
        None
    } else {
        Some(Sparse::new(&flattened.triangles, options.cutoff)?)
    };
    let renderer = Renderer {
        sparse,
        scene: &flattened,
        camera,
        options,
        sampler: Sampler::new(options.seed),
        settings: PathSettings {
            sigma: options.sigma / (flattened.unit * flattened.unit),
            visibility: options.visibility,
            diagnostics: options.diagnostics,
            bounces: options.bounces,
            roulette_after: options.roulette_after,
        },
    };
    renderer.render()
}

struct Renderer<'a> {
    scene: &'a Flattened,
    camera: &'a Camera,
    options: &'a RenderOptions,
    sampler: Sampler,
    settings: PathSettings,
    sparse: Option<Sparse>,
}

/// Pixels `first..first + pixels` with samples `from..to`.
#[derive(Clone, Copy, Debug)]
struct Tile {
    first: usize,
    pixels: usize,
    from: u32,
    to: u32,
}

/// Sums over the samples of a tile, one column a pixel `[C, P]`: radiance, and what was asked for.
struct TileSums {
    sums: Tensor<2>,
    census: Census,
    diagnostics: Option<Diagnostics>,
}

impl Renderer<'_> {
    fn render(&self) -> Result<Image> {
        let tiles = self.tiles();
        let done = AtomicUsize::new(0);
        let run = |tile: &Tile| {
            let sums = self.tile(tile);
            let n = done.fetch_add(1, Ordering::Relaxed) + 1;
            if let Some(progress) = &self.options.progress {
                progress(n, tiles.len());
            }
            sums
        };
        // The first tile tells whether there is a tape: a graph is built by one thread.
        let mut results = vec![run(&tiles[0])?];
        if results[0].sums.is_tracked() || !is_cpu(&self.scene.context.device) {
            for tile in &tiles[1..] {
                results.push(run(tile)?);
            }
        } else {
            results.extend(tiles[1..].par_iter().map(run).collect::<Result<Vec<_>>>()?);
        }
        let mut census = Census::default();
        results.iter().for_each(|r| census.merge(&r.census));
        let mut diagnostics: Option<Diagnostics> = None;
        for found in results.iter().filter_map(|r| r.diagnostics.as_ref()) {
            diagnostics.get_or_insert_default().merge(found);
        }

        // Tiles come in order of pixels, then samples.
        let mut columns: Vec<Tensor<2>> = Vec::new();
        for (tile, result) in tiles.iter().zip(results) {
            if tile.from == 0 {
                columns.push(result.sums);
            } else if let Some(sum) = columns.pop() {
                columns.push(sum + result.sums);
            }
        }
        // Not a division: its backward pass rounds 1/n to f32.
        let mean = Tensor::cat(columns, 1) * f64::from(self.options.samples).recip();
        let mut image = self.image(mean, &census);
        image.diagnostics = diagnostics;
        Ok(image)
    }

    fn tiles(&self) -> Vec<Tile> {
        let triangles = self.scene.triangles.len();
        let pixels = self.options.width * self.options.height;
        let samples = self.options.samples as usize;
        let pairs = if is_cpu(&self.scene.context.device) {
            1 << 18
        } else {
            1 << 23
        };
        let rays = self
            .options
            .rays_per_tile
            .unwrap_or(if self.sparse.is_some() {
                1 << 13
            } else {
                (pairs / triangles).clamp(128, 1 << 17)
            });
        let per_tile = (rays / samples).max(1);
        let samples_per_tile = rays.min(samples);
        let mut tiles = Vec::new();
        for first in (0..pixels).step_by(per_tile) {
            for from in (0..samples).step_by(samples_per_tile) {
                tiles.push(Tile {
                    first,
                    pixels: per_tile.min(pixels - first),
                    from: from as u32,
                    to: (from + samples_per_tile).min(samples) as u32,
                });
            }
        }
        tiles
    }

    fn tile(&self, tile: &Tile) -> Result<TileSums> {
        let paths: Vec<(u32, u32)> = (tile.first..tile.first + tile.pixels)
            .flat_map(|pixel| (tile.from..tile.to).map(move |sample| (pixel as u32, sample)))
            .collect();
        let rays = self.camera_rays(&paths);
        let samples = (tile.to - tile.from) as usize;
        let found = trace(
            self.scene,
            &self.settings,
            &self.sampler,
            self.sparse.as_ref(),
            rays,
            &paths,
            samples,
        )?;
        let census = found.census.clone();
        let diagnostics = found.diagnostics.clone();
        let rows = Tensor::cat(self.outputs(found), 0);
        let channels = rows.dims()[0];
        let sums = rows
            .reshape([channels * tile.pixels, samples])
            .sum_dim(1)
            .reshape([channels, tile.pixels]);
        Ok(TileSums {
            sums,
            census,
            diagnostics,
        })
    }

    fn camera_rays(&self, paths: &[(u32, u32)]) -> Rays {
        let context = &self.scene.context;
        let random = |d| self.sampler.uniform(paths, 0, d);
        let (width, height) = (self.options.width, self.options.height);
        let film = |coordinate: &dyn Fn(usize) -> usize, jitter: Vec<f64>, size: usize| {
            let values: Vec<f64> = paths
                .iter()
                .zip(jitter)
                .map(|(&(pixel, _), j)| (coordinate(pixel as usize) as f64 + j) / size as f64)
                .collect();
            context.row(&values)
        };
        let film = [
            film(&|p| p % width, random(Dimension::FilmX), width),
            film(&|p| p / width, random(Dimension::FilmY), height),
        ];
        let disk = self.camera.has_lens().then(|| {
            let polar: Vec<(f64, f64)> = random(Dimension::LensRadius)
                .iter()
                .zip(random(Dimension::LensAngle))
                .map(|(r, a)| (r.sqrt(), std::f64::consts::TAU * a))
                .collect();
            [
                context.row(&polar.iter().map(|(r, a)| r * a.cos()).collect::<Vec<_>>()),
                context.row(&polar.iter().map(|(r, a)| r * a.sin()).collect::<Vec<_>>()),
            ]
        });
        let time = self
            .scene
            .triangles
            .velocity
            .is_some()
            .then(|| context.row(&random(Dimension::Time)));
        let (origin, direction) = self.camera.rays(
            context,
            self.scene.bounds.center,
            self.scene.unit,
            width as f64 / height as f64,
            &film,
            disk.as_ref(),
        );
        Rays {
            origin,
            direction,
            time,
            departure: None,
            arrival: None,
        }
    }
}

/// Whether tiles of rays gain from several host threads.
pub(crate) fn is_cpu(device: &Device) -> bool {
    let name = format!("{device:?}");
    name.contains("Flex") || name.contains("NdArray")
}
