//! An optimizer whose vertex updates keep a mesh smooth.

use std::fmt;
use std::sync::Arc;

use burn::optim::{LearningRate, Optimizer, RecordState, StateSink, StateSource};
use burn::tensor::{Device, Tensor, TensorData};

use super::conjugate_gradient::Diffusion;
use super::connectivity::Connectivity;
use crate::error::{Error, Result};
use crate::geometry::{Context, host_values};
use crate::scene::Mesh;
use softray_kernels::warning;

/// The object name in error messages.
const OBJECT: &str = "large steps";

/// The settings of [`LargeSteps`].
///
/// [`LargeSteps`] has an example.
#[derive(Clone, Debug, PartialEq)]
pub struct LargeStepsConfig {
    /// λ of I + λL, at least 0. A larger value gives smoother steps; 0 leaves gradients unchanged.
    pub lambda: f64,
    /// β₁, the decay factor of the mean of gradients, in [0, 1).
    pub beta_1: f64,
    /// β₂, the decay factor of the mean of squared gradients, in [0, 1).
    pub beta_2: f64,
    /// ε, added to the square root of the largest mean of squared gradients, more than 0.
    pub epsilon: f64,
}

impl Default for LargeStepsConfig {
    /// λ = 19, β₁ = 0.9, β₂ = 0.999, ε = 1e-8.
    fn default() -> Self {
        Self {
            lambda: 19.0,
            beta_1: 0.9,
            beta_2: 0.999,
            epsilon: 1e-8,
        }
    }
}

impl LargeStepsConfig {
    /// Sets λ, ≥ 0.
    pub fn with_lambda(mut self, lambda: f64) -> Self {
        self.lambda = lambda;
        self
    }

    /// Sets λ = α/(1 − α), for α in [0, 1), since (1 − α)I + αL = (1 − α)(I + λL). The default λ corresponds to
    /// α = 0.95. A learning rate for (1 − α)I + αL is 1 − α times the equivalent learning rate for I + λL.
    pub fn with_alpha(self, alpha: f64) -> Self {
        self.with_lambda(alpha / (1.0 - alpha))
    }

    /// Sets β₁ and β₂, each in [0, 1).
    pub fn with_betas(mut self, beta_1: f64, beta_2: f64) -> Self {
        (self.beta_1, self.beta_2) = (beta_1, beta_2);
        self
    }

    /// Sets ε, > 0.
    pub fn with_epsilon(mut self, epsilon: f64) -> Self {
        self.epsilon = epsilon;
        self
    }

    fn check(&self) -> Result<()> {
        let valid = self.lambda >= 0.0 && self.lambda.is_finite();
        Error::unless(valid, OBJECT, "lambda", self.lambda, "a finite number >= 0")?;
        for (field, share) in [("beta_1", self.beta_1), ("beta_2", self.beta_2)] {
            let valid = (0.0..1.0).contains(&share);
            Error::unless(valid, OBJECT, field, share, "in [0, 1)")?;
        }
        Error::unless_positive(OBJECT, "epsilon", self.epsilon)
    }
}

