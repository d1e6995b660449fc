//! The parts of fits to photographs: the loss, exposures, and the network of surfaces.

use crate::common::errors::{message, says};
use crate::common::tensors::values;
use burn::optim::{AdamConfig, GradientsParams};
use softray::loss::PhotographLoss;
use softray::modules::{ExposureParamsConfig, SurfaceNetworkConfig};
use softray::optim::Comparison;
use softray::photographs::{Photograph, PhotographOptions, Photographs, Region};
use softray::prelude::*;

/// Two pixels of one color, beside each other.
fn photograph(color: f32, mask: [f32; 2]) -> Photograph {
    let set = Photographs::open("tests/data/photographs").expect("the set");
    let options = PhotographOptions::new().with_longest_side(2);
    let loaded = set.load(&[0], &options).expect("a photograph");
    let mut photograph = loaded.photographs[0].clone();
    photograph.camera.size = [2, 1];
    photograph.color = HostImage::new(2, 1, vec![color; 6]).expect("an image");
    photograph.mask = mask.to_vec();
    photograph.weight = vec![1.0; 2];
    photograph
}

/// An image of two pixels.
fn image(radiance: Tensor<4>, opacity: [f32; 2]) -> ImageBatch {
    let device = radiance.device();
    let scene = Scene::new().with_object(Object::new(shapes::cube(&device)));
    let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]);
    let batch = Batch::new(vec![scene], vec![camera]).expect("a batch");
    let options = RenderOptions::new(2, 1).with_bounces(0).with_opacity();
    let mut image = render_batch(&batch, &options).expect("an image");
    image.radiance = radiance;
    image.opacity = Some(Tensor::from_floats([[opacity]], &device));
    image
}

/// Radiance of one value.
fn gray(value: f32, device: &Device) -> Tensor<4> {
    Tensor::full([1, 1, 2, 3], value, device)
}

/// The sRGB curve without its offset, and its slope.
fn curve(value: f64) -> [f64; 2] {
    let root = value.powf(1.0 / 2.4) * 1.055;
    [root, root / value / 2.4]
}

/// The errors are those of one render, and the derivatives those of the other. An error counts as it looks.
#[test]
fn errors_of_photographs_come_from_one_render_and_derivatives_from_the_other() {
    let device = Device::flex().autodiff();
    let shown = photograph(0.25, [1.0, 1.0]);
    let loss = PhotographLoss::new(&[&shown], &device).expect("a loss");
    let tracked = gray(0.7, &device).require_grad();
    let factors = Tensor::<2>::ones([1, 3], &device).require_grad();
    let errors = image(gray(0.3, &device), [1.0, 1.0]);
    let derived = image(tracked.clone(), [1.0, 1.0]);
    let found = loss
        .forward(&errors, &derived, Some(factors.clone()))
        .expect("errors");

    let [seen, slope] = curve(0.3);
    let error = seen - curve(0.25)[0];
    let root = (1.0 + error.powi(2)).sqrt();
    let expected = 2.0 * (root - 1.0);
    let value = values(&found.color)[0];
    assert!((value - expected).abs() < 1e-5, "{value} {expected}");
    assert!(
        (found.psnr + 20.0 * error.log10()).abs() < 1e-3,
        "{}",
        found.psnr
    );
    assert!(values(&found.silhouette)[0].abs() < 1e-6);
    let gradients = found.color.backward();
    let by_value = 2.0 * error * slope / root / 6.0;
    for by in values(&tracked.grad(&gradients).expect("a gradient")) {
        assert!((by - by_value).abs() < 1e-6, "{by} {by_value}");
    }
    // Each factor is that of two pixels, whose radiance is that of the tracked render.
    for by in values(&factors.grad(&gradients).expect("a gradient")) {
        assert!((by - 2.0 * 0.7 * by_value).abs() < 1e-6, "{by}");
    }
}

