//! The work of a render on a GPU, and its division into pieces.

use std::sync::Arc;

use crate::cube::*;

use super::device::List;
use super::packed::Packed;
use crate::trace::{Features, Fours, Scene};

/// The requested rows of an image beside radiance.
#[derive(Clone, Copy, Debug, Hash, PartialEq, Eq)]
pub(crate) struct Outputs {
    pub opacity: bool,
    pub depth: bool,
    pub normals: bool,
    pub albedo: bool,
    /// The number of rows for shares of objects, including the background; 0 if they are not requested.
    pub objects: usize,
    /// Whether the last row is the number of rays.
    pub rays: bool,
}

impl Outputs {
    pub fn rows(self) -> usize {
        3 + usize::from(self.opacity)
            + usize::from(self.depth)
            + 3 * (usize::from(self.normals) + usize::from(self.albedo))
            + self.objects
            + usize::from(self.rays)
    }

    /// Returns the number of backward passes along a path: one for a loss, and in forward mode one for each channel.
    pub fn channels(self, forward: bool) -> u32 {
        if forward { self.rows() as u32 } else { 1 }
    }

    /// Returns how many of these passes have derivatives of radiance, which may jump at edges that surfaces see.
    pub fn channels_of_radiance(forward: bool) -> u32 {
        if forward { 3 } else { 1 }
    }
}

/// Views, with the pixels, samples and outputs to render.
#[derive(Clone)]
pub(crate) struct Job {
    pub views: Arc<Packed>,
    /// The pixels to render in each view, or `None` for all pixels.
    pub pixels: Option<Arc<Vec<u32>>>,
    /// The number of pixels to render in each view.
    pub of_view: usize,
    /// The first sample of each pixel, and the number of samples.
    pub from: u32,
    pub samples: u32,
    pub outputs: Outputs,
    /// Whether the backward pass reads back the number of searches for edges.
    pub statistics: bool,
}

/// Maximum number of paths in a launch, which limits the duration of a launch.
pub(super) const PATHS: usize = 1 << 20;

/// The part of a job that one launch computes: samples of pixels. Pixels are numbered over all views.
#[apply(argument!)]
pub(super) struct Piece {
    /// The first pixel, the distance to the next pixel, and the number of pixels.
    pub first: u32,
    pub stride: u32,
    pub count: u32,
    /// The first sample of each pixel, and the end of the samples (exclusive).
    pub from: u32,
    pub past: u32,
    /// The number of samples of a pixel that one thread computes.
    pub each: u32,
}

#[cube]
impl Piece {
    pub fn threads(&self) -> u32 {
        self.count * (self.past - self.from).div_ceil(self.each)
    }
}

/// Joins pieces of the same pixels whose samples follow each other, to pieces of at most so many paths.
pub(super) fn joined(pieces: Vec<Piece>, paths: usize) -> Vec<Piece> {
    let mut all: Vec<Piece> = Vec::new();
    for piece in pieces {
        match all.last_mut() {
            Some(last)
                if (last.first, last.past) == (piece.first, piece.from)
                    && last.count as usize * (piece.past - last.from) as usize <= paths =>
            {
                last.past = piece.past;
            }
            _ => all.push(piece),
        }
    }
    all
}

/// Views as a kernel argument.
#[apply(argument!)]
pub(super) struct Views {
    floats: &'static [f32],
    words: &'static [u32],
    /// The floats by four, if kernels can bind them so.
    fours: Fours<'static>,
    #[cube(comptime)]
    features: Features,
}

#[cube]
impl Views {
    pub fn scene(&self, view: u32) -> Scene<'static> {
        Scene::of_view(
            self.floats,
            self.words,
            self.fours,
            view,
            comptime!(self.features),
        )
    }
}

/// The paths of a launch as a kernel argument.
#[apply(argument!)]
pub(super) struct Paths {
    pub views: Views,
    /// The pixels to render in each view, if `listed`; otherwise all pixels are rendered.
    pixels: &'static [u32],
    pub piece: Piece,
    of_view: u32,
    #[cube(comptime)]
    listed: bool,
}

/// The first path of a thread.
#[apply(record!)]
pub(super) struct PathAt {
    /// The index of its pixel among the pixels of all views.
    pub row: u32,
    pub view: u32,
    pub pixel: u32,
    pub sample: u32,
}

#[cube]
impl Paths {
    pub fn of_thread(&self, thread: u32) -> PathAt {
        let row = self.piece.first + thread % self.piece.count * self.piece.stride;
        let mut pixel = row % self.of_view;
        if comptime!(self.listed) {
            pixel = self.pixels[pixel as usize];
        }
        PathAt {
            row,
            view: row / self.of_view,
            pixel,
            sample: self.piece.from + thread / self.piece.count * self.piece.each,
        }
    }
}

impl Job {
    /// Returns the number of pixels to render in all views.
    pub fn count(&self) -> usize {
        self.views.views * self.of_view
    }

    /// Divides all samples into pieces of at most `paths` paths, but of at least one path.
    pub(super) fn pieces(&self, paths: usize) -> Vec<Piece> {
        let at_once = paths.clamp(1, self.count().max(1));
        let samples_at_once = (paths / at_once).max(1) as u32;
        let mut pieces = Vec::new();
        for first in (0..self.count()).step_by(at_once) {
            let (mut from, all) = (self.from, self.from + self.samples);
            while from < all {
                let past = all.min(from.saturating_add(samples_at_once));
                pieces.push(Piece {
                    first: first as u32,
                    stride: 1,
                    count: at_once.min(self.count() - first) as u32,
                    from,
                    past,
                    each: 1,
                });
                from = past;
            }
        }
        pieces
    }

    /// Returns the lists of the views and the list of the pixels, on the device.
    pub(super) fn lists(&self, client: &Client) -> [List; 3] {
        let [floats, words, none] = self.views.buffers.on_device(client);
        let pixels = self.pixels.as_ref();
        let pixels = pixels.map(|pixels| List::send(client, [u32::as_bytes(pixels)]));
        let [pixels] = pixels.unwrap_or([none]);
        [floats, words, pixels]
    }

    /// Returns the views as an argument for kernels that use `features`.
    pub(super) fn views(
        &self,
        client: &Client,
        [floats, words, _]: &[List; 3],
        features: Features,
    ) -> ViewsLaunch {
        // Traversal and draws load floats by four. Without boxes, there are few triangles and edges.
        let fours = features.boxes.then(|| floats.fours(client)).flatten();
        ViewsLaunch::new(floats.argument(), words.argument(), fours.into(), features)
    }

    /// Returns the paths of a piece as a kernel argument.
    pub(super) fn paths(&self, client: &Client, lists: &[List; 3], p: Piece) -> PathsLaunch {
        PathsLaunch::new(
            self.views(client, lists, self.views.features),
            lists[2].argument(),
            PieceLaunch::new(p.first, p.stride, p.count, p.from, p.past, p.each),
            self.of_view as u32,
            self.pixels.is_some(),
        )
    }
}
