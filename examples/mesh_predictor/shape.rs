//! The shapes of the data set: boxes, superquadrics, lathe shapes, unions of two, links, mugs, frames and letters.

use std::f64::consts::{PI, TAU};

use glam::{DQuat, DVec2, DVec3};
use softray::meshing::TriangleMesh;

use super::numbers::Numbers;

/// The number of rings of a smooth surface, and of vertices per ring.
const RINGS: usize = 31;
const AROUND: usize = 48;
/// The number of radii that a lathe's profile interpolates.
const KNOTS: usize = 5;

/// The kinds of shapes.
pub const KINDS: [&str; 8] = [
    "box",
    "superquadric",
    "lathe",
    "union of two",
    "link",
    "mug",
    "frame",
    "letter",
];

/// The strokes of letters about the origin, from and to (x, y), with the numbers of their holes.
const LETTERS: [(usize, &[[f64; 4]]); 6] = [
    // A, P, H, T, L, E
    (
        1,
        &[
            [-0.5, -0.7, 0.0, 0.7],
            [0.5, -0.7, 0.0, 0.7],
            [-0.3, -0.25, 0.3, -0.25],
        ],
    ),
    (
        1,
        &[
            [-0.35, -0.7, -0.35, 0.7],
            [-0.35, 0.7, 0.35, 0.7],
            [0.35, 0.7, 0.35, 0.0],
            [0.35, 0.0, -0.35, 0.0],
        ],
    ),
    (
        0,
        &[
            [-0.45, -0.7, -0.45, 0.7],
            [0.45, -0.7, 0.45, 0.7],
            [-0.45, 0.0, 0.45, 0.0],
        ],
    ),
    (0, &[[-0.55, 0.7, 0.55, 0.7], [0.0, 0.7, 0.0, -0.7]]),
    (0, &[[-0.4, 0.7, -0.4, -0.7], [-0.4, -0.7, 0.4, -0.7]]),
    (
        0,
        &[
            [-0.4, -0.7, -0.4, 0.7],
            [-0.4, 0.7, 0.4, 0.7],
            [-0.4, 0.0, 0.25, 0.0],
            [-0.4, -0.7, 0.4, -0.7],
        ],
    ),
];

/// A body, which may be the union of several closed surfaces that overlap.
#[derive(Clone, Debug)]
pub struct Shape {
    /// The index of its kind in [`KINDS`].
    pub kind: usize,
    /// The surface, with faces that are counter-clockwise from outside. It is inside of a ball about the origin.
    pub mesh: TriangleMesh,
    /// The number of holes through the body.
    pub genus: usize,
    /// The largest turn about the y axis, in radians, at which its silhouette shows what it is.
    pub turn: f64,
}

impl Shape {
    /// Returns a random shape of a kind, an index into [`KINDS`].
    pub fn random(kind: usize, n: &mut Numbers) -> Self {
        let (parts, genus, turn) = match KINDS[kind] {
            "box" => (vec![cuboid(DVec3::from(n.vector(0.25, 0.7)))], 0, PI),
            "superquadric" => (vec![superquadric(n)], 0, PI),
            "lathe" => {
                let height = n.uniform(0.4, 0.85);
                (vec![revolved(&turned(height, n.vector(0.12, 0.62)))], 0, PI)
            }
            "union of two" => {
                let one = |n: &mut Numbers| match n.index(2) {
                    0 => cuboid(DVec3::from(n.vector(0.2, 0.55))),
                    _ => superquadric(n),
                };
                let (first, second) = (one(n), one(n));
                let turn = DQuat::from_rotation_y(n.uniform(0.0, PI));
                // Balls of these radii are inside of them, also of octahedra, so that the two overlap.
                let [a, b] =
                    [&first, &second].map(|mesh| extent(mesh).min_element() / 3_f64.sqrt());
                let along = DVec3::from(n.vector(-1.0, 1.0)).normalize_or(DVec3::X);
                let offset = along * ((a + b) * n.uniform(0.5, 0.95));
                (vec![first, moved(second, |p| turn * p + offset)], 0, PI)
            }
            "link" => {
                let (bend, straight) = (n.uniform(0.3, 0.5), n.uniform(-0.4, 0.6).max(0.0));
                let curve = (0..AROUND).map(|i| {
                    let p = DVec2::from_angle(TAU * (i as f64 + 0.5) / AROUND as f64) * bend;
                    p + DVec2::new(0.0, straight * p.y.signum())
                });
                let radius = bend * n.uniform(0.25, 0.5);
                (vec![tube(&curve.collect::<Vec<_>>(), radius, true)], 1, 1.0)
            }
            "mug" => (mug(n), 1, 1.2),
            "frame" => (vec![frame(n)], 1, 1.0),
            _ => {
                let (parts, genus) = letter(n.index(LETTERS.len()), n);
                (parts, genus, 1.0)
            }
        };
        let mut mesh = joined(parts);
        let all = mesh.positions.iter().map(|&p| DVec3::from(p));
        let (min, max) = all
            .clone()
            .fold((DVec3::MAX, DVec3::MIN), |(a, b), p| (a.min(p), b.max(p)));
        let middle = 0.5 * (min + max);
        let farthest = all.map(|p| p.distance(middle)).fold(0.0, f64::max);
        let scale = n.uniform(0.6, 0.8) / farthest;
        let place = |p: &[f64; 3]| ((DVec3::from(*p) - middle) * scale).to_array();
        mesh.positions = mesh.positions.iter().map(place).collect();
        Self {
            kind,
            mesh,
            genus,
            turn,
        }
    }
}

