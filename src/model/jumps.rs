//! Where a point of a path looks for edges, and the two sides of one.

use super::bsdf::{Lobe, Shading};
use super::cone::widened;
use super::edge::half_plane;
use super::edge_weight::Query;
use super::frame::SinCos;
use super::{V2, V3, select_vector};
use crate::cube::*;

/// Points count at least for this share of an average camera ray.
const LEAST: f32 = 0.05;
/// How many searches a point that counts as much as a camera ray does on average makes for edges of the lights' shadows,
/// and of reflected light, which takes two more paths.
const OF_SHADOWS: f32 = 0.5;
const OF_REFLECTED: f32 = 0.25;
/// Up to so many samples a pixel (log₂) a point makes half as many, and the film has half as many samples: many steps of a
/// fit with few paths each gain more from time than from quiet gradients.
pub(crate) const FEW_SAMPLES: u32 = 2;
/// The most searches of a point for either.
const MOST_SEARCHES: f32 = 8.0;
/// Sets of random numbers from one search of a point to the next.
pub(crate) const SEARCH_SETS: u32 = 192;
/// Points beside an edge are this far from it, over the largest coordinate.
const BESIDE: f32 = 2e-5;
/// No triangle.
const NOTHING: u32 = u32::MAX;

/// What a point counts for: the sum of the channels of the derivative that it carries, over the typical one of a camera
/// ray.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn counts_of(carried: V3, typical: f32) -> f32 {
    carried.abs().element_sum() / typical
}

/// How many searches a point that counts as much as a camera ray does on average makes, where a pixel has so many samples
/// (log₂) and nothing better is known.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn usual_searches(of_light: bool, samples_log: u32) -> f32 {
    let rate = select(of_light, OF_SHADOWS, OF_REFLECTED);
    select(samples_log <= FEW_SAMPLES, rate * 0.5, rate)
}

/// The mean number of searches of a point, by that of one which counts as much as a camera ray does on average.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn mean_searches(usual: f32, counts: f32) -> f32 {
    usual * counts.max(LEAST)
}

/// The most searches of a point that makes so many on average.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn most_searches(mean: f32) -> u32 {
    mean.min(MOST_SEARCHES).ceil() as u32
}

/// The search in the cone that a group of emitters fills, widened by that of the rays; in the hemisphere if it is
/// wider. `to` is the vector to the middle of the group.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn towards_group(
    shading: &Shading,
    x: V3,
    time: f32,
    to: V3,
    radius: f32,
    tangent: f32,
) -> Query {
    let distance = to.length();
    let sin = radius / distance.max(radius);
    let cos = (1.0 - sin * sin).max(0.0).sqrt();
    let half = widened(SinCos { sin, cos }, tangent);
    let mut query = Query {
        x,
        time,
        axis: shading.outer(to),
        cos: 0.0,
        sin: 1.0,
        exponent: 0.0,
        shadows: true,
    };
    if half.cos > 0.0 {
        query.axis = to * (1.0 / distance);
        query.cos = half.cos;
        query.sin = half.sin;
    }
    query
}

/// The search in the cone of rays about the direction to a delta light.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn towards_light(x: V3, time: f32, axis: V3, tangent: f32) -> Query {
    let half = widened(SinCos { sin: 0.0, cos: 1.0 }, tangent);
    Query {
        x,
        time,
        axis,
        cos: half.cos,
        sin: half.sin,
        exponent: 0.0,
        shadows: true,
    }
}

/// A search for an edge that a lobe reflects.
#[apply(record!)]
pub(crate) struct LobeSearch {
    pub query: Query,
    pub lobe: Lobe,
    pub of_gloss: bool,
    /// The probability of the lobe and of its part.
    pub chance: f32,
    /// A uniform number for the kernel of the cone.
    pub cone_u: f32,
}

/// The search by a uniform number, which chooses the lobe, one of its parts, and is uniform again.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn of_lobe(
    shading: &Shading,
    x: V3,
    time: f32,
    choice: f32,
    tangent: f32,
) -> LobeSearch {
    let gloss = shading.gloss();
    let of_gloss = choice < gloss;
    let mut chance = (1.0 - gloss).max(1e-20);
    let mut rest = (choice - gloss) / chance;
    if of_gloss {
        chance = gloss;
        rest = choice / gloss;
    }
    let lobe = shading.lobe(of_gloss, rest, tangent);
    LobeSearch {
        query: Query {
            x,
            time,
            axis: lobe.axis,
            cos: lobe.cos,
            sin: lobe.sin,
            exponent: lobe.exponent,
            shadows: false,
        },
        lobe,
        of_gloss,
        chance: chance * lobe.chance,
        cone_u: lobe.rest.max(0.0).min(1.0),
    }
}

