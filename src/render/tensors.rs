//! Renders the softmax form as chains of tensor operations, tile by tile.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use burn::tensor::Tensor;
use rayon::prelude::*;

use super::batch::of_batch;
use super::film::{Means, Statistics};
use super::replay::{Retrace, Retraced, replay};
use super::{Batch, RenderOptions, is_cpu};
use crate::accel::Hierarchy;
use crate::error::Result;
use crate::geometry::plain;
use crate::scene::{Camera, Collect, Detach, Flattened, Scene, visit_tensors};
use crate::transport::{
    Census, Diagnostics, Dimension, Lights, PathSettings, Sampler, Sky, Transport, trace,
};
use crate::visibility::{Rays, Softmax, Sparse};

/// Renders the views of a batch one after another.
pub(super) fn render(
    batch: &Batch,
    options: &RenderOptions,
    form: Softmax,
    pixels: Option<Arc<Vec<u32>>>,
) -> Result<Means> {
    let mut rendered = Vec::with_capacity(batch.views.len());
    for (index, (scene, camera)) in batch.views.iter().enumerate() {
        let scene = batch.scene(*scene, true);
        let view = View::render(
            &scene,
            camera,
            &options.of_view(index),
            form,
            pixels.clone(),
        );
        rendered.push(view.map_err(of_batch("view", index))?);
    }
    let objects = rendered.iter().map(|v| v.objects).max().unwrap_or(0);
    let rows = rendered
        .iter()
        .map(|v| v.rows(objects, options.outputs.object_ids));
    Ok(Means {
        mean: Tensor::stack(rows.collect(), 0),
        objects,
        statistics: rendered.iter().map(|v| v.statistics.clone()).collect(),
        diagnostics: rendered.into_iter().filter_map(|v| v.diagnostics).collect(),
    })
}

/// One view: means over samples `[C, P]`, and what was found beside.
struct View {
    mean: Tensor<2>,
    objects: usize,
    statistics: Statistics,
    diagnostics: Option<Diagnostics>,
}

impl View {
    fn new(renderer: &Renderer, mean: Tensor<2>, found: Found) -> Self {
        Self {
            mean,
            objects: renderer.objects(),
            statistics: Statistics::new(&found.census),
            diagnostics: found.diagnostics,
        }
    }

    /// The rows, with weights of so many objects if there are any.
    fn rows(&self, objects: usize, with_objects: bool) -> Tensor<2> {
        let mean = self.mean.clone();
        if !with_objects || objects == self.objects {
            return mean;
        }
        let [rows, pixels] = mean.dims();
        let more = [objects - self.objects, pixels];
        let none = Tensor::zeros(more, (&mean.device(), mean.dtype()));
        let background = mean.clone().slice([rows - 1..rows]);
        Tensor::cat(vec![mean.slice([0..rows - 1]), none, background], 0)
    }

    fn render(
        scene: &Scene,
        camera: &Camera,
        options: &RenderOptions,
        form: Softmax,
        pixels: Option<Arc<Vec<u32>>>,
    ) -> Result<Self> {
        let mut collected = Collect::default();
        visit_tensors(&mut scene.clone(), &mut camera.clone(), &mut collected);
        if collected.rows.is_empty() {
            let flattened = Flattened::new(scene, camera, options.bounds)?;
            let renderer = Renderer::new(&flattened, camera, (options, form), pixels, None)?;
            let (mean, found) = renderer.render()?;
            return Ok(Self::new(&renderer, mean, found));
        }
        // Forward without tape, backward on paths traced again.
        let (mut still, mut still_camera) = (scene.clone(), camera.clone());
        visit_tensors(&mut still, &mut still_camera, &mut Detach);
        let flattened = Flattened::new(&still, &still_camera, options.bounds)?;
        let parameters = Tensor::cat(collected.rows, 0);
        let retraced = Retraced {
            scene: scene.clone(),
            camera: camera.clone(),
            options: options.clone().bounds_or(flattened.bounds),
            form,
            pixels: pixels.clone(),
            parameters: plain(&parameters),
        };
        let renderer = Renderer::new(&flattened, &still_camera, (options, form), pixels, None)?;
        let (mean, found) = renderer.render()?;
        let hierarchy = renderer.sparse.as_ref().map(Sparse::hierarchy);
        let retrace = Retrace(Arc::new(move |upstream| {
            retraced.gradient(&upstream, &hierarchy)
        }));
        let mean = replay(parameters, mean, retrace);
        Ok(Self::new(&renderer, mean, found))
    }
}

