//! Lines in which triangles pass through each other: there what is seen jumps, though no mesh has an edge.

use glam::DVec3;
use rayon::prelude::*;

use super::edges::{Edge, FACES, Kind};
use super::vertex::TOUCHING;
use crate::kernel::scene::KernelScene;
use crate::model::V3;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
struct Box3 {
    min: DVec3,
    max: DVec3,
}

impl Box3 {
    const EMPTY: Self = Self {
        min: DVec3::INFINITY,
        max: DVec3::NEG_INFINITY,
    };

    fn with(self, p: DVec3) -> Self {
        Self {
            min: self.min.min(p),
            max: self.max.max(p),
        }
    }

    fn union(self, o: Self) -> Self {
        Self {
            min: self.min.min(o.min),
            max: self.max.max(o.max),
        }
    }

    fn overlaps(&self, o: &Self) -> bool {
        self.min.cmple(o.max).all() && o.min.cmple(self.max).all()
    }
}

/// Times in the shutter at which moving objects are looked at.
const TIMES: [f32; 5] = [0.5, 0.0, 1.0, 0.25, 0.75];

/// The corners of a triangle at a time.
fn corners(scene: &KernelScene, k: u32, time: f32) -> [DVec3; 3] {
    let shift = scene.shift(k, time);
    scene.triangles[k as usize]
        .corners
        .map(|c| (c + shift).into())
}

/// The segment in which two triangles pass through each other at a time, if they do so by more than
/// rounding.
pub(super) fn segment(scene: &KernelScene, k: u32, l: u32, time: f32) -> Option<[V3; 2]> {
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
    // Along the line: where the second triangle passes the plane of the first, and the other way round.
    let passes = |c: &[DVec3; 3], n: DVec3, on: DVec3| -> Option<[(f64, DVec3); 2]> {
        let d = c.map(|v| n.dot(v - on));
        let (low, high) = (d[0].min(d[1]).min(d[2]), d[0].max(d[1]).max(d[2]));
        if low > -tolerance || high < tolerance {
            return None;
        }
        let mut found = [None; 2];
        let mut count = 0;
        for i in 0..3 {
            let j = (i + 1) % 3;
            if (d[i] > 0.0) != (d[j] > 0.0) && count < 2 {
                let at = c[i] + (c[j] - c[i]) * (d[i] / (d[i] - d[j]));
                found[count] = Some((along.dot(at), at));
                count += 1;
            }
        }
        let [a, b] = found;
        let (a, b) = (a?, b?);
        Some(if a.0 <= b.0 { [a, b] } else { [b, a] })
    };
    let first = passes(&q, n, p[0])?;
    let second = passes(&p, m, q[0])?;
    let from = if first[0].0 > second[0].0 {
        first[0]
    } else {
        second[0]
    };
    let to = if first[1].0 < second[1].0 {
        first[1]
    } else {
        second[1]
    };
    let [a, b] = [from.1, to.1];
    (from.0 < to.0 && a.distance(b) > tolerance).then(|| [a.into(), b.into()])
}

/// The crossings that concern objects for which `matters` is true, or any pair if one of it does.
pub(super) fn find(scene: &KernelScene, matters: &(impl Fn(u32) -> bool + Sync)) -> Vec<Edge> {
    let times: &[f32] = if scene.velocities.is_some() {
        &TIMES
    } else {
        &[0.0]
    };
    let bounds: Vec<Box3> = (0..scene.triangles.len() as u32)
        .into_par_iter()
        .map(|k| {
            let moved = [0.0, 1.0].into_iter().flat_map(|t| corners(scene, k, t));
            moved.fold(Box3::EMPTY, Box3::with)
        })
        .collect();
    let of_object: Vec<Box3> = scene
        .objects
        .iter()
        .map(|o| {
            let range = o.first_triangle..o.first_triangle + o.triangles;
            bounds[range].iter().fold(Box3::EMPTY, |a, b| a.union(*b))
        })
        .collect();
    let mut found = Vec::new();
    for i in 0..scene.objects.len() {
        for j in i..scene.objects.len() {
            if !(matters(i as u32) || matters(j as u32)) || !of_object[i].overlaps(&of_object[j]) {
                continue;
            }
            let list = |a: usize, b: usize| -> Vec<u32> {
                let o = &scene.objects[a];
                (o.first_triangle as u32..(o.first_triangle + o.triangles) as u32)
                    .filter(|&k| {
                        scene.triangles[k as usize].area > 0.0
                            && bounds[k as usize].overlaps(&of_object[b])
                    })
                    .collect()
            };
            let pairs = if i == j {
                if is_convex(scene, i) {
                    continue;
                }
                pairs_within(scene, &bounds, list(i, i))
            } else {
                pairs_between(&bounds, list(i, j), list(j, i))
            };
            found.par_extend(pairs.into_par_iter().filter_map(|(k, l)| {
                times.iter().find_map(|&time| {
                    segment(scene, k, l, time).map(|s| crossing(scene, k, l, s, time))
                })
            }));
        }
    }
    found
}

