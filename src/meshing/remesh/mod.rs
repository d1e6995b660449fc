//! Isotropic remeshing.

mod edits;
mod relax;
mod sizing;
mod surface;

use glam::DVec3;
use rayon::prelude::*;

use super::mesh::{SurfacePoint, TriangleMesh};
use crate::error::{Error, Result};
use edits::{collapse_short, flip, split_long};
use relax::{Reference, relax};
pub use sizing::Sizing;
use surface::Surface;

/// The most faces that a remeshing makes.
const MOST_FACES: usize = 20_000_000;

/// The most rounds in which a mesh first gets coarser; each halves the number of vertices at most.
const COARSENING: usize = 16;

/// How a mesh is remeshed.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct RemeshOptions {
    /// The edge lengths to aim at.
    pub sizing: Sizing,
    /// The number of passes over all edges.
    pub passes: usize,
}

impl RemeshOptions {
    /// Edges of the same length everywhere, in scene units, and 8 passes.
    pub fn uniform(length: f64) -> Self {
        Self::with_sizing(Sizing::Uniform(length))
    }

    /// Edge lengths that differ from place to place, and 8 passes.
    pub fn with_sizing(sizing: Sizing) -> Self {
        Self { sizing, passes: 8 }
    }

    /// Sets the number of passes over all edges (8 by default).
    #[must_use]
    pub fn with_passes(mut self, passes: usize) -> Self {
        self.passes = passes;
        self
    }
}

/// A remeshed surface, from [`remesh`].
#[derive(Clone, Debug, PartialEq)]
pub struct Remeshed {
    /// The new mesh.
    pub mesh: TriangleMesh,
    /// For each new vertex its place on the old mesh, to interpolate values of vertices.
    pub from: Vec<SurfacePoint>,
}

/// Makes a mesh with even edges and about round faces on the same surface (Botsch and Kobbelt 2004, *A remeshing approach
/// to multiresolution modeling*; Palfinger 2022, *Continuous remeshing for inverse rendering*): passes split edges
/// longer than 4/3 of the wanted length, collapse those shorter than 4/5, flip edges towards six edges at a vertex, and
/// move vertices along the surface. All vertices of the new mesh lie on the old surface.
///
/// A closed manifold mesh stays one, with the same genus. Vertices at borders and where the mesh is not manifold stay.
/// Parts smaller than about three edges remain, with shorter edges.
///
/// # Errors
/// [`Error::Invalid`] if the mesh or a length is not valid, or if the mesh would have more than 20 million faces.
pub fn remesh(mesh: &TriangleMesh, options: &RemeshOptions) -> Result<Remeshed> {
    mesh.check()?;
    let lengths = options.sizing.lengths(mesh)?;
    let of_face = |k: u32| {
        let f = mesh.faces[k as usize];
        let wanted = f.iter().map(|&v| lengths[v as usize]).sum::<f64>() / 3.0;
        mesh.area_vector(k).length() / (3f64.sqrt() / 4.0 * wanted * wanted)
    };
    let count: f64 = (0..mesh.faces.len() as u32).map(of_face).sum();
    let expected = format!("lengths that give at most {MOST_FACES} faces");
    let shown = format!("such that there would be about {count:.0} faces");
    let few = count < MOST_FACES as f64;
    Error::unless(few, "remesh", "sizing", shown, &expected)?;
    let most = mesh.faces.len() + (8.0 * count) as usize + 1000;
    let reference = Reference::new(mesh, &lengths);
    let mut surface = Surface::new(mesh, lengths.clone());
    // Fine meshes first get coarser, which leaves less to do, and thin faces are not split along their length.
    let few = mesh.positions.len() / 50;
    let rounds = if options.passes > 0 { COARSENING } else { 0 };
    for _ in 0..rounds {
        if collapse_short(&mut surface, true) <= few {
            break;
        }
    }
    for _ in 0..options.passes {
        split_long(&mut surface, most);
        collapse_short(&mut surface, false);
        flip(&mut surface);
        relax(&mut surface, &reference);
    }
    let mut mesh = surface.into_mesh();
    let normals = mesh.vertex_normals();
    let wanted = lengths.iter().copied().fold(0.0, f64::max);
    let nearest = |(p, &normal): (&[f64; 3], &DVec3)| {
        let near = reference.nearest((*p).into(), normal, wanted);
        near.map_or((*p, SurfacePoint::default()), |near| {
            (near.point.to_array(), near.on)
        })
    };
    let places = mesh.positions.par_iter().zip(&normals).map(nearest);
    let from;
    (mesh.positions, from) = places.collect();
    Ok(Remeshed { mesh, from })
}
