//! The shares of surfaces in rays, which are grouped by the number of triangles that matter to them.

use burn::tensor::Tensor;

use super::coverage::PlaneHits;
use super::pairs::Pairs;
use super::weights::Weights;
use crate::error::Result;
use crate::geometry::{Context, gather_row};
use crate::scene::Flattened;
use crate::tensors::rays::{Rays, spread};

/// The number of draws of a split: every surface whose weight is at least the inverse is taken.
const SPLIT: usize = 4;

/// The weights of rays in groups.
pub(crate) struct Shares {
    context: Context,
    groups: Groups<Group>,
    triangles: u32,
}

/// A group of rays, with the weights of their surfaces.
pub(crate) struct Group {
    pub rays: Rays,
    pub pairs: Pairs,
    pub weights: Weights,
}

impl Group {
    /// Intersects the rays with the planes of their triangles.
    pub fn hits(&self, scene: &Flattened) -> PlaneHits {
        PlaneHits::new(&scene.context, &scene.triangles, &self.rays, &self.pairs)
    }

    /// Returns 1 for pairs in which the ray hits the front, else 0.
    pub fn fronts(&self, scene: &Flattened) -> Tensor<2> {
        let normal = self.pairs.vectors(&scene.triangles.normal.detached());
        let cosine = normal.dot(&self.rays.direction.detached());
        cosine.lower_elem(0.0).float().cast(scene.context.dtype)
    }
}

/// Rays in groups, with a value for each group.
pub(crate) struct Groups<T> {
    pub rays: usize,
    pub list: Vec<(Vec<u32>, T)>,
}

impl<T> Groups<T> {
    /// Joins rows `[1, n]` of the groups to one row `[1, N]` of all rays, with 0 for rays in no group.
    pub fn join(&self, context: &Context, row: impl Fn(&[u32], &T) -> Tensor<2>) -> Tensor<2> {
        let rows: Vec<_> = self
            .list
            .iter()
            .map(|(rays, group)| row(rays, group))
            .collect();
        let rays: Vec<u32> = self
            .list
            .iter()
            .flat_map(|(rays, _)| rays)
            .copied()
            .collect();
        if rows.is_empty() {
            return Tensor::zeros([1, self.rays], (&context.device, context.dtype));
        }
        spread(context, Tensor::cat(rows, 1), &rays, self.rays)
    }
}

impl Shares {
    pub fn new(context: &Context, groups: Groups<Group>, triangles: usize) -> Self {
        Self {
            context: context.clone(),
            groups,
            triangles: triangles as u32,
        }
    }

    fn join(&self, row: impl Fn(&[u32], &Group) -> Tensor<2>) -> Tensor<2> {
        self.groups.join(&self.context, row)
    }

    /// Draws surfaces of each ray with lists of random numbers in [0, 1). Returns triangles and weights. The number of
    /// triangles stands for the background. A surface of weight 0 is never drawn.
    fn draws(&self, random: &[Vec<f64>]) -> Result<Vec<Vec<(u32, f64)>>> {
        let mut found = vec![vec![(self.triangles, 1.0); self.groups.rays]; random.len()];
        for (rays, Group { pairs, weights, .. }) in &self.groups.list {
            let of = |all: &Vec<f64>| rays.iter().map(|&i| all[i as usize]).collect();
            let random: Vec<Vec<f64>> = random.iter().map(of).collect();
            let drawn = match pairs.is_whole() || pairs.is_empty() {
                true => vec![vec![(0, 1.0); rays.len()]; random.len()],
                false => weights.draw(&self.context, &random)?,
            };
            for (found, drawn) in found.iter_mut().zip(drawn) {
                for (place, (&i, (row, weight))) in rays.iter().zip(drawn).enumerate() {
                    found[i as usize] = (pairs.triangle(place, row, self.triangles), weight);
                }
            }
        }
        Ok(found)
    }

    /// Draws one surface of each ray.
    pub fn draw(&self, random: Vec<f64>) -> Result<Vec<u32>> {
        let drawn = self.draws(&[random])?;
        Ok(drawn.concat().into_iter().map(|d| d.0).collect())
    }

    /// Draws several surfaces of each ray by systematic sampling, which takes a surface with probability min(1, 4W).
    /// Returns (ray, surface, W over this probability).
    pub fn split(&self, random: &[f64]) -> Result<Vec<(u32, u32, f64)>> {
        let shifted = |m: usize| {
            let of = |u: &f64| (u + m as f64) / SPLIT as f64;
            random.iter().map(of).collect()
        };
        let draws = self.draws(&(0..SPLIT).map(shifted).collect::<Vec<_>>())?;
        let mut found = Vec::new();
        for (i, _) in random.iter().enumerate() {
            for m in (0..SPLIT).filter(|&m| m == 0 || draws[m][i].0 != draws[m - 1][i].0) {
                let (drawn, share) = draws[m][i];
                found.push((i as u32, drawn, share.max(1.0 / SPLIT as f64)));
            }
        }
        Ok(found)
    }

    /// Returns W / detach(W) of drawn surfaces (ray, triangle) as a row: 1, with the derivative of log W. Returns
    /// `None` if the weights are untracked.
    pub fn ratio(&self, drawn: impl Iterator<Item = (u32, u32)>) -> Option<Tensor<2>> {
        let groups = &self.groups.list;
        if !groups.iter().any(|g| g.1.weights.surfaces.is_tracked()) {
            return None;
        }
        let mut places = vec![(0, 0); self.groups.rays];
        for (number, (rays, _)) in groups.iter().enumerate() {
            for (place, &i) in rays.iter().enumerate() {
                places[i as usize] = (number, place);
            }
        }
        let mut of_groups = vec![(Vec::new(), Vec::new()); groups.len()];
        let mut count = 0;
        for (i, k) in drawn {
            let (number, place) = places[i as usize];
            let pairs = &groups[number].1.pairs;
            let row = pairs.row_of(place, k).unwrap_or(pairs.rows());
            of_groups[number].0.push(count);
            of_groups[number].1.push((row, place));
            count += 1;
        }
        let parts = groups
            .iter()
            .zip(&of_groups)
            .filter(|(_, of)| !of.0.is_empty());
        let ratio = |((_, group), of): (&(Vec<u32>, Group), &(_, Vec<_>))| {
            group.weights.ratio(&self.context, &of.1)
        };
        let rows: Vec<Tensor<2>> = parts.map(ratio).collect();
        let which: Vec<u32> = of_groups.into_iter().flat_map(|of| of.0).collect();
        Some(spread(
            &self.context,
            Tensor::cat(rows, 1),
            &which,
            count as usize,
        ))
    }

    /// Returns the mean Σ W_k·v_k + W_background·v as a row `[1, N]`. v is `[K, n]` or `[T, 1]` for pairs, and `[1, N]`
    /// or `[1, 1]` for the background. The mean is tracked with the weights and with v.
    pub fn mean(
        &self,
        surfaces: impl Fn(&Group) -> Tensor<2>,
        background: Option<&Tensor<2>>,
    ) -> Tensor<2> {
        self.join(|rays, group| {
            let behind = background.map(|all| match all.dims()[1] {
                1 => all.clone(),
                _ => gather_row(all.clone(), &self.context.index_row(rays)),
            });
            group.weights.mean(surfaces(group), behind)
        })
    }

    /// Returns W of the background `[1, N]`, tracked with the weights.
    pub fn background(&self) -> Tensor<2> {
        self.join(|_, group| group.weights.background.clone())
    }
}
