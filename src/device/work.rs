//! Counts of what this crate does on GPUs, and the times of stages of renders.

use std::ops::Sub;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use burn::tensor::Device;

use super::is_cpu;

/// What this crate has done on GPUs since the program began, for profiles: the difference of two is what was done in
/// between. burn's own launches, and what a user reads, don't count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Kernels that were launched.
    pub launches: u64,
    /// How often lists of scenes and of backward passes were sent to a device.
    pub uploads: u64,
    /// The bytes of these lists.
    pub uploaded_bytes: u64,
    /// How often tensors were read back: at most once a render by kernels there, all of its scenes and cameras together,
    /// and never in their backward passes; statistics and diagnostics that were asked for are read too.
    pub read_backs: u64,
    /// The bytes of these tensors.
    pub read_bytes: u64,
    /// The searches for edges that points of paths made in backward passes of renders with statistics.
    pub searches: u64,
    /// The searches that as many threads could have made as were busy until the last of 32 that run in step had made
    /// its own: [`Work::searches`] over this is the share of lanes that a warp keeps busy.
    pub search_lanes: u64,
}

impl Sub for Work {
    type Output = Self;

    fn sub(self, before: Self) -> Self {
        Self {
            launches: self.launches - before.launches,
            uploads: self.uploads - before.uploads,
            uploaded_bytes: self.uploaded_bytes - before.uploaded_bytes,
            read_backs: self.read_backs - before.read_backs,
            read_bytes: self.read_bytes - before.read_bytes,
            searches: self.searches - before.searches,
            search_lanes: self.search_lanes - before.search_lanes,
        }
    }
}

/// What this crate has done on GPUs so far.
pub fn work() -> Work {
    *lock()
}

static WORK: Mutex<Work> = Mutex::new(Work {
    launches: 0,
    uploads: 0,
    uploaded_bytes: 0,
    read_backs: 0,
    read_bytes: 0,
    searches: 0,
    search_lanes: 0,
});

fn lock() -> MutexGuard<'static, Work> {
    WORK.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Counts the launch of a kernel.
#[cfg(feature = "wgpu")]
pub(crate) fn count_launch() {
    lock().launches += 1;
}

/// Counts bytes that are sent to a GPU.
#[cfg(feature = "wgpu")]
pub(crate) fn count_upload(bytes: usize) {
    let mut work = lock();
    work.uploads += 1;
    work.uploaded_bytes += bytes as u64;
}

/// Counts searches for edges by points, in the order of their threads.
#[cfg(feature = "wgpu")]
pub(crate) fn count_searches(of_points: &[u32]) {
    const WARP: usize = 32;
    let lanes = |warp: &[u32]| (WARP as u32 * warp.iter().max().unwrap_or(&0)) as u64;
    let mut work = lock();
    work.searches += of_points.iter().map(|&n| u64::from(n)).sum::<u64>();
    work.search_lanes += of_points.chunks(WARP).map(lanes).sum::<u64>();
}

/// Counts a read-back of so many numbers of 32 bits, where the device is not a CPU.
pub(crate) fn count_read_back(device: &Device, numbers: usize) {
    if !is_cpu(device) {
        let mut work = lock();
        work.read_backs += 1;
        work.read_bytes += 4 * numbers as u64;
    }
}

/// A stage of a render or of its backward pass: a kernel, with the time until the device has run it, or work of the host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stage {
    /// The kernel's name, or what the host does.
    pub name: &'static str,
    /// Whether it is a kernel.
    pub on_device: bool,
    /// How often it ran.
    pub count: u64,
    /// The time that it took in all.
    pub time: Duration,
}

static STAGES: Mutex<Option<Vec<Stage>>> = Mutex::new(None);

fn stages() -> MutexGuard<'static, Option<Vec<Stage>>> {
    STAGES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Measures how long each stage of renders takes while something is done, in the order in which they first ended. All
/// threads of the process count, so one such measurement is made at a time. The host waits before and after each kernel;
/// so all together takes longer than without. The time of a kernel's first run is mostly that of its compiler.
///
/// ```no_run
/// # fn step() {}
/// for stage in softray::device::stages_of(|| step()).1 {
///     println!("{} × {}: {:?}", stage.count, stage.name, stage.time);
/// }
/// ```
///
/// # Panics
/// If another measurement is under way.
pub fn stages_of<T>(work: impl FnOnce() -> T) -> (T, Vec<Stage>) {
    /// Ends the measurement, if the work panics too.
    struct End;
    impl Drop for End {
        fn drop(&mut self) {
            stages().take();
        }
    }
    let begin = |all: &mut Option<Vec<Stage>>| {
        assert!(all.is_none(), "one measurement of stages at a time");
        *all = Some(Vec::new());
    };
    begin(&mut stages());
    let end = End;
    let done = work();
    std::mem::forget(end);
    (done, stages().take().unwrap_or_default())
}

/// Runs a stage of the host, and adds its time while stages are measured.
pub(crate) fn stage<T>(name: &'static str, run: impl FnOnce() -> T) -> T {
    if stages().is_none() {
        return run();
    }
    let start = Instant::now();
    let done = run();
    add(name, false, start.elapsed());
    done
}

/// Launches a kernel, and adds its time while stages are measured: then the host waits for the device before and after.
#[cfg(feature = "wgpu")]
pub(crate) fn kernel(name: &'static str, launch: impl FnOnce(), wait: impl Fn()) {
    if stages().is_none() {
        return launch();
    }
    wait();
    let start = Instant::now();
    launch();
    wait();
    add(name, true, start.elapsed());
}

fn add(name: &'static str, on_device: bool, time: Duration) {
    let mut stages = stages();
    let Some(all) = stages.as_mut() else { return };
    match all.iter_mut().find(|stage| stage.name == name) {
        Some(stage) => {
            stage.count += 1;
            stage.time += time;
        }
        None => all.push(Stage {
            name,
            on_device,
            count: 1,
            time,
        }),
    }
}
