//! Jumps of the image that the camera sees.
//!
//! Edges are drawn on the film: where they are seen, in proportion to their length there, to how much may
//! jump at them and to how much the loss depends on the pixels about. So no sample is spent where nothing
//! is asked, and the noise does not depend on how wide the camera's cone is.

use std::ops::Range;

use super::edge_point::EdgePoint;
use super::film_edges::FilmEdges;
use super::pieces::PixelGradients;
use crate::accel::{Hit, Machine, Task, dispatch};
use crate::kernel::gradient::Sums;
use crate::kernel::view::View;
use crate::kernel::walk::{Path, Seen, Work};
use crate::model::camera::CameraGradient;
use crate::model::filter::film_kernel;
use crate::model::jumps::Sides;
use crate::model::{V2, V3, v2};
use crate::sampling::Dimensions;

/// [`View::film_backward`] as a task.
struct FilmSamples<'a> {
    view: &'a View,
    edges: &'a FilmEdges,
    pixels: &'a PixelGradients,
    range: Range<u32>,
    count: u32,
    work: &'a mut Work,
    sums: &'a mut Sums,
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
        let view = self.view;
        let numbers = view.film.numbers((0, sample));
        let path = Path {
            time: view.time(&numbers),
            cones: (view.cone > 0.0).then(|| view.cones.numbers((u32::MAX, sample))),
            numbers,
        };
        let lens = view.lens_point(&path.numbers);
        let Some((point, origin)) = view.film_point(self.edges, &path, lens, self.count) else {
            return;
        };
        // The pixel whose ray would come here.
        let V2 {
            x: film_x,
            y: film_y,
        } = view.camera.project(point.position, lens.x, lens.y);
        let drawn = view
            .edges
            .numbers((u32::MAX, sample))
            .draw(Dimensions::of_set(0));
        let radius = view.filter.radius();
        let kernel = v2(film_kernel(drawn.x), film_kernel(drawn.y));
        let (x, y) = (film_x - radius * kernel.x, film_y - radius * kernel.y);
        let Some(g) = self.pixels.get(x, y).filter(|g| **g != Seen::default()) else {
            return;
        };
        let direction = point.to.normalize();
        let V2 {
            x: along_x,
            y: along_y,
        } = view
            .camera
            .project_along(point.position, point.edge.along, lens.x, lens.y);
        // To the right of the edge's image, on a film whose y points down.
        let side = view.camera.across * along_y + view.camera.upward * along_x;
        let sides = view.sides(&point, direction, side, path.time);
        let Some(behind) = view.behind(&point, origin, sides.past, path.time) else {
            return;
        };
        let [minus, plus] = view.seen_beside(
            &point,
            &sides,
            behind,
            (origin, direction),
            &path,
            self.work,
        );
        let jump = g.radiance.dot(minus.radiance - plus.radiance)
            + g.opacity * (minus.opacity - plus.opacity)
            + g.depth * (minus.depth - plus.depth)
            + g.normal.dot(minus.normal - plus.normal);
        let scale = jump * point.per_density;
        if !scale.is_finite() || scale == 0.0 {
            return;
        }
        let by_film = v2(along_y * scale, -along_x * scale);
        let mut camera = CameraGradient::default();
        let by_point =
            view.camera
                .project_backward(point.position, lens.x, lens.y, by_film, &mut camera);
        if view.wanted.camera {
            // A wider filter moves its points away from the middle, past the edge.
            camera.filter -= by_film.x * kernel.x + by_film.y * kernel.y;
            self.sums.camera += camera.into();
        }
        view.add_to_edge(&point, by_point, path.time, self.sums);
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
        sums: &mut Sums,
    ) {
        let samples = FilmSamples {
            view: self,
            edges,
            pixels,
            range,
            count,
            work,
            sums,
        };
        dispatch(self.arch, samples);
    }

    /// Draws a point of an edge before the camera, and the start of the ray that comes to it through a point
    /// of the lens.
    #[inline(always)]
    fn film_point(
        &self,
        edges: &FilmEdges,
        path: &Path,
        lens: V2,
        count: u32,
    ) -> Option<(EdgePoint, V3)> {
        let sets = self.edge_sets.as_ref()?;
        let drawn = path.numbers.draw(Dimensions::film());
        let drawn = edges.choose(drawn.x, drawn.y)?;
        let edge = sets.edges[drawn.edge].at_time(&self.scene, path.time)?;
        let shift = self.scene.shift(edge.faces[0], path.time);
        let position = edge.a + edge.along * drawn.lambda + shift;
        let origin = self.camera.origin_towards(position, lens.x, lens.y);
        let point = EdgePoint {
            edge,
            lambda: drawn.lambda,
            per_density: drawn.per_density / count as f32,
            to: position - origin,
            position,
        };
        let before = point.to.dot(self.camera.dual.z) > 0.0;
        before.then_some((point, origin))
    }

    /// The surfaces and the light that a camera ray sees on both sides of an edge's point.
    #[inline(always)]
    fn seen_beside(
        &self,
        point: &EdgePoint,
        sides: &Sides,
        behind: Hit,
        (origin, view): (V3, V3),
        path: &Path,
        work: &mut Work,
    ) -> [Seen; 2] {
        let mut walks = std::mem::take(&mut work.side_walks);
        self.walks_beside(point, sides, behind, (origin, view), path.time, &mut walks);
        for walk in &mut walks.list {
            walk.radiance = if walk.on_surface {
                self.emission(&walk.point)
            } else {
                self.scene.sky.at(view)
            };
        }
        self.reflected::<false>(&[*path; 2], &mut walks, 0, work);
        let mut seen = [Seen::default(); 2];
        for (seen, walk) in seen.iter_mut().zip(&walks.list) {
            seen.add(walk);
        }
        work.side_walks = walks;
        seen
    }
}
