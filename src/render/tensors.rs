//! Renders as chains of tensor operations, tile by tile: the softmax, and cones as the specification of
//! the kernels.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use burn::tensor::{Tensor, TensorData};
use rayon::prelude::*;

use super::batch::of_batch;
use super::film::{Means, Statistics};
use super::replay::{Retrace, Retraced, replay};
use super::{Batch, RenderOptions, is_cpu};
use crate::accel::Hierarchy;
use crate::error::Result;
use crate::geometry::plain;
use crate::model::filter::PixelFilter;
use crate::scene::{
    Camera, Collect, Detach, Flattened, HostScene, Normalization, Scene, SceneFrame, visit_tensors,
};
use crate::transport::{
    Census, Cones, Diagnostics, Dimension, Lights, PathSettings, Sampler, Sight, Sky, Transport,
    trace,
};
use crate::visibility::{Rays, Softmax, Sparse, Visibility, hierarchy_of};

/// Renders the views of a batch one after another.
pub(super) fn render(
    batch: &Batch,
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
) -> Result<Means> {
    let mut rendered = Vec::with_capacity(batch.views.len());
    for (index, (scene, camera)) in batch.views.iter().enumerate() {
        let scene = batch.scene(*scene, true);
        let view = View::render(&scene, camera, &options.of_view(index), pixels.clone());
        rendered.push(view.map_err(of_batch("view", index))?);
    }
    let objects = rendered.iter().map(|v| v.objects).max().unwrap_or(0);
    let rows = rendered.iter().map(|v| {
        let rows = v.rows(objects, options.outputs.object_ids);
        rows.swap_dims(0, 1)
    });
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
        pixels: Option<Arc<Vec<u32>>>,
    ) -> Result<Self> {
        let mut collected = Collect::default();
        visit_tensors(&mut scene.clone(), &mut camera.clone(), &mut collected);
        let (mut still, mut still_camera) = (scene.clone(), camera.clone());
        visit_tensors(&mut still, &mut still_camera, &mut Detach);
        let hard = matches!(options.visibility, Visibility::Cone { .. });
        let mut within = options.normalization();
        if hard {
            // As the kernels have it.
            let frame = SceneFrame::new(&HostScene::new(&still)?);
            within = Some(Normalization {
                center: frame.centre.into(),
                radius: frame.unit,
            });
        }
        let flattened = Flattened::of_scene(&still, within, None)?.seen_by(&still_camera)?;
        let renderer = Renderer::new(&flattened, &still_camera, options, pixels.clone(), None)?;
        let (mean, found) = renderer.render()?;
        if collected.rows.is_empty() {
            return Ok(Self::new(&renderer, mean, found));
        }
        // Forward without tape, backward on paths traced again.
        let parameters = Tensor::cat(collected.rows, 0);
        let retraced = Retraced {
            scene: scene.clone(),
            camera: camera.clone(),
            options: options.clone(),
            normalization: flattened.normalization,
            pixels,
            parameters: plain(&parameters),
        };
        let hierarchy = renderer.sight.hierarchy();
        let retrace = Retrace(Arc::new(move |upstream| {
            let gradient = retraced.gradient(&upstream, &hierarchy);
            if hard {
                // Kernels have the channels of a pixel side by side.
                let upstream = transposed(&upstream);
                retraced.with_jumps(gradient, &upstream)
            } else {
                gradient
            }
        }));
        let mean = replay(parameters, mean, retrace);
        Ok(Self::new(&renderer, mean, found))
    }
}

/// A matrix `[C, P]` as `[P, C]`.
fn transposed(data: &TensorData) -> TensorData {
    let (rows, columns) = (data.shape()[0], data.shape()[1]);
    let values: Vec<f64> = data.iter::<f64>().collect();
    let of_column = |p: usize| (0..rows).map(move |c| (c, p));
    let all = (0..columns).flat_map(of_column);
    let values: Vec<f64> = all.map(|(c, p)| values[c * columns + p]).collect();
    TensorData::new(values, [columns, rows])
}

/// What rays see, with what it needs of a scene.
enum HostSight {
    Cones(Cones, PixelFilter),
    Softmax(Softmax, Option<Box<Sparse>>),
}

impl HostSight {
    fn new(
        scene: &Flattened,
        camera: &Camera,
        options: &RenderOptions,
        hierarchy: Option<Arc<Hierarchy>>,
    ) -> Result<Self> {
        let hierarchy = || match hierarchy {
            Some(hierarchy) => Ok(hierarchy),
            None => hierarchy_of(&scene.triangles, options.cache.as_ref()),
        };
        Ok(match options.visibility {
            Visibility::Cone { angle, pixels } => {
                let half_height = camera.half_height()?;
                let least = options.blur.map_or(0.0, f64::tan);
                let wide = least * 0.5 * options.height as f64 / half_height;
                let cones = Cones::new(hierarchy()?, angle, &sampler(options));
                Self::Cones(cones, PixelFilter::new(pixels.max(wide)))
            }
            Visibility::Softmax {
                sigma,
                gamma,
                epsilon,
            } => {
                let form = Softmax {
                    sigma: sigma / (scene.unit * scene.unit),
                    gamma,
                    epsilon,
                };
                // Diagnostics are there in tensors only, and GPUs do without the host.
                let dense =
                    options.brute_force || options.diagnostics || !is_cpu(&scene.context.device);
                let sparse = if dense {
                    None
                } else {
                    let sparse = Sparse::new(&scene.triangles, hierarchy()?, options.cutoff);
                    Some(Box::new(sparse))
                };
                Self::Softmax(form, sparse)
            }
        })
    }

    /// The boxes, if there are any.
    fn hierarchy(&self) -> Option<Arc<Hierarchy>> {
        match self {
            Self::Cones(cones, _) => Some(cones.hierarchy()),
            Self::Softmax(_, sparse) => sparse.as_ref().map(|s| s.hierarchy()),
        }
    }

    fn get(&self) -> Sight<'_> {
        match self {
            Self::Cones(cones, _) => Sight::Cones(cones),
            Self::Softmax(form, sparse) => Sight::Softmax(*form, sparse.as_deref()),
        }
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
    sight: HostSight,
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
            sight: self.sight.get(),
        };
        let found = trace(transport, rays, &paths, samples)?;
        let census = found.census.clone();
        let diagnostics = found.diagnostics.clone();
        let rows = Tensor::cat(self.outputs(found)?, 0);
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

/// What a path does.
fn settings(options: &RenderOptions) -> PathSettings {
    PathSettings {
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
