//! The edges of meshes at which something may jump: silhouettes, borders, creases and seams.

use std::sync::Arc;

use rayon::prelude::*;

use super::{Edge, Edges, FACES, Kind};
use crate::host::{HostObject, Weld};
use crate::kernel::scene::KernelScene;
use crate::model::V3;
use crate::model::triangle::{self, AREA};
use crate::trace::{NONE, NORMAL_ROWS, UV_ROWS};

/// The jump of colors at a crease, divided by the difference of its normals (approximate).
const CREASE: f32 = 0.5;
/// The jump at a crease of glossy faces, divided by the root of the difference of its normals (approximate): few paths on
/// both sides reach different light, but then it differs much.
const IN_GLOSS: f32 = 0.6;
/// The same for the difference of geometric normals under one shading normal.
const SMOOTH: f32 = 0.25;
/// Normals that differ by less count as equal.
const FLAT: f32 = 1e-5;

/// The kind and the bound of the jump of all edges that are not folds.
const BORDER: (Kind, f32) = (Kind::Border, 1.0);

/// A triangle, and the indices of its corners where an edge begins and ends.
type Ends = (usize, usize, usize);

/// The faces at each edge of a mesh. They stay valid while its faces, and which of its vertices coincide, do not
/// change.
#[derive(Default)]
pub(super) struct MeshEdges {
    /// The index of its first triangle in the scene.
    first: usize,
    faces: Arc<Vec<[u32; 3]>>,
    weld: Weld,
    /// Faces without area. They have no edges.
    empty: Vec<u32>,
    /// Up to [`FACES`] faces of each edge, each as 4 × the face plus the index of its corner where the edge begins.
    /// Unused places are [`NONE`].
    groups: Vec<[u32; FACES]>,
    /// Whether all edges have two faces.
    closed: bool,
}

impl MeshEdges {
    /// Updates the edges for an object. They are computed again only if its faces, its coinciding vertices or its faces
    /// without area changed. `moved` is whether each triangle has moved since the last render, if that is known.
    pub fn update(
        &mut self,
        scene: &KernelScene,
        object: usize,
        host: &HostObject,
        moved: Option<&[bool]>,
    ) {
        let first = std::mem::replace(&mut self.first, scene.lists.objects[object].first_triangle);
        let own = self.first..self.first + host.faces.len();
        let rests = moved.is_some_and(|m| m.is_empty() || !m[own.clone()].contains(&true));
        if rests && self.first == first && self.faces == host.faces {
            return;
        }
        let weld = Weld::new(&host.positions);
        let surfaces = scene.lists.surfaces[own].par_iter().enumerate();
        let empty =
            |(f, s): (usize, &[f32; triangle::NUMBERS])| (s[AREA] <= 0.0).then_some(f as u32);
        let empty: Vec<u32> = surfaces.filter_map(empty).collect();
        if self.faces == host.faces && self.weld == weld && self.empty == empty {
            return;
        }
        *self = Self {
            first: self.first,
            faces: host.faces.clone(),
            weld,
            empty,
            ..Self::default()
        };
        self.find();
    }

