//! Blur kernels: the pixel filter of the film, and the kernel of ray cones.

use std::sync::Arc;

use super::frame::sin_cos_of_turns;
use super::{V2, v2};
use crate::cube::*;

/// Samples the unit disk with density 3/π·(1 − r²)², the kernel of a ray cone.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn disk_kernel(u: f32, v: f32) -> V2 {
    // The cumulative distribution in r is 1 − (1 − r²)³.
    let rest = cube_root(max(1.0 - u, 0.0));
    let r = max(1.0 - rest, 0.0).sqrt();
    let turn = sin_cos_of_turns(v);
    v2(r * turn.cos, r * turn.sin)
}

/// Maps a pair of uniform numbers to a uniformly distributed point of the unit disk.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn uniform_disk(u: f32, v: f32) -> V2 {
    let turn = sin_cos_of_turns(v);
    v2(u.sqrt() * turn.cos, u.sqrt() * turn.sin)
}

/// Returns the cube root of a non-negative number: an initial guess from its bits, then two steps of Halley's method.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn cube_root(x: f32) -> f32 {
    let least = max(x, 1e-30);
    let mut y = f32::from_bits(least.to_bits() / 3 + 0x2a51_37a0);
    let mut i = 0;
    while i < 2 {
        let cube = y * y * y;
        y *= (cube + 2.0 * least) / (2.0 * cube + least);
        i += 1;
    }
    y * (x / least)
}

/// Samples [−1, 1] with density 15/16·(1 − x²)², the kernel of the pixel filter along each axis.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn film_kernel(u: f32) -> f32 {
    // Newton's method for y = 1 − |x| with y³ (20 − 15 y + 3 y²)/16 = min(u, 1 − u). It solves for the cube root of
    // both sides, which is nearly linear.
    let upper = u > 0.5;
    let half = select(upper, 1.0 - u, u);
    let root = cube_root(0.8 * half);
    let mut y = root * (1.0 + 0.22 * root);
    let mut i = 0;
    while i < 3 {
        let factor = 1.0 - y * (0.75 - 0.15 * y);
        let value = y * cube_root(factor);
        let slope = cube_root(factor) * (1.0 - y * (0.25 - 0.1 * y) / factor);
        y = (y - (value - root) / slope).clamp(0.0, 1.0);
        i += 1;
    }
    select(upper, 1.0 - y, y - 1.0)
}

/// The pixel filter along one axis: a box of one pixel convolved with [`film_kernel`] scaled to a radius in pixels.
///
/// The inverse cumulative distribution is tabulated for one half, over the fourth root of the uniform number. The
/// cumulative distribution ends like a fourth power, so the tail is as accurate as the middle.
#[derive(Debug)]
pub struct PixelFilter {
    radius: f64,
    /// Whether the radius is that of a ray cone, which changes with the field of view.
    is_cone: bool,
    pub table: Vec<f32>,
}

const ENTRIES: usize = 512;

impl PixelFilter {
    pub fn new(radius: f64) -> Self {
        let table = (0..=ENTRIES).map(|i| {
            let root = i as f64 / ENTRIES as f64;
            let wanted = 0.5 * root.powi(4);
            let (mut low, mut high) = (-0.5 - radius, 0.0);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if share_below(middle, radius) < wanted {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            (0.5 * (low + high)) as f32
        });
        Self {
            radius,
            is_cone: false,
            table: table.collect(),
        }
    }

    /// Returns the filter for a ray cone of `cone` pixels, with a radius of at least `least` pixels.
    pub fn of_cone(least: f64, cone: f64) -> Self {
        Self {
            is_cone: cone > least,
            ..Self::new(least.max(cone))
        }
    }

    /// Returns the radius in pixels if it changes with the field of view, otherwise 0.
    pub fn cone_radius(&self) -> f32 {
        if self.is_cone { self.radius() } else { 0.0 }
    }

    /// Returns the derivative of a filter point with respect to the radius, times the radius, in pixels.
    pub fn spread(&self, x: f32) -> f64 {
        let radius = self.radius();
        f64::from(radius * filter_by_radius(x, radius))
    }

    /// Returns the radius in pixels of the kernel that the box is convolved with.
    pub fn radius(&self) -> f32 {
        self.radius as f32
    }

    /// Samples an offset from the pixel center, in pixels, for a uniform number.
    #[inline(always)]
    pub fn sample(&self, u: f32) -> f32 {
        sample_filter(&self.table, 0, u)
    }
}

/// The pixel filters of all views; views with equal filters share one.
#[derive(Default)]
pub struct Filters(Vec<Arc<PixelFilter>>);

impl Filters {
    /// Returns [`PixelFilter::of_cone`], or an equal filter that exists already.
    pub fn of_cone(&mut self, least: f64, cone: f64) -> Arc<PixelFilter> {
        let same =
            |f: &&Arc<PixelFilter>| f.radius == least.max(cone) && f.is_cone == (cone > least);
        if let Some(known) = self.0.iter().find(same) {
            return known.clone();
        }
        self.0.push(Arc::new(PixelFilter::of_cone(least, cone)));
        self.0[self.0.len() - 1].clone()
    }
}

/// [`PixelFilter::sample`] with a table that starts at index `table` of a list.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn sample_filter(list: &[f32], table: usize, u: f32) -> f32 {
    let place = filter_place(u);
    filter_between(filter_entries(list, table, place), place, u)
}

