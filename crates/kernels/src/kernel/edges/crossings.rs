//! Lines in which triangles pass through each other. Colors jump there, although no mesh has an edge.

use glam::DVec3;
use rayon::prelude::*;

use super::{Edge, Kind};
use crate::accel::Overlaps;
use crate::kernel::scene::KernelScene;
use crate::model::V3;
use crate::model::edge::TOUCHING;
use crate::model::triangle::Triangle;
use crate::trace::NONE;
use crate::warning_once;

/// The shutter times at which moving objects are tested.
const TIMES: [f32; 5] = [0.5, 0.0, 1.0, 0.25, 0.75];

/// Returns the corners of a triangle at a shutter time.
fn corners(scene: &KernelScene, k: u32, time: f32) -> [DVec3; 3] {
    let shift = scene.shift(k, time);
    let corners = scene.triangle(k).corners();
    corners.map(|c| (c + shift).into())
}

/// Returns the segment in which two triangles pass through each other at a shutter time, if they do so by more than
/// rounding.
fn segment(scene: &KernelScene, k: u32, l: u32, time: f32) -> Option<[V3; 2]> {
    let (p, q) = (corners(scene, k, time), corners(scene, l, time));
    let normal = |c: &[DVec3; 3]| (c[1] - c[0]).cross(c[2] - c[0]).try_normalize();
    let (n, m) = (normal(&p)?, normal(&q)?);
    let size = p
        .iter()
        .chain(&q)
        .map(|c| c.abs().max_element())
        .fold(0.1, f64::max);
    let tolerance = f64::from(TOUCHING) * size;
    let along = n.cross(m);
    // The ends, along the line, of the part in which one triangle passes the plane of the other.
    let passes = |c: &[DVec3; 3], n: DVec3, on: DVec3| -> Option<[(f64, DVec3); 2]> {
        let d = c.map(|v| n.dot(v - on));
        let (low, high) = (d[0].min(d[1]).min(d[2]), d[0].max(d[1]).max(d[2]));
        if low > -tolerance || high < tolerance {
            return None;
        }
        let sides = [(0, 1), (1, 2), (2, 0)].into_iter();
        let passing = sides.filter(|&(i, j)| (d[i] > 0.0) != (d[j] > 0.0));
        let mut found = passing.map(|(i, j)| {
            let at = c[i] + (c[j] - c[i]) * (d[i] / (d[i] - d[j]));
            (along.dot(at), at)
        });
        let (a, b) = (found.next()?, found.next()?);
        Some(if a.0 <= b.0 { [a, b] } else { [b, a] })
    };
    let first = passes(&q, n, p[0])?;
    let second = passes(&p, m, q[0])?;
    let end = |of_first: bool, i: usize| if of_first { first[i] } else { second[i] };
    let from = end(first[0].0 > second[0].0, 0);
    let to = end(first[1].0 < second[1].0, 1);
    let [a, b] = [from.1, to.1];
    (from.0 < to.0 && a.distance(b) > tolerance).then(|| [a.into(), b.into()])
}

/// The number of consecutive leaves of the hierarchy that share a budget, and the budget of tests of leaves and pairs.
/// So the time is linear in the number of triangles, however many are in one place.
const LEAVES: usize = 128;
const LOOKS: usize = 1 << 18;

/// The crossings of the last render.
#[derive(Default)]
pub(super) struct LastCrossings {
    /// The version of the hierarchy in which they were found, and whether anything moved over the shutter.
    of: Option<(u64, bool)>,
    found: Vec<Edge>,
}

impl LastCrossings {
    /// Finds the crossings of all triangles that have area and share no corner, in the order of these triangles. Those of
    /// triangles that have not moved since the last render are kept.
    pub fn update(&mut self, scene: &KernelScene) -> &[Edge] {
        let hierarchy = &scene.hierarchy;
        let of = (hierarchy.version(), scene.velocities.is_some());
        let last = self.of.filter(|last| last.1 == of.1);
        let moved = last.and_then(|last| hierarchy.moved_since(last.0));
        match moved {
            None => self.found.clear(),
            Some([]) => {}
            Some(moved) => {
                (self.found).retain(|e| !e.faces[..2].iter().any(|&k| moved[k as usize]))
            }
        }
        for edge in &mut self.found {
            edge.object = scene.object_of(edge.faces[0]);
        }
        // What is incomplete is found, and reported, in each render.
        self.of = None;
        if moved.is_none_or(|moved| moved.contains(&true)) {
            let (mut found, all) = find(scene, &Overlaps::new(hierarchy, moved));
            self.found.append(&mut found);
            self.found
                .sort_unstable_by_key(|e| [e.faces[0], e.faces[1]]);
            self.of = all.then_some(of);
        } else {
            self.of = Some(of);
        }
        &self.found
    }
}

/// Returns the crossings among pairs of triangles, and whether all were found.
fn find(scene: &KernelScene, overlaps: &Overlaps) -> (Vec<Edge>, bool) {
    let times: &[f32] = if scene.velocities.is_some() {
        &TIMES
    } else {
        &[0.0]
    };
    let of_chunk = |pairs: &mut Vec<[u32; 2]>, chunk: usize| {
        pairs.clear();
        let mut leaves = chunk * LEAVES..((chunk + 1) * LEAVES).min(overlaps.leaves());
        let mut left = LOOKS;
        let all = leaves.all(|leaf| overlaps.add_pairs(leaf, &mut left, pairs));
        let cross = |&[k, l]: &[u32; 2]| {
            if !may_cross(scene, k, l) {
                return None;
            }
            let at = |&time: &f32| segment(scene, k, l, time).map(|s| (s, time));
            let (segment, time) = times.iter().find_map(at)?;
            Some(crossing(scene, k, l, segment, time))
        };
        let found: Vec<Edge> = pairs.iter().filter_map(cross).collect();
        (found, all)
    };
    let chunks = (0..overlaps.leaves().div_ceil(LEAVES)).into_par_iter();
    let found: Vec<(Vec<Edge>, bool)> = chunks.map_init(Vec::new, of_chunk).collect();
    let all = found.iter().all(|f| f.1);
    if !all {
        warning_once!(
            "very many triangles are in one place: not all lines in which they pass through each other \
             are found, gradients lack the jumps there"
        );
    }
    (found.into_iter().flat_map(|f| f.0).collect(), all)
}

/// Returns whether two triangles may pass through each other, judged by corners and planes.
fn may_cross(scene: &KernelScene, k: u32, l: u32) -> bool {
    let (t, s) = (scene.triangle(k), scene.triangle(l));
    if s.area <= 0.0 || t.area <= 0.0 || t.corners().iter().any(|c| s.corners().contains(c)) {
        return false;
    }
    if scene.velocities.is_some() {
        return true;
    }
    let passes = |plane: &Triangle, other: &Triangle| {
        let above = other.corners().map(|c| plane.above(c));
        above.iter().any(|&d| d > 0.0) && above.iter().any(|&d| d < 0.0)
    };
    passes(&t, &s) && passes(&s, &t)
}

fn crossing(scene: &KernelScene, k: u32, l: u32, [a, b]: [V3; 2], time: f32) -> Edge {
    // At the start of the shutter, as if both triangles moved like the first.
    let shift = scene.shift(k, time);
    Edge {
        a: a - shift,
        along: b - a,
        faces: [k, l, NONE, NONE],
        rows: [[0; 2]; 2],
        object: scene.object_of(k),
        kind: Kind::Crossing,
        crease: 1.0,
        followed: false,
        closed: false,
        apart: scene.shift(k, 1.0) != scene.shift(l, 1.0),
    }
}
