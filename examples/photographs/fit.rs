//! What is fitted, and a level of the fit.

use std::path::PathBuf;
use std::time::Instant;

use burn::module::{Module, ParamGroup};
use burn::optim::AdamConfig;
use softray::Result;
use softray::loss::PhotographLoss;
use softray::meshing::TriangleMesh;
use softray::modules::{
    EnvironmentParamsConfig, ExposureParams, ExposureParamsConfig, SurfaceNetworkConfig,
    TexturedMeshParams,
};
use softray::optim::{Comparison, LargeSteps, LargeStepsConfig, Step};
use softray::photographs::{Batches, Photograph, crop_to_masks};
use softray::prelude::*;

/// The parameters.
#[derive(Module, Debug)]
pub struct Asset {
    pub object: TexturedMeshParams,
    pub sky: EnvironmentParams,
    pub exposure: ExposureParams,
    /// Whether the light stands in the world, and not with the camera.
    pub world: bool,
}

impl Asset {
    /// The scene and the camera of a photograph. If the light turns with the camera, they are in the camera's frame.
    fn view(&self, object: &Object, sky: &Environment, p: &Photograph) -> Result<(Scene, Camera)> {
        let (mut object, mut camera) = (object.clone(), p.camera);
        if !self.world {
            let device = object.mesh.vertices.device().inner();
            object.mesh = object.mesh.transformed(&camera.world_to_own_frame(&device));
            camera = camera.in_own_frame();
        }
        let scene = Scene::new()
            .with_object(object)
            .with_environment(sky.clone());
        Ok((scene, camera.to_camera()?))
    }

    /// Measures how well photographs agree.
    pub fn compare(&self, photographs: &[Photograph], bounces: u32) -> Result<Comparison> {
        let asset = self.valid();
        let (object, sky) = (asset.object.object()?, asset.sky.environment());
        let options = RenderOptions::new(1, 1)
            .with_samples(64)
            .with_bounces(bounces);
        Comparison::new(photographs, &options, |p| asset.view(&object, &sky, p))
    }
}

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

