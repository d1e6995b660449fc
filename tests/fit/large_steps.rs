//! Large steps: the solve, the rule by hand, what they do to a mesh, and records.

use crate::common;
use crate::common::errors::{message, says};
use crate::common::numbers::{largest, noise, norm};
use crate::common::{cpu_devices, values};
use burn::module::Param;
use burn::optim::{AdamConfig, GradientsParams, ModuleOptimizer, OptimizerRecord};
use burn::tensor::DType;
use softray::optim::{LargeSteps, LargeStepsConfig, MeshRegularizer};
use softray::prelude::*;

fn tensor(values: &[f64], columns: usize, device: &Device, dtype: DType) -> Tensor<2> {
    let shape = [values.len() / columns, columns];
    common::tensors::tensor(values, shape, device, dtype)
}

/// I + λL by plain loops.
fn matrix(mesh: &Mesh, lambda: f64) -> Vec<Vec<f64>> {
    let n = mesh.vertices.dims()[0];
    let mut a = vec![vec![0.0; n]; n];
    for f in mesh.faces.iter() {
        for i in 0..3 {
            let (p, q) = (f[i] as usize, f[(i + 1) % 3] as usize);
            (a[p][q], a[q][p]) = (-lambda, -lambda);
        }
    }
    for (i, row) in a.iter_mut().enumerate() {
        row[i] = 1.0 - row.iter().sum::<f64>();
    }
    a
}

/// Gaussian elimination of a symmetric positive definite system.
fn dense_solve(mut a: Vec<Vec<f64>>, b: &[f64]) -> Vec<f64> {
    let (n, mut x) = (b.len(), b.to_vec());
    for i in 0..n {
        let (above, below) = a.split_at_mut(i + 1);
        let pivot = &above[i];
        for (j, row) in below.iter_mut().enumerate() {
            let factor = row[i] / pivot[i];
            row.iter_mut()
                .zip(pivot)
                .for_each(|(r, p)| *r -= factor * p);
            x[i + 1 + j] -= factor * x[i];
        }
    }
    for i in (0..n).rev() {
        let known: f64 = (i + 1..n).map(|k| a[i][k] * x[k]).sum();
        x[i] = (x[i] - known) / a[i][i];
    }
    x
}

/// A parameter: burn's optimizers take those of a device with autodiff.
fn leaf(values: Tensor<2>) -> Param<Tensor<2>> {
    Param::from_tensor(values.autodiff())
}

/// A step of one optimizer on a parameter with a given gradient.
fn step(
    optimizer: &mut ModuleOptimizer,
    parameter: Param<Tensor<2>>,
    lr: f64,
    gradient: Tensor<2>,
) -> Param<Tensor<2>> {
    let mut gradients = GradientsParams::new();
    gradients.register(parameter.id, gradient);
    optimizer.step(lr, parameter, gradients)
}

#[test]
fn the_solve_is_that_of_the_dense_matrix() {
    for device in cpu_devices() {
        let open = shapes::plane_grid(1.0, 1.0, 5, 4, &device);
        for mesh in [shapes::icosphere(1, &device), open] {
            let n = mesh.vertices.dims()[0];
            for lambda in [0.0, 1.0, 19.0, 1000.0] {
                let config = LargeStepsConfig::default().with_lambda(lambda);
                let steps = LargeSteps::from_mesh(&mesh, &config).expect("a mesh");
                let b = noise(3 * n, 7);
                let x = steps.precondition(tensor(&b, 3, &device, DType::F64));
                let x = values(&x.expect("a solution"));
                for c in 0..3 {
                    let column = |v: &[f64]| v.iter().skip(c).step_by(3).copied().collect();
                    let (b, x): (Vec<f64>, Vec<f64>) = (column(&b), column(&x));
                    let expected = dense_solve(matrix(&mesh, lambda), &b);
                    let apart = largest(x.iter().zip(&expected).map(|(p, q)| p - q));
                    // The error is at most the residual over the least eigenvalue, 1.
                    assert!(apart < 1.01e-10 * norm(&b), "λ = {lambda}: {apart:e}");
                }
            }
        }
    }
}

