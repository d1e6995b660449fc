//! Values that another thread prepares while training steps go on.

use std::sync::Arc;

use softray::device::work;
use softray::prelude::*;

use super::{Bodies, options};
use crate::common::process::alone;
use crate::common::scenes::diffuse;
use crate::device::device;

/// A normal of length 0 is an error when values that contain it are to be used, and the next render reads.
#[test]
fn mistakes_are_found_when_values_are_used() {
    if !alone(mistakes_are_found_when_values_are_used) {
        return;
    }
    let bodies = Bodies::new(&device());
    let options = options(2);
    let reads = |length: f32| {
        let normals = bodies.ball.vertices.clone() * length;
        let ball = bodies
            .ball
            .clone()
            .with_normals(normals.autodiff().require_grad());
        let scene = bodies.scene.clone();
        let ball = diffuse(ball, [0.3, 0.5, 0.6]).with_name("ball");
        let before = work();
        let image = render(&scene.with_object(ball), &bodies.camera, &options);
        image.map(|image| {
            image.radiance.sum().backward();
            (work() - before).read_backs
        })
    };
    for (i, (length, wanted)) in [(1.0, 1), (0.0, 0), (1.0, 0)].into_iter().enumerate() {
        assert_eq!(reads(length).expect("an image"), wanted, "step {i}");
    }
    let message = reads(1.0).expect_err("normals of length 0").to_string();
    println!("{message}");
    assert!(
        message.contains("ball") && message.contains("normals"),
        "{message}"
    );
    assert_eq!(reads(1.0).expect("an image"), 1);
    assert_eq!(reads(1.0).expect("an image"), 0);
}

/// A cache that is dropped while a thread prepares for it frees all that it keeps, and so does the thread.
#[test]
fn a_dropped_cache_keeps_nothing() {
    if !alone(a_dropped_cache_keeps_nothing) {
        return;
    }
    let bodies = Bodies::new(&device());
    let before = Arc::strong_count(&bodies.ball.faces);
    for steps in 0..6 {
        let options = options(3);
        for i in 0..steps {
            bodies.step(1e-6 * i as f32, &options).expect("an image");
        }
        // The thread that starts in step 3 may still work when the cache is dropped.
        let vertices = bodies.ball.vertices.clone().autodiff().require_grad();
        let ball = bodies.ball.clone().with_vertices(vertices);
        let ball = diffuse(ball, [0.3, 0.5, 0.6]).with_name("ball");
        let scene = bodies.scene.clone().with_object(ball);
        let image = render(&scene, &bodies.camera, &options).expect("an image");
        drop(scene);
        assert!(Arc::strong_count(&bodies.ball.faces) > before);
        drop(options);
        drop(image);
        assert_eq!(
            Arc::strong_count(&bodies.ball.faces),
            before,
            "{steps} steps"
        );
    }
}

/// Views that another thread has prepared are used early if vertices have moved too far since the values in use.
#[test]
fn prepared_values_are_used_after_far_moves() {
    if !alone(prepared_values_are_used_after_far_moves) {
        return;
    }
    let bodies = Bodies::new(&device());
    let (late, reading) = (options(6), options(1));
    // Step 5 requests values, which step 11 would begin to use. Step 8 is more than a quarter of an edge from step 0.
    for i in 0..12 {
        let way = 2.4e-3 * i as f32;
        let step = |options: &RenderOptions| {
            let step = bodies.step(way, &options.clone().with_seed(i));
            step.expect("an image")
        };
        let ([image, _], work) = step(&late);
        let ([wanted, _], _) = step(&reading);
        println!("step {i}: {work:?}");
        assert_eq!(image, wanted, "step {i}");
        assert_eq!(work.read_backs, u64::from(i == 0), "step {i}");
    }
}