impl Stage {
    pub fn new(train: &[Photograph], size: usize, still: bool, bounces: u32) -> Result<Self> {
        let shrunk = train
            .iter()
            .map(|p| p.shrunk(size))
            .collect::<Result<Vec<_>>>()?;
        let views = crop_to_masks(&shrunk, 2)?;
        let [width, height] = views[0].camera.size;
        let first = size < 64;
        let widths = views.iter().map(|p| p.camera.pixel_width([0.0; 3]));
        Ok(Self {
            still,
            first,
            pixel: widths.sum::<f64>() / views.len() as f64,
            options: RenderOptions::new(width, height)
                .with_samples(if first { 8 } else { 4 })
                .with_bounces(bounces)
                .with_opacity(),
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

    /// A start of the first level. The mean base color is 0.5, and colors are what white light would show.
    pub fn begin(&self, mesh: &TriangleMesh, world: bool, device: &Device) -> Result<Asset> {
        let device = device.clone().autodiff();
        let count = self.views.len();
        let colors: Vec<_> = self.views.iter().map(Photograph::mean_color).collect();
        let color =
            [0, 1, 2].map(|c| colors.iter().map(|color| color[c]).sum::<f64>() / count as f64);
        let light = color.iter().sum::<f64>() / 3.0 / 0.5;
        let color = color.map(|c| (c / light).min(0.95));
        let network = SurfaceNetworkConfig::new().init(&device)?;
        Ok(Asset {
            object: TexturedMeshParams::from_mesh(mesh, self.texel(), color, network, &device)?,
            sky: EnvironmentParamsConfig::new(16, 32)
                .with_radiance([light; 3])
                .init(&device)?,
            exposure: ExposureParamsConfig::new(count).init(&device)?,
            world,
        })
    }

    /// The start of a later level, from the asset of the one before and a mesh near its.
    pub fn refine(&self, before: Asset, mesh: &TriangleMesh) -> Result<Asset> {
        let object = before.object.remeshed(mesh, self.texel())?;
        Ok(Asset {
            object: if self.still {
                object.with_normal_map()?
            } else {
                object
            },
            sky: before.sky.resized(if self.still { 32 } else { 16 })?,
            ..before
        })
    }

    /// The loss of a step, by two renders: one for the errors, and one for the derivatives.
    fn loss(&self, asset: &Asset, views: &[usize], step: &Step) -> Result<Evaluation> {
        let shown: Vec<&Photograph> = views.iter().map(|&i| &self.views[i]).collect();
        let surface = asset.object.surface()?;
        let (object, sky) = (
            asset.object.object_of(surface.clone()),
            asset.sky.environment(),
        );
        let device = object.mesh.vertices.device();
        let scenes = shown.iter().map(|p| asset.view(&object, &sky, p));
        let (mut scenes, cameras): (Vec<_>, Vec<_>) =
            scenes.collect::<Result<Vec<_>>>()?.into_iter().unzip();
        if asset.world {
            scenes.truncate(1);
        }
        let batch = Batch::new(scenes, cameras)?;
        // Both renders share the BVH.
        let options = self.options.clone().with_cache(&HierarchyCache::new());
        let more = options.clone().with_samples(2 * options.samples);
        let errors = render_batch(&batch, &step.options(&more, 0))?;
        let image = render_batch(&batch, &step.options(&options, 1))?;
        let factors = asset.exposure.factors(views)?;
        let errors =
            PhotographLoss::new(&shown, &device)?.forward(&errors, &image, Some(factors))?;
        let loss = errors.color * 40.0 + errors.silhouette * 10.0 + penalty(asset, surface)?;
        Ok(Evaluation::new(loss).with_value("PSNR", errors.psnr))
    }

    /// The number of steps that this many seconds are enough for.
    pub fn steps_in(&self, seconds: f64, asset: &Asset) -> Result<usize> {
        let clock = Instant::now();
        self.fit(asset.clone(), 5, None)?;
        let steps = 5.0 * seconds / clock.elapsed().as_secs_f64();
        Ok((steps as usize).clamp(20, 1000))
    }

    /// Fits, with progress and checkpoints if there is a folder for them.
    pub fn fit(&self, asset: Asset, steps: usize, checkpoints: Option<PathBuf>) -> Result<Asset> {
        let mesh = asset.object.mesh.mesh();
        let large = LargeSteps::from_mesh(&mesh, &LargeStepsConfig::default().with_lambda(4.0))?;
        let group = ParamGroup::from_path;
        let optimizer =
            AdamConfig::new()
                .init()
                .with_group(group("object.mesh.vertices"), large, None);
        let falling = |rate: f64| Rate::exponential(rate, 0.2 * rate);
        let mut fit = Fit::new(asset, optimizer, steps)
            .with_rate(falling(0.003))
            .with_rate_of(group("object.base_color.logit_texels"), falling(0.4))
            .with_rate_of(
                group("object.mesh.vertices"),
                if self.first {
                    Rate::exponential(0.09, 0.004)
                } else {
                    Rate::exponential(0.03, 0.003)
                },
            )
            .with_rate_of(
                group("sky.log_radiance"),
                falling(if self.first { 0.4 } else { 0.2 }),
            )
            .with_progress(checkpoints.is_some());
        if self.still {
            fit = fit.with_rate_of(group("object.normal_map.slopes"), Rate::constant(0.004));
        }
        if let Some(folder) = checkpoints {
            fit = fit.with_folder(folder);
        }
        let all: Vec<usize> = (0..self.views.len()).collect();
        let batches = Batches::new(&all, if self.first { 8 } else { 4 }, 1)?;
        let fitted = fit
            .run(|asset: &Asset, step: &Step| self.loss(asset, &batches.views(step.index), step))?;
        Ok(fitted.module)
    }
}

/// Keeps light and textures smooth, and light nearly white, under which colors are judged. Rough metal looks as paint does:
/// paint is what most things have.
fn penalty(asset: &Asset, [metallic, roughness]: [Tensor<2>; 2]) -> Result<Tensor<1>> {
    let sky = asset.sky.texels();
    let gray = sky.clone().mean_dim(2);
    let power = gray.clone().detach().powi_scalar(2).mean();
    let mut sum = (metallic * roughness).mean() * 0.03
        + (sky - gray).powi_scalar(2).mean() * 0.06 / power
        + loss::smoothness(asset.sky.log_radiance.val())? * 3e-4
        + loss::smoothness(asset.object.base_color.logit_texels.val())? * 0.005;
    if let Some(normals) = &asset.object.normal_map {
        sum = sum + loss::smoothness(normals.slopes.val())? * 0.02;
    }
    Ok(sum)
}
