//! A level of the fit.

use std::path::PathBuf;
use std::time::Instant;

use burn::module::ParamGroup;
use burn::optim::AdamConfig;
use softray::Result;
use softray::meshing::TriangleMesh;
use softray::modules::AssetParams;
use softray::optim::{LargeSteps, LargeStepsConfig, Step};
use softray::photographs::{Batches, Photograph, crop_to_masks};
use softray::prelude::*;

pub struct Stage {
    /// Whether the mesh stays as it is.
    still: bool,
    /// Whether it is a first one. It finds the light, which is hard to tell from the base color: it takes larger steps with
    /// less noise.
    first: bool,
    pub views: Vec<Photograph>,
    /// The width of a pixel at the object.
    pixel: f64,
    options: RenderOptions,
}

/// The options of renders that are compared with photographs.
pub fn measuring(bounces: u32) -> RenderOptions {
    let options = RenderOptions::new(1, 1).with_samples(64);
    options.with_bounces(bounces)
}

impl Stage {
    pub fn new(train: &[Photograph], size: usize, still: bool, bounces: u32) -> Result<Self> {
        let shrunk = train.iter().map(|p| p.shrunk(size));
        let views = crop_to_masks(&shrunk.collect::<Result<Vec<_>>>()?, 2)?;
        let first = size < 64;
        let widths = views.iter().map(|p| p.camera.pixel_width([0.0; 3]));
        Ok(Self {
            still,
            first,
            pixel: widths.sum::<f64>() / views.len() as f64,
            options: RenderOptions::new(1, 1)
                .with_samples(if first { 8 } else { 4 })
                .with_bounces(bounces),
            views,
        })
    }

    /// The length of the mesh's edges.
    pub fn edge(&self) -> f64 {
        1.4 * self.pixel
    }

    /// The width of a texel.
    fn texel(&self) -> f64 {
        self.pixel / 1.5
    }

    /// About eight of the photographs.
    pub fn few(&self) -> Vec<Photograph> {
        let step = self.views.len().div_ceil(8);
        self.views.iter().step_by(step).cloned().collect()
    }

    /// A start of the first level.
    pub fn begin(&self, mesh: &TriangleMesh, stands: bool, device: &Device) -> Result<AssetParams> {
        let device = device.clone().autodiff();
        AssetParams::from_photographs(&self.views, mesh, self.texel(), stands, &device)
    }

    /// The start of a later level, from the asset of the one before and a mesh near its.
    pub fn refine(&self, before: AssetParams, mesh: &TriangleMesh) -> Result<AssetParams> {
        let rows = if self.still { 32 } else { 16 };
        let mut asset = before.remeshed(mesh, self.texel(), rows)?;
        if self.still {
            asset.object = asset.object.with_normal_map()?;
        }
        Ok(asset)
    }

    /// The loss of a step. The render for the errors needs no derivatives, so it has more samples.
    fn loss(&self, asset: &AssetParams, views: &[usize], step: &Step) -> Result<Evaluation> {
        let more = self.options.clone().with_samples(2 * self.options.samples);
        let options = [step.options(&more, 0), step.options(&self.options, 1)];
        let surface = asset.object.surface()?;
        let object = asset.object.object_of(surface.clone());
        let errors = asset.errors(&object, &self.views, views, options)?;
        let loss = errors.color * 40.0 + errors.silhouette * 10.0 + asset.regularizer(surface)?;
        Ok(Evaluation::new(loss).with_value("PSNR", errors.psnr))
    }

    /// The number of steps that this many seconds are enough for.
    pub fn steps_in(&self, seconds: f64, asset: &AssetParams) -> Result<usize> {
        let clock = Instant::now();
        self.fit(asset.clone(), 5, None)?;
        let steps = 5.0 * seconds / clock.elapsed().as_secs_f64();
        Ok((steps as usize).clamp(20, 1000))
    }

    /// Fits, with progress and checkpoints if there is a folder for them.
    pub fn fit(
        &self,
        asset: AssetParams,
        steps: usize,
        checkpoints: Option<PathBuf>,
    ) -> Result<AssetParams> {
        let mesh = asset.object.mesh.mesh();
        let large = LargeSteps::from_mesh(&mesh, &LargeStepsConfig::default().with_lambda(4.0))?;
        let group = ParamGroup::from_path;
        let [vertices, colors, sky] = [
            "object.mesh.vertices",
            "object.base_color.logit_texels",
            "sky.log_radiance",
        ];
        let optimizer = AdamConfig::new()
            .init()
            .with_group(group(vertices), large, None);
        let falling = |rate: f64| Rate::exponential(rate, 0.2 * rate);
        let (moves, light) = if self.first {
            (Rate::exponential(0.09, 0.004), 0.4)
        } else {
            (Rate::exponential(0.03, 0.003), 0.2)
        };
        let posed = asset.viewpoints.is_some();
        let mut fit = Fit::new(asset, optimizer, steps)
            .with_rate(falling(0.003))
            .with_rate_of(group(colors), falling(0.4))
            .with_rate_of(group(vertices), moves)
            .with_rate_of(group(sky), falling(light))
            .with_progress(checkpoints.is_some());
        let poses = ["turns", "shifts", "log_focal"].map(|name| format!("viewpoints.{name}"));
        for name in poses.iter().filter(|_| posed) {
            fit = fit.with_rate_of(group(name), Rate::constant(2e-4));
        }
        if self.still {
            fit = fit.with_rate_of(group("object.normal_map.slopes"), Rate::constant(0.004));
        }
        if let Some(folder) = checkpoints {
            fit = fit.with_folder(folder);
        }
        let all: Vec<usize> = (0..self.views.len()).collect();
        let batches = Batches::new(&all, if self.first { 8 } else { 4 }, 1)?;
        let loss =
            |asset: &AssetParams, step: &Step| self.loss(asset, &batches.views(step.index), step);
        Ok(fit.run(loss)?.module)
    }
}
