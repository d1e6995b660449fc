//! Gradients of every class of parameter against central differences, in both forms of visibility.

mod random_scenes;

use crate::common;
use crate::common::errors::{message, says};
use crate::common::facets::facet_cases;
use crate::common::gradients::{
    CONES, Case, Effort, SHARP, SOFTMAX, Setup, all_classes, assert_agreement, cases, check, lights,
};
use crate::common::numbers::mean_and_error;
use crate::common::scenes::{facing_down, floor, scene_file};
use crate::common::tensors::{gradient, tensor, values};
use burn::tensor::{DType, Device};
use random_scenes::{RandomScene, compare};
use softray::gradcheck::{Checked, GradCheck, Point, Verdict, gradcheck};
use softray::prelude::*;

/// Standard errors are at most 8 % of the reference, in the long tier those of the case; both agree within 3.5 of them and
/// 3 %. What stays undecided is a failure. Cases that are too noisy for the short tier are left out there.
fn agree_with_central_differences(effort: Effort, cases: Vec<Case>) {
    let device = Device::flex();
    let mut failures = Vec::new();
    for case in cases {
        let (precision, seeds) = match common::long() {
            true => (case.precision, [100, 25_000]),
            false if case.precision > 0.08 => continue,
            false => (0.08, [32, 2000]),
        };
        let row = check(&case, &device, effort, precision, seeds);
        if row.verdict != Verdict::Agrees {
            failures.push((case.name, row.verdict));
        }
    }
    assert!(failures.is_empty(), "{failures:?}");
}

#[test]
fn softmax_agrees_with_central_differences() {
    agree_with_central_differences(SOFTMAX, cases());
}

#[test]
fn cones_agree_with_central_differences() {
    agree_with_central_differences(CONES, cases());
    agree_with_central_differences(CONES, lights::crossings());
}

#[test]
fn cones_without_an_angle_agree_with_central_differences() {
    let visibility = SHARP;
    let effort = Effort {
        visibility,
        ..CONES
    };
    agree_with_central_differences(effort, cases());
    agree_with_central_differences(effort, lights::crossings());
}

/// Shadows of lights without a surface have derivatives where a blur makes them soft.
#[test]
fn lights_agree_with_central_differences() {
    agree_with_central_differences(CONES, lights::still());
    agree_with_central_differences(CONES, lights::moving());
    agree_with_central_differences(SOFTMAX, lights::still());
    let visibility = SHARP;
    let effort = Effort {
        visibility,
        ..CONES
    };
    agree_with_central_differences(effort, lights::still());
}

#[test]
fn emissive_textures_agree_with_central_differences() {
    agree_with_central_differences(CONES, lights::glowing());
}

#[test]
fn facets_agree_with_central_differences() {
    agree_with_central_differences(CONES, facet_cases());
}

/// Random scenes by `make`, of seeds from `SOFTRAY_SEED` on. In the long tier these are `count` or `SOFTRAY_SCENES`.
fn random_scenes_agree(make: fn(u64) -> RandomScene, count: u64, precision: f64, renders: u64) {
    let number = |name: &str, otherwise| {
        let given = std::env::var(name).ok();
        given.and_then(|v| v.parse().ok()).unwrap_or(otherwise)
    };
    let first: u64 = number("SOFTRAY_SEED", 0);
    let (count, precision, renders) = match common::long() {
        true => (number("SOFTRAY_SCENES", count), precision, renders),
        false => (2, 0.05, 48),
    };
    let scenes: Vec<_> = (first..first + count).map(make).collect();
    let outcome = compare(&scenes, precision, renders);
    let undecided = &outcome.undecided;
    let of = outcome.derivatives;
    println!("{} of {of} undecided: {undecided:#?}", undecided.len());
    assert!(outcome.disagree.is_empty(), "{:#?}", outcome.disagree);
}

/// None of the scenes that the long tier may draw is an error.
#[test]
fn random_scenes_have_images() {
    for seed in 0..300 {
        let drawn = RandomScene::new(seed);
        let options = drawn.options.clone().with_samples(1);
        let image = render(&drawn.scene, &drawn.camera, &options);
        let image = image.unwrap_or_else(|e| panic!("scene {seed}, {}: {e}", drawn.description));
        let values = values(&image.radiance);
        assert!(values.iter().all(|v| v.is_finite()), "scene {seed}");
    }
}

#[test]
fn random_scenes_agree_with_central_differences() {
    random_scenes_agree(RandomScene::new, 100, 0.01, 600);
}

#[test]
fn bodies_that_pass_through_each_other_agree_with_central_differences() {
    random_scenes_agree(RandomScene::of_crossing_bodies, 20, 0.007, 8000);
}

