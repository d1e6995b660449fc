//! The shares of surfaces in rays that are in groups, by how many triangles matter to them.

use burn::tensor::{IndexingUpdateOp, Tensor};

use super::pairs::Pairs;
use super::weights::Weights;
use crate::error::Result;
use crate::geometry::{Context, gather_row};

/// The weights of rays in groups.
pub(crate) struct Shares {
    context: Context,
    groups: Groups<(Pairs, Weights)>,
    triangles: u32,
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
    pub fn new(context: &Context, groups: Groups<(Pairs, Weights)>, triangles: usize) -> Self {
        Self {
            context: context.clone(),
            groups,
            triangles: triangles as u32,
        }
    }

    fn join(&self, row: impl Fn(&[u32], &(Pairs, Weights)) -> Tensor<2>) -> Tensor<2> {
        self.groups.join(&self.context, row)
    }

    /// Draws surfaces of each ray with lists of random numbers in [0, 1): their triangles and weights. The number of
    /// triangles stands for the background. A surface of weight 0 is never drawn.
    pub fn draw(&self, random: &[Vec<f64>]) -> Result<Vec<Vec<(u32, f64)>>> {
        let mut found = vec![vec![(0, 0.0); self.groups.rays]; random.len()];
        for (rays, (pairs, weights)) in &self.groups.list {
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
        let tracked = |group: &(Vec<u32>, (Pairs, Weights))| group.1.1.slopes.is_some();
        self.groups.list.iter().any(tracked).then(|| {
            self.join(|rays, (pairs, weights)| {
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
        surfaces: impl Fn(&Pairs, &Weights) -> Tensor<2>,
        background: Option<&Tensor<2>>,
    ) -> Tensor<2> {
        self.join(|rays, (pairs, weights)| {
            let behind = background.map(|all| match all.dims()[1] {
                1 => all.clone(),
                _ => gather_row(all.clone(), &self.context.index_row(rays)),
            });
            weights.mean(surfaces(pairs, weights), behind)
        })
    }

    /// W of the background `[1, N]`, in the graph if a gradient can flow.
    pub fn attached_background(&self) -> Tensor<2> {
        self.join(|_, (_, weights)| weights.attached_background())
    }
}

/// Whether these are all of so many, in order.
pub(crate) fn is_identity(which: &[u32], count: usize) -> bool {
    which.len() == count && which.iter().enumerate().all(|(i, &w)| i == w as usize)
}

/// A row of some rays as a row of all, zero elsewhere.
pub(crate) fn spread(context: &Context, row: Tensor<2>, which: &[u32], count: usize) -> Tensor<2> {
    if is_identity(which, count) {
        return row;
    }
    let zeros = Tensor::<2>::zeros([1, count], (&context.device, context.dtype));
    zeros.scatter(1, context.index_row(which), row, IndexingUpdateOp::Add)
}
