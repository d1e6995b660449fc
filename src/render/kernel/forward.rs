//! The forward pass on the host. It renders tiles of all views on all cores into rows of images.

use std::ops::Range;
use std::sync::atomic::AtomicUsize;

use burn::tensor::{Element, TensorData};
use rayon::prelude::*;

use super::rows::Rows;
use crate::error::Result;
use crate::render::options::RenderOptions;
use crate::render::standing::Places;
use crate::render::tiles::{Tile, tiles};
use softray_kernels::kernel::{Counted, RayCounts, View, Work};
use softray_kernels::model::V3;

/// The default number of camera rays per tile.
const RAYS: usize = 1 << 13;

/// Divides the samples of a view's pixels into tiles.
pub(super) fn camera_tiles(
    options: &RenderOptions,
    pixels: usize,
    samples: Range<u32>,
) -> Vec<Tile> {
    tiles(options, pixels, samples, RAYS)
}

/// The forward pass: the data that all views share.
pub(super) struct Forward<'a> {
    pub options: &'a RenderOptions,
    /// The pixels to render; all if `None`.
    pub pixels: Option<&'a Vec<u32>>,
    /// The number of samples of each pixel.
    pub samples: usize,
    pub tiles: &'a [Tile],
    pub rows: &'a Rows,
    /// The number of finished tiles, and of all.
    pub done: Option<(&'a AtomicUsize, usize)>,
}

/// The counts of a forward pass.
#[derive(Clone, Default)]
pub(super) struct Traced {
    pub counts: RayCounts,
    /// The number of radiance values that are not finite.
    pub non_finite: u64,
    /// Whether any pixel is not black. Valid for means, not for tiles.
    pub lit: bool,
}

impl Traced {
    pub fn add(&mut self, other: &Self) {
        self.counts.add(&other.counts);
        self.non_finite += other.non_finite;
        self.lit |= other.lit;
    }
}

impl Forward<'_> {
    /// Returns the rows `[B·P, C]` of all pixels of all views, converted by `cast`. Only one array of this size is in
    /// memory.
    pub fn views<T: Element + Send>(
        &self,
        views: &[(View, Places)],
        count: usize,
        cast: impl Fn(f64) -> T + Sync,
    ) -> Result<(TensorData, Vec<Traced>)> {
        let channels = self.rows.count();
        let of_view = count * channels;
        let mut means: Vec<T> = Vec::new();
        means
            .try_reserve_exact(views.len() * of_view)
            .map_err(|_| {
                let size = (views.len() * of_view * size_of::<T>()) as f64 / 1e9;
                let expected = format!("an image that fits into memory; it takes {size:.1} GB");
                self.options.size_error(expected)
            })?;
        means.resize(views.len() * of_view, cast(0.0));
        let traced = means
            .par_chunks_mut(of_view)
            .zip(views)
            .map(|(means, (view, _))| self.view(view, means, &cast))
            .collect();
        let shape = [views.len() * count, channels];
        Ok((TensorData::new(means, shape), traced))
    }

    /// Fills the rows `[P, C]` of a view's pixels.
    fn view<T: Send>(
        &self,
        view: &View,
        means: &mut [T],
        cast: &(impl Fn(f64) -> T + Sync),
    ) -> Traced {
        let channels = self.rows.count();
        let same_pixels = |a: &Tile, b: &Tile| a.first == b.first;
        let groups: Vec<&[Tile]> = self.tiles.chunk_by(same_pixels).collect();
        let each = self.tiles[0].pixels * channels;
        let of_group = |(tiles, means): (&[Tile], &mut [T])| {
            let sums: Vec<(Vec<f64>, Traced)> =
                tiles.par_iter().map(|tile| self.tile(view, tile)).collect();
            let mut traced = Traced::default();
            sums.iter().for_each(|s| traced.add(&s.1));
            for (i, mean) in means.iter_mut().enumerate() {
                let sum: f64 = sums.iter().map(|s| s.0[i]).sum();
                traced.lit |= sum != 0.0 && i % channels < 3;
                *mean = cast(sum / self.samples as f64);
            }
            traced
        };
        let groups = groups.into_par_iter().zip(means.par_chunks_mut(each));
        let found: Vec<Traced> = groups.map(of_group).collect();
        let mut traced = Traced::default();
        found.iter().for_each(|f| traced.add(f));
        traced
    }

    /// Returns the sums `[P, C]` over the samples of a tile.
    fn tile(&self, view: &View, tile: &Tile) -> (Vec<f64>, Traced) {
        let own = view.scene.lists.counted.len();
        let range = tile.first..tile.first + tile.pixels;
        let all: Vec<u32>;
        let pixels = match self.pixels {
            Some(pixels) => &pixels[range],
            None => {
                all = range.map(|i| i as u32).collect();
                &all
            }
        };
        let mut work = Work::new(self.options.bounces);
        let mut more = Counted {
            objects: (self.rows.objects).map(|_| vec![0.0; (own + 1) * tile.pixels]),
            albedos: (self.rows.albedo()).map(|_| vec![V3::ZERO; tile.pixels]),
            rays: self.rows.rays.then(|| vec![0.0; tile.pixels]),
        };
        let samples = tile.from..tile.to;
        let sums = view.render(pixels, samples, &mut work, &mut more);
        let channels = self.rows.count();
        let mut rows = vec![0.0; channels * tile.pixels];
        let mut non_finite = 0;
        for (i, (sum, row)) in sums.iter().zip(rows.chunks_exact_mut(channels)).enumerate() {
            let values = self.rows.of(sum, view.scene.frame.unit);
            row.iter_mut().zip(values).for_each(|(r, v)| *r = v);
            non_finite += row[..3].iter().filter(|v| !v.is_finite()).count() as u64;
            if let (Some(albedos), Some(channels)) = (&more.albedos, self.rows.albedo()) {
                row[channels].copy_from_slice(&albedos[i].as_dvec3().to_array());
            }
            if let Some(rays) = &more.rays {
                row[channels - 1] = f64::from(rays[i]);
            }
            if let (Some(objects), Some(all)) = (&more.objects, self.rows.objects) {
                let first = channels - usize::from(self.rows.rays) - all - 1;
                for (k, share) in objects[i * (own + 1)..][..=own].iter().enumerate() {
                    // The background is last, for any number of objects.
                    row[first + if k == own { all } else { k }] = f64::from(*share);
                }
            }
        }
        if let Some((done, all)) = self.done {
            self.options.progress.tile(done, all);
        }
        let counts = work.counts;
        let traced = Traced {
            counts,
            non_finite,
            ..Traced::default()
        };
        (rows, traced)
    }
}
