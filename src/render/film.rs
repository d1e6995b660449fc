//! What a render returns: radiance, and what was asked for beside it.

use burn::tensor::kind::Basic;
use burn::tensor::{Int, Tensor};

use super::Renderer;
use super::options::Outputs;
use crate::error::Result;
use crate::geometry::{Vec3, host_values, plain};
use crate::transport::{Census, Diagnostics, Hits, Radiance, RayWeights, SurfacePoints};
use crate::visibility::SparseWeights;

/// What a render cost.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Statistics {
    /// Camera, bounce and shadow rays.
    pub rays: u64,
    /// For the softmax: triangles asked, ray by ray.
    pub tested: u64,
    /// For the softmax: how many surfaces matter to a camera or bounce ray: mean, 99th percentile and
    /// most. 0 where all triangles are asked in tensors.
    pub surfaces: [f64; 3],
    /// Paths that looked for their next surface, by bounce: how many survived so far.
    pub bounces: Vec<u64>,
}

impl Statistics {
    pub(super) fn of_rays(counts: crate::kernel::RayCounts) -> Self {
        Self {
            rays: counts.rays,
            bounces: counts.bounces,
            ..Self::default()
        }
    }

    pub(super) fn new(census: &Census) -> Self {
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
        }
    }
}

/// A rendered image; tensors are in the graph where gradients can flow.
#[derive(Clone)]
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

/// Rendered images; tensors are in the graph where gradients can flow.
#[derive(Clone)]
pub struct ImageBatch {
    /// Linear RGB radiance `[B, H, W, 3]`, row 0 at the top.
    pub radiance: Tensor<4>,
    /// As [`Image::opacity`], `[B, H, W]`.
    pub opacity: Option<Tensor<3>>,
    /// As [`Image::depth`], `[B, H, W]`.
    pub depth: Option<Tensor<3>>,
    /// As [`Image::normals`], `[B, H, W, 3]`.
    pub normals: Option<Tensor<4>>,
    /// As [`Image::object_ids`], `[B, H, W]`.
    pub object_ids: Option<Tensor<3, Int>>,
    /// What each view cost.
    pub statistics: Vec<Statistics>,
    /// What was degenerate in each view; empty unless asked for.
    pub diagnostics: Vec<Diagnostics>,
}

impl ImageBatch {
    /// How many views.
    pub fn len(&self) -> usize {
        self.statistics.len()
    }

    /// Whether there is none; there is always one.
    pub fn is_empty(&self) -> bool {
        self.statistics.is_empty()
    }

    /// The image of one view. Compute a loss over all views from the tensors of the batch: each slice is
    /// another node of the graph.
    ///
    /// # Panics
    /// If there are not so many views.
    pub fn view(&self, index: usize) -> Image {
        fn one<const D: usize, const E: usize, K: Basic>(
            t: &Tensor<D, K>,
            index: usize,
        ) -> Tensor<E, K> {
            t.clone().slice([index..index + 1]).squeeze_dim(0)
        }
        Image {
            radiance: one(&self.radiance, index),
            opacity: self.opacity.as_ref().map(|t| one(t, index)),
            depth: self.depth.as_ref().map(|t| one(t, index)),
            normals: self.normals.as_ref().map(|t| one(t, index)),
            object_ids: self.object_ids.as_ref().map(|t| one(t, index)),
            statistics: self.statistics[index].clone(),
            diagnostics: self.diagnostics.get(index).cloned(),
        }
    }

    /// The only view.
    pub(super) fn single(mut self) -> Image {
        Image {
            radiance: self.radiance.squeeze_dim(0),
            opacity: self.opacity.map(|t| t.squeeze_dim(0)),
            depth: self.depth.map(|t| t.squeeze_dim(0)),
            normals: self.normals.map(|t| t.squeeze_dim(0)),
            object_ids: self.object_ids.map(|t| t.squeeze_dim(0)),
            statistics: self.statistics.swap_remove(0),
            diagnostics: self.diagnostics.pop(),
        }
    }
}

/// Means over the samples of all pixels of all views.
pub(super) struct Means {
    /// `[B, P, C]`, channels in the order of [`Renderer::outputs`].
    pub mean: Tensor<3>,
    /// Rows of weights of objects, without that of the background.
    pub objects: usize,
    pub statistics: Vec<Statistics>,
    pub diagnostics: Vec<Diagnostics>,
}