/// Colors count where mask and render show the object alone, and a clipped value says "at least".
#[test]
fn borders_and_brighter_renders_of_clipped_values_are_no_errors() {
    let device = Device::flex();
    let compare = |photograph: &Photograph, pixels: [f32; 2], opacity: [f32; 2]| {
        let loss = PhotographLoss::new(&[photograph], &device).expect("a loss");
        let radiance = Tensor::from_floats([[pixels.map(|v| [v; 3])]], &device);
        let seen = image(radiance, opacity);
        let found = loss.forward(&seen, &seen, None).expect("errors");
        [values(&found.color)[0], values(&found.silhouette)[0]]
    };
    let color = |photograph: &Photograph, value: f32, opacity: [f32; 2]| {
        compare(photograph, [value; 2], opacity)
    };
    let whole = color(&photograph(0.25, [1.0, 1.0]), 0.5, [1.0, 1.0])[0];
    let shown = photograph(0.25, [1.0, 0.5]);
    let [border, silhouette] = compare(&shown, [0.5, 5.0], [1.0, 1.0]);
    assert!((border - whole).abs() < 1e-6, "{border} {whole}");
    assert!((silhouette - 0.25 / 1.5).abs() < 1e-6, "{silhouette}");
    // Where the photograph shows nothing, the mask says nothing.
    let mut beyond = photograph(0.25, [1.0, 0.0]);
    beyond.weight[1] = 0.0;
    let [hidden, silhouette] = compare(&beyond, [0.5, 5.0], [1.0, 1.0]);
    assert!((hidden - whole).abs() < 1e-6, "{hidden} {whole}");
    assert!(silhouette.abs() < 1e-6, "{silhouette}");
    assert_eq!(
        color(&photograph(0.25, [1.0, 1.0]), 0.5, [0.5, 0.5])[0],
        0.0
    );
    assert_eq!(color(&photograph(1.0, [1.0, 1.0]), 3.0, [1.0, 1.0])[0], 0.0);
    assert!(color(&photograph(1.0, [1.0, 1.0]), 0.5, [1.0, 1.0])[0] > 0.01);
}

/// Below a linear value of 0.02 the sRGB curve is its tangent, also for the values below 0 that a render may have.
#[test]
fn dark_errors_are_linear() {
    let device = Device::flex().autodiff();
    let shown = photograph(0.0, [1.0, 1.0]);
    let loss = PhotographLoss::new(&[&shown], &device).expect("a loss");
    let slope = curve(0.02)[1];
    for value in [-0.01, 0.01, 0.02] {
        let tracked = gray(value, &device).require_grad();
        let seen = image(tracked.clone(), [1.0, 1.0]);
        let found = loss.forward(&seen, &seen, None).expect("errors");
        let error = f64::from(value) * slope;
        let psnr = -20.0 * error.abs().log10();
        assert!((found.psnr - psnr).abs() < 1e-3, "{} {psnr}", found.psnr);
        let by_value = 2.0 * error * slope / (1.0 + error.powi(2)).sqrt() / 6.0;
        let gradients = found.color.backward();
        for by in values(&tracked.grad(&gradients).expect("a gradient")) {
            assert!((by / by_value - 1.0).abs() < 1e-3, "{by} {by_value}");
        }
    }
}

#[test]
fn silhouettes_have_the_derivative_of_their_square() {
    let device = Device::flex().autodiff();
    let shown = photograph(0.25, [1.0, 0.5]);
    let loss = PhotographLoss::new(&[&shown], &device).expect("a loss");
    let errors = image(gray(0.3, &device), [0.75, 1.0]);
    let mut derived = image(gray(0.3, &device), [0.0, 0.0]);
    let opacity = derived.opacity.take().expect("one").require_grad();
    derived.opacity = Some(opacity.clone());
    let found = loss.forward(&errors, &derived, None).expect("errors");
    let gradients = found.silhouette.backward();
    let found = values(&opacity.grad(&gradients).expect("a gradient"));
    for (by, expected) in found.iter().zip([-0.5 / 1.5, 1.0 / 1.5]) {
        assert!((by - expected).abs() < 1e-6, "{found:?}");
    }
}

#[test]
fn smoothness_is_that_of_both_axes() {
    let map = Tensor::<3>::from_floats([[[0.0], [2.0]], [[1.0], [5.0]]], &Device::flex());
    let found = loss::smoothness(map).expect("a loss");
    assert_eq!(values(&found), [15.0]);
    let empty = Tensor::<3>::zeros([0, 5, 3], &Device::flex());
    says(message(loss::smoothness(empty).map(|_| ())), ["smoothness"]);
}

#[test]
fn photographs_of_other_sizes_and_renders_without_opacity_are_errors() {
    let device = Device::flex();
    let shown = photograph(0.25, [1.0, 1.0]);
    let error = message(PhotographLoss::new(&[], &device).map(|_| ()));
    says(&error, ["photographs", "0", "at least one"]);
    let empty = photograph(0.25, [0.0, 0.5]);
    let error = message(PhotographLoss::new(&[&empty], &device).map(|_| ()));
    says(&error, ["photographs", "masks", "empty"]);
    let loss = PhotographLoss::new(&[&shown], &device).expect("a loss");
    let mut seen = image(gray(0.5, &device), [1.0, 1.0]);
    let factors = Tensor::<2>::ones([2, 3], &device);
    let error = message(loss.forward(&seen, &seen, Some(factors)).map(|_| ()));
    says(&error, ["photographs", "shape", "[2, 3]", "[1, 3]"]);
    seen.opacity = None;
    let error = message(loss.forward(&seen, &seen, None).map(|_| ()));
    says(&error, ["photographs", "opacity", "none"]);
}