#[test]
fn alpha_is_lambda_by_another_name() {
    let config = LargeStepsConfig::default().with_alpha(0.95);
    assert!((config.lambda - 19.0).abs() < 1e-12);
}

/// Three steps against the formulas, in f64.
#[test]
fn the_rule_by_hand() {
    let device = Device::flex();
    let mesh = shapes::icosahedron(&device);
    let (n, lr) = (36, 0.1);
    let config = LargeStepsConfig::default().with_betas(0.8, 0.95);
    let steps = LargeSteps::from_mesh(&mesh, &config).expect("a mesh");
    let mut optimizer = ModuleOptimizer::from(steps);
    let start = noise(n, 1);
    let mut parameter = leaf(tensor(&start, 3, &device, DType::F64));

    let solve = |b: &[f64]| {
        let mut x = vec![0.0; n];
        for c in 0..3 {
            let b: Vec<f64> = b.iter().skip(c).step_by(3).copied().collect();
            let column = dense_solve(matrix(&mesh, 19.0), &b);
            column
                .iter()
                .enumerate()
                .for_each(|(i, v)| x[3 * i + c] = *v);
        }
        x
    };
    let (mut v, mut m, mut s) = (start, vec![0.0; n], vec![0.0; n]);
    for t in 1..=3 {
        let gradient = noise(n, 10 + t as u64);
        let g = solve(&gradient);
        for i in 0..n {
            m[i] = 0.8 * m[i] + 0.2 * g[i];
            s[i] = 0.95 * s[i] + 0.05 * g[i] * g[i];
        }
        let most = largest(s.iter().copied()) / (1.0 - 0.95f64.powi(t));
        let d = m
            .iter()
            .map(|m| m / (1.0 - 0.8f64.powi(t)) / (most.sqrt() + 1e-8));
        let d = solve(&d.collect::<Vec<_>>());
        v.iter_mut().zip(d).for_each(|(v, d)| *v -= lr * d);
        let gradient = tensor(&gradient, 3, &device, DType::F64);
        parameter = step(&mut optimizer, parameter, lr, gradient);
        let found = values(&parameter.val());
        let apart = largest(found.iter().zip(&v).map(|(p, q)| p - q));
        assert!(apart < 1e-9, "step {t}: {apart:e}");
    }
}

/// L of a constant is 0: a mesh moves as a whole by `lr`.
#[test]
fn translations_are_not_slowed() {
    let device = Device::flex();
    let mesh = shapes::icosphere(2, &device);
    let steps = LargeSteps::from_mesh(&mesh, &LargeStepsConfig::default()).expect("a mesh");
    let mut optimizer = ModuleOptimizer::from(steps);
    let before = values(&mesh.vertices);
    let along = before
        .iter()
        .enumerate()
        .map(|(i, _)| if i % 3 == 0 { -5.0 } else { 0.0 });
    let gradient = tensor(&along.collect::<Vec<_>>(), 3, &device, DType::F32);
    let moved = step(&mut optimizer, leaf(mesh.vertices), 0.3, gradient);
    for (i, (after, before)) in values(&moved.val()).iter().zip(before).enumerate() {
        let expected = if i % 3 == 0 { 0.3 } else { 0.0 };
        assert!(
            (after - before - expected).abs() < 1e-6,
            "{i}: {after} {before}"
        );
    }
}

