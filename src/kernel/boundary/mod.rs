//! The contribution of jumps at edges to a gradient.
//!
//! Where a path looks at light, an edge that lies in between makes the integrand jump, and where the edge
//! moves, the integral changes by the jump. So at points of a path an edge is drawn that can be seen from
//! there and a point of it (`jumps`), and the light that arrives beside it on either side is found (`beside`): that of
//! emitters, of delta lights, of surfaces and of the environment. Edges that the camera sees are drawn on the film (`film`).

mod beside;
mod film;
mod film_edges;
mod jumps;
mod pieces;

pub(crate) use film_edges::FilmEdges;
#[cfg(feature = "wgpu")]
pub(crate) use pieces::Piece;
pub(crate) use pieces::PixelGradients;
