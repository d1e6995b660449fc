//! Renders pixels of a view, and computes their derivatives, on one core.

use std::ops::Range;

use macro_rules_attribute::apply;

use super::backward::Return;
use super::gradient::HostSums;
use super::pixels::PixelGradients;
use super::shares::SEARCHED;
use super::view::{Tracer, View};
use super::walk::{Kept, Path, PathBlock, Paths, RUN, Seen, TOGETHER, Walks, Work};
use crate::accel::stage;
use crate::model::V3;
use crate::trace::exposure;

/// Counts for each pixel. `None` is not counted.
#[derive(Default)]
pub struct Counted {
    /// The number of camera rays that hit each counted object, and the number of those that hit anything else.
    pub objects: Option<Vec<f32>>,
    /// The sum of the albedos of the surfaces that camera rays hit.
    pub albedos: Option<Vec<V3>>,
    /// The number of rays of paths.
    pub rays: Option<Vec<f32>>,
}

impl View {
    /// Returns the sums over samples of each pixel, and adds to the counts.
    pub fn render(
        &self,
        pixels: &[u32],
        samples: Range<u32>,
        work: &mut Work,
        counted: &mut Counted,
    ) -> Vec<Seen> {
        let mut all = vec![Seen::default(); pixels.len()];
        let kept = Kept {
            counts: counted.rays.is_some(),
            ..Kept::default()
        };
        self.each_block(pixels, samples, kept, work, |first, each, _, walks, _| {
            for (k, walks) in walks.list.chunks(each).enumerate() {
                let i = first + k;
                for walk in walks {
                    all[i].add(&walk.light, 1.0);
                    if let Some(objects) = &mut counted.objects {
                        self.count_object(i, walk.seen, objects);
                    }
                    if let Some(rays) = &mut counted.rays {
                        rays[i] += walk.rays as f32;
                    }
                }
            }
            if let Some(albedos) = &mut counted.albedos {
                for (sum, own) in albedos[first..].iter_mut().zip(walks.albedos.chunks(each)) {
                    own.iter().for_each(|&albedo| *sum += albedo);
                }
            }
        });
        all
    }

    /// Traces samples of pixels in blocks and calls `act` for each block: with the index of its first pixel, its number
    /// of samples of each pixel, and its paths.
    fn each_block(
        &self,
        pixels: &[u32],
        samples: Range<u32>,
        kept: Kept,
        work: &mut Work,
        mut act: impl FnMut(usize, usize, PathBlock, &Walks, &mut Work),
    ) {
        let tracer = self.tracer();
        let (mut walks, mut paths) = (Walks::default(), Paths::default());
        let together = TOGETHER.div_ceil(samples.len().clamp(1, RUN));
        for (block, pixels) in pixels.chunks(together).enumerate() {
            for samples in runs_of(&samples) {
                begin_paths(&tracer, pixels, samples.clone(), &mut paths);
                let mut of = PathBlock {
                    tracer: &tracer,
                    paths: &paths.list,
                    cones: &paths.cones,
                    bounce: 0,
                    kept,
                };
                of.camera_walks(&mut walks, work);
                act(block * together, samples.len(), of, &walks, work);
            }
        }
    }

    /// Returns the mean, over the pixels on which the loss depends, of the size of the derivative of the loss with
    /// respect to the pixel's radiance.
    pub fn typical(pixels: &[(u32, Seen)]) -> f32 {
        let all = pixels.iter();
        let all = all.map(|(_, g)| f64::from(g.radiance.abs().element_sum()));
        let positive = all.filter(|own| *own > 0.0 && own.is_finite());
        let (sum, count) = positive.fold((0.0, 0u32), |(sum, count), own| (sum + own, count + 1));
        (sum / f64::from(count.max(1))) as f32
    }

    /// Adds the derivatives of the sums over samples of pixels, each times the derivative of the loss with respect to
    /// that sum. `typical` is the mean of these derivatives over the image ([`View::typical`]). `searches` is the
    /// number of searches of each kind by a point that counts as much. `around` is the derivatives with respect to the means
    /// of all pixels, and the factor of those with respect to sums.
    pub fn backward(
        &self,
        pixels: &[(u32, Seen)],
        around: Option<(&PixelGradients, f32)>,
        (typical, searches): (f32, [f32; SEARCHED]),
        samples: Range<u32>,
        work: &mut Work,
        sums: &mut HostSums,
    ) {
        let around = around.filter(|_| !sums.is_forward());
        let sums = &sums.sums();
        let nonzero = pixels.iter().filter(|p| p.1 != Seen::default());
        let (pixels, gradients): (Vec<u32>, Vec<&Seen>) = nonzero.map(|(i, g)| (*i, g)).unzip();
        let kept = Kept {
            levels: true,
            ..Kept::default()
        };
        let go_back = |first: usize, each: usize, of: PathBlock, walks: &Walks, work: &mut Work| {
            let of_paths = (0..of.paths.len()).map(|k| gradients[first + k / each]);
            let upstream: Vec<&Seen> = of_paths.collect();
            let back = Return {
                of,
                walks,
                upstream: &upstream,
                around,
                typical,
                searches,
                sums,
            };
            back.go_back(work);
            for ((path, walk), upstream) in back.paths.iter().zip(&walks.list).zip(&upstream) {
                sums.add_values(path.numbers.pixel, upstream, &walk.light);
            }
        };
        self.each_block(&pixels, samples, kept, work, go_back);
    }

    /// Counts the object that a ray of the i-th pixel hit. The last count of a pixel is for the background and for
    /// objects that are not counted.
    fn count_object(&self, i: usize, triangle: u32, objects: &mut [f32]) {
        let lists = &self.scene.lists;
        let width = lists.counted.len() + 1;
        let hit = lists.triangles.get(triangle as usize);
        let found = hit.and_then(|words| lists.counted.binary_search(&(words[1] as usize)).ok());
        objects[i * width + found.unwrap_or(width - 1)] += 1.0;
    }
}

/// Divides samples into runs that are contiguous in the sequence.
fn runs_of(samples: &Range<u32>) -> impl Iterator<Item = Range<u32>> + use<> {
    let run = RUN as u32;
    let (start, end) = (samples.start, samples.end);
    (start / run..end.div_ceil(run)).map(move |k| {
        let past = (k * run).saturating_add(run);
        start.max(k * run)..end.min(past)
    })
}

/// Begins the paths of samples of pixels. The paths of a pixel are contiguous.
#[apply(stage!)]
fn begin_paths<'a>(
    tracer: &'a Tracer<'a>,
    pixels: &'a [u32],
    samples: Range<u32>,
    paths: &'a mut Paths,
) {
    let Paths { list, cones } = paths;
    list.clear();
    cones.clear();
    let (first, with_cones) = (samples.start, tracer.cone > 0.0);
    for &pixel in pixels {
        let numbers = tracer.settings.sampler.stream(pixel, first);
        for i in 0..samples.len() as u32 {
            let numbers = numbers.after(i);
            list.push(Path {
                time: exposure(&tracer.lists, &numbers).time,
                cones: list.len() as u32,
                numbers,
            });
        }
        if with_cones {
            let numbers = tracer.cones.stream(pixel, first);
            for i in 0..samples.len() as u32 {
                cones.push(numbers.after(i));
            }
        }
    }
}
