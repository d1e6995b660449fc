//! The backward pass: paths are traced again, and derivatives add up in the parent's gradient.

use std::sync::Arc;

use burn::tensor::TensorData;
use rayon::prelude::*;

use super::forward::camera_tiles;
use super::prepare::Places;
use super::rows::Rows;
use crate::kernel::{PixelGradients, Seen, Sums, View, Work};
use crate::render::options::{RenderOptions, Tile};

/// Numbers in the sums of derivatives of all accumulators together.
const ACCUMULATED: usize = 1 << 24;

/// Views whose derivatives are held at once.
const VIEWS_AT_ONCE: usize = 16;

/// Samples of edges on the film for each path of the image.
const FILM_SAMPLES: f64 = 0.125;

/// So many samples of edges on the film take no time.
const FEW: f64 = 1024.0;

/// The views of a batch on a GPU.
#[cfg(feature = "wgpu")]
pub(super) struct Gpu {
    pub device: burn::tensor::Device,
    pub jobs: Vec<crate::gpu::Job>,
}

/// Without GPUs there are none.
#[cfg(not(feature = "wgpu"))]
pub(super) enum Gpu {}

/// The backward pass of a batch.
pub(super) struct Backward {
    /// Where paths go back on a GPU.
    gpu: Option<Gpu>,
    views: Vec<(View, Places)>,
    pixels: Arc<Vec<u32>>,
    tiles: Vec<Tile>,
    rows: Rows,
    samples: u32,
    /// Numbers of the parent.
    size: usize,
}

impl Backward {
    /// For pixels of a list, or all; `size` is that of the parent.
    pub fn new(
        views: Vec<(View, Places)>,
        size: usize,
        rows: Rows,
        options: &RenderOptions,
        pixels: Option<Arc<Vec<u32>>>,
    ) -> Self {
        let all = || Arc::new((0..(options.width * options.height) as u32).collect());
        let pixels = pixels.unwrap_or_else(all);
        Self {
            gpu: None,
            views,
            tiles: camera_tiles(options, pixels.len()),
            pixels,
            rows,
            samples: options.samples,
            size,
        }
    }

    /// The same where the image came from a GPU.
    pub fn on(mut self, gpu: Option<Gpu>) -> Self {
        for (view, _) in &mut self.views {
            view.settings.interior &= gpu.is_none();
        }
        self.gpu = gpu;
        self
    }

    /// The sums of derivatives along a view's paths from a GPU, if they are computed there.
    fn on_gpu(&self, index: usize, upstream: &[f64]) -> Option<Sums> {
        #[cfg(feature = "wgpu")]
        if let Some(gpu) = &self.gpu {
            let upstream: Vec<f32> = upstream.iter().map(|&g| g as f32).collect();
            let (view, _) = &self.views[index];
            return Some(crate::gpu::sums_of(
                &gpu.device,
                view,
                &gpu.jobs[index],
                &upstream,
            ));
        }
        let _ = (index, upstream, &self.gpu);
        None
    }

    /// Whether jumps come from a GPU.
    fn jumps_on_gpu(&self, view: &View) -> bool {
        #[cfg(feature = "wgpu")]
        return self.gpu.is_some() && crate::gpu::adds_jumps(view);
        #[cfg(not(feature = "wgpu"))]
        {
            let _ = view;
            false
        }
    }

    /// The gradient of the parent from that of the rows of all views `[B·P, C]`.
    pub fn gradient(&self, upstream: &TensorData) -> Vec<f64> {
        let upstream: Vec<f64> = upstream.iter::<f64>().collect();
        let of_view = self.rows.count() * self.pixels.len();
        let mut all = vec![0.0; self.size];
        let pieces = self.views.chunks(VIEWS_AT_ONCE);
        for (piece, (views, upstream)) in pieces
            .zip(upstream.chunks(VIEWS_AT_ONCE * of_view))
            .enumerate()
        {
            let gradients: Vec<Sums> = views
                .par_iter()
                .zip(upstream.par_chunks(of_view))
                .enumerate()
                .map(|(i, ((view, _), upstream))| {
                    let index = VIEWS_AT_ONCE * piece + i;
                    let along_paths = self.on_gpu(index, upstream);
                    self.of_view(view, index, upstream, along_paths)
                })
                .collect();
            for ((view, places), sums) in views.iter().zip(&gradients) {
                sums.write(&view.scene, &places.scene, &mut all);
                view.write_camera(&sums.camera, &places.camera, &mut all);
            }
        }
        all
    }

