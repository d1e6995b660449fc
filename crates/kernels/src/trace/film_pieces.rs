//! Pieces of edges on the film, and the weights by which they are drawn.

use crate::cube::*;

use super::edge_points::{IS_CROSSING, OF_EDGE};
use super::scene::{RESTING, Scene};
use crate::model::camera::Camera;
use crate::model::edge_weight::{CLOSED, FOLD};
use crate::model::lists::vector;
use crate::model::segment::{Part, clip_linear};
use crate::model::{V2, V3, v2, v3};

/// Words of a slot, which is the room for a piece of an edge: the edge, and the number of the piece times [`PIECES`] plus
/// the logarithm to base 2 of the number of pieces.
pub const OF_SLOT: usize = 2;
pub const PIECES: u32 = 16;

/// Whether a camera sees a face from the front is not certain up to this part of the distance to it.
const EDGE_ON: f32 = 1e-5;

/// The part of an edge that a camera may see, from some point of its lens at some time.
#[apply(record!)]
pub struct FilmLine {
    /// Whether there is such a part, and the part.
    pub is_seen: bool,
    part: Part,
    /// The bound of the jump; 0 if nothing jumps.
    pub jump: f32,
    /// The part's ends as seen from the middle of the lens at the middle of the shutter: film coordinates in halves of the
    /// image height about the image center, y up, and 1 over their divisor, the depth in a perspective.
    pub first: V3,
    pub last: V3,
    /// Half the displacement over the shutter, in the camera's basis, without signs.
    way: V3,
    /// Whether the edge is a crossing whose line moves, which is not divided.
    pub is_apart: bool,
}

/// A piece of an edge, between two values of λ.
#[apply(record!)]
pub struct FilmPiece {
    pub from: f32,
    pub to: f32,
    /// The bound of its jump, times its length in pixels, times about the probability that a point of it is seen; 0 if
    /// it is hidden.
    pub weight: f32,
    /// Its middle on the film in pixels.
    pub middle: V2,
}

/// Returns a bound of the jump at an edge from `start` that is displaced by up to `moved` over the shutter.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn jump_on_film(scene: &Scene, c: &Camera, edge: u32, start: V3, moved: f32) -> f32 {
    let kind = scene.edge_kinds[edge as usize];
    let mut jump = 1.0f32;
    if kind % CLOSED == FOLD {
        // Parallel rays see a face from the same side wherever it moves.
        let mut to_eye = -c.forward;
        let mut slack = 0.0f32;
        if !c.parallel {
            to_eye = c.eye - start;
            // The largest distance of a ray's start from the camera's middle, plus that by which the edge moves. Within it,
            // a face may be seen from either side.
            slack = c.aperture + moved;
        }
        slack += EDGE_ON * to_eye.length();
        let faces = OF_EDGE * edge as usize;
        let front = scene.plane(scene.of_edges[faces]).normal.dot(to_eye);
        let back = scene.plane(scene.of_edges[faces + 1]).normal.dot(to_eye);
        let least = min(front.abs(), back.abs());
        if least > slack && front * back > 0.0 {
            let hidden = kind & CLOSED != 0 && front < 0.0;
            jump = select(hidden, 0.0, scene.creases[edge as usize]);
            if comptime!(scene.features.follows_on_film()) {
                let rests = scene.settings[RESTING] < 1.0 && !scene.edge_moves(edge);
                let carried = scene.is_carried(scene.of_edges[faces])
                    && scene.is_carried(scene.of_edges[faces + 1]);
                let still = rests || (carried && scene.follows_on_film());
                jump = select(still, 0.0, jump);
            }
        }
    }
    if comptime!(scene.features.follows_on_film()) {
        jump *= select(scene.edge_moves(edge), 1.0, scene.settings[RESTING]);
    }
    jump
}

/// Returns the film coordinates of a point in the camera's basis, and 1 over their divisor.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn on_film(c: &Camera, p: V3) -> V3 {
    let inverse = c.per_depth(p.z);
    v3(p.x * inverse, p.y * inverse, inverse)
}

/// Returns by how much the lens displaces a point along both axes of the film, per difference of its inverse depth from
/// that of the focal plane.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn reach_of_lens(c: &Camera) -> V2 {
    let mut aperture = c.aperture;
    if c.parallel {
        aperture = 0.0f32;
    }
    v2(aperture * c.dual.x.length(), aperture * c.dual.y.length())
}

/// Returns the part of `part` in which the coordinate of a point is within a limit of either sign, from the coordinates
/// and limits at the ends of the segment.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn clip_within(part: Part, at_a: f32, at_b: f32, limit_a: f32, limit_b: f32) -> Part {
    let above = clip_linear(part, limit_a + at_a, limit_b + at_b);
    clip_linear(above, limit_a - at_a, limit_b - at_b)
}

