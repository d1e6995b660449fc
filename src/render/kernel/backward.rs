//! The backward pass: paths are traced again, and derivatives add up in the parent's gradient.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use burn::tensor::TensorData;
use rayon::prelude::*;

use super::forward::camera_tiles;
use super::prepare::Places;
use super::rows::Rows;
use crate::kernel::{FilmEdges, HostSums, ON_FILM, PixelGradients, Seen, View, Work, Yields};
use crate::model::film::{MOST, samples_of_film};
use crate::model::integers::hashed;
use crate::model::jumps::usual_searches;
use crate::render::options::RenderOptions;
use crate::render::tiles::Tile;

/// Numbers in the sums of derivatives of all accumulators together.
const ACCUMULATED: usize = 1 << 24;

/// Views whose derivatives are held at once.
const VIEWS_AT_ONCE: usize = 16;

/// One of so many pixels goes first: how much edges vary and cost there says how many samples the others give them.
const FIRST: u32 = 8;
/// The least number of paths with which that is done.
const LEAST_PATHS: u64 = 8192;
/// One of so many samples of edges on the film is drawn first, and is no part of the result.
const FIRST_ON_FILM: u32 = 32;

/// The backward pass of a batch on the host.
pub(super) struct Backward {
    views: Vec<(View, Places)>,
    pixels: Arc<Vec<u32>>,
    tiles: Vec<Tile>,
    rows: Rows,
    samples: u32,
    /// Whether edges are given samples by what they bring.
    shares: bool,
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
            shares: options.adaptive_edges,
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
        let count = upstream.iter().filter(|p| p.1 != Seen::default()).count();
        let mut film = None;
        if view.has_edges {
            let pixels = PixelGradients::new(&upstream, view);
            let edges = FilmEdges::new(view, &pixels);
            film = (!edges.is_empty()).then(|| Film {
                edges,
                pixels,
                samples: samples_of_film(count as u32, self.samples),
            });
        }
        Asked {
            upstream,
            paths: count as u64 * u64::from(self.samples),
            film,
        }
    }

    /// Adds the derivatives of a view.
    fn add(&self, view: &View, asked: &Asked, all: &mut HostSums) {
        let jumps = view.has_edges;
        if !view.settings.interior && !jumps {
            return;
        }
        // Tiles in accumulators that have their sums to themselves: as many whatever the machine, so that
        // sums come out the same.
        let accumulators = (ACCUMULATED / all.len()).clamp(4, 64);
        let each = self.tiles.len().div_ceil(accumulators).max(1);
        let per_sample = f64::from(self.samples).recip() as f32;
        let upstream: Vec<(u32, Seen)> = asked
            .upstream
            .iter()
            .map(|&(pixel, g)| (pixel, g.times(per_sample)))
            .collect();
        let typical = View::typical(&upstream);
        let samples_log = view.lists().samples_log;
        let usual = [true, false].map(|of_light| usual_searches(of_light, samples_log));
        let tiles: Vec<&[Tile]> = self.tiles.chunks(each).collect();
        let mut of_pixels = |searches, chosen: &(dyn Fn(u32) -> bool + Sync)| {
            add_in_order(view, tiles.len(), all, |i, work, sums| {
                for tile in tiles[i] {
                    let pixels = &upstream[tile.first..tile.first + tile.pixels];
                    let pixels: Vec<_> = pixels.iter().filter(|p| chosen(p.0)).copied().collect();
                    view.backward(&pixels, typical, searches, tile.from..tile.to, work, sums);
                }
            })
        };
        let film = &asked.film;
        let mut shares = [1.0; 3];
        if self.shares && jumps && asked.paths >= LEAST_PATHS {
            let first = |pixel: u32| hashed(pixel) % FIRST == 0;
            let mut yields = of_pixels(usual, &first).times(f64::from(FIRST));
            if let Some(film) = film {
                yields += film.first(view).times(f64::from(FIRST_ON_FILM));
            }
            shares = yields.shares(samples_log);
            let searches = [0, 1].map(|kind| usual[kind] * shares[kind]);
            of_pixels(searches, &|pixel| !first(pixel));
        } else {
            of_pixels(usual, &|_| true);
        }
        if let Some(film) = film {
            let count = (film.samples as f32 * shares[ON_FILM]) as u32;
            film.add(view, 0..count.clamp(1, MOST), accumulators, all);
        }
    }
}

/// Adds parts that are computed on all cores, each in sums of its own, in their order: few are held at once.
/// Returns how much samples of edges vary and cost.
fn add_in_order(
    view: &View,
    count: usize,
    all: &mut HostSums,
    part: impl Fn(usize, &mut Work, &mut HostSums) + Sync,
) -> Yields {
    let next = AtomicUsize::new(0);
    // The sums, the number of parts in them, and parts that came before their turn.
    let added = Mutex::new((all, Yields::default(), 0, BTreeMap::new()));
    let of_core = |_| loop {
        let i = next.fetch_add(1, Ordering::Relaxed);
        if i >= count {
            return;
        }
        let mut sums = HostSums::new(&view.scene, &view.wanted);
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

/// What a loss depends on in a view.
struct Asked {
    /// Its derivatives by each pixel.
    upstream: Vec<(u32, Seen)>,
    /// Paths of pixels on which it depends.
    paths: u64,
    /// Where something can jump.
    film: Option<Film>,
}

/// Edges on a film.
struct Film {
    edges: FilmEdges,
    pixels: PixelGradients,
    /// How many are drawn usually.
    samples: u32,
}

impl Film {
    /// Adds the derivatives by jumps at so many edges.
    fn add(
        &self,
        view: &View,
        samples: Range<u32>,
        accumulators: usize,
        all: &mut HostSums,
    ) -> Yields {
        let count = samples.len() as u32;
        let each = count.div_ceil(accumulators as u32).max(256);
        add_in_order(view, count.div_ceil(each) as usize, all, |i, work, sums| {
            let first = samples.start + i as u32 * each;
            let range = first..(first + each).min(samples.end);
            view.film_backward(&self.edges, &self.pixels, range, count, work, sums);
        })
    }

    /// How much a few edges vary and cost. Their random numbers are their own.
    fn first(&self, view: &View) -> Yields {
        let count = self.samples.div_ceil(FIRST_ON_FILM);
        let mut sums = HostSums::new(&view.scene, &view.wanted);
        let mut yields = self.add(view, MOST..MOST + count, 4, &mut sums);
        // Each was one of `count`: squares fall as the number of samples grows.
        let of = &mut yields.edges[ON_FILM];
        of.squares /= f64::from(FIRST_ON_FILM).powi(2);
        yields
    }
}
