//! Sums turned into the gradient of the tensors that they are of: `Sums::resolve` and `Sums::write` of
//! `kernel/gradient` in a kernel of a GPU.

use std::ops::Range;

use burn::cubecl::{self, prelude::*};

use super::layout::{FIRST_SUMS, HEADER, SURFACE_STRIDE, SURFACES, VERTEX_CORNERS, VERTEX_STARTS};
use super::reading::vector;
use super::sum_places::Places;
use super::sums::{
    AREAS, CAMERA, COLOURS, LIGHTS, MATERIALS, NORMALS, OF_CAMERA, OF_LIGHT, SKY, TANGENTS, TEXELS,
    TRIANGLES, UVS, VELOCITIES, VERTICES, component, sum_at,
};
use crate::kernel::{CameraSums, DeltaSums, Part, Rows, View};
use crate::model::{V3, splat, v3};
use crate::scene::{LightPart, ParameterId};

/// The places of a view's tensors in a gradient.
pub(crate) type TensorPlaces<'a> = &'a [(ParameterId, Range<usize>)];

/// A view, and the places of its scene's and camera's tensors.
pub(crate) type ViewPlaces<'a> = (&'a View, TensorPlaces<'a>, TensorPlaces<'a>);

/// Words of a tensor: its first number in the gradient, how many it has, its first sum, its part, how it follows from
/// sums, numbers of a row of it and of a row of sums, and where its factor or its matrix begins.
const OF_TENSOR: usize = 8;
/// Sums times a factor; the same of vertices, which triangles move with; a matrix times sums.
const ROWS: u32 = 0;
const OF_VERTICES: u32 = 1;
const MATRIX: u32 = 2;

/// A part's number, and the numbers of a row of it.
fn part_of(part: Part) -> (usize, usize) {
    match part {
        Part::Vertices => (VERTICES, 3),
        Part::Velocities => (VELOCITIES, 3),
        Part::Uvs => (UVS, 2),
        Part::Normals => (NORMALS, 3),
        Part::Colours => (COLOURS, 3),
        Part::Tangents => (TANGENTS, 3),
        Part::Materials => (MATERIALS, 3),
        Part::Texels => (TEXELS, 3),
        Part::Sky => (SKY, 3),
    }
}

/// How the gradient of a view's tensors follows from sums.
pub(super) struct Table {
    pub words: Vec<u32>,
    pub factors: Vec<f32>,
    /// The numbers of all tensors.
    pub numbers: usize,
}

impl Table {
    /// Of the camera, and of the scene if the view is the first one of it.
    pub fn new(
        sums: &Places,
        v: usize,
        view: &View,
        scene: TensorPlaces,
        camera: TensorPlaces,
    ) -> Self {
        let mut table = Self {
            words: Vec::new(),
            factors: Vec::new(),
            numbers: 0,
        };
        let first = &sums.first[v];
        for (id, to) in scene.iter().filter(|_| sums.owns(v)) {
            if let ParameterId::Light(light, part) = *id {
                let own = first[LIGHTS] + (OF_LIGHT * light) as u32;
                table.add_light(view, (light, part), to, own);
            } else if let Some(rows) = Rows::of(&view.scene, *id, to.len()) {
                let (part, of_sums) = part_of(rows.part);
                let own = first[part] + (of_sums * rows.first) as u32;
                let kind = if part == VERTICES { OF_VERTICES } else { ROWS };
                let lengths = [rows.length, of_sums];
                table.add(to, (part, own), kind, lengths, [rows.factor]);
            }
        }
        table.add_camera(view, camera, first[CAMERA]);
        table
    }

    fn add(
        &mut self,
        to: &Range<usize>,
        (part, first): (usize, u32),
        kind: u32,
        [own, of_sums]: [usize; 2],
        factors: impl IntoIterator<Item = f64>,
    ) {
        let at = self.factors.len() as u32;
        let (begin, count) = (to.start as u32, to.len() as u32);
        self.words.extend([begin, count, first, part as u32]);
        self.words.extend([kind, own as u32, of_sums as u32, at]);
        self.factors.extend(factors.into_iter().map(|f| f as f32));
        self.numbers += to.len();
    }

    fn add_light(
        &mut self,
        view: &View,
        (light, part): (usize, LightPart),
        to: &Range<usize>,
        first: u32,
    ) {
        let column = |k: usize| {
            let mut by = vec![0.0; to.len()];
            let one = DeltaSums::of(|j| f64::from(u8::from(j == k)));
            one.write(&view.scene, light, part, &mut by);
            by
        };
        let columns: Vec<Vec<f64>> = (0..OF_LIGHT).map(column).collect();
        let matrix = (0..to.len()).flat_map(|i| columns.iter().map(move |c| c[i]));
        self.add(to, (LIGHTS, first), MATRIX, [to.len(), OF_LIGHT], matrix);
    }

