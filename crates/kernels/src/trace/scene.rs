//! A scene and its view as flat lists: borrowed on the host, parts of two buffers on a GPU.

#![cfg_attr(
    not(feature = "gpu"),
    allow(dead_code, reason = "some lists are for GPUs alone")
)]

use crate::cube::*;
use crate::host::Channel;
use crate::model::lists::vector;
use crate::model::triangle::{Plane, Triangle, plane_at, triangle_at};
use crate::model::{V3, camera, splat};

use super::Features;
#[cfg(feature = "gpu")]
use super::Fours;

/// Defines the struct of all lists and numbers, and their positions in the header that a view has in a buffer of
/// words.
macro_rules! lists {
    (
        floats { $($(#[$of_float:meta])* $float:ident,)* }
        words { $($(#[$of_word:meta])* $word:ident,)* }
        numbers { $($(#[$of_number:meta])* $number:ident,)* }
    ) => {
        /// The lists and numbers of a scene and its view, and the features that kernels are compiled for.
        #[cfg_attr(feature = "gpu", derive(CubeType))]
        #[derive(Clone, Copy, Default)]
        pub struct Scene<'a> {
            $($(#[$of_float])* pub $float: &'a [f32],)*
            $($(#[$of_word])* pub $word: &'a [u32],)*
            $($(#[$of_number])* pub $number: u32,)*
            /// All floats of the buffer by four, if they can be loaded so, and where nodes, triangles for rays, and the
            /// nodes and leaves of trees over edges begin in them.
            #[cfg(feature = "gpu")]
            pub fours: Fours<'a>,
            #[cfg(feature = "gpu")]
            pub first_node: u32,
            #[cfg(feature = "gpu")]
            pub first_hit: u32,
            #[cfg(feature = "gpu")]
            pub first_edge_node: u32,
            #[cfg(feature = "gpu")]
            pub first_edge_leaf: u32,
            #[cfg_attr(feature = "gpu", cube(comptime))]
            pub features: Features,
        }

        /// Positions in a header: where lists begin in their buffers, then numbers.
        #[cfg(feature = "gpu")]
        #[allow(non_camel_case_types)]
        #[derive(Clone, Copy)]
        pub enum HeaderWord { $($float,)* $($word,)* $($number,)* End }

        #[cfg(feature = "gpu")]
        impl HeaderWord {
            /// Returns whether lists that the device computes depend on this list.
            pub fn shapes(self) -> bool {
                use HeaderWord as W;
                matches!(
                    self,
                    W::vertices | W::crossings | W::creases | W::velocities | W::vertex_rows
                        | W::triangles | W::of_edges | W::edge_kinds | W::edges_of_leaves
                        | W::edge_children | W::hit_numbers
                )
            }
        }

        #[cfg(feature = "gpu")]
        impl Scene<'_> {
            pub fn float_lists(&self) -> Vec<(HeaderWord, &[f32])> {
                vec![$((HeaderWord::$float, self.$float),)*]
            }

            pub fn word_lists(&self) -> Vec<(HeaderWord, &[u32])> {
                vec![$((HeaderWord::$word, self.$word),)*]
            }

            pub fn numbers(&self) -> Vec<(HeaderWord, u32)> {
                vec![$((HeaderWord::$number, self.$number),)*]
            }
        }

        #[cfg(feature = "gpu")]
        #[cube]
        impl<'a> Scene<'a> {
            /// Returns the scene of a view, whose header is in the second of two buffers.
            pub fn of_view(
                floats: &'a [f32],
                words: &'a [u32],
                fours: Fours<'a>,
                view: u32,
                #[comptime] features: Features,
            ) -> Scene<'a> {
                let header = &words[view as usize * HEADER..];
                Scene::<'a> {
                    $($float: &floats[header[comptime!(HeaderWord::$float as usize)] as usize..],)*
                    $($word: &words[header[comptime!(HeaderWord::$word as usize)] as usize..],)*
                    $($number: header[comptime!(HeaderWord::$number as usize)],)*
                    fours,
                    first_node: header[comptime!(HeaderWord::nodes as usize)] / 4,
                    first_hit: header[comptime!(HeaderWord::hits as usize)] / 4,
                    first_edge_node: header[comptime!(HeaderWord::edge_nodes as usize)] / 4,
                    first_edge_leaf: header[comptime!(HeaderWord::edge_leaves as usize)] / 4,
                    features,
                }
            }
        }
    };
}

lists! {
    floats {
        /// Each triangle ([`Triangle`]).
        surfaces,
        /// Displacement of each object over the shutter, if any object moves.
        velocities,
        /// Values at corners: texture coordinates, normals, colors, and tangents with the signs of their bitangents.
        uvs,
        normals,
        colors,
        tangents,
        /// Constants of each material, three numbers per channel.
        materials,
        texels,
        /// [`OF_MASKED`](crate::host::OF_MASKED) numbers per triangle with a mask: the texture coordinates of its
        /// corners, and the alpha below which it has a hole. Then the texels of the masks.
        masked_uvs,
        alphas,
        /// Position, axis, strength and spot cosines of each delta light.
        lights,
        /// Corners, normal, area and velocity of each emissive triangle, and the factors of the emitters' light.
        emitter_triangles,
        brightness,
        /// Fixed probabilities of emitters, and their cumulative sums.
        fixed,
        fixed_sums,
        /// Floats of the tree over emitters ([`LightTree`](crate::sampling::LightTree)).
        light_branches,
        distant_sums,
        distant_axes,
        /// Radiance of a constant environment or texels of a map, and the list that directions to the map are sampled
        /// by.
        sky,
        sky_density,
        /// [`GROUP`] numbers per group of emitters: center, radius and velocity.
        groups,
        /// One end of each edge, and the vector to the other end.
        edges,
        /// The possible jump of color at each edge where both faces are seen.
        creases,
        /// For GPUs, which compute `surfaces`, `edges`, nodes, leaves and `hits`: each vertex as the sum of two
        /// floats per axis, and edges that are crossings.
        vertices,
        crossings,
        /// The nodes of the tree over all edges, its leaves, and the leaves of a list of moving edges.
        edge_nodes,
        edge_leaves,
        /// The BVH nodes that GPUs traverse, and triangles in the form for ray intersection.
        nodes,
        hits,
        /// Table of the pixel filter; the camera and the other settings of a view.
        filter,
        settings,
    }
    words {
        /// [`TRIANGLE`] words per triangle: its material and object, and the rows of its corners' texture coordinates
        /// and normals, or [`NONE`].
        triangles,
        /// Vertices of each triangle.
        vertex_rows,
        /// Rows of the colors and tangents at the corners of each triangle, or [`NONE`]; empty if there are none.
        color_rows,
        tangent_rows,
        /// [`MATERIAL`] words per material: bits, the textures of its channels, and its normal map.
        of_materials,
        /// Index of each triangle among those with a mask, or [`NONE`], and the image of each of these.
        masked,
        masks,
        /// The triangle of each emitter, followed by the delta lights; then their bits.
        emitters,
        light_bits,
        /// Words of the tree over emitters.
        light_nodes,
        light_places,
        distant,
        /// [`OF_GROUP`] words per group: its first member, the number of members, and whether any moves. Then the
        /// group of each emitter.
        of_groups,
        group_of_emitters,
        /// Faces and rows of each edge, its object, and whether it is a crossing.
        of_edges,
        edge_children,
        edges_of_leaves,
        /// The kind of each edge, with its bits ([`CLOSED`](crate::model::edge_weight::CLOSED)).
        edge_kinds,
        /// For GPUs: the slots for pieces of edges on the film ([`OF_SLOT`](super::OF_SLOT)), and then room.
        slots,
        /// For both trees: where their leaves and edges begin, the child that a draw starts at, and the number of
        /// children it starts at.
        edge_trees,
        /// The numbers of the triangles that GPUs intersect with rays.
        hit_numbers,
        /// The number of each object among the counted ones.
        counted,
        /// Whether derivatives with respect to each object and each delta light are requested.
        wanted_objects,
        wanted_lights,
        /// Start of each vertex's corners, and one more; the corners, each as 3·triangle + corner.
        vertex_starts,
        vertex_corners,
        /// First sum of each part.
        first_sums,
        /// Points of the sequence of random numbers, and seeds.
        points,
        seeds,
    }
    numbers {
        emitter_count,
        /// Number of triangles among the emitters.
        emissive_count,
        light_node_count,
        distant_count,
        sky_width,
        sky_height,
        /// The number of triangles that are intersected without a BVH.
        hit_count,
        /// The number of slots.
        slot_count,
        width,
        height,
        bounces,
        roulette_after,
        samples_log,
        sample_blocks,
    }
}

/// Number of words of a header.
#[cfg(feature = "gpu")]
pub const HEADER: usize = HeaderWord::End as usize;
#[cfg(feature = "gpu")]
pub const BOUNCES: usize = HeaderWord::bounces as usize;

/// Offsets of the rows among a triangle's words.
pub const UV_ROWS: u32 = 2;
pub const NORMAL_ROWS: u32 = 5;
pub const TRIANGLE: u32 = 8;
/// Number of channels of a material, and the index of emission among them.
pub const CHANNELS: u32 = crate::host::CHANNELS as u32;
pub const EMISSION: u32 = Channel::Emission.place() as u32;
/// Offset of the normal map among a material's words.
pub const NORMAL_MAP: u32 = 1 + 4 * CHANNELS;
pub const MATERIAL: u32 = NORMAL_MAP + 4;
pub const GROUP: u32 = 7;
pub const OF_GROUP: u32 = 3;
/// No row, or no triangle.
pub const NONE: u32 = u32::MAX;

/// Bits of a material, and the factor of the number of its BSDF, which is below 8.
pub const EMITS: u32 = 1;
pub const REFLECTS: u32 = 2;
pub const GLOSSY: u32 = 4;
pub const COMPENSATED: u32 = 8;
pub const MODEL: u32 = 16;
/// The bits of which a material that bounces follow has any: it is glossy, or of another BSDF than Phong's.
pub const FOLLOWED: u32 = GLOSSY | (7 * MODEL);
pub const GLOWS: u32 = 8 * MODEL;

/// Settings of a view: the camera, the tangent of the half-angle of cones, scene units per unit of the lists, the limit
/// of indirect light, the least roughness after a bounce, 1 over the distance at which directions follow glossy faces by
/// half (0 if they never do, −1 if no ray follows the material), the radius of the pixel filter, or 0 if camera rays follow
/// nothing, and the factor by which edges that rest count less on the film.
pub const CONE: usize = camera::NUMBERS;
pub const UNIT: usize = CONE + 1;
pub const CLAMP: usize = UNIT + 1;
pub const LEAST_ROUGHNESS: usize = CLAMP + 1;
pub const FOLLOWING: usize = LEAST_ROUGHNESS + 1;
pub const FILTER: usize = FOLLOWING + 1;
pub const RESTING: usize = FILTER + 1;

/// Returns the number of the BSDF in the bits of a material.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn model_in(bits: u32) -> u32 {
    (bits / MODEL) % 8
}

#[cfg_attr(feature = "gpu", cube)]
impl<'a> Scene<'a> {
    #[inline(always)]
    pub fn triangle(&self, k: u32) -> Triangle {
        triangle_at(self.surfaces, k)
    }

    /// Returns the plane of a triangle.
    #[inline(always)]
    pub fn plane(&self, k: u32) -> Plane {
        plane_at(self.surfaces, k)
    }

    #[inline(always)]
    pub fn material_of(&self, triangle: u32) -> u32 {
        self.triangles[(TRIANGLE * triangle) as usize]
    }

    #[inline(always)]
    pub fn object_of(&self, triangle: u32) -> u32 {
        self.triangles[(TRIANGLE * triangle) as usize + 1]
    }

    /// Returns the bits of a material.
    #[inline(always)]
    pub fn bits_of(&self, material: u32) -> u32 {
        self.of_materials[(MATERIAL * material) as usize]
    }

    /// Returns the number of the BSDF of a material.
    #[inline(always)]
    pub fn model_of(&self, material: u32) -> u32 {
        model_in(self.bits_of(material))
    }

    /// Returns the displacement of a triangle at a shutter time.
    #[inline(always)]
    pub fn shift(&self, triangle: u32, time: f32) -> V3 {
        let mut shift = splat(0.0);
        if comptime!(self.features.moves) {
            shift = vector(self.velocities, 3 * self.object_of(triangle)) * time;
        }
        shift
    }

    /// Returns whether derivatives with respect to an object are requested.
    #[inline(always)]
    pub fn is_wanted(&self, object: u32) -> bool {
        self.wanted_objects[object as usize] != 0
    }
}
