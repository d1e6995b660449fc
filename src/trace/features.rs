//! What stages are compiled for on GPUs: what a scene does not need is not in a kernel. On the host these are conditions
//! like others.

use crate::model::bsdf::Models;
use crate::sampling::{EmitterKinds, Sequence};

/// What a scene and its view have.
#[derive(Clone, Copy, Debug, Default, Hash, PartialEq, Eq)]
pub(crate) struct Features {
    /// Whether the tree of boxes has nodes, and room for a stack of them.
    pub boxes: bool,
    pub stack: usize,
    pub moves: bool,
    pub lens: bool,
    pub parallel: bool,
    pub smooth: bool,
    pub textured: bool,
    pub tinted: bool,
    pub tilted: bool,
    /// Whether any emission is a texture.
    pub glows: bool,
    pub holes: bool,
    pub glossy: bool,
    pub models: Models,
    pub emitters: bool,
    pub of_emitters: EmitterKinds,
    pub combined: bool,
    pub sky_constant: bool,
    pub sky_map: bool,
    /// Whether bounce rays that miss bring light of the environment; that of a map is gathered at surfaces instead, if
    /// strategies are combined.
    pub sees_sky: bool,
    pub gathers_map: bool,
    /// Whether there is no light at all.
    pub dark: bool,
    pub cones: bool,
    pub roulette: bool,
    pub sequence: Sequence,
}

impl Features {
    /// Whether points have the normals of their triangles, and materials that are matt and constant.
    pub fn plain_points(&self) -> bool {
        !(self.smooth || self.tilted || self.textured || self.tinted || self.glossy)
    }
}

/// The derivatives that are asked for.
#[derive(Clone, Copy, Debug, Default, Hash, PartialEq, Eq)]
pub(crate) struct Derivatives {
    /// Whether rays and the points that they hit have any.
    pub rays: bool,
    /// Whether any object's vertices or velocity have.
    pub objects: bool,
    pub velocities: bool,
    pub uvs: bool,
    pub normals: bool,
    pub colours: bool,
    pub tangents: bool,
    /// Colours and exponents of materials.
    pub materials: bool,
    pub emission: bool,
    pub lights: bool,
    pub sky: bool,
    pub camera: bool,
    /// Whether directions that are drawn turn while surfaces stand still.
    pub turns: bool,
    /// Whether jumps at edges that points of paths see are added, whether trees over edges have nodes, whether
    /// emitters are in several groups, and room for drawing an edge.
    pub jumps: bool,
    pub edge_nodes: bool,
    pub grouped: bool,
    pub edge_room: usize,
}