/// The largest distance from the origin along each axis.
fn extent(mesh: &TriangleMesh) -> DVec3 {
    let all = mesh.positions.iter();
    all.fold(DVec3::ZERO, |most, &p| most.max(DVec3::from(p).abs()))
}

fn moved(mut mesh: TriangleMesh, f: impl Fn(DVec3) -> DVec3) -> TriangleMesh {
    let positions = mesh.positions.iter();
    mesh.positions = positions.map(|&p| f(p.into()).to_array()).collect();
    mesh
}

fn joined(parts: Vec<TriangleMesh>) -> TriangleMesh {
    let mut all = TriangleMesh {
        positions: Vec::new(),
        faces: Vec::new(),
    };
    for part in parts {
        let before = all.positions.len() as u32;
        all.positions.extend(part.positions);
        all.faces
            .extend(part.faces.iter().map(|face| face.map(|v| v + before)));
    }
    all
}

/// The closed surface through rings of as many vertices each. Without ends, the last ring is joined to the first one.
fn rings(rings: &[Vec<DVec3>], ends: Option<[DVec3; 2]>) -> TriangleMesh {
    let (count, around) = (rings.len(), rings[0].len());
    let mut positions: Vec<DVec3> = rings.concat();
    let at = |ring: usize, j: usize| (ring % count * around + j % around) as u32;
    let mut faces = Vec::new();
    for j in 0..around {
        let joined = if ends.is_some() { count - 1 } else { count };
        for i in 0..joined {
            let (a, b, c, d) = (at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j));
            faces.extend([[a, d, c], [a, c, b]]);
        }
        if ends.is_some() {
            let first = (count * around) as u32;
            faces.push([first, at(0, j), at(0, j + 1)]);
            faces.push([at(count - 1, j), first + 1, at(count - 1, j + 1)]);
        }
    }
    positions.extend(ends.into_iter().flatten());
    let positions = positions.iter().map(|p| p.to_array()).collect();
    let mut mesh = TriangleMesh { positions, faces };
    if mesh.volume() < 0.0 {
        mesh.faces.iter_mut().for_each(|face| face.swap(1, 2));
    }
    mesh
}

/// A box about the origin.
fn cuboid(half: DVec3) -> TriangleMesh {
    let ring = |y: f64| {
        let corners = [(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)];
        corners.map(|(x, z)| half * DVec3::new(x, y, z)).to_vec()
    };
    let ends = [-1.0, 1.0].map(|y| DVec3::new(0.0, y * half.y, 0.0));
    rings(&[ring(-1.0), ring(1.0)], Some(ends))
}

