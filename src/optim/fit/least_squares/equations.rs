//! The normal equations of a step, and their solution with damping.

/// The normal equations (H + λ·D)·δ = −g of noisy residuals.
///
/// Products of two quantities with independent noise have no bias. So H = ½·(AᵀB + BᵀA) and g = ½·(Aᵀs + Bᵀr) for the
/// Jacobians A and B and the residuals r and s of two renders with different seeds. H may have negative eigenvalues because
/// of noise; D = ½·diag(AᵀA + BᵀB) has none.
pub(super) struct Equations {
    /// Rows of the symmetric matrix H.
    matrix: Vec<Vec<f64>>,
    /// The diagonal of D.
    scale: Vec<f64>,
    pub gradient: Vec<f64>,
    /// r·s, the loss.
    pub loss: f64,
    /// The square of the standard error of the loss. It is too large where the loss is far above its noise.
    pub variance: f64,
}

/// The damping with which the fall of the loss is predicted, and the damping that makes any matrix positive definite.
const LEAST_DAMPING: f64 = 0.01;
const MAX_DAMPING: f64 = 1e6;

/// The residuals of a render and their derivatives with respect to each number.
pub(super) struct Linear {
    pub residuals: Vec<f64>,
    pub by_number: Vec<Vec<f64>>,
}

impl Equations {
    pub fn new(a: &Linear, b: &Linear) -> Self {
        let count = a.by_number.len();
        let entry = |i: usize, j: usize| {
            0.5 * (dot(&a.by_number[i], &b.by_number[j]) + dot(&b.by_number[i], &a.by_number[j]))
        };
        let square = |v: &Vec<f64>| dot(v, v);
        let pairs = || a.by_number.iter().zip(&b.by_number);
        Self {
            matrix: (0..count)
                .map(|i| (0..count).map(|j| entry(i, j)).collect())
                .collect(),
            scale: pairs()
                .map(|(a, b)| 0.5 * (square(a) + square(b)))
                .collect(),
            gradient: pairs()
                .map(|(by_a, by_b)| 0.5 * (dot(by_a, &b.residuals) + dot(by_b, &a.residuals)))
                .collect(),
            loss: dot(&a.residuals, &b.residuals),
            variance: {
                let products = a.residuals.iter().zip(&b.residuals);
                products.map(|(r, s)| (r * s).powi(2)).sum()
            },
        }
    }

    /// Returns the equations of no residuals.
    pub fn zero(numbers: usize) -> Self {
        Self {
            matrix: vec![vec![0.0; numbers]; numbers],
            scale: vec![0.0; numbers],
            gradient: vec![0.0; numbers],
            loss: 0.0,
            variance: 0.0,
        }
    }

    /// Adds the equations of other residuals by the same numbers.
    pub fn add(&mut self, other: &Self) {
        for (own, other) in self.matrix.iter_mut().zip(&other.matrix) {
            add(own, other);
        }
        add(&mut self.scale, &other.scale);
        add(&mut self.gradient, &other.gradient);
        self.loss += other.loss;
        self.variance += other.variance;
    }

    /// Returns which numbers have no influence on the residuals.
    pub fn unused(&self) -> impl Iterator<Item = usize> {
        let scale = self.scale.iter().enumerate();
        scale.filter(|(_, s)| **s == 0.0).map(|(i, _)| i)
    }

    /// Returns by how much a step with little damping would reduce the loss if the residuals were linear.
    pub fn decrease(&self) -> f64 {
        -dot(&self.gradient, &self.step_of_least_damping().1)
    }

    /// Returns a small damping and its step. The damping is as large as noise requires: larger where H has negative
    /// eigenvalues.
    pub fn step_of_least_damping(&self) -> (f64, Vec<f64>) {
        let mut damping = LEAST_DAMPING;
        loop {
            if let Some(step) = self.step(damping) {
                return (damping, step);
            }
            if damping > MAX_DAMPING {
                return (damping, vec![0.0; self.gradient.len()]);
            }
            damping *= 10.0;
        }
    }

    /// Returns the step for a damping λ, or `None` if H + λ·D is not positive definite. Numbers without influence do not
    /// change.
    pub fn step(&self, damping: f64) -> Option<Vec<f64>> {
        let mut matrix = self.matrix.clone();
        for (i, row) in matrix.iter_mut().enumerate() {
            row[i] += match self.scale[i] {
                0.0 => 1.0,
                scale => damping * scale,
            };
        }
        let step = solve(matrix, &self.gradient)?;
        Some(step.into_iter().map(|x| -x).collect())
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn add(to: &mut [f64], from: &[f64]) {
    to.iter_mut().zip(from).for_each(|(a, b)| *a += b);
}

/// Solves A·x = b by Cholesky's factorization. `None` if A is not positive definite.
fn solve(mut matrix: Vec<Vec<f64>>, right: &[f64]) -> Option<Vec<f64>> {
    let count = right.len();
    // The lower triangle becomes the factor L of A = L·Lᵀ.
    for i in 0..count {
        for j in 0..=i {
            let rest = matrix[i][j] - dot(&matrix[i][..j], &matrix[j][..j]);
            if i == j {
                // Rounding may leave a tiny number where the exact one is 0.
                let least = 1e-12 * matrix[i][i].abs();
                if rest.is_nan() || rest <= least {
                    return None;
                }
                matrix[i][i] = rest.sqrt();
            } else {
                matrix[i][j] = rest / matrix[j][j];
            }
        }
    }
    let mut x = right.to_vec();
    for i in 0..count {
        x[i] = (x[i] - dot(&matrix[i][..i], &x[..i])) / matrix[i][i];
    }
    for i in (0..count).rev() {
        let later: f64 = (i + 1..count).map(|j| matrix[j][i] * x[j]).sum();
        x[i] = (x[i] - later) / matrix[i][i];
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Without noise a step of a linear problem without damping ends at its solution.
    #[test]
    fn a_linear_problem_takes_one_step() {
        let by_number = vec![vec![1.0, 2.0, 0.5], vec![-1.0, 0.5, 3.0], vec![0.0; 3]];
        let at = [0.7, -0.3];
        let residuals = (0..3).map(|k| at[0] * by_number[0][k] + at[1] * by_number[1][k]);
        let linear = Linear {
            residuals: residuals.collect(),
            by_number,
        };
        let equations = Equations::new(&linear, &linear);
        let step = equations.step(0.0).expect("a step");
        assert!((step[0] + at[0]).abs() < 1e-12 && (step[1] + at[1]).abs() < 1e-12);
        assert_eq!(
            (step[2], equations.unused().collect::<Vec<_>>()),
            (0.0, vec![2])
        );
        // Damping shortens it.
        let short = equations.step(1.0).expect("a step");
        assert!(short[0].abs() < step[0].abs());
    }

    /// The mean of H over noise is the matrix without noise, whose eigenvalues are positive.
    #[test]
    fn noise_does_not_bias_the_matrix() {
        let exact = [1.0, -2.0, 0.5, 1.5];
        let mut state = 1u64;
        let mut noise = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1);
            (state >> 40) as f64 / f64::from(1 << 24) - 0.5
        };
        let mut noisy = || Linear {
            residuals: vec![0.0; 4],
            by_number: vec![exact.iter().map(|x| x + 4.0 * noise()).collect()],
        };
        let runs = 20_000;
        let mut sum = 0.0;
        for _ in 0..runs {
            sum += Equations::new(&noisy(), &noisy()).matrix[0][0];
        }
        let (mean, exact) = (sum / f64::from(runs), dot(&exact, &exact));
        assert!((mean - exact).abs() < 0.02 * exact, "{mean} {exact}");
    }
}
