//! Converts sums into the gradient of the tensors, on the device.

use std::ops::Range;

use softray_kernels::cube::*;

use super::job::Views;
use super::placed::{TensorPlaces, ViewPlaces};
use super::sums::{Places, Replicas};
use softray_kernels::host::ParameterId;
use softray_kernels::kernel::{Rows, View};
use softray_kernels::model::{V3, component, splat, v3};
use softray_kernels::trace::{
    AREAS, CAMERAS, LIGHTS, OF_CAMERA, OF_LIGHT, PARTS, Scene, TRIANGLES, VERTICES,
};

/// Number of words of a tensor in the table: its first element in the gradient, the number of threads before its own, its
/// first sum, its part, its kind, the lengths of its rows and of the rows of sums, the start of its
/// factor or matrix, and its view.
const OF_TENSOR: usize = 9;
/// Kinds of tensors: sums times a factor; the same for vertices, plus the derivatives from their triangles; a matrix
/// times sums.
const ROWS: u32 = 0;
const OF_VERTICES: u32 = 1;
const MATRIX: u32 = 2;

/// How the gradient of the views' tensors is computed from sums.
#[derive(Default)]
pub(super) struct Table {
    pub words: Vec<u32>,
    pub factors: Vec<f32>,
    /// The number of threads: one for each vertex, and for each element of other tensors.
    pub threads: usize,
    view: u32,
}

impl Table {
    /// Creates the table for all cameras, and for each scene at its first view.
    pub fn new(sums: &Places, views: &[ViewPlaces]) -> Self {
        let mut table = Self::default();
        for (v, &(view, scene, camera)) in views.iter().enumerate() {
            table.view = v as u32;
            let first = &sums.first[v];
            if sums.owns(v) {
                table.add_scene(first, view, scene);
            }
            for (id, to) in camera {
                let by = |one: &[f64]| {
                    let mut by = vec![0.0; to.len()];
                    view.write_camera(one, &[(*id, 0..to.len())], &mut by);
                    by
                };
                table.add_matrix(to, (CAMERAS, first[CAMERAS as usize]), OF_CAMERA, by);
            }
        }
        table
    }

    fn add_scene(&mut self, first: &[u32; PARTS], view: &View, scene: TensorPlaces) {
        for (id, to) in scene {
            if let ParameterId::Light(light, part) = *id {
                let own = first[LIGHTS as usize] + OF_LIGHT * light as u32;
                let by = |one: &[f64]| {
                    let own = std::array::from_fn(|k| one[k]);
                    view.scene.by_light(light, part, own).to_vec()
                };
                self.add_matrix(to, (LIGHTS, own), OF_LIGHT, by);
            } else if let Some(rows) = Rows::of(&view.scene, *id, to.len()) {
                let part = rows.part;
                let own = first[part as usize] + (rows.width * rows.first) as u32;
                let kind = if part == VERTICES { OF_VERTICES } else { ROWS };
                let lengths = [rows.length, rows.width];
                self.add(to, (part, own), kind, lengths, [rows.factor]);
            }
        }
    }

    fn add(
        &mut self,
        to: &Range<usize>,
        (part, first): (u32, u32),
        kind: u32,
        [own, of_sums]: [usize; 2],
        factors: impl IntoIterator<Item = f64>,
    ) {
        let at = self.factors.len() as u32;
        let (begin, before) = (to.start as u32, self.threads as u32);
        self.words.extend([begin, before, first, part, kind]);
        let lengths = [own as u32, of_sums as u32];
        self.words
            .extend(lengths.into_iter().chain([at, self.view]));
        self.factors.extend(factors.into_iter().map(|f| f as f32));
        self.threads += match kind {
            OF_VERTICES => to.len() / own,
            _ => to.len(),
        };
    }

