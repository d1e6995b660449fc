//! The forward pass of a batch. Kernels run on its device if it is a GPU and tensors are f32, otherwise on the host.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;

use burn::tensor::{DType, Int, Tensor};
use rayon::prelude::*;

use super::forward::{Forward, Traced, camera_tiles};
#[cfg(feature = "gpu")]
use super::prepare::on_gpu;
use super::rows::Rows;
#[cfg(feature = "gpu")]
use super::step::as_places;
#[cfg(feature = "gpu")]
use crate::device::stage;
use crate::error::Result;
use crate::geometry::{Context, host_values};
#[cfg(feature = "gpu")]
use crate::gpu::{Job, Row, ViewPlaces, pack};
use crate::render::adaptive::{pilots, shares};
use crate::render::cache::HierarchyCache;
use crate::render::options::RenderOptions;
#[cfg(feature = "gpu")]
use crate::render::standing::Group;
use crate::render::standing::Places;
use softray_kernels::kernel::View;

/// The parameters of a forward pass.
pub(super) struct Pass<'a> {
    pub options: &'a RenderOptions,
    pub views: &'a [(View, Places)],
    pub context: &'a Context,
    pub rows: &'a Rows,
    /// The pixels of each view (all if `None`), and their number.
    pub pixels: Option<Arc<Vec<u32>>>,
    pub count: usize,
    /// On a GPU: the groups of all views, if they are packed, and otherwise the row from which it places tensors.
    #[cfg(feature = "gpu")]
    pub groups: Option<&'a [Group]>,
    #[cfg(feature = "gpu")]
    pub row: Option<&'a Row>,
}

/// The rows `[B·P, C]` of the pixels of some views, and the counts of each view.
type Images = (Tensor<2>, Vec<Traced>);

/// Views that are traced together.
struct Together {
    views: Range<usize>,
    /// On a GPU: groups of views, with the indices of their views in this range.
    #[cfg(feature = "gpu")]
    packed: Vec<Group>,
}

/// Pixels of a view (all if there is no list), their number, and their samples.
#[derive(Clone)]
struct Share {
    pixels: Option<Arc<Vec<u32>>>,
    count: usize,
    samples: Range<u32>,
}

/// The number of finished tiles, and of all.
type Done<'a> = Option<(&'a AtomicUsize, usize)>;

/// The data for a backward pass on a GPU.
#[cfg(feature = "gpu")]
pub(super) type Jobs = Vec<(Vec<usize>, Job)>;
/// Without GPU support there are no jobs.
#[cfg(not(feature = "gpu"))]
pub(super) type Jobs = std::convert::Infallible;

