//! The contribution of jumps at edges to a gradient.
//!
//! Where a path looks at light, an edge that lies in between makes the integrand jump, and where the edge
//! moves, the integral changes by the jump. So at points of a path (`vertex`) an edge is drawn that can be
//! seen from there, a point of it (`edge_point`), and the light that arrives beside it on either side
//! (`sides`): light of emitters (`lights`), and of surfaces and the environment (`reflected`). Edges that the
//! camera sees are drawn on the film (`film`).

mod edge_point;
mod film;
mod lights;
mod observer;
mod reflected;
mod sides;
mod vertex;

pub(crate) use film::PixelGradients;
