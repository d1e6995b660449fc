//! Renders by fused kernels: all views of a batch are one node of the graph, from tables of what the
//! scenes are made of to the images. The backward pass traces the paths again; memory does not grow
//! with them.

mod prepare;
mod rows;

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use burn::tensor::{DType, TensorData};
use rayon::prelude::*;

use super::film::{Means, Statistics};
use super::replay::{Retrace, replay};
use super::tensors::{Tile, tiles};
use super::{Batch, RenderOptions, is_cpu};
use crate::error::Result;
use crate::transport::{Census, Gradient, TileLog, Work};
use prepare::{Prepared, View, prepare};
use rows::Rows;

/// Camera rays of a tile.
const RAYS: usize = 1 << 13;

/// Numbers in the sums of derivatives of all lanes together.
const LANE_NUMBERS: usize = 1 << 24;

/// What the logs of all tiles may take: about 25 bytes a path of three surfaces on simple scenes. Tiles
/// past it look for what their rays meet again in the backward pass.
const LOG_BYTES: usize = 1 << 26;

/// Views whose derivatives are held at once.
const VIEWS_AT_ONCE: usize = 16;

/// Whether fused kernels know all that is asked for.
pub(super) fn can_render(batch: &Batch, options: &RenderOptions) -> bool {
    let tensors = options.brute_force || options.diagnostics || !options.fused;
    let mut vertices = batch.scenes.iter().flat_map(|s| &s.objects).take(1);
    vertices.all(|o| is_cpu(&o.mesh.vertices.device())) && !tensors
}

/// Renders pixels of all views (all pixels, if there is no list).
pub(super) fn render(
    batch: &Batch,
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
) -> Result<Means> {
    let Prepared {
        views,
        parent,
        parent_size,
        context,
    } = prepare(batch, options)?;
    let pixels = pixels.unwrap_or_else(|| {
        let count = (options.width * options.height) as u32;
        Arc::new((0..count).collect())
    });
    let objects = views.iter().map(|v| v.objects).max().unwrap_or(0);
    let rows = Rows::new(options, objects);
    let tiles = tiles(options, pixels.len(), RAYS);
    let count = pixels.len();
    let of_view = rows.count() * count;
    let mut planes = vec![0.0; views.len() * of_view];
    let (done, logged) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let pass = Forward {
        options,
        pixels: &pixels,
        tiles: &tiles,
        rows: &rows,
        all: tiles.len() * views.len(),
        log: parent.is_some(),
        done: &done,
        logged: &logged,
    };
    let found: Vec<(Census, Logs)> = planes
        .par_chunks_mut(of_view)
        .zip(&views)
        .map(|(planes, view)| pass.view(view, planes))
        .collect();
    let (statistics, logs): (Vec<_>, Vec<_>) = found
        .into_iter()
        .map(|(census, logs)| (Statistics::new(&census, 0), logs))
        .unzip();
    let mean = context.tensor(&planes, [views.len() * rows.count(), count]);
    let mean = match parent {
        Some(parent) => {
            let dtype = context.dtype;
            let backward = Backward {
                views,
                logs,
                pixels,
                tiles,
                rows,
                per_sample: f64::from(options.samples).recip(),
                size: parent_size,
            };
            let retrace = Retrace(Arc::new(move |upstream| {
                backward.gradient(&upstream, dtype)
            }));
            replay(parent, mean, retrace)
        }
        None => mean,
    };
    Ok(Means {
        mean: mean.reshape([statistics.len(), rows.count(), count]),
        objects,
        statistics,
        diagnostics: Vec::new(),
    })
}

/// What the rays of each tile of a view met, where it was kept.
type Logs = Vec<Option<Arc<TileLog>>>;

/// What the views of a forward pass have in common.
struct Forward<'a> {
    options: &'a RenderOptions,
    pixels: &'a [u32],
    tiles: &'a [Tile],
    rows: &'a Rows,
    /// Tiles of all views.
    all: usize,
    /// Whether to keep what rays met.
    log: bool,
    done: &'a AtomicUsize,
    logged: &'a AtomicUsize,
}

