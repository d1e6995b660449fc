//! The work of a render on a GPU, and its division into pieces.

use std::sync::Arc;

use softray_kernels::cube::*;

use super::device::List;
use super::packed::Packed;
use softray_kernels::trace::{Features, Fours, HeaderWord, Scene};

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
    /// The width of images whose pixels are rendered in tiles, otherwise 0.
    tiled: u32,
    #[cube(comptime)]
    pub listed: bool,
}

/// The width and height of the tiles of pixels that neighboring threads take. Their rays are more alike than those of a
/// row of pixels, so threads of a warp wait less for each other.
const TILE: [u32; 2] = [8, 4];
/// The smallest number of rows of tiles in pieces of whole tiles. Pieces become smaller by less than a quarter.
const LEAST_ROWS: usize = 4;

/// Returns the pixel at a place in the order of tiles. Tiles come row by row, and pixels of a tile in Morton order.
#[cube]
fn in_tiles(place: u32, width: u32) -> u32 {
    let (columns, rows) = comptime!((TILE[0], TILE[1]));
    let of_row = place % (rows * width);
    let of_tile = of_row % comptime!(columns * rows);
    let x = (of_tile & 1) | ((of_tile >> 1) & 2) | ((of_tile >> 2) & 4);
    let y = ((of_tile >> 1) & 1) | ((of_tile >> 2) & 2);
    place - of_row + y * width + of_row / comptime!(columns * rows) * columns + x
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
        let mut row = self.piece.first + thread % self.piece.count * self.piece.stride;
        if self.tiled > 0 {
            row = in_tiles(row, self.tiled);
        }
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

    /// Divides all samples into pieces of at most `paths` paths, but of at least one path. Large pieces consist of whole
    /// tiles, if images do.
    pub(super) fn pieces(&self, paths: usize) -> Vec<Piece> {
        let mut at_once = paths.clamp(1, self.count().max(1));
        if at_once >= LEAST_ROWS * self.of_tiles() {
            at_once -= at_once % self.of_tiles();
        }
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

    fn width(&self) -> u32 {
        self.views.buffers.header()[HeaderWord::width as usize]
    }

    /// Returns the number of pixels in a row of tiles, or 1 if pixels are listed or an image does not consist of whole tiles.
    fn of_tiles(&self) -> usize {
        let [columns, rows] = TILE;
        let of_row = rows as usize * self.width() as usize;
        let whole = self.width().is_multiple_of(columns) && self.of_view.is_multiple_of(of_row);
        if whole && self.pixels.is_none() {
            of_row
        } else {
            1
        }
    }

    /// Returns the paths of a piece as a kernel argument.
    pub(super) fn paths(&self, client: &Client, lists: &[List; 3], p: Piece) -> PathsLaunch {
        let of_tiles = self.of_tiles();
        let mut pixels = [p.first, p.count].into_iter();
        let whole = pixels.all(|n| (n as usize).is_multiple_of(of_tiles));
        let tiled = of_tiles > 1 && p.stride == 1 && whole;
        PathsLaunch::new(
            self.views(client, lists, self.views.features),
            lists[2].argument(),
            PieceLaunch::new(p.first, p.stride, p.count, p.from, p.past, p.each),
            self.of_view as u32,
            if tiled { self.width() } else { 0 },
            self.pixels.is_some(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each pixel has one place, and 32 places from a multiple of 32 on are those of a tile.
    #[test]
    fn pixels_in_the_order_of_tiles() {
        let width = 24;
        let mut pixels: Vec<u32> = (0..8 * width).map(|place| in_tiles(place, width)).collect();
        for (tile, of_tile) in pixels.chunks(32).enumerate() {
            let tile = tile as u32;
            let first = tile / 3 * 4 * width + tile % 3 * 8;
            let inside = |pixel: &u32| {
                let (x, y) = (pixel % width, pixel / width);
                x / 8 == first % width / 8 && y / 4 == first / width / 4
            };
            assert!(of_tile.iter().all(inside), "{tile}");
        }
        pixels.sort_unstable();
        assert!(pixels.into_iter().eq(0..8 * width));
    }
}
