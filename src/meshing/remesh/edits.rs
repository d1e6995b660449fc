//! The passes of a remeshing over all edges.

use glam::DVec3;

use super::surface::{Surface, roundness};

/// Edges that are longer, in relation to the length that they should have, are split, and shorter ones are collapsed.
const LONGEST: f64 = 4.0 / 3.0;
const SHORTEST: f64 = 4.0 / 5.0;

/// Vertices with more faces keep their edges, as the work for each edge grows with their number.
const CROWD: usize = 1000;

/// The edges of a pass whose ratio is in a range, in the order of `key`.
fn chosen(surface: &Surface, is_chosen: impl Fn(f64) -> bool, sign: f64) -> Vec<[u32; 2]> {
    let with_ratio = |edge| (surface.ratio(edge), edge);
    let edges = surface.edges().into_iter().map(with_ratio);
    let mut edges: Vec<(f64, [u32; 2])> = edges.filter(|(r, _)| is_chosen(*r)).collect();
    edges.sort_by(|a, b| (sign * a.0).total_cmp(&(sign * b.0)));
    edges.into_iter().map(|(_, edge)| edge).collect()
}

/// Splits edges that are too long, the longest first, until none is or there would be more than `most` faces.
pub(super) fn split_long(surface: &mut Surface, most: usize) {
    /// Each round halves edges.
    const ROUNDS: usize = 40;
    for _ in 0..ROUNDS {
        let long = chosen(surface, |ratio| ratio > LONGEST, -1.0);
        if long.is_empty() {
            return;
        }
        for edge in long {
            if surface.faces.len() >= most {
                return;
            }
            surface.split(edge);
        }
    }
}

/// Collapses edges that are too short, the shortest first. With `keeping_long`, edges that are too long already don't
/// hinder it. Returns the number of edges that collapsed.
pub(super) fn collapse_short(surface: &mut Surface, keeping_long: bool) -> usize {
    let mut lists = [Vec::new(), Vec::new()];
    let mut count = 0;
    for edge in chosen(surface, |ratio| ratio < SHORTEST, 1.0) {
        if edge.iter().all(|&v| !surface.around[v as usize].is_empty())
            && surface.ratio(edge) < SHORTEST
        {
            count += usize::from(collapse(surface, edge, keeping_long, &mut lists));
        }
    }
    count
}

/// Collapses an edge if the surface keeps its topology (the link condition: both ends have only the two vertices
/// opposite to the edge in common), no edge gets too long, and no face turns.
fn collapse(
    surface: &mut Surface,
    edge: [u32; 2],
    keeping_long: bool,
    lists: &mut [Vec<u32>; 2],
) -> bool {
    let [a, b] = edge;
    let count = |v: u32| surface.around[v as usize].len();
    if count(a) + count(b) > CROWD {
        return false;
    }
    let Some((pair, opposite)) = surface.pair(edge) else {
        return false;
    };
    let [of_a, of_b] = lists;
    surface.ring(a, of_a);
    surface.ring(b, of_b);
    let common = of_a
        .iter()
        .filter(|v| of_b.binary_search(v).is_ok())
        .count();
    if common != 2 || opposite[0] == opposite[1] || of_a.len() + of_b.len() < 7 {
        return false;
    }
    if opposite
        .iter()
        .any(|&v| count(v) < 4 && !surface.locked[v as usize])
    {
        return false;
    }
    let (p, q) = (surface.points[a as usize], surface.points[b as usize]);
    let middle = (p + q) / 2.0;
    let locked = edge.map(|v| surface.locked[v as usize]);
    let places: &[DVec3] = match locked {
        [true, true] => &[],
        [true, false] => &[p],
        [false, true] => &[q],
        [false, false] => &[middle, p, q],
    };
    let fits = |place: &&DVec3| {
        let wanted = (surface.lengths[a as usize] + surface.lengths[b as usize]) / 2.0;
        let short = |v: &u32| {
            let (to, length) = (surface.points[*v as usize], surface.lengths[*v as usize]);
            let most = LONGEST * (wanted + length) / 2.0;
            let was = || to.distance(p).max(to.distance(q));
            let most = if keeping_long { most.max(was()) } else { most };
            edge.contains(v) || to.distance(**place) < most
        };
        of_a.iter().all(short) && of_b.iter().all(short) && keeps(surface, edge, pair, **place)
    };
    let place = places.iter().find(fits);
    if let Some(&place) = place {
        surface.merge(edge, place);
    }
    place.is_some()
}

