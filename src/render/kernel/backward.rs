//! The backward pass: paths are traced again, and derivatives add up in the parent's gradient.

use std::sync::Arc;

use burn::tensor::TensorData;
use rayon::prelude::*;

use super::forward::camera_tiles;
use super::prepare::Places;
use super::rows::Rows;
use crate::kernel::{FilmEdges, HostSums, PixelGradients, Seen, View, Work};
use crate::model::film::samples_of_film;
use crate::render::options::RenderOptions;
use crate::render::tiles::Tile;

/// Numbers in the sums of derivatives of all accumulators together.
const ACCUMULATED: usize = 1 << 24;

/// Views whose derivatives are held at once.
const VIEWS_AT_ONCE: usize = 16;

/// The backward pass of a batch on the host.
pub(super) struct Backward {
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
            views,
            tiles: camera_tiles(options, pixels.len(), 0..options.samples),
            pixels,
            rows,
            samples: options.samples,
            size,
        }
    }

    /// The gradient of the parent from that of the rows of all views `[B·P, C]`.
    pub fn gradient(&self, upstream: &TensorData) -> Vec<f64> {
        let upstream: Vec<f64> = upstream.iter::<f64>().collect();
        let at_once = VIEWS_AT_ONCE * self.rows.count() * self.pixels.len();
        let mut all = vec![0.0; self.size];
        let groups = self.views.chunks(VIEWS_AT_ONCE);
        for (views, rows) in groups.zip(upstream.chunks(at_once)) {
            self.add_group(views, rows, &mut all);
        }
        all
    }

    /// Adds the derivatives by the scenes and cameras of some views.
    fn add_group(&self, views: &[(View, Places)], rows: &[f64], all: &mut [f64]) {
        let of_view = self.rows.count() * self.pixels.len();
        let sums: Vec<HostSums> = views
            .par_iter()
            .zip(rows.par_chunks(of_view))
            .map(|((view, _), rows)| {
                let mut sums = HostSums::new(&view.scene, &view.wanted);
                self.add(view, &self.asked(view, rows), &mut sums);
                sums.resolve(&view.scene);
                sums
            })
            .collect();
        for ((view, places), sums) in views.iter().zip(&sums) {
            sums.write(&view.scene, &places.scene, all);
            view.write_camera(sums.camera(), &places.camera, all);
        }
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
            let asked = upstream.iter().filter(|p| p.1 != Seen::default());
            film = Some(Film {
                edges: FilmEdges::new(view, &pixels),
                pixels,
                samples: samples_of_film(asked.count() as u32, self.samples),
            });
        }
        Asked { upstream, film }
    }

    /// Adds the derivatives of a view.
    fn add(&self, view: &View, asked: &Asked, all: &mut HostSums) {
        let jumps = view.has_edges;
        if !view.settings.interior && !jumps {
            return;
        }
        // Tiles in accumulators that have their sums to themselves: as many whatever the machine, so that
        // sums come out the same.
        let zero = HostSums::new(&view.scene, &view.wanted);
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
        let sums: Vec<HostSums> = self.tiles.par_chunks(each).map(of_accumulator).collect();
        sums.iter().for_each(|s| all.add(s));
        let Some(film) = asked.film.as_ref().filter(|f| !f.edges.is_empty()) else {
            return;
        };
        let count = film.samples;
        let each = count.div_ceil(accumulators as u32).max(256);
        let sums: Vec<HostSums> = (0..count.div_ceil(each))
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
