//! A scene as a camera sees it, as flat lists: on the host borrowed from where they are, on a GPU parts of two buffers.

#![cfg_attr(
    not(feature = "wgpu"),
    allow(dead_code, reason = "some lists are for GPUs alone")
)]

use crate::cube::*;
use crate::model::lists::vector;
use crate::model::triangle::{Plane, Triangle, plane_at, triangle_at};
use crate::model::{V3, camera, splat};
use crate::scene::Channel;

use super::Features;

/// Makes the struct of all lists and numbers, and their places in the header that a view has in a buffer of words.
macro_rules! lists {
    (
        floats { $($(#[$of_float:meta])* $float:ident,)* }
        words { $($(#[$of_word:meta])* $word:ident,)* }
        numbers { $($(#[$of_number:meta])* $number:ident,)* }
    ) => {
        /// The lists of a scene and of its view, numbers beside them, and what kernels are compiled for.
        #[cfg_attr(feature = "wgpu", derive(CubeType))]
        #[derive(Clone, Copy, Default)]
        pub(crate) struct Scene<'a> {
            $($(#[$of_float])* pub $float: &'a [f32],)*
            $($(#[$of_word])* pub $word: &'a [u32],)*
            $($(#[$of_number])* pub $number: u32,)*
            #[cfg_attr(feature = "wgpu", cube(comptime))]
            pub features: Features,
        }

        /// The places of a header: where lists begin in their buffers, then numbers.
        #[cfg(feature = "wgpu")]
        #[allow(non_camel_case_types)]
        #[derive(Clone, Copy)]
        pub(crate) enum HeaderWord { $($float,)* $($word,)* $($number,)* End }

        #[cfg(feature = "wgpu")]
        impl HeaderWord {
            /// Whether lists that the device makes depend on this one.
            pub fn shapes(self) -> bool {
                use HeaderWord as W;
                matches!(
                    self,
                    W::vertices | W::crossings | W::creases | W::velocities | W::vertex_rows
                        | W::triangles | W::of_edges | W::edge_kinds | W::edges_of_leaves
                        | W::hit_numbers
                )
            }
        }

        #[cfg(feature = "wgpu")]
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

        #[cfg(feature = "wgpu")]
        #[cube]
        impl<'a> Scene<'a> {
            /// That of a view, whose header is in the second of two buffers.
            pub fn of_view(
                floats: &'a [f32],
                words: &'a [u32],
                view: u32,
                #[comptime] features: Features,
            ) -> Scene<'a> {
                let header = &words[view as usize * HEADER..];
                Scene::<'a> {
                    $($float: &floats[header[comptime!(HeaderWord::$float as usize)] as usize..],)*
                    $($word: &words[header[comptime!(HeaderWord::$word as usize)] as usize..],)*
                    $($number: header[comptime!(HeaderWord::$number as usize)],)*
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
        /// The displacement of each object over the shutter, if any moves.
        velocities,
        /// Values at corners: texture coordinates, normals, colours, and tangents with the sides of their bitangents.
        uvs,
        normals,
        colours,
        tangents,
        /// The constants of each material, three numbers a channel.
        materials,
        texels,
        /// [`OF_MASKED`](crate::scene::OF_MASKED) of each triangle with a mask: the texture coordinates of its corners, and the alpha under which it
        /// has a hole. What masks hold.
        masked_uvs,
        alphas,
        /// Of each delta light its position, axis, strength, and the cosines of a spot.
        lights,
        /// Corners, normal, area and velocity of each triangle that emits, and what emitters bring is multiplied
        /// by.
        emitter_triangles,
        brightness,
        /// Fixed probabilities of emitters, and sums of these.
        fixed,
        fixed_sums,
        /// Of a tree over emitters ([`LightTree`](crate::sampling::LightTree)).
        light_branches,
        distant_sums,
        distant_axes,
        /// The radiance of a constant environment, or texels of a map, and what directions to it are drawn by.
        sky,
        sky_density,
        /// [`GROUP`] of each group of emitters: centre, radius and velocity.
        groups,
        /// Of each edge an end, and the vector to the other.
        edges,
        /// For GPUs, which make `surfaces`, `hits`, `edges` and `edge_leaves`: each vertex as the sum of two numbers an axis,
        /// edges that are crossings, and by how much colours may jump at each edge where both faces are seen.
        vertices,
        crossings,
        creases,
        /// Of the trees over all edges and over those that move, one behind the other.
        edge_nodes,
        edge_leaves,
        /// Both boxes of nodes of the tree that GPUs traverse, and triangles as rays meet them.
        boxes,
        hits,
        /// The pixel filter's table, and the camera, and what else a view has.
        filter,
        settings,
    }
    words {
        /// [`TRIANGLE`] of each triangle: its material and object, the rows of its corners' texture coordinates and
        /// normals, or [`NONE`].
        triangles,
        /// The vertices of each triangle.
        vertex_rows,
        /// The rows of the colours and tangents at the corners of each triangle, or [`NONE`]; empty where there are none.
        colour_rows,
        tangent_rows,
        /// [`MATERIAL`] of each material: bits, the textures of its channels, and that of its normal map.
        of_materials,
        /// The place of each triangle among those with a mask, or [`NONE`], and the image of each of these.
        masked,
        masks,
        /// The triangle of each emitter; delta lights follow them. Their bits.
        emitters,
        light_bits,
        /// Of the tree over emitters.
        light_nodes,
        light_places,
        distant,
        /// [`OF_GROUP`] of each group: its first member, how many, and whether any moves. The group of each emitter.
        of_groups,
        group_of_emitters,
        /// Its faces and rows of each edge, its object, and whether it is a crossing.
        of_edges,
        edge_children,
        edges_of_leaves,
        /// For GPUs the kind of each edge, and whether its object is closed ([`CLOSED`]).
        edge_kinds,
        /// Of both trees: where their nodes, children, leaves and edges begin, the child that a draw starts at, and how
        /// many it starts at.
        edge_trees,
        /// Children of nodes that GPUs traverse, first and number of the triangles of leaves, and their numbers.
        children,
        leaves,
        hit_numbers,
        /// The number of each object among those that are counted.
        counted,
        /// Whether derivatives by each object and each delta light are asked for.
        wanted_objects,
        wanted_lights,
        /// Where the corners of each vertex begin, and one more; the corners, each as 3·triangle + corner.
        vertex_starts,
        vertex_corners,
        /// The first sum of each part.
        first_sums,
        /// The points of the sequence of random numbers, and seeds.
        points,
        seeds,
    }
    numbers {
        emitter_count,
        /// The number of triangles among them.
        emissive_count,
        light_node_count,
        distant_count,
        sky_width,
        sky_height,
        /// The first node or leaf, and the number of triangles that are met without boxes.
        root,
        hit_count,
        width,
        height,
        bounces,
        roulette_after,
        samples_log,
        sample_blocks,
    }
}

/// Words of a header.
#[cfg(feature = "wgpu")]
pub(crate) const HEADER: usize = HeaderWord::End as usize;
#[cfg(feature = "wgpu")]
pub(crate) const BOUNCES: usize = HeaderWord::bounces as usize;

/// The places of a triangle's rows among its words.
pub(crate) const UV_ROWS: u32 = 2;
pub(crate) const NORMAL_ROWS: u32 = 5;
pub(crate) const TRIANGLE: u32 = 8;
/// Channels of a material, and the place of emission among them.
pub(crate) const CHANNELS: u32 = crate::scene::CHANNELS as u32;
pub(crate) const EMISSION: u32 = Channel::Emission.place() as u32;
/// The place of a material's normal map among its words.
pub(crate) const NORMAL_MAP: u32 = 1 + 4 * CHANNELS;
pub(crate) const MATERIAL: u32 = NORMAL_MAP + 4;
pub(crate) const GROUP: u32 = 7;
pub(crate) const OF_GROUP: u32 = 3;
/// The bit of an edge's kind ([`FOLD`](crate::model::edge_weight::FOLD) and so on) that says that its object is closed.
pub(crate) const CLOSED: u32 = 4;
/// No row, or no triangle.
pub(crate) const NONE: u32 = u32::MAX;

/// Bits of a material, and what the number of its BSDF, which is under 8, is multiplied by.
pub(crate) const EMITS: u32 = 1;
pub(crate) const REFLECTS: u32 = 2;
pub(crate) const GLOSSY: u32 = 4;
pub(crate) const COMPENSATED: u32 = 8;
pub(crate) const MODEL: u32 = 16;
pub(crate) const GLOWS: u32 = 8 * MODEL;

/// A view's settings: the camera, the tangent of the half-angle of cones, and scene units in a unit of the lists.
pub(crate) const CONE: usize = camera::NUMBERS;
pub(crate) const UNIT: usize = CONE + 1;

#[cfg_attr(feature = "wgpu", cube)]
impl<'a> Scene<'a> {
    #[inline(always)]
    pub fn triangle(&self, k: u32) -> Triangle {
        triangle_at(self.surfaces, k)
    }

    /// The plane of a triangle.
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

    /// The bits of a material.
    #[inline(always)]
    pub fn bits_of(&self, material: u32) -> u32 {
        self.of_materials[(MATERIAL * material) as usize]
    }

    /// The vector by which a triangle has moved at a time in the shutter.
    #[inline(always)]
    pub fn shift(&self, triangle: u32, time: f32) -> V3 {
        let mut shift = splat(0.0);
        if comptime!(self.features.moves) {
            shift = vector(self.velocities, 3 * self.object_of(triangle)) * time;
        }
        shift
    }

    /// Whether derivatives by an object are asked for.
    #[inline(always)]
    pub fn is_wanted(&self, object: u32) -> bool {
        self.wanted_objects[object as usize] != 0
    }
}
