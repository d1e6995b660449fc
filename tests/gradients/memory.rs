//! A long training does not grow: what a step leaves behind is nothing.
#![cfg(target_os = "linux")]

use crate::common::memory::resident;
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
