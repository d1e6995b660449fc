//! The backward pass. It traces the paths again and sums derivatives into the parent's gradient. In forward mode the
//! same pass sums their products with tangents into the derivatives of pixels.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use burn::tensor::TensorData;
use rayon::prelude::*;

use super::forward::camera_tiles;
use super::rows::Rows;
use crate::render::options::RenderOptions;
use crate::render::standing::Places;
use crate::render::tiles::Tile;
use softray_kernels::kernel::{
    FilmEdges, HostSums, KINDS, ON_FILM, PixelGradients, SEARCHED, SHADOWS, Seen, View, Work,
    Yields,
};
use softray_kernels::model::film::{MAX_EDGE_SAMPLES, samples_of_film};
use softray_kernels::model::integers::hashed;
use softray_kernels::model::jumps::usual_searches;

/// The maximum total size, in numbers, of all accumulators of derivatives.
const ACCUMULATED: usize = 1 << 24;

/// The number of views whose derivatives are in memory at once.
const VIEWS_AT_ONCE: usize = 16;

/// One pixel in this many comes first. The variance and cost of its edges set the numbers of edge samples of the
/// others.
const FIRST: u32 = 8;
/// The minimum number of paths for this measurement.
const MIN_PATHS: u64 = 8192;
/// The least number of pixels that go first.
const MIN_FIRST_PIXELS: usize = 32;
/// One film edge sample in this many is drawn first, for the measurement. It is not part of the result.
const FIRST_ON_FILM: u32 = 32;

/// The backward pass of a batch on the host.
pub(super) struct Backward {
    views: Vec<(View, Places)>,
    pixels: Arc<Vec<u32>>,
    tiles: Vec<Tile>,
    rows: Rows,
    samples: u32,
    /// Whether the numbers of edge samples adapt to variance and cost.
    shares: bool,
    /// The size of the parent.
    size: usize,
}

