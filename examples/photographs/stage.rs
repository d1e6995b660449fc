//! A level: its start, its fit and what it reaches.

use std::path::Path;
use std::time::Instant;

use burn::module::{Param, ParamGroup};
use burn::optim::AdamConfig;
use softray::Result;
use softray::atlas::{Atlas, AtlasOptions, Textured, transfer};
use softray::loss::PhotographLoss;
use softray::meshing::{RemeshOptions, RepairOptions, TriangleMesh, remesh, repair};
use softray::modules::{
    EnvironmentParamsConfig, ExposureParamsConfig, NormalMapParamsConfig, SurfaceNetworkConfig,
    TextureParams,
};
use softray::optim::{Evaluation, Fit, LargeSteps, LargeStepsConfig, Rate, Report, Step};
use softray::photographs::{Batches, Photograph, crop_to_masks};
use softray::prelude::*;

use super::Set;
use super::asset::{Asset, Level, shrunk};
use super::results;

/// Views of a step. The first level finds the light, which is hard to tell from the base color: it takes larger steps with
/// less noise.
const VIEWS: usize = 4;
const MORE_VIEWS: usize = 8;
/// Up to this size of an atlas, each texel has its own metallic and roughness; above it, each 2 × 2 block.
const FINE: usize = 160;
/// The mean of the base color at the start.
const BASE: f64 = 0.5;
/// The most pixels of the first level, along the longest side.
const FIRST: usize = 63;

pub struct Stage {
    /// The longest side of photographs, in pixels.
    pub size: usize,
    /// Whether it is the last one, which leaves the mesh as it is.
    last: bool,
    pub views: Vec<Photograph>,
    /// The width of a pixel at the object, in radii of the region.
    pixel: f64,
    options: RenderOptions,
}

impl Stage {
    pub fn new(set: &Set, size: usize, last: bool, bounces: u32) -> Result<Self> {
        let shrunk = set.train.iter().map(|p| p.shrunk(size));
        let views = crop_to_masks(&shrunk.collect::<Result<Vec<_>>>()?, 2)?;
        let [width, height] = views[0].camera.size;
        Ok(Self {
            size,
            last,
            views,
            pixel: set.distance / (set.focal * size as f64),
            options: RenderOptions::new(width, height)
                .with_samples(if size > FIRST { 4 } else { 8 })
                .with_bounces(bounces)
                .with_opacity(),
        })
    }

    /// Makes the mesh even and sound, an atlas for it, and parameters from those of the level before.
    pub fn start(
        &self,
        set: &Set,
        mesh: &mut TriangleMesh,
        before: Option<(Asset, Level)>,
        world: bool,
        device: &Device,
    ) -> Result<(Asset, Level)> {
        let old = mesh.clone();
        let edge = 1.4 * self.pixel;
        let sound = RepairOptions::default().with_edge_length(edge);
        *mesh = remesh(&repair(mesh, &sound)?.mesh, &RemeshOptions::uniform(edge))?.mesh;
        *mesh = repair(mesh, &sound)?.mesh;
        let side = (1.5 * (mesh.area() / 0.6).sqrt() / self.pixel).ceil() as usize;
        let share = if side > FINE { 2 } else { 1 };
        let side = side.max(32).next_multiple_of(share);
        let options = AtlasOptions {
            gutter: 2 * share,
            ..AtlasOptions::default()
        };
        let atlas = Atlas::new(&mesh.positions, &mesh.faces, side, &options)?;
        let side = atlas.size;
        let places = atlas.texels().bake::<3>(|face, at| {
            let corners = mesh.faces[face as usize].map(|v| mesh.positions[v as usize]);
            [0, 1, 2].map(|i| (0..3).map(|k| at[k] * corners[k][i]).sum::<f64>() as f32)
        });
        let places = Tensor::<1>::from_floats(places.as_slice(), device).reshape([side, side, 3]);
        let mut level = Level {
            faces: mesh.faces.clone(),
            places: shrunk(places, share)?,
            atlas,
            still: None,
            world,
        };
        let auto = device.clone().autodiff();
        let vertices = Mesh::from_host(&mesh.positions, mesh.faces.clone(), &auto).vertices;
        let vertices = Param::from_tensor(vertices);
        let Some((before, from)) = before else {
            // Colors are what white light would show.
            let light = set.brightness.iter().sum::<f64>() / 3.0 / BASE;
            let color = set.brightness.map(|b| (b / light).min(0.95) as f32);
            let color = Tensor::<1>::from_floats(color, device).reshape([1, 1, 3]);
            let asset = Asset {
                vertices,
                base: TextureParams::from_image(&color.repeat(&[side, side, 1]), &auto)?,
                surface: SurfaceNetworkConfig::new().init(&auto)?,
                normals: None,
                sky: EnvironmentParamsConfig::new(16, 32)
                    .with_radiance([light; 3])
                    .init(&auto)?,
                exposure: ExposureParamsConfig::new(set.train.len()).init(&auto)?,
            };
            return Ok((asset, level));
        };
        let texels = HostImage::from_tensor(&before.base.texels())?;
        let textured = Textured {
            positions: &old.positions,
            faces: &old.faces,
            uvs: &from.atlas.uvs,
            uv_faces: &from.atlas.faces,
            texels: &texels.pixels,
            shape: [from.atlas.size; 2],
        };
        let texels = level.atlas.texels();
        let texels = transfer::<3>(&textured, &mesh.positions, &mesh.faces, &texels)?;
        let base = HostImage::new(side, side, texels)?.into_tensor(device);
        let mut asset = Asset {
            vertices,
            base: TextureParams::from_image(&base, &auto)?,
            sky: before.sky.resized(if self.last { 32 } else { 16 })?,
            ..before
        };
        if self.last {
            asset.normals = Some(NormalMapParamsConfig::new(side, side).init(&auto)?);
            let still = level.mesh(asset.vertices.val().inner(), device);
            level.still = Some(still.mikktspace_tangents());
        }
        Ok((asset, level))
    }

