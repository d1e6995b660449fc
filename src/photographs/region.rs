//! The region of interest of a set: where its points are, where its masks meet, or where its cameras look.

use glam::{DMat3, DVec3};

use super::{Photograph, ViewCamera};
use crate::error::{Error, Result};
use crate::meshing;

/// A ball and a box that hold what a set of photographs shows, in scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// The center of the ball.
    pub center: [f64; 3],
    /// The radius of the ball.
    pub radius: f64,
    /// The lower corner of the box.
    pub low: [f64; 3],
    /// The upper corner of the box.
    pub high: [f64; 3],
}

impl From<Region> for meshing::Region {
    /// Takes the ball.
    fn from(region: Region) -> Self {
        let (center, radius) = (region.center, region.radius);
        Self { center, radius }
    }
}

impl Region {
    /// A ball, and the box around it.
    pub fn sphere(center: [f64; 3], radius: f64) -> Self {
        Self {
            center,
            radius,
            low: center.map(|v| v - radius),
            high: center.map(|v| v + radius),
        }
    }

    /// Moves and scales the world so that the ball becomes the unit ball about the origin: changes the poses of photographs.
    pub fn make_unit<'a>(&self, photographs: impl IntoIterator<Item = &'a mut Photograph>) {
        for photograph in photographs {
            let rows = photograph.camera.to_world.iter_mut().zip(self.center);
            rows.for_each(|(row, center)| row[3] = (row[3] - center) / self.radius);
        }
    }

    /// Returns the region of points. The center is their median, and 98 % of them are in the ball and, along each axis,
    /// in the box: a few points of a reconstruction lie far away.
    ///
    /// # Errors
    /// If there are no points.
    pub fn of_points(points: &[[f64; 3]]) -> Result<Self> {
        const KEPT: f64 = 0.98;
        if points.is_empty() {
            return Err(Error::invalid(
                "region",
                "points",
                "empty",
                "at least one point",
            ));
        }
        let quantile = |values: &mut Vec<f64>, q: f64| {
            values.sort_by(f64::total_cmp);
            values[(q * (values.len() - 1) as f64).round() as usize]
        };
        let axis = |i: usize| {
            let mut values: Vec<f64> = points.iter().map(|p| p[i]).collect();
            let cut = 0.5 * (1.0 - KEPT);
            [cut, 0.5, 1.0 - cut].map(|q| quantile(&mut values, q))
        };
        let axes = [0, 1, 2].map(axis);
        let center = axes.map(|[_, middle, _]| middle);
        let from_center = |p: &[f64; 3]| DVec3::from(*p).distance(center.into());
        let mut distances: Vec<f64> = points.iter().map(from_center).collect();
        Ok(Self {
            center,
            radius: quantile(&mut distances, KEPT),
            low: axes.map(|[low, ..]| low),
            high: axes.map(|[.., high]| high),
        })
    }

    /// Returns the region at which cameras look: the center is the point that is nearest to all view axes by least
    /// squares, and each camera sees the whole ball if it looks at the center.
    ///
    /// # Errors
    /// If there are fewer than two cameras, or they look in nearly the same direction.
    pub fn of_cameras(cameras: &[ViewCamera]) -> Result<Self> {
        let axes: Vec<_> = cameras
            .iter()
            .map(|c| (c.position(), c.forward()))
            .collect();
        let center = nearest_to_lines(&axes)?;
        let radius = |camera: &ViewCamera| {
            let half = [0, 1].map(|i| 0.5 * camera.size[i] as f64 / camera.focal[i]);
            let sine = half[0].min(half[1]).atan().sin();
            center.distance(camera.position().into()) * sine
        };
        let radius = cameras.iter().map(radius).fold(f64::INFINITY, f64::min);
        Ok(Self::sphere(center.to_array(), radius))
    }

    /// Returns the region in which masks meet: the center is the point that is nearest, by least squares, to the rays
    /// through the middles of all masks, and the ball holds the cones of all masks at its distance. Photographs with an
    /// empty mask, or without one, are left out.
    ///
    /// # Errors
    /// If fewer than two photographs have a mask that is not empty, or they look in nearly the same direction.
    pub fn of_masks<'a>(photographs: impl IntoIterator<Item = &'a Photograph>) -> Result<Self> {
        let masked = photographs.into_iter().filter(|photo| photo.masked);
        let seen: Vec<_> = masked
            .filter_map(|photo| Some((photo, middle_of(photo)?)))
            .collect();
        let rays: Vec<_> = seen.iter().map(|(_, ray)| *ray).collect();
        let center = nearest_to_lines(&rays)?;
        let radius = |(photo, (eye, _)): &(&Photograph, ([f64; 3], [f64; 3]))| {
            let offset = center - DVec3::from(*eye);
            let axis = offset.normalize_or_zero();
            let cosines = pixels_of(photo).filter_map(|pixel| {
                let (_, direction) = photo.camera.ray(pixel)?;
                Some(DVec3::from(direction).dot(axis))
            });
            let cosine = cosines.fold(1.0, f64::min).max(0.0);
            offset.length() * (1.0 - cosine * cosine).sqrt()
        };
        let radius = seen.iter().map(radius).fold(0.0, f64::max);
        Ok(Self::sphere(center.to_array(), radius))
    }
}

/// The middles of the pixels of a photograph's mask.
fn pixels_of(photo: &Photograph) -> impl Iterator<Item = [f64; 2]> {
    let width = photo.camera.size[0];
    let inside = photo.mask.iter().enumerate().filter(|(_, m)| **m > 0.5);
    inside.map(move |(i, _)| [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5])
}

/// Returns the ray through the middle of a photograph's mask. `None` if the mask is empty.
fn middle_of(photo: &Photograph) -> Option<([f64; 3], [f64; 3])> {
    let (mut sum, mut count) = ([0.0; 2], 0.0);
    for pixel in pixels_of(photo) {
        sum = [0, 1].map(|i| sum[i] + pixel[i]);
        count += 1.0;
    }
    photo
        .camera
        .ray(sum.map(|v| v / count))
        .filter(|_| count > 0.0)
}

/// Returns the point with the least sum of squared distances to lines, given by a point and a unit direction each.
fn nearest_to_lines(lines: &[([f64; 3], [f64; 3])]) -> Result<DVec3> {
    /// The least determinant of the mean projector, 0 for lines of one direction.
    const LEAST: f64 = 1e-6;
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (origin, direction) in lines {
        let (origin, d) = (DVec3::from(*origin), DVec3::from(*direction));
        let projector = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        matrix += projector;
        right += projector * origin;
    }
    let count = lines.len() as f64;
    let spread = matrix.determinant() / count.powi(3);
    if lines.len() < 2 || spread.is_nan() || spread < LEAST {
        let found = format!("{} with a spread of {spread:.1e}", lines.len());
        let expected = "at least two views from different directions";
        return Err(Error::invalid("region", "views", found, expected));
    }
    Ok(matrix.inverse() * right)
}