impl Pass<'_> {
    /// Returns the rows of all pixels of all views with the counts, and the jobs if a GPU ran them. If derivatives follow,
    /// `directions` is the number of directions of forward mode, or 0 for a gradient.
    pub fn trace(&self, directions: Option<usize>) -> Result<(Images, Option<Jobs>)> {
        if directions.is_some() {
            self.options.check_gradient()?;
        }
        let all = self.together(0..self.views.len(), self.options.cache.as_ref());
        let share = self.share(self.options.sample_range());
        #[cfg(feature = "gpu")]
        let jobs = self.on_gpu().then(|| self.jobs(&all, &share));
        #[cfg(feature = "gpu")]
        if let Some(jobs) = &jobs {
            let device = &self.context.device;
            crate::gpu::check(device, jobs.iter().map(|j| &j.1), directions)?;
        }
        #[cfg(not(feature = "gpu"))]
        let jobs = None;
        let pilots = pilots(self.options.samples);
        let pilots = pilots.filter(|_| self.options.adaptive && self.pixels.is_none());
        let images = match pilots {
            Some(pilots) => self.adaptive(&all, pilots)?,
            None => {
                let tiles = camera_tiles(self.options, self.count, share.samples.clone()).len();
                let done = AtomicUsize::new(0);
                self.rows(&all, &share, Some((&done, tiles * self.views.len())))?
            }
        };
        // Buffers are kept only here, since a failed render leaves their contents undefined.
        #[cfg(feature = "gpu")]
        if self.on_gpu()
            && let Some(cache) = &self.options.cache
        {
            let buffers = all.packed.iter().map(|(_, packed)| packed.buffers.clone());
            cache.buffers.keep(&self.context.device, buffers);
        }
        Ok((images, jobs))
    }

    /// A share with samples of all pixels.
    fn share(&self, samples: Range<u32>) -> Share {
        Share {
            pixels: self.pixels.clone(),
            count: self.count,
            samples,
        }
    }

    /// Renders with adaptive sampling: two pilot images set the number of samples of each pixel.
    fn adaptive(&self, all: &Together, pilots: [Range<u32>; 2]) -> Result<Images> {
        let rows = &Rows::with_rays();
        let pilot = Pass {
            rows,
            pixels: None,
            ..*self
        };
        let of = |samples: Range<u32>| -> Result<(Vec<f64>, Vec<Traced>)> {
            let (image, traced) = pilot.rows(all, &pilot.share(samples), None)?;
            Ok((host_values(&image)?, traced))
        };
        let [first, second] = pilots.map(of);
        let ((first, counted), (second, more)) = (first?, second?);
        let (width, samples) = (self.options.width, self.options.samples);
        let of_view = |(a, b): (&[[f64; 4]], &[[f64; 4]])| -> Vec<Share> {
            let of_count = |(count, pixels): (u32, Vec<u32>)| Share {
                count: pixels.len(),
                pixels: Some(Arc::new(pixels)),
                samples: 0..count,
            };
            shares([a, b], width, samples)
                .into_iter()
                .map(of_count)
                .collect()
        };
        let [first, second] = [&first, &second].map(|image| image.as_chunks().0.chunks(self.count));
        let pilots = first.zip(second);
        let shares: Vec<Vec<Share>> = pilots.map(of_view).collect();
        let tiles = |s: &Share| camera_tiles(self.options, s.count, s.samples.clone()).len();
        let done = (
            AtomicUsize::new(0),
            shares.iter().flatten().map(tiles).sum(),
        );
        let mut images = Vec::with_capacity(shares.len());
        let mut traced = Vec::with_capacity(shares.len());
        for (v, shares) in shares.iter().enumerate() {
            let own;
            let view = if self.views.len() == 1 {
                all
            } else {
                own = self.together(v..v + 1, None);
                &own
            };
            let (image, mut own) = self.view(view, shares, Some((&done.0, done.1)))?;
            own.counts.add(&counted[v].counts);
            own.counts.add(&more[v].counts);
            images.push(image);
            traced.push(own);
        }
        Ok((Tensor::cat(images, 0), traced))
    }

    /// Renders the shares of all pixels of a view as one image.
    fn view(&self, view: &Together, shares: &[Share], done: Done) -> Result<(Tensor<2>, Traced)> {
        let of_share = |share: &Share| self.rows(view, share, done);
        let found = if self.on_gpu() {
            shares.iter().map(of_share).collect::<Result<Vec<_>>>()?
        } else {
            shares
                .par_iter()
                .map(of_share)
                .collect::<Result<Vec<_>>>()?
        };
        let mut row_of_each = vec![0i32; self.count];
        let pixels = shares
            .iter()
            .flat_map(|s| s.pixels.iter().flat_map(|p| &**p));
        for (row, &pixel) in pixels.enumerate() {
            row_of_each[pixel as usize] = row as i32;
        }
        let mut traced = Traced::default();
        found
            .iter()
            .for_each(|(_, of_share)| traced.add(&of_share[0]));
        let rows = Tensor::cat(found.into_iter().map(|f| f.0).collect(), 0);
        let order = Tensor::<1, Int>::from_data(row_of_each.as_slice(), &self.context.device);
        Ok((rows.select(0, order), traced))
    }

    /// Returns the means over a share's samples.
    fn rows(&self, of: &Together, share: &Share, done: Done) -> Result<Images> {
        #[cfg(feature = "gpu")]
        if self.on_gpu() {
            return self.rows_of_gpu(&self.jobs(of, share));
        }
        let tiles = camera_tiles(self.options, share.count, share.samples.clone());
        let pass = Forward {
            options: self.options,
            pixels: share.pixels.as_deref(),
            samples: share.samples.len(),
            tiles: &tiles,
            rows: self.rows,
            done,
        };
        let views = &self.views[of.views.clone()];
        let (means, traced) = if self.context.dtype == DType::F64 {
            pass.views(views, share.count, |value| value)?
        } else {
            pass.views(views, share.count, |value| value as f32)?
        };
        let on = (&self.context.device, self.context.dtype);
        Ok((Tensor::from_data(means, on), traced))
    }
}

