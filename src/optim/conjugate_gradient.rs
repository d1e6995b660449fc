//! Solves (I + λL)x = b on the host.

use rayon::prelude::*;

use super::connectivity::Connectivity;
use softray_kernels::warning;

/// The relative residual |b − Ax|/|b| at which the solver stops.
const TOLERANCE: f64 = 1e-10;

/// The matrix A = I + λL of a mesh, with the combinatorial Laplacian L = D − W. D has the number of neighbors
/// of each vertex on its diagonal. W has a 1 for each pair of neighbors. A is symmetric and positive definite.
/// Its eigenvalues lie between 1 and 1 + 2λ·(largest number of neighbors).
#[derive(Debug)]
pub(super) struct Diffusion {
    lambda: f64,
    /// The diagonal, 1 + λ·(number of neighbors).
    diagonal: Vec<f64>,
    /// Neighbors of vertex i: `list[starts[i]..starts[i + 1]]`.
    list: Vec<u32>,
    starts: Vec<usize>,
}

impl Diffusion {
    pub fn new(connectivity: &Connectivity, vertices: usize, lambda: f64) -> Self {
        let degrees = connectivity.degrees(vertices);
        let mut starts = vec![0; vertices + 1];
        for (i, &degree) in degrees.iter().enumerate() {
            starts[i + 1] = starts[i] + degree as usize;
        }
        let mut next = starts.clone();
        let mut list = vec![0; starts[vertices]];
        for &[i, j] in &connectivity.edges {
            for (p, q) in [(i, j), (j, i)] {
                list[next[p as usize]] = q;
                next[p as usize] += 1;
            }
        }
        Self {
            lambda,
            diagonal: degrees
                .iter()
                .map(|&d| 1.0 + lambda * f64::from(d))
                .collect(),
            list,
            starts,
        }
    }

    /// The number of rows.
    pub fn rows(&self) -> usize {
        self.diagonal.len()
    }

    /// Returns A⁻¹b for each column of `b`, `[V, C]` in row-major order.
    pub fn solve(&self, b: &[f64], columns: usize) -> Vec<f64> {
        let column = |c: usize| b.iter().skip(c).step_by(columns).copied().collect();
        let solutions: Vec<Vec<f64>> = (0..columns)
            .into_par_iter()
            .map(|c| self.solve_column(column(c)))
            .collect();
        let mut x = vec![0.0; b.len()];
        for (c, solution) in solutions.iter().enumerate() {
            let places = x.iter_mut().skip(c).step_by(columns);
            places.zip(solution).for_each(|(to, from)| *to = *from);
        }
        x
    }

    /// Conjugate gradients with the diagonal as preconditioner (Shewchuk 1994, *An Introduction to the
    /// Conjugate Gradient Method Without the Agonizing Pain*, B3). The iteration starts from x = 0, so the
    /// result depends on `b` alone.
    fn solve_column(&self, b: Vec<f64>) -> Vec<f64> {
        let n = self.rows();
        let mut x = vec![0.0; n];
        let scale = dot(&b, &b).sqrt();
        if scale == 0.0 {
            return x;
        }
        // In exact arithmetic n iterations suffice.
        let most = (4 * n + 100).min(20_000);
        let mut residual = b;
        let precondition = |r: &[f64]| -> Vec<f64> {
            let entries = r.iter().zip(&self.diagonal);
            entries.map(|(r, d)| r / d).collect()
        };
        let mut z = precondition(&residual);
        let mut direction = z.clone();
        let mut image = vec![0.0; n];
        let mut rho = dot(&residual, &z);
        let mut relative = 1.0;
        for _ in 0..most {
            self.apply(&direction, &mut image);
            let alpha = rho / dot(&direction, &image);
            for i in 0..n {
                x[i] += alpha * direction[i];
                residual[i] -= alpha * image[i];
            }
            relative = dot(&residual, &residual).sqrt() / scale;
            if relative <= TOLERANCE {
                return x;
            }
            z = precondition(&residual);
            let next = dot(&residual, &z);
            let beta = next / rho;
            rho = next;
            for i in 0..n {
                direction[i] = z[i] + beta * direction[i];
            }
        }
        warning!(
            "large steps: conjugate gradients stopped after {most} iterations at a relative residual of \
             {relative:e}, expected {TOLERANCE:e}"
        );
        x
    }

    /// y = Ax.
    fn apply(&self, x: &[f64], y: &mut [f64]) {
        for (i, y) in y.iter_mut().enumerate() {
            let around = &self.list[self.starts[i]..self.starts[i + 1]];
            let sum: f64 = around.iter().map(|&j| x[j as usize]).sum();
            *y = self.diagonal[i] * x[i] - self.lambda * sum;
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
