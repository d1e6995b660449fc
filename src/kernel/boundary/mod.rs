//! The contribution of jumps at edges to a gradient.
//!
//! Where a path looks at light, an edge that lies in between makes the integrand jump, and where the edge
//! moves, the integral changes by the jump. So at points of a path an edge is drawn that can be seen from
//! there, a point of it and the light that arrives beside it on either side (`edge_point`): light of emitters
//! (`vertex`, `delta`), and of surfaces and the environment (`reflected`). Edges that the camera sees are drawn on the
//! film (`film`).

mod delta;
mod edge_point;
mod film;
mod film_edges;
mod pieces;
mod reflected;
mod vertex;

pub(crate) use film_edges::FilmEdges;
#[cfg(feature = "wgpu")]
pub(crate) use pieces::Piece;
pub(crate) use pieces::PixelGradients;
