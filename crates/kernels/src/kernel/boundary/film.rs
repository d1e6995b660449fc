//! Jumps of the image that the camera sees.
//!
//! Edges are drawn on the film in proportion to their visible length there, to the bound of their jump, and to how much
//! the loss depends on the pixels around them. So no sample falls where the loss does not depend on the pixels, and the
//! noise does not depend on the width of the camera's cone.

use std::ops::Range;

use macro_rules_attribute::apply;

use super::beside::light_beside;
use super::film_edges::FilmEdges;
use crate::accel::stage;
use crate::kernel::gradient::HostSums;
use crate::kernel::pixels::PixelGradients;
use crate::kernel::shares::ON_FILM as FILM;
use crate::kernel::view::{Tracer, View};
use crate::kernel::walk::{Path, Seen, TOGETHER, Work};
use crate::sampling::{Dimensions, Stream};
use crate::trace::{
    Approach, Exposure, FilmPoint, NO_PIXEL, ON_FILM, Sums, exposure, film_point, sampler,
};

/// The data from which samples of edges on the film are drawn.
struct FilmSamples<'a> {
    edges: &'a FilmEdges,
    pixels: &'a PixelGradients,
    count: u32,
}

/// Points of edges on the film, the derivatives of the loss with respect to the pixels that see them, and the paths and
/// rays that reach them.
#[derive(Default)]
struct FilmPoints<'a> {
    points: Vec<(FilmPoint, &'a Seen)>,
    approaches: Vec<Approach>,
    paths: Vec<Path>,
    cones: Vec<Stream>,
}

impl FilmSamples<'_> {
    /// Returns the point of an edge that a sample draws, if the loss depends on it.
    #[inline(always)]
    fn sample(
        &self,
        view: &Tracer,
        sample: u32,
        numbers: &Stream,
        at: &Exposure,
    ) -> Option<(FilmPoint, &Seen)> {
        let (lists, c) = (&view.lists, &view.camera);
        let drawn = numbers.numbers(Dimensions::film());
        let (edge, on) = self.edges.choose(drawn.x, drawn.y)?;
        let mut point = film_point(lists, c, edge, on, self.count, at);
        if !point.is_seen {
            return None;
        }
        point.project(lists, c, sample, view.filter.radius());
        let g = self.pixels.get(point.film.x, point.film.y)?;
        (*g != Seen::default()).then_some((point, g))
    }
}

/// Draws points of edges for a range of samples.
#[apply(stage!)]
fn draw<'a>(
    view: &'a Tracer<'a>,
    film: &'a FilmSamples<'a>,
    samples: Range<u32>,
) -> FilmPoints<'a> {
    let mut drawn = FilmPoints::default();
    for sample in samples {
        let numbers = sampler(&view.lists, ON_FILM).of_one_pixel();
        let numbers = numbers.stream(0, sample);
        let at = exposure(&view.lists, &numbers);
        if let Some((mut point, g)) = film.sample(view, sample, &numbers, &at) {
            let approach = point.approach(&view.lists, &view.camera, at.time);
            drawn.points.push((point, g));
            drawn.approaches.push(approach);
            drawn.paths.push(Path {
                time: at.time,
                cones: drawn.cones.len() as u32,
                numbers,
            });
            if view.features.cones {
                drawn.cones.push(view.cones.stream(NO_PIXEL, sample));
            }
        }
    }
    drawn
}

/// Adds the derivatives from jumps at points of edges on the film. Returns the sum of the squared derivatives with
/// respect to these points.
#[apply(stage!)]
fn backward<'a>(
    view: &'a Tracer<'a>,
    drawn: &'a FilmPoints<'a>,
    work: &'a Work,
    sums: &'a Sums<'a>,
) -> f64 {
    let mut squares = 0.0;
    let points = drawn.points.iter().zip(&drawn.paths);
    for (((point, g), path), light) in points.zip(&work.side_lights) {
        if let Some(light) = light {
            let pixel = point.film.y as u32 * view.settings.width + point.film.x as u32;
            for channel in 0..sums.channels() {
                let g = &sums.of_channel(g, channel);
                sums.select(pixel, channel);
                let (c, time) = (&view.camera, path.time);
                let largest = point.backward(&view.lists, sums, c, g, light, time);
                squares += f64::from(largest).powi(2);
            }
        }
    }
    squares
}

impl View {
    /// Adds the derivatives from jumps on the film, for the samples `range` of `count`.
    pub fn film_backward(
        &self,
        edges: &FilmEdges,
        pixels: &PixelGradients,
        range: Range<u32>,
        count: u32,
        work: &mut Work,
        sums: &mut HostSums,
    ) {
        let (tracer, sums) = (self.tracer(), sums.sums());
        let film = FilmSamples {
            edges,
            pixels,
            count,
        };
        for from in range.clone().step_by(TOGETHER) {
            let past = range.end.min(from.saturating_add(TOGETHER as u32));
            let drawn = draw(&tracer, &film, from..past);
            let paths = (&*drawn.paths, &*drawn.cones);
            let rays = light_beside(&tracer, &drawn.approaches, paths, Some(0), true, work);
            let squares = backward(&tracer, &drawn, work, &sums);
            work.yields.edges[FILM].add(squares, rays);
        }
    }
}