pub(super) struct Renderer<'a> {
    pub(super) scene: &'a Flattened,
    camera: &'a Camera,
    pub(super) options: &'a RenderOptions,
    sampler: Sampler,
    lights: Arc<Lights>,
    sky: Option<Sky>,
    settings: PathSettings,
    sparse: Option<Sparse>,
    /// The pixels to render, where that is not all.
    pixels: Option<Arc<Vec<u32>>>,
}

/// What a render found beside its image.
struct Found {
    census: Census,
    diagnostics: Option<Diagnostics>,
}

/// Pixels `first..first + pixels` with samples `from..to`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tile {
    pub first: usize,
    pub pixels: usize,
    pub from: u32,
    pub to: u32,
}

/// Sums over the samples of a tile, one column a pixel `[C, P]`: radiance, and what was asked for.
pub(super) struct TileSums {
    pub sums: Tensor<2>,
    census: Census,
    diagnostics: Option<Diagnostics>,
}

impl<'a> Renderer<'a> {
    pub(super) fn new(
        scene: &'a Flattened,
        camera: &'a Camera,
        (options, form): (&'a RenderOptions, Softmax),
        pixels: Option<Arc<Vec<u32>>>,
        hierarchy: Option<Arc<Hierarchy>>,
    ) -> Result<Self> {
        // Diagnostics are there in tensors only, and GPUs do without the host.
        let dense = options.brute_force || options.diagnostics || !is_cpu(&scene.context.device);
        let sparse = match hierarchy {
            _ if dense => None,
            Some(hierarchy) => Some(Sparse::with(&scene.triangles, hierarchy, options.cutoff)),
            None => {
                let cache = options.cache.as_ref();
                Some(Sparse::new(&scene.triangles, options.cutoff, cache)?)
            }
        };
        Ok(Self {
            scene,
            camera,
            options,
            sampler: sampler(options),
            lights: Arc::new(Lights::new(scene, options.sampling.emitters)?),
            sky: Sky::new(scene)?,
            settings: settings(scene, options, form),
            sparse,
            pixels,
        })
    }

    /// Means over samples `[C, pixels]`.
    fn render(&self) -> Result<(Tensor<2>, Found)> {
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
        let results = if is_cpu(&self.scene.context.device) {
            tiles.par_iter().map(run).collect::<Result<Vec<_>>>()?
        } else {
            tiles.iter().map(run).collect::<Result<_>>()?
        };
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
        let found = Found {
            census,
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
        let rays = if self.sparse.is_some() {
            1 << 13
        } else {
            (pairs / triangles).clamp(128, 1 << 17)
        };
        let pixels = self.pixels.as_ref().map_or_else(
            || self.options.width * self.options.height,
            |pixels| pixels.len(),
        );
        tiles(self.options, pixels, rays)
    }

    pub(super) fn tile(&self, tile: &Tile) -> Result<TileSums> {
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
            sparse: self.sparse.as_ref(),
        };
        let found = trace(transport, rays, &paths, samples)?;
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
        let [x, y] = self.sampler.uniform(paths, 0, dimensions);
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

/// What a path does in a scene.
fn settings(scene: &Flattened, options: &RenderOptions, form: Softmax) -> PathSettings {
    PathSettings {
        softmax: Softmax {
            sigma: form.sigma / (scene.unit * scene.unit),
            ..form
        },
        diagnostics: options.diagnostics,
        bounces: options.bounces,
        roulette_after: options.roulette_after,
        sampling: options.sampling,
    }
}

/// The random numbers of a render.
pub(super) fn sampler(options: &RenderOptions) -> Sampler {
    Sampler::new(
        options.seed,
        options.sampling.sequence,
        options.width,
        options.samples,
    )
}

/// Pixels in pieces of about so many rays.
pub(super) fn tiles(options: &RenderOptions, pixels: usize, rays: usize) -> Vec<Tile> {
    let samples = options.samples as usize;
    let rays = options.rays_per_tile.unwrap_or(rays);
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
