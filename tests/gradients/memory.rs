//! A long training does not grow: what a step leaves behind is nothing.
#![cfg(target_os = "linux")]

use crate::common::memory::{peak, resident};
use crate::common::numbers::mean;
use crate::common::process::alone;
use crate::common::training::Training;
use softray::prelude::*;

#[test]
fn memory_is_flat_over_a_thousand_steps() {
    if !alone(memory_is_flat_over_a_thousand_steps) {
        return;
    }
    let mut training = Training::new(&Device::flex());
    let mut losses = Vec::new();
    let mut sizes = Vec::new();
    for step in 0..1000 {
        losses.push(training.step(step).0);
        if step % 100 == 99 {
            sizes.push(resident().floor());
        }
    }
    println!("MiB by hundreds of steps: {sizes:?}");
    // The first two hundred warm up allocators and pools. What the rays of a step met, 14 kB, would
    // be 11 MiB by the end if it stayed.
    let (before, after) = (sizes[1], sizes[9]);
    assert!(before > 0.0 && after <= before + 4.0, "{sizes:?} MiB");
    // And it was a training.
    let (first, last) = (mean(&losses[..20]), mean(&losses[980..]));
    println!("loss {first:.4} → {last:.4}");
    assert!(last < 0.5 * first, "{first} → {last}");
}

/// The most memory that derivatives along directions take, after those of fewer samples: on all cores each accumulates the
/// derivatives of some pixels.
#[test]
fn derivatives_take_as_much_with_more_samples() {
    if !alone(derivatives_take_as_much_with_more_samples) {
        return;
    }
    let device = Device::flex();
    let (scene, camera) = cornell_box(&device);
    let turn = Tangent::new(&scene, &camera, |_, camera| {
        *camera = camera.clone().with_fov_y(1.0);
    });
    let tangents = [turn.expect("a tangent")];
    let taken = [4, 64].map(|samples| {
        let options = RenderOptions::new(48, 48)
            .with_samples(samples)
            .with_bounces(1);
        let all = render_derivative(&scene, &camera, &options, &tangents).expect("derivatives");
        assert!(all.tangents.radiance.max().into_scalar::<f32>() > 0.0);
        peak()
    });
    println!("MiB at the highest with 4 and 64 samples: {taken:?}");
    // The paths of 64 samples have a million points and lights, of which each takes over 100 bytes.
    assert!(
        taken[0] > 0.0 && taken[1] <= taken[0] + 8.0,
        "{taken:?} MiB"
    );
}
