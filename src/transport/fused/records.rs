//! What paths leave behind for the way back.

use std::ops::Range;

use glam::DVec3;

use super::log::Log;
use super::shading::{Scatter, Shade};
use crate::transport::Census;
use crate::visibility::{PullScratch, Surface};

/// A ray whose surfaces were weighed.
#[derive(Clone, Debug)]
pub(super) struct Ray {
    pub origin: DVec3,
    pub direction: DVec3,
    /// In order of depth, in `Work::surfaces`.
    pub surfaces: Range<usize>,
    /// W of the background.
    pub background: f64,
    /// far − near.
    pub depth: f64,
}

impl Ray {
    /// Whether all of its weight is one surface's, which small changes don't change.
    pub fn is_whole(&self) -> bool {
        self.surfaces.len() == 1 && self.background <= 0.0
    }
}

/// A camera ray.
#[derive(Clone, Debug)]
pub(super) struct CameraRay {
    pub ray: Ray,
    pub time: f64,
    /// Coordinates on the film in units of half its height, and on the unit disk of the lens.
    pub film: [f64; 2],
    pub disk: [f64; 2],
    /// What the direction was divided by.
    pub length: f64,
    /// Random numbers for the first emitter.
    pub emitter: [f64; 2],
    pub branches: Range<usize>,
}

/// A path from one surface of a camera ray on.
#[derive(Clone, Debug)]
pub(super) struct Branch {
    /// Which of the camera ray's surfaces, None for the background.
    pub drawn: Option<usize>,
    /// Whether it is the one that was drawn, not one of a split.
    pub alone: bool,
    /// W over the probability of being here.
    pub share: f64,
    pub vertices: Range<usize>,
}

/// A ray of a path and what it found.
#[derive(Clone, Debug)]
pub(super) struct Vertex {
    /// None for the camera ray.
    pub ray: Option<Ray>,
    /// Which surface of the ray was drawn, None for the background.
    pub drawn: Option<usize>,
    pub throughput: DVec3,
    pub hit: Option<Hit>,
    /// In `Work::lit`.
    pub lit: Range<usize>,
    /// In `Work::gathered`.
    pub gathered: Range<usize>,
    pub next: Option<Next>,
}

impl Vertex {
    /// One of which nothing has come yet.
    #[inline(always)]
    pub fn new(
        ray: Option<Ray>,
        drawn: Option<usize>,
        throughput: DVec3,
        hit: Option<Hit>,
    ) -> Self {
        Self {
            ray,
            drawn,
            throughput,
            hit,
            lit: 0..0,
            gathered: 0..0,
            next: None,
        }
    }
}

/// A surface point.
#[derive(Clone, Debug)]
pub(super) struct Hit {
    /// Which it is, in `Work::surfaces`.
    pub surface: usize,
    pub triangle: u32,
    pub material: u32,
    pub uv: glam::DVec2,
    pub position: DVec3,
    pub shade: Shade,
    /// Whether the normal is interpolated.
    pub smooth: bool,
}

/// Where a path goes on.
#[derive(Clone, Debug)]
pub(super) struct Next {
    pub scatter: Scatter,
    /// Over the probability to go on.
    pub survival: f64,
    /// The environment behind the last hit.
    pub end: Option<Ray>,
}

/// A point of an emitter that lights a surface point.
#[derive(Clone, Debug)]
pub(super) struct Lit {
    pub emitter: u32,
    pub corners: [f64; 3],
    pub way: Connection,
    /// What the surface reflects of light from there: f·cos θ.
    pub reflected: DVec3,
    pub density: f64,
    pub passed: f64,
    /// In `Work::shadows`.
    pub shadows: Range<usize>,
}

/// Light of a map along a fixed direction.
#[derive(Clone, Debug)]
pub(super) struct Gathered {
    pub ray: Ray,
    pub density: f64,
}

/// What lies between a surface point and a point of an emitter, but for what is in between.
#[derive(Clone, Debug)]
pub(super) struct Connection {
    pub direction: DVec3,
    pub squared: f64,
    pub distance: f64,
    /// Whether the distance was held off 0.
    pub held: bool,
    pub facing: f64,
    pub area: f64,
}

/// Room for the paths of a pixel, and what rays met.
pub(crate) struct Work {
    pub(super) bounces: usize,
    pub(super) surfaces: Vec<Surface>,
    pub(super) shadows: Vec<Surface>,
    /// Derivatives of what passes by the p of each of them.
    pub(super) by_p: Vec<f64>,
    pub(super) cameras: Vec<CameraRay>,
    pub(super) branches: Vec<Branch>,
    pub(super) vertices: Vec<Vertex>,
    pub(super) lit: Vec<Lit>,
    pub(super) gathered: Vec<Gathered>,
    /// Light that the sample at hand brought back, where nothing is kept for the way back.
    pub(super) brought: DVec3,
    /// For the way back: what samples brought, by sample and bounce.
    pub(super) light: Vec<DVec3>,
    pub(super) census: Census,
    /// Sums of the weights of objects and background, if they are asked for.
    pub(super) objects: Option<Vec<f64>>,
    pub(super) values: Vec<f64>,
    pub(super) scratch: PullScratch,
    pub(super) log: Log,
    pub(super) passing: Vec<f64>,
    pub(super) order: Vec<(u32, Option<usize>, f64)>,
    pub(super) entries: Vec<(Option<usize>, f64)>,
    pub(super) chances: Vec<f64>,
    pub(super) met: Vec<(usize, f64, f64)>,
}

impl Work {
    pub(crate) fn new(bounces: u32) -> Self {
        Self {
            bounces: bounces as usize,
            surfaces: Vec::new(),
            shadows: Vec::new(),
            by_p: Vec::new(),
            cameras: Vec::new(),
            branches: Vec::new(),
            vertices: Vec::new(),
            lit: Vec::new(),
            gathered: Vec::new(),
            brought: DVec3::ZERO,
            light: Vec::new(),
            census: Census {
                bounces: vec![0; bounces as usize + 1],
                ..Census::default()
            },
            objects: None,
            values: Vec::new(),
            scratch: PullScratch::default(),
            log: Log::None,
            passing: Vec::new(),
            order: Vec::new(),
            entries: Vec::new(),
            chances: Vec::new(),
            met: Vec::new(),
        }
    }

    pub(super) fn clear(&mut self) {
        self.forget();
        self.by_p.clear();
        self.cameras.clear();
        self.branches.clear();
        self.vertices.clear();
        self.lit.clear();
    }

    /// Forgets a path.
    pub(super) fn forget(&mut self) {
        self.surfaces.clear();
        self.shadows.clear();
        self.gathered.clear();
        self.light.clear();
    }
}
