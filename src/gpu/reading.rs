//! What kernels read from lists: vectors, triangles, and places among numbers that grow.

use burn::cubecl::{self, prelude::*};

use super::Features;
use super::layout::{FLOAT_HEADER, HEADER, SURFACE_STRIDE, SURFACES, TABLES};
use crate::model::V3;
pub(super) use crate::model::lists::vector;
use crate::model::triangle::weights_at;

/// A scene as a camera sees it, as two lists ([`layout`](super::layout)), and what kernels of it are compiled for.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Scene<'a> {
    /// Words of the view's header, and its floats: the camera, and settings.
    pub header: &'a [u32],
    pub settings: &'a [f32],
    /// The lists that places in the header are of.
    pub floats: &'a [f32],
    pub words: &'a [u32],
    /// The points of the Sobol sequence.
    pub points: &'a [u32],
    #[cube(comptime)]
    pub features: Features,
}

#[cube]
impl<'a> Scene<'a> {
    /// A view of those in two buffers.
    pub fn new(
        floats: &'a [f32],
        words: &'a [u32],
        view: u32,
        #[comptime] features: Features,
    ) -> Scene<'a> {
        let header = &words[view as usize * HEADER..];
        Scene::<'a> {
            header,
            settings: &floats[view as usize * FLOAT_HEADER..],
            floats,
            words,
            points: &words[header[TABLES] as usize..],
            features,
        }
    }

    /// A vector of the list of floats.
    pub fn vector(&self, at: u32) -> V3 {
        vector(self.floats, at)
    }
}

/// Weights of a triangle's corners in a point of it, at the start of the shutter.
#[cube]
pub(super) fn weights_in(scene: &Scene, triangle: u32, at_rest: V3) -> V3 {
    let at = scene.header[SURFACES] + SURFACE_STRIDE as u32 * triangle;
    weights_at(
        scene.vector(at),
        scene.vector(at + 3),
        scene.vector(at + 6),
        scene.vector(at + 9),
        scene.floats[at as usize + 13],
        at_rest,
    )
}