/// Returns whether the faces around an edge keep their directions if both ends of it move to a place.
fn keeps(surface: &Surface, edge: [u32; 2], pair: [u32; 2], place: DVec3) -> bool {
    let all = || {
        let around = |v: u32| surface.around[v as usize].iter().copied();
        around(edge[0])
            .chain(around(edge[1]))
            .filter(|k| !pair.contains(k))
    };
    let mean = all()
        .map(|k| surface.normal(k))
        .sum::<DVec3>()
        .normalize_or_zero();
    all().all(|k| {
        let old = surface.corners(k);
        let face = surface.faces[k as usize];
        let new = [0, 1, 2].map(|i| {
            if edge.contains(&face[i]) {
                place
            } else {
                old[i]
            }
        });
        stays(old, new, mean)
    })
}

/// Returns whether a face that moves keeps its direction, about, and does not become a sliver. The
/// directions of slivers are uncertain, so those of the faces around count too.
pub(super) fn stays(old: [DVec3; 3], new: [DVec3; 3], mean: DVec3) -> bool {
    /// Triangles less round are slivers.
    const SLIVER: f64 = 0.1;
    let unit = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).normalize_or_zero();
    let (was, is) = (roundness(old), roundness(new));
    if is < SLIVER.min(0.3 * was) {
        return false;
    }
    if was < SLIVER {
        unit(new).dot(mean) > 0.1 || unit(new).dot(unit(old)) > 0.9
    } else {
        unit(new).dot(unit(old)) > 0.4
    }
}

/// Flips edges where this brings the numbers of edges at vertices nearer to 6 (4 at borders), or where it replaces
/// slivers.
pub(super) fn flip(surface: &mut Surface) {
    let mut list = Vec::new();
    let mut valence: Vec<i32> = (0..surface.points.len() as u32)
        .map(|v| {
            surface.ring(v, &mut list);
            list.len() as i32
        })
        .collect();
    for edge in surface.edges() {
        let Some((pair, opposite)) = surface.pair(edge) else {
            continue;
        };
        let ([a, b], [c, d]) = (edge, opposite);
        let exists = surface.faces_at(opposite).next().is_some();
        if c == d || exists || valence[a as usize] < 4 || valence[b as usize] < 4 {
            continue;
        }
        let off = |v: u32, change: i32| {
            let wanted = if surface.locked[v as usize] { 4 } else { 6 };
            (valence[v as usize] + change - wanted).pow(2)
        };
        let before = off(a, 0) + off(b, 0) + off(c, 0) + off(d, 0);
        let after = off(a, -1) + off(b, -1) + off(c, 1) + off(d, 1);
        let by = [[a, d, c], [d, b, c]];
        if may_flip(surface, pair, by, opposite, after < before) {
            surface.replace(pair, by);
            for (v, change) in [(a, -1), (b, -1), (c, 1), (d, 1)] {
                valence[v as usize] += change;
            }
        }
    }
}

/// Returns whether two faces may be replaced by two others between the same four vertices: these don't fold, the surface
/// is about flat there, and they are better.
fn may_flip(
    surface: &Surface,
    pair: [u32; 2],
    by: [[u32; 3]; 2],
    edge: [u32; 2],
    better: bool,
) -> bool {
    let round = |[t, s]: [[DVec3; 3]; 2]| roundness(t).min(roundness(s));
    let old = pair.map(|k| surface.corners(k));
    let new = by.map(|f| f.map(|v| surface.points[v as usize]));
    let (was, is) = (round(old), round(new));
    if !(better && is > 0.2f64.min(was) || is > 2.0 * was && is > 0.2) {
        return false;
    }
    let normal = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a);
    let [n, m] = old.map(normal);
    let mean = (n + m).normalize_or_zero();
    let flat = was < 0.1 || n.dot(m) > 0.5 * n.length() * m.length();
    let faces = new.map(|t| normal(t).normalize_or_zero().dot(mean) > 0.5);
    flat && faces == [true; 2] && surface.ratio(edge) < 2.0
}