/// The same seed gives the same gradient on the other CPU backend.
#[cfg(feature = "ndarray")]
#[test]
fn the_same_on_ndarray() {
    for effort in [SOFTMAX, CONES] {
        let devices = common::cpu_devices();
        let setups: [Setup; 2] = [(&devices[1], |o| o), (&devices[0], |o| o)];
        assert_agreement(&all_classes(), setups, DType::F64, effort, |_| 1e-6);
    }
}

/// The same seed gives the same gradient by all triangles in tensors, but for what the cutoff drops.
#[test]
fn the_same_by_all_triangles() {
    let flex = Device::flex();
    let setups: [Setup; 2] = [
        (&flex, |o| {
            with_softmax(o, |softmax| softmax.with_cutoff(1e-9))
        }),
        (&flex, |o| with_softmax(o, SoftmaxOptions::with_brute_force)),
    ];
    // Ten times the cutoff; 2e-10 are left.
    assert_agreement(&all_classes(), setups, DType::F64, SOFTMAX, |_| 1e-8);
}

fn with_softmax(
    options: RenderOptions,
    change: fn(SoftmaxOptions) -> SoftmaxOptions,
) -> RenderOptions {
    let Visibility::Softmax(softmax) = options.visibility else {
        panic!("{options:?}");
    };
    options.with_visibility(change(softmax))
}

/// A floor under a sky and a lamp; the albedo of the floor, times a factor whose gradient is cut to a
/// share of the right one.
fn sunlit(point: &Point, share: f64) -> softray::Result<(Scene, Camera)> {
    let device = &point.device;
    let quad = floor(2.0, 0.0, device);
    let p = point.get("albedo")?;
    let albedo = p.clone() * share + p.detach() * (1.0 - share);
    let scene = Scene::new()
        .with_object(
            Object::new(quad.cast(point.dtype))
                .with_material(Material::diffuse(albedo.expand([3]))),
        )
        .with_environment([1.0; 3]);
    Ok((scene, Camera::look_at([0.0, 2.0, 4.0], [0.0; 3])))
}

#[test]
fn gradcheck_tells_right_from_wrong_and_from_unknown() {
    let options = RenderOptions::new(8, 8).with_samples(4).with_bounces(0);
    let settings = GradCheck::new(options, &Device::flex());
    let parameters = [Checked::new("albedo", [0.5], 0.05)];
    let verdict = |settings: &GradCheck, share| {
        let report = gradcheck(&parameters, settings, |p| sunlit(p, share)).expect("a report");
        println!("{report}");
        report.rows[0].verdict
    };
    assert_eq!(verdict(&settings, 1.0), Verdict::Agrees);
    for wrong in [0.0, 0.5, 0.9, 1.1, -1.0] {
        assert_eq!(verdict(&settings, wrong), Verdict::Disagrees, "{wrong}");
    }
    // Both ways share no noise where the edge of the floor moves: two seeds don't tell them apart.
    let hasty = settings.clone().with_precision(1e-6).with_seeds(2, 2);
    let parameters = [Checked::new("shift", [0.1], 0.05)];
    let report = gradcheck(&parameters, &hasty, |point| {
        let quad = floor(2.0, 0.0, &point.device).cast(point.dtype);
        let by = point.get("shift")? * tensor(&[1.0, 0.0, 0.0], [3], &point.device, point.dtype);
        let scene = Scene::new().with_object(Object::new(quad.translated(by)));
        let camera = Camera::look_at([0.0, 2.0, 4.0], [0.0; 3]);
        Ok((scene.with_environment([1.0; 3]), camera))
    });
    let verdict = report.expect("a report").rows[0].verdict;
    assert_eq!(verdict, Verdict::Undecided);

    let bad = [Checked::new("albedo", [0.5], 0.0)];
    let error = gradcheck(&bad, &settings, |p| sunlit(p, 1.0));
    says(message(error), ["albedo: step is 0"]);
    let other = [Checked::new("a", [0.5], 0.1)];
    let error = gradcheck(&other, &settings, |p| sunlit(p, 1.0));
    says(message(error), ["albedo", "[\"a\"]"]);
}

