//! A mesh on the host: welded corners, neighbors, normals and areas.

use glam::DVec3;

use crate::error::{Error, Result};
use softray_kernels::host::Weld;

/// In place of a face where there is none.
pub(super) const NONE: u32 = u32::MAX;

/// A triangle has no area if its smallest height is below this, where the mesh has a size of 1.
const NO_HEIGHT: f64 = 1e-6;

/// How often normals are averaged with those of their neighbors.
const SMOOTHINGS: usize = 6;

/// A mesh whose vertices at the same position are one, scaled to a size of 1 about the origin.
pub(super) struct Surface {
    /// The places: the distinct vertices.
    pub points: Vec<DVec3>,
    /// The place of each corner.
    pub corners: Vec<[u32; 3]>,
    /// The face beyond the edge from corner i to corner i + 1, or [`NONE`] at borders.
    pub across: Vec<[u32; 3]>,
    /// Unit normals, 0 for faces without area.
    pub normals: Vec<DVec3>,
    /// Normals averaged over neighbors of similar direction, 0 for faces without area.
    pub smooth: Vec<DVec3>,
    /// Areas.
    pub areas: Vec<f64>,
    /// The size of the mesh before.
    pub size: f64,
}

/// Checks that positions are finite and that faces name existing vertices.
pub(super) fn check(positions: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<()> {
    if let Some(v) = positions
        .iter()
        .position(|p| !p.iter().all(|x| x.is_finite()))
    {
        let value = format!("{:?}", positions[v]);
        let field = format!("position {v}");
        return Err(Error::invalid("mesh", field, value, "finite numbers"));
    }
    check_faces("face", faces, positions.len())
}

/// Checks that faces name existing rows.
pub(super) fn check_faces(field: &str, faces: &[[u32; 3]], rows: usize) -> Result<()> {
    let outside = |f: &[u32; 3]| f.iter().any(|&i| i as usize >= rows);
    match faces.iter().position(outside) {
        Some(f) => {
            let value = format!("{:?}", faces[f]);
            let expected = format!("indices below {rows}");
            Err(Error::invalid(
                "mesh",
                format!("{field} {f}"),
                value,
                expected,
            ))
        }
        None => Ok(()),
    }
}

impl Surface {
    /// Welds a mesh that was checked.
    ///
    /// # Errors
    /// If the difference of two positions overflows.
    pub fn new(positions: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<Self> {
        let weld = Weld::new(positions);
        let all = || positions.iter().map(|&p| DVec3::from(p));
        let min = all().fold(DVec3::INFINITY, DVec3::min);
        let max = all().fold(DVec3::NEG_INFINITY, DVec3::max);
        let extent = (max - min).max_element().max(0.0);
        if !extent.is_finite() && !positions.is_empty() {
            return Err(Error::invalid(
                "mesh",
                "size",
                extent,
                "a number within the range of f64",
            ));
        }
        let scale = if extent > 0.0 { extent } else { 1.0 };
        let mut points = vec![DVec3::ZERO; weld.count()];
        for (v, p) in all().enumerate() {
            points[weld.place(v as u32) as usize] = (p - min) / scale;
        }
        let corners: Vec<[u32; 3]> = faces.iter().map(|f| f.map(|i| weld.place(i))).collect();
        let mut surface = Self {
            across: vec![[NONE; 3]; corners.len()],
            normals: Vec::new(),
            smooth: Vec::new(),
            areas: Vec::new(),
            size: scale,
            points,
            corners,
        };
        for f in 0..surface.corners.len() {
            let [a, b, c] = surface.triangle(f as u32);
            let normal = (b - a).cross(c - a);
            let longest = (b - a).length().max((c - b).length()).max((a - c).length());
            let flat = normal.length() <= NO_HEIGHT * longest;
            let unit = if flat {
                DVec3::ZERO
            } else {
                normal.normalize_or_zero()
            };
            surface.normals.push(unit);
            surface.areas.push(0.5 * normal.length());
        }
        surface.join();
        surface.smooth_normals();
        Ok(surface)
    }

    /// The three points of a face.
    pub fn triangle(&self, face: u32) -> [DVec3; 3] {
        self.corners[face as usize].map(|p| self.points[p as usize])
    }

    /// The middle of a face.
    pub fn middle(&self, face: u32) -> DVec3 {
        let [a, b, c] = self.triangle(face);
        (a + b + c) / 3.0
    }

    /// Whether a face has no area.
    pub fn is_flat(&self, face: u32) -> bool {
        self.normals[face as usize] == DVec3::ZERO
    }

    /// The length of the edge from corner i to corner i + 1.
    pub fn edge(&self, face: u32, i: usize) -> f64 {
        let t = self.triangle(face);
        t[i].distance(t[(i + 1) % 3])
    }

    /// Finds neighbors: two faces with area that have an edge in opposite directions, if no third face has this edge.
    fn join(&mut self) {
        let mut edges: Vec<(u32, u32, u32)> = Vec::with_capacity(3 * self.corners.len());
        for (f, w) in self.corners.iter().enumerate() {
            for i in 0..3 {
                let (p, q) = (w[i], w[(i + 1) % 3]);
                edges.push((p.min(q), p.max(q), (3 * f + i) as u32));
            }
        }
        edges.sort_unstable();
        for group in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let &[(.., a), (.., b)] = group else {
                continue;
            };
            let start = |e: u32| self.corners[e as usize / 3][e as usize % 3];
            let (f, g) = (a / 3, b / 3);
            if start(a) == start(b) || f == g || self.is_flat(f) || self.is_flat(g) {
                continue;
            }
            self.across[f as usize][a as usize % 3] = g;
            self.across[g as usize][b as usize % 3] = f;
        }
    }

    /// Averages normals over neighbors. The weight of a neighbor is small across sharp edges.
    fn smooth_normals(&mut self) {
        self.smooth = self.normals.clone();
        for _ in 0..SMOOTHINGS {
            let of_face = |f: usize| {
                let own = self.smooth[f];
                let mut sum = own * self.areas[f];
                for &g in self.across[f].iter().filter(|&&g| g != NONE) {
                    let other = self.smooth[g as usize];
                    let weight = 0.1 + own.dot(other).max(0.0).powi(2);
                    sum += other * (weight * self.areas[g as usize]);
                }
                let unit = sum.normalize_or_zero();
                if unit == DVec3::ZERO { own } else { unit }
            };
            self.smooth = (0..self.smooth.len()).map(of_face).collect();
        }
    }
}
