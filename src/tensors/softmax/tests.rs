//! Compares the formulas with `visibility.json`: float64 values and gradients of an independent implementation.
#![cfg_attr(not(feature = "flex"), allow(dead_code))] // each backend uses a part

use std::path::PathBuf;

use burn::tensor::{DType, Device, Tensor, TensorData};
use serde_json::Value;

use super::{
    Coverage, CoverageSettings, Pairs, Softmax, Weights, coverage, transmittance, weights,
};
use crate::geometry::{Context, Neighbors, Topology, Triangles, Vec3, VertexData, host_values};
use crate::tensors::rays::Rays;

struct Case {
    name: String,
    json: Value,
    triangles: usize,
    rays: usize,
}

fn values<const D: usize>(t: &Tensor<D>) -> Vec<f64> {
    host_values(t).expect("values")
}

fn flat(v: &Value) -> Vec<f64> {
    match v {
        Value::Array(list) => list.iter().flat_map(flat).collect(),
        other => vec![other.as_f64().expect("a number")],
    }
}

fn cases() -> Vec<Case> {
    let folder = std::env::var_os("SOFTRAY_REFERENCE").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data"),
        PathBuf::from,
    );
    let text = std::fs::read_to_string(folder.join("visibility.json")).expect("visibility.json");
    let json: Value = serde_json::from_str(&text).expect("JSON");
    let list = json["cases"].as_array().expect("cases").clone();
    assert!(!list.is_empty());
    list.into_iter()
        .map(|c| Case {
            name: c["name"].as_str().expect("a name").into(),
            triangles: c["triangles"].as_array().expect("triangles").len(),
            rays: c["origins"].as_array().expect("origins").len(),
            json: c,
        })
        .collect()
}

/// The leaf tensors of a case, and values computed from them.
struct Built {
    corners: Tensor<2>,
    origins: Tensor<2>,
    directions: Tensor<2>,
    /// Untracked, since the reference has no gradients through near and far.
    still: Vec3,
    radius: f64,
    /// Coverage along the whole ray, and up to `t_max`.
    coverage: Coverage,
    cut: Coverage,
    softmax: Softmax,
}

impl Built {
    fn weights(&self) -> Weights {
        weights(&self.coverage, &self.still, self.radius, self.softmax)
    }
}

fn build(case: &Case, device: &Device, dtype: DType) -> Built {
    let context = Context {
        device: device.clone(),
        dtype,
    };
    let leaf = |field: &str, rows: usize| -> Tensor<2> {
        let data = TensorData::new(flat(&case.json[field]), [rows, 3]);
        let t = Tensor::<2>::from_data(data, (device, dtype));
        t.autodiff().require_grad()
    };
    let corners = leaf("triangles", case.triangles * 3);
    let origins = leaf("origins", case.rays);
    let directions = leaf("directions", case.rays);
    let center = context.tensor(&flat(&case.json["center"]), [1, 3]);
    let corner = |i: usize| {
        let all = (corners.clone() - center.clone()).reshape([case.triangles, 9]);
        Vec3::from_columns(all.narrow(1, 3 * i, 3))
    };
    let triangles = Triangles::new(
        &context,
        VertexData {
            a: corner(0),
            b: corner(1),
            c: corner(2),
        },
        None,
    );
    let topology = Topology {
        object: flat(&case.json["mesh"]).iter().map(|&m| m as u32).collect(),
        material: vec![0; case.triangles],
        closed: vec![false; case.triangles],
        neighbors: Neighbors::none(case.triangles),
        visible_side: vec![0.0; case.triangles],
    };
    let rays = Rays {
        origin: Vec3::from_rows((origins.clone() - center).transpose()),
        direction: Vec3::from_rows(directions.clone().transpose()),
        time: None,
        departure: None,
        arrival: None,
    };
    // No triangle is left out: the emitter is none of them, and only its distance counts.
    let t_max = context.row(&flat(&case.json["t_max"]));
    let up_to = Rays {
        arrival: Some((Vec::new(), t_max)),
        ..rays.clone()
    };
    let settings = CoverageSettings {
        sigma: case.json["sigma"].as_f64().expect("sigma"),
        t_min: 0.0,
        start: 0.0,
        arrival_margin: 0.0,
    };
    let radius = case.json["radius"].as_f64().expect("radius");
    let (scene, pairs) = ((&triangles, &topology), Pairs::with_all(case.triangles));
    Built {
        coverage: coverage(&context, scene, &rays, &pairs, &settings),
        cut: coverage(&context, scene, &up_to, &pairs, &settings),
        corners,
        origins,
        directions,
        still: rays.origin.detached(),
        radius,
        softmax: Softmax {
            sigma: settings.sigma,
            gamma: case.json["gamma"].as_f64().expect("gamma"),
            epsilon: case.json["epsilon"].as_f64().expect("epsilon"),
        },
    }
}

/// Returns the rows of planes `[T, N]` by ray, as in the file.
fn by_ray(t: &Tensor<2>) -> Vec<f64> {
    values(&t.clone().inner().transpose())
}

fn assert_close(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        assert!(
            (f - e).abs() <= tolerance,
            "{what}[{i}]: found {f}, expected {e}, tolerance {tolerance}"
        );
    }
}

