//! Silhouettes of a body in images, and what they tell of points in space.

use glam::DVec3;
use rayon::prelude::*;

use super::distance::{Distances, LEVEL};
use crate::error::{Error, Result};

/// The silhouette of a body in the image of a pinhole camera.
#[derive(Clone, Copy, Debug)]
pub struct Silhouette<'a> {
    /// The rows of the rotation and translation from world to camera, in OpenGL's axes: the camera looks along −z, and
    /// y is up.
    pub world_to_camera: [[f64; 4]; 3],
    /// The focal length in pixels, horizontally and vertically.
    pub focal: [f64; 2],
    /// The principal point in pixels from the image's upper-left corner, to the right and down.
    pub principal: [f64; 2],
    /// The width of the mask in pixels.
    pub width: usize,
    /// The height of the mask in pixels.
    pub height: usize,
    /// `width` × `height` values in rows from the top: 1 where the body covers a pixel, 0 where it does not, and
    /// between them the covered part.
    pub mask: &'a [f32],
}

impl Silhouette<'_> {
    /// Checks the values of the silhouette with an index.
    fn check(&self, index: usize) -> Result<()> {
        let name = format!("silhouettes[{index}]");
        let rows = &self.world_to_camera;
        let dot = |a: &[f64; 4], b: &[f64; 4]| (0..3).map(|i| a[i] * b[i]).sum::<f64>();
        let is_turn = (0..3).all(|i| {
            (0..3).all(|j| (dot(&rows[i], &rows[j]) - f64::from(u8::from(i == j))).abs() < 1e-3)
        });
        let valid = is_turn && rows.iter().all(|r| r[3].is_finite());
        let (field, expected) = ("world_to_camera", "a rotation and a finite translation");
        Error::unless(valid, &name, field, format!("{rows:?}"), expected)?;
        for focal in self.focal {
            Error::unless_positive(&name, "focal", focal)?;
        }
        let finite = self.principal.iter().all(|x| x.is_finite());
        let shown = format!("{:?}", self.principal);
        Error::unless(finite, &name, "principal", shown, "finite numbers")?;
        let size = format!("{} × {}", self.width, self.height);
        let valid = (1..=1 << 15).contains(&self.width) && (1..=1 << 15).contains(&self.height);
        Error::unless(valid, &name, "width × height", size, "1 to 32768 pixels")?;
        let (count, wanted) = (self.mask.len(), self.width * self.height);
        let expected = format!("width × height = {wanted} values");
        Error::unless(
            count == wanted,
            &name,
            "mask",
            format!("{count} values"),
            &expected,
        )?;
        if let Some(i) = self.mask.iter().position(|x| !x.is_finite()) {
            let field = format!("mask[{i}]");
            return Err(Error::invalid(name, field, self.mask[i], "a finite number"));
        }
        let empty = self.mask.iter().all(|&x| x < LEVEL);
        let expected = "at least one pixel of the body (0.5 or more)";
        Error::unless(!empty, &name, "mask", "empty", expected)
    }

    /// Whether the body reaches the border of the image, so that parts of it may be outside.
    fn is_cut(&self) -> bool {
        let (w, h) = (self.width, self.height);
        let row = |y: usize| (0..w).any(|x| self.mask[y * w + x] >= LEVEL);
        let column = |x: usize| (0..h).any(|y| self.mask[y * w + x] >= LEVEL);
        row(0) || row(h - 1) || column(0) || column(w - 1)
    }
}

/// A silhouette with the distances to its outline.
struct View {
    rows: [[f64; 4]; 3],
    focal: [f64; 2],
    principal: [f64; 2],
    /// Scene units per pixel at a distance of 1.
    scale: f64,
    /// The value of points about which the view tells nothing, or behind the camera.
    behind: f64,
    distances: Option<Distances>,
}

impl View {
    fn new(silhouette: &Silhouette) -> Self {
        let cut = silhouette.is_cut();
        let Silhouette {
            mask,
            width,
            height,
            focal,
            ..
        } = *silhouette;
        let beyond = if cut { 1.0 } else { 0.0 };
        Self {
            rows: silhouette.world_to_camera,
            focal,
            principal: silhouette.principal,
            scale: 1.0 / (focal[0] * focal[1]).sqrt(),
            behind: if cut {
                f64::INFINITY
            } else {
                f64::NEG_INFINITY
            },
            distances: Distances::new(mask, width, height, beyond),
        }
    }

    /// The signed distance of a point to the cone of rays through the silhouette, in scene units and about: positive
    /// inside, infinite where the view tells nothing.
    fn value(&self, point: DVec3) -> f64 {
        let row = |[x, y, z, w]: [f64; 4]| x * point.x + y * point.y + z * point.z + w;
        let depth = -row(self.rows[2]);
        let Some(distances) = &self.distances else {
            return f64::INFINITY;
        };
        if depth <= 0.0 {
            return self.behind;
        }
        let x = self.principal[0] + self.focal[0] * row(self.rows[0]) / depth;
        let y = self.principal[1] - self.focal[1] * row(self.rows[1]) / depth;
        distances.at(x.clamp(-1e9, 1e9), y.clamp(-1e9, 1e9)) * depth * self.scale
    }

    /// How fast the value changes at most with the point, about.
    fn slope(&self) -> f64 {
        let Some(distances) = &self.distances else {
            return 1.0;
        };
        let [width, height] = distances.size().map(|x| x as f64);
        let [x, y] = self.principal;
        let right = x.abs().max((width - x).abs()) / self.focal[0];
        let down = y.abs().max((height - y).abs()) / self.focal[1];
        // The outline moves in the image with the depth, and the size of a pixel grows with it.
        1.1 + 1.5 * right.hypot(down)
    }
}

/// All views of a body.
pub(super) struct Views {
    views: Vec<View>,
    tolerance: usize,
}

impl Views {
    /// Checks silhouettes and computes the distances to their outlines. `tolerance` is the number of views that may
    /// be wrong about a point.
    pub fn new(silhouettes: &[Silhouette], tolerance: usize) -> Result<Self> {
        let none = silhouettes.is_empty();
        Error::unless(!none, "visual hull", "silhouettes", "empty", "at least one")?;
        for (i, silhouette) in silhouettes.iter().enumerate() {
            silhouette.check(i)?;
        }
        let most = silhouettes.len();
        let expected = format!("less than the number of silhouettes, {most}");
        Error::unless(
            tolerance < most,
            "visual hull",
            "tolerance",
            tolerance,
            &expected,
        )?;
        let views = silhouettes.par_iter().map(View::new).collect();
        Ok(Self { views, tolerance })
    }

    /// The signed distance of a point to the hull, in scene units and about: positive inside.
    pub fn value(&self, point: DVec3) -> f64 {
        let values = self.views.iter().map(|view| view.value(point));
        if self.tolerance == 0 {
            return values.fold(f64::INFINITY, f64::min);
        }
        let mut values: Vec<f64> = values.collect();
        *values
            .select_nth_unstable_by(self.tolerance, f64::total_cmp)
            .1
    }

    /// How fast the value changes at most with the point.
    pub fn slope(&self) -> f64 {
        self.views
            .iter()
            .map(View::slope)
            .fold(1.0, f64::max)
            .min(8.0)
    }
}
