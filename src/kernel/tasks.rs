//! Pixels of a view rendered, and their derivatives, on one core.

use std::ops::Range;

use macro_rules_attribute::apply;

use super::backward::Return;
use super::gradient::HostSums;
use super::view::{Tracer, View};
use super::walk::{Path, PathBlock, Seen, TOGETHER, Walks, Work};
use crate::accel::stage;
use crate::sampling::{Numbers, RUN, Run};

impl View {
    /// Sums over samples of pixels. `objects` counts, for each pixel, what its rays hit.
    pub fn render(
        &self,
        pixels: &[u32],
        samples: Range<u32>,
        work: &mut Work,
        mut objects: Option<&mut [f32]>,
    ) -> Vec<Seen> {
        let mut all = vec![Seen::default(); pixels.len()];
        self.each_block(pixels, samples, false, work, |first, each, _, walks, _| {
            for (k, walk) in walks.list.iter().enumerate() {
                let i = first + k / each;
                walk.add_to(&mut all[i]);
                if let Some(objects) = &mut objects {
                    self.count_object(i, walk.seen, objects);
                }
            }
        });
        all
    }

    /// Traces samples of pixels, in blocks, and does something with each: with the place of its first pixel, its samples
    /// of each pixel, and its paths.
    fn each_block(
        &self,
        pixels: &[u32],
        samples: Range<u32>,
        keep: bool,
        work: &mut Work,
        mut act: impl FnMut(usize, usize, PathBlock, &Walks, &mut Work),
    ) {
        let tracer = self.tracer();
        let mut walks = Walks::default();
        let together = TOGETHER.div_ceil(samples.len().clamp(1, RUN));
        for (block, pixels) in pixels.chunks(together).enumerate() {
            for samples in runs_of(&samples) {
                let runs = draw_runs(&tracer, pixels, samples.start);
                let cones = self.cones(&runs, &samples);
                let paths = self.paths(&runs, &cones, &samples);
                let mut of = PathBlock::new(&tracer, &paths, keep);
                of.camera_walks(&mut walks, work);
                act(block * together, samples.len(), of, &walks, work);
            }
        }
    }

    /// The mean of how much a loss depends on the radiance of a pixel, over those that it depends on.
    pub fn typical(pixels: &[(u32, Seen)]) -> f32 {
        let (mut sum, mut count) = (0.0, 0u32);
        for (_, g) in pixels {
            let own = f64::from(g.radiance.abs().element_sum());
            if own > 0.0 && own.is_finite() {
                sum += own;
                count += 1;
            }
        }
        (sum / f64::from(count.max(1))) as f32
    }

    /// Adds the derivatives of sums over samples of pixels, each times the derivative of the loss by it.
    /// `typical` is their mean over the image ([`View::typical`]).
    pub fn backward(
        &self,
        pixels: &[(u32, Seen)],
        typical: f32,
        samples: Range<u32>,
        work: &mut Work,
        sums: &mut HostSums,
    ) {
        let sums = &sums.sums();
        let asked = pixels.iter().filter(|p| p.1 != Seen::default());
        let (pixels, gradients): (Vec<u32>, Vec<&Seen>) = asked.map(|(i, g)| (*i, g)).unzip();
        self.each_block(
            &pixels,
            samples,
            true,
            work,
            |first, each, of, walks, work| {
                let of_paths = (0..of.paths.len()).map(|k| gradients[first + k / each]);
                let upstream: Vec<&Seen> = of_paths.collect();
                let back = Return {
                    of,
                    walks,
                    upstream: &upstream,
                    typical,
                    sums,
                };
                back.go_back(work);
            },
        );
    }

    /// Random numbers for the cones of samples of all runs, if there are cones.
    fn cones(&self, runs: &[Run], samples: &Range<u32>) -> Vec<Numbers<'static>> {
        let with_cones = if self.cone > 0.0 { runs } else { &[] };
        let of_run = |run: &Run| {
            let pixel = run.pixel();
            samples.clone().map(move |s| self.cones.numbers((pixel, s)))
        };
        with_cones.iter().flat_map(of_run).collect()
    }

    /// Samples of all runs, those of one after another.
    fn paths<'a>(
        &'a self,
        runs: &'a [Run],
        cones: &'a [Numbers<'static>],
        samples: &Range<u32>,
    ) -> Vec<Path<'a>> {
        let mut paths = Vec::with_capacity(runs.len() * samples.len());
        for run in runs {
            for sample in samples.clone() {
                let numbers = run.numbers(sample);
                paths.push(Path {
                    time: self.time(&numbers),
                    cones: cones.get(paths.len()),
                    numbers,
                });
            }
        }
        paths
    }

    /// Counts an object that a ray of the i-th pixel hit; the last is the background.
    fn count_object(&self, i: usize, triangle: u32, objects: &mut [f32]) {
        let lists = &self.scene.lists;
        let width = lists.counted.len() + 1;
        let k = match lists.triangles.get(triangle as usize) {
            Some(&[_, object, ..]) => {
                let found = lists.counted.binary_search(&(object as usize));
                found.unwrap_or(width - 1)
            }
            None => width - 1,
        };
        objects[i * width + k] += 1.0;
    }
}

/// Samples in runs, whose numbers are drawn at once.
fn runs_of(samples: &Range<u32>) -> impl Iterator<Item = Range<u32>> + use<> {
    let run = RUN as u32;
    let (start, end) = (samples.start, samples.end);
    (start / run..end.div_ceil(run)).map(move |k| {
        let past = (k * run).saturating_add(run);
        start.max(k * run)..end.min(past)
    })
}

/// The random numbers of the run of samples that one of them is in, of some pixels.
#[apply(stage!)]
fn draw_runs<'a>(tracer: &'a Tracer<'a>, pixels: &'a [u32], sample: u32) -> Vec<Run> {
    let first = sample - sample % RUN as u32;
    let mut runs = Vec::with_capacity(pixels.len());
    for &pixel in pixels {
        let samples = first..first.saturating_add(RUN as u32);
        let run = tracer.settings.sampler.run(pixel, samples, tracer.drawn);
        runs.push(run);
    }
    runs
}
