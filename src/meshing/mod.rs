//! Meshes from silhouettes, and meshes made even and sound: for the start of a fit to photographs, and between its
//! levels.
//!
//! All of it works on lists on the host, without tensors.
mod bvh;
mod closest;
mod crossing;
mod distance;
mod edges;
mod hull;
mod lattice;
mod mesh;
mod parts;
mod remesh;
mod renew;
mod repair;
#[cfg(test)]
mod samples;
mod silhouette;
mod smooth;
mod statistics;
#[cfg(test)]
mod tests;
mod winding;

pub(crate) use bvh::Bvh;
pub(crate) use lattice::{Crossings, LEAST_PART};

pub use closest::{closest_points, signed_distances, volume_iou};
pub use hull::{HullOptions, Region, visual_hull};
pub use mesh::{SurfacePoint, TriangleMesh};
pub use remesh::{RemeshOptions, Remeshed, Sizing, remesh};
pub use renew::renew;
pub use repair::{RepairOptions, Repaired, repair};
pub use silhouette::Silhouette;
pub use smooth::{SmoothOptions, smooth};
pub use statistics::MeshStatistics;
pub(crate) use statistics::median;