/// |y/b|^(2/m) + (|x/a|^(2/s) + |z/c|^(2/s))^(s/m) = 1, the spherical product of a meridian and a section (Barr 1981,
/// *Superquadrics and Angle-Preserving Transformations*), with random a, b, c, m and s.
fn superquadric(n: &mut Numbers) -> TriangleMesh {
    let axes = DVec3::from(n.vector(0.28, 0.68));
    let [meridian, section] = n.vector(0.3, 2.0);
    let ring = |i: usize| {
        let angle = PI * ((i + 1) as f64 / (RINGS + 1) as f64 - 0.5);
        let (radius, y) = (power(angle.cos(), meridian), power(angle.sin(), meridian));
        let vertex = |j: usize| {
            let (sin, cos) = (TAU * j as f64 / AROUND as f64).sin_cos();
            axes * DVec3::new(
                radius * power(cos, section),
                y,
                radius * power(sin, section),
            )
        };
        (0..AROUND).map(vertex).collect()
    };
    let ends = [-1.0, 1.0].map(|y| DVec3::new(0.0, y * axes.y, 0.0));
    rings(&(0..RINGS).map(ring).collect::<Vec<_>>(), Some(ends))
}

/// Returns |x|^exponent with the sign of x. Values of x that differ from 0 by rounding give 0.
fn power(x: f64, exponent: f64) -> f64 {
    if x.abs() < 1e-12 {
        0.0
    } else {
        x.signum() * x.abs().powf(exponent)
    }
}

/// A profile (radius, y) rotated about the y axis, from end to end on the axis.
fn revolved(profile: &[DVec2]) -> TriangleMesh {
    let ring = |p: &DVec2| {
        let vertex = |j: usize| {
            let around = DVec2::from_angle(TAU * j as f64 / AROUND as f64) * p.x;
            DVec3::new(around.x, p.y, around.y)
        };
        (0..AROUND).map(vertex).collect()
    };
    let inner = &profile[1..profile.len() - 1];
    let ends = [profile[0], profile[profile.len() - 1]].map(|p| DVec3::new(0.0, p.y, 0.0));
    rings(&inner.iter().map(ring).collect::<Vec<_>>(), Some(ends))
}

/// Returns a smooth profile through radii at even heights, rounded at both ends. `height` is half its height.
fn turned(height: f64, knots: [f64; KNOTS]) -> Vec<DVec2> {
    let point = |i: usize| {
        // Points are denser at the ends, where the profile bends most.
        let t = -(PI * i as f64 / (RINGS + 1) as f64).cos();
        let place = 0.5 * (t + 1.0) * (KNOTS - 1) as f64;
        let k = (place as usize).min(KNOTS - 2);
        let share = 0.5 - 0.5 * (PI * (place - k as f64)).cos();
        let radius = knots[k] + share * (knots[k + 1] - knots[k]);
        DVec2::new(radius * (1.0 - t.powi(8)).max(0.0).sqrt(), height * t)
    };
    (0..RINGS + 2).map(point).collect()
}

/// A round tube along a curve in the plane z = 0, closed or with flat ends.
fn tube(curve: &[DVec2], radius: f64, closed: bool) -> TriangleMesh {
    let count = curve.len();
    let ring = |i: usize| {
        let [before, after] = match closed {
            true => [(i + count - 1) % count, (i + 1) % count],
            false => [i.saturating_sub(1), (i + 1).min(count - 1)],
        };
        let across = (curve[after] - curve[before]).normalize().perp();
        let vertex = |j: usize| {
            let (sin, cos) = (TAU * j as f64 / 16.0).sin_cos();
            (curve[i] + across * (radius * cos)).extend(radius * sin)
        };
        (0..16).map(vertex).collect()
    };
    let ends = [curve[0], curve[count - 1]].map(|p| p.extend(0.0));
    rings(
        &(0..count).map(ring).collect::<Vec<_>>(),
        (!closed).then_some(ends),
    )
}