    /// The loss of a step, by two renders: one for the errors, and one for the derivatives.
    fn loss(
        &self,
        asset: &Asset,
        level: &Level,
        views: &[usize],
        step: &Step,
        device: &Device,
    ) -> Result<Evaluation> {
        let shown: Vec<&Photograph> = views.iter().map(|&i| &self.views[i]).collect();
        let surface = asset.surface(level)?;
        let [metallic, roughness] = surface.clone();
        // Rough metal looks as paint does: paint is what most things have.
        let metal = (metallic * roughness).mean();
        let object = asset.object(level, surface);
        let batch = asset.batch(&object, level.world, &shown)?;
        // Both renders share the BVH.
        let options = self.options.clone().with_cache(&HierarchyCache::new());
        let more = options.clone().with_samples(2 * options.samples);
        let errors = render_batch(&batch, &step.options(&more, 0))?;
        let image = render_batch(&batch, &step.options(&options, 1))?;
        let factors = asset.exposure.factors(views)?;
        let loss = PhotographLoss::new(&shown, device)?;
        let errors = loss.forward(&errors, &image, Some(factors))?;
        // Colors are judged under white light, so a penalty keeps the light near white.
        let sky = asset.sky.texels();
        let gray = sky.clone().mean_dim(2);
        let power = gray.clone().detach().powi_scalar(2).mean();
        let color = (sky - gray).powi_scalar(2).mean() * 3.0 / power;
        let mut smooth = loss::smoothness(asset.sky.log_radiance.val())? * 3e-4
            + loss::smoothness(asset.base.logit_texels.val())? * 0.005
            + metal * 0.03
            + color * 0.02;
        if let Some(normals) = &asset.normals {
            smooth = smooth + loss::smoothness(normals.slopes.val())? * 0.02;
        }
        let loss = errors.color * 40.0 + errors.silhouette * 10.0 + smooth;
        Ok(Evaluation::new(loss).with_value("PSNR", errors.psnr))
    }

    /// The number of steps that this many seconds are enough for.
    pub fn steps_in(
        &self,
        seconds: f64,
        asset: &Asset,
        level: &Level,
        device: &Device,
    ) -> Result<usize> {
        let clock = Instant::now();
        self.fit(asset.clone(), level, 5, None, device)?;
        let steps = 5.0 * seconds / clock.elapsed().as_secs_f64();
        Ok((steps as usize).clamp(20, 1000))
    }

    /// Fits, with checkpoints in a folder.
    pub fn fit(
        &self,
        asset: Asset,
        level: &Level,
        steps: usize,
        folder: Option<&Path>,
        device: &Device,
    ) -> Result<Asset> {
        let mesh = Mesh::new(asset.vertices.val().inner(), level.faces.clone());
        let large = LargeSteps::from_mesh(&mesh, &LargeStepsConfig::default().with_lambda(4.0))?;
        let group = ParamGroup::from_path;
        let optimizer = AdamConfig::new()
            .init()
            .with_group(group("vertices"), large, None);
        let first = self.size <= FIRST;
        let falling = |rate: f64| Rate::exponential(rate, 0.2 * rate);
        let of_sky = if first { 0.4 } else { 0.2 };
        let mut fit = Fit::new(asset, optimizer, steps)
            .with_rate(falling(0.003))
            .with_rate_of(group("base.logit_texels"), falling(0.2))
            .with_rate_of(group("vertices"), Rate::exponential(0.09, 0.004))
            .with_rate_of(group("sky.log_radiance"), falling(of_sky))
            .with_progress(false);
        if self.last {
            fit = fit.with_rate_of(group("normals.slopes"), Rate::constant(0.004));
        }
        if let Some(folder) = folder {
            let bar = results::bar(steps, self.size);
            fit = fit.with_folder(folder.join(self.size.to_string()));
            fit = fit.on_step(1, move |report: &Report<Asset>| {
                let values = report
                    .history
                    .rows
                    .iter()
                    .rev()
                    .take(10)
                    .map(|row| row.values[0]);
                let count = report.history.rows.len().min(10) as f64;
                bar.set_position(report.step.index as u64 + 1);
                bar.set_message(format!("{:.1} dB", values.sum::<f64>() / count));
                Ok(true)
            });
        }
        let all: Vec<usize> = (0..self.views.len()).collect();
        let batches = Batches::new(&all, if first { MORE_VIEWS } else { VIEWS }, 1)?;
        let fitted = fit.run(|asset: &Asset, step: &Step| {
            self.loss(asset, level, &batches.views(step.index), step, device)
        })?;
        Ok(fitted.module)
    }
}
