//! The backward pass: paths are traced again, and derivatives add up in the parent's gradient.

use std::ops::Range;
use std::sync::Arc;

use burn::tensor::TensorData;
use rayon::prelude::*;

use super::forward::camera_tiles;
use super::prepare::Places;
use super::rows::Rows;
use crate::kernel::{FilmEdges, PixelGradients, Seen, Sums, View, Work};
use crate::render::options::{RenderOptions, Tile};

/// Numbers in the sums of derivatives of all accumulators together.
const ACCUMULATED: usize = 1 << 24;

/// Views whose derivatives are held at once.
const VIEWS_AT_ONCE: usize = 16;

/// Samples of edges on the film for each path of the image.
const FILM_SAMPLES: f64 = 0.125;

/// So many samples of edges on the film take no time.
const FEW: f64 = 1024.0;

/// Groups of views whose images came from a GPU.
#[cfg(feature = "wgpu")]
pub(super) struct Gpu {
    pub device: burn::tensor::Device,
    pub jobs: Vec<(Range<usize>, crate::gpu::Job)>,
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

    /// Views whose derivatives are held at once.
    fn groups(&self) -> Vec<Range<usize>> {
        #[cfg(feature = "wgpu")]
        if let Some(gpu) = &self.gpu {
            return gpu.jobs.iter().map(|job| job.0.clone()).collect();
        }
        let firsts = (0..self.views.len()).step_by(VIEWS_AT_ONCE);
        let past = |first: usize| self.views.len().min(first + VIEWS_AT_ONCE);
        firsts.map(|first| first..past(first)).collect()
    }

    /// The gradient of the parent from that of the rows of all views `[B·P, C]`.
    pub fn gradient(&self, upstream: &TensorData) -> Vec<f64> {
        let upstream: Vec<f64> = upstream.iter::<f64>().collect();
        let of_view = self.rows.count() * self.pixels.len();
        let mut all = vec![0.0; self.size];
        for (index, range) in self.groups().into_iter().enumerate() {
            let views = &self.views[range.clone()];
            let rows = &upstream[range.start * of_view..range.end * of_view];
            let sums = self.of_group(index, views, rows);
            for ((view, places), sums) in views.iter().zip(&sums) {
                sums.write(&view.scene, &places.scene, &mut all);
                view.write_camera(&sums.camera, &places.camera, &mut all);
            }
        }
        all
    }

    /// The sums of derivatives of a group's views.
    fn of_group(&self, index: usize, views: &[(View, Places)], rows: &[f64]) -> Vec<Sums> {
        let of_view = self.rows.count() * self.pixels.len();
        let asked: Vec<Asked> = views
            .par_iter()
            .zip(rows.par_chunks(of_view))
            .map(|((view, _), rows)| self.asked(view, rows))
            .collect();
        let zero = |(view, _): &(View, Places)| Sums::new(&view.scene, &view.wanted);
        let mut sums = match self.on_gpu(index, views, &asked, rows) {
            Some(sums) => sums,
            None => views.iter().map(zero).collect(),
        };
        let tasks = views.par_iter().zip(&asked).zip(&mut sums);
        tasks.for_each(|(((view, _), asked), sums)| {
            self.add_on_host(view, asked, sums);
            sums.resolve(&view.scene);
        });
        sums
    }

    /// The derivatives of the loss by a view's pixels, and the edges on its film where it depends on it.
    fn asked(&self, view: &View, rows: &[f64]) -> Asked {
        let channels = self.rows.count();
        let unit = view.scene.frame.unit;
        let pixels = self.pixels.iter().enumerate();
        let upstream: Vec<(u32, Seen)> = pixels
            .map(|(i, &pixel)| {
                let row = |row: usize| rows[i * channels + row];
                (pixel, self.rows.upstream(row, unit))
            })
            .collect();
        let mut film = None;
        if view.has_edges {
            let pixels = PixelGradients::new(&upstream, view);
            let count = upstream.iter().filter(|p| p.1 != Seen::default()).count();
            let paths = count as f64 * f64::from(self.samples);
            let count = (FILM_SAMPLES * paths).max(FEW.min(8.0 * paths)).ceil();
            film = Some(Film {
                edges: view.film_edges(&pixels),
                pixels,
                samples: count.clamp(1.0, 1e9) as u32,
            });
        }
        Asked { upstream, film }
    }

