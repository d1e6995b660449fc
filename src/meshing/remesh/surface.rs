//! A mesh whose edges can be changed.

use glam::DVec3;

use super::super::edges::Connectivity;
use super::super::mesh::TriangleMesh;

/// The vertices of a face that was removed.
const REMOVED: [u32; 3] = [u32::MAX; 3];

/// A mesh whose edges can be split, collapsed and flipped, with the faces around each vertex.
pub(super) struct Surface {
    pub points: Vec<DVec3>,
    /// The length that edges at each vertex should have.
    pub lengths: Vec<f64>,
    pub faces: Vec<[u32; 3]>,
    /// The faces of each vertex, none of a vertex that was removed.
    pub around: Vec<Vec<u32>>,
    /// Whether each vertex stays where it is: at borders, and where the mesh is not manifold.
    pub locked: Vec<bool>,
}

/// How round a triangle is: twice its area over the square of its longest side, 0.87 if all sides are equal and 0 without
/// area.
pub(super) fn roundness([a, b, c]: [DVec3; 3]) -> f64 {
    let longest = (a.distance_squared(b))
        .max(b.distance_squared(c))
        .max(c.distance_squared(a));
    let area = (b - a).cross(c - a).length();
    if longest > 0.0 { area / longest } else { 0.0 }
}

impl Surface {
    pub fn new(mesh: &TriangleMesh, lengths: Vec<f64>) -> Self {
        let mut around = vec![Vec::new(); mesh.positions.len()];
        for (k, f) in mesh.faces.iter().enumerate() {
            f.iter().for_each(|&v| around[v as usize].push(k as u32));
        }
        Self {
            points: mesh.positions.iter().map(|&p| p.into()).collect(),
            lengths,
            faces: mesh.faces.clone(),
            around,
            locked: Connectivity::of(mesh).irregular,
        }
    }

    /// All edges, each once, in order.
    pub fn edges(&self) -> Vec<[u32; 2]> {
        let mut edges = Vec::with_capacity(3 * self.faces.len());
        for f in self.faces.iter().filter(|f| **f != REMOVED) {
            for i in 0..3 {
                let (a, b) = (f[i], f[(i + 1) % 3]);
                edges.push((u64::from(a.min(b)) << 32) | u64::from(a.max(b)));
            }
        }
        edges.sort_unstable();
        edges.dedup();
        let ends = |e: u64| [(e >> 32) as u32, e as u32];
        edges.into_iter().map(ends).collect()
    }

    /// The faces with an edge.
    pub fn faces_at(&self, [a, b]: [u32; 2]) -> impl Iterator<Item = u32> {
        let count = |v: u32| self.around[v as usize].len();
        let (few, other) = if count(a) <= count(b) { (a, b) } else { (b, a) };
        let around = self.around[few as usize].iter().copied();
        around.filter(move |&k| self.faces[k as usize].contains(&other))
    }

    /// The two faces of an edge and the vertices opposite to it: the first face passes the edge from a to b, the second
    /// from b to a. `None` if the edge does not have two such faces.
    pub fn pair(&self, [a, b]: [u32; 2]) -> Option<([u32; 2], [u32; 2])> {
        let mut faces = self.faces_at([a, b]);
        let (first, second) = (faces.next()?, faces.next()?);
        if faces.next().is_some() {
            return None;
        }
        let after = |k: u32, from: u32, to: u32| {
            let f = self.faces[k as usize];
            let i = (0..3).find(|&i| f[i] == from && f[(i + 1) % 3] == to)?;
            Some(f[(i + 2) % 3])
        };
        if let (Some(c), Some(d)) = (after(first, a, b), after(second, b, a)) {
            return Some(([first, second], [c, d]));
        }
        let (c, d) = (after(second, a, b)?, after(first, b, a)?);
        Some(([second, first], [c, d]))
    }

    /// Sets `list` to the vertices that share an edge with a vertex, in order.
    pub fn ring(&self, vertex: u32, list: &mut Vec<u32>) {
        list.clear();
        for &k in &self.around[vertex as usize] {
            list.extend(self.faces[k as usize].iter().filter(|&&v| v != vertex));
        }
        list.sort_unstable();
        list.dedup();
    }