/// An optimizer for the vertices `[V, 3]` of a mesh: Nicolet, Jacobson and Jakob 2021, *Large Steps in Inverse
/// Rendering of Geometry*.
///
/// The gradient of an image loss is rough: it is large on silhouettes, noisy, and 0 on surfaces that the camera
/// does not see. Steps along it tangle a mesh. This optimizer takes steps in u = (I + λL)v, where L is the
/// combinatorial Laplacian of the mesh. A step of one entry of u also moves the vertices around it. The update
/// is the paper's AdamUniform:
///
/// - gᵤ = (I + λL)⁻¹ gᵥ
/// - m ← β₁m + (1 − β₁)gᵤ,  s ← β₂s + (1 − β₂)gᵤ²
/// - d = m̂/(√max ŝ + ε), where m̂ = m/(1 − β₁ᵗ), ŝ = s/(1 − β₂ᵗ)
/// - v ← v − lr·(I + λL)⁻¹ d
///
/// The denominator uses the largest ŝ of all entries. Adam divides each entry by its own ŝ, which changes the
/// direction of m̂ and undoes the smoothing. A translation of the whole mesh is not slowed, because L of a
/// constant is 0. `lr` is about the largest distance, in scene units, that a vertex moves in a step; it can be
/// far larger than for Adam.
///
/// The matrix applies to every parameter whose first axis has length V, to each column by itself. Parameters of
/// other shapes (such as `[3]` or `[B, V, 3]`) use AdamUniform without the matrix. For a batch of meshes, build
/// one mesh of disjoint parts. Give textures and the vertices of other meshes to another optimizer with
/// `ModuleOptimizer::with_group`; [`Fit::with_rate_of`](super::Fit::with_rate_of) has an example.
///
/// # Panics
/// A step panics if a parameter has the shape `[W, 3]` of vertices, where W is more than 3 and not V; also a weight matrix
/// of this shape.
///
/// The optimizer runs on the host in f64. It solves with the matrix by conjugate gradients to a relative
/// residual of 1e-10, and logs a warning if they do not converge. It skips a step, with a warning, if the
/// gradient cannot be read or is not finite.
///
/// ```
/// use burn::module::Param;
/// use burn::optim::{GradientsParams, ModuleOptimizer};
/// use softray::optim::{LargeSteps, LargeStepsConfig};
/// use softray::prelude::*;
///
/// let mesh = shapes::icosphere(1, &Device::flex().autodiff());
/// let steps = LargeSteps::from_mesh(&mesh, &LargeStepsConfig::default())?;
/// let mut optimizer = ModuleOptimizer::from(steps);
/// let mut vertices = Param::from_tensor(mesh.vertices.clone());
/// for _ in 0..3 {
///     let loss = (vertices.val() - 1.0).powf_scalar(2.0).mean();
///     let gradients = GradientsParams::from_grads(loss.backward(), &vertices);
///     vertices = optimizer.step(0.05, vertices, gradients);
/// }
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone)]
pub struct LargeSteps {
    config: LargeStepsConfig,
    matrix: Arc<Diffusion>,
}

/// The moments of a parameter. They are stored on the host in f64, so a record holds them exactly.
///
/// The optimizer in the example of [`LargeSteps`] keeps them from step to step.
#[derive(Clone, PartialEq)]
pub struct LargeStepsState {
    /// The number of steps taken.
    time: usize,
    /// m, one number per entry of the parameter.
    moment_1: Vec<f64>,
    /// s, one number per entry of the parameter.
    moment_2: Vec<f64>,
}

impl fmt::Debug for LargeSteps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LargeSteps")
            .field("config", &self.config)
            .field("vertices", &self.matrix.rows())
            .finish()
    }
}

impl fmt::Debug for LargeStepsState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LargeStepsState")
            .field("time", &self.time)
            .field("numbers", &self.moment_1.len())
            .finish_non_exhaustive()
    }
}

impl LargeSteps {
    /// Creates an optimizer for meshes with these faces and `vertices` vertices.
    ///
    /// # Errors
    /// If no face has three different vertices, an index is out of range, or a value of the configuration is
    /// out of range.
    pub fn new(faces: &[[u32; 3]], vertices: usize, config: &LargeStepsConfig) -> Result<Self> {
        config.check()?;
        let connectivity = Connectivity::new(OBJECT, faces, vertices)?;
        let matrix = Diffusion::new(&connectivity, vertices, config.lambda);
        Ok(Self {
            config: config.clone(),
            matrix: Arc::new(matrix),
        })
    }

    /// Creates an optimizer for a mesh.
    ///
    /// # Errors
    /// Like [`LargeSteps::new`].
    pub fn from_mesh(mesh: &Mesh, config: &LargeStepsConfig) -> Result<Self> {
        Self::new(&mesh.faces, mesh.vertices.dims()[0], config)
    }

    /// Returns (I + λL)⁻¹ of each column of a tensor `[V, C]`, as a constant outside of any graph.
    ///
    /// # Errors
    /// If the first axis does not have length V, a value is not finite, or the values cannot be read from the
    /// device.
    pub fn precondition(&self, values: Tensor<2>) -> Result<Tensor<2>> {
        let [rows, columns] = values.dims();
        let expected = self.matrix.rows();
        let shape = format!("of shape [{rows}, {columns}]");
        let wanted = format!("shape [{expected}, _]");
        Error::unless(rows == expected, OBJECT, "values", shape, &wanted)?;
        let solved = self.matrix.solve(&finite(&values)?, columns);
        Ok(constant(&values, &solved))
    }

