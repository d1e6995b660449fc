//! The edges of meshes at which something may jump: silhouettes, borders, creases, seams.

use rayon::prelude::*;

use super::{Edge, FACES, Kind};
use crate::geometry::Weld;
use crate::kernel::scene::KernelScene;
use crate::model::V3;
use crate::model::triangle::AREA;
use crate::trace::{NONE, NORMAL_ROWS, UV_ROWS};

/// Jumps of colour at a crease are about this share of the difference of its normals.
const CREASE: f32 = 0.5;
/// The same of geometric normals under one shading normal.
const SMOOTH: f32 = 0.25;
/// Normals that differ by less are the same.
const FLAT: f32 = 1e-5;

/// The edges of an object that can jump, from its welded vertices.
pub(super) fn of_object(
    scene: &KernelScene,
    object: usize,
    positions: &[[f64; 3]],
    faces: &[[u32; 3]],
) -> Vec<Edge> {
    let weld = Weld::new(positions);
    let part = &scene.lists.objects[object];
    // An edge's other end and its place, by the end that comes first: a face's i-th edge runs from its i-th corner to
    // the next.
    let ends = |f: usize, i: usize| {
        let [p, q] = [i, (i + 1) % 3].map(|i| weld.place(faces[f][i]));
        let valid = scene.lists.surfaces[part.first_triangle + f][AREA] > 0.0;
        (valid && p != q).then_some((p.min(q), p.max(q)))
    };
    let every = || (0..faces.len()).flat_map(|f| (0..3).map(move |i| (f, i)));
    let mut past = vec![0u32; weld.count() + 1];
    for (f, i) in every() {
        if let Some((p, _)) = ends(f, i) {
            past[p as usize] += 1;
        }
    }
    let mut sum = 0;
    for count in &mut past {
        sum += std::mem::replace(count, sum);
    }
    let mut all = vec![(0, 0); sum as usize];
    for (f, i) in every() {
        if let Some((p, q)) = ends(f, i) {
            all[past[p as usize] as usize] = (q, 4 * f as u32 + i as u32);
            past[p as usize] += 1;
        }
    }
    let mut groups: Vec<&[(u32, u32)]> = Vec::with_capacity(all.len() / 2);
    let (mut rest, mut first) = (all.as_mut_slice(), 0);
    for past in past {
        let own;
        (own, rest) = rest.split_at_mut((past - first) as usize);
        first = past;
        own.sort_unstable();
        let own: &[(u32, u32)] = own;
        groups.extend(own.chunk_by(|a, b| a.0 == b.0));
    }
    let transparent = |k: usize| scene.material(k as u32).kind.bsdf.refracts();
    let triangles = part.first_triangle..part.first_triangle + faces.len();
    let closed = !groups.is_empty() && groups.iter().all(|g| g.len() == 2);
    let pierced = |k: usize| scene.holes.as_ref().is_some_and(|h| h.are_in(k));
    // One sees into what is clear or has holes.
    let closed = closed && !triangles.into_iter().any(|k| transparent(k) || pierced(k));
    groups
        .par_iter()
        .filter_map(|group| edge_of(scene, object, &weld, faces, group, closed))
        .collect()
}

fn edge_of(
    scene: &KernelScene,
    object: usize,
    weld: &Weld,
    faces: &[[u32; 3]],
    group: &[(u32, u32)],
    closed: bool,
) -> Option<Edge> {
    let part = &scene.lists.objects[object];
    let ends = |at: u32| {
        let (f, i) = ((at / 4) as usize, (at % 4) as usize);
        let k = part.first_triangle + f;
        (k, i, (i + 1) % 3)
    };
    let (k, i, j) = ends(group[0].1);
    let corners = scene.triangle(k as u32).corners();
    let rows = scene.lists.vertex_rows[k];
    let own = [rows[i], rows[j]];
    let mut edge = Edge {
        a: corners[i],
        along: corners[j] - corners[i],
        faces: [u32::MAX; FACES],
        rows: [own, own],
        object: object as u32,
        kind: Kind::Border,
        crease: 1.0,
        closed,
        apart: false,
    };
    for (to, &(_, at)) in edge.faces.iter_mut().zip(group) {
        *to = ends(at).0 as u32;
    }
    if group.len() != 2 {
        return Some(edge);
    }
    let (k2, i2, j2) = ends(group[1].1);
    let rows2 = scene.lists.vertex_rows[k2];
    let turned = weld.place(faces[(group[0].1 / 4) as usize][i])
        == weld.place(faces[(group[1].1 / 4) as usize][i2]);
    edge.rows[1] = if turned {
        [rows2[i2], rows2[j2]]
    } else {
        [rows2[j2], rows2[i2]]
    };
    // Faces of one direction can't be told apart by their sides.
    if turned {
        return Some(edge);
    }
    edge.kind = Kind::Fold;
    let normals = [k, k2].map(|k| scene.triangle(k as u32).normal);
    edge.crease = crease(scene, [k, k2], normals, [[i, j], [j2, i2]]);
    let flat = (normals[0] - normals[1]).length() < FLAT;
    (!flat || edge.crease > 0.0).then_some(edge)
}

/// The most by which colours may jump where both faces are seen: two triangles with their normals, and the corners of
/// each at the ends of the edge.
fn crease(
    scene: &KernelScene,
    [k, k2]: [usize; 2],
    geometric: [V3; 2],
    [ends, ends2]: [[usize; 2]; 2],
) -> f32 {
    let lists = &scene.lists;
    let (words, words2) = (&lists.triangles[k], &lists.triangles[k2]);
    if words[0] != words2[0] {
        return 1.0;
    }
    let material = &scene.materials[words[0] as usize];
    if !material.kind.reflects && !material.kind.glows {
        return 0.0;
    }
    let textured = material.is_textured();
    let distance = |p: &[f32], q: &[f32]| {
        let square = |(p, q): (&f32, &f32)| (p - q) * (p - q);
        p.iter().zip(q).map(square).sum::<f32>().sqrt()
    };
    // Geometric normals count where light comes from near the horizon.
    let mut jump: f32 = SMOOTH * (geometric[0] - geometric[1]).length();
    for (c, c2) in ends.into_iter().zip(ends2) {
        let normal = |words: &[u32], c: usize, geometric: V3| match words[NORMAL_ROWS as usize + c]
        {
            NONE => geometric,
            row => V3::from(lists.normals[row as usize]).normalize(),
        };
        let normals = [
            normal(words, c, geometric[0]),
            normal(words2, c2, geometric[1]),
        ];
        jump = jump.max((normals[0] - normals[1]).length());
        if textured {
            let at = |words: &[u32], c: usize| match words[UV_ROWS as usize + c] {
                NONE => [0.0; 2],
                row => lists.uvs[row as usize],
            };
            if distance(&at(words, c), &at(words2, c2)) > 1e-6 {
                return 1.0;
            }
        }
        let colours = [(k, c), (k2, c2)].map(|(k, c)| lists.colours.at(k, c).unwrap_or([1.0; 3]));
        jump = jump.max(distance(&colours[0], &colours[1]) / CREASE);
        if material.normal_map.is_some() {
            let tangents = [(k, c), (k2, c2)].map(|(k, c)| lists.tangents.at(k, c));
            let [p, q] = tangents.map(Option::unwrap_or_default);
            jump = jump.max(distance(&p[..3], &q[..3]));
        }
    }
    if jump < FLAT {
        0.0
    } else {
        (CREASE * jump).min(1.0)
    }
}