/// The faces of an edge that are seen on its two sides, or [`NOTHING`] where one sees past it.
#[apply(record!)]
pub(crate) struct Sides {
    pub minus: u32,
    pub plus: u32,
    /// Points from the − side to the + side, at a right angle to the edge and to the direction in which it is seen.
    pub across: V3,
    /// The direction of a ray that passes the edge's point right beside it, on the side where nothing is, if there is one.
    pub past: V3,
    /// The least depths of faces so far.
    least_minus: f32,
    least_plus: f32,
}

#[cfg_attr(feature = "wgpu", cube)]
impl Sides {
    /// Those of an edge without faces, the second towards `side`.
    #[inline(always)]
    pub fn new(along: V3, view: V3, side: V3) -> Sides {
        // Across the plane of the edge and the view, so that lateral places are comparable.
        let across = along.cross(view);
        let across = select_vector(across.dot(side) < 0.0, -across, across);
        Sides {
            minus: NOTHING.runtime(),
            plus: NOTHING.runtime(),
            across,
            past: view,
            least_minus: f32::MAX.runtime(),
            least_plus: f32::MAX.runtime(),
        }
    }

    /// Adds a face, which a vector from the edge points into.
    #[inline(always)]
    pub fn add(&mut self, face: u32, inward: V3, along: V3, view: V3) {
        let half: V2 = half_plane(inward, along, view, self.across);
        let above = half.x > 0.0;
        let on_plus = above && half.y < self.least_plus;
        let on_minus = !above && half.y < self.least_minus;
        self.least_plus = select(on_plus, half.y, self.least_plus);
        self.plus = select(on_plus, face, self.plus);
        self.least_minus = select(on_minus, half.y, self.least_minus);
        self.minus = select(on_minus, face, self.minus);
    }

    /// Says how rays pass the edge's point, when all faces are added. `to` is the vector to it.
    #[inline(always)]
    pub fn pass(&mut self, to: V3, position: V3) {
        let step = beside(position) / self.across.length();
        let on_plus = select(self.plus == NOTHING, step, 0.0);
        let step = select(self.minus == NOTHING, -step, on_plus);
        self.past = (to + self.across * step).normalize();
    }
}

/// How far a point beside an edge's point is from it.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
fn beside(position: V3) -> f32 {
    BESIDE * (0.1 + position.abs().max_element())
}

/// A place beside an edge's point, in a face that a vector from there points into: so far inside that no ray from it meets
/// the other faces of the edge by rounding.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn inside(position: V3, inward: V3) -> V3 {
    let step = (beside(position) / inward.length().max(1e-37)).min(0.1);
    position + inward * step
}

/// The half of a face that lies on a side of a line in which it crosses another.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn half_beside(normal: V3, along: V3, across: V3) -> V3 {
    let half = normal.cross(along);
    select_vector(half.dot(across) < 0.0, -half, half)
}

/// Of three vectors from a point of a line, to the corners of a face, the one that ends farthest from the line.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn farthest(a: V3, b: V3, c: V3, along: V3) -> V3 {
    let far_a = a.cross(along).length_squared();
    let far_b = b.cross(along).length_squared();
    let far_c = c.cross(along).length_squared();
    let other = select_vector(far_b >= far_c, b, c);
    select_vector(far_a >= far_b && far_a >= far_c, a, other)
}

/// The derivative of g·P by how far a plane moves along its normal, where P is a point of the line in which it crosses
/// another: n₁·dP and n₂·dP are those of the planes.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn by_crossing_plane(normal: V3, other: V3, g: V3) -> V3 {
    let cosine = normal.dot(other);
    let dual = (normal - other * cosine) * (1.0 / (1.0 - cosine * cosine).max(1e-12));
    normal * g.dot(dual)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_make_as_many_searches_as_they_count_for() {
        for of_light in [true, false] {
            let usual = usual_searches(of_light, FEW_SAMPLES + 1);
            assert_eq!(usual_searches(of_light, FEW_SAMPLES), 0.5 * usual);
            for counts in [1e-6, 0.05, 0.3, 1.0, 2.0, 3.7, 16.0, 1e30, f32::INFINITY] {
                let wanted = mean_searches(usual, counts);
                let most = most_searches(wanted);
                assert!((1..=MOST_SEARCHES as u32).contains(&most), "{counts}");
                let mean = most as f32 * (wanted / most as f32).min(1.0);
                let wanted = wanted.min(MOST_SEARCHES);
                assert!((mean - wanted).abs() <= 1e-6 * wanted, "{counts}: {mean}");
            }
        }
    }
}