impl Backward {
    /// Makes the backward pass for a list of pixels, or for all; `size` is the size of the parent.
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
            shares: options.adaptive_edges,
            size,
        }
    }

    /// Returns the gradient of the parent for the upstream gradient `[B·P, C]` of the rows of all views.
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

    /// Returns the derivatives `[P, C, K + 1]` of all pixels of the only view for K directions of the parent, and the
    /// pixels' values after them. Edges are drawn as for a loss that depends on all channels of all pixels equally.
    pub fn derivatives(&self, directions: &[Vec<f64>]) -> Vec<f64> {
        let (view, places) = &self.views[0];
        let channels = self.rows.derived();
        let units = (0..channels).map(|channel| {
            let row = |row: usize| f64::from(row == channel);
            self.rows.upstream(row, 1.0)
        });
        let places = (&*places.scene, &*places.camera);
        let (sums, tangents) = view.tangents(places, directions, units.collect());
        let mut all = sums.into_pixels(tangents, 0..self.pixels.len() as u32);
        let rows = vec![1.0; self.rows.count() * self.pixels.len()];
        self.add(view, &self.loss_gradient(view, &rows), &mut all);
        all.into_numbers()
    }

    /// Adds the derivatives of the loss with respect to the scenes and cameras of some views.
    fn add_group(&self, views: &[(View, Places)], rows: &[f64], all: &mut [f64]) {
        let of_view = self.rows.count() * self.pixels.len();
        let sums: Vec<HostSums> = views
            .par_iter()
            .zip(rows.par_chunks(of_view))
            .map(|((view, _), rows)| {
                let mut sums = HostSums::new(&view.scene, &view.wanted);
                self.add(view, &self.loss_gradient(view, rows), &mut sums);
                sums.resolve(&view.scene);
                sums
            })
            .collect();
        for ((view, places), sums) in views.iter().zip(&sums) {
            sums.write(&view.scene, &places.scene, all);
            view.write_camera(sums.camera(), &places.camera, all);
        }
    }

    /// Returns the upstream gradient of a view's pixels, and the edges on its film if there are any.
    fn loss_gradient(&self, view: &View, rows: &[f64]) -> LossGradient {
        let channels = self.rows.count();
        let unit = view.scene.frame.unit;
        let pixels = self.pixels.iter().enumerate();
        let upstream: Vec<(u32, Seen)> = pixels
            .map(|(i, &pixel)| {
                let row = |row: usize| rows[i * channels + row];
                (pixel, self.rows.upstream(row, unit))
            })
            .collect();
        let count = upstream.iter().filter(|p| p.1 != Seen::default()).count();
        let follows = view.lists().follows_on_film();
        let pixels = view.has_edges || follows;
        let pixels = pixels.then(|| PixelGradients::new(&upstream, view));
        let edges = pixels.as_ref().filter(|_| view.has_edges);
        let edges = edges.map(|pixels| FilmEdges::new(view, pixels));
        let film = edges.filter(|edges| !edges.is_empty()).map(|edges| Film {
            edges,
            samples: samples_of_film(count as u32, self.samples),
        });
        LossGradient {
            upstream,
            paths: count as u64 * u64::from(self.samples),
            pixels,
            film,
        }
    }

    /// Adds the derivatives of a view.
    fn add(&self, view: &View, loss: &LossGradient, all: &mut HostSums) {
        let jumps = view.has_edges;
        if !view.settings.interior && !jumps {
            return;
        }
        // Each accumulator has its own sums of some tiles. Their number does not depend on the machine, so the sums are
        // reproducible.
        let accumulators = (ACCUMULATED / all.count()).clamp(4, 64);
        let each = self.tiles.len().div_ceil(accumulators).max(1);
        let per_sample = f64::from(self.samples).recip() as f32;
        let upstream: Vec<(u32, Seen)> = loss
            .upstream
            .iter()
            .map(|&(pixel, g)| (pixel, g.times(per_sample)))
            .collect();
        let typical = View::typical(&upstream);
        let samples_log = view.lists().samples_log;
        let usual: [f32; SEARCHED] =
            std::array::from_fn(|kind| usual_searches(kind == SHADOWS, samples_log));
        let tiles: Vec<&[Tile]> = self.tiles.chunks(each).collect();
        let range = |tiles: &[Tile]| {
            let past = tiles.iter().map(|t| t.first + t.pixels).max();
            tiles[0].first as u32..past.unwrap_or_default() as u32
        };
        let ranges: Vec<Range<u32>> = tiles.iter().map(|tiles| range(tiles)).collect();
        let empty = all.empty(0..view.settings.width * view.settings.height);
        let around = loss.pixels.as_ref().map(|pixels| (pixels, per_sample));
        let mut of_pixels = |searches, chosen: &(dyn Fn(u32) -> bool + Sync)| {
            add_in_order(&ranges, all, |i, work, sums| {
                for tile in tiles[i] {
                    let pixels = &upstream[tile.first..tile.first + tile.pixels];
                    let pixels: Vec<_> = pixels.iter().filter(|p| chosen(p.0)).copied().collect();
                    let samples = tile.from..tile.to;
                    view.backward(&pixels, around, (typical, searches), samples, work, sums);
                }
            })
        };
        let film = loss.film.as_ref().zip(loss.pixels.as_ref());
        let mut shares = [1.0; KINDS];
        let first = |pixel: u32| hashed(pixel).is_multiple_of(FIRST);
        let counted = upstream
            .iter()
            .filter(|(p, g)| first(*p) && *g != Seen::default());
        let enough = loss.paths >= MIN_PATHS && counted.count() >= MIN_FIRST_PIXELS;
        if self.shares && jumps && enough {
            let mut yields = of_pixels(usual, &first).times(f64::from(FIRST));
            if let Some((film, pixels)) = film {
                yields += film
                    .first(view, pixels, &empty)
                    .times(f64::from(FIRST_ON_FILM));
            }
            shares = yields.shares(samples_log);
            let searches = std::array::from_fn(|kind| usual[kind] * shares[kind]);
            of_pixels(searches, &|pixel| !first(pixel));
        } else {
            of_pixels(usual, &|_| true);
        }
        if let Some((film, pixels)) = film {
            let count = (film.samples as f32 * shares[ON_FILM]) as u32;
            let samples = 0..count.clamp(1, MAX_EDGE_SAMPLES);
            film.add(view, pixels, samples, accumulators, all);
        }
    }
}

