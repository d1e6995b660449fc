//! What a render returns: radiance, and what was asked for beside it.

use burn::tensor::{Int, Tensor};

use super::{Found, Renderer};
use crate::error::Result;
use crate::geometry::{Vec3, host_values, plain};
use crate::transport::{Census, Diagnostics, Radiance, RayWeights};
use crate::visibility::{Sparse, SparseWeights};

/// What a render cost.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Statistics {
    /// Camera, bounce and shadow rays.
    pub rays: u64,
    /// Triangles asked, ray by ray.
    pub tested: u64,
    /// How many surfaces matter to a camera or bounce ray: mean, 99th percentile and most. 0 where
    /// all triangles are asked in tensors.
    pub surfaces: [f64; 3],
    /// Paths that looked for their next surface, by bounce: how many survived so far.
    pub bounces: Vec<u64>,
    /// Pairs of ray and triangle whose derivatives went into the graph (11 numbers each); 0 where
    /// all triangles are asked in tensors, or the render is a replay.
    pub taped_pairs: u64,
}

impl Statistics {
    pub(super) fn new(census: &Census, taped_pairs: u64) -> Self {
        let total: u64 = census.surfaces.iter().sum();
        let pairs = census.surfaces.iter().enumerate();
        let sum: u64 = pairs.clone().map(|(k, n)| k as u64 * n).sum();
        let mut below = 0;
        let percentile = pairs
            .map(|(k, n)| {
                below += n;
                (k, below)
            })
            .find(|&(_, below)| 100 * below >= 99 * total);
        let most = census.surfaces.len().saturating_sub(1);
        Self {
            rays: census.rays,
            tested: census.tested,
            surfaces: [
                sum as f64 / total.max(1) as f64,
                percentile.map_or(0.0, |(k, _)| k as f64),
                most as f64,
            ],
            bounces: census.bounces.clone(),
            taped_pairs,
        }
    }
}

/// A rendered image; tensors are in the graph where gradients can flow.
#[derive(Clone, Debug)]
pub struct Image {
    /// Linear RGB radiance `[H, W, 3]`, row 0 at the top.
    pub radiance: Tensor<3>,
    /// 1 − W_background of the camera rays `[H, W]`, on request.
    pub opacity: Option<Tensor<2>>,
    /// Expected distance along the camera rays to what they see `[H, W]`, scene units; 0 where
    /// they see nothing. On request.
    pub depth: Option<Tensor<2>>,
    /// Expected geometric normal, facing the camera, of what the camera rays see `[H, W, 3]`; 0
    /// where they see nothing. On request.
    pub normals: Option<Tensor<3>>,
    /// The object with the most weight in each pixel `[H, W]`, −1 for the background. On request;
    /// not differentiable.
    pub object_ids: Option<Tensor<2, Int>>,
    /// What it cost.
    pub statistics: Statistics,
    /// What was degenerate. On request.
    pub diagnostics: Option<Diagnostics>,
}

