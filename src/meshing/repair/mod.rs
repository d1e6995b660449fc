//! Meshes without folds and crossings.

mod clean;
mod local;
mod rebuild;

use super::edges::Connectivity;
use super::mesh::TriangleMesh;
use super::parts::bodies;
use super::statistics::{edge_lengths, median};
use crate::error::{Error, Result};
use clean::cleaned;
use local::{relaxed, unfold};
use rebuild::rebuilt;

/// How a mesh is repaired.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct RepairOptions {
    /// The edge length of a surface that is made anew, in scene units; the median edge of the mesh if `None`.
    pub edge_length: Option<f64>,
    /// The number of rounds in which faces that cross or fold are relaxed before the surface is made anew.
    pub rounds: usize,
    /// Parts whose volume is less than this share of the largest one's are removed.
    pub least_part: f64,
}

impl Default for RepairOptions {
    fn default() -> Self {
        Self {
            edge_length: None,
            rounds: 5,
            least_part: 0.01,
        }
    }
}

impl RepairOptions {
    /// Sets the edge length of a surface that is made anew (the median edge of the mesh by default).
    #[must_use]
    pub fn with_edge_length(mut self, length: f64) -> Self {
        self.edge_length = Some(length);
        self
    }

    /// Sets the number of rounds of relaxation (5 by default); 0 makes the surface anew if anything crosses or folds.
    #[must_use]
    pub fn with_rounds(mut self, rounds: usize) -> Self {
        self.rounds = rounds;
        self
    }

    /// Sets the least volume of a part, as a share of the largest one's (0.01 by default).
    #[must_use]
    pub fn with_least_part(mut self, share: f64) -> Self {
        self.least_part = share;
        self
    }
}

/// A repaired mesh, from [`repair`].
#[derive(Clone, Debug, PartialEq)]
pub struct Repaired {
    /// The new mesh. [`closest_points`](super::closest_points) finds its vertices on the old one.
    pub mesh: TriangleMesh,
    /// Whether the whole surface was made anew. Otherwise, vertices moved where faces crossed or folded.
    pub rebuilt: bool,
}

/// Makes a mesh the surface of a body: closed, oriented with its front outwards, manifold, and without faces that cross.
///
/// Faces are oriented alike, and small parts and cavities are removed. Where faces cross or fold, the
/// vertices are relaxed, in a neighborhood that grows round by round. If faces still cross, or if the mesh is not closed or
/// not manifold, the whole surface is made anew around all points about which the faces wind at least half a
/// time (Barill et al. 2018, *Fast winding numbers for soups and clouds*), so that holes are closed and parts that pass
/// through each other become one. Details smaller than an edge may get lost then.
///
/// # Errors
/// [`Error::Invalid`] if the mesh or an option is not valid, or if the mesh encloses nothing.
pub fn repair(mesh: &TriangleMesh, options: &RepairOptions) -> Result<Repaired> {
    mesh.check_indices()?;
    let object = "repair";
    if let Some(length) = options.edge_length {
        Error::unless_positive(object, "edge_length", length)?;
    }
    let valid = (0.0..=1.0).contains(&options.least_part);
    Error::unless(valid, object, "least_part", options.least_part, "0 to 1")?;
    let mut clean = cleaned(mesh);
    let median = median(&edge_lengths(&clean));
    let length = options.edge_length.unwrap_or(median);
    if Connectivity::of(&clean).is_solid() {
        let mut solid = bodies(&clean, options.least_part);
        if !solid.faces.is_empty() && relaxed(&mut solid, options.rounds) && solid.volume() > 0.0 {
            return Ok(Repaired {
                mesh: solid,
                rebuilt: false,
            });
        }
    }
    let new = if length > 0.0 {
        // Spikes would become thin bodies, and handles where they pass through the surface.
        unfold(&mut clean, options.rounds);
        rebuilt(&clean, length, options.least_part)?
    } else {
        TriangleMesh::default()
    };
    let (count, expected) = (mesh.faces.len(), "faces that enclose some volume");
    let shown = format!("{count} faces");
    Error::unless(!new.faces.is_empty(), "mesh", "faces", shown, expected)?;
    Ok(Repaired {
        mesh: new,
        rebuilt: true,
    })
}