    fn add_camera(&mut self, view: &View, places: TensorPlaces, first: u32) {
        // As if they were alone.
        let mut size = 0;
        let alone = places.iter().map(|(id, to)| {
            size += to.len();
            (*id, size - to.len()..size)
        });
        let alone: Vec<(ParameterId, Range<usize>)> = alone.collect();
        let column = |k: usize| {
            let mut by = vec![0.0; size];
            let one = CameraSums::of(|j| f64::from(u8::from(j == k)));
            view.write_camera(&one, &alone, &mut by);
            by
        };
        let columns: Vec<Vec<f64>> = (0..OF_CAMERA).map(column).collect();
        for ((_, to), (_, own)) in places.iter().zip(&alone) {
            let matrix = own.clone().flat_map(|i| columns.iter().map(move |c| c[i]));
            self.add(to, (CAMERA, first), MATRIX, [to.len(), OF_CAMERA], matrix);
        }
    }
}

#[cube]
fn vector_at(sums: &[u32], scales: &[f32], at: u32, #[comptime] part: u32) -> V3 {
    v3(
        sum_at(sums, scales, at, part),
        sum_at(sums, scales, at + 1, part),
        sum_at(sums, scales, at + 2, part),
    )
}

/// The part of a vertex's derivative that comes from the normals and areas of its triangles.
#[cube]
fn of_triangles(
    header: &[u32],
    floats: &[f32],
    words: &[u32],
    sums: &[u32],
    scales: &[f32],
    vertex: u32,
) -> V3 {
    let mut by = splat(0.0);
    let starts = (header[VERTEX_STARTS] + vertex) as usize;
    let mut i = words[starts];
    while i < words[starts + 1] {
        let corner = words[(header[VERTEX_CORNERS] + i) as usize];
        let k = corner / 3;
        let normals = header[FIRST_SUMS + TRIANGLES] + 3 * k;
        let by_normal = vector_at(sums, scales, normals, comptime!(TRIANGLES as u32));
        let areas = header[FIRST_SUMS + AREAS] + k;
        let by_area = sum_at(sums, scales, areas, comptime!(AREAS as u32));
        let at = header[SURFACES] + SURFACE_STRIDE as u32 * k;
        let area = floats[at as usize + 13];
        let nothing = by_normal.is_zero() && by_area == 0.0;
        if area > 0.0 && !nothing {
            let a = vector(floats, at);
            let ab = vector(floats, at + 3) - a;
            let ac = vector(floats, at + 6) - a;
            let normal = vector(floats, at + 9);
            let across = by_normal.reject_from_normalized(normal);
            let by_cross = across * (0.5 / area) + normal * (0.5 * by_area);
            let by_ab = ac.cross(by_cross);
            let by_ac = by_cross.cross(ab);
            let which = corner - 3 * k;
            if which == 0 {
                by -= by_ab + by_ac;
            } else if which == 1 {
                by += by_ab;
            } else {
                by += by_ac;
            }
        }
        i += 1;
    }
    by
}

/// Adds the gradient of a view's tensors to that of all, one thread a number.
#[cube(launch)]
pub(super) fn write_gradient(
    floats: &[f32],
    words: &[u32],
    sums: &[u32],
    scales: &[f32],
    table: &[u32],
    factors: &[f32],
    gradient: &mut [f32],
    view: u32,
    numbers: u32,
) {
    if ABSOLUTE_POS < numbers as usize {
        let header = &words[view as usize * HEADER..];
        let mut row = 0usize;
        let mut i = ABSOLUTE_POS as u32;
        while i >= table[row + 1] {
            i -= table[row + 1];
            row += OF_TENSOR;
        }
        let first = table[row + 2];
        let part = table[row + 3];
        let kind = table[row + 4];
        let own = table[row + 5];
        let of_sums = table[row + 6];
        let factor = table[row + 7];
        let mut value = 0.0f32;
        if kind == MATRIX {
            let mut k = 0u32;
            while k < of_sums {
                let by = sum_at(sums, scales, first + k, part);
                value += factors[(factor + i * of_sums + k) as usize] * by;
                k += 1;
            }
        } else {
            let column = i % own;
            let from = i / own;
            if column < of_sums {
                value = sum_at(sums, scales, first + from * of_sums + column, part);
            }
            if kind == OF_VERTICES {
                let vertex = (first - header[FIRST_SUMS + VERTICES]) / 3 + from;
                let more = of_triangles(header, floats, words, sums, scales, vertex);
                value += component(more, column);
            }
            value *= factors[factor as usize];
        }
        gradient[(table[row] + i) as usize] += value;
    }
}
