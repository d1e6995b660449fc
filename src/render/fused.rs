//! Renders by fused kernels: one node of the graph, from a table of what the scene is made of to the
//! image. The backward pass traces the paths again; memory does not grow with them.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use burn::tensor::TensorData;
use glam::DVec3;
use rayon::prelude::*;

use super::replay::{Retrace, replay};
use super::{Found, Image, RenderOptions, Renderer, Tile, is_cpu, tiles, with_gradient};
use crate::error::Result;
use crate::scene::{Camera, Flattened, Scene};
use crate::transport::{Census, Fused, FusedParts, Pixel, TileLog, Work};

/// Camera rays of a tile.
const RAYS: usize = 1 << 13;

/// Numbers in the sums of derivatives of all lanes together.
const LANE_NUMBERS: usize = 1 << 24;

/// What the logs of all tiles may take: about 25 bytes a path of three surfaces on simple scenes. Tiles
/// past it look for what their rays meet again in the backward pass.
const LOG_BYTES: usize = 1 << 26;

/// Whether fused kernels know all that is asked for.
pub(super) fn can_render(scene: &Flattened, options: &RenderOptions) -> bool {
    let tensors = options.brute_force || options.diagnostics || !options.fused;
    is_cpu(&scene.context.device) && !tensors
}

/// Renders pixels (all, if there is no list).
pub(super) fn render(
    scene: &Scene,
    camera: &Camera,
    flattened: &Flattened,
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
) -> Result<Image> {
    let mut renderer = Renderer::new(flattened, camera, options, pixels.clone(), None)?;
    let sparse = renderer.sparse.as_ref();
    let sparse = sparse.expect("CPUs look for candidates, and fused kernels run there alone");
    let parts = FusedParts {
        hierarchy: sparse.hierarchy(),
        lights: renderer.lights.clone(),
        sky: renderer.sky.take(),
        sampler: renderer.sampler,
        settings: renderer.settings,
        size: [options.width, options.height],
        cutoff: sparse.cutoff(),
    };
    let mut fused = Fused::new(flattened, camera, parts)?;
    let parent = fused.take_parent();
    let fused = Arc::new(fused);
    let pixels = pixels.unwrap_or_else(|| {
        let count = (options.width * options.height) as u32;
        Arc::new((0..count).collect())
    });
    let tiles = tiles(options, pixels.len(), RAYS);
    let done = AtomicUsize::new(0);
    let rows = Rows {
        opacity: options.outputs.opacity || options.outputs.depth || options.outputs.normals,
        depth: options.outputs.depth,
        normals: options.outputs.normals,
        objects: options.outputs.object_ids.then(|| renderer.objects()),
        unit: flattened.unit,
    };
    let logged = AtomicUsize::new(0);
    let of_tile = |tile: &Tile| {
        let pixels = &pixels[tile.first..tile.first + tile.pixels];
        let log = parent.is_some() && logged.load(Ordering::Relaxed) < LOG_BYTES;
        let mut found = fused.render(pixels, (tile.from, tile.to), rows.objects, log);
        let size = found.log.as_ref().map_or(0, TileLog::size);
        if size > 0 && logged.fetch_add(size, Ordering::Relaxed) + size > LOG_BYTES {
            found.log = None;
        }
        let n = done.fetch_add(1, Ordering::Relaxed) + 1;
        if let Some(progress) = &options.progress {
            progress(n, tiles.len());
        }
        found
    };
    let found: Vec<_> = tiles.par_iter().map(of_tile).collect();
    let per_sample = f64::from(options.samples).recip();
    let count = pixels.len();
    let mut planes = vec![0.0; rows.count() * count];
    let mut census = Census::default();
    let mut logs = Vec::with_capacity(tiles.len());
    for (tile, of_tile) in tiles.iter().zip(found) {
        let sums = of_tile.sums;
        census.merge(&of_tile.census);
        logs.push(of_tile.log.map(Arc::new));
        let mut weights = of_tile.objects.chunks(rows.objects.map_or(1, |n| n + 1));
        for (i, sum) in sums.iter().enumerate() {
            let weights = weights.next().unwrap_or_default();
            for (row, value) in rows.of(sum).chain(weights.iter().copied()).enumerate() {
                planes[row * count + tile.first + i] += value * per_sample;
            }
        }
    }
    let mean = flattened.context.tensor(&planes, [rows.count(), count]);
    let mean = match parent {
        Some(parent) => {
            let retrace = Retrace(Arc::new(move |upstream| {
                gradient(&fused, &pixels, &tiles, &logs, &rows, per_sample, &upstream)
            }));
            replay(parent, mean, retrace)
        }
        None => mean,
    };
    let mean = with_gradient(mean, scene, camera);
    let found = Found {
        census,
        diagnostics: None,
    };
    Ok(renderer.image(mean, &found))
}