impl Renderer<'_> {
    /// Rows `[_, N]`: radiance, opacity, depth, normal, weight of each object.
    pub(super) fn outputs(&self, found: Radiance) -> Vec<Tensor<2>> {
        let outputs = self.options.outputs;
        let Vec3 { x, y, z } = found.radiance;
        let mut rows = vec![x, y, z];
        let first = found.first;
        if outputs.opacity || outputs.depth || outputs.normals {
            rows.push(first.attached_background().neg() + 1.0);
        }
        let first = match first {
            RayWeights::Dense(first) => first,
            RayWeights::Sparse(first) => {
                rows.extend(self.outputs_by_candidates(&first));
                return rows;
            }
        };
        if outputs.depth {
            rows.push(first.mean(first.attached_distances() * self.scene.unit, None));
        }
        if outputs.normals {
            let normal = &self.scene.triangles.normal;
            let front = first.cosine().clone().lower_elem(0.0);
            let side = front.float().cast(self.scene.context.dtype) * 2.0 - 1.0;
            for axis in [&normal.x, &normal.y, &normal.z] {
                rows.push(first.mean(side.clone() * axis.clone(), None));
            }
        }
        if outputs.object_ids {
            let object = &self.scene.topology.object;
            let objects = self.objects();
            let triangles = object.len();
            for id in 0..objects as u32 {
                let member: Vec<f64> = object
                    .iter()
                    .map(|&o| if o == id { 1.0 } else { 0.0 })
                    .collect();
                let member = self.scene.context.tensor(&member, [triangles, 1]);
                rows.push((first.surfaces.clone() * member).sum_dim(0));
            }
            rows.push(first.background);
        }
        rows
    }

    /// Rows of depth, normal and weight of each object.
    fn outputs_by_candidates(&self, first: &SparseWeights) -> Vec<Tensor<2>> {
        let outputs = self.options.outputs;
        let mut rows = Vec::new();
        if outputs.depth {
            rows.push(first.mean_distance() * self.scene.unit);
        }
        if outputs.normals {
            let normal = &self.scene.triangles.normal;
            let side = |front: bool| if front { 1.0 } else { -1.0 };
            for axis in [&normal.x, &normal.y, &normal.z] {
                let host = host_values(axis).unwrap_or_default();
                let value = |_, k: u32, front| host[k as usize] * side(front);
                let mut row = first.mean(value, |_| 0.0);
                if axis.is_tracked()
                    && let Some(turned) = first.spread(axis, |k, front| Some((k, side(front))))
                {
                    let value = plain(&turned);
                    row = row + (turned - value);
                }
                rows.push(row);
            }
        }
        if outputs.object_ids {
            let (objects, background) =
                first.by_object(&self.scene.topology.object, self.objects());
            rows.extend([objects, background]);
        }
        rows
    }

    pub(super) fn objects(&self) -> usize {
        self.scene
            .topology
            .object
            .last()
            .map_or(0, |&o| o as usize + 1)
    }

    /// The image from means `[C, H·W]` of the rows of `outputs`.
    pub(super) fn image(&self, mean: Tensor<2>, found: &Found) -> Image {
        let (width, height) = match &self.pixels {
            Some(pixels) => (pixels.len(), 1),
            None => (self.options.width, self.options.height),
        };
        let outputs = self.options.outputs;
        let mut next = 0;
        let mut take = |channels: usize| {
            let rows = mean.clone().slice([next..next + channels]);
            next += channels;
            rows
        };
        let plane = |t: Tensor<2>| t.reshape([height, width]);
        let colour = |t: Tensor<2>| t.transpose().reshape([height, width, 3]);
        let radiance = colour(take(3));
        let opacity = (outputs.opacity || outputs.depth || outputs.normals).then(|| take(1));
        let seen = opacity.as_ref().map(|o| {
            let nothing = crate::geometry::plain(o).lower_elem(1e-12);
            (o.clone().mask_fill(nothing.clone(), 1.0), nothing)
        });
        let per_opacity = |t: Tensor<2>| match &seen {
            Some((opacity, nothing)) => {
                let shape = t.dims();
                (t / opacity.clone()).mask_fill(nothing.clone().expand(shape), 0.0)
            }
            None => t,
        };
        let depth = outputs.depth.then(|| plane(per_opacity(take(1))));
        let normals = outputs.normals.then(|| colour(per_opacity(take(3))));
        let object_ids = outputs.object_ids.then(|| {
            let objects = self.objects();
            let index = take(objects + 1).inner().argmax(0);
            let background = index.clone().equal_elem(objects as i64);
            index.mask_fill(background, -1).reshape([height, width])
        });
        Image {
            radiance,
            opacity: if outputs.opacity {
                opacity.map(plane)
            } else {
                None
            },
            depth,
            normals,
            object_ids,
            statistics: Statistics::new(
                &found.census,
                self.sparse.as_ref().map_or(0, Sparse::taped),
            ),
            diagnostics: found.diagnostics.clone(),
        }
    }
}

impl Image {
    /// The mean radiance of each channel, on the host.
    ///
    /// # Errors
    /// If the tensor can't be read back.
    pub fn mean(&self) -> Result<[f64; 3]> {
        let values = host_values(&self.radiance)?;
        let n = (values.len() / 3) as f64;
        Ok(std::array::from_fn(|c| {
            values.iter().skip(c).step_by(3).sum::<f64>() / n
        }))
    }
}
