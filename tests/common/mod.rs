//! Shared by the integration tests: reference data, devices, statistics.
#![allow(dead_code)] // each program of tests uses a part

pub mod cached;
pub mod errors;
pub mod facets;
pub mod folder;
pub mod gradients;
pub mod grids;
pub mod materials;
pub mod memory;
pub mod mistakes;
pub mod numbers;
pub mod process;
pub mod scenes;
pub mod stress;
pub mod tensors;
pub mod training;
pub mod views;

use std::path::PathBuf;

use softray::prelude::*;
pub use tensors::values;

/// The folder of reference data: `SOFTRAY_REFERENCE`, or the project's own copy.
pub fn reference(path: &str) -> PathBuf {
    let folder = std::env::var_os("SOFTRAY_REFERENCE").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data"),
        PathBuf::from,
    );
    folder.join(path)
}

/// Whether the long tier was asked for: converged renders, every gradient.
pub fn long() -> bool {
    std::env::var_os("SOFTRAY_LONG").is_some_and(|v| v != "0")
}

/// The CPU backends.
#[allow(deprecated)] // burn deprecates ndarray; users ask for it
pub fn cpu_devices() -> Vec<Device> {
    vec![
        Device::flex(),
        #[cfg(feature = "ndarray")]
        Device::ndarray(),
    ]
}

/// A perspective camera's vertical field of view, degrees.
pub fn fov(camera: &Camera) -> f64 {
    match &camera.projection {
        Projection::Perspective { fov_y } => fov_y.values().expect("a number")[0],
        other => panic!("{other:?}"),
    }
}

/// A folder of a test's own below the target folder, empty.
pub fn target_folder(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder); // there may be none
    std::fs::create_dir_all(&folder).expect("a folder");
    folder
}
