//! Soft silhouettes of grids of signed distances.

use burn::tensor::{DType, Int, Tensor, TensorData, activation};
use glam::DVec3;
use rayon::prelude::*;

use super::TetrahedralGrid;
use crate::error::{Error, Result};
use crate::geometry::{Context, host_values, host_vectors};
use crate::scene::Camera;

/// The samples of a ray in the length of a cell.
const SAMPLES: f64 = 2.0;
/// The distance, over the softness, of rays that miss the cube.
const MISSED: f64 = 30.0;

/// The corners of the cell about a point on a ray, with the weights of linear interpolation.
type Corners = [(usize, f64); 8];

impl TetrahedralGrid {
    /// Returns soft silhouettes `[V, H, W]` of grids of signed distances `[S, N, N, N]`, in their graph (not in that of the
    /// cameras): σ(−d/`softness`) for the least distance d along the ray through each pixel's middle, from 0 to 1 (Yariv et
    /// al. 2020, *Multiview Neural Surface Reconstruction by Disentangling Geometry and Appearance*, Eq. 7). Each of the V
    /// views is the index of a grid and a camera. `size` is the width and height in pixels, and `softness` a length in scene
    /// units, such as twice [`TetrahedralGrid::step`].
    ///
    /// Renders change only where the surface is. Here a pixel also changes by the distances in the middle of a body, and by
    /// those in empty space, so a fit to silhouettes opens holes and adds parts. It is smooth over the softness: use it beside
    /// the opacity of renders, and less in the end. Distances at the border count as they are, where [`TetrahedralGrid::surfaces`]
    /// takes them as outside. Distances are read back to the host once, and the rays of each view.
    ///
    /// ```
    /// use softray::modules::DMTetParamsConfig;
    /// use softray::prelude::*;
    /// let ball = DMTetParamsConfig::new(16).init(&Device::flex().autodiff())?;
    /// let views = [(0, Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]))];
    /// let distances = ball.distances.val().unsqueeze();
    /// let opacity = ball.grid().opacity(distances, &views, [9, 9], 0.1)?;
    /// let middle: Tensor<3> = opacity.slice([0..1, 4..5, 4..5]);
    /// // The middle of the ball is less inside if the pixel has to be clearer.
    /// let gradients = middle.clone().sum().backward();
    /// let change = ball.distances.val().grad(&gradients).expect("tracked").sum();
    /// assert!(middle.into_scalar::<f32>() > 0.98 && change.into_scalar::<f32>() < 0.0);
    /// # Ok::<(), softray::Error>(())
    /// ```
    ///
    /// # Errors
    /// If a camera is not valid, a view names a grid that is not there, the shape is another, there is no view, the image has no
    /// pixels, the softness is not a finite number > 0, or a tensor can't be read.
    pub fn opacity(
        &self,
        distances: Tensor<4>,
        views: &[(usize, Camera)],
        size: [usize; 2],
        softness: f64,
    ) -> Result<Tensor<3>> {
        let (object, n) = ("grid opacity", self.size());
        let [grids, sides @ ..] = distances.dims();
        let expected = format!("[S, {n}, {n}, {n}]");
        let shown = format!("{:?}", distances.dims());
        Error::unless(sides == [n; 3], object, "distances", shown, &expected)?;
        Error::unless_positive(object, "softness", softness)?;
        let [width, height] = size;
        let (pixels, shown) = (width * height, format!("{size:?}"));
        Error::unless(pixels > 0, object, "size", shown, "at least one pixel")?;
        Error::unless(!views.is_empty(), object, "views", "none", "at least one")?;
        let context = Context {
            device: distances.device().inner(),
            dtype: DType::F32,
        };
        let (values, nodes) = (host_values(&distances)?, n.pow(3));
        let mut found: Vec<Option<Corners>> = Vec::with_capacity(views.len() * pixels);
        for (grid, camera) in views {
            let expected = format!("an index below {grids}");
            Error::unless(*grid < grids, object, "grid of a view", grid, &expected)?;
            camera.check(None)?;
            let (origins, directions) = camera.pixel_rays(&context, size)?;
            let rays = host_vectors(&origins)?.into_iter();
            let rays: Vec<_> = rays.zip(host_vectors(&directions)?).collect();
            let first = grid * nodes;
            let own = &values[first..first + nodes];
            let nearest = |&(origin, along): &(DVec3, DVec3)| {
                let corners = self.least(own, origin, along)?;
                Some(corners.map(|(row, weight)| (first + row, weight)))
            };
            found.par_extend(rays.par_iter().map(nearest));
        }

        let (device, kind) = (distances.device(), (&distances.device(), distances.dtype()));
        let count = found.len();
        let missed = found.iter().map(|corners| f64::from(corners.is_none()));
        let missed = TensorData::new(missed.collect(), [count]);
        let corners = || {
            found
                .iter()
                .flat_map(|corners| corners.unwrap_or([(0, 0.0); 8]))
        };
        let rows: Vec<i32> = corners().map(|(row, _)| row as i32).collect();
        let weights = TensorData::new(corners().map(|(_, w)| w).collect::<Vec<_>>(), [count, 8]);
        let rows = Tensor::<1, Int>::from_ints(rows.as_slice(), &device);
        let own = distances
            .reshape([grids * nodes])
            .select(0, rows)
            .reshape([count, 8]);
        let least: Tensor<1> = (own * Tensor::from_data(weights, kind))
            .sum_dim(1)
            .squeeze_dim(1);
        let missed = Tensor::<1>::from_data(missed, kind) * (MISSED * softness);
        let opacity = activation::sigmoid((least + missed) / -softness);
        Ok(opacity.reshape([views.len(), height, width]))
    }