/// Computes parts on all cores, each in its own sums, and adds them in order. Few parts are in memory at once. In forward
/// mode a part contributes to its range of pixels. Returns the variance and cost of the edge samples.
fn add_in_order(
    parts: &[Range<u32>],
    all: &mut HostSums,
    part: impl Fn(usize, &mut Work, &mut HostSums) + Sync,
) -> Yields {
    let next = AtomicUsize::new(0);
    let empty = all.empty(0..0);
    // The sums, the variance and cost, the number of added parts, and parts that finished early.
    let added = Mutex::new((all, Yields::default(), 0, BTreeMap::new()));
    let of_core = |_| loop {
        let i = next.fetch_add(1, Ordering::Relaxed);
        let Some(pixels) = parts.get(i) else {
            return;
        };
        let mut sums = empty.empty(pixels.clone());
        let mut work = Work::new(0);
        part(i, &mut work, &mut sums);
        let mut added = added.lock().unwrap_or_else(PoisonError::into_inner);
        let (all, yields, past, early) = &mut *added;
        early.insert(i, (sums, work.yields));
        while let Some((sums, more)) = early.remove(past) {
            all.add(&sums);
            *yields += more;
            *past += 1;
        }
    };
    let cores = (0..rayon::current_num_threads()).into_par_iter();
    cores.with_max_len(1).for_each(of_core);
    added.into_inner().unwrap_or_else(PoisonError::into_inner).1
}

/// The dependence of a loss on a view.
struct LossGradient {
    /// The derivatives of the loss with respect to each pixel.
    upstream: Vec<(u32, Seen)>,
    /// The number of paths in pixels with a nonzero derivative.
    paths: u64,
    /// The same for edges and rays that move on the film.
    pixels: Option<PixelGradients>,
    /// The edges on the film, if there are any.
    film: Option<Film>,
}

/// The edges on a film.
struct Film {
    edges: FilmEdges,
    /// The usual number of samples.
    samples: u32,
}

impl Film {
    /// Adds the boundary terms of a range of edge samples.
    fn add(
        &self,
        view: &View,
        pixels: &PixelGradients,
        samples: Range<u32>,
        accumulators: usize,
        all: &mut HostSums,
    ) -> Yields {
        let count = samples.len() as u32;
        let each = count.div_ceil(accumulators as u32).max(256);
        let all_pixels = 0..view.settings.width * view.settings.height;
        let parts = vec![all_pixels; count.div_ceil(each) as usize];
        add_in_order(&parts, all, |i, work, sums| {
            let first = samples.start + i as u32 * each;
            let range = first..(first + each).min(samples.end);
            view.film_backward(&self.edges, pixels, range, count, work, sums);
        })
    }

    /// Measures the variance and cost of a few edge samples, with independent random numbers.
    fn first(&self, view: &View, pixels: &PixelGradients, empty: &HostSums) -> Yields {
        let count = self.samples.div_ceil(FIRST_ON_FILM);
        let mut sums = empty.empty(0..view.settings.width * view.settings.height);
        let pilot = MAX_EDGE_SAMPLES..MAX_EDGE_SAMPLES + count;
        let mut yields = self.add(view, pixels, pilot, 4, &mut sums);
        // Each sample was one of `count`. Squares fall as the number of samples grows.
        let of = &mut yields.edges[ON_FILM];
        of.squares /= f64::from(FIRST_ON_FILM).powi(2);
        yields
    }
}
