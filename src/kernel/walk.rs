//! The state of paths on their way.

use super::surface::Point;
use crate::accel::NOTHING;
use crate::model::V3;
use crate::model::bsdf::Scatter;
use crate::model::camera::CameraRay;
use crate::model::cone::Bend;
use crate::sampling::Numbers;

/// The constants of a path.
#[derive(Clone, Copy)]
pub(crate) struct Path<'a> {
    pub numbers: Numbers<'a>,
    /// Random numbers for the kernels of cones.
    pub cones: Option<Numbers<'a>>,
    /// Time in the shutter.
    pub time: f32,
}

/// A path on its way.
#[derive(Clone)]
pub(crate) struct Walk {
    pub camera: CameraRay,
    /// The triangle that the camera ray hit, or [`NOTHING`].
    pub seen: u32,
    /// The surface point that the path came to, if it did.
    pub point: Point,
    /// The start of rays from there.
    pub start: V3,
    pub on_surface: bool,
    /// Distance and geometric normal of the first surface.
    pub first: (f32, V3),
    pub throughput: V3,
    /// The light that it brought back so far.
    pub radiance: V3,
    /// Random numbers for the next emitter.
    pub emitter: [f32; 2],
    pub scatter: Scatter,
    pub bend: Bend,
    /// Its last point among those that are kept.
    pub vertex: usize,
}

impl Walk {
    pub fn new() -> Self {
        Self {
            camera: CameraRay::default(),
            seen: NOTHING,
            point: Point::default(),
            start: V3::ZERO,
            on_surface: false,
            first: (0.0, V3::ZERO),
            throughput: V3::ONE,
            radiance: V3::ZERO,
            emitter: [0.0; 2],
            scatter: Scatter::default(),
            bend: Bend::default(),
            vertex: usize::MAX,
        }
    }

    /// The path comes to a surface point.
    #[inline(always)]
    pub fn arrive(&mut self, point: Point) {
        self.start = point.start();
        self.point = point;
    }

    /// The path comes to its first surface point.
    #[inline(always)]
    pub fn begin_at(&mut self, point: Point) {
        self.first = (point.t, point.shading.geometric);
        self.arrive(point);
        self.on_surface = true;
    }
}

/// Paths that go together.
#[derive(Default)]
pub(crate) struct Walks {
    pub list: Vec<Walk>,
    pub alive: Vec<u32>,
}

impl Walks {
    pub fn clear(&mut self) {
        self.list.clear();
        self.alive.clear();
    }
}

/// The surface that a camera ray sees, and the light that its path brings back.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Seen {
    pub radiance: V3,
    /// 1 where there is a surface.
    pub opacity: f32,
    /// The distance to it.
    pub depth: f32,
    /// Its geometric normal on the side that is seen.
    pub normal: V3,
}

impl Seen {
    /// Adds the surface that a path's camera ray saw and the light that it brought back.
    #[inline(always)]
    pub fn add(&mut self, walk: &Walk) {
        self.radiance += walk.radiance;
        if walk.seen != NOTHING {
            let first = &walk.first;
            self.opacity += 1.0;
            self.depth += first.0;
            self.normal += first.1;
        }
    }
}
