//! Edge searches from points of a path, and the two sides of an edge.

use super::bsdf::{Lobe, Shading};
use super::cone::widened;
use super::edge::half_plane;
use super::edge_weight::Query;
use super::frame::SinCos;
use super::{V2, V3, select_vector};
use crate::cube::*;

/// Minimum importance of a point, relative to an average camera ray.
const MIN_IMPORTANCE: f32 = 0.05;
/// Mean number of searches by a point as important as an average camera ray: for edges of the lights' shadows, and
/// for edges in reflected light, which takes two more paths.
const OF_SHADOWS: f32 = 0.5;
const OF_REFLECTED: f32 = 0.25;
/// Up to this log₂ of samples per pixel, the number of searches and the number of film samples are halved. An
/// optimization with many steps of few paths each gains more from speed than from low gradient variance.
pub const LOW_SAMPLES_LOG: u32 = 2;
/// Maximum number of searches by a point, for shadows and for reflected light each.
const MAX_SEARCHES: f32 = 8.0;
/// Number of sets of random numbers between one search of a point and the next.
pub const SEARCH_SETS: u32 = 192;
/// Distance from an edge of points beside it, relative to the largest coordinate.
const BESIDE: f32 = 2e-5;
/// No triangle.
const NOTHING: u32 = u32::MAX;

/// Returns the importance of a point: the channel sum of the derivative that it carries, over the typical one of a
/// camera ray.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn counts_of(carried: V3, typical: f32) -> f32 {
    carried.abs().element_sum() / typical
}

/// Returns the default mean number of searches by a point as important as an average camera ray, for log₂ of the
/// samples per pixel.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn usual_searches(of_light: bool, samples_log: u32) -> f32 {
    let rate = select(of_light, OF_SHADOWS, OF_REFLECTED);
    select(samples_log <= LOW_SAMPLES_LOG, rate * 0.5, rate)
}

/// Returns the mean number of searches by a point of importance `counts`. `usual` is the mean number for an average
/// camera ray.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn mean_searches(usual: f32, counts: f32) -> f32 {
    usual * max(counts, MIN_IMPORTANCE)
}

/// Returns the maximum number of searches by a point with this mean number.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn most_searches(mean: f32) -> u32 {
    min(mean, MAX_SEARCHES).ceil() as u32
}

/// Returns the query in the cone of a group of emitters, widened by the cone of rays, or over the hemisphere if that
/// cone is wider. `to` is the vector to the center of the group.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn towards_group(
    shading: &Shading,
    x: V3,
    time: f32,
    to: V3,
    radius: f32,
    tangent: f32,
) -> Query {
    let distance = to.length();
    let sin = radius / max(distance, radius);
    let cos = max(1.0 - sin * sin, 0.0).sqrt();
    let half = widened(SinCos { sin, cos }, tangent);
    let mut query = Query {
        x,
        time,
        axis: shading.outer(to),
        cos: 0.0,
        sin: 1.0,
        exponent: 0.0,
        shadows: true,
        following: 0.0,
    };
    if half.cos > 0.0 {
        query.axis = to * (1.0 / distance);
        query.cos = half.cos;
        query.sin = half.sin;
    }
    query
}

/// Returns the query in the cone of rays about the direction to a delta light.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn towards_light(x: V3, time: f32, axis: V3, tangent: f32) -> Query {
    let half = widened(SinCos { sin: 0.0, cos: 1.0 }, tangent);
    Query {
        x,
        time,
        axis,
        cos: half.cos,
        sin: half.sin,
        exponent: 0.0,
        shadows: true,
        following: 0.0,
    }
}

/// A search for an edge in the light that a lobe reflects.
#[apply(record!)]
pub struct LobeSearch {
    pub query: Query,
    pub lobe: Lobe,
    pub of_gloss: bool,
    /// Probability of the lobe and of its part.
    pub chance: f32,
    /// A uniform number for the blur of the cone.
    pub cone_u: f32,
}

