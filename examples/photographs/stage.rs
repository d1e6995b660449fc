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
use softray::scene::CornerAttribute;

use super::Set;
use super::asset::{Asset, Level, Targets, compare};
use super::results;

/// Rendered views and samples a pixel of a step.
const VIEWS: usize = 4;
const SAMPLES: [u32; 2] = [8, 4];

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
    pub fn new(set: &Set, size: usize, last: bool) -> Result<Self> {
        let shrunk = set.train.iter().map(|p| p.shrunk(size));
        let views = crop_to_masks(&shrunk.collect::<Result<Vec<_>>>()?, 2)?;
        let [width, height] = views[0].camera.size;
        Ok(Self {
            size,
            last,
            views,
            pixel: set.distance / (set.focal * size as f64),
            options: RenderOptions::new(width, height)
                .with_samples(SAMPLES[usize::from(size > 32)])
                .with_bounces(0)
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
                surface: flat([-1.0, -1.2], 1, &auto),
                normals: None,
                sky: EnvironmentParamsConfig::new(16, 32)
                    .with_radiance([light; 3])
                    .init(&auto)?,
                gains: Param::from_tensor(Tensor::zeros([set.train.len(), 3], &auto)),
            };
            return Ok((asset, level));
        };
        let base = before
            .base
            .val()
            .into_data()
            .try_into_vec::<f32>()
            .expect("floats");
        let textured = Textured {
            positions: &old.positions,
            faces: &old.faces,
            uvs: &from.atlas.uvs,
            uv_faces: &from.atlas.faces,
            texels: &base,
            shape: [from.atlas.size; 2],
        };
        let texels = level.atlas.texels();
        let base = transfer::<3>(&textured, &mesh.positions, &mesh.faces, &texels)?;
        let side = level.atlas.size;
        let base = Tensor::<1>::from_floats(base.as_slice(), &auto).reshape([side, side, 3]);
        let surface = match before.surface.dims()[0] {
            1 => before.surface.val().repeat(&[side, side, 1]),
            _ => {
                let old = before
                    .surface
                    .val()
                    .into_data()
                    .try_into_vec::<f32>()
                    .expect("floats");
                let textured = Textured {
                    texels: &old,
                    ..textured
                };
                let new = transfer::<2>(&textured, &mesh.positions, &mesh.faces, &texels)?;
                Tensor::<1>::from_floats(new.as_slice(), &auto).reshape([side, side, 2])
            }
        };
        let mut asset = Asset {
            vertices,
            base: Param::from_tensor(base.detach()),
            surface: Param::from_tensor(surface.detach()),
            sky: before.sky.resized(if self.last { 32 } else { 16 })?,
            ..before
        };
        if self.last {
            asset.normals = Some(NormalMapParamsConfig::new(side, side).init(&auto)?);
            let mut still = Mesh::from_host(&mesh.positions, mesh.faces.clone(), device);
            let (uvs, faces) = (&level.atlas.uvs, level.atlas.faces.clone());
            still.uvs = Some(CornerAttribute::from_host(uvs, faces, device));
            level.still = Some(still.smooth_normals().mikktspace_tangents());
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

    fn batches(&self) -> Result<Batches> {
        let all: Vec<usize> = (0..self.views.len()).collect();
        Batches::new(&all, VIEWS, 1)
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
        let rate = if self.size > 32 { 0.1 } else { 0.2 };
        let mut fit = Fit::new(asset, optimizer, steps)
            .with_rate(Rate::exponential(rate, 0.2 * rate))
            .with_rate_of(group("vertices"), Rate::exponential(0.09, 0.036))
            .with_rate_of(group("surface"), Rate::exponential(0.5 * rate, 0.1 * rate))
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
        let batches = self.batches()?;
        let fitted = fit.run(|asset: &Asset, step: &Step| {
            let options = step.options(&self.options, 0);
            self.loss(asset, level, &batches.views(step.index), &options, device)
        })?;
        Ok(fitted.module)
    }
}

/// A texture of one value.
fn flat<const C: usize>(value: [f32; C], side: usize, device: &Device) -> Param<Tensor<3>> {
    let texel = Tensor::<1>::from_floats(value, device).reshape([1, 1, C]);
    Param::from_tensor(texel.repeat(&[side, side, 1]).detach())
}