    /// The place of the least distance along a ray, or `None` if it misses the cube.
    fn least(&self, values: &[f64], origin: DVec3, along: DVec3) -> Option<Corners> {
        let half = DVec3::splat(self.side / 2.0);
        let to = [-half, half].map(|corner| (corner - origin) / along);
        // A ray in the plane of a side has 0/0, and may count as one that misses.
        let enter = to[0].min(to[1]).max_element().max(0.0);
        let leave = to[0].max(to[1]).min_element();
        let count = ((leave - enter) / self.step() * SAMPLES).ceil();
        if !(enter < leave && count.is_finite()) {
            return None;
        }
        let length = (leave - enter) / count;
        let at = |i: usize| origin + along * (enter + (i as f64 + 0.5) * length);
        let valued = (0..count as usize).map(|i| (self.value(values, at(i)), i));
        let least = valued.min_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(self.corners(at(least.1)))
    }

    /// The first corner of the cell about a point, and the point's coordinates in the cell, from 0 to 1.
    fn cell(&self, point: DVec3) -> ([u32; 3], [f64; 3]) {
        let last = self.cells as f64;
        let at = ((point + self.side / 2.0) / self.step()).clamp(DVec3::ZERO, DVec3::splat(last));
        let cell = at.floor().min(DVec3::splat(last - 1.0));
        let corner = cell.to_array().map(|x| x as u32);
        (corner, (at - cell).to_array())
    }

    /// The value at a point: the weighted sum over [`Self::corners`], by seven linear interpolations.
    fn value(&self, values: &[f64], point: DVec3) -> f64 {
        let (corner, [x, y, z]) = self.cell(point);
        let (first, n) = (self.index(corner), self.size());
        let between = |a: f64, b: f64, part: f64| a + part * (b - a);
        let edge = |at: usize| between(values[at], values[at + 1], z);
        let face = |at: usize| between(edge(at), edge(at + n), y);
        between(face(first), face(first + n * n), x)
    }

    fn corners(&self, point: DVec3) -> Corners {
        let (start, part) = self.cell(point);
        std::array::from_fn(|corner| {
            let up = [0, 1, 2].map(|axis| corner >> axis & 1);
            let weight = [0, 1, 2].map(|i| if up[i] == 1 { part[i] } else { 1.0 - part[i] });
            let node = [0, 1, 2].map(|i| start[i] + up[i] as u32);
            (self.index(node), weight.iter().product())
        })
    }
}
