//! Counts of this crate's work on GPUs, and times of the stages of renders.

use std::ops::Sub;
use std::sync::{Mutex, MutexGuard, PoisonError};

use burn::tensor::Device;
use web_time::{Duration, Instant};

use super::is_cpu;

/// Counts of this crate's work on GPUs since the program started, for profiling.
///
/// The difference of two values is the work in between. burn's own launches and the user's read-backs are not included.
///
/// [`work()`] has an example.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// The number of kernel launches.
    pub launches: u64,
    /// The number of uploads to a device: lists of scenes and of backward passes.
    pub uploads: u64,
    /// The total size of the uploads in bytes.
    pub uploaded_bytes: u64,
    /// The number of read-backs of tensors that something waits for. A render by GPU kernels adds at most one, for all
    /// its scenes and cameras together, and its backward pass adds none. Adaptive sampling and requested statistics or
    /// diagnostics add more.
    pub read_backs: u64,
    /// The total size of these tensors in bytes.
    pub read_bytes: u64,
    /// The number of searches for edges from points of paths, in backward passes of renders with statistics.
    pub searches: u64,
    /// The number of searches for which there was time: 32 times the maximum number of searches in each warp of 32
    /// threads. [`Work::searches`] divided by this is the fraction of busy lanes in a warp.
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

/// Returns the counts of this crate's work on GPUs so far.
///
/// ```
/// use softray::device::work;
/// let before = work();
/// // Renders and backward passes …
/// let during = work() - before;
/// println!("{} launches, {} bytes read back", during.launches, during.read_bytes);
/// ```
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

/// Counts a kernel launch.
#[cfg(feature = "gpu")]
pub(crate) fn count_launch() {
    lock().launches += 1;
}

/// Counts an upload to a GPU.
#[cfg(feature = "gpu")]
pub(crate) fn count_upload(bytes: usize) {
    let mut work = lock();
    work.uploads += 1;
    work.uploaded_bytes += bytes as u64;
}

/// Counts searches for edges from points, which are in the order of their threads.
#[cfg(feature = "gpu")]
pub(crate) fn count_searches(of_points: &[u32]) {
    const WARP: usize = 32;
    let lanes = |warp: &[u32]| (WARP as u32 * warp.iter().max().unwrap_or(&0)) as u64;
    let mut work = lock();
    work.searches += of_points.iter().map(|&n| u64::from(n)).sum::<u64>();
    work.search_lanes += of_points.chunks(WARP).map(lanes).sum::<u64>();
}

/// Counts a read-back of `numbers` 32-bit numbers, unless the device is a CPU.
pub(crate) fn count_read_back(device: &Device, numbers: usize) {
    if !is_cpu(device) {
        let mut work = lock();
        work.read_backs += 1;
        work.read_bytes += 4 * numbers as u64;
    }
}

/// A stage of a render or of its backward pass: a kernel, timed until the device has finished it, or work on the host.
///
/// [`stages_of`] has an example.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stage {
    /// The name of the kernel or of the host's work.
    pub name: &'static str,
    /// Whether the stage is a kernel.
    pub on_device: bool,
    /// The number of runs.
    pub count: u64,
    /// The total time of all runs.
    pub time: Duration,
}

static STAGES: Mutex<Option<Vec<Stage>>> = Mutex::new(None);

fn stages() -> MutexGuard<'static, Option<Vec<Stage>>> {
    STAGES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs `work` and measures the stages of renders meanwhile. Returns the result of `work` and the stages, in the order
/// in which they first ended.
///
/// The measurement includes all threads of the process, so only one can run at a time. The host waits before and after
/// each kernel, so the total is longer than without the measurement. A kernel's first run is mostly compilation.
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
    /// Ends the measurement if `work` panics.
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

/// Runs a stage on the host. Adds its time if stages are measured.
pub(crate) fn stage<T>(name: &'static str, run: impl FnOnce() -> T) -> T {
    if stages().is_none() {
        return run();
    }
    let start = Instant::now();
    let done = run();
    add(name, false, start.elapsed());
    done
}

/// Launches a kernel. If stages are measured, the host waits for the device before and after, and adds the time.
#[cfg(feature = "gpu")]
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