/// Returns the part of an edge that a camera may see. `radius` is that of the pixel filter.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn film_line(scene: &Scene, c: &Camera, radius: f32, edge: u32) -> FilmLine {
    let start = vector(scene.edges, 6 * edge);
    let along = c.local(vector(scene.edges, 6 * edge + 3));
    let of_edge = OF_EDGE * edge as usize;
    let velocity = scene.shift(scene.of_edges[of_edge], 1.0);
    let moved = velocity.length();
    let mut way = c.local(velocity).abs() * 0.5;
    // The part in front of the camera, from a to b.
    let all = c.local(start + velocity * 0.5 - c.eye);
    let past = all + along;
    let near = 1e-4 * (max(all.z.abs(), past.z.abs()) + c.aperture + moved);
    let whole = Part {
        from: 0.0f32.runtime(),
        to: 1.0f32.runtime(),
    };
    let before = clip_linear(whole, all.z - near, past.z - near);
    let a = all + along * before.from;
    let b = all + along * before.to;
    let mut divisor_a = a.z;
    let mut divisor_b = b.z;
    if c.parallel {
        way.z = 0.0f32;
        divisor_a = 1.0f32;
        divisor_b = 1.0f32;
    }
    // The film, enlarged by the reach of its filter and by the displacement through lens and shutter, is linear along the
    // edge, times the divisor. The displacement through the lens is convex.
    let lens = reach_of_lens(c);
    let blur_a = (a.z * c.per_focus - 1.0).abs();
    let blur_b = (b.z * c.per_focus - 1.0).abs();
    let high = 1.0 + (1.0 + 2.0 * radius) / c.height;
    let wide = high - 1.0 + c.width / c.height;
    let cut = clip_within(
        whole,
        a.x,
        b.x,
        wide * (divisor_a + way.z) + way.x + lens.x * blur_a,
        wide * (divisor_b + way.z) + way.x + lens.x * blur_b,
    );
    let cut = clip_within(
        cut,
        a.y,
        b.y,
        high * (divisor_a + way.z) + way.y + lens.y * blur_a,
        high * (divisor_b + way.z) + way.y + lens.y * blur_b,
    );
    let length = before.to - before.from;
    FilmLine {
        is_seen: before.from < before.to && cut.from < cut.to,
        part: Part {
            from: before.from + length * cut.from,
            to: before.from + length * cut.to,
        },
        jump: jump_on_film(scene, c, edge, start, moved),
        first: on_film(c, a + (b - a) * cut.from),
        last: on_film(c, a + (b - a) * cut.to),
        way,
        is_apart: scene.of_edges[of_edge + IS_CROSSING as usize] == 2,
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl FilmLine {
    /// Returns its length on the film in pixels.
    #[inline(always)]
    pub fn length(&self, c: &Camera) -> f32 {
        let x = self.last.x - self.first.x;
        let y = self.last.y - self.first.y;
        0.5 * c.height * (x * x + y * y).sqrt()
    }

    /// Returns the film coordinates at a part of its length on the film, and 1 over their divisor.
    #[inline(always)]
    fn at(&self, share: f32) -> V3 {
        self.first + (self.last - self.first) * share
    }

    /// Returns λ at a part of its length on the film.
    #[inline(always)]
    fn lambda(&self, share: f32) -> f32 {
        let rest = self.first.z * (1.0 - share);
        let along = self.last.z * share;
        self.part.from + (self.part.to - self.part.from) * (along / (rest + along))
    }

    /// Returns about the probability that a point at film coordinates is seen: lens and shutter displace it by a part of
    /// the film.
    #[inline(always)]
    fn probability(&self, c: &Camera, at: V3) -> f32 {
        let lens = reach_of_lens(c);
        let blur = (at.z - c.per_focus).abs();
        let x = lens.x * blur + (self.way.x + self.way.z * at.x.abs()) * at.z;
        let y = lens.y * blur + (self.way.y + self.way.z * at.y.abs()) * at.z;
        1.0 / ((1.0 + x) * (1.0 + y))
    }

    /// Returns piece `number` of 2^`log` pieces of equal length on the film. An edge whose line moves is one piece.
    #[inline(always)]
    pub fn piece(&self, c: &Camera, number: u32, log: u32) -> FilmPiece {
        let step = 1.0 / (1u32 << log) as f32;
        let from = number as f32 * step;
        let to = from + step;
        let seen = min(
            self.probability(c, self.at(from)),
            self.probability(c, self.at(to)),
        );
        let middle = self.at(from + 0.5 * step);
        let weight = self.length(c) * step * self.jump * seen;
        FilmPiece {
            from: select(self.is_apart, 0.0, self.lambda(from)),
            to: select(self.is_apart, 1.0, self.lambda(to)),
            weight: select(self.is_seen, weight, 0.0),
            middle: v2(
                0.5 * (c.width + middle.x * c.height),
                0.5 * (1.0 - middle.y) * c.height,
            ),
        }
    }
}

/// Returns the piece of a view's slot. `radius` is that of the pixel filter.
#[cfg(feature = "gpu")]
#[cube]
pub fn piece_of_slot(scene: &Scene, c: &Camera, radius: f32, slot: u32) -> FilmPiece {
    let at = OF_SLOT * slot as usize;
    let place = scene.slots[at + 1];
    let line = film_line(scene, c, radius, scene.slots[at]);
    line.piece(c, place / PIECES, place % PIECES)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::camera::Dual;
    use crate::model::edge_weight::BORDER;
    use crate::model::{Pair, splat};
    use crate::trace::{Features, NONE};

    fn camera(parallel: bool) -> Camera {
        let [x, y, z] = V3::AXES;
        let aperture = if parallel { 0.0 } else { 0.2 };
        Camera {
            across: x * 0.7,
            upward: y * 0.5,
            forward: z + x * 0.1,
            dual: Dual {
                x: (x - z * 0.1) * (1.0 / 0.7),
                y: y * 2.0,
                z,
            },
            lens: Pair {
                first: x * aperture,
                second: y * aperture,
            },
            aperture,
            per_focus: if parallel { 0.0 } else { 0.4 },
            parallel,
            width: 40.0,
            height: 30.0,
            ..Camera::default()
        }
    }

    /// Points that a camera sees from any point of its lens at any time are in pieces, and pieces are of equal length.
    #[test]
    fn pieces_cover_what_is_seen() {
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        };
        let (mut seen, mut hidden) = (0, 0);
        for i in 0..2000 {
            let c = camera(i % 2 == 1);
            let mut vector = || v3(random(), random(), random());
            let (a, along, velocity) = (vector() * 3.0, vector() * 4.0, vector() * 0.4);
            let scene = Scene {
                edges: &[a, along].map(V3::to_array).concat(),
                of_edges: &[0, NONE, NONE, NONE, 0, 0, 0, 0, 0, 0],
                edge_kinds: &[BORDER],
                triangles: &[0; 8],
                velocities: &velocity.to_array(),
                features: Features {
                    moves: true,
                    ..Features::default()
                },
                ..Scene::default()
            };
            let line = film_line(&scene, &c, 0.0, 0);
            let all = line.piece(&c, 0, 0);
            for _ in 0..100 {
                let (share, time) = (0.5 * (random() + 1.0), 0.5 * (random() + 1.0));
                let (x, y) = (0.7 * random(), 0.7 * random());
                let point = |time: f32| a + along * share + velocity * time;
                let depths = [point(time), point(0.5)].map(|p| c.local(p).z);
                let at = c.project(point(time), x, y);
                let on_film = (0.0..c.width).contains(&at.x) && (0.0..c.height).contains(&at.y);
                if depths[0] > 0.0 && depths[1] > 0.01 && on_film {
                    let is_in = all.from - 1e-4 < share && share < all.to + 1e-4;
                    assert!(all.weight > 0.0 && is_in, "{i}: {share} {line:?}");
                    seen += 1;
                }
            }
            hidden += usize::from(all.weight == 0.0);
            // Places very near to the camera are lost by rounding.
            if all.weight == 0.0 || line.first.z.max(line.last.z) > 20.0 {
                continue;
            }
            let place = |share: f32| {
                let at = c.project(a + along * share + velocity * 0.5, 0.0, 0.0);
                v3(at.x, at.y, 0.0)
            };
            let mut past = all.from;
            for number in 0..8 {
                let piece = line.piece(&c, number, 3);
                assert_eq!(piece.from, past);
                past = piece.to;
                let (from, to) = (place(piece.from), place(piece.to));
                let length = (to - from).length();
                let size = from.abs().max(to.abs()).max(splat(1.0)).max_element();
                let wanted = line.length(&c) / 8.0;
                assert!(
                    (length - wanted).abs() < 1e-3 * (wanted + size),
                    "{i} {number}"
                );
                let middle = v3(piece.middle.x, piece.middle.y, 0.0) - (from + to) * 0.5;
                assert!(middle.length() < 1e-3 * size, "{i} {number}: {middle:?}");
            }
            assert!((past - all.to).abs() < 1e-6);
        }
        assert!(seen > 10_000 && hidden > 100, "{seen} {hidden}");
    }
}