    /// Adds a tensor whose gradient is the linear function `by` of some sums.
    fn add_matrix(
        &mut self,
        to: &Range<usize>,
        sums: (u32, u32),
        count: u32,
        by: impl Fn(&[f64]) -> Vec<f64>,
    ) {
        let count = count as usize;
        let column = |k: usize| {
            let mut one = vec![0.0; count];
            one[k] = 1.0;
            by(&one)
        };
        let columns: Vec<Vec<f64>> = (0..count).map(column).collect();
        let matrix = (0..to.len()).flat_map(|i| columns.iter().map(move |c| c[i]));
        self.add(to, sums, MATRIX, [to.len(), count], matrix);
    }
}

/// Returns the part of a vertex's derivative that comes from the normals and areas of its triangles.
#[cube]
fn of_triangles(
    scene: &Scene,
    sums: &mut [u32],
    replicas: &Replicas,
    scales: &[f32],
    vertex: u32,
) -> V3 {
    let mut by = splat(0.0);
    let first = scene.vertex_starts[vertex as usize];
    let past = scene.vertex_starts[vertex as usize + 1];
    for i in first..past {
        let corner = scene.vertex_corners[i as usize];
        let k = corner / 3;
        let normals = scene.first_sums[comptime!(TRIANGLES as usize)] + 3 * k;
        let by_normal = v3(
            replicas.number(sums, scales, normals, TRIANGLES),
            replicas.number(sums, scales, normals + 1, TRIANGLES),
            replicas.number(sums, scales, normals + 2, TRIANGLES),
        );
        let areas = scene.first_sums[comptime!(AREAS as usize)] + k;
        let by_area = replicas.number(sums, scales, areas, AREAS);
        let triangle = scene.triangle(k);
        let nothing = by_normal.is_zero() && by_area == 0.0;
        if triangle.area > 0.0 && !nothing {
            let sides = triangle.sides_backward(by_normal, by_area);
            let which = corner - 3 * k;
            if which == 0 {
                by -= sides.first + sides.second;
            } else if which == 1 {
                by += sides.first;
            } else {
                by += sides.second;
            }
        }
    }
    by
}

/// Adds the gradient of the views' tensors to the gradient of all tensors.
#[cube(launch)]
pub(super) fn write_gradient(
    views: Views,
    sums: &mut [u32],
    replicas: Replicas,
    scales: &[f32],
    table: &[u32],
    factors: &[f32],
    gradient: &mut [f32],
    threads: u32,
) {
    if ABSOLUTE_POS < threads as usize {
        // Find the last tensor whose threads begin at or before this one.
        let mut tensor = 0usize;
        let mut past = table.len() / OF_TENSOR;
        while past - tensor > 1 {
            let middle = (tensor + past) / 2;
            if table[middle * OF_TENSOR + 1] as usize <= ABSOLUTE_POS {
                tensor = middle;
            } else {
                past = middle;
            }
        }
        let row = tensor * OF_TENSOR;
        let i = ABSOLUTE_POS as u32 - table[row + 1];
        let scene = views.scene(table[row + 8]);
        let first = table[row + 2];
        let part = table[row + 3];
        let kind = table[row + 4];
        let own = table[row + 5];
        let of_sums = table[row + 6];
        let factor = table[row + 7];
        let begin = table[row];
        if kind == MATRIX {
            let mut value = 0.0f32;
            for k in 0..of_sums {
                let by = replicas.number(sums, scales, first + k, part);
                value += factors[(factor + i * of_sums + k) as usize] * by;
            }
            gradient[(begin + i) as usize] += value;
        } else if kind == OF_VERTICES {
            let vertices = scene.first_sums[comptime!(VERTICES as usize)];
            let vertex = (first - vertices) / 3 + i;
            let more = of_triangles(&scene, sums, &replicas, scales, vertex);
            for axis in 0..3u32 {
                let by = replicas.number(sums, scales, first + 3 * i + axis, part);
                let value = (by + component(more, axis)) * factors[factor as usize];
                gradient[(begin + 3 * i + axis) as usize] += value;
            }
        } else if i % own < of_sums {
            let sum = first + i / own * of_sums + i % own;
            let value = replicas.number(sums, scales, sum, part);
            gradient[(begin + i) as usize] += value * factors[factor as usize];
        }
    }
}
