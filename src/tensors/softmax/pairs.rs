//! The pairs of rays and triangles: each ray with all triangles, or with its own candidates.

use burn::tensor::{Bool, Int, Tensor, TensorData};

use crate::geometry::{Context, Neighbors, Vec3, gather_row};
use crate::tensors::rays::NO_TRIANGLE;

/// The triangles that may matter to a ray.
pub(crate) struct List {
    /// In ascending order.
    pub triangles: Vec<u32>,
    /// Whether there is one triangle, and it covers the whole ray.
    pub is_whole: bool,
}

/// Pairs `[K, N]` of rays and triangles: each of N rays with all T triangles, or with up to K of its own.
#[derive(Clone, Debug)]
pub(crate) struct Pairs {
    rows: usize,
    lists: Option<CandidateLists>,
}

/// The triangles of each ray.
#[derive(Clone, Debug)]
struct CandidateLists {
    /// Triangle indices `[K, N]`, ascending for each ray, with [`NO_TRIANGLE`] after the last one.
    triangle: Vec<u32>,
    rays: usize,
    /// The same as a row `[1, K·N]`, with 0 instead of [`NO_TRIANGLE`].
    index: Tensor<2, Int>,
    /// Whether an element `[K, N]` is a triangle.
    some: Tensor<2, Bool>,
    /// Whether each ray has one triangle, which covers the whole ray.
    is_whole: bool,
}

impl Pairs {
    /// Pairs every ray with all triangles.
    pub fn with_all(triangles: usize) -> Self {
        Self {
            rows: triangles,
            lists: None,
        }
    }

    /// Pairs each ray with its own triangles, whose indices are in ascending order.
    pub fn with_candidates(context: &Context, lists: &[&List]) -> Self {
        let rays = lists.len();
        let rows = lists
            .iter()
            .map(|l| l.triangles.len())
            .max()
            .unwrap_or(0)
            .max(1);
        let mut triangle = vec![NO_TRIANGLE; rows * rays];
        for (i, list) in lists.iter().enumerate() {
            for (row, &k) in list.triangles.iter().enumerate() {
                triangle[row * rays + i] = k;
            }
        }
        let some: Vec<bool> = triangle.iter().map(|&k| k != NO_TRIANGLE).collect();
        let index: Vec<u32> = triangle
            .iter()
            .map(|&k| if k == NO_TRIANGLE { 0 } else { k })
            .collect();
        let lists = CandidateLists {
            index: context.index_row(&index),
            some: Tensor::from_data(TensorData::new(some, [rows, rays]), &context.device),
            is_whole: lists.iter().all(|l| l.is_whole),
            triangle,
            rays,
        };
        Self {
            rows,
            lists: Some(lists),
        }
    }

    /// Returns whether there are no pairs.
    pub fn is_empty(&self) -> bool {
        let empty = |lists: &CandidateLists| lists.triangle.iter().all(|&k| k == NO_TRIANGLE);
        self.lists.as_ref().is_some_and(empty)
    }

    /// Returns whether each ray has one triangle, which covers the whole ray.
    pub fn is_whole(&self) -> bool {
        self.lists.as_ref().is_some_and(|lists| lists.is_whole)
    }

    /// Returns K.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Gathers a value of all triangles `[T, 1]` or `[1, T]` for the pairs: `[K, N]`, or `[T, 1]` if each ray has all.
    pub fn of(&self, plane: &Tensor<2>) -> Tensor<2> {
        match &self.lists {
            Some(lists) => gather_row(plane.clone(), &lists.index).reshape([self.rows, lists.rays]),
            None => plane.clone().reshape([self.rows, 1]),
        }
    }

    pub fn vectors(&self, v: &Vec3) -> Vec3 {
        v.map(|plane| self.of(&plane))
    }

    /// Gathers untracked values in the same way.
    pub fn constant(&self, context: &Context, values: &[f64]) -> Tensor<2> {
        match &self.lists {
            Some(lists) => {
                let of = |&k: &u32| values.get(k as usize).copied().unwrap_or(0.0);
                let values: Vec<f64> = lists.triangle.iter().map(of).collect();
                context.tensor(&values, [self.rows, lists.rays])
            }
            None => context.column(values),
        }
    }

    /// Returns which elements are pairs with a valid triangle. `valid` is `[T, 1]`. A ray's own triangles are all
    /// valid.
    pub fn valid(&self, valid: &Tensor<2, Bool>) -> Tensor<2, Bool> {
        self.lists
            .as_ref()
            .map_or(valid, |lists| &lists.some)
            .clone()
    }

    /// Returns the triangle of a ray in a row, or T past the last one.
    pub fn triangle(&self, ray: usize, row: u32, triangles: u32) -> u32 {
        let of =
            |lists: &CandidateLists| lists.triangle.get(row as usize * lists.rays + ray).copied();
        match &self.lists {
            Some(lists) => of(lists).map_or(triangles, |k| k.min(triangles)),
            None => row,
        }
    }

    /// Returns the row of a ray that contains a triangle.
    pub fn row_of(&self, ray: usize, triangle: u32) -> Option<usize> {
        match &self.lists {
            Some(lists) => {
                (0..self.rows).find(|row| lists.triangle[row * lists.rays + ray] == triangle)
            }
            None => Some(triangle as usize),
        }
    }

    /// Visits the rows of a ray that contain neighbors of a triangle.
    pub fn rows_beside(
        &self,
        ray: usize,
        triangle: u32,
        neighbors: &Neighbors,
        mut f: impl FnMut(usize),
    ) {
        match &self.lists {
            Some(lists) => {
                let of = |row: usize| lists.triangle[row * lists.rays + ray];
                let is = |row: &usize| of(*row) != NO_TRIANGLE && neighbors.are(of(*row), triangle);
                (0..self.rows).filter(is).for_each(f);
            }
            None => neighbors.of(triangle).for_each(|k| f(k as usize)),
        }
    }
}