    /// The sums of derivatives of a group's views from a GPU, if they are computed there.
    #[cfg(feature = "wgpu")]
    fn on_gpu(
        &self,
        index: usize,
        views: &[(View, Places)],
        asked: &[Asked],
        rows: &[f64],
    ) -> Option<Vec<Sums>> {
        let gpu = self.gpu.as_ref()?;
        let (_, job) = &gpu.jobs[index];
        let films = views.iter().zip(asked).map(|((view, _), asked)| {
            let film = asked.film.as_ref().filter(|_| self.jumps_on_gpu(view))?;
            Some((view.filter.radius(), &film.edges, film.samples))
        });
        let places = asked.iter().find_map(|a| a.film.as_ref()?.pixels.places());
        let typical = asked.iter().map(|a| View::typical(&a.upstream)).collect();
        let sought = crate::gpu::Sought::new(crate::gpu::Films::new(films, places), typical);
        let views: Vec<&View> = views.iter().map(|v| &v.0).collect();
        let rows = rows.iter().map(|&g| g as f32).collect();
        Some(crate::gpu::sums_of(&gpu.device, &views, job, sought, rows))
    }

    #[cfg(not(feature = "wgpu"))]
    fn on_gpu(&self, _: usize, _: &[(View, Places)], _: &[Asked], _: &[f64]) -> Option<Vec<Sums>> {
        self.gpu.as_ref().map(|never| match *never {})
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

    /// Adds the derivatives of a view that no GPU adds.
    fn add_on_host(&self, view: &View, asked: &Asked, all: &mut Sums) {
        let jumps = view.has_edges && !self.jumps_on_gpu(view);
        if !view.settings.interior && !jumps {
            return;
        }
        // Tiles in accumulators that have their sums to themselves: as many whatever the machine, so that
        // sums come out the same.
        let zero = Sums::new(&view.scene, &view.wanted);
        let accumulators = (ACCUMULATED / zero.len()).clamp(4, 64);
        let each = self.tiles.len().div_ceil(accumulators).max(1);
        let per_sample = f64::from(self.samples).recip() as f32;
        let upstream: Vec<(u32, Seen)> = asked
            .upstream
            .iter()
            .map(|&(pixel, g)| (pixel, g.times(per_sample)))
            .collect();
        let typical = View::typical(&upstream);
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
        let sums: Vec<Sums> = self.tiles.par_chunks(each).map(of_accumulator).collect();
        sums.iter().for_each(|s| all.add(s));
        let Some(film) = asked.film.as_ref().filter(|f| jumps && !f.edges.is_empty()) else {
            return;
        };
        let count = film.samples;
        let each = count.div_ceil(accumulators as u32).max(256);
        let sums: Vec<Sums> = (0..count.div_ceil(each))
            .into_par_iter()
            .map(|i| {
                let mut sums = zero.clone();
                let mut work = Work::new(0);
                let range = i * each..((i + 1) * each).min(count);
                view.film_backward(
                    &film.edges,
                    &film.pixels,
                    range,
                    count,
                    &mut work,
                    &mut sums,
                );
                sums
            })
            .collect();
        sums.iter().for_each(|s| all.add(s));
    }
}

/// What a loss depends on in a view.
struct Asked {
    /// Its derivatives by each pixel.
    upstream: Vec<(u32, Seen)>,
    /// Where something can jump.
    film: Option<Film>,
}

/// Edges on a film.
struct Film {
    edges: FilmEdges,
    pixels: PixelGradients,
    /// How many are drawn.
    samples: u32,
}
