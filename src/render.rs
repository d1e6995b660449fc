//! `render()`: passes, tiles, averaging.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use burn::tensor::{Int, Tensor};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::geometry::{Context, Vec3, host_values};
use crate::scene::{Bounds, Camera, Flattened, Scene};
use crate::transport::{Dimension, PathSettings, Radiance, Sampler, trace};
use crate::visibility::{Rays, Softmax};

/// Called after each tile with the number of tiles done and of all tiles.
pub type Progress = Arc<dyn Fn(usize, usize) + Send + Sync>;

/// How to render.
#[derive(Clone)]
pub struct RenderOptions {
    width: usize,
    height: usize,
    samples: u32,
    bounces: u32,
    sigma: f64,
    gamma: f64,
    epsilon: f64,
    seed: u64,
    roulette_after: Option<u32>,
    rays_per_tile: Option<usize>,
    bounds: Option<Bounds>,
    outputs: Outputs,
    progress: Option<Progress>,
}

/// What to return beside radiance.
#[derive(Clone, Copy, Debug, Default)]
struct Outputs {
    opacity: bool,
    depth: bool,
    normals: bool,
    object_ids: bool,
}

impl fmt::Debug for RenderOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RenderOptions")
            .field("width", &self.width)
            .field("height", &self.height)
            .field("samples", &self.samples)
            .field("bounces", &self.bounces)
            .field("sigma", &self.sigma)
            .field("gamma", &self.gamma)
            .field("epsilon", &self.epsilon)
            .field("seed", &self.seed)
            .field("roulette_after", &self.roulette_after)
            .field("rays_per_tile", &self.rays_per_tile)
            .field("bounds", &self.bounds)
            .field("outputs", &self.outputs)
            .finish_non_exhaustive()
    }
}

impl RenderOptions {
    /// An image of width × height pixels: 16 samples, 3 bounces, σ = 1e-4, γ = 1e-3, seed 0.
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            samples: 16,
            bounces: 3,
            sigma: 1e-4,
            gamma: 1e-3,
            epsilon: 1e-3,
            seed: 0,
            roulette_after: None,
            rays_per_tile: None,
            bounds: None,
            outputs: Outputs::default(),
            progress: None,
        }
    }

    /// Paths a pixel.
    pub fn samples(mut self, samples: u32) -> Self {
        self.samples = samples;
        self
    }

    /// Bounces after the surface that the camera sees; 0 is direct light only.
    pub fn bounces(mut self, bounces: u32) -> Self {
        self.bounces = bounces;
        self
    }

    /// σ of Eq. 1 in scene units squared, and γ of Eq. 3 in units of the scene's depth.
    pub fn blur(mut self, sigma: f64, gamma: f64) -> Self {
        self.sigma = sigma;
        self.gamma = gamma;
        self
    }

    /// ε of Eq. 3, the score of the background.
    pub fn epsilon(mut self, epsilon: f64) -> Self {
        self.epsilon = epsilon;
        self
    }

    /// Same seed, same image.
    pub fn seed(mut self, seed: u64) -> Self {
        self.seed = seed;
        self
    }

    /// Ends paths at random, in proportion to their throughput, after the given bounce and every
    /// later one (0: after the surface that the camera sees).
    pub fn russian_roulette(mut self, after: u32) -> Self {
        self.roulette_after = Some(after);
        self
    }

    /// The most rays processed at once. Bounds the memory of a render without gradient; by
    /// default chosen from the number of triangles.
    pub fn rays_per_tile(mut self, rays: usize) -> Self {
        self.rays_per_tile = Some(rays);
        self
    }

    /// Fixes the bounds that set the scale of depths and tolerances. Finite differences need the
    /// same bounds on both sides.
    pub fn bounds(mut self, bounds: Bounds) -> Self {
        self.bounds = Some(bounds);
        self
    }

    /// Also returns the opacity.
    pub fn with_opacity(mut self) -> Self {
        self.outputs.opacity = true;
        self
    }

    /// Also returns the depth.
    pub fn with_depth(mut self) -> Self {
        self.outputs.depth = true;
        self
    }

    /// Also returns normals.
    pub fn with_normals(mut self) -> Self {
        self.outputs.normals = true;
        self
    }

    /// Also returns object ids.
    pub fn with_object_ids(mut self) -> Self {
        self.outputs.object_ids = true;
        self
    }

    /// Calls a function after each tile.
    pub fn progress(mut self, progress: Progress) -> Self {
        self.progress = Some(progress);
        self
    }

    fn check(&self) -> Result<()> {
        let options = "options";
        for (field, value) in [
            ("width", self.width),
            ("height", self.height),
            ("samples", self.samples as usize),
            ("rays_per_tile", self.rays_per_tile.unwrap_or(1)),
        ] {
            if value == 0 {
                return Err(Error::invalid(options, field, value, "at least 1"));
            }
        }
        if self.width.saturating_mul(self.height) > u32::MAX as usize {
            let size = format!("{} × {}", self.width, self.height);
            return Err(Error::invalid(
                options,
                "width × height",
                size,
                "at most 2³² − 1 pixels",
            ));
        }
        for (field, value) in [("sigma", self.sigma), ("gamma", self.gamma)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(Error::invalid(options, field, value, "a finite number > 0"));
            }
        }
        if !self.epsilon.is_finite() {
            return Err(Error::invalid(
                options,
                "epsilon",
                self.epsilon,
                "a finite number",
            ));
        }
        if let Some(b) = self.bounds
            && !(b.radius.is_finite() && b.radius > 0.0 && b.center.iter().all(|c| c.is_finite()))
        {
            return Err(Error::invalid(
                options,
                "bounds",
                format!("{b:?}"),
                "a finite centre and a radius > 0",
            ));
        }
        Ok(())
    }
}

