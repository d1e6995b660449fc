//! Charts in a plane.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::arap::relax;
use super::crevice::crevice;
use super::overlap::{Fault, check, twice_area};
use super::surface::{NONE, Surface};

/// A chart in a plane.
pub(super) struct Flat {
    /// The faces of the mesh.
    pub faces: Vec<u32>,
    /// The indices of their corners in `points`.
    pub corners: Vec<[u32; 3]>,
    /// The points in the plane, with about the areas of the surface.
    pub points: Vec<DVec2>,
    /// Whether it is a face without area on the surface, which is drawn with a size of one texel.
    pub is_token: bool,
}

/// How often triangles that turn over are taken out of a chart, before it is halved.
const TAKES: usize = 3;

/// Flattens charts. Those that would overlap themselves, or come too near to themselves for texels with a side of
/// `texel`, are divided.
pub(super) fn flatten(surface: &Surface, charts: Vec<Vec<u32>>, texel: f64) -> Vec<Flat> {
    let flat = |chart: Vec<u32>| {
        let mut done = Vec::new();
        let mut waiting: Vec<(Vec<u32>, usize)> = connected(surface, &chart, |_| 0)
            .into_iter()
            .map(|part| (part, 0))
            .collect();
        while let Some((faces, depth)) = waiting.pop() {
            match Flat::new(surface, faces, texel) {
                Ok(flat) => done.push(flat),
                Err((faces, fault)) => {
                    let parts = divide(surface, &faces, &fault, depth);
                    waiting.extend(parts.into_iter().map(|part| (part, depth + 1)));
                }
            }
        }
        done
    };
    let lists: Vec<Vec<Flat>> = charts.into_par_iter().map(flat).collect();
    lists.into_iter().flatten().collect()
}

impl Flat {
    /// Flattens connected faces, or says why that fails.
    fn new(surface: &Surface, faces: Vec<u32>, texel: f64) -> Result<Self, (Vec<u32>, Fault)> {
        let whole: Vec<[u32; 3]> = faces.iter().map(|&f| surface.corners[f as usize]).collect();
        if let &[face] = &faces[..] {
            return Ok(Self::single(surface, face));
        }
        let mut places: Vec<u32> = whole.iter().flatten().copied().collect();
        places.sort_unstable();
        places.dedup();
        let local = |p: u32| places.partition_point(|&q| q < p) as u32;
        let corners: Vec<[u32; 3]> = whole.iter().map(|w| w.map(local)).collect();
        let shapes: Vec<[DVec2; 3]> = faces.iter().map(|&f| shape(surface.triangle(f))).collect();
        let areas: Vec<f64> = faces.iter().map(|&f| surface.areas[f as usize]).collect();
        let projected = project(surface, &faces, &places);
        let mut points = projected.clone();
        relax(&corners, &shapes, &areas, &mut points);
        let mut fault = check(&corners, &areas, &points);
        if fault.is_err() && check(&corners, &areas, &projected).is_ok() {
            for part in [0.7, 0.35, 0.0] {
                let between = |(p, q): (&DVec2, &DVec2)| p.lerp(*q, part);
                let mixed: Vec<DVec2> = projected.iter().zip(&points).map(between).collect();
                fault = check(&corners, &areas, &mixed);
                if fault.is_ok() {
                    points = mixed;
                    break;
                }
            }
        }
        if let Err(fault) = fault {
            return Err((faces, fault));
        }
        let flat: f64 = corners
            .iter()
            .map(|c| 0.5 * twice_area(c.map(|v| points[v as usize])))
            .sum();
        let scale = (areas.iter().sum::<f64>() / flat).sqrt();
        points.iter_mut().for_each(|p| *p *= scale);
        let in_space: Vec<DVec3> = places.iter().map(|&p| surface.points[p as usize]).collect();
        if let Some(near) = crevice(&corners, &points, &in_space, texel) {
            return Err((faces, Fault::Near(near)));
        }
        Ok(Self {
            faces,
            corners,
            points,
            is_token: false,
        })
    }

    /// One face, in its shape; an equilateral triangle with sides of 1 if it has no area.
    fn single(surface: &Surface, face: u32) -> Self {
        let is_token = surface.is_flat(face);
        let points = if is_token {
            [[0.0, 0.0], [1.0, 0.0], [0.5, 0.866]].map(DVec2::from)
        } else {
            shape(surface.triangle(face))
        };
        Self {
            faces: vec![face],
            corners: vec![[0, 1, 2]],
            points: points.to_vec(),
            is_token,
        }
    }
}