    /// The sums of derivatives of a view, and those along paths if they are known.
    fn of_view(&self, view: &View, index: usize, rows: &[f64], along_paths: Option<Sums>) -> Sums {
        let channels = self.rows.count();
        let per_sample = f64::from(self.samples).recip();
        let unit = view.scene.frame.unit;
        let upstream: Vec<(u32, Seen)> = self
            .pixels
            .iter()
            .enumerate()
            .map(|(i, &pixel)| {
                let row = |row: usize| rows[i * channels + row] * per_sample;
                (pixel, self.rows.upstream(row, unit))
            })
            .collect();
        // Tiles in accumulators that have their sums to themselves: as many whatever the machine, so that
        // sums come out the same.
        let typical = View::typical(&upstream);
        let zero = Sums::new(&view.scene, &view.wanted);
        let accumulators = (ACCUMULATED / zero.len()).clamp(4, 64);
        let each = self.tiles.len().div_ceil(accumulators).max(1);
        let of_accumulator = |tiles: &[Tile]| {
            let mut sums = zero.clone();
            let mut work = Work::new(0);
            for tile in tiles {
                let pixels = &upstream[tile.first..tile.first + tile.pixels];
                let samples = tile.from..tile.to;
                view.backward(pixels, typical, samples, &mut work, &mut sums);
            }
            sums
        };
        let mut sums = Vec::new();
        if view.settings.interior || (view.has_edges && !self.jumps_on_gpu(view)) {
            sums = self.tiles.par_chunks(each).map(of_accumulator).collect();
        }
        let mut all = along_paths.unwrap_or_else(|| zero.clone());
        sums.iter().for_each(|s| all.add(s));
        if view.has_edges {
            self.on_film(view, (index, rows), upstream, &zero, accumulators, &mut all);
        }
        all.resolve(&view.scene);
        all
    }

    /// Adds the jumps on the film.
    fn on_film(
        &self,
        view: &View,
        (index, rows): (usize, &[f64]),
        mut upstream: Vec<(u32, Seen)>,
        zero: &Sums,
        accumulators: usize,
        all: &mut Sums,
    ) {
        let samples = self.samples as f32;
        for (_, g) in &mut upstream {
            g.radiance *= samples;
            g.opacity *= samples;
            g.depth *= samples;
            g.normal *= samples;
        }
        let asked = upstream.iter().filter(|p| p.1 != Seen::default()).count();
        let pixels = PixelGradients::new(&upstream, view);
        let edges = view.film_edges(&pixels);
        if edges.is_empty() {
            return;
        }
        let paths = asked as f64 * f64::from(self.samples);
        let count = (FILM_SAMPLES * paths).max(FEW.min(8.0 * paths)).ceil();
        let count = count.clamp(1.0, 1e9) as u32;
        #[cfg(feature = "wgpu")]
        if let Some(gpu) = &self.gpu
            && self.jumps_on_gpu(view)
        {
            let film = crate::gpu::FilmJob {
                pieces: Arc::new(edges.flat()),
                places: pixels.places().map(Arc::new),
                radius: view.filter.radius(),
                samples: count,
            };
            let rows: Vec<f32> = rows.iter().map(|&g| g as f32).collect();
            let (device, job) = (&gpu.device, &gpu.jobs[index]);
            all.add(&crate::gpu::sums_of_film(device, view, job, &film, &rows));
            return;
        }
        let _ = (index, rows);
        let each = count.div_ceil(accumulators as u32).max(256);
        let sums: Vec<Sums> = (0..count.div_ceil(each))
            .into_par_iter()
            .map(|i| {
                let mut sums = zero.clone();
                let mut work = Work::new(0);
                let range = i * each..((i + 1) * each).min(count);
                view.film_backward(&edges, &pixels, range, count, &mut work, &mut sums);
                sums
            })
            .collect();
        sums.iter().for_each(|s| all.add(s));
    }
}