/// The rows of an image, in the order of [`Renderer::outputs`].
#[derive(Clone, Copy, Debug)]
struct Rows {
    opacity: bool,
    depth: bool,
    normals: bool,
    /// How many objects, if their weights are asked for.
    objects: Option<usize>,
    /// The length of depths, in scene units.
    unit: f64,
}

impl Rows {
    fn count(&self) -> usize {
        let normals = if self.normals { 3 } else { 0 };
        let objects = self.objects.map_or(0, |n| n + 1);
        3 + usize::from(self.opacity) + usize::from(self.depth) + normals + objects
    }

    /// All but the weights of objects.
    fn of(&self, p: &Pixel) -> impl Iterator<Item = f64> {
        let opacity = self.opacity.then_some(p.opacity);
        let depth = self.depth.then_some(p.depth * self.unit);
        let normal = self.normals.then_some(p.normal.to_array());
        let radiance = p.radiance.to_array().into_iter();
        let rows = radiance.chain(opacity).chain(depth);
        rows.chain(normal.into_iter().flatten())
    }

    /// From rows of derivatives by the rows.
    fn pixel(&self, row: impl Fn(usize) -> f64) -> Pixel {
        let mut next = 3;
        let mut take = |wanted: bool| {
            if !wanted {
                return 0.0;
            }
            next += 1;
            row(next - 1)
        };
        Pixel {
            radiance: DVec3::new(row(0), row(1), row(2)),
            opacity: take(self.opacity),
            depth: take(self.depth) * self.unit,
            normal: DVec3::new(take(self.normals), take(self.normals), take(self.normals)),
        }
    }
}

/// The gradient of the table from that of the rows `[C, pixels]`.
fn gradient(
    fused: &Fused,
    pixels: &[u32],
    tiles: &[Tile],
    logs: &[Option<Arc<TileLog>>],
    rows: &Rows,
    per_sample: f64,
    upstream: &TensorData,
) -> TensorData {
    let count = pixels.len();
    let values: Vec<f64> = upstream.iter::<f64>().collect();
    let upstream_of = |i: usize| rows.pixel(|row| values[row * count + i] * per_sample);
    // Tiles in lanes that have their sums to themselves: as many whatever the machine, so that sums
    // come out the same.
    let lanes = (LANE_NUMBERS / fused.tables().size()).clamp(4, 64);
    let per_lane = tiles.len().div_ceil(lanes).max(1);
    let of_lane = |(lane, logs): (&[Tile], &[Option<Arc<TileLog>>])| {
        let mut sums = fused.tables().sums();
        let mut work = Work::new(fused.bounces());
        for (tile, log) in lane.iter().zip(logs) {
            let of_tile =
                (tile.first..tile.first + tile.pixels).map(|i| (pixels[i], upstream_of(i)));
            let of_tile: Vec<_> = of_tile.collect();
            let samples = (tile.from, tile.to);
            fused.pull(&of_tile, samples, log.clone(), &mut work, &mut sums);
        }
        sums
    };
    let sums: Vec<_> = tiles
        .par_chunks(per_lane)
        .zip(logs.par_chunks(per_lane))
        .map(of_lane)
        .collect();
    let mut all = fused.tables().sums();
    sums.iter().for_each(|s| all.add(s));
    let gradient = fused.resolve(all);
    let length = gradient.len();
    TensorData::new(gradient, [length]).convert_dtype(upstream.dtype())
}
