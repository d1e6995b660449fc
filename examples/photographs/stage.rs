//! A level: its start, its fit and what it reaches.

use std::path::Path;
use std::time::Instant;

use burn::module::{Param, ParamGroup};
use burn::optim::AdamConfig;
use softray::Result;
use softray::atlas::{Atlas, AtlasOptions, Textured, transfer};
use softray::meshing::{RemeshOptions, RepairOptions, TriangleMesh, remesh, repair};
use softray::modules::{EnvironmentParamsConfig, NormalMapParamsConfig};
use softray::optim::{Evaluation, Fit, LargeSteps, LargeStepsConfig, Rate, Report, Step};
use softray::photographs::{Batches, Photograph, crop_to_masks};
use softray::prelude::*;

use super::Set;
use super::asset::{Asset, Level, Targets, compare};
use super::results;

/// Views of a step. A light that stands in the world is hard to tell from the base color, so that its first level takes
/// larger steps with less noise.
const VIEWS: usize = 4;
const MORE_VIEWS: usize = 8;
/// The most pixels of the first level, along the longest side.
const FIRST: usize = 63;

pub struct Stage {
    /// The longest side of photographs, in pixels.
    pub size: usize,
    /// Whether it is the last one, which leaves the mesh as it is.
    last: bool,
    /// See [`Stage::for_trial`].
    trial: bool,
    pub views: Vec<Photograph>,
    /// The width of a pixel at the object, in radii of the region.
    pixel: f64,
    options: RenderOptions,
}

impl Stage {
    pub fn new(set: &Set, size: usize, last: bool) -> Result<Self> {
        let shrunk = set.train.iter().map(|p| p.shrunk(size));
        let views = crop_to_masks(&shrunk.collect::<Result<Vec<_>>>()?, 2)?;
        let [width, height] = views[0].camera.size;
        Ok(Self {
            size,
            last,
            trial: false,
            views,
            pixel: set.distance / (set.focal * size as f64),
            options: RenderOptions::new(width, height)
                .with_samples(if size > FIRST { 4 } else { 8 })
                .with_bounces(0)
                .with_opacity(),
        })
    }

    /// The same for a short fit that compares two kinds of light, on equal terms.
    pub fn for_trial(mut self) -> Self {
        self.trial = true;
        self
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
        let options = AtlasOptions {
            gutter: 2,
            ..AtlasOptions::default()
        };
        let atlas = Atlas::new(&mesh.positions, &mesh.faces, side.max(32), &options)?;
        let mut level = Level {
            faces: mesh.faces.clone(),
            atlas,
            still: None,
            world,
        };
        let auto = device.clone().autodiff();
        let vertices = Mesh::from_host(&mesh.positions, mesh.faces.clone(), &auto).vertices;
        let vertices = Param::from_tensor(vertices);
        let Some((before, from)) = before else {
            let light = set.brightness / 0.5;
            let asset = Asset {
                vertices,
                base: flat([0.0; 3], side, &auto),
                // Highlights of a smooth surface show where a standing light is.
                surface: match self.finds_light(world) {
                    true => flat([0.0, -2.0], side, &auto),
                    false => flat([-1.0, -1.2], 1, &auto),
                },
                normals: None,
                sky: EnvironmentParamsConfig::new(16, 32)
                    .with_radiance([light; 3])
                    .init(&auto)?,
                gains: Param::from_tensor(Tensor::zeros([set.train.len(), 3], &auto)),
            };
            return Ok((asset, level));
        };
        let side = level.atlas.size;
        let move_to = |texture: &Param<Tensor<3>>| -> Result<Param<Tensor<3>>> {
            moved(texture, (&old, &from.atlas), (mesh, &level.atlas), &auto)
        };
        let mut asset = Asset {
            vertices,
            base: move_to(&before.base)?,
            surface: move_to(&before.surface)?,
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

    /// The loss of a step.
    fn loss(
        &self,
        asset: &Asset,
        level: &Level,
        views: &[usize],
        options: &RenderOptions,
        device: &Device,
    ) -> Result<Evaluation> {
        let shown: Vec<&Photograph> = views.iter().map(|&i| &self.views[i]).collect();
        let image = render_batch(&asset.batch(level, &shown, device)?, options)?;
        compare(asset, &image, Targets::new(&shown, device), views)
    }

    /// Whether a light is searched that stands in the world.
    fn finds_light(&self, world: bool) -> bool {
        world && self.size <= FIRST && !self.trial
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
        let large = LargeSteps::from_mesh(&mesh, &LargeStepsConfig::default().with_lambda(16.0))?;
        let group = ParamGroup::from_path;
        let optimizer = AdamConfig::new()
            .init()
            .with_group(group("vertices"), large, None);
        let finds_light = self.finds_light(level.world);
        let rate = if self.size > FIRST { 0.1 } else { 0.2 };
        let (of_surface, of_sky) = if finds_light { (0.7, 2.0) } else { (0.5, 1.0) };
        let falling = |rate: f64| Rate::exponential(rate, 0.2 * rate);
        let mut fit = Fit::new(asset, optimizer, steps)
            .with_rate(falling(rate))
            .with_rate_of(group("vertices"), Rate::exponential(0.09, 0.036))
            .with_rate_of(group("surface"), falling(of_surface * rate))
            .with_rate_of(group("sky.log_radiance"), falling(of_sky * rate))
            .with_rate_of(group("gains"), Rate::constant(0.003))
            .with_progress(false);
        if self.last {
            fit = fit.with_rate_of(group("normals.slopes"), Rate::constant(0.01));
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
        let batches = Batches::new(&all, if finds_light { MORE_VIEWS } else { VIEWS }, 1)?;
        let fitted = fit.run(|asset: &Asset, step: &Step| {
            let options = step.options(&self.options, 0);
            self.loss(asset, level, &batches.views(step.index), &options, device)
        })?;
        Ok(fitted.module)
    }
}

/// A texture of one mesh, looked up for another.
fn moved(
    texture: &Param<Tensor<3>>,
    (old, old_atlas): (&TriangleMesh, &Atlas),
    (new, atlas): (&TriangleMesh, &Atlas),
    device: &Device,
) -> Result<Param<Tensor<3>>> {
    let [side, _, channels] = texture.dims();
    // Images have three channels.
    let rest = Tensor::zeros([side, side, 3 - channels], &texture.device());
    let texels = HostImage::from_tensor(&Tensor::cat(vec![texture.val(), rest], 2))?;
    let from = Textured {
        positions: &old.positions,
        faces: &old.faces,
        uvs: &old_atlas.uvs,
        uv_faces: &old_atlas.faces,
        texels: &texels.pixels,
        shape: [side; 2],
    };
    let texels = transfer::<3>(&from, &new.positions, &new.faces, &atlas.texels())?;
    let map = HostImage::new(atlas.size, atlas.size, texels)?.into_tensor(device);
    Ok(Param::from_tensor(map.narrow(2, 0, channels).detach()))
}

/// A texture of one value.
fn flat<const C: usize>(value: [f32; C], side: usize, device: &Device) -> Param<Tensor<3>> {
    let texel = Tensor::<1>::from_floats(value, device).reshape([1, 1, C]);
    Param::from_tensor(texel.repeat(&[side, side, 1]).detach())
}