/// Returns the search for a uniform number, which chooses the lobe and its part; the remainder is uniform again.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn of_lobe(shading: &Shading, x: V3, time: f32, choice: f32, tangent: f32) -> LobeSearch {
    let gloss = shading.gloss();
    let of_gloss = choice < gloss;
    let mut chance = max(1.0 - gloss, 1e-20);
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
            following: 0.0,
        },
        lobe,
        of_gloss,
        chance: chance * lobe.chance,
        cone_u: min(max(lobe.rest, 0.0), 1.0),
    }
}

/// The faces of an edge that are seen on its two sides, [`NOTHING`] on a side without a face.
#[apply(record!)]
pub struct Sides {
    pub minus: u32,
    pub plus: u32,
    /// Direction from the − side to the + side, perpendicular to the edge and to the direction in which it is seen.
    pub across: V3,
    /// Direction of a ray that passes closely beside the edge's point, on the side without a face, if there is one.
    pub past: V3,
    /// The least depth slopes of faces so far.
    least_minus: f32,
    least_plus: f32,
}

#[cfg_attr(feature = "gpu", cube)]
impl Sides {
    /// Returns the sides of an edge without faces; the + side lies toward `side`.
    #[inline(always)]
    pub fn new(along: V3, view: V3, side: V3) -> Sides {
        // Perpendicular to the plane of the edge and the view, so that lateral positions are comparable.
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

    /// Adds a face that extends from the edge along `inward`.
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

    /// Sets the ray that passes the edge's point, after all faces were added. `to` is the vector to the point.
    #[inline(always)]
    pub fn pass(&mut self, to: V3, position: V3) {
        let step = beside(position) / self.across.length();
        let on_plus = select(self.plus == NOTHING, step, 0.0);
        let step = select(self.minus == NOTHING, -step, on_plus);
        self.past = (to + self.across * step).normalize();
    }
}

/// Returns the distance of a point beside an edge from the edge's point.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn beside(position: V3) -> f32 {
    BESIDE * (0.1 + position.abs().max_element())
}

/// Returns a point beside an edge's point, in the face that `inward` points into. It is so far inside that no ray
/// from it hits the other faces of the edge by rounding.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn inside(position: V3, inward: V3) -> V3 {
    let step = min(beside(position) / max(inward.length(), 1e-37), 0.1);
    position + inward * step
}

/// Returns the direction of the half of a face that lies on a side of the line in which it crosses another face.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn half_beside(normal: V3, along: V3, across: V3) -> V3 {
    let half = normal.cross(along);
    select_vector(half.dot(across) < 0.0, -half, half)
}

/// Returns, of three vectors from a point of a line to the corners of a face, the vector that ends farthest from the
/// line.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn farthest(a: V3, b: V3, c: V3, along: V3) -> V3 {
    let far_a = a.cross(along).length_squared();
    let far_b = b.cross(along).length_squared();
    let far_c = c.cross(along).length_squared();
    let other = select_vector(far_b >= far_c, b, c);
    select_vector(far_a >= far_b && far_a >= far_c, a, other)
}

/// Returns the derivative of g·P with respect to the motion of a plane along its normal. P is a point of the line in
/// which the plane crosses another: n₁·dP and n₂·dP are the motions of the planes.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn by_crossing_plane(normal: V3, other: V3, g: V3) -> V3 {
    let cosine = normal.dot(other);
    let dual = (normal - other * cosine) * (1.0 / max(1.0 - cosine * cosine, 1e-12));
    normal * g.dot(dual)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_make_as_many_searches_as_they_count_for() {
        for of_light in [true, false] {
            let usual = usual_searches(of_light, LOW_SAMPLES_LOG + 1);
            assert_eq!(usual_searches(of_light, LOW_SAMPLES_LOG), 0.5 * usual);
            for counts in [1e-6, 0.05, 0.3, 1.0, 2.0, 3.7, 16.0, 1e30, f32::INFINITY] {
                let wanted = mean_searches(usual, counts);
                let most = most_searches(wanted);
                assert!((1..=MAX_SEARCHES as u32).contains(&most), "{counts}");
                let mean = most as f32 * (wanted / most as f32).min(1.0);
                let wanted = wanted.min(MAX_SEARCHES);
                assert!((mean - wanted).abs() <= 1e-6 * wanted, "{counts}: {mean}");
            }
        }
    }
}