impl Means {
    /// The images of width × height pixels.
    pub fn images(self, [width, height]: [usize; 2], outputs: Outputs) -> ImageBatch {
        let [count, pixels, all] = self.mean.dims();
        let mut next = 0;
        let mut rest = Some(self.mean);
        let mut take = |channels: usize| -> Tensor<3> {
            let from = next;
            next += channels;
            // All that is left needs no copy.
            let rows = if from == 0 && next == all {
                rest.take()
            } else {
                rest.clone()
            };
            let rows = rows.expect("channels that are there");
            if channels == all {
                return rows;
            }
            rows.slice([0..count, 0..pixels, from..next])
        };
        let plane = |t: Tensor<3>| t.reshape([count, height, width]);
        let colour = |t: Tensor<3>| t.reshape([count, height, width, 3]);
        let radiance = colour(take(3));
        let opacity = (outputs.opacity || outputs.depth || outputs.normals).then(|| take(1));
        let seen = opacity.as_ref().map(|o| {
            let nothing = crate::geometry::plain(o).lower_elem(1e-12);
            (o.clone().mask_fill(nothing.clone(), 1.0), nothing)
        });
        let per_opacity = |t: Tensor<3>| match &seen {
            Some((opacity, nothing)) => {
                let shape = t.dims();
                (t / opacity.clone()).mask_fill(nothing.clone().expand(shape), 0.0)
            }
            None => t,
        };
        let depth = outputs.depth.then(|| plane(per_opacity(take(1))));
        let normals = outputs.normals.then(|| colour(per_opacity(take(3))));
        let object_ids = outputs.object_ids.then(|| {
            let index = take(self.objects + 1).inner().argmax(2);
            let background = index.clone().equal_elem(self.objects as i64);
            index
                .mask_fill(background, -1)
                .reshape([count, height, width])
        });
        ImageBatch {
            radiance,
            opacity: opacity.filter(|_| outputs.opacity).map(plane),
            depth,
            normals,
            object_ids,
            statistics: self.statistics,
            diagnostics: self.diagnostics,
        }
    }
}

impl Renderer<'_> {
    /// Rows `[_, N]`: radiance, opacity, depth, normal, weight of each object.
    pub(super) fn outputs(&self, found: Radiance) -> Result<Vec<Tensor<2>>> {
        let outputs = self.options.outputs;
        let Vec3 { x, y, z } = found.radiance;
        let mut rows = vec![x, y, z];
        let first = found.first;
        if outputs.opacity || outputs.depth || outputs.normals {
            rows.push(first.attached_background(&self.scene.context).neg() + 1.0);
        }
        let first = match first {
            RayWeights::Hits(hits) => {
                rows.extend(self.outputs_of_hits(&hits)?);
                return Ok(rows);
            }
            RayWeights::Dense(first) => first,
            RayWeights::Sparse(first) => {
                rows.extend(self.outputs_by_candidates(&first));
                return Ok(rows);
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
        Ok(rows)
    }

    /// Rows of depth, normal and object, of what rays hit.
    fn outputs_of_hits(&self, hits: &Hits) -> Result<Vec<Tensor<2>>> {
        let outputs = self.options.outputs;
        let context = &self.scene.context;
        let mut rows = Vec::new();
        if outputs.depth || outputs.normals {
            let is_hit = hits.row(context, |i| hits.is_hit(i));
            let missed = plain(&is_hit).lower_elem(0.5);
            // Where nothing is hit any triangle serves; what it gives is left out.
            let last = self.scene.triangles.len() as u32 - 1;
            let triangles = hits.triangle.iter().map(|&k| k.min(last)).collect();
            let points = SurfacePoints::new(self.scene, &hits.rays, triangles)?;
            if outputs.depth {
                let along = points.position.sub(&hits.rays.origin);
                let depth = along.dot(&hits.rays.direction) * self.scene.unit;
                rows.push(depth.mask_fill(missed.clone(), 0.0));
            }
            if outputs.normals {
                let Vec3 { x, y, z } = points.geometric_normal;
                rows.extend([x, y, z].map(|n| n.mask_fill(missed.clone(), 0.0)));
            }
        }
        if outputs.object_ids {
            let object = &self.scene.topology.object;
            for id in 0..self.objects() as u32 {
                let is = |i: usize| hits.is_hit(i) && object[hits.triangle[i] as usize] == id;
                rows.push(hits.row(context, is));
            }
            rows.push(hits.row(context, |i| !hits.is_hit(i)));
        }
        Ok(rows)
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
        self.scene.objects()
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
