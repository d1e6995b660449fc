//! Slots for pieces of edges on the film: how many an edge has, and their order.

use rayon::prelude::*;

use crate::kernel::view::View;
use crate::model::film::OFFSET;
use crate::model::integers::morton;
use crate::trace::{FilmLine, FilmPiece, OF_SLOT, PIECES, film_line};

/// The largest length of a piece in pixels (approximate). Edges of simple scenes are no multiples of it, so that rounding
/// does not decide how many pieces they have.
const LENGTH: f32 = 8.17;
/// The largest ratio of the depths at the ends of a piece, as a logarithm to base 2, if lens or shutter displace near
/// points more than far ones.
const DEPTHS: f32 = 0.97;
/// The largest number of pieces of an edge, as a logarithm to base 2.
const MOST: f32 = 12.0;

/// The words of a slot.
pub type Slot = [u32; OF_SLOT];

/// Returns the place of a piece along a Z-order curve on the film, in quarters of pixels, with creases after
/// silhouettes.
fn place(piece: &FilmPiece, line: &FilmLine) -> u64 {
    // Film coordinates start at −2¹⁷.
    let quarter = |v: f32| (4.0 * (v + OFFSET) + 524_288.0).clamp(0.0, 1_048_575.0) as u32;
    let (x, y) = (quarter(piece.middle.x), quarter(piece.middle.y));
    u64::from(morton(x, y)) | (u64::from(line.jump < 1.0) << 63)
}

impl View {
    /// Returns what `take` takes of the slots for pieces of edges on the film. An edge has slots if it moves relative to
    /// the camera; how many depends only on its size on the film. Neighbors on the film are adjacent in the list, and
    /// creases come after silhouettes. So numbers that are spread evenly over pieces are spread evenly over the film.
    pub fn film_slots<T: Send>(
        &self,
        take: impl Fn(Slot, FilmPiece) -> Option<T> + Sync,
    ) -> Vec<T> {
        let Some(sets) = &self.edge_sets else {
            return Vec::new();
        };
        let (lists, radius) = (self.lists(), self.filter.radius());
        // If the camera moves, all edges move relative to it. Edges that rest jump before material that rays follow.
        let all = self.wanted.of.camera || lists.follows_on_film();
        let of_edge = |mut found: Vec<(u64, T)>, edge: usize| {
            if all || sets.edges.get(edge).moves(&self.scene, &self.wanted) {
                let line = film_line(&lists, &self.camera, radius, edge as u32);
                let log = self.log_pieces(&line);
                for number in 0..1 << log {
                    let piece = line.piece(&self.camera, number, log);
                    let place = place(&piece, &line);
                    let taken = take([edge as u32, number * PIECES + log], piece);
                    found.extend(taken.map(|taken| (place, taken)));
                }
            }
            found
        };
        let edges = (0..sets.edges.count).into_par_iter();
        let lists = edges.fold(Vec::new, of_edge);
        let mut all: Vec<(u64, T)> = lists.flatten_iter().collect();
        all.par_sort_by_key(|slot| slot.0);
        all.into_iter().map(|slot| slot.1).collect()
    }

    /// Returns the number of pieces of an edge, as a logarithm to base 2.
    fn log_pieces(&self, line: &FilmLine) -> u32 {
        if line.is_apart || !line.is_seen {
            return 0;
        }
        let mut count = line.length(&self.camera) / LENGTH;
        if self.features.lens || self.features.moves {
            let depths = line.first.z.log2() - line.last.z.log2();
            count = count.max(depths.abs() / DEPTHS);
        }
        count.log2().ceil().clamp(0.0, MOST) as u32
    }
}