/// A factor of all photographs is not theirs.
#[test]
fn exposures_have_a_product_of_one() {
    let device = Device::flex().autodiff();
    let mut exposure = ExposureParamsConfig::new(3)
        .init(&device)
        .expect("exposures");
    let logs =
        Tensor::<2>::from_floats([[0.5, 0.1, 0.0], [0.5, 0.2, 1.0], [0.5, 0.3, 2.0]], &device);
    exposure.log_factors = exposure.log_factors.map(|_| logs.clone().require_grad());
    let found = values(&exposure.factors(&[2, 0]).expect("factors"));
    let expected = [0.0, 0.1, 1.0, 0.0, -0.1, -1.0].map(f64::exp);
    let near = found
        .iter()
        .zip(expected)
        .all(|(a, b)| (a - b).abs() < 1e-5);
    assert!(near, "{found:?} {expected:?}");
    let error = message(exposure.factors(&[0, 3]).map(|_| ()));
    says(&error, ["exposure", "view", "3", "less than 3"]);
    let error = message(ExposureParamsConfig::new(0).init(&device).map(|_| ()));
    says(&error, ["exposure", "count", "at least one"]);
}

/// What a network is taught of a few points of gold and paint, it knows of others of these colors.
#[test]
fn surfaces_of_a_color_are_learned_together() {
    let device = Device::flex().autodiff();
    let mut network = SurfaceNetworkConfig::new()
        .init(&device)
        .expect("a network");
    // Colors of gold and of a blue paint in turn, at places all over the ball.
    let points = |from: usize, count: usize| {
        let numbers = from..from + count;
        let color = |i: usize| {
            if i.is_multiple_of(2) {
                [1.0, 0.75, 0.3]
            } else {
                [0.05, 0.2, 0.3]
            }
        };
        let place = |i: usize| [0, 1, 2].map(|k| (i as f32 * 1.7 + k as f32 * 2.1).sin() * 0.6);
        let flat = |rows: Vec<[f32; 3]>| {
            Tensor::<1>::from_floats(rows.concat().as_slice(), &device).reshape([count, 3])
        };
        (
            flat(numbers.clone().map(color).collect()),
            flat(numbers.map(place).collect()),
        )
    };
    let (colors, places) = points(0, 24);
    let start = network
        .forward(colors.clone(), places.clone())
        .map(|t| values(&t));
    assert!(
        start[0].iter().all(|m| (0.4..0.6).contains(m)),
        "{:?}",
        start[0]
    );
    assert!(
        start[1].iter().all(|r| (0.1..0.9).contains(r)),
        "{:?}",
        start[1]
    );
    let target = |of: [f32; 2]| Tensor::<1>::from_floats([of; 12].concat().as_slice(), &device);
    let mut optimizer = AdamConfig::new().init();
    for _ in 0..200 {
        let [metallic, roughness] = network.forward(colors.clone(), places.clone());
        let error = (metallic - target([1.0, 0.0])).powi_scalar(2)
            + (roughness - target([0.3, 0.6])).powi_scalar(2);
        let gradients = error.mean().backward();
        let gradients = GradientsParams::from_grads(gradients, &network);
        network = optimizer.step(0.01, network, gradients);
    }
    let (colors, places) = points(40, 20);
    let [metallic, roughness] = network.forward(colors, places).map(|t| values(&t));
    for (i, (m, r)) in metallic.iter().zip(&roughness).enumerate() {
        let expected = if i.is_multiple_of(2) {
            (1.0, 0.3)
        } else {
            (0.0, 0.6)
        };
        let near = (m - expected.0).abs() < 0.2 && (r - expected.1).abs() < 0.12;
        assert!(near, "{i}: {m} {r} {expected:?}");
    }
    let error = message(
        SurfaceNetworkConfig::new()
            .with_roughness(2.0)
            .init(&device)
            .map(|_| ()),
    );
    says(&error, ["surface network", "roughness"]);
}

