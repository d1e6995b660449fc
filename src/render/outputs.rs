//! The outputs of a render.

use serde::{Deserialize, Serialize};

/// The outputs of a render in addition to radiance.
///
/// [`RenderOptions`](super::RenderOptions) has an example.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[non_exhaustive]
pub struct Outputs {
    /// See [`RenderOptions::with_opacity`](super::RenderOptions::with_opacity).
    pub opacity: bool,
    /// See [`RenderOptions::with_depth`](super::RenderOptions::with_depth).
    pub depth: bool,
    /// See [`RenderOptions::with_normals`](super::RenderOptions::with_normals).
    pub normals: bool,
    /// See [`RenderOptions::with_albedo`](super::RenderOptions::with_albedo).
    pub albedo: bool,
    /// See [`RenderOptions::with_object_ids`](super::RenderOptions::with_object_ids).
    pub object_ids: bool,
}

impl Outputs {
    /// Whether opacity is rendered. Depth and normals need it, since they are divided by it.
    pub(super) fn need_opacity(self) -> bool {
        self.opacity || self.depth || self.normals
    }
}