    pub fn corners(&self, face: u32) -> [DVec3; 3] {
        self.faces[face as usize].map(|v| self.points[v as usize])
    }

    /// The normal of a face, times twice its area.
    pub fn normal(&self, face: u32) -> DVec3 {
        let [a, b, c] = self.corners(face);
        (b - a).cross(c - a)
    }

    /// The sum of the normals around a vertex, of unit length or zero.
    pub fn vertex_normal(&self, vertex: u32) -> DVec3 {
        let around = self.around[vertex as usize].iter();
        around
            .map(|&k| self.normal(k))
            .sum::<DVec3>()
            .normalize_or_zero()
    }

    /// The length of an edge in relation to the one that it should have.
    pub fn ratio(&self, [a, b]: [u32; 2]) -> f64 {
        let (a, b) = (a as usize, b as usize);
        let wanted = (self.lengths[a] + self.lengths[b]) / 2.0;
        self.points[a].distance(self.points[b]) / wanted
    }

    /// Divides an edge and its faces in the middle.
    pub fn split(&mut self, [a, b]: [u32; 2]) {
        let faces: Vec<u32> = self.faces_at([a, b]).collect();
        let middle = self.points.len() as u32;
        let (i, j) = (a as usize, b as usize);
        self.points.push((self.points[i] + self.points[j]) / 2.0);
        self.lengths.push((self.lengths[i] + self.lengths[j]) / 2.0);
        // An edge inside has a free middle, even between two vertices that are not free.
        self.locked.push(faces.len() != 2);
        self.around.push(Vec::with_capacity(2 * faces.len()));
        for k in faces {
            let (mut f, mut g) = (self.faces[k as usize], self.faces[k as usize]);
            f.iter_mut().filter(|v| **v == b).for_each(|v| *v = middle);
            g.iter_mut().filter(|v| **v == a).for_each(|v| *v = middle);
            let new = self.faces.len() as u32;
            self.faces[k as usize] = f;
            self.faces.push(g);
            for v in g.into_iter().filter(|&v| v != middle) {
                let around = &mut self.around[v as usize];
                if v == b {
                    around.retain(|&other| other != k);
                }
                around.push(new);
            }
            self.around[middle as usize].extend([k, new]);
        }
    }

    /// Removes vertex `b` and moves `a` to a point: the faces of the edge between them go, and all others of `b` are
    /// now those of `a`.
    pub fn merge(&mut self, [a, b]: [u32; 2], point: DVec3) {
        for k in std::mem::take(&mut self.around[b as usize]) {
            let face = self.faces[k as usize];
            if face.contains(&a) {
                for v in face.into_iter().filter(|&v| v != b) {
                    self.around[v as usize].retain(|&other| other != k);
                }
                self.faces[k as usize] = REMOVED;
            } else {
                let corners = self.faces[k as usize].iter_mut();
                corners.filter(|v| **v == b).for_each(|v| *v = a);
                self.around[a as usize].push(k);
            }
        }
        let (i, j) = (a as usize, b as usize);
        self.points[i] = point;
        self.lengths[i] = (self.lengths[i] + self.lengths[j]) / 2.0;
        self.locked[i] |= self.locked[j];
    }

    /// Replaces two faces.
    pub fn replace(&mut self, pair: [u32; 2], by: [[u32; 3]; 2]) {
        for k in pair {
            for v in self.faces[k as usize] {
                self.around[v as usize].retain(|&other| other != k);
            }
        }
        for (k, face) in pair.into_iter().zip(by) {
            self.faces[k as usize] = face;
            face.iter().for_each(|&v| self.around[v as usize].push(k));
        }
    }

    /// The faces and the vertices that have some; the vertices are renumbered.
    pub fn into_mesh(self) -> TriangleMesh {
        let positions = self.points.iter().map(|p| p.to_array()).collect();
        let faces = self.faces.into_iter().filter(|f| *f != REMOVED).collect();
        TriangleMesh { positions, faces }.compacted()
    }
}