fn assert_gradients(case: &Case, kind: &str, built: &Built, loss: Tensor<1>, relative: f64) {
    let gradients = loss.backward();
    for (field, leaf) in [
        ("triangles", &built.corners),
        ("origins", &built.origins),
        ("directions", &built.directions),
    ] {
        let expected = flat(&case.json[kind][field]);
        let found = leaf
            .grad(&gradients)
            .map_or(vec![0.0; expected.len()], |g| values(&g));
        let scale = expected.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        assert_close(
            &format!("{} {kind} {field}", case.name),
            &found,
            &expected,
            relative * scale.max(1.0),
        );
        if field == "triangles" {
            // Triangles that do not count have a gradient of exactly 0.
            let t = flat(&case.json["t"]);
            for k in 0..case.triangles {
                let missed = (0..case.rays).all(|i| t[i * case.triangles + k] < 0.0);
                if missed {
                    assert!(
                        found[9 * k..9 * k + 9].iter().all(|&g| g == 0.0),
                        "{} triangle {k}",
                        case.name
                    );
                }
            }
        }
    }
}

/// Checks values and gradients of every case on one device.
fn check(device: &Device, dtype: DType, value: f64, gradient: f64) {
    for case in &cases() {
        let context = Context {
            device: device.clone(),
            dtype,
        };
        let cotangent = |kind: &str, i: usize, columns: usize| {
            let all = case.json[kind]["cotangents"]
                .as_array()
                .expect("cotangents");
            context
                .tensor(&flat(&all[i]), [case.rays, columns])
                .transpose()
        };
        let close = |kind: &str, found: &Tensor<2>, expected: &Value| {
            let name = format!("{} {kind}", case.name);
            assert_close(&name, &by_ray(found), &flat(expected), value);
        };
        let built = build(case, device, dtype);
        close("p", &built.coverage.probability(), &case.json["p"]);
        let weights = built.weights();
        let expected = &case.json["softmax"];
        close("softmax", &weights.surfaces, &expected["weights"]);
        let background = weights.background.clone();
        close("softmax", &background, &expected["background"]);
        let kind = "softmax_gradient";
        let background = cotangent(kind, 1, 1);
        let loss = weights.mean(cotangent(kind, 0, case.triangles), Some(background));
        assert_gradients(case, kind, &built, loss.sum(), gradient);

        let built = build(case, device, dtype);
        let passed = transmittance(&built.cut);
        close(
            "transmittance",
            &passed,
            &case.json["product_transmittance"],
        );
        let kind = "product_transmittance_gradient";
        let loss = (passed * cotangent(kind, 0, 1)).sum();
        assert_gradients(case, kind, &built, loss, gradient);
    }
}

/// The ratio W/detach(W) of a drawn surface is 1 and carries the derivative of log W. It is compared with
/// `mean`, whose derivative of W `check` compares with the file.
fn check_ratio(device: &Device, dtype: DType, gradient: f64) {
    for case in &cases() {
        for k in 0..=case.triangles {
            check_one_ratio(case, device, dtype, k, gradient);
        }
    }
}

fn check_one_ratio(case: &Case, device: &Device, dtype: DType, k: usize, gradient: f64) {
    let context = Context {
        device: device.clone(),
        dtype,
    };
    let built = build(case, device, dtype);
    let weights = built.weights();
    // A surface that is never drawn requires no ratio.
    let weight = if k < case.triangles {
        weights.surfaces.clone().slice([k..k + 1])
    } else {
        weights.background.clone()
    };
    let possible = weight.clone().greater_elem(1e-12).float().cast(dtype);
    let drawn: Vec<(usize, usize)> = values(&possible)
        .iter()
        .enumerate()
        .map(|(i, &p)| {
            // Where it is impossible, the likeliest surface replaces it.
            let column = |t: &Tensor<2>| values(&t.clone().slice([0..t.dims()[0], i..i + 1]));
            let likeliest = || {
                let mut all = column(&weights.surfaces);
                all.extend(column(&weights.background));
                (0..all.len())
                    .max_by(|&a, &b| all[a].total_cmp(&all[b]))
                    .expect("some")
            };
            (if p > 0.0 { k } else { likeliest() }, i)
        })
        .collect();
    let ratio = weights.ratio(&context, &drawn);
    for r in values(&ratio) {
        assert!((r - 1.0).abs() < 1e-12, "{}: {r}", case.name);
    }
    // Σ W · ratio has the gradient of Σ W.
    let found = (ratio * weight.detach() * possible.clone())
        .sum()
        .backward();
    let built_again = build(case, device, dtype);
    let weights = built_again.weights();
    let whole = if k < case.triangles {
        let one_hot: Vec<f64> = (0..case.triangles)
            .map(|j| if j == k { 1.0 } else { 0.0 })
            .collect();
        weights.mean(context.column(&one_hot), None)
    } else {
        weights.background.clone()
    };
    let expected = (whole * possible).sum().backward();
    let zero = || vec![0.0; case.triangles * 9];
    let found = built.corners.grad(&found).map_or_else(zero, |g| values(&g));
    let expected = built_again
        .corners
        .grad(&expected)
        .map_or_else(zero, |g| values(&g));
    let scale = expected.iter().fold(1.0f64, |m, x| m.max(x.abs()));
    assert_close(&case.name, &found, &expected, gradient * scale);
}

#[cfg(feature = "flex")]
#[test]
fn f64_on_flex_to_1e_9() {
    check(&Device::flex(), DType::F64, 1e-9, 1e-9);
}

#[cfg(feature = "flex")]
#[test]
fn f32_on_flex() {
    check(&Device::flex(), DType::F32, 2e-4, 2e-3);
}

#[cfg(feature = "ndarray")]
#[test]
#[allow(deprecated)] // burn deprecates ndarray; the feature still supports it
fn f32_on_ndarray() {
    check(&Device::ndarray(), DType::F32, 2e-4, 2e-3);
}

#[cfg(feature = "flex")]
#[test]
fn a_drawn_weight_carries_its_gradient() {
    check_ratio(&Device::flex(), DType::F64, 1e-12);
}

#[cfg(feature = "gpu")]
#[test]
fn f32_on_a_gpu() {
    check(&crate::device::of_tests(), DType::F32, 2e-4, 2e-3);
}
