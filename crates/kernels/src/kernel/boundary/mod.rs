//! The boundary term of a gradient: the contribution of jumps at edges.
//!
//! An edge between a point and the light that the point sees makes the integrand jump. If the edge moves, the integral
//! changes by the jump. So each point of a path draws an edge that it can see, and a point of this edge (`jumps`). Then
//! the light on both sides of the edge is computed (`beside`): the light of emitters, delta lights, surfaces and the
//! environment. Edges that the camera sees are drawn on the film (`film`), in pieces (`slots`, `film_edges`), where the
//! loss depends on its pixels.

mod beside;
mod film;
mod film_edges;
mod jumps;
mod slots;

pub use film_edges::FilmEdges;
