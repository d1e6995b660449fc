//! Tangents of the sums of derivatives, for forward mode: the transpose of the map from sums to the gradients of tensors.

use std::ops::Range;

use super::gradient::{HostSums, Rows};
use super::view::View;
use crate::host::ParameterId;
use crate::model::{V3, v3};
use crate::trace::{
    AREAS, CAMERAS, LIGHTS, OF_CAMERA, OF_LIGHT, Seen, SumTangents, TRIANGLES, VERTICES,
};

type Places = [(ParameterId, Range<usize>)];

impl View {
    /// Returns the tangents of the sums for directions of the row of all tensors: `rows` has one number for each entry of
    /// the row and direction.
    pub fn tangents(
        &self,
        (scene, camera): (&Places, &Places),
        rows: &[Vec<f64>],
        channels: Vec<Seen>,
    ) -> (HostSums, SumTangents) {
        let sums = HostSums::new(&self.scene, &self.wanted);
        let mut tangents = SumTangents {
            directions: rows.len(),
            values: vec![0.0; sums.count() * rows.len()],
            channels,
        };
        let mut own = vec![0.0; sums.count()];
        for (direction, row) in rows.iter().enumerate() {
            own.fill(0.0);
            self.of_tensors(&sums, scene, row, &mut own);
            self.of_triangles(&sums, &mut own);
            self.of_camera(&sums, camera, row, &mut own);
            let to = tangents.values.iter_mut().skip(direction);
            to.step_by(rows.len())
                .zip(&own)
                .for_each(|(to, own)| *to = *own);
        }
        (sums, tangents)
    }

    /// The transpose of [`HostSums::write`].
    fn of_tensors(&self, sums: &HostSums, places: &Places, row: &[f64], own: &mut [f64]) {
        for (id, range) in places {
            let from = &row[range.clone()];
            if let ParameterId::Light(i, part) = *id {
                let of_light = OF_LIGHT as usize;
                let to = &mut own[sums.range(LIGHTS)][of_light * i..][..of_light];
                for (k, to) in to.iter_mut().enumerate() {
                    let by =
                        self.scene
                            .by_light(i, part, std::array::from_fn(|j| f64::from(j == k)));
                    *to += dot(&by, from);
                }
            } else if let Some(rows) = Rows::of(&self.scene, *id, from.len()) {
                let to = own[sums.range(rows.part)].get_mut(rows.width * rows.first..);
                let to = to.unwrap_or_default().chunks_exact_mut(rows.width);
                for (to, from) in to.zip(from.chunks_exact(rows.length)) {
                    to.iter_mut()
                        .zip(from)
                        .for_each(|(to, t)| *to += t * rows.factor);
                }
            }
        }
    }

    /// The transpose of [`HostSums::resolve`].
    fn of_triangles(&self, sums: &HostSums, own: &mut [f64]) {
        let vector = |own: &[f64], k: u32| {
            let at = sums.range(VERTICES).start + 3 * k as usize;
            v3(own[at] as f32, own[at + 1] as f32, own[at + 2] as f32)
        };
        for k in 0..sums.range(AREAS).len() {
            let tri = self.scene.triangle(k as u32);
            if tri.area <= 0.0 {
                continue;
            }
            let [a, b, c] = self.scene.lists.vertex_rows[k].map(|row| vector(own, row));
            let (first, second) = (b - a, c - a);
            let along = |normal: V3, area: f32| {
                let by = tri.sides_backward(normal, area);
                f64::from(by.first.dot(first) + by.second.dot(second))
            };
            let axes = [v3(1.0, 0.0, 0.0), v3(0.0, 1.0, 0.0), v3(0.0, 0.0, 1.0)];
            let normal = axes.map(|axis| along(axis, 0.0));
            own[sums.range(TRIANGLES)][3 * k..][..3].copy_from_slice(&normal);
            own[sums.range(AREAS).start + k] = along(V3::ZERO, 1.0);
        }
    }

    /// The transpose of [`View::write_camera`].
    fn of_camera(&self, sums: &HostSums, places: &Places, row: &[f64], own: &mut [f64]) {
        if places.is_empty() {
            return;
        }
        let mut all = vec![0.0; row.len()];
        for (k, to) in own[sums.range(CAMERAS)].iter_mut().enumerate() {
            let mut unit = [0.0; OF_CAMERA as usize];
            unit[k] = 1.0;
            self.write_camera(&unit, places, &mut all);
            for (_, range) in places {
                *to += dot(&all[range.clone()], &row[range.clone()]);
                all[range.clone()].fill(0.0);
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