/// A triangle in its own plane, counterclockwise.
fn shape([a, b, c]: [DVec3; 3]) -> [DVec2; 3] {
    let (u, v) = (b - a, c - a);
    let length = u.length();
    let (x, y) = (v.dot(u) / length, u.cross(v).length() / length);
    [DVec2::ZERO, DVec2::new(length, 0.0), DVec2::new(x, y)]
}

/// Places, projected onto the mean plane of faces.
fn project(surface: &Surface, faces: &[u32], places: &[u32]) -> Vec<DVec2> {
    let weighted = |&f: &u32| surface.normals[f as usize] * surface.areas[f as usize];
    let normal = faces.iter().map(weighted).sum::<DVec3>();
    let normal = normal.normalize_or(DVec3::Z);
    let (x, y) = normal.any_orthonormal_pair();
    let center = surface.middle(faces[0]);
    let at = |&p: &u32| {
        let p = surface.points[p as usize] - center;
        DVec2::new(p.dot(x), p.dot(y))
    };
    let points: Vec<DVec2> = places.iter().map(at).collect();
    if x.cross(y).dot(normal) > 0.0 {
        points
    } else {
        points.into_iter().map(|p| DVec2::new(p.y, p.x)).collect()
    }
}

/// Divides faces: takes triangles out that turn over if they are few, otherwise halves the faces.
fn divide(surface: &Surface, faces: &[u32], fault: &Fault, depth: usize) -> Vec<Vec<u32>> {
    match fault {
        Fault::Turned(turned) if depth < TAKES && 8 * turned.len() < faces.len() => {
            let side = |i: usize| u32::from(turned.binary_search(&(i as u32)).is_ok());
            connected(surface, faces, side)
        }
        Fault::Near(from) => {
            let (nearest, _) = walk(surface, faces, from);
            connected(surface, faces, |i| nearest[i])
        }
        _ => halves(surface, faces),
    }
}

/// Two halves of connected faces: those nearer to one end than to the other, along edges. Their connected parts, at
/// least two.
fn halves(surface: &Surface, faces: &[u32]) -> Vec<Vec<u32>> {
    let mut sorted = faces.to_vec();
    sorted.sort_unstable();
    let far = |from: usize| *walk(surface, &sorted, &[from]).1.last().unwrap_or(&from);
    let first = far(0);
    let mut second = far(first);
    if second == first {
        second = usize::from(first == 0);
    }
    let (nearest, _) = walk(surface, &sorted, &[first, second]);
    connected(surface, &sorted, |i| nearest[i])
}

/// Walks from faces in a sorted list along edges, breadth first. Returns from which of `from` each face was reached
/// first, and the order.
fn walk(surface: &Surface, sorted: &[u32], from: &[usize]) -> (Vec<u32>, Vec<usize>) {
    let mut source = vec![NONE; sorted.len()];
    let mut order = from.to_vec();
    for (k, &i) in from.iter().enumerate() {
        source[i] = k as u32;
    }
    let mut next = 0;
    while let Some(&i) = order.get(next) {
        next += 1;
        for g in surface.across[sorted[i] as usize] {
            if let Ok(j) = sorted.binary_search(&g)
                && source[j] == NONE
            {
                source[j] = source[i];
                order.push(j);
            }
        }
    }
    (source, order)
}

/// The connected parts of faces, within those with the same label. `label` takes an index into `faces`.
fn connected(surface: &Surface, faces: &[u32], label: impl Fn(usize) -> u32) -> Vec<Vec<u32>> {
    let mut labels: Vec<(u32, u32)> = faces
        .iter()
        .enumerate()
        .map(|(i, &f)| (f, label(i)))
        .collect();
    labels.sort_unstable();
    let mut seen = vec![false; labels.len()];
    let mut parts = Vec::new();
    for start in 0..labels.len() {
        if std::mem::replace(&mut seen[start], true) {
            continue;
        }
        let mut part = vec![labels[start].0];
        let mut next = 0;
        while let Some(&f) = part.get(next) {
            next += 1;
            for g in surface.across[f as usize] {
                if let Ok(j) = labels.binary_search_by_key(&g, |e| e.0)
                    && labels[j].1 == labels[start].1
                    && !std::mem::replace(&mut seen[j], true)
                {
                    part.push(g);
                }
            }
        }
        part.sort_unstable();
        parts.push(part);
    }
    parts
}