#[cfg(not(feature = "gpu"))]
impl Pass<'_> {
    fn on_gpu(&self) -> bool {
        false
    }

    fn together(&self, views: Range<usize>, _: Option<&HierarchyCache>) -> Together {
        Together { views }
    }
}

#[cfg(feature = "gpu")]
impl Pass<'_> {
    fn on_gpu(&self) -> bool {
        on_gpu(self.context)
    }

    /// Packs views to be traced together, with a cache into the buffers of the last render.
    fn together(&self, views: Range<usize>, cache: Option<&HierarchyCache>) -> Together {
        if let Some(groups) = self.groups {
            let packed = groups.to_vec();
            return Together { views, packed };
        }
        let of = self.views[views.clone()].iter().map(as_places);
        let of: Vec<ViewPlaces> = of.collect();
        let mut packed = Vec::new();
        if self.on_gpu() {
            let device = &self.context.device;
            let last = cache.map(|cache| cache.buffers.take(device));
            packed = stage("pack", || pack(&of, self.row, last.into_iter().flatten()));
        }
        let packed = packed
            .into_iter()
            .map(|(group, packed)| (group, Arc::new(packed)));
        Together {
            views,
            packed: packed.collect(),
        }
    }

    /// Returns the means `[K + 1, P, C]` of the only view: its derivatives along K directions of the parent, then its values.
    pub fn derivatives(&self, directions: &[Vec<f64>]) -> Result<Tensor<3>> {
        let ((values, _), jobs) = self.trace(Some(directions.len()))?;
        let jobs = jobs.expect("a GPU has jobs");
        let of_view = as_places(&self.views[0]);
        let (_, tangents) = of_view
            .0
            .tangents((of_view.1, of_view.2), directions, Vec::new());
        let device = &self.context.device;
        let derivatives = crate::gpu::derivatives_of(device, &jobs[0].1, of_view, &tangents)?;
        Ok(Tensor::cat(vec![derivatives, values.unsqueeze()], 0))
    }

    fn jobs(&self, of: &Together, share: &Share) -> Jobs {
        let job = |(group, packed): &Group| {
            let job = Job {
                views: packed.clone(),
                pixels: share.pixels.clone(),
                of_view: share.count,
                from: share.samples.start,
                samples: share.samples.len() as u32,
                outputs: self.rows.for_gpu(),
                statistics: self.options.statistics,
            };
            (group.clone(), job)
        };
        of.packed.iter().map(job).collect()
    }

    fn rows_of_gpu(&self, jobs: &Jobs) -> Result<Images> {
        let device = &self.context.device;
        let images = jobs
            .iter()
            .map(|(_, job)| crate::gpu::trace(device, job.clone()));
        let image = Tensor::cat(images.collect::<Result<_>>()?, 0);
        let order: Vec<usize> = jobs.iter().flat_map(|j| &j.0).copied().collect();
        let image = in_order(image, &order);
        let views = order.len();
        // Whether the image is black is unknown until it is read back.
        let mut traced = vec![
            Traced {
                lit: true,
                ..Traced::default()
            };
            views
        ];
        if self.options.statistics {
            for (group, job) in jobs {
                let counts = crate::gpu::counts_of(device, job)?;
                for (&view, counts) in group.iter().zip(counts) {
                    traced[view].counts = counts;
                }
            }
        }
        if self.options.diagnostics {
            let [rows, _] = image.dims();
            let values = host_values(&image.clone().slice([0..rows, 0..3]))?;
            for (traced, values) in traced.iter_mut().zip(values.chunks_exact(3 * rows / views)) {
                traced.non_finite = values.iter().filter(|v| !v.is_finite()).count() as u64;
            }
        }
        Ok((image, traced))
    }
}

/// Sorts the rows `[B·P, C]` of views by the views' numbers.
#[cfg(feature = "gpu")]
fn in_order(rows: Tensor<2>, numbers: &[usize]) -> Tensor<2> {
    if numbers.is_sorted() {
        return rows;
    }
    let mut place = vec![0i32; numbers.len()];
    for (at, &view) in numbers.iter().enumerate() {
        place[view] = at as i32;
    }
    let place = Tensor::<1, Int>::from_data(place.as_slice(), &rows.device());
    let [count, columns] = rows.dims();
    let of_views = rows.reshape([numbers.len(), count / numbers.len() * columns]);
    of_views.select(0, place).reshape([count, columns])
}
