//! One view as a chain of tensor operations.

use std::sync::Arc;
use std::sync::atomic::AtomicUsize;

use burn::tensor::Tensor;
use rayon::prelude::*;

use super::outputs::outputs;
use super::sight::HostSight;
use crate::accel::Hierarchy;
use crate::device::is_cpu;
use crate::error::Result;
use crate::render::options::RenderOptions;
use crate::render::tiles::{Tile, sampler, tiles};
use crate::sampling::{Dimension, Sampler};
use crate::scene::{Camera, Flattened};
use crate::transport::{Diagnostics, Lights, PathSettings, RayStatistics, Sky, Transport, trace};
use crate::visibility::Rays;

/// A view, ready to be traced.
pub(super) struct TensorRenderer<'a> {
    pub scene: &'a Flattened,
    camera: &'a Camera,
    options: &'a RenderOptions,
    sampler: Sampler,
    lights: Arc<Lights>,
    sky: Option<Sky>,
    settings: PathSettings,
    sight: HostSight,
    /// The pixels to render, where that is not all.
    pixels: Option<Arc<Vec<u32>>>,
}

/// Counts of a render.
pub(super) struct Found {
    pub statistics: RayStatistics,
    pub diagnostics: Option<Diagnostics>,
}

/// Sums over the samples of a tile, one column a pixel `[C, P]`: radiance, and what was asked for.
pub(super) struct TileSums {
    pub sums: Tensor<2>,
    statistics: RayStatistics,
    diagnostics: Option<Diagnostics>,
}

impl<'a> TensorRenderer<'a> {
    pub fn new(
        scene: &'a Flattened,
        camera: &'a Camera,
        options: &'a RenderOptions,
        pixels: Option<Arc<Vec<u32>>>,
        hierarchy: Option<Arc<Hierarchy>>,
    ) -> Result<Self> {
        Ok(Self {
            scene,
            camera,
            options,
            sampler: sampler(options),
            lights: Arc::new(Lights::new(scene, options.sampling.emitters)?),
            sky: Sky::new(scene)?,
            settings: settings(options),
            sight: HostSight::new(scene, camera, options, hierarchy)?,
            pixels,
        })
    }

    /// The boxes, if there are any.
    pub fn hierarchy(&self) -> Option<Arc<Hierarchy>> {
        self.sight.hierarchy()
    }

    /// Means over samples `[C, pixels]`.
    pub fn render(&self) -> Result<(Tensor<2>, Found)> {
        let tiles = self.tiles();
        let done = AtomicUsize::new(0);
        let run = |tile: &Tile| {
            let sums = self.tile(tile);
            self.options.progress.tile(&done, tiles.len());
            sums
        };
        let results = if is_cpu(&self.scene.context.device) {
            tiles.par_iter().map(run).collect::<Result<Vec<_>>>()?
        } else {
            tiles.iter().map(run).collect::<Result<_>>()?
        };
        let mut statistics = RayStatistics::default();
        results.iter().for_each(|r| statistics.merge(&r.statistics));
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
        let found = Found {
            statistics,
            diagnostics,
        };
        Ok((mean, found))
    }

    fn tiles(&self) -> Vec<Tile> {
        let triangles = self.scene.triangles.len();
        let pairs = if is_cpu(&self.scene.context.device) {
            1 << 18
        } else {
            1 << 23
        };
        let rays = match self.sight {
            HostSight::Softmax(_, None) => (pairs / triangles).clamp(128, 1 << 17),
            _ => 1 << 13,
        };
        let pixels = self.pixels.as_ref().map_or_else(
            || self.options.width * self.options.height,
            |pixels| pixels.len(),
        );
        tiles(self.options, pixels, rays)
    }

    /// The sums over a tile.
    pub fn tile(&self, tile: &Tile) -> Result<TileSums> {
        let paths: Vec<(u32, u32)> = (tile.first..tile.first + tile.pixels)
            .map(|i| self.pixels.as_ref().map_or(i as u32, |pixels| pixels[i]))
            .flat_map(|pixel| (tile.from..tile.to).map(move |sample| (pixel, sample)))
            .collect();
        let rays = self.camera_rays(&paths);
        let samples = (tile.to - tile.from) as usize;
        let transport = Transport {
            scene: self.scene,
            settings: &self.settings,
            sampler: &self.sampler,
            lights: &self.lights,
            sky: self.sky.as_ref(),
            sight: self.sight.get(),
        };
        let found = trace(transport, rays, &paths, samples)?;
        let statistics = found.statistics.clone();
        let diagnostics = found.diagnostics.clone();
        let rows = Tensor::cat(outputs(self.scene, self.options.outputs, found)?, 0);
        let channels = rows.dims()[0];
        let sums = rows
            .reshape([channels * tile.pixels, samples])
            .sum_dim(1)
            .reshape([channels, tile.pixels]);
        Ok(TileSums {
            sums,
            statistics,
            diagnostics,
        })
    }

    fn camera_rays(&self, paths: &[(u32, u32)]) -> Rays {
        let context = &self.scene.context;
        let (width, height) = (self.options.width, self.options.height);
        let film = |coordinate: &dyn Fn(usize) -> usize, jitter: Vec<f64>, size: usize| {
            let values: Vec<f64> = paths
                .iter()
                .zip(jitter)
                .map(|(&(pixel, _), j)| (coordinate(pixel as usize) as f64 + j) / size as f64)
                .collect();
            context.row(&values)
        };
        let dimensions = [Dimension::FilmX, Dimension::FilmY];
        let jitter = self.sampler.uniform(paths, 0, dimensions);
        let [x, y] = match &self.sight {
            HostSight::Softmax(..) => jitter,
            HostSight::Cones(_, filter) => jitter.map(|numbers| {
                let of = |u: f64| 0.5 + f64::from(filter.sample(u as f32));
                numbers.into_iter().map(of).collect()
            }),
        };
        let film = [
            film(&|p| p % width, x, width),
            film(&|p| p / width, y, height),
        ];
        let disk = self.camera.has_lens().then(|| {
            let dimensions = [Dimension::LensRadius, Dimension::LensAngle];
            let [radius, angle] = self.sampler.uniform(paths, 0, dimensions);
            let polar: Vec<(f64, f64)> = radius
                .iter()
                .zip(angle)
                .map(|(r, a)| (r.sqrt(), std::f64::consts::TAU * a))
                .collect();
            [
                context.row(&polar.iter().map(|(r, a)| r * a.cos()).collect::<Vec<_>>()),
                context.row(&polar.iter().map(|(r, a)| r * a.sin()).collect::<Vec<_>>()),
            ]
        });
        let moves = self.scene.triangles.velocity.is_some();
        let time = moves.then(|| {
            let [time] = self.sampler.uniform(paths, 0, [Dimension::Time]);
            context.row(&time)
        });
        let (origin, direction) = self.camera.rays(
            context,
            self.scene.normalization.center,
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

/// The settings of paths.
fn settings(options: &RenderOptions) -> PathSettings {
    PathSettings {
        diagnostics: options.diagnostics,
        bounces: options.bounces,
        roulette_after: options.roulette_after,
        sampling: options.sampling,
    }
}
