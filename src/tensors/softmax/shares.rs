//! The shares of surfaces in rays that are in groups, by how many triangles matter to them.

use std::cell::OnceCell;

use burn::tensor::Tensor;

use super::coverage::PlaneHits;
use super::pairs::Pairs;
use super::weights::Weights;
use crate::error::Result;
use crate::geometry::{Context, gather_row};
use crate::scene::Flattened;
use crate::tensors::rays::{Rays, spread};

/// The weights of rays in groups.
pub(crate) struct Shares {
    context: Context,
    groups: Groups<Group>,
    triangles: u32,
}

/// Rays with the weights of their surfaces.
pub(crate) struct Group {
    pub rays: Rays,
    pub pairs: Pairs,
    pub weights: Weights,
    fronts: OnceCell<Tensor<2>>,
}

impl Group {
    pub fn new(rays: Rays, pairs: Pairs, weights: Weights) -> Self {
        Self {
            rays,
            pairs,
            weights,
            fronts: OnceCell::new(),
        }
    }

    /// Where the rays meet the planes of their triangles.
    pub fn hits(&self, scene: &Flattened) -> PlaneHits {
        PlaneHits::new(&scene.context, &scene.triangles, &self.rays, &self.pairs)
    }

    /// 1 for pairs in which the ray meets the front, else 0.
    pub fn fronts(&self, scene: &Flattened) -> Tensor<2> {
        let fronts = || {
            let normal = self.pairs.vectors(&scene.triangles.normal.detached());
            let cosine = normal.dot(&self.rays.direction.detached());
            cosine.lower_elem(0.0).float().cast(scene.context.dtype)
        };
        self.fronts.get_or_init(fronts).clone()
    }
}

/// Rays in groups, with something of each.
pub(crate) struct Groups<T> {
    pub rays: usize,
    pub list: Vec<(Vec<u32>, T)>,
}

impl<T> Groups<T> {
    /// Rows `[1, n]` of each group as one of all rays `[1, N]`, 0 for rays of none.
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

    /// Draws surfaces of each ray with lists of random numbers in [0, 1): their triangles and weights. The number of
    /// triangles stands for the background. A surface of weight 0 is never drawn.
    pub fn draw(&self, random: &[Vec<f64>]) -> Result<Vec<Vec<(u32, f64)>>> {
        let mut found = vec![vec![(0, 0.0); self.groups.rays]; random.len()];
        for (rays, Group { pairs, weights, .. }) in &self.groups.list {
            let of = |all: &Vec<f64>| rays.iter().map(|&i| all[i as usize]).collect();
            let random: Vec<Vec<f64>> = random.iter().map(of).collect();
            for (found, drawn) in found.iter_mut().zip(weights.draw(&self.context, &random)?) {
                for (place, (&i, (row, weight))) in rays.iter().zip(drawn).enumerate() {
                    found[i as usize] = (pairs.triangle(place, row, self.triangles), weight);
                }
            }
        }
        Ok(found)
    }

    /// W / detach(W) of the drawn surfaces `[1, N]`: 1, with the derivative of log W. None if no gradient can flow.
    pub fn ratio(&self, drawn: &[u32]) -> Option<Tensor<2>> {
        let tracked = |group: &(Vec<u32>, Group)| group.1.weights.is_tracked();
        self.groups.list.iter().any(tracked).then(|| {
            self.join(|rays, Group { pairs, weights, .. }| {
                let row = |(place, &i): (usize, &u32)| match drawn[i as usize] {
                    k if k < self.triangles => pairs.row_of(place, k),
                    _ => None,
                };
                let rows = rays.iter().enumerate().map(row);
                let rows: Vec<u32> = rows.map(|r| r.unwrap_or(pairs.rows()) as u32).collect();
                let none = || Tensor::ones_like(&weights.background);
                weights.ratio(&self.context, &rows).unwrap_or_else(none)
            })
        })
    }

    /// Σ W_k·v_k + W_background·v of a quantity of pairs `[K, n]` or `[T, 1]` and of the background `[1, N]` or `[1, 1]`: a row
    /// `[1, N]`, in the graph if a gradient can flow to the weights or to the quantity.
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

    /// W of the background `[1, N]`, in the graph if a gradient can flow.
    pub fn attached_background(&self) -> Tensor<2> {
        self.join(|_, group| group.weights.attached_background())
    }
}
