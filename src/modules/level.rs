use std::path::Path;
use std::time::Duration;

use burn::module::ParamGroup;
use burn::optim::AdamConfig;
use burn::tensor::Device;
use web_time::Instant;

use super::AssetParams;
use crate::error::{Error, Result};
use crate::meshing::TriangleMesh;
use crate::optim::{Evaluation, Fit, LargeSteps, LargeStepsConfig, Rate, Step};
use crate::photographs::{Batches, Photograph, crop_to_masks};
use crate::render::RenderOptions;

/// A level with a smaller longest side in pixels counts as a first one.
const FIRST: usize = 64;
/// The weights of the errors of colors and of outlines.
const WEIGHTS: [f64; 2] = [40.0, 10.0];
/// The part of its first rate that a rate ends with.
const END: f64 = 0.2;
/// The first and the last rate of vertices at a first level, and later.
const MOVES: [[f64; 2]; 2] = [[0.09, 0.004], [0.03, 0.003]];
/// The first and the last rate of corrections of cameras, in a fit of all parameters and in one of them alone.
const POSES: [[f64; 2]; 2] = [[1e-4, 1e-5], [5e-4, 2e-5]];
/// λ of the large steps ([`LargeStepsConfig`]).
const SMOOTH: f64 = 4.0;

/// One level of a coarse-to-fine fit of [`AssetParams`]. All its photographs have one size.
///
/// A fit begins with small photographs and the visual hull of their masks. Each level has photographs of twice the size, a mesh
/// that [`meshing::renew`](crate::meshing::renew) has made finer, and textures of that size; it moves the vertices, by
/// [`LargeSteps`], and trains base color, metallic, roughness, light and exposures. A last level has a mesh that stays, and a
/// normal map.
///
/// ```
/// use softray::meshing::{HullOptions, renew};
/// use softray::modules::AssetLevel;
/// use softray::photographs::{ObjectPhotographs, PhotographOptions};
/// use softray::prelude::*;
/// let options = PhotographOptions::new().with_longest_side(32);
/// let set = ObjectPhotographs::open("tests/data/photographs", 8, options)?;
/// let hull = set.visual_hull(&HullOptions::default().with_resolution(32))?;
/// let level = AssetLevel::new(&set.train, 24)?;
/// let mesh = renew(&hull, level.edge())?;
/// let start = level.begin(&mesh, true, &Device::flex())?;
/// let coarse = level.fit(start, 2, None)?;
///
/// let last = AssetLevel::new(&set.train, 32)?.with_still_mesh(true);
/// let start = last.refine(coarse, &renew(&mesh, last.edge())?)?;
/// let asset = last.fit(start, 1, None)?;
/// assert!(asset.object.normal_map.is_some());
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct AssetLevel {
    /// The photographs, cropped to windows of one size about the object.
    pub photographs: Vec<Photograph>,
    /// Whether the mesh stays as it is.
    still: bool,
    /// Whether it is a first one. It finds the light, which is hard to tell from the base color: it takes larger steps with
    /// less noise.
    first: bool,
    /// The width of a pixel at the object.
    pixel: f64,
    options: RenderOptions,
}

impl AssetLevel {
    /// Shrinks photographs of an object in the unit ball about the origin to a longest side of `size` pixels. The mesh moves,
    /// and light does not bounce. Below 64 pixels, steps are larger and less noisy, to find the light.
    ///
    /// # Errors
    /// If there is no photograph, and those of [`Photograph::shrunk`] and [`crop_to_masks`].
    pub fn new(photographs: &[Photograph], size: usize) -> Result<Self> {
        let count = photographs.len();
        Error::unless(count > 0, "level", "photographs", count, "at least one")?;
        let shrunk = photographs.iter().map(|p| p.shrunk(size));
        let photographs = crop_to_masks(&shrunk.collect::<Result<Vec<_>>>()?, 2)?;
        let first = size < FIRST;
        let widths = photographs.iter().map(|p| p.camera.pixel_width([0.0; 3]));
        Ok(Self {
            still: false,
            first,
            pixel: widths.sum::<f64>() / count as f64,
            options: RenderOptions::new(1, 1)
                .with_samples(if first { 8 } else { 4 })
                .with_bounces(0),
            photographs,
        })
    }

    /// Sets whether [`AssetLevel::refine`] ends the training of the vertices and adds a normal map.
    #[must_use]
    pub fn with_still_mesh(mut self, still: bool) -> Self {
        self.still = still;
        self
    }

    /// Sets the number of bounces of light.
    #[must_use]
    pub fn with_bounces(mut self, bounces: u32) -> Self {
        self.options = self.options.with_bounces(bounces);
        self
    }

    /// Returns the length of edges that a mesh for this level has, in scene units: 1.4 pixels.
    pub fn edge(&self) -> f64 {
        1.4 * self.pixel
    }

    /// The width of a texel: two thirds of a pixel.
    fn texel(&self) -> f64 {
        self.pixel / 1.5
    }