/// A photograph of a scene of one ball, from a camera of the shipped set, and the scene.
fn photograph_of_ball() -> (Photograph, Scene) {
    let set = Photographs::open("tests/data/photographs").expect("the set");
    let options = PhotographOptions::new().with_longest_side(24);
    let loaded = set.load(&[3], &options).expect("a photograph");
    let mut photograph = loaded.photographs[0].clone();
    let device = Device::flex();
    let ball =
        Object::new(shapes::icosphere(3, &device)).with_material(Material::diffuse([0.6; 3]));
    let scene = Scene::new()
        .with_object(ball)
        .with_environment([0.9, 0.7, 0.5]);
    let options = RenderOptions::new(24, 24)
        .with_samples(256)
        .with_bounces(0)
        .with_opacity();
    let camera = photograph.camera.to_camera().expect("a camera");
    let image = render(&scene, &camera, &options.with_seed(5)).expect("an image");
    let opacity = image.opacity.expect("requested");
    let sky = Tensor::<1>::from_floats([0.9, 0.7, 0.5], &device).reshape([1, 1, 3]);
    let object = image.radiance - (opacity.clone().neg() + 1.0).unsqueeze_dim(2) * sky;
    photograph.color = HostImage::from_tensor(&object).expect("an image");
    photograph.mask = values(&opacity).iter().map(|&v| v as f32).collect();
    (photograph, scene)
}

/// A scene agrees with its own photograph, whatever its environment shows beside it; and a scene that has moved does not.
#[test]
fn comparisons_see_the_object_alone() {
    let (photograph, scene) = photograph_of_ball();
    let photographs = [photograph];
    let options = RenderOptions::new(1, 1).with_samples(256).with_bounces(0);
    let compare = |scene: &Scene| {
        let view = |p: &Photograph| Ok((scene.clone(), p.camera.to_camera()?));
        Comparison::new(&photographs, &options, view).expect("a comparison")
    };
    let same = compare(&scene);
    assert!(same.iou > 0.97, "{same:?}");
    assert!(same.psnr_linear > 35.0 && same.psnr_srgb > 28.0, "{same:?}");
    assert!(same.images[0].pixels[..6].iter().all(|v| v.abs() < 1e-5));
    same.figure(&photographs, 6)
        .expect("a figure")
        .image()
        .expect("an image");

    let mut moved = scene.clone();
    for object in &mut moved.objects {
        object.mesh = object.mesh.clone().translated([0.3, 0.0, 0.0]);
    }
    let moved = compare(&moved);
    assert!(
        moved.iou < 0.9 && moved.psnr_srgb < same.psnr_srgb - 3.0,
        "{moved:?}"
    );
    let none = Comparison::new(&[], &options, |p| {
        Ok((scene.clone(), p.camera.to_camera()?))
    });
    assert!(none.is_err());
}

/// An object in a camera's own frame looks as it does in the world, and the region becomes the unit ball.
#[test]
fn frames_of_photographs() {
    let (mut photograph, scene) = photograph_of_ball();
    let camera = photograph.camera;
    let mut own = scene.clone();
    for object in &mut own.objects {
        object.mesh = object
            .mesh
            .clone()
            .transformed(&camera.world_to_own_frame(&Device::flex()));
    }
    let options = RenderOptions::new(1, 1).with_samples(64).with_bounces(0);
    let view = |_: &Photograph| Ok((own.clone(), camera.in_own_frame().to_camera()?));
    let found = Comparison::new(std::slice::from_ref(&photograph), &options, view);
    let found = found.expect("a comparison");
    assert!(found.iou > 0.97 && found.psnr_linear > 35.0, "{found:?}");

    // A pixel at the middle of the image is as wide as `pixel_width` says.
    let at = |pixel: [f64; 2]| {
        let (eye, direction) = camera.ray(pixel).expect("a ray");
        let along: f64 = (0..3).map(|i| -eye[i] * direction[i]).sum();
        [0, 1, 2].map(|i| eye[i] + along * direction[i])
    };
    let [a, b] = [
        camera.principal,
        [camera.principal[0] + 1.0, camera.principal[1]],
    ]
    .map(at);
    let width = (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
    assert!(
        (camera.pixel_width(a) / width - 1.0).abs() < 0.01,
        "{width}"
    );

    let region = Region::sphere([0.1, 0.2, 0.3], 2.0);
    let before = camera
        .project([0.1 + 2.0 * 0.3, 0.2 - 2.0 * 0.4, 0.3])
        .expect("a pixel");
    region.make_unit([&mut photograph]);
    let after = photograph
        .camera
        .project([0.3, -0.4, 0.0])
        .expect("a pixel");
    assert!(
        (0..2).all(|i| (before[i] - after[i]).abs() < 1e-9),
        "{before:?} {after:?}"
    );
    let [mean, expected] = [photograph.mean_color(), [0.54, 0.42, 0.3]];
    assert!(
        (0..3).all(|c| (mean[c] / expected[c] - 1.0).abs() < 0.1),
        "{mean:?}"
    );
}