    /// Returns d, or (I + λL)⁻¹ d where the matrix applies, in row-major order, and the moments after the step.
    fn direction<const D: usize>(
        &self,
        gradient: &Tensor<D>,
        state: Option<&LargeStepsState>,
    ) -> Result<(Vec<f64>, LargeStepsState)> {
        let mut g = finite(gradient)?;
        let (n, vertices) = (g.len(), self.matrix.rows());
        let columns = match gradient.dims()[..] {
            [rows, ..] if rows == vertices => Some(n / rows),
            [rows, 3] if rows > 3 => panic!(
                "{OBJECT}: a parameter of shape [{rows}, 3], expected [{vertices}, 3]; use another optimizer for \
                 it (ModuleOptimizer::with_group)"
            ),
            _ => None,
        };
        if let Some(columns) = columns {
            g = self.matrix.solve(&g, columns);
        }
        let fresh = LargeStepsState {
            time: 0,
            moment_1: vec![0.0; n],
            moment_2: vec![0.0; n],
        };
        let mut state = match state {
            Some(s) if s.moment_1.len() == n && s.moment_2.len() == n => s.clone(),
            Some(s) => {
                let found = s.moment_1.len();
                warning!("{OBJECT}: the record has {found} entries, expected {n}; starting anew");
                fresh
            }
            None => fresh,
        };
        let scale = state.advance(&g, &self.config);
        let mut direction: Vec<f64> = state.moment_1.iter().map(|m| m * scale).collect();
        if let Some(columns) = columns {
            direction = self.matrix.solve(&direction, columns);
        }
        Ok((direction, state))
    }
}

impl LargeStepsState {
    /// Updates the moments with a gradient and returns the factor d/m.
    fn advance(&mut self, gradient: &[f64], config: &LargeStepsConfig) -> f64 {
        let (b1, b2) = (config.beta_1, config.beta_2);
        self.time += 1;
        let mut largest: f64 = 0.0;
        let moments = self.moment_1.iter_mut().zip(&mut self.moment_2);
        for ((m, s), g) in moments.zip(gradient) {
            *m = b1 * *m + (1.0 - b1) * g;
            *s = b2 * *s + (1.0 - b2) * g * g;
            largest = largest.max(*s);
        }
        let time = i32::try_from(self.time).unwrap_or(i32::MAX);
        let (correct_1, correct_2) = (1.0 - b1.powi(time), 1.0 - b2.powi(time));
        ((largest / correct_2).sqrt() + config.epsilon).recip() / correct_1
    }
}

impl Optimizer for LargeSteps {
    type State<const D: usize> = LargeStepsState;

    fn step<const D: usize>(
        &self,
        lr: LearningRate,
        tensor: Tensor<D>,
        grad: Tensor<D>,
        state: Option<Self::State<D>>,
    ) -> (Tensor<D>, Option<Self::State<D>>) {
        match self.direction(&grad, state.as_ref()) {
            Ok((direction, next)) => {
                let step: Vec<f64> = direction.iter().map(|d| lr * d).collect();
                let step = constant(&tensor, &step);
                (tensor - step, Some(next))
            }
            Err(error) => {
                warning!("{OBJECT}: a step is left out: {error}");
                (tensor, state)
            }
        }
    }

    fn to_device<const D: usize>(state: Self::State<D>, _: &Device) -> Self::State<D> {
        state
    }
}

// Written by hand, because burn's derive macro uses paths of burn's own crate.
impl RecordState for LargeStepsState {
    fn state_flatten(&self, prefix: &str, out: &mut StateSink) {
        out.push_scalar(prefix, "time", self.time.into());
        for (name, moment) in [("moment_1", &self.moment_1), ("moment_2", &self.moment_2)] {
            let data = TensorData::new(moment.clone(), [moment.len()]);
            out.push_tensor(prefix, name, data);
        }
    }

    fn state_unflatten(prefix: &str, src: &mut StateSource, _: &Device) -> Option<Self> {
        let mut moment = |name| Some(src.take_tensor(prefix, name)?.iter::<f64>().collect());
        let (moment_1, moment_2) = (moment("moment_1")?, moment("moment_2")?);
        let time = src.take_scalar(prefix, "time")?.try_into().ok()?;
        Some(Self {
            time,
            moment_1,
            moment_2,
        })
    }
}

/// Reads the values back to the host; an error if one is not finite.
fn finite<const D: usize>(values: &Tensor<D>) -> Result<Vec<f64>> {
    let host = host_values(values)?;
    match host.iter().position(|v| !v.is_finite()) {
        Some(i) => {
            let entry = format!("entry {i}");
            Err(Error::invalid(OBJECT, entry, host[i], "a finite number"))
        }
        None => Ok(host),
    }
}

/// Returns host values as a tensor with the shape, device and float type of another, outside of any graph.
fn constant<const D: usize>(like: &Tensor<D>, values: &[f64]) -> Tensor<D> {
    let context = Context {
        device: like.device().inner(),
        dtype: like.dtype(),
    };
    context.tensor(values, like.dims())
}
