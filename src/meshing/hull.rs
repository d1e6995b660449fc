//! The visual hull of a body from its silhouettes.

use glam::DVec3;

use super::lattice::{Lattice, MAX_CELLS};
use super::mesh::TriangleMesh;
use super::parts::bodies;
use super::silhouette::{Silhouette, Views};
use crate::error::{Error, Result};

/// The ball in which a body lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// The center, in scene units.
    pub center: [f64; 3],
    /// The radius, in scene units.
    pub radius: f64,
}

/// How a visual hull is computed.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct HullOptions {
    /// The number of lattice cells along the region's diameter, 2 to 1022.
    pub resolution: usize,
    /// The number of views that may be wrong about a point: it lies in the hull if at most so many views see it outside
    /// of the silhouette.
    pub tolerance: usize,
    /// Parts whose volume is less than this share of the largest one's are removed; 1 keeps only the largest.
    pub least_part: f64,
}

impl Default for HullOptions {
    fn default() -> Self {
        Self {
            resolution: 128,
            tolerance: 0,
            least_part: 1.0,
        }
    }
}

impl HullOptions {
    /// Sets the number of lattice cells along the region's diameter (128 by default).
    #[must_use]
    pub fn with_resolution(mut self, cells: usize) -> Self {
        self.resolution = cells;
        self
    }

    /// Sets the number of views that may be wrong about a point (0 by default).
    #[must_use]
    pub fn with_tolerance(mut self, views: usize) -> Self {
        self.tolerance = views;
        self
    }

    /// Sets the least volume of a part, as a share of the largest one's (1 by default: one part).
    #[must_use]
    pub fn with_least_part(mut self, share: f64) -> Self {
        self.least_part = share;
        self
    }

    fn check(&self) -> Result<()> {
        let object = "visual hull";
        // A cell on each side is beyond the region.
        let most = MAX_CELLS as usize - 2;
        let valid = (2..=most).contains(&self.resolution);
        let expected = format!("2 to {most}");
        Error::unless(valid, object, "resolution", self.resolution, &expected)?;
        let valid = (0.0..=1.0).contains(&self.least_part);
        Error::unless(valid, object, "least_part", self.least_part, "0 to 1")
    }
}

/// Carves the visual hull (Laurentini 1994) of a body out of a region: all points that no view sees beside the
/// silhouette. The surface is where the smallest of the views' signed distances to the outline, in scene units, is
/// zero, by marching tetrahedra. Only cells that the surface may pass are divided, so time and memory grow with the
/// square of the resolution.
///
/// A view whose silhouette reaches the border of its image tells nothing about points outside of the image. The mesh is
/// closed, oriented with its front outwards, and manifold; it has no cavities and no faces that cross. Its
/// edges are uneven: [`remesh`](super::remesh()) makes them even.
///
/// # Errors
/// [`Error::Invalid`] if a silhouette or an option is not valid, if a mask is empty, or if no point of the region is in
/// the hull.
pub fn visual_hull(
    silhouettes: &[Silhouette],
    region: impl Into<Region>,
    options: &HullOptions,
) -> Result<TriangleMesh> {
    options.check()?;
    let region = region.into();
    let object = "visual hull";
    let finite = region.center.iter().all(|x| x.abs() <= 1e30);
    let shown = format!("{:?}", region.center);
    Error::unless(finite, object, "region.center", shown, "finite numbers")?;
    Error::unless_positive(object, "region.radius", region.radius)?;
    let views = Views::new(silhouettes, options.tolerance)?;
    let center = DVec3::from(region.center);
    // A cell beyond the ball on each side.
    let step = 2.0 * region.radius / options.resolution as f64;
    let cells = options.resolution as u32 + 2;
    let lattice = Lattice {
        corner: center - step * f64::from(cells) / 2.0,
        step,
        cells,
    };
    let field = |point: DVec3| {
        let within = region.radius - point.distance(center);
        // Outside of the ball the views don't matter.
        if within < 0.0 {
            return within;
        }
        within.min(views.value(point))
    };
    let mesh = bodies(&lattice.surface(views.slope(), field), options.least_part);
    if mesh.faces.is_empty() {
        let expected = "a region of which the views see some point inside of all silhouettes (wrong cameras or masks \
                        empty it, and so does a coarse resolution; a tolerance admits some)";
        let region = format!("{region:?}");
        return Err(Error::invalid(object, "region", region, expected));
    }
    Ok(mesh)
}