    /// Returns a start with a mesh near the object ([`AssetParams::from_photographs`]).
    ///
    /// # Errors
    /// As [`AssetParams::from_photographs`].
    pub fn begin(&self, mesh: &TriangleMesh, stands: bool, device: &Device) -> Result<AssetParams> {
        let device = device.clone().autodiff();
        AssetParams::from_photographs(&self.photographs, mesh, self.texel(), stands, &device)
    }

    /// Returns a start from the result of the level before and a mesh near its mesh ([`AssetParams::remeshed`]).
    ///
    /// # Errors
    /// As [`AssetParams::remeshed`].
    pub fn refine(&self, before: AssetParams, mesh: &TriangleMesh) -> Result<AssetParams> {
        let rows = if self.still { 32 } else { 16 };
        let mut asset = before.remeshed(mesh, self.texel(), rows)?;
        if self.still {
            asset.object = asset.object.with_normal_map()?;
        }
        Ok(asset)
    }

    /// Finds the cameras of this level's photographs for an asset that was fitted to others, in a number of steps:
    /// [`AssetParams::for_photographs`], and a fit of the corrections alone.
    ///
    /// # Errors
    /// As [`AssetParams::for_photographs`] and [`AssetLevel::fit`].
    pub fn register(&self, asset: &AssetParams, steps: usize) -> Result<AssetParams> {
        let asset = asset.for_photographs(&self.photographs)?;
        self.fit_with(asset, steps, None, POSES[1])
    }

    /// The loss of a step. The render for the errors needs no derivatives, so it has more samples.
    fn loss(&self, asset: &AssetParams, views: &[usize], step: &Step) -> Result<Evaluation> {
        let more = self.options.clone().with_samples(2 * self.options.samples);
        let options = [step.options(&more, 0), step.options(&self.options, 1)];
        let surface = asset.object.surface()?;
        let object = asset.object.object_of(surface.clone());
        let errors = asset.errors(&object, &self.photographs, views, options)?;
        let [color, outline] = WEIGHTS;
        let penalty = asset.regularizer(surface)?;
        let loss = errors.color * color + errors.silhouette * outline + penalty;
        Ok(Evaluation::new(loss).with_value("PSNR", errors.psnr))
    }

    /// Measures how many steps a fit makes in a time: 20 to 1,000.
    ///
    /// # Errors
    /// As [`AssetLevel::fit`].
    pub fn steps_within(&self, time: Duration, asset: &AssetParams) -> Result<usize> {
        const TRIED: usize = 5;
        let clock = Instant::now();
        self.fit(asset.clone(), TRIED, None)?;
        let steps = TRIED as f64 * time.as_secs_f64() / clock.elapsed().as_secs_f64();
        Ok((steps as usize).clamp(20, 1000))
    }

    /// Fits for a number of steps, with progress, and with checkpoints in a folder from which a stopped fit goes on; without
    /// both if there is no folder.
    ///
    /// # Errors
    /// If `asset` has another number of photographs, and those of [`Fit::run`].
    pub fn fit(
        &self,
        asset: AssetParams,
        steps: usize,
        checkpoints: Option<&Path>,
    ) -> Result<AssetParams> {
        self.fit_with(asset, steps, checkpoints, POSES[0])
    }

    fn fit_with(
        &self,
        asset: AssetParams,
        steps: usize,
        checkpoints: Option<&Path>,
        poses: [f64; 2],
    ) -> Result<AssetParams> {
        asset.check_count(self.photographs.len())?;
        let mesh = asset.object.mesh.mesh();
        let large = LargeSteps::from_mesh(&mesh, &LargeStepsConfig::default().with_lambda(SMOOTH))?;
        let group = ParamGroup::from_path;
        let vertices = "object.mesh.vertices";
        let optimizer = AdamConfig::new()
            .init()
            .with_group(group(vertices), large, None);
        let falling = |rate: f64| Rate::exponential(rate, END * rate);
        let [start, end] = MOVES[usize::from(!self.first)];
        let (moves, light) = (
            Rate::exponential(start, end),
            if self.first { 0.4 } else { 0.2 },
        );
        let posed = asset.viewpoints.is_some();
        let poses = Rate::exponential(poses[0], poses[1]);
        let rates = [
            (true, vertices, moves),
            (true, "object.base_color.logit_texels", falling(0.4)),
            (true, "sky.log_radiance", falling(light)),
            (
                self.still,
                "object.normal_map.slopes",
                Rate::constant(0.004),
            ),
            (posed, "viewpoints.turns", poses),
            (posed, "viewpoints.shifts", poses),
            (posed, "viewpoints.log_focal", poses),
        ];
        let mut fit = Fit::new(asset, optimizer, steps)
            .with_rate(falling(0.003))
            .with_progress(checkpoints.is_some());
        for (_, name, rate) in rates.into_iter().filter(|(there, ..)| *there) {
            fit = fit.with_rate_of(group(name), rate);
        }
        if let Some(folder) = checkpoints {
            fit = fit.with_folder(folder);
        }
        let all: Vec<usize> = (0..self.photographs.len()).collect();
        let batches = Batches::new(&all, if self.first { 8 } else { 4 }, 1)?;
        let loss =
            |asset: &AssetParams, step: &Step| self.loss(asset, &batches.views(step.index), step);
        Ok(fit.run(loss)?.module)
    }
}
