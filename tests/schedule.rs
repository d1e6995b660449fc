//! Blur over the steps of a fit, and what a pixel covers.

mod common;

use softray::optim::pixel_footprint;
use softray::prelude::*;

/// A wall of 20 × 20 units in the plane y = 0.
fn wall() -> Scene {
    let wall = shapes::plane_grid(20.0, 20.0, 1, 1, &Device::flex());
    Scene::new().with(Object::new(wall).named("wall"))
}

/// Looks down on the wall from above.
fn above(height: f64) -> Camera {
    let camera = Camera::look_at([0.0, height, 0.0], [0.0; 3]);
    camera.up([0.0, 0.0, 1.0]).fov_y(60.0)
}

#[test]
fn falls_by_the_same_factor_at_every_step() {
    let schedule = BlurSchedule::decay(1e-1, 1e-4, 30).expect("a schedule");
    let expected = [(0, 1e-1), (10, 1e-2), (20, 1e-3), (30, 1e-4), (1000, 1e-4)];
    for (step, sigma) in expected {
        let found = schedule.at(step);
        assert!((found / sigma - 1.0).abs() < 1e-12, "{step}: {found}");
    }
    assert_eq!((schedule.at(0), schedule.at(30)), (1e-1, 1e-4));
    let factors = (0..30).map(|i| schedule.at(i + 1) / schedule.at(i));
    for factor in factors {
        assert!((factor - 10f64.powf(-0.1)).abs() < 1e-12, "{factor}");
    }
}

#[test]
fn holds_before_it_falls() {
    let falls = BlurSchedule::decay(1e-1, 1e-3, 10).expect("a schedule");
    let holds = falls.clone().hold(5);
    assert_ne!(holds, falls);
    for step in 0..=5 {
        assert_eq!(holds.at(step), 1e-1);
    }
    for step in 0..20 {
        assert_eq!(holds.at(step + 5), falls.at(step));
    }
}

#[test]
fn constant_is_constant() {
    let schedule = BlurSchedule::constant(3e-4).expect("a schedule");
    for step in [0, 1, 2, 1000, usize::MAX] {
        assert_eq!(schedule.at(step), 3e-4);
    }
}

#[test]
fn errors_name_the_field_and_the_value() {
    let cases = [
        (BlurSchedule::constant(0.0), "start is 0"),
        (BlurSchedule::constant(-1e-3), "start is -0.001"),
        (BlurSchedule::constant(f64::NAN), "start is NaN"),
        (BlurSchedule::decay(f64::INFINITY, 1e-3, 10), "start is inf"),
        (BlurSchedule::decay(1e-1, 0.0, 10), "end is 0"),
        (BlurSchedule::decay(1e-3, 1e-1, 10), "end is 0.1"),
        (BlurSchedule::decay(1e-1, 1e-3, 0), "steps is 0"),
        (
            BlurSchedule::auto(&wall(), &above(5.0), 0, 10),
            "height is 0",
        ),
        (
            BlurSchedule::auto(&wall(), &above(5.0), 16, 0),
            "steps is 0",
        ),
        (
            BlurSchedule::auto(&Scene::new(), &above(5.0), 16, 10),
            "no triangles",
        ),
    ];
    for (found, expected) in cases {
        let error = found.expect_err(expected).to_string();
        assert!(error.contains(expected), "{error}");
    }
    let error = pixel_footprint(&wall(), &above(0.0), 16).expect_err("no view");
    assert!(error.to_string().contains("target"), "{error}");
}

/// 2·z·tan(fov/2)/height, whatever the point looked at.
#[test]
fn footprint_of_a_wall() {
    let side = |z: f64, rows: f64| 2.0 * z * 30f64.to_radians().tan() / rows;
    for (z, rows) in [(5.0, 16), (5.0, 480), (0.5, 64)] {
        let found = pixel_footprint(&wall(), &above(z), rows).expect("a footprint");
        let expected = side(z, rows as f64);
        // Rays go through random points of the pixels that distances are taken from: a median of
        // 256 is off by less than their size.
        assert!((found / expected - 1.0).abs() < 5e-3, "{found} {expected}");
    }
    let mut near = above(5.0);
    near.target = [0.0, 4.9, 0.0].into();
    let lens = above(5.0).thin_lens(0.3, 2.0);
    let expected = pixel_footprint(&wall(), &above(5.0), 64).expect("a footprint");
    for camera in [near, lens] {
        let found = pixel_footprint(&wall(), &camera, 64).expect("a footprint");
        assert!((found / expected - 1.0).abs() < 1e-5, "{found} {expected}");
    }
}

