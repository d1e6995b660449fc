//! A differentiable path tracer on burn.
//!
//! Gradients of an image are unbiased, including the boundary terms of silhouettes and shadow edges, which are sampled
//! explicitly. Rays may be blurred by cones; the softmax visibility of Quinn et al., *Differentiable Path Tracing by
//! Regularizing Discontinuities*, is available for comparison.
//!
//! A [`Scene`](scene::Scene) is a plain value made of tensors. [`render()`](render::render) turns it into an image in
//! their autodiff graph, so that `backward()` gives gradients to geometry, materials, lights,
//! camera, lens and motion.
//!
//! Likely mistakes that are not errors, such as a camera that sees nothing, are warnings. They go to the `log` crate. If a
//! program has installed no logger, they are also printed to the standard error, each once ([`show_warnings`]).
//!
//! ```
//! use softray::prelude::*;
//!
//! let device = Device::flex();
//! let offset = Tensor::<1>::from_floats([0.0, 0.2, 0.0], &device).autodiff().require_grad();
//! let scene = Scene::new()
//!     .with_object(Object::new(shapes::icosahedron(&device).translated(offset.clone())))
//!     .with_environment([1.0, 1.0, 1.0]);
//! let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0]).with_fov_y(40.0);
//! let options = RenderOptions::new(16, 16).with_samples(4).with_bounces(0);
//! let image = render(&scene, &camera, &options)?;
//! let gradients = image.radiance.powf_scalar(2.0).mean().backward();
//! assert!(offset.grad(&gradients).is_some());
//! # Ok::<(), softray::Error>(())
//! ```

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

#[cfg(all(doctest, feature = "fit", feature = "safetensors"))]
#[doc = include_str!("../docs/GUIDE.md")]
struct Guide;

#[cfg(doctest)]
#[doc = include_str!("../docs/README.md")]
struct Introduction;

#[cfg(all(doctest, feature = "photographs"))]
#[doc = include_str!("../docs/PHOTOGRAPHS.md")]
struct Photographs;

#[cfg(all(doctest, feature = "fit"))]
#[doc = include_str!("../docs/PREDICTOR.md")]
struct Predictor;

#[cfg(all(doctest, feature = "fit"))]
mod recipes {
    #[doc = include_str!("../docs/recipes/pose.md")]
    struct Pose;
    #[doc = include_str!("../docs/recipes/texture.md")]
    struct Texture;
    #[doc = include_str!("../docs/recipes/mesh.md")]
    struct Mesh;
    #[doc = include_str!("../docs/recipes/material.md")]
    struct Material;
    #[doc = include_str!("../docs/recipes/lens.md")]
    struct Lens;
    #[doc = include_str!("../docs/recipes/network.md")]
    struct Network;
    #[doc = include_str!("../docs/recipes/environment.md")]
    struct Environment;
}

pub mod atlas;
mod debug;
pub mod device;
pub mod error;
#[cfg(feature = "fit")]
pub mod figure;
mod geometry;
#[cfg(feature = "gpu")]
mod gpu;
pub mod gradcheck;
pub mod io;
pub mod meshing;
pub mod modules;
pub mod optim;
#[cfg(all(feature = "photographs", not(target_family = "wasm")))]
pub mod photographs;
#[cfg(feature = "remote")]
pub mod remote;
pub mod render;
pub mod scene;
mod tensors;

/// The burn that this crate is built with, so that a program's tensors are of the same one.
pub use burn;
pub use error::{Error, Result};
pub use optim::loss;

/// Shows or hides warnings on the standard error, where they are shown by default if no logger is installed.
///
/// Warnings are about likely mistakes that are not errors: a black image, a camera that sees nothing of the scene, parts
/// of a file that are not read. Each goes to the `log` crate. If the program has installed no logger, it is printed to
/// the standard error instead, as a line that begins with `softray: warning:`. The same text is printed once in a
/// process, and at most eight texts of one kind. The crate prints nothing else without a request.
///
/// A logger whose maximum level is `Off` counts as none, so that warnings are printed. To hide them, call this function
/// with `false`, or set the environment variable `SOFTRAY_WARNINGS=0`. Neither changes what a logger receives.
///
/// A logger receives each text about scenes, cameras and options of renders once in a process, because a fit would
/// repeat it at every step. It receives every other warning, and every one of a black image.
///
/// ```
/// softray::show_warnings(false);
/// ```
pub fn show_warnings(shown: bool) {
    softray_kernels::warnings::show(shown);
}

/// The names that most programs need.
pub mod prelude {
    pub use burn::tensor::{Device, Tensor};

    pub use crate::io::{HostImage, LoadLimits, SceneFile};
    pub use crate::loss;
    pub use crate::modules::{
        CameraParams, CameraParamsConfig, EnvironmentParams, EnvironmentParamsConfig,
        MaterialParams, MaterialParamsConfig, MeshOffsets, MeshParams, NormalMapParams,
        NormalMapParamsConfig, RenderLoss, RenderLossConfig, Renderer, RigidTransform,
        RigidTransformConfig, TextureParams, TextureParamsConfig,
    };
    pub use crate::optim::BlurSchedule;
    #[cfg(feature = "fit")]
    pub use crate::optim::{Evaluation, Fit, Rate};
    pub use crate::render::{
        Batch, Diagnostics, EmitterSampling, Engine, HierarchyCache, Image, ImageBatch,
        ImageDerivative, Program, RenderOptions, Sampling, Sequence, SoftmaxOptions, Statistics,
        SurfaceSampling, Tangent, Visibility, overview, render, render_async, render_batch,
        render_derivative, render_pixels, unpremultiply,
    };
    pub use crate::scene::{
        Bounds, Bsdf, Camera, ColorTexture, Environment, Light, Material, Mesh, Object, Parameter,
        Projection, ScalarTexture, Scene, Transform, Wrap, cornell_box, shapes,
    };
}
