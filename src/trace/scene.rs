//! A scene as a camera sees it, as flat lists: on the host borrowed from where they are, on a GPU parts of two buffers.

#![cfg_attr(
    not(feature = "wgpu"),
    allow(dead_code, reason = "some lists are for GPUs alone")
)]

use crate::cube::*;
use crate::model::lists::vector;
use crate::model::triangle::{barycentric_slopes, weights_at};
use crate::model::{Pair, V3, splat};
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
        /// [`SURFACE`] of each triangle: its corners, normal, plane and area.
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

pub(crate) const SURFACE: u32 = 14;
/// The place of a triangle's area among its numbers, and those of its rows among its words.
pub(crate) const AREA: usize = 13;
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
/// No row, or no triangle.
pub(crate) const NONE: u32 = u32::MAX;

/// Bits of a material, and what the number of its BSDF, which is under 8, is multiplied by.
pub(crate) const EMITS: u32 = 1;
pub(crate) const REFLECTS: u32 = 2;
pub(crate) const GLOSSY: u32 = 4;
pub(crate) const COMPENSATED: u32 = 8;
pub(crate) const MODEL: u32 = 16;
pub(crate) const GLOWS: u32 = 8 * MODEL;

/// A view's settings: the camera, the tangent of the half-angle of cones, scene units in a unit of the lists, and the
/// rows of the inverse of the camera's basis.
pub(crate) const CAMERA: u32 = 0;
pub(crate) const CONE: usize = 22;
pub(crate) const UNIT: usize = 23;
pub(crate) const DUAL: u32 = 24;

/// A triangle, in inner coordinates at the start of the shutter.
#[apply(zeroed!)]
pub(crate) struct Triangle {
    pub a: V3,
    pub b: V3,
    pub c: V3,
    /// Unit normal of the front.
    pub normal: V3,
    /// normal · corner.
    pub offset: f32,
    pub area: f32,
}

/// The plane of a triangle.
#[apply(zeroed!)]
pub(crate) struct Plane {
    pub normal: V3,
    pub offset: f32,
}

#[cfg_attr(feature = "wgpu", cube)]
impl Plane {
    /// How far a point is from it.
    #[inline(always)]
    pub fn above(&self, point: V3) -> f32 {
        self.normal.dot(point) - self.offset
    }
}

impl Triangle {
    pub fn corners(&self) -> [V3; 3] {
        [self.a, self.b, self.c]
    }
}

#[cfg_attr(feature = "wgpu", cube)]
impl Triangle {
    /// The weights of its corners in a point of its plane.
    #[inline(always)]
    pub fn weights(&self, at_rest: V3) -> V3 {
        weights_at(self.a, self.b, self.c, self.normal, self.area, at_rest)
    }

    /// ∂/∂point of the weights of the second and third corner.
    #[inline(always)]
    pub fn slopes(&self) -> Pair {
        barycentric_slopes(self.a, self.b, self.c, self.normal, self.area)
    }

    /// From derivatives by its normal and its area to those by b − a and c − a.
    #[inline(always)]
    pub fn sides_backward(&self, by_normal: V3, by_area: f32) -> Pair {
        let across = by_normal.reject_from_normalized(self.normal);
        let ab = self.b - self.a;
        let ac = self.c - self.a;
        // Lengths before they are divided by the area, which may be tiny.
        let per_area = 0.5 / self.area;
        Pair {
            first: ac.cross(across) * per_area + ac.cross(self.normal) * (0.5 * by_area),
            second: across.cross(ab) * per_area + self.normal.cross(ab) * (0.5 * by_area),
        }
    }

    #[inline(always)]
    pub fn plane(&self) -> Plane {
        Plane {
            normal: self.normal,
            offset: self.offset,
        }
    }

    /// How far a point is from its plane.
    #[inline(always)]
    pub fn above(&self, point: V3) -> f32 {
        self.plane().above(point)
    }
}

/// A triangle of a list of surfaces.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn triangle_at(surfaces: &[f32], k: u32) -> Triangle {
    let list = &surfaces[SURFACE as usize * k as usize..];
    // The last number first: then the host checks one index.
    let area = list[AREA];
    Triangle {
        a: vector(list, 0u32),
        b: vector(list, 3u32),
        c: vector(list, 6u32),
        normal: vector(list, 9u32),
        offset: list[12],
        area,
    }
}

#[cfg_attr(feature = "wgpu", cube)]
impl<'a> Scene<'a> {
    #[inline(always)]
    pub fn triangle(&self, k: u32) -> Triangle {
        triangle_at(self.surfaces, k)
    }

    /// The plane of a triangle.
    #[inline(always)]
    pub fn plane(&self, k: u32) -> Plane {
        let at = SURFACE * k + 9;
        // The last number first: then the host checks one index.
        let offset = self.surfaces[(at + 3) as usize];
        Plane {
            normal: vector(self.surfaces, at),
            offset,
        }
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

    /// The vector by which an object has moved at a time in the shutter.
    #[inline(always)]
    pub fn displacement(&self, object: u32, time: f32) -> V3 {
        let mut shift = splat(0.0);
        if comptime!(self.features.moves) {
            shift = vector(self.velocities, 3 * object) * time;
        }
        shift
    }

    /// The vector by which a triangle has moved at a time in the shutter.
    #[inline(always)]
    pub fn shift(&self, triangle: u32, time: f32) -> V3 {
        let mut shift = splat(0.0);
        if comptime!(self.features.moves) {
            shift = self.displacement(self.object_of(triangle), time);
        }
        shift
    }

    /// Whether derivatives by an object are asked for.
    #[inline(always)]
    pub fn is_wanted(&self, object: u32) -> bool {
        self.wanted_objects[object as usize] != 0
    }
}