/// Returns the fractional index into the filter's table for a uniform number.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn filter_place(u: f32) -> f32 {
    (2.0 * min(u, 1.0 - u)).sqrt().sqrt() * ENTRIES as f32
}

/// Returns the index of the table entry before a fractional index.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn entry_before(place: f32) -> f32 {
    min(place.floor(), (ENTRIES - 1) as f32)
}

/// Returns the two entries around a fractional index into the table, which starts at index `table` of a list.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn filter_entries(list: &[f32], table: usize, place: f32) -> V2 {
    let i = table + entry_before(place) as usize;
    let after = list[i + 1];
    v2(list[i], after)
}

/// Interpolates between two table entries; `u` selects the half, and with it the sign.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn filter_between(entries: V2, place: f32, u: f32) -> f32 {
    let x = entries.x + (entries.y - entries.x) * (place - entry_before(place));
    select(u > 0.5, -x, x)
}

/// Returns the derivative of a filter point with respect to the filter radius r, at a fixed random number.
///
/// The point is the sum of a point of the box and r κ, with κ from [`film_kernel`]. So the derivative is the mean of
/// κ over all such sums that equal this point, that is over κ in [(x − ½)/r, (x + ½)/r]. The quadrature is exact for
/// the polynomials of the kernel.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn filter_by_radius(x: f32, radius: f32) -> f32 {
    let low = max((x - 0.5) / radius, -1.0);
    let high = min((x + 0.5) / radius, 1.0);
    let middle = 0.5 * (low + high);
    let step = 0.387_298_35 * (high - low);
    let before = middle - step;
    let after = middle + step;
    let a = 1.0 - before * before;
    let b = 1.0 - middle * middle;
    let c = 1.0 - after * after;
    let weight_a = 5.0 * a * a;
    let weight_b = 8.0 * b * b;
    let weight_c = 5.0 * c * c;
    let all = weight_a + weight_b + weight_c;
    let mut mean = middle;
    if all > 0.0 {
        mean = (weight_a * before + weight_b * middle + weight_c * after) / all;
    }
    mean
}

/// Returns the pixel filter's density at an offset x from the pixel's center, and its derivative.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn filter_at(x: f32, radius: f32) -> V2 {
    // The lower half, whose end the difference of the cumulative distributions keeps.
    let low = max((-x.abs() - 0.5) / radius, -1.0);
    let high = min((-x.abs() + 0.5) / radius, 1.0);
    let a = 1.0 - low * low;
    let b = 1.0 - high * high;
    let slope = 0.9375 * (b * b - a * a) / radius;
    v2(
        kernel_below(high) - kernel_below(low),
        select(x > 0.0, -slope, slope),
    )
}

/// Returns the fraction of [`film_kernel`] below x.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn kernel_below(x: f32) -> f32 {
    let y = 1.0 - x.abs();
    let below = y * y * y * (20.0 - y * (15.0 - 3.0 * y)) * 0.0625;
    select(x > 0.0, 1.0 - below, below)
}

