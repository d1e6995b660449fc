//! The number of paths in a launch of a backward pass. A launch of few paths leaves a GPU idle while its last threads run,
//! and drivers end launches that run for seconds. So a launch takes as many paths as the device traces in a limited time,
//! which is measured once for each kind of job.

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};

use burn::cubecl::prelude::*;
use web_time::{Duration, Instant};

use super::device::wait;
use super::form::Form;
use super::job::{Job, PATHS};

/// Limit of the time that all kernels together take for the paths of one launch.
const LIMIT: Duration = Duration::from_millis(100);
/// Numbers of words of records in a launch, unless one path has more: the largest, that of a launch whose time is unknown,
/// and the least.
const MOST: usize = 1 << 27;
const FIRST: usize = 1 << 23;
const LEAST: usize = 1 << 20;

/// The seconds that a path takes, by a hash of what this depends on.
static KNOWN: LazyLock<Mutex<HashMap<u64, f64>>> = LazyLock::new(Mutex::default);

fn known() -> MutexGuard<'static, HashMap<u64, f64>> {
    KNOWN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The number of paths in launches of a job.
pub(super) struct Pace {
    /// A hash of the device, the kernels, the directions of forward mode, the number of words of a path's records, and the
    /// magnitude of the scene's lists.
    kind: u64,
    of_path: usize,
    /// The number of words that a list has at most.
    room: usize,
    /// The number of paths in a launch, if the time of a path is known. It stays the same while others measure.
    paths: Option<usize>,
}

impl Pace {
    /// Returns the pace of a job whose paths have records of `of_path` words.
    pub fn new(client: &Client, job: &Job, form: Form, of_path: usize) -> Self {
        let (views, mut hash) = (&job.views, DefaultHasher::new());
        let size = views.buffers.longest().max(1).ilog2();
        let kernels = (views.features, views.derivatives, job.outputs);
        let work = (form.directions, of_path, size);
        (client.service_id(), kernels, work).hash(&mut hash);
        // A quarter of the largest buffer.
        let room = client.properties().memory.max_page_size / 16;
        let mut this = Self {
            kind: hash.finish(),
            of_path,
            room: usize::try_from(room).unwrap_or(usize::MAX),
            paths: None,
        };
        let seconds = known().get(&this.kind).copied();
        this.paths = seconds.map(|seconds| this.within_limit(seconds));
        this
    }

    /// Returns the number of paths that take the limit, if one takes so many seconds.
    fn within_limit(&self, seconds: f64) -> usize {
        let paths = (LIMIT.as_secs_f64() / seconds) as usize;
        paths.clamp(self.paths_of(LEAST), self.most())
    }

    fn paths_of(&self, words: usize) -> usize {
        (words.min(self.room) / self.of_path).max(1)
    }

    /// Returns the largest number of paths in a launch, whatever their time.
    pub fn most(&self) -> usize {
        self.paths_of(MOST)
    }

    /// Returns the number of paths in a launch whose time is unknown.
    pub fn first(&self) -> usize {
        self.paths_of(FIRST)
    }

    /// Returns whether a launch is to be timed. A page in a browser may not wait, so none is timed there.
    pub fn is_unknown(&self) -> bool {
        self.paths.is_none() && !cfg!(target_family = "wasm")
    }

    /// Returns the number of paths in a launch.
    pub fn paths(&self) -> usize {
        self.paths.unwrap_or(self.first())
    }

    /// Returns the number of samples of edges on films in a launch.
    pub fn samples(&self) -> usize {
        match self.paths {
            Some(paths) => (2 * paths).clamp(PATHS / 8, Self::MOST_SAMPLES),
            None => PATHS,
        }
    }

    pub const MOST_SAMPLES: usize = 4 * PATHS;

    /// Returns the pace after the time of launches of so many paths was measured.
    pub fn measured(&self, client: &Client, paths: usize, launch: impl FnOnce()) -> Self {
        wait(client);
        let start = Instant::now();
        launch();
        wait(client);
        let seconds = (start.elapsed().as_secs_f64() / paths.max(1) as f64).max(1e-12);
        known().insert(self.kind, seconds);
        Self {
            paths: Some(self.within_limit(seconds)),
            ..*self
        }
    }
}