/// A noisy image times itself is too large by its variance, and so is its gradient: at the minimum
/// of the loss of the converged image the plain form pulls, the two-sample form does not.
#[test]
fn the_square_of_noise_biases_a_loss() {
    let device = Device::flex();
    let lamp = |radiance: Tensor<1>| {
        let light = facing_down([-0.5, 0.5], [-0.5, 0.5], 1.5, &device);
        let ground = floor(2.0, 0.0, &device);
        Scene::new()
            .with_object(Object::new(light).with_material(Material::emitter(radiance.expand([3]))))
            .with_object(Object::new(ground))
    };
    let camera = Camera::look_at([0.0, 1.0, 3.0], [0.0; 3]).with_fov_y(40.0);
    let image = |radiance: Tensor<1>, samples, seed| {
        let options = RenderOptions::new(8, 8)
            .with_samples(samples)
            .with_bounces(1)
            .with_seed(seed);
        let image = render(&lamp(radiance), &camera, &options);
        image.expect("an image").radiance
    };
    let right = Tensor::<1>::from_floats([4.0], &device);
    let target = image(right.clone(), 8192, u64::MAX);
    let leaf = || right.clone().autodiff().require_grad();
    let (mut plain, mut unbiased) = (Vec::new(), Vec::new());
    for seed in 0..200 {
        let p = leaf();
        let loss = softray::loss::mse(image(p.clone(), 2, 2 * seed), target.clone());
        let gradients = loss.backward();
        plain.push(gradient(&p, &gradients)[0]);
        let p = leaf();
        let [a, b] = [0, 1].map(|i| image(p.clone(), 2, 2 * seed + i));
        let gradients = softray::loss::mse_unbiased(a, b, target.clone()).backward();
        unbiased.push(gradient(&p, &gradients)[0]);
    }
    let (plain, error) = mean_and_error(&plain);
    assert!(plain > 10.0 * error, "{plain} ± {error}");
    let (unbiased, error) = mean_and_error(&unbiased);
    println!("plain {plain}, two samples {unbiased} ± {error}");
    assert!(unbiased.abs() < 3.5 * error, "{unbiased} ± {error}");
    assert!(unbiased.abs() < 0.1 * plain, "{unbiased}, plain {plain}");
}

/// The standard error of each side as a share of the derivative: `SOFTRAY_PRECISION`, or 0.5 %,
/// which takes some minutes.
fn cornell_precision() -> f64 {
    let given = std::env::var("SOFTRAY_PRECISION").ok();
    given.and_then(|p| p.parse().ok()).unwrap_or(0.005)
}

/// The Cornell box with every class of parameter: its light turns, moves and has a free vertex, the
/// back wall has a texture under a gloss, the camera a lens. The light hangs off the ceiling.
fn cornell_box(point: &Point, camera: Camera) -> softray::Result<(Scene, Camera)> {
    let mut scene = scene_file("cornell", &point.device).scene;
    for object in &mut scene.objects {
        object.mesh = object.mesh.clone().cast(point.dtype);
    }
    let (vertex, translation) = (point.get("vertex")?, point.get("translation")?);
    let turn = Transform::new()
        .with_axis_angle([1.0, 0.2, 0.3], point.get("rotation")? * 1f64.to_degrees());
    let velocity = point.get("velocity")?;
    let constant = |v: &[f64]| Tensor::<1>::from_data(v, (&point.device, point.dtype));
    let texel = point.get("texel")?.reshape([1, 1, 1]);
    let rest = constant(&[0.5, 0.4, 0.3, 0.2, 0.5, 0.4, 0.4, 0.3, 0.5, 0.3, 0.3, 0.3]);
    let first = constant(&[0.7, 0.6, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.5]);
    let texels = rest.reshape([2, 2, 3]) + first.reshape([2, 2, 3]) * texel;
    let emission = point.get("emission")? * constant(&[1.0, 0.8, 0.5]);
    let gloss = (point.get("specular")?.expand([3]), point.get("shininess")?);
    let wall = point.get("albedo")? * constant(&[1.0, 0.3, 0.2]);
    let one_row = |rows: usize| {
        let one: Vec<f64> = (0..rows).map(|i| if i == 0 { 1.0 } else { 0.0 }).collect();
        constant(&one).reshape([rows, 1])
    };
    let scene = scene
        .map_object("light", |o| {
            let o = o.with_material(Material::emitter(emission.clone()));
            o.with_velocity(velocity.clone()).map_mesh(|m| {
                let middle = m.vertices.clone().mean_dim(0).reshape([3]);
                let hung = constant(&[0.0, -0.8, 0.0]);
                let m = m.translated(middle.clone().neg()).transformed(&turn);
                let moved = one_row(m.vertices.dims()[0]) * vertex.clone().reshape([1, 3]);
                let vertices = m.vertices.clone() + moved;
                m.with_vertices(vertices)
                    .translated(middle + hung + translation.clone())
            })
        })?
        .map_object("back", |o| {
            let diffuse = ColorTexture::texture(texels.clone());
            o.with_material(Material::phong(diffuse, gloss.0.clone(), gloss.1.clone()))
                .map_mesh(|m| {
                    let flat: Vec<f64> = m
                        .host_vertices()
                        .expect("vertices")
                        .iter()
                        .flat_map(|v| [v[0] / 5.0, v[1] / 5.0])
                        .collect();
                    let uvs = constant(&flat).reshape([flat.len() / 2, 2]);
                    m.with_uvs(uvs)
                })
        })?
        .map_object("left", |o| o.with_material(Material::diffuse(wall.clone())))?
        .with_environment(point.get("environment")?.expand([3]));
    Ok((scene, camera))
}

