//! Surface points that receive light.

use super::cones::AtBounce;
use super::rays::Rays;
use super::surface::SurfacePoints;
use crate::geometry::Context;

/// Surface points, the rays that hit them, and their paths.
#[derive(Clone, Copy)]
pub(super) struct Shaded<'a> {
    pub points: &'a SurfacePoints,
    pub rays: &'a Rays,
    pub at: AtBounce<'a>,
}

impl Shaded<'_> {
    /// Calls a function with the listed points.
    pub fn of_some<T>(&self, context: &Context, which: &[u32], f: impl FnOnce(Shaded) -> T) -> T {
        let paths: Vec<_> = which.iter().map(|&i| self.at.paths[i as usize]).collect();
        f(Shaded {
            points: &self.points.pick(context, which),
            rays: &self.rays.pick(context, which),
            at: AtBounce {
                paths: &paths,
                ..self.at
            },
        })
    }
}