    fn find(&mut self) {
        let (faces, weld) = (&self.faces, &self.weld);
        let mut valid = vec![true; faces.len()];
        self.empty.iter().for_each(|&f| valid[f as usize] = false);
        // Returns the places of an edge's two ends, the smaller first. A face's i-th edge runs from its i-th corner to
        // the next.
        let ends = |f: usize, i: usize| {
            let [p, q] = [i, (i + 1) % 3].map(|i| weld.place(faces[f][i]));
            (valid[f] && p != q).then_some((p.min(q), p.max(q)))
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
        let mut groups = Vec::with_capacity(all.len() / 2);
        let mut closed = true;
        let (mut rest, mut first) = (all.as_mut_slice(), 0);
        for past in past {
            let own;
            (own, rest) = rest.split_at_mut((past - first) as usize);
            first = past;
            own.sort_unstable();
            for group in own.chunk_by(|a, b| a.0 == b.0) {
                let place = |i: usize| group.get(i).map_or(NONE, |own| own.1);
                groups.push(std::array::from_fn(place));
                closed &= group.len() == 2;
            }
        }
        // Sorting by face places neighboring edges next to each other.
        groups.par_sort_unstable();
        self.closed = closed && !groups.is_empty();
        self.groups = groups;
    }

    /// Returns the triangle of a face in a group, and the indices of its corners where the edge begins and ends.
    fn ends(&self, at: u32) -> Ends {
        let i = (at % 4) as usize;
        (self.first + (at / 4) as usize, i, (i + 1) % 3)
    }

    /// Returns the two faces of an edge that has exactly two, and whether both have the same direction along it.
    fn pair(&self, group: &[u32; FACES]) -> Option<([Ends; 2], bool)> {
        let [first, second, NONE, _] = *group else {
            return None;
        };
        let place = |at: u32| {
            self.weld
                .place(self.faces[(at / 4) as usize][(at % 4) as usize])
        };
        let ends = |at: u32| self.ends(at);
        (second != NONE).then(|| ([first, second].map(ends), place(first) == place(second)))
    }

    /// Adds the edges that can jump. `moved` is whether each triangle has moved since the last render, if that is known.
    pub fn add_to(
        &self,
        edges: &mut Edges,
        scene: &KernelScene,
        object: usize,
        moved: Option<&[bool]>,
    ) {
        let mut triangles = self.first..self.first + self.faces.len();
        let transparent = |k: usize| scene.material(k as u32).kind.bsdf.refracts();
        let pierced = |k: usize| scene.holes.as_ref().is_some_and(|h| h.are_in(k));
        // The inside of transparent objects and of objects with holes is visible.
        let closed = self.closed && !triangles.any(|k| transparent(k) || pierced(k));
        let kinds = self.groups.par_iter().map(|group| self.kind(scene, group));
        let kinds: Vec<Option<(Kind, f32)>> = kinds.collect();
        let jumping = (0..kinds.len() as u32).filter(|&i| kinds[i as usize].is_some());
        let jumping: Vec<u32> = jumping.collect();
        edges.extend(jumping.len(), moved, |i| {
            let i = jumping[i] as usize;
            let kind = kinds[i].unwrap_or(BORDER);
            let edge = self.edge(scene, &self.groups[i], kind);
            let glossy = |&k: &u32| scene.material(k).is_followed();
            Edge {
                object: object as u32,
                closed,
                followed: kind.0 == Kind::Fold && edge.faces[..2].iter().all(glossy),
                ..edge
            }
        });
    }

    /// Returns the kind of an edge, and the bound of the jump of colors where both faces are visible. Returns `None` if
    /// nothing can jump.
    fn kind(&self, scene: &KernelScene, group: &[u32; FACES]) -> Option<(Kind, f32)> {
        let Some(([(k, i, j), (k2, i2, j2)], false)) = self.pair(group) else {
            // Faces of the same direction cannot be distinguished by their sides.
            return Some(BORDER);
        };
        let normals = [k, k2].map(|k| scene.triangle(k as u32).normal);
        let crease = crease(scene, [k, k2], normals, [[i, j], [j2, i2]]);
        let flat = (normals[0] - normals[1]).length() < FLAT;
        (!flat || crease > 0.0).then_some((Kind::Fold, crease))
    }

    /// Returns an edge, without its object and the flag `closed`.
    fn edge(&self, scene: &KernelScene, group: &[u32; FACES], (kind, crease): (Kind, f32)) -> Edge {
        let rows = |(k, i, j): Ends| {
            let rows = scene.lists.vertex_rows[k];
            [rows[i], rows[j]]
        };
        let (k, i, j) = self.ends(group[0]);
        let own = rows((k, i, j));
        let other = match self.pair(group) {
            None => own,
            Some(([_, ends], true)) => rows(ends),
            Some(([_, (k, i, j)], false)) => rows((k, j, i)),
        };
        let corners = scene.triangle(k as u32).corners();
        let triangle = |at: u32| self.first as u32 + at / 4;
        Edge {
            a: corners[i],
            along: corners[j] - corners[i],
            faces: group.map(|at| if at == NONE { NONE } else { triangle(at) }),
            rows: [own, other],
            object: 0,
            kind,
            crease,
            closed: false,
            followed: false,
            apart: false,
        }
    }
}

/// Returns an upper bound of the jump of colors where both faces are visible, from two triangles, their normals, and
/// the corners of each at the ends of the edge.
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
    // Geometric normals matter where light arrives near the horizon.
    let mut bend: f32 = SMOOTH * (geometric[0] - geometric[1]).length();
    let mut colors_apart: f32 = 0.0;
    for (c, c2) in ends.into_iter().zip(ends2) {
        let normal = |words: &[u32], c: usize, geometric: V3| match words[NORMAL_ROWS as usize + c]
        {
            NONE => geometric,
            row => V3::from(lists.normals[row as usize]).normalize(),
        };
        let between = normal(words, c, geometric[0]) - normal(words2, c2, geometric[1]);
        bend = bend.max(between.length());
        if textured {
            let at = |words: &[u32], c: usize| match words[UV_ROWS as usize + c] {
                NONE => [0.0; 2],
                row => lists.uvs[row as usize],
            };
            if distance(&at(words, c), &at(words2, c2)) > 1e-6 {
                return 1.0;
            }
        }
        let colors = [(k, c), (k2, c2)].map(|(k, c)| lists.colors.at(k, c).unwrap_or([1.0; 3]));
        colors_apart = colors_apart.max(distance(&colors[0], &colors[1]));
        if material.normal_map.is_some() {
            let tangents = [(k, c), (k2, c2)].map(|(k, c)| lists.tangents.at(k, c));
            let [p, q] = tangents.map(Option::unwrap_or_default);
            bend = bend.max(distance(&p[..3], &q[..3]));
        }
    }
    if bend.max(colors_apart / CREASE) < FLAT {
        return 0.0;
    }
    let of_normals = if material.is_followed() {
        IN_GLOSS * bend.sqrt()
    } else {
        CREASE * bend
    };
    of_normals.max(colors_apart).min(1.0)
}