fn crossing(scene: &KernelScene, k: u32, l: u32, [a, b]: [V3; 2], time: f32) -> Edge {
    let mut faces = [u32::MAX; FACES];
    faces[..2].copy_from_slice(&[k, l]);
    let object = scene.triangles[k as usize].object;
    // At the start of the shutter, as if both moved like the first.
    let shift = scene.shift(k, time);
    let apart = match &scene.velocities {
        Some(v) => {
            let other = scene.triangles[l as usize].object;
            v[object as usize] != v[other as usize]
        }
        None => false,
    };
    Edge {
        a: a - shift,
        along: b - a,
        faces,
        rows: [[0; 2]; 2],
        object,
        kind: Kind::Crossing,
        crease: 1.0,
        closed: false,
        apart,
    }
}

/// Whether an object's faces lie on one side of each face's plane, told by its vertices: then it does not
/// pass through itself. Asked of small objects alone.
fn is_convex(scene: &KernelScene, object: usize) -> bool {
    let o = &scene.objects[object];
    let range = o.first_triangle..o.first_triangle + o.triangles;
    if o.triangles > 2000 {
        return false;
    }
    let tolerance = |c: V3| TOUCHING * (0.1 + c.max_abs());
    scene.triangles[range.clone()].par_iter().all(|t| {
        scene.triangles[range.clone()].iter().all(|s| {
            let above = |c: V3| t.normal.dot(c) - t.plane <= tolerance(c);
            s.corners.into_iter().all(above)
        })
    })
}

/// Pairs of triangles of two lists whose boxes overlap, by sweeping along an axis.
fn pairs_between(bounds: &[Box3], mut first: Vec<u32>, mut second: Vec<u32>) -> Vec<(u32, u32)> {
    let low = |k: u32| bounds[k as usize].min.x;
    first.sort_unstable_by(|&a, &b| low(a).total_cmp(&low(b)));
    second.sort_unstable_by(|&a, &b| low(a).total_cmp(&low(b)));
    let sweep = |from: &[u32], over: &[u32], strictly: bool| -> Vec<(u32, u32)> {
        from.par_iter()
            .flat_map_iter(|&k| {
                let own = &bounds[k as usize];
                // Each pair once: where the one begins within the other.
                let first = over.partition_point(|&l| {
                    if strictly {
                        low(l) <= own.min.x
                    } else {
                        low(l) < own.min.x
                    }
                });
                over[first..]
                    .iter()
                    .take_while(|&&l| low(l) <= own.max.x)
                    .filter(|&&l| own.overlaps(&bounds[l as usize]))
                    .map(move |&l| (k, l))
            })
            .collect()
    };
    let mut pairs = sweep(&first, &second, false);
    let others = sweep(&second, &first, true);
    pairs.extend(others.into_iter().map(|(l, k)| (k, l)));
    pairs
}

/// Pairs of triangles of one object that share no vertex and whose boxes overlap.
fn pairs_within(scene: &KernelScene, bounds: &[Box3], list: Vec<u32>) -> Vec<(u32, u32)> {
    let mut list = list;
    let low = |k: u32| bounds[k as usize].min.x;
    list.sort_unstable_by(|&a, &b| low(a).total_cmp(&low(b)));
    let share = |k: u32, l: u32| {
        let (p, q) = (
            scene.triangles[k as usize].corners,
            scene.triangles[l as usize].corners,
        );
        p.iter().any(|a| q.contains(a))
    };
    (0..list.len())
        .into_par_iter()
        .flat_map_iter(|i| {
            let k = list[i];
            let own = &bounds[k as usize];
            list[i + 1..]
                .iter()
                .take_while(|&&l| low(l) <= own.max.x)
                .filter(move |&&l| own.overlaps(&bounds[l as usize]) && !share(k, l))
                .map(move |&l| (k, l))
        })
        .collect()
}
