//! Blur over the steps of a fit, and the angle of a pixel.

use crate::common::errors::{message, says};
use proptest::prelude::*;
use softray::optim::{Blur, PlateauBlur, pixel_angle};
use softray::prelude::*;

/// A wall of 20 × 20 units in the plane y = 0.
fn wall() -> Scene {
    let wall = shapes::plane_grid(20.0, 20.0, 1, 1, &Device::flex());
    Scene::new().with_object(Object::new(wall).with_name("wall"))
}

/// Looks down on the wall from above.
fn above(height: f64) -> Camera {
    let camera = Camera::look_at([0.0, height, 0.0], [0.0; 3]);
    camera.with_up([0.0, 0.0, 1.0]).with_fov_y(60.0)
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

/// (1 − cos(π/3))/2 = 1/4: the values of a decay at a quarter and three quarters come at a third and
/// two thirds.
#[test]
fn cosine_is_slow_at_both_ends() {
    let schedule = BlurSchedule::cosine(1e-1, 1e-5, 30).expect("a schedule");
    let expected = [(10, 1e-2), (15, 1e-3), (20, 1e-4), (30, 1e-5), (1000, 1e-5)];
    for (step, value) in expected {
        let found = schedule.at(step);
        assert!((found / value - 1.0).abs() < 1e-12, "{step}: {found}");
    }
    assert_eq!((schedule.at(0), schedule.at(30)), (1e-1, 1e-5));
    let decay = BlurSchedule::decay(1e-1, 1e-5, 30).expect("a schedule");
    assert_ne!(schedule, decay);
    assert!(schedule.at(1) > decay.at(1) && schedule.at(29) < decay.at(29));
    let held = schedule.clone().with_hold(7);
    assert!((0..50).all(|step| held.at(step + 7) == schedule.at(step)));
    assert_eq!(held.at(3), 1e-1);
}

proptest! {
    #[test]
    fn never_rises(
        start in 1e-8..1e2,
        share in 1e-6..=1.0,
        steps in 1_usize..400,
        hold in 0_usize..50,
    ) {
        let end = start * share;
        let schedules = [BlurSchedule::decay, BlurSchedule::cosine]
            .map(|new| new(start, end, steps).expect("a schedule").with_hold(hold));
        for schedule in schedules {
            prop_assert_eq!(schedule.at(0), start);
            prop_assert_eq!(schedule.at(hold + steps), end);
            for step in 0..hold + steps + 3 {
                // Neighbors may be equal up to rounding where the ends are.
                prop_assert!(schedule.at(step + 1) <= schedule.at(step) * (1.0 + 1e-14));
            }
        }
    }

    /// Whatever is observed, a plateau's value is start·factorᵏ or the end, stays for 2·patience
    /// observations, and comes again when they are replayed.
    #[test]
    fn plateaus_replay(
        losses in prop::collection::vec(-10.0..10.0, 0..200),
        patience in 1_usize..8,
        factor in 0.05..0.95,
    ) {
        let new = || PlateauBlur::new(1.0, 1e-2, factor, patience).expect("a schedule");
        let (mut one, mut other) = (new(), new());
        let (mut changes, mut since) = (0, 0);
        let mut half = None;
        for (i, &loss) in losses.iter().enumerate() {
            let before = one.value();
            one.observe(loss);
            since += 1;
            if one.value() != before {
                prop_assert!(one.value() < before && since >= 2 * patience);
                (changes, since) = (changes + 1, 0);
            }
            let expected = (0..changes).fold(1.0, |v: f64, _| (v * factor).max(1e-2));
            prop_assert_eq!(one.value(), expected);
            if i == losses.len() / 2 {
                half = Some(one.clone());
            }
        }
        losses.iter().for_each(|&loss| other.observe(loss));
        prop_assert_eq!(&one, &other);
        if let Some(mut half) = half {
            losses[losses.len() / 2 + 1..].iter().for_each(|&loss| half.observe(loss));
            prop_assert_eq!(half, one);
        }
    }
}

/// ±30 % that do not repeat over a window.
fn jitter(i: usize) -> f64 {
    1.0 + 0.3 * (12.9898 * i as f64).sin()
}

#[test]
fn plateau_waits_while_a_noisy_loss_falls() {
    let mut blur = PlateauBlur::new(1e-1, 1e-3, 0.5, 20).expect("a schedule");
    for i in 0..200 {
        // By a third over a window of 20.
        blur.observe(0.98f64.powi(i as i32) * jitter(i));
        assert_eq!(blur.value(), 1e-1, "{i}");
    }
}

#[test]
fn plateau_falls_to_its_end_while_a_noisy_loss_is_flat() {
    // Means of 20 values of ±30 % differ by up to 3 % here: the tolerance is above it.
    let blur = PlateauBlur::new(1e-1, 1e-3, 0.25, 20).expect("a schedule");
    let mut blur = blur.with_tolerance(0.05).expect("a tolerance");
    let mut values = vec![blur.value()];
    for i in 0..250 {
        blur.observe(0.7 * jitter(i));
        let last = values[values.len() - 1];
        if blur.value() != last {
            values.push(blur.value());
        }
    }
    assert_eq!(values, [1e-1, 2.5e-2, 6.25e-3, 1.5625e-3, 1e-3]);
}

/// The means are of what came since the last change: the jump that a change brings does not count.
#[test]
fn plateau_changes_after_two_windows() {
    let mut blur = PlateauBlur::new(1.0, 0.1, 0.5, 3).expect("a schedule");
    let observed = |blur: &mut PlateauBlur, losses: &[f64]| {
        losses.iter().for_each(|&loss| blur.observe(loss));
        blur.value()
    };
    assert_eq!(observed(&mut blur, &[1.0; 5]), 1.0);
    assert_eq!(observed(&mut blur, &[f64::NAN, f64::INFINITY]), 1.0);
    assert_eq!(observed(&mut blur, &[1.0]), 0.5);
    // A fall from 5 to 4.8 is 4 %, and then one to 4.75 1 %.
    assert_eq!(observed(&mut blur, &[5.0, 5.0, 5.0, 4.8, 4.8, 4.8]), 0.5);
    assert_eq!(observed(&mut blur, &[4.75, 4.75]), 0.5);
    assert_eq!(observed(&mut blur, &[4.75]), 0.25);
    // A loss of 0, or that grows, or below 0 that stays, has stopped falling.
    assert_eq!(observed(&mut blur, &[0.0; 6]), 0.125);
    assert_eq!(observed(&mut blur, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), 0.1);
    assert_eq!(observed(&mut blur, &[-1.0; 20]), 0.1);
    let mut below = PlateauBlur::new(1.0, 0.1, 0.5, 3).expect("a schedule");
    assert_eq!(
        observed(&mut below, &[-1.0, -1.0, -1.0, -1.1, -1.1, -1.1]),
        1.0
    );
    assert_eq!(observed(&mut below, &[-1.1, -1.1, -1.1]), 0.5);
}

#[test]
fn plateau_errors_name_the_field_and_the_value() {
    let new = PlateauBlur::new;
    let tolerance = |t: f64| new(1.0, 0.1, 0.5, 3).expect("a schedule").with_tolerance(t);
    let cases = [
        (new(0.0, 0.1, 0.5, 3), "start is 0"),
        (new(1.0, f64::NAN, 0.5, 3), "end is NaN"),
        (new(1.0, 2.0, 0.5, 3), "end is 2"),
        (new(1.0, 0.1, 0.0, 3), "factor is 0"),
        (new(1.0, 0.1, 1.0, 3), "factor is 1"),
        (new(1.0, 0.1, f64::NAN, 3), "factor is NaN"),
        (new(1.0, 0.1, 0.5, 0), "patience is 0"),
        (tolerance(-0.1), "tolerance is -0.1"),
        (tolerance(1.0), "tolerance is 1"),
        (tolerance(f64::NAN), "tolerance is NaN"),
    ];
    for (found, expected) in cases {
        says(message(found), [expected]);
    }
}

#[test]
fn blur_of_either_kind() {
    let schedule = BlurSchedule::cosine(1e-1, 1e-3, 10).expect("a schedule");
    let mut scheduled = Blur::from(schedule.clone());
    let mut plateau = Blur::from(PlateauBlur::new(1.0, 0.1, 0.5, 2).expect("a schedule"));
    for step in 0..4 {
        assert_eq!(scheduled.value(step), schedule.at(step));
        assert_eq!(plateau.value(step), 1.0);
        scheduled.observe(1.0);
        plateau.observe(1.0);
    }
    assert_eq!(scheduled, Blur::Scheduled(schedule));
    assert_eq!((plateau.value(0), plateau.value(9)), (0.5, 0.5));
}

#[test]
fn holds_before_it_falls() {
    let falls = BlurSchedule::decay(1e-1, 1e-3, 10).expect("a schedule");
    let holds = falls.clone().with_hold(5);
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
        (BlurSchedule::constant(-1e-3), "value is -0.001"),
        (BlurSchedule::constant(f64::NAN), "value is NaN"),
        (BlurSchedule::decay(f64::INFINITY, 1e-3, 10), "start is inf"),
        (BlurSchedule::decay(1e-1, 0.0, 10), "end is 0"),
        (BlurSchedule::decay(1e-3, 1e-1, 10), "end is 0.1"),
        (BlurSchedule::decay(1e-1, 1e-3, 0), "steps is 0"),
        (BlurSchedule::cosine(f64::NAN, 1e-3, 10), "start is NaN"),
        (BlurSchedule::cosine(1e-1, -1.0, 10), "end is -1"),
        (BlurSchedule::cosine(1e-3, 1e-1, 10), "end is 0.1"),
        (BlurSchedule::cosine(1e-1, 1e-3, 0), "steps is 0"),
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
            "no objects",
        ),
    ];
    for (found, expected) in cases {
        says(message(found), [expected]);
    }
    says(
        message(pixel_angle(&above(5.0).with_fov_y(180.0), 16)),
        ["fov_y"],
    );
}

