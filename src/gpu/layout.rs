//! Views as two buffers: floats, and words that say where they lie.
//!
//! Both begin with a header for each view; lists of scenes follow, which views of a scene share. Places in a header's
//! words are where lists begin.

/// Words of the header.
pub(super) const WIDTH: usize = 0;
pub(super) const HEIGHT: usize = 1;
pub(super) const BOUNCES: usize = 2;
pub(super) const ROULETTE_AFTER: usize = 3;
pub(super) const SAMPLES_LOG: usize = 4;
pub(super) const BLOCKS: usize = 5;
pub(super) const SEED: usize = 6;
pub(super) const SEED_OF_CONES: usize = 8;
/// Words: the points of the Sobol sequence.
pub(super) const TABLES: usize = 10;
/// The first node or leaf.
pub(super) const ROOT: usize = 11;
/// Floats: both boxes of nodes, twelve numbers each. Words: both children.
pub(super) const BOXES: usize = 12;
pub(super) const CHILDREN: usize = 13;
/// Floats: triangles as rays meet them, [`HIT_STRIDE`] numbers each, and words: their numbers.
pub(super) const HITS: usize = 14;
pub(super) const HIT_NUMBERS: usize = 15;
/// Words: first and number of the triangles of a leaf.
pub(super) const LEAVES: usize = 16;
/// Floats: triangles as surfaces, [`SURFACE_STRIDE`] numbers each. Words: [`OF_TRIANGLE`] each.
pub(super) const SURFACES: usize = 17;
pub(super) const OF_TRIANGLES: usize = 18;
/// Floats: displacement over the shutter of each object.
pub(super) const VELOCITIES: usize = 19;
pub(super) const UVS: usize = 20;
pub(super) const NORMALS: usize = 21;
/// Floats: constants of materials, four colours each. Words: [`OF_MATERIAL`] each.
pub(super) const MATERIALS: usize = 22;
pub(super) const OF_MATERIALS: usize = 23;
pub(super) const TEXELS: usize = 24;
/// Words: triangles of emitters. Floats: brightness of each, and of lights without extent.
pub(super) const EMITTERS: usize = 25;
pub(super) const OF_EMITTERS: usize = 26;
pub(super) const EMITTER_COUNT: usize = 27;
/// Floats: texels of the sky, then sums over rows, sums within rows, and probabilities.
pub(super) const SKY: usize = 28;
pub(super) const SKY_WIDTH: usize = 29;
pub(super) const SKY_HEIGHT: usize = 30;
pub(super) const SKY_ROWS: usize = 31;
pub(super) const SKY_COLUMNS: usize = 32;
pub(super) const SKY_CHANCES: usize = 33;
/// Floats: the pixel filter's table.
pub(super) const FILTER: usize = 34;
/// Words: the number of each object among those that are counted.
pub(super) const COUNTED: usize = 35;
/// The number of triangles that are met without boxes.
pub(super) const HIT_COUNT: usize = 36;
/// Words: the vertices of each triangle.
pub(super) const VERTEX_ROWS: usize = 37;
/// Words: whether derivatives by an object are asked for.
pub(super) const WANTED_OBJECTS: usize = 38;
/// The first sum of each part ([`sums`](super::sums)).
pub(super) const FIRST_SUMS: usize = 40;
/// Floats: colours at corners, and tangents with the sides of their bitangents, four numbers each. Words: the rows of
/// those of each triangle, or [`NONE`].
pub(super) const COLOURS: usize = 80;
pub(super) const COLOUR_ROWS: usize = 81;
pub(super) const TANGENTS: usize = 82;
pub(super) const TANGENT_ROWS: usize = 83;
/// Words: the place of each triangle among those with a mask, or [`NONE`], and the mask of each of these, four
/// words each, as for a texture. Floats: [`OF_MASKED`] for each of them, and what masks hold.
pub(super) const MASKED: usize = 84;
pub(super) const MASKS: usize = 85;
pub(super) const MASKED_UVS: usize = 86;
pub(super) const ALPHAS: usize = 87;
/// Lights without extent. Floats: [`OF_LIGHT`] each. Words: their bits.
pub(super) const LIGHTS: usize = 88;
pub(super) const LIGHT_BITS: usize = 89;
/// The number of triangles among emitters; lights without extent follow them.
pub(super) const EMISSIVE_COUNT: usize = 90;
/// Floats: fixed probabilities of emitters, and sums of these, where they are many.
pub(super) const FIXED: usize = 102;
pub(super) const FIXED_SUMS: usize = 91;
/// A tree over emitters ([`LightTree`](crate::sampling::LightTree)). Floats: its branches. Words: its nodes, and the
/// places of emitters.
pub(super) const LIGHT_BRANCHES: usize = 92;
pub(super) const LIGHT_NODES: usize = 93;
pub(super) const LIGHT_NODE_COUNT: usize = 94;
pub(super) const LIGHT_PLACES: usize = 95;
/// Directional lights beside it. Words: which emitters they are. Floats: sums of their strengths, and how they lie.
pub(super) const DISTANT: usize = 96;
pub(super) const DISTANT_COUNT: usize = 97;
pub(super) const DISTANT_SUMS: usize = 98;
pub(super) const DISTANT_AXES: usize = 99;
/// Words: where the corners of each vertex begin, and one more; the corners, each as 3·triangle + corner.
pub(super) const VERTEX_STARTS: usize = 100;
pub(super) const VERTEX_CORNERS: usize = 101;
pub(super) const HEADER: usize = 104;

/// Floats of the header: the camera, then the tangent of cones.
pub(super) const CAMERA: usize = 0;
pub(super) const CONE: usize = 24;
/// Scene units in a unit of the kernels.
pub(super) const UNIT: usize = 25;
/// The rows of the inverse of the camera's basis.
pub(super) const DUAL: usize = 32;
pub(super) const FLOAT_HEADER: usize = 48;

pub(super) const HIT_STRIDE: usize = 20;
pub(super) const SURFACE_STRIDE: usize = 16;
pub(super) const OF_TRIANGLE: usize = 8;
pub(super) const OF_MATERIAL: usize = 24;
/// The texture of a material's normal map among its words.
pub(super) const NORMAL_MAP: usize = 17;
pub(super) const OF_LIGHT: usize = 11;
/// Texture coordinates of the corners of a triangle with a mask, and the alpha under which it has a hole.
pub(super) const OF_MASKED: usize = 8;
/// A child that is a leaf.
pub(super) const LEAF: u32 = 1 << 31;
pub(super) const NONE: u32 = u32::MAX;
/// Bits of a light without extent, the last where derivatives by it are asked for.
pub(super) const DIRECTIONAL: u32 = 1;
pub(super) const SPOT: u32 = 2;
pub(super) const WANTED: u32 = 4;
/// Bits of a material.
pub(super) const EMITS: u32 = 1;
pub(super) const REFLECTS: u32 = 2;
pub(super) const GLOSSY: u32 = 4;
pub(super) const COMPENSATED: u32 = 8;
/// What the number of its BSDF is multiplied by.
pub(super) const MODEL: u32 = 16;