/// Returns the fraction of the pixel filter that lies below a point x ≤ 0.
fn share_below(x: f64, radius: f64) -> f64 {
    if radius <= 0.0 {
        return (x + 0.5).clamp(0.0, 1.0);
    }
    // The integral from −1 of the kernel's cumulative distribution. With y = x + 1 that distribution is 5/4 y³ −
    // 15/16 y⁴ + 3/16 y⁵. Powers of y do not cancel near the end.
    let integral = |x: f64| {
        let y = x + 1.0;
        if y <= 0.0 {
            0.0
        } else if y >= 2.0 {
            x
        } else {
            // ∫∫ 15/16·(y(2 − y))² dy dy.
            y.powi(4) * (5.0 / 16.0 + y * (-3.0 / 16.0 + y / 32.0))
        }
    };
    radius * (integral((x + 0.5) / radius) - integral((x - 0.5) / radius))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cube_roots_to_rounding() {
        assert_eq!(cube_root(0.0), 0.0);
        for i in 0..400 {
            let x = 1e-12 * 1.1f32.powi(i);
            assert!((cube_root(x) / x.cbrt() - 1.0).abs() < 4e-7, "{x}");
        }
    }

    /// The moments of the kernels match closed forms.
    #[test]
    fn kernels_have_their_moments() {
        let n = 1 << 14;
        let mean = |f: &dyn Fn(f32) -> f64| -> f64 {
            (0..n).map(|i| f((i as f32 + 0.5) / n as f32)).sum::<f64>() / f64::from(n)
        };
        let square = |x: f32| f64::from(x) * f64::from(x);
        assert!(mean(&|u| f64::from(film_kernel(u))).abs() < 1e-5);
        assert!((mean(&|u| square(film_kernel(u))) - 1.0 / 7.0).abs() < 1e-5);
        assert!((mean(&|u| square(film_kernel(u)).powi(2)) - 1.0 / 21.0).abs() < 1e-5);
        for u in [1e-6f32, 1e-4, 0.01, 0.2, 0.5, 0.9, 0.9999] {
            let x = f64::from(film_kernel(u));
            let below = 0.5 + x * (15.0 - x * x * (10.0 - 3.0 * x * x)) / 16.0;
            assert!((below - f64::from(u)).abs() < 1e-6, "{u}: {x} {below}");
        }
        // E r² = 1/4 under 3/π (1 − r²)².
        let r = |u: f32| {
            let p = disk_kernel(u, 0.3);
            p.x.hypot(p.y)
        };
        assert!((mean(&|u| square(r(u))) - 0.25).abs() < 1e-4);
        for radius in [0.0, 0.25, 0.5, 1.0, 4.0] {
            let filter = PixelFilter::new(radius);
            assert!(mean(&|u| f64::from(filter.sample(u))).abs() < 1e-4);
            let wanted = 1.0 / 12.0 + radius * radius / 7.0;
            let found = mean(&|u| square(filter.sample(u)));
            assert!(
                (found - wanted).abs() < 1e-3 * wanted,
                "{radius}: {found} {wanted}"
            );
            assert!((filter.sample(0.3) + filter.sample(0.7)).abs() < 1e-6);
            // The tail matches the convolved box.
            for u in [1e-5f32, 1e-3, 0.1, 0.4] {
                let below = share_below(filter.sample(u).into(), radius);
                assert!(
                    (below / f64::from(u) - 1.0).abs() < 2e-3,
                    "{radius} {u}: {below}"
                );
            }
            // Its derivative with respect to the radius against central differences.
            let h = 1e-3;
            let wider = PixelFilter::new(radius + h);
            let narrower = PixelFilter::new((radius - h).max(0.0));
            for u in [1e-3f32, 0.03, 0.2, 0.4, 0.7, 0.99] {
                let wanted = (wider.sample(u) - narrower.sample(u)) / (2.0 * h as f32);
                let found = filter_by_radius(filter.sample(u), radius as f32);
                assert!(
                    radius == 0.0 || (found - wanted).abs() < 5e-3,
                    "{radius} {u}: {found} {wanted}"
                );
            }
            // The slope of its density, which is the derivative of u with respect to the sample.
            for x in [0.1f32, -0.3, 0.45, -0.6, 0.9] {
                let density = |x: f64| {
                    let below = |x: f64| share_below(-x.abs(), radius);
                    (below(x + 1e-4) - below(x - 1e-4)).abs() / 2e-4
                };
                let x = x * (0.5 + radius as f32);
                let (before, after) = (density(f64::from(x) - 2e-3), density(f64::from(x) + 2e-3));
                let wanted = ((after / before).ln() / 4e-3) as f32;
                let at = filter_at(x, radius as f32);
                let found = at.y / at.x;
                assert!(
                    radius == 0.0 || (found - wanted).abs() < 0.01 * (1.0 + wanted.abs()),
                    "{radius} {x}: {found} {wanted}"
                );
            }
            assert!(filter.sample(0.0) >= -(0.5 + radius as f32 + 1e-6));
            assert!(filter.sample(1.0) <= 0.5 + radius as f32 + 1e-6);
        }
    }
}