/// Three eighths of what is seen, three quarters of the smallest object, at least the end; the same in a
/// scene of twice the size, and with tensors in a graph.
#[test]
fn auto_goes_from_the_scene_to_the_pixel() {
    let with_ball = |radius: f64, scale: f32, tracked: bool| {
        let device = Device::flex();
        let mut scale = Tensor::<1>::from_floats([scale], &device);
        if tracked {
            scale = scale.autodiff().require_grad();
        }
        let radius = Tensor::<1>::from_floats([radius as f32], &device);
        let ball = Object::new(shapes::icosphere(2, &device).scaled(radius)).with_name("ball");
        let mut scene = wall().with_object(ball);
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
    // The box around the ball of radius 0.3 has half a diagonal of √3·0.3, 5 away.
    let schedule = auto(0.3, 1.0, false);
    near(
        schedule.at(0),
        (0.75 * 3f64.sqrt() * 0.3 / 5.0).atan().to_degrees(),
    );
    near(
        schedule.at(75),
        0.5 * pixel_angle(&above(5.0), 64).expect("an angle"),
    );
    assert!(schedule.at(74) > schedule.at(75));
    assert_eq!(schedule, auto(0.3, 1.0, true));
    near(auto(0.3, 2.0, false).at(0), schedule.at(0));
    near(auto(0.3, 2.0, false).at(75), schedule.at(75));
    // Smaller than a pixel: no wider than at the end.
    let speck = auto(1e-3, 1.0, false);
    assert_eq!(speck.at(0), speck.at(75));
    // The wall alone is large: three eighths of half the view.
    let wall = BlurSchedule::auto(&wall(), &above(5.0), 64, steps).expect("a schedule");
    near(
        wall.at(0),
        (0.375 * 30f64.to_radians().tan()).atan().to_degrees(),
    );
}
