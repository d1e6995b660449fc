//! Which triangles rays are paired with: each ray with all, or with its own candidates.

use burn::tensor::{Bool, Int, Tensor, TensorData};

use crate::geometry::{Context, Neighbours, Vec3, gather_row};
use crate::tensors::rays::NO_TRIANGLE;

/// The triangles that may matter to a ray.
pub(crate) struct List {
    /// Upwards.
    pub triangles: Vec<u32>,
    /// Whether there is one, and nothing matters beside it.
    pub is_whole: bool,
}

/// Pairs `[K, N]` of rays and triangles: of each of N rays with all T triangles, or with up to K of its own.
#[derive(Clone, Debug)]
pub(crate) struct Pairs {
    rows: usize,
    own: Option<Own>,
}

/// Triangles of each ray.
#[derive(Clone, Debug)]
struct Own {
    /// Their numbers `[K, N]`, upwards for each ray; [`NO_TRIANGLE`] after the last of a ray.
    triangle: Vec<u32>,
    rays: usize,
    /// The same as a row `[1, K·N]`, 0 in place of none.
    index: Tensor<2, Int>,
    /// Whether there is one `[K, N]`.
    some: Tensor<2, Bool>,
    /// Whether each ray has one, which fills it.
    is_whole: bool,
}

impl Pairs {
    /// Every ray with all triangles.
    pub fn all(triangles: usize) -> Self {
        Self {
            rows: triangles,
            own: None,
        }
    }

    /// Each ray with its own triangles, whose numbers go upwards.
    pub fn own(context: &Context, lists: &[&List]) -> Self {
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
        let own = Own {
            index: context.index_row(&index),
            some: Tensor::from_data(TensorData::new(some, [rows, rays]), &context.device),
            is_whole: lists.iter().all(|l| l.is_whole),
            triangle,
            rays,
        };
        Self {
            rows,
            own: Some(own),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        let empty = |own: &Own| own.triangle.iter().all(|&k| k == NO_TRIANGLE);
        self.own.as_ref().is_some_and(empty)
    }

    /// Whether each ray has one, which fills it.
    pub fn is_whole(&self) -> bool {
        self.own.as_ref().is_some_and(|own| own.is_whole)
    }

    /// K.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// A value of all triangles `[T, 1]` or `[1, T]`, as one of pairs: `[K, N]`, or `[T, 1]` where each ray has all.
    pub fn of(&self, plane: &Tensor<2>) -> Tensor<2> {
        match &self.own {
            Some(own) => gather_row(plane.clone(), &own.index).reshape([self.rows, own.rays]),
            None => plane.clone().reshape([self.rows, 1]),
        }
    }

    pub fn vectors(&self, v: &Vec3) -> Vec3 {
        v.map(|plane| self.of(&plane))
    }

    /// The same of values without tape.
    pub fn constant(&self, context: &Context, values: &[f64]) -> Tensor<2> {
        match &self.own {
            Some(own) => {
                let of = |&k: &u32| values.get(k as usize).copied().unwrap_or(0.0);
                let values: Vec<f64> = own.triangle.iter().map(of).collect();
                context.tensor(&values, [self.rows, own.rays])
            }
            None => context.column(values),
        }
    }

    /// Whether each is a pair, of triangles that are valid or not `[T, 1]`; of one's own triangles all are.
    pub fn valid(&self, valid: &Tensor<2, Bool>) -> Tensor<2, Bool> {
        self.own.as_ref().map_or(valid, |own| &own.some).clone()
    }

    /// The triangle of a ray in a row; T past the last.
    pub fn triangle(&self, ray: usize, row: u32, triangles: u32) -> u32 {
        let of = |own: &Own| own.triangle.get(row as usize * own.rays + ray).copied();
        match &self.own {
            Some(own) => of(own).map_or(triangles, |k| k.min(triangles)),
            None => row,
        }
    }

    /// The row of a ray in which a triangle is.
    pub fn row_of(&self, ray: usize, triangle: u32) -> Option<usize> {
        match &self.own {
            Some(own) => (0..self.rows).find(|row| own.triangle[row * own.rays + ray] == triangle),
            None => Some(triangle as usize),
        }
    }

    /// The rows of a ray in which neighbours of a triangle are.
    pub fn rows_beside(
        &self,
        ray: usize,
        triangle: u32,
        neighbours: &Neighbours,
        mut f: impl FnMut(usize),
    ) {
        match &self.own {
            Some(own) => {
                let of = |row: usize| own.triangle[row * own.rays + ray];
                let is =
                    |row: &usize| of(*row) != NO_TRIANGLE && neighbours.are(of(*row), triangle);
                (0..self.rows).filter(is).for_each(f);
            }
            None => neighbours.of(triangle).for_each(|k| f(k as usize)),
        }
    }
}