/// Other parameters take AdamUniform: the first step of the entry with the largest gradient is `lr`,
/// and others' are less in proportion.
#[test]
fn other_shapes_take_adam_uniform() {
    let device = Device::flex();
    let mesh = shapes::icosahedron(&device);
    let steps = LargeSteps::from_mesh(&mesh, &LargeStepsConfig::default()).expect("a mesh");
    let mut optimizer = ModuleOptimizer::from(steps);
    let parameter = leaf(tensor(&[0.0; 4], 2, &device, DType::F64));
    let gradient = tensor(&[4.0, -2.0, 1.0, 0.0], 2, &device, DType::F64);
    let found = values(&step(&mut optimizer, parameter, 0.5, gradient).val());
    for (found, expected) in found.iter().zip([-0.5, 0.25, -0.125, 0.0]) {
        assert!((found - expected).abs() < 1e-8, "{found} {expected}");
    }
}

#[test]
#[should_panic(expected = "of shape [5, 3], expected [12, 3]")]
fn vertices_of_another_mesh_are_refused() {
    let device = Device::flex();
    let mesh = shapes::icosahedron(&device);
    let steps = LargeSteps::from_mesh(&mesh, &LargeStepsConfig::default()).expect("a mesh");
    let rows = || tensor(&[0.0; 15], 3, &device, DType::F64);
    step(&mut ModuleOptimizer::from(steps), leaf(rows()), 0.5, rows());
}

/// What an image does to a mesh: noisy gradients at every seventh vertex. Both optimizers go on
/// until those vertices are as near to the target.
#[test]
fn descent_stays_smooth() {
    let device = Device::flex();
    let mesh = shapes::icosphere(3, &device);
    let n = mesh.vertices.dims()[0];
    let regular = MeshRegularizer::from_mesh(&mesh).expect("a mesh");
    let energy = |v: &Tensor<2>| values(&regular.laplacian(v.clone().inner().unsqueeze()))[0];
    let start = values(&mesh.vertices);
    let axes = [1.5, 1.0, 0.7];
    let target: Vec<f64> = start
        .iter()
        .enumerate()
        .map(|(i, v)| v * axes[i % 3])
        .collect();
    let seen: Vec<f64> = (0..3 * n).map(|i| f64::from((i / 3) % 7 == 0)).collect();
    let fit = |v: &[f64]| {
        let squares = (0..3 * n).map(|i| seen[i] * (v[i] - target[i]).powi(2));
        squares.sum::<f64>() / seen.iter().sum::<f64>()
    };
    let run = |mut optimizer: ModuleOptimizer, lr: f64| {
        let mut parameter = leaf(mesh.vertices.clone());
        for i in 0..2000 {
            let v = values(&parameter.val());
            if fit(&v) < 1e-3 {
                return (i, energy(&parameter.val()), v);
            }
            let noise = noise(3 * n, i);
            let gradient: Vec<f64> = (0..3 * n)
                .map(|i| seen[i] * (v[i] - target[i] + 0.1 * noise[i]))
                .collect();
            let gradient = tensor(&gradient, 3, &device, DType::F32);
            parameter = step(&mut optimizer, parameter, lr, gradient);
        }
        panic!("no fit: {}", fit(&values(&parameter.val())));
    };
    let config = LargeStepsConfig::default();
    let steps = LargeSteps::from_mesh(&mesh, &config).expect("a mesh");
    let (steps_taken, large, v) = run(steps.into(), 0.05);
    let (adam_steps, adam, w) = run(AdamConfig::new().init(), 0.01);
    let smooth = energy(&tensor(&target, 3, &device, DType::F32));
    let unseen = |v: &[f64]| {
        let squares = (0..3 * n).map(|i| (v[i] - target[i]).powi(2));
        (squares.sum::<f64>() / (3 * n) as f64).sqrt()
    };
    println!(
        "large steps: {steps_taken} steps, energy {large:e}, off by {:.4}; Adam: {adam_steps} steps, \
         energy {adam:e}, off by {:.4}; target {smooth:e}",
        unseen(&v),
        unseen(&w),
    );
    assert!(large < 0.1 * adam, "{large:e} {adam:e}");
    assert!(unseen(&v) < 0.5 * unseen(&w));
}

