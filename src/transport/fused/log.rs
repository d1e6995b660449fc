//! What the rays of a tile found, kept from the forward pass for the backward pass.

use std::sync::Arc;

use crate::visibility::{Finder, HostRay, Span, Surface};

/// The triangles that the rays of a tile found, ray by ray in the order in which they are traced: how
/// many, and which. With it paths are traced again without looking for them.
#[derive(Default)]
pub(crate) struct TileLog {
    found: Vec<u32>,
    /// Where each pixel begins.
    pixels: Vec<usize>,
}

impl TileLog {
    /// In bytes.
    pub(crate) fn size(&self) -> usize {
        4 * self.found.len() + 8 * self.pixels.len()
    }
}

/// What is done with such a log.
#[derive(Default)]
pub(crate) enum Log {
    #[default]
    None,
    Write(TileLog),
    /// The log, and what is next in it.
    Read(Arc<TileLog>, usize),
}

impl Log {
    /// Goes to a pixel of the tile.
    pub(super) fn begin_pixel(&mut self, pixel: usize) {
        match self {
            Self::None => {}
            Self::Write(log) => log.pixels.push(log.found.len()),
            Self::Read(log, next) => *next = log.pixels[pixel],
        }
    }

    /// The surfaces that a ray meets, added to others.
    #[inline]
    pub(super) fn meet(
        &mut self,
        finder: &Finder,
        ray: &HostRay,
        span: Span,
        surfaces: &mut Vec<Surface>,
    ) -> u32 {
        match self {
            Self::Read(log, next) => {
                let first = *next + 1;
                *next = first + log.found[*next] as usize;
                if *next > first {
                    finder.meet_known(ray, span, &log.found[first..*next], surfaces);
                }
                0
            }
            Self::None => finder.meet(ray, span, surfaces),
            Self::Write(log) => {
                let first = surfaces.len();
                let offered = finder.meet(ray, span, surfaces);
                log.found.push((surfaces.len() - first) as u32);
                for s in &surfaces[first..] {
                    log.found.push(s.triangle);
                }
                offered
            }
        }
    }
}