/// What a render cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Camera, bounce and shadow rays.
    pub rays: u64,
}

/// A rendered image; tensors are in the graph where gradients can flow.
#[derive(Clone, Debug)]
pub struct Image {
    /// Linear RGB radiance `[H, W, 3]`, row 0 at the top.
    pub radiance: Tensor<3>,
    /// 1 − W_background of the camera rays `[H, W]`, on request.
    pub opacity: Option<Tensor<2>>,
    /// Expected distance along the camera rays to what they see `[H, W]`, scene units; 0 where
    /// they see nothing. On request.
    pub depth: Option<Tensor<2>>,
    /// Expected geometric normal, facing the camera, of what the camera rays see `[H, W, 3]`; 0
    /// where they see nothing. On request.
    pub normals: Option<Tensor<3>>,
    /// The object with the most weight in each pixel `[H, W]`, −1 for the background. On request;
    /// not differentiable.
    pub object_ids: Option<Tensor<2, Int>>,
    /// What it cost.
    pub statistics: Statistics,
}

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
    let renderer = Renderer {
        scene: &flattened,
        camera,
        options,
        sampler: Sampler::new(options.seed),
        settings: PathSettings {
            sigma: options.sigma,
            softmax: Softmax {
                gamma: options.gamma,
                epsilon: options.epsilon,
            },
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
    rays: u64,
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
        if results[0].sums.is_tracked() || !is_cpu(&self.scene.context) {
            for tile in &tiles[1..] {
                results.push(run(tile)?);
            }
        } else {
            results.extend(tiles[1..].par_iter().map(run).collect::<Result<Vec<_>>>()?);
        }
        let rays = results.iter().map(|r| r.rays).sum();

        // Tiles come in order of pixels, then samples.
        let mut columns: Vec<Tensor<2>> = Vec::new();
        for (tile, result) in tiles.iter().zip(results) {
            if tile.from == 0 {
                columns.push(result.sums);
            } else if let Some(sum) = columns.pop() {
                columns.push(sum + result.sums);
            }
        }
        let mean = Tensor::cat(columns, 1) / f64::from(self.options.samples);
        Ok(self.image(mean, rays))
    }

    fn tiles(&self) -> Vec<Tile> {
        let triangles = self.scene.triangles.len();
        let pixels = self.options.width * self.options.height;
        let samples = self.options.samples as usize;
        let pairs = if is_cpu(&self.scene.context) {
            1 << 18
        } else {
            1 << 23
        };
        let rays = self
            .options
            .rays_per_tile
            .unwrap_or((pairs / triangles).clamp(128, 1 << 17));
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
            rays,
            &paths,
            samples,
        )?;
        let traced = found.rays;
        let rows = Tensor::cat(self.outputs(found), 0);
        let channels = rows.dims()[0];
        let sums = rows
            .reshape([channels * tile.pixels, samples])
            .sum_dim(1)
            .reshape([channels, tile.pixels]);
        Ok(TileSums { sums, rays: traced })
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

    /// Rows `[_, N]`: radiance, opacity, depth, normal, weight of each object.
    fn outputs(&self, found: Radiance) -> Vec<Tensor<2>> {
        let outputs = self.options.outputs;
        let Vec3 { x, y, z } = found.radiance;
        let mut rows = vec![x, y, z];
        let first = found.first;
        if outputs.opacity || outputs.depth || outputs.normals {
            rows.push(first.attached_background().neg() + 1.0);
        }
        if outputs.depth {
            rows.push(first.mean(first.attached_distances(), None));
        }
        if outputs.normals {
            let normal = &self.scene.triangles.normal;
            let front = first.cosine().clone().lower_elem(0.0);
            let side = front.float().cast(self.scene.context.dtype) * 2.0 - 1.0;
            for axis in [&normal.x, &normal.y, &normal.z] {
                rows.push(first.mean(side.clone() * axis.clone(), None));
            }
        }
        if outputs.object_ids {
            let object = &self.scene.topology.object;
            let objects = self.objects();
            let triangles = object.len();
            for id in 0..objects as u32 {
                let member: Vec<f64> = object
                    .iter()
                    .map(|&o| if o == id { 1.0 } else { 0.0 })
                    .collect();
                let member = self.scene.context.tensor(&member, [triangles, 1]);
                rows.push((first.surfaces.clone() * member).sum_dim(0));
            }
            rows.push(first.background);
        }
        rows
    }

    fn objects(&self) -> usize {
        self.scene
            .topology
            .object
            .last()
            .map_or(0, |&o| o as usize + 1)
    }

    /// The image from means `[C, H·W]` of the rows of `outputs`.
    fn image(&self, mean: Tensor<2>, rays: u64) -> Image {
        let (width, height) = (self.options.width, self.options.height);
        let outputs = self.options.outputs;
        let mut next = 0;
        let mut take = |channels: usize| {
            let rows = mean.clone().slice([next..next + channels]);
            next += channels;
            rows
        };
        let plane = |t: Tensor<2>| t.reshape([height, width]);
        let colour = |t: Tensor<2>| t.transpose().reshape([height, width, 3]);
        let radiance = colour(take(3));
        let opacity = (outputs.opacity || outputs.depth || outputs.normals).then(|| take(1));
        let seen = opacity.as_ref().map(|o| {
            let nothing = crate::geometry::plain(o).lower_elem(1e-12);
            (o.clone().mask_fill(nothing.clone(), 1.0), nothing)
        });
        let per_opacity = |t: Tensor<2>| match &seen {
            Some((opacity, nothing)) => {
                let shape = t.dims();
                (t / opacity.clone()).mask_fill(nothing.clone().expand(shape), 0.0)
            }
            None => t,
        };
        let depth = outputs.depth.then(|| plane(per_opacity(take(1))));
        let normals = outputs.normals.then(|| colour(per_opacity(take(3))));
        let object_ids = outputs.object_ids.then(|| {
            let objects = self.objects();
            let index = take(objects + 1).inner().argmax(0);
            let background = index.clone().equal_elem(objects as i64);
            index.mask_fill(background, -1).reshape([height, width])
        });
        Image {
            radiance,
            opacity: if outputs.opacity {
                opacity.map(plane)
            } else {
                None
            },
            depth,
            normals,
            object_ids,
            statistics: Statistics { rays },
        }
    }
}

impl Image {
    /// The mean radiance of each channel, on the host.
    ///
    /// # Errors
    /// If the tensor can't be read back.
    pub fn mean(&self) -> Result<[f64; 3]> {
        let values = host_values(&self.radiance)?;
        let n = (values.len() / 3) as f64;
        Ok(std::array::from_fn(|c| {
            values.iter().skip(c).step_by(3).sum::<f64>() / n
        }))
    }
}

/// Whether tiles of rays gain from several host threads.
fn is_cpu(context: &Context) -> bool {
    let name = format!("{:?}", context.device);
    name.contains("Flex") || name.contains("NdArray")
}
