//! Path tracing on the host in f32, with hand-written derivatives. It runs the stages of [`trace`](crate::trace) over
//! blocks of paths.
//!
//! `scene` holds the lists of a scene, made from `lists` of triangles; `view` adds a camera and settings. `walk` holds
//! blocks of paths and the levels that they reach. `path` traces them forward, with direct light from `direct`, and
//! `eights` computes steps on matt surfaces for eight paths at once. `backward` goes back over the levels. `edges`
//! collects and draws the edges at which visibility jumps, `boundary` traces the contributions of the jumps, and
//! `shares` computes the number of samples for them. `gradient` holds the sums of derivatives, `tangents` the tangents that
//! forward mode multiplies with them, and `tasks` renders the pixels of a core.

mod backward;
mod boundary;
mod direct;
mod edges;
mod eights;
mod gradient;
mod lists;
mod path;
mod pixels;
mod scene;
mod shares;
mod tangents;
mod tasks;
mod view;
mod walk;

pub use boundary::FilmEdges;
#[cfg(feature = "gpu")]
pub use edges::{
    Blocks, Bounds, DrawnEdge, LEAF, NO_EDGE, NODE, Root, TreeShape, draw_edge, put_edge,
    put_subtree,
};
pub use edges::{EdgeSets, LastEdges};
#[cfg(feature = "gpu")]
pub use gradient::Rows;
pub use gradient::{HostSums, Wanted};
pub use pixels::PixelGradients;
pub use scene::KernelScene;
pub use shares::{KINDS, ON_FILM, SEARCHED, SHADOWS, Yields};
pub use tasks::Counted;
pub use view::{View, ViewSettings};
pub use walk::{RayCounts, Seen, Work};
