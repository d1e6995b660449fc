//! Jumps of the image that the camera sees.
//!
//! Edges are drawn on the film: where they are seen, in proportion to their length there, to how much may
//! jump at them and to how much the loss depends on the pixels about. So no sample is spent where nothing
//! is asked, and the noise does not depend on how wide the camera's cone is.

use std::ops::Range;

use super::film_edges::FilmEdges;
use super::jumps::Approach;
use super::pieces::PixelGradients;
use crate::accel::{Machine, Task, dispatch};
use crate::kernel::gradient::HostSums;
use crate::kernel::view::{Tracer, View};
use crate::kernel::walk::{Path, Seen, Work};
use crate::sampling::Dimensions;
use crate::trace::{Sums, film_point};

/// [`View::film_backward`] as a task.
struct FilmSamples<'a> {
    view: Tracer<'a>,
    edges: &'a FilmEdges,
    pixels: &'a PixelGradients,
    range: Range<u32>,
    count: u32,
    work: &'a mut Work,
    sums: Sums<'a>,
}

impl Task for FilmSamples<'_> {
    type Output = ();

    #[inline(always)]
    fn run<M: Machine>(mut self, _machine: M) {
        for i in self.range.clone() {
            self.sample(i);
        }
    }
}

impl FilmSamples<'_> {
    /// Adds the derivatives by one sample.
    #[inline(always)]
    fn sample(&mut self, sample: u32) {
        let view = &self.view;
        let numbers = view.film.numbers((0, sample));
        let path = Path {
            time: view.time(&numbers),
            cones: (view.cone > 0.0).then(|| view.cones.numbers((u32::MAX, sample))),
            numbers,
        };
        let (lists, c, time) = (&view.lists, &view.camera, path.time);
        let lens = view.lens_point(&path.numbers);
        let drawn = path.numbers.draw(Dimensions::film());
        let Some(drawn) = self.edges.choose(drawn.x, drawn.y) else {
            return;
        };
        let (edge, per_density) = (drawn.edge as u32, drawn.per_density / self.count as f32);
        let mut point = film_point(lists, c, edge, drawn.lambda, per_density, lens, time);
        if !point.is_seen {
            return;
        }
        // The pixel whose ray would come here.
        let kernel = view.edges.numbers((u32::MAX, sample));
        let kernel = kernel.draw(Dimensions::of_set(0));
        point.project(c, kernel.x, kernel.y, view.filter.radius());
        let g = self.pixels.get(point.film.x, point.film.y);
        let Some(g) = g.filter(|g| **g != Seen::default()) else {
            return;
        };
        let direction = point.point.to.normalize();
        let sides = &point.sides(lists, c, direction, time);
        let approach = Approach {
            point: &point.point,
            origin: point.origin,
            view: direction,
            sides,
        };
        let work = &mut *self.work;
        let Some(light) = view.light_beside(&approach, &path, Some(0), true, work) else {
            return;
        };
        let jump = g.jump(&light);
        let scale = jump * point.point.per_density;
        if scale.is_finite() && scale != 0.0 {
            point.backward(lists, &self.sums, c, jump, time);
        }
    }
}

impl View {
    /// Adds the derivatives by jumps on the film: samples `range` of `count`.
    pub fn film_backward(
        &self,
        edges: &FilmEdges,
        pixels: &PixelGradients,
        range: Range<u32>,
        count: u32,
        work: &mut Work,
        sums: &mut HostSums,
    ) {
        let samples = FilmSamples {
            view: self.tracer(),
            edges,
            pixels,
            range,
            count,
            work,
            sums: sums.sums(),
        };
        dispatch(self.arch, samples);
    }
}
