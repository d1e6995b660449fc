//! An edge at which something may jump.

use crate::kernel::gradient::Wanted;
use crate::kernel::scene::KernelScene;
use crate::model::V3;

/// Surfaces that lie within this share of the coordinates of an edge touch it.
pub(in crate::kernel) const TOUCHING: f32 = 4e-6;
/// Faces of an edge, at most; if there are more, the others count as what lies behind.
pub(in crate::kernel) const FACES: usize = 4;

/// An edge, in inner coordinates at the start of the shutter.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernel) struct Edge {
    pub a: V3,
    /// The vector from a to b.
    pub along: V3,
    /// Its triangles, `u32::MAX` where there are no more.
    pub faces: [u32; FACES],
    /// Rows of the two ends in the vertices of its first and second face.
    pub rows: [[u32; 2]; 2],
    pub object: u32,
    pub kind: Kind,
    /// The most by which colours may jump at it where both faces are seen, up to 1.
    pub crease: f32,
    /// Whether all that is behind its faces is hidden by the object itself.
    pub closed: bool,
    /// Whether its faces move apart while the shutter is open: then the line of a crossing moves too.
    pub apart: bool,
}

impl Edge {
    /// Whether it has derivatives.
    pub fn moves(&self, scene: &KernelScene, wanted: &Wanted) -> bool {
        if self.kind == Kind::Crossing {
            return self.faces[..2].iter().any(|&k| {
                let object = scene.triangles[k as usize].object;
                wanted.objects[object as usize]
            });
        }
        wanted.objects[self.object as usize]
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::kernel) enum Kind {
    /// An edge between two faces of opposite direction: it jumps where one is seen from the front, one from
    /// behind.
    Fold,
    /// An edge of one face, or of more than two: it always jumps.
    Border,
    /// A line in which two triangles pass through each other: colours jump, but not whether light passes.
    Crossing,
}