/// Where nothing is seen the point looked at counts.
#[test]
fn footprint_of_nothing() {
    let away = Camera::look_at([0.0, 5.0, 0.0], [0.0, 8.0, 0.0]);
    let away = away.up([0.0, 0.0, 1.0]).fov_y(60.0);
    let found = pixel_footprint(&wall(), &away, 16).expect("a footprint");
    let expected = 2.0 * 3.0 * 30f64.to_radians().tan() / 16.0;
    assert!((found / expected - 1.0).abs() < 1e-6, "{found} {expected}");
}

/// An eighth of what is seen, a quarter of the smallest object, at least the end; twice as large in
/// a scene of twice the size, and the same with tensors in a graph.
#[test]
fn auto_goes_from_the_scene_to_the_pixel() {
    let with_ball = |radius: f64, scale: f32, tracked: bool| {
        let device = Device::flex();
        let mut scale = Tensor::<1>::from_floats([scale], &device);
        if tracked {
            scale = scale.autodiff().require_grad();
        }
        let radius = Tensor::<1>::from_floats([radius as f32], &device);
        let ball = Object::new(shapes::icosphere(2, &device).scaled(radius)).named("ball");
        let mut scene = wall().with(ball);
        for object in &mut scene.objects {
            object.mesh = object.mesh.clone().scaled(scale.clone());
        }
        scene
    };
    let steps = 100;
    let auto = |radius, scale: f32, tracked| {
        let scene = with_ball(radius, scale, tracked);
        let camera = above(5.0 * f64::from(scale));
        BlurSchedule::auto(&scene, &camera, 64, steps).expect("a schedule")
    };
    let near = |found: f64, expected: f64| {
        assert!((found / expected - 1.0).abs() < 2e-2, "{found} {expected}");
    };
    let view = 2.0 * 5.0 * 30f64.to_radians().tan();
    // The box around the ball of radius 0.3 has half a diagonal of √3·0.3.
    near(auto(0.3, 1.0, false).at(0).sqrt(), 0.25 * 3f64.sqrt() * 0.3);
    let schedule = auto(0.3, 1.0, false);
    near(schedule.at(75).sqrt(), 0.5 * view / 64.0);
    assert!(schedule.at(74) > schedule.at(75));
    assert_eq!(schedule, auto(0.3, 1.0, true));
    near(auto(0.3, 2.0, false).at(0) / schedule.at(0), 4.0);
    near(auto(0.3, 2.0, false).at(75) / schedule.at(75), 4.0);
    // Smaller than a pixel: no wider than at the end.
    let speck = auto(1e-3, 1.0, false);
    assert_eq!(speck.at(0), speck.at(75));
    // The wall alone is large: an eighth of half the view.
    let wall = BlurSchedule::auto(&wall(), &above(5.0), 64, steps).expect("a schedule");
    near(wall.at(0).sqrt(), 0.125 * 0.5 * view);
}

/// At the sharp σ the image is that of an unblurred path tracer: what is left of the error is
/// noise, which two renders with independent seeds do not share.
#[test]
fn sharp_renders_as_without_blur() {
    let file = SceneFile::load(common::reference("shadow/scene.json"), &Device::flex());
    let file = file.expect("a scene");
    let reference = HostImage::read(common::reference("shadow/bounces-0.exr")).expect("an image");
    let sigma = BlurSchedule::sharp_sigma(&file.scene, &file.camera, file.height).expect("σ");
    let footprint = pixel_footprint(&file.scene, &file.camera, file.height).expect("a footprint");
    assert!((sigma.sqrt() / footprint - 0.02).abs() < 1e-9);
    let errors = [1, 2].map(|seed| {
        let options = RenderOptions::new(file.width, file.height)
            .bounces(0)
            .samples(64)
            .sigma(sigma)
            .seed(seed);
        let image = render(&file.scene, &file.camera, &options).expect("an image");
        let image = HostImage::from_tensor(&image.radiance).expect("values");
        assert!((image.mean_ratio(&reference) - 1.0).abs() < 5e-3);
        let pairs = image.pixels.iter().zip(&reference.pixels);
        pairs.map(|(a, b)| f64::from(a - b)).collect::<Vec<_>>()
    });
    let [a, b] = &errors;
    let product: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
    // 0.0009 at √σ = 1 pixel (docs/BLUR.md); the noise of one render is 0.002.
    let rmse = (product.max(0.0) / a.len() as f64).sqrt();
    assert!(rmse < 5e-4, "{rmse}");
}
