//! The row of all tensors that are in a graph: the only parent of the images of a batch.

use std::ops::Range;

use burn::tensor::Tensor;

use crate::geometry::detached;
use crate::render::batch::Batch;
use crate::scene::{Collect, ParameterId, visit_scene};

/// The places of tensors in the row.
pub(super) type TensorPlaces = Vec<(ParameterId, Range<usize>)>;

/// The places of a view's derivatives in the row.
#[derive(Clone, Default)]
pub(super) struct Places {
    pub scene: TensorPlaces,
    pub camera: TensorPlaces,
}

/// Rows that become one.
#[derive(Default)]
pub(super) struct Parent {
    rows: Vec<Tensor<1>>,
    size: usize,
}

impl Parent {
    /// Adds rows, and returns the place at which they begin.
    fn push(&mut self, rows: Vec<Tensor<1>>) -> usize {
        let first = self.size;
        self.size += rows.iter().map(|r| r.dims()[0]).sum::<usize>();
        self.rows.extend(rows);
        first
    }

    /// Adds the tensors that were collected, and returns their places.
    pub fn collect(&mut self, collected: Collect) -> TensorPlaces {
        let places = collected.places(self.size);
        self.push(collected.rows);
        places
    }

    /// Adds the tensors of the batch, then those of its scenes, and returns the places of each scene's.
    pub fn collect_scenes(&mut self, batch: &Batch) -> Vec<TensorPlaces> {
        let starts: Vec<Option<usize>> = batch
            .vertices
            .iter()
            .map(|v| {
                let [s, n, _] = v.values.dims();
                let tracked = v.values.is_tracked();
                tracked.then(|| self.push(vec![v.values.clone().reshape([3 * s * n])]))
            })
            .collect();
        let mut all = Vec::with_capacity(batch.scenes.len());
        for (index, scene) in batch.scenes.iter().enumerate() {
            let mut rest = scene.clone();
            let mut places = Vec::new();
            for (v, start) in batch.vertices.iter().zip(&starts) {
                let Some(i) = rest.objects.iter().position(|o| o.name == v.name) else {
                    continue;
                };
                let mesh = &mut rest.objects[i].mesh;
                mesh.vertices = detached(&mesh.vertices);
                if let Some(start) = start {
                    let length = 3 * v.values.dims()[1];
                    let begin = start + index * length;
                    places.push((ParameterId::Vertices(i), begin..begin + length));
                }
            }
            let mut collected = Collect::default();
            visit_scene(&mut rest, &mut collected);
            places.extend(self.collect(collected));
            all.push(places);
        }
        all
    }

    /// The row, if anything is in a graph.
    pub fn row(self) -> Option<Tensor<1>> {
        (!self.rows.is_empty()).then(|| Tensor::cat(self.rows, 0))
    }
}