impl Forward<'_> {
    /// Fills the planes of a view `[C, P]`.
    fn view(&self, view: &View, planes: &mut [f64]) -> (Census, Logs) {
        let of_tile = |tile: &Tile| {
            let pixels = &self.pixels[tile.first..tile.first + tile.pixels];
            let log = self.log && self.logged.load(Ordering::Relaxed) < LOG_BYTES;
            let samples = (tile.from, tile.to);
            let mut found = view.fused.render(pixels, samples, self.rows.objects, log);
            let size = found.log.as_ref().map_or(0, TileLog::size);
            if size > 0 && self.logged.fetch_add(size, Ordering::Relaxed) + size > LOG_BYTES {
                found.log = None;
            }
            let n = self.done.fetch_add(1, Ordering::Relaxed) + 1;
            if let Some(progress) = &self.options.progress {
                progress(n, self.all);
            }
            found
        };
        let found: Vec<_> = self.tiles.par_iter().map(of_tile).collect();
        let per_sample = f64::from(self.options.samples).recip();
        let count = self.pixels.len();
        let mut census = Census::default();
        let mut logs = Vec::with_capacity(self.tiles.len());
        for (tile, of_tile) in self.tiles.iter().zip(found) {
            census.merge(&of_tile.census);
            logs.push(of_tile.log.map(Arc::new));
            let width = self.rows.objects.map_or(1, |n| n + 1);
            let mut weights = of_tile.objects.chunks(width);
            for (i, sum) in of_tile.sums.iter().enumerate() {
                let weights = weights.next().unwrap_or_default();
                let values = self.rows.of(sum, view.unit).chain(weights.iter().copied());
                for (row, value) in values.enumerate() {
                    planes[row * count + tile.first + i] += value * per_sample;
                }
            }
        }
        (census, logs)
    }
}

/// What the backward pass needs.
struct Backward {
    views: Vec<View>,
    logs: Vec<Logs>,
    pixels: Arc<Vec<u32>>,
    tiles: Vec<Tile>,
    rows: Rows,
    per_sample: f64,
    /// Numbers of the parent.
    size: usize,
}

impl Backward {
    /// The gradient of the parent from that of the rows of all views `[B·C, P]`.
    fn gradient(&self, upstream: &TensorData, dtype: DType) -> TensorData {
        let upstream: Vec<f64> = upstream.iter::<f64>().collect();
        let of_view = self.rows.count() * self.pixels.len();
        let mut all = vec![0.0; self.size];
        let views: Vec<_> = self.views.iter().zip(&self.logs).collect();
        let pieces = views.chunks(VIEWS_AT_ONCE);
        for (views, upstream) in pieces.zip(upstream.chunks(VIEWS_AT_ONCE * of_view)) {
            let gradients: Vec<Gradient> = views
                .par_iter()
                .zip(upstream.par_chunks(of_view))
                .map(|((view, logs), upstream)| self.of_view(view, logs, upstream))
                .collect();
            for ((view, _), gradient) in views.iter().zip(&gradients) {
                view.places.add(gradient, &mut all);
            }
        }
        TensorData::new(all, [self.size]).convert_dtype(dtype)
    }

    fn of_view(&self, view: &View, logs: &Logs, upstream: &[f64]) -> Gradient {
        let fused = &view.fused;
        let count = self.pixels.len();
        let upstream_of = |i: usize| {
            let row = |row: usize| upstream[row * count + i] * self.per_sample;
            self.rows.pixel(row, view.unit)
        };
        // Tiles in lanes that have their sums to themselves: as many whatever the machine, so that sums
        // come out the same.
        let lanes = (LANE_NUMBERS / fused.size()).clamp(4, 64);
        let per_lane = self.tiles.len().div_ceil(lanes).max(1);
        let of_lane = |(lane, logs): (&[Tile], &[Option<Arc<TileLog>>])| {
            let mut sums = fused.sums();
            let mut work = Work::new(fused.bounces());
            for (tile, log) in lane.iter().zip(logs) {
                let of_tile = (tile.first..tile.first + tile.pixels)
                    .map(|i| (self.pixels[i], upstream_of(i)));
                let of_tile: Vec<_> = of_tile.collect();
                let samples = (tile.from, tile.to);
                fused.pull(&of_tile, samples, log.clone(), &mut work, &mut sums);
            }
            sums
        };
        let sums: Vec<_> = self
            .tiles
            .par_chunks(per_lane)
            .zip(logs.par_chunks(per_lane))
            .map(of_lane)
            .collect();
        let mut all = fused.sums();
        sums.iter().for_each(|s| all.add(s));
        fused.resolve(all)
    }
}
