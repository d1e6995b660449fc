//! Compile-time switches of the stages: on GPUs, kernels omit features that a scene does not use. On the host these
//! are ordinary conditions.

use crate::model::bsdf::Models;
use crate::sampling::{EmitterKinds, Sequence};

/// Features that a scene and its view use.
#[derive(Clone, Copy, Debug, Default, Hash, PartialEq, Eq)]
pub struct Features {
    /// Whether the BVH has nodes, and the size of its stack.
    pub boxes: bool,
    pub stack: usize,
    pub moves: bool,
    pub lens: bool,
    pub parallel: bool,
    pub smooth: bool,
    pub textured: bool,
    pub tinted: bool,
    pub tilted: bool,
    /// Whether any emission is textured.
    pub glows: bool,
    pub holes: bool,
    pub glossy: bool,
    pub models: Models,
    pub emitters: bool,
    pub of_emitters: EmitterKinds,
    pub combined: bool,
    pub sky_constant: bool,
    pub sky_map: bool,
    /// Whether bounce rays that miss carry light of the environment. If MIS is used, light of an environment map is
    /// gathered at surfaces instead.
    pub sees_sky: bool,
    pub gathers_map: bool,
    /// Whether directions to a map turn with the lobes of polished surfaces in derivatives, on the host.
    pub turns_to_map: bool,
    /// Whether there is no light at all.
    pub dark: bool,
    pub cones: bool,
    pub roulette: bool,
    /// Whether surfaces have a least roughness after a bounce.
    pub regularized: bool,
    /// Whether indirect light is clamped, and whether albedos are an output.
    pub clamp: bool,
    pub albedo: bool,
    pub sequence: Sequence,
}

impl Features {
    /// Returns whether camera rays follow any material in derivatives.
    pub fn follows_on_film(&self) -> bool {
        self.glossy && !self.cones
    }

    /// Returns whether all points have their triangle's normal and a constant diffuse material.
    pub fn plain_points(&self) -> bool {
        !(self.smooth || self.tilted || self.textured || self.tinted || self.glossy)
    }
}

/// The derivatives that are requested.
#[derive(Clone, Copy, Debug, Default, Hash, PartialEq, Eq)]
pub struct Derivatives {
    /// Whether rays and their hit points have derivatives.
    pub rays: bool,
    /// Whether vertices or velocity of any object have derivatives.
    pub objects: bool,
    pub velocities: bool,
    pub uvs: bool,
    pub normals: bool,
    pub colors: bool,
    pub tangents: bool,
    /// Colors and exponents of materials.
    pub materials: bool,
    pub emission: bool,
    pub lights: bool,
    pub sky: bool,
    pub camera: bool,
    /// Whether sampled directions change while surfaces are static.
    pub turns: bool,
    /// Whether boundary terms at edges seen from path points are added, whether trees over edges have nodes, whether
    /// emitters form several groups, and the size of the working memory for drawing an edge.
    pub jumps: bool,
    pub edge_nodes: bool,
    pub grouped: bool,
    pub edge_room: usize,
}