/// Saved after some steps and loaded in a fresh optimizer, a fit goes on as if undisturbed.
#[test]
fn a_record_holds_all() {
    for device in cpu_devices() {
        for dtype in [DType::F32, DType::F64] {
            let mesh = shapes::icosphere(1, &device);
            let n = 3 * mesh.vertices.dims()[0];
            let fresh = || {
                let steps = LargeSteps::from_mesh(&mesh, &LargeStepsConfig::default());
                ModuleOptimizer::from(steps.expect("a mesh"))
            };
            let gradient = |i| tensor(&noise(n, i), 3, &device, dtype);
            let mut optimizer = fresh();
            let mut parameter = leaf(mesh.vertices.clone().cast(dtype));
            for i in 0..3 {
                parameter = step(&mut optimizer, parameter, 0.02, gradient(i));
            }
            let bytes = optimizer.to_record().into_bytes().expect("bytes");
            let record = OptimizerRecord::from_bytes(bytes).expect("a record");
            let loaded = [optimizer.to_record(), record].map(|r| fresh().load_record(r));
            let go_on = |mut optimizer: ModuleOptimizer| {
                let mut parameter = parameter.clone();
                for i in 3..6 {
                    parameter = step(&mut optimizer, parameter, 0.02, gradient(i));
                }
                values(&parameter.val())
            };
            let expected = go_on(optimizer);
            for optimizer in loaded {
                assert_eq!(go_on(optimizer), expected, "{device:?} {dtype:?}");
            }
            assert_ne!(go_on(fresh()), expected, "the state matters");
        }
    }
}

#[test]
fn a_gradient_that_is_not_finite_changes_nothing() {
    let device = Device::flex();
    let mesh = shapes::icosahedron(&device);
    let steps = LargeSteps::from_mesh(&mesh, &LargeStepsConfig::default()).expect("a mesh");
    let mut optimizer = ModuleOptimizer::from(steps.clone());
    let parameter = leaf(mesh.vertices.clone());
    let first = step(&mut optimizer, parameter, 0.1, mesh.vertices.clone());
    let (before, mut twin) = (values(&first.val()), optimizer.clone());
    let bad = mesh.vertices.clone() * f32::NAN;
    let after = step(&mut optimizer, first.clone(), 0.1, bad.clone());
    assert_eq!(values(&after.val()), before);
    let next = step(&mut optimizer, after, 0.1, mesh.vertices.clone());
    let expected = step(&mut twin, first, 0.1, mesh.vertices.clone());
    assert_eq!(values(&next.val()), values(&expected.val()));
    assert!(steps.precondition(bad).is_err());
}

#[test]
fn errors_name_the_field_and_the_value() {
    let device = Device::flex();
    let mesh = shapes::icosahedron(&device);
    let config = LargeStepsConfig::default;
    let cases = [
        (config().with_lambda(-1.0), "lambda is -1, expected"),
        (config().with_lambda(f64::NAN), "lambda is NaN, expected"),
        (config().with_alpha(1.0), "lambda is inf, expected"),
        (config().with_betas(1.0, 0.9), "beta_1 is 1, expected"),
        (config().with_betas(0.9, -0.1), "beta_2 is -0.1, expected"),
        (config().with_epsilon(0.0), "epsilon is 0, expected"),
    ];
    for (config, expected) in cases {
        says(message(LargeSteps::from_mesh(&mesh, &config)), [expected]);
    }
    let error = LargeSteps::new(&[[0, 1, 5]], 3, &config());
    says(message(error), ["face 0 is [0, 1, 5]"]);
    let steps = LargeSteps::from_mesh(&mesh, &config()).expect("a mesh");
    let error = steps.precondition(tensor(&[0.0; 6], 3, &device, DType::F32));
    says(message(error), ["of shape [2, 3], expected shape [12, _]"]);
}
