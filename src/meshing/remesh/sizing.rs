//! The edge lengths that a remeshing aims at.

use super::super::edges::{by_edge, sides};
use super::super::mesh::TriangleMesh;
use crate::error::{Error, Result};

/// The edge lengths that [`remesh`](super::remesh()) aims at, in scene units.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Sizing {
    /// The same length everywhere.
    Uniform(f64),
    /// A length for each vertex of the old mesh, interpolated between them.
    PerVertex(Vec<f64>),
    /// Shorter edges where the surface is curved (Dunyach et al. 2013, *Adaptive remeshing for real-time mesh
    /// deformation*).
    Curvature {
        /// The largest distance between the surface and the faces, in scene units.
        error: f64,
        /// The shortest length.
        shortest: f64,
        /// The longest length.
        longest: f64,
    },
}

/// How much the length changes at most per unit of length along the surface, so that even edges stay so.
const GRADING: f64 = 0.3;

impl Sizing {
    /// The length at each vertex of a mesh.
    pub(super) fn lengths(&self, mesh: &TriangleMesh) -> Result<Vec<f64>> {
        let object = "remesh";
        let mut lengths = match self {
            &Self::Uniform(length) => {
                Error::unless_positive(object, "sizing", length)?;
                return Ok(vec![length; mesh.positions.len()]);
            }
            Self::PerVertex(lengths) => {
                let (count, wanted) = (lengths.len(), mesh.positions.len());
                let expected = format!("one for each of the {wanted} vertices");
                let shown = format!("{count} lengths");
                Error::unless(count == wanted, object, "sizing", shown, &expected)?;
                for (v, &length) in lengths.iter().enumerate() {
                    Error::unless_positive(object, &format!("sizing[{v}]"), length)?;
                }
                lengths.clone()
            }
            &Self::Curvature {
                error,
                shortest,
                longest,
            } => {
                Error::unless_positive(object, "sizing.error", error)?;
                Error::unless_positive(object, "sizing.shortest", shortest)?;
                let valid = longest.is_finite() && longest >= shortest;
                let expected = "a finite number ≥ shortest";
                Error::unless(valid, object, "sizing.longest", longest, expected)?;
                let length = |curvature: f64| {
                    let squared = 6.0 * error / curvature - 3.0 * error * error;
                    squared.max(0.0).sqrt().clamp(shortest, longest)
                };
                curvatures(mesh).into_iter().map(length).collect()
            }
        };
        grade(mesh, &mut lengths);
        Ok(lengths)
    }
}

/// The largest curvature at each vertex along its edges, in one over scene units, averaged over neighbors.
fn curvatures(mesh: &TriangleMesh) -> Vec<f64> {
    let normals = mesh.vertex_normals();
    let sides = sides(mesh);
    let mut largest = vec![0.0f64; mesh.positions.len()];
    let edges: Vec<[u32; 2]> = by_edge(&sides).map(|edge| edge[0].ends).collect();
    for &[a, b] in &edges {
        let along = mesh.at(b) - mesh.at(a);
        let turned = (normals[b as usize] - normals[a as usize]).dot(along);
        let curvature = turned.abs() / along.length_squared().max(f64::MIN_POSITIVE);
        for v in [a, b] {
            largest[v as usize] = largest[v as usize].max(curvature);
        }
    }
    let (mut sums, mut counts) = (largest.clone(), vec![1.0; largest.len()]);
    for [a, b] in edges.into_iter().map(|edge| edge.map(|v| v as usize)) {
        sums[a] += largest[b];
        sums[b] += largest[a];
        counts[a] += 1.0;
        counts[b] += 1.0;
    }
    sums.iter()
        .zip(counts)
        .map(|(sum, count)| sum / count)
        .collect()
}

/// Reduces lengths so that they differ little between neighbors.
fn grade(mesh: &TriangleMesh, lengths: &mut [f64]) {
    /// The most passes over all edges.
    const PASSES: usize = 50;
    let sides = sides(mesh);
    let with_length = |edge: &[super::super::edges::Side]| {
        let [a, b] = edge[0].ends;
        ([a, b], mesh.at(a).distance(mesh.at(b)))
    };
    let edges: Vec<_> = by_edge(&sides).map(with_length).collect();
    for pass in 0..PASSES {
        let mut changed = false;
        let mut visit = |([a, b], length): ([u32; 2], f64)| {
            let (a, b) = (a as usize, b as usize);
            for (v, u) in [(a, b), (b, a)] {
                let most = lengths[u] + GRADING * length;
                if lengths[v] > most {
                    lengths[v] = most;
                    changed = true;
                }
            }
        };
        // Back and forth, so that a change comes far in each pass.
        if pass % 2 == 0 {
            edges.iter().copied().for_each(&mut visit);
        } else {
            edges.iter().rev().copied().for_each(&mut visit);
        }
        if !changed {
            return;
        }
    }
}