/// Mean radiance, counted most about a place of the image.
fn spot(at: [f64; 2], width: f64) -> impl Fn(Tensor<3>) -> Tensor<1> + Send + Sync {
    move |image| {
        let [h, w, _] = image.dims();
        let weights: Vec<f64> = (0..h * w)
            .map(|i| {
                let y = ((i / w) as f64 + 0.5) / h as f64;
                let x = ((i % w) as f64 + 0.5) / w as f64;
                let spot = ((x - at[0]).powi(2) + (y - at[1]).powi(2)) / (width * width);
                0.2 + 0.1 * x + 2.0 * (-spot).exp()
            })
            .collect();
        let like = (&image.device().inner(), image.dtype());
        let weights = Tensor::<1>::from_data(weights.as_slice(), like).reshape([h, w, 1]);
        (image * weights).mean()
    }
}

/// Geometry, motion and camera where the light is looked at from below, materials where the box is
/// looked into: each class where it shows.
#[test]
fn the_cornell_box_in_every_class_of_parameter() {
    let long = common::long();
    let options = RenderOptions::new(12, 12)
        .with_samples(16)
        .with_bounces(1)
        .with_blur(2.865);
    let (precision, least, most) = if long {
        (cornell_precision(), 256, 1_000_000)
    } else {
        (0.08, 32, 4000)
    };
    let settings = |options: &RenderOptions, at, width| {
        GradCheck::new(options.clone(), &Device::flex())
            .with_precision(precision)
            .with_tolerance(0.01)
            .with_seeds(least, most)
            .with_objective(spot(at, width))
    };
    let shift = [0.3, 1.0, -0.4];
    let all = |environment: f64| {
        [
            Checked::new("vertex", [0.0; 3], 0.03).with_direction(shift),
            Checked::new("translation", [0.0; 3], 0.02).with_direction(shift),
            Checked::new("rotation", [0.1], 0.02),
            Checked::new("velocity", [0.2, 0.0, 0.1], 0.04).with_direction(shift),
            Checked::new("eye", [3.9, 1.0, 1.0], 0.03).with_direction([-0.2, 1.0, 0.3]),
            Checked::new("fov", [45.0], 0.5),
            Checked::new("aperture", [0.5], 0.03),
            Checked::new("focus", [2.5], 0.08),
            Checked::new("albedo", [0.3], 0.1),
            Checked::new("texel", [0.4], 0.2),
            Checked::new("specular", [0.3], 0.15),
            Checked::new("shininess", [12.0], 1.0),
            Checked::new("emission", [10.0], 2.0),
            Checked::new("environment", [environment], 0.1),
        ]
    };
    let start = std::time::Instant::now();
    let report = |looking: &str, settings: GradCheck, environment: f64| {
        let report = gradcheck(&all(environment), &settings, |point| {
            let camera = Camera::look_at(point.get("eye")?, [2.78, 5.49, 2.8])
                .with_fov_y(point.get("fov")?)
                .with_thin_lens(point.get("aperture")?, point.get("focus")?);
            let inside = Camera::look_at([2.78, 2.73, -8.0], [2.78, 2.73, 0.0]).with_fov_y(39.3);
            cornell_box(point, if looking == "up" { camera } else { inside })
        });
        let report = report.expect("a report");
        println!("{report}{:.0} s", start.elapsed().as_secs_f64());
        report.rows
    };
    let geometry = ["vertex", "translation", "rotation", "velocity"];
    let camera = ["eye", "fov", "aperture", "focus"];
    let up = settings(&options, [0.55, 0.45], 0.2).with_parameters(&[geometry, camera].concat());
    let light = ["albedo", "texel", "emission", "environment"];
    let inside = settings(&options, [0.5, 0.25], 0.3).with_parameters(&light);
    // Bounced light brings the derivative of a lobe's width much noise, and little else.
    let direct = options.clone().with_bounces(0);
    let gloss = settings(&direct, [0.5, 0.33], 0.08).with_parameters(&["specular", "shininess"]);
    let rows = [
        report("up", up, 0.2),
        report("in", inside, 0.2),
        report("in", gloss, 0.0),
    ]
    .concat();
    let report = softray::gradcheck::Report { rows };
    println!("mean relative error {:.4}", report.mean_relative_error());
    assert!(report.agrees(), "{report}");
    if long {
        let bound = cornell_precision().max(0.01);
        assert!(report.mean_relative_error() <= bound, "{report}");
    }
}