/// A hollow cup with a handle, whose ends are in the wall.
fn mug(n: &mut Numbers) -> Vec<TriangleMesh> {
    let (radius, height, wall) = (
        n.uniform(0.35, 0.5),
        n.uniform(0.4, 0.6),
        n.uniform(0.09, 0.13),
    );
    let inner = radius - wall;
    let profile = [
        (0.0, -height),
        (radius, -height),
        (radius, height),
        (inner, height),
        (inner, wall - height),
        (0.0, wall - height),
    ];
    let profile = profile.map(|(r, y)| DVec2::new(r, y));
    let thick = n.uniform(0.07, 0.1);
    let (out, up) = (n.uniform(0.28, 0.4), height * n.uniform(0.55, 0.75));
    let arc = (0..=16).map(|i| {
        let (sin, cos) = (PI * (f64::from(i) / 16.0 - 0.5)).sin_cos();
        DVec2::new(radius - 0.5 * wall + out * cos, up * sin)
    });
    vec![
        revolved(&profile),
        tube(&arc.collect::<Vec<_>>(), thick, false),
    ]
}

/// The strokes of a letter, and its number of holes.
fn letter(index: usize, n: &mut Numbers) -> (Vec<TriangleMesh>, usize) {
    let (genus, strokes) = LETTERS[index];
    let (width, depth) = (n.uniform(0.1, 0.16), n.uniform(0.12, 0.25));
    let stroke = |(i, &[x, y, to_x, to_y]): (usize, &[f64; 4])| {
        let (from, to) = (DVec2::new(x, y), DVec2::new(to_x, to_y));
        let along = to - from;
        let turn = DQuat::from_rotation_z(along.to_angle());
        let middle = (0.5 * (from + to)).extend(0.0);
        // Strokes differ a little, so that no two faces are in one plane.
        let size = 1.0 - 0.02 * i as f64;
        let half = DVec3::new(
            0.5 * along.length() + width * size,
            width * size,
            depth * size,
        );
        moved(cuboid(half), |p| turn * p + middle)
    };
    (strokes.iter().enumerate().map(stroke).collect(), genus)
}

/// A rectangle with a rectangular hole.
fn frame(n: &mut Numbers) -> TriangleMesh {
    let (half, depth) = (DVec2::from(n.vector(0.4, 0.7)), n.uniform(0.08, 0.2));
    let hole = half - n.uniform(0.12, 0.22);
    let corner = |(x, y): (f64, f64)| {
        let at = |half: DVec2, z: f64| (half * DVec2::new(x, y)).extend(z);
        vec![
            at(half, -depth),
            at(half, depth),
            at(hole, depth),
            at(hole, -depth),
        ]
    };
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    rings(&corners.map(corner), None)
}

#[cfg(test)]
mod tests {
    use super::*;
    use softray::meshing::signed_distances;
    use softray::modules::TetrahedralGrid;
    use softray::prelude::*;

    /// The parts are closed surfaces that face outwards. The surface of their union is one, with as many holes as it says.
    fn check(mesh: &TriangleMesh, genus: usize, kind: &str) {
        let device = Device::flex();
        let grid = TetrahedralGrid::new(56, 2.0).expect("a grid");
        let found = mesh.statistics().expect("a valid mesh");
        assert!(found.is_solid() && found.volume > 0.0, "{kind}: {found:?}");
        let nodes = grid.nodes(&device).into_data();
        let nodes: Vec<f64> = nodes.iter::<f64>().collect();
        let nodes: Vec<[f64; 3]> = nodes.chunks(3).map(|p| [p[0], p[1], p[2]]).collect();
        let distances = signed_distances(mesh, &nodes).expect("a closed mesh");
        let distances = Tensor::<1>::from_floats(distances.as_slice(), &device);
        let size = grid.size();
        let union = grid.surfaces(distances.reshape([1, size, size, size]), None);
        let union = TriangleMesh::try_from(&union.expect("a surface")[0]).expect("a mesh");
        let union = union.statistics().expect("a valid mesh");
        assert_eq!((union.genus, union.components), (Some(genus), 1), "{kind}");
    }

    #[test]
    fn shapes_are_closed_and_have_their_holes() {
        for (i, kind) in (0..KINDS.len()).flat_map(|kind| [kind; 3]).enumerate() {
            let shape = Shape::random(kind, &mut Numbers::new(5, i as u64));
            check(&shape.mesh, shape.genus, KINDS[kind]);
        }
        for index in 0..LETTERS.len() {
            let (parts, genus) = letter(index, &mut Numbers::new(7, index as u64));
            check(&joined(parts), genus, &format!("letter {index}"));
        }
    }
}
