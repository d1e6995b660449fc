//! Pixels of a view rendered, and their derivatives, as tasks of one core.

use std::ops::Range;

use super::gradient::HostSums;
use super::view::View;
use super::walk::Work;
use super::walk::{Path, Seen, Walks};
use crate::accel::{Machine, Task, dispatch};
use crate::sampling::{Numbers, RUN, Run};

impl View {
    /// Sums over samples of pixels. `objects` counts, for each pixel, what its rays hit.
    pub fn render(
        &self,
        pixels: &[u32],
        samples: Range<u32>,
        work: &mut Work,
        objects: Option<&mut [f32]>,
    ) -> Vec<Seen> {
        let forward = Forward {
            view: self,
            pixels,
            samples,
            work,
            objects,
        };
        dispatch(self.arch, forward)
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
        let backward = Backward {
            view: self,
            pixels,
            typical,
            samples,
            work,
            sums,
        };
        dispatch(self.arch, backward);
    }
}

/// [`View::render`] as a task.
struct Forward<'a> {
    view: &'a View,
    pixels: &'a [u32],
    samples: Range<u32>,
    work: &'a mut Work,
    objects: Option<&'a mut [f32]>,
}

impl Task for Forward<'_> {
    type Output = Vec<Seen>;

    #[inline(always)]
    fn run<M: Machine>(self, _machine: M) -> Vec<Seen> {
        let (view, pixels, samples, work) = (self.view, self.pixels, self.samples, self.work);
        let (tracer, mut objects) = (view.tracer(), self.objects);
        let mut all = vec![Seen::default(); pixels.len()];
        let mut walks = Walks::default();
        let (together, mut first) = (view.together(&samples), 0);
        while first < pixels.len() {
            let some = first..pixels.len().min(first + together);
            let mut from = samples.start;
            while from < samples.end {
                let past = next_run(from).min(samples.end);
                let runs = view.runs(pixels[some.clone()].iter().copied(), from);
                let paths = view.paths(&runs, from..past);
                tracer.camera_walks::<false>(&paths, &mut walks, work);
                for (k, walk) in walks.list.iter().enumerate() {
                    let i = first + k / (past - from) as usize;
                    walk.add_to(&mut all[i]);
                    if let Some(objects) = &mut objects {
                        view.count_object(i, walk.seen, objects);
                    }
                }
                from = past;
            }
            first = some.end;
        }
        all
    }
}

/// The first sample of the next run.
fn next_run(sample: u32) -> u32 {
    (sample - sample % RUN as u32).saturating_add(RUN as u32)
}

/// Paths that go together, about: so many that the machine has others to do while it waits for one.
const TOGETHER: usize = 16;

impl View {
    /// The number of pixels whose paths go together.
    fn together(&self, samples: &Range<u32>) -> usize {
        let of_pixel = (samples.end - samples.start).clamp(1, RUN as u32);
        TOGETHER.div_ceil(of_pixel as usize)
    }

    /// The random numbers of the run of samples that one of them is in, of some pixels.
    #[inline(always)]
    fn runs(&self, pixels: impl Iterator<Item = u32>, sample: u32) -> Vec<Run> {
        let first = sample - sample % RUN as u32;
        let mut runs = Vec::with_capacity(TOGETHER);
        for pixel in pixels {
            let samples = first..next_run(first);
            runs.push(self.settings.sampler.run(pixel, samples, self.drawn));
        }
        runs
    }

    /// Samples of all runs, those of one after another.
    #[inline(always)]
    fn paths<'a>(&'a self, runs: &'a [Run], samples: Range<u32>) -> Vec<Path<'a>> {
        let mut paths = Vec::with_capacity(runs.len() * RUN);
        for run in runs {
            for sample in samples.clone() {
                paths.push(self.path(run.numbers(sample)));
            }
        }
        paths
    }

    #[inline(always)]
    fn path<'a>(&'a self, numbers: Numbers<'a>) -> Path<'a> {
        let cones = (self.cone > 0.0).then(|| self.cones.numbers(numbers.path()));
        Path {
            time: self.time(&numbers),
            numbers,
            cones,
        }
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

/// [`View::backward`] as a task.
struct Backward<'a> {
    view: &'a View,
    pixels: &'a [(u32, Seen)],
    typical: f32,
    samples: Range<u32>,
    work: &'a mut Work,
    sums: &'a mut HostSums,
}

impl Task for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn run<M: Machine>(self, _machine: M) {
        let (view, samples, work) = (self.view, self.samples, self.work);
        let (tracer, sums) = (view.tracer(), &self.sums.sums());
        let mut walks = Walks::default();
        let asked: Vec<_> = self
            .pixels
            .iter()
            .filter(|p| p.1 != Seen::default())
            .collect();
        for some in asked.chunks(view.together(&samples)) {
            let mut from = samples.start;
            while from < samples.end {
                let past = next_run(from).min(samples.end);
                let runs = view.runs(some.iter().map(|p| p.0), from);
                let paths = view.paths(&runs, from..past);
                work.clear();
                tracer.camera_walks::<true>(&paths, &mut walks, work);
                for (k, (path, walk)) in paths.iter().zip(&walks.list).enumerate() {
                    let (_, upstream) = some[k / (past - from) as usize];
                    tracer.walk_backward(path, walk, (upstream, self.typical), work, sums);
                }
                from = past;
            }
        }
    }
}
