//! A long training does not grow: what a step leaves behind is nothing. Alone in its process, which is
//! what is measured.
#![cfg(target_os = "linux")]

mod common;

use common::training::Training;
use softray::prelude::*;

/// Memory of this process that is in use, bytes.
fn resident() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").expect("a status");
    let line = status.lines().find(|l| l.starts_with("VmRSS:"));
    let number = line.and_then(|l| l.split_whitespace().nth(1));
    1024 * number.and_then(|n| n.parse::<u64>().ok()).expect("kB")
}

#[test]
fn memory_is_flat_over_a_thousand_steps() {
    const MIB: u64 = 1 << 20;
    let mut training = Training::new(&Device::flex());
    let mut losses = Vec::new();
    let mut sizes = Vec::new();
    for step in 0..1000 {
        losses.push(training.step(step).0);
        if step % 100 == 99 {
            sizes.push(resident() / MIB);
        }
    }
    println!("MiB by hundreds of steps: {sizes:?}");
    // The first two hundred warm up allocators and pools. What the rays of a step met, 14 kB, would
    // be 11 MiB by the end if it stayed.
    let (before, after) = (sizes[1], sizes[9]);
    assert!(after <= before + 4, "{sizes:?} MiB");
    // And it was a training.
    let mean = |l: &[f64]| l.iter().sum::<f64>() / l.len() as f64;
    let (first, last) = (mean(&losses[..20]), mean(&losses[980..]));
    println!("loss {first:.4} → {last:.4}");
    assert!(last < 0.5 * first, "{first} → {last}");
}
