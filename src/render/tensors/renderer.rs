//! Renders one view with tensor operations.

use std::sync::Arc;
use std::sync::atomic::AtomicUsize;

use burn::tensor::Tensor;
use rayon::prelude::*;

use super::outputs::outputs;
use crate::device::is_cpu;
use crate::error::{Error, Result};
use crate::render::options::{RenderOptions, sampler};
use crate::render::tiles::{Tile, tiles};
use crate::scene::{Camera, Flattened};
use crate::tensors::{
    Candidates, Cones, Diagnostics, Lights, PathSettings, RayStatistics, Rays, Sight, Sky, Tracer,
    Transport, VisibilityForm, hierarchy_of, trace,
};
use softray_kernels::accel::Hierarchy;
use softray_kernels::model::filter::PixelFilter;
use softray_kernels::sampling::{Dimensions, Sampler};

/// A view that is ready to trace.
pub(super) struct TensorRenderer<'a> {
    pub scene: &'a Flattened,
    camera: &'a Camera,
    options: &'a RenderOptions,
    sampler: Sampler,
    lights: Arc<Lights>,
    sky: Option<Sky>,
    settings: PathSettings,
    sight: Sight,
    /// The pixel filter, for cones only.
    filter: Option<PixelFilter>,
    /// The pixels to render; all if `None`.
    pixels: Option<Arc<Vec<u32>>>,
}

/// Radiance and the other requested outputs as rows `[C, P]`, and counts.
pub(super) struct Traced {
    pub rows: Tensor<2>,
    pub statistics: RayStatistics,
    pub diagnostics: Option<Diagnostics>,
}

impl<'a> TensorRenderer<'a> {
    pub fn new(
        scene: &'a Flattened,
        camera: &'a Camera,
        options: &'a RenderOptions,
        pixels: Option<Arc<Vec<u32>>>,
        hierarchy: Option<Arc<Hierarchy>>,
    ) -> Result<Self> {
        let (sight, filter) = sight(scene, camera, options, hierarchy)?;
        Ok(Self {
            scene,
            camera,
            options,
            sampler: sampler(options),
            lights: Arc::new(Lights::new(scene, options.sampling.emitters)?),
            sky: Sky::new(scene)?,
            settings: PathSettings {
                diagnostics: options.diagnostics,
                bounces: options.bounces,
                roulette_after: options.roulette_after,
                indirect_clamp: options.indirect_clamp,
                least_roughness: options.path_regularization,
                albedo: options.outputs.albedo,
                sampling: options.sampling,
            },
            sight,
            filter,
            pixels,
        })
    }

    /// The BVH, if there is one.
    pub fn hierarchy(&self) -> Option<Arc<Hierarchy>> {
        match &self.sight {
            Sight::Cones(cones) => Some(cones.hierarchy()),
            Sight::Softmax(_, candidates) => candidates.as_ref().map(Candidates::hierarchy),
        }
    }

    /// Returns the means over samples.
    pub fn render(&self, tiles: &[Tile]) -> Result<Traced> {
        let done = AtomicUsize::new(0);
        let run = |tile: &Tile| {
            let sums = self.tile(tile);
            self.options.progress.tile(&done, tiles.len());
            sums
        };
        let results = if is_cpu(&self.scene.context.device) {
            tiles.par_iter().map(run).collect::<Result<Vec<_>>>()?
        } else {
            tiles.iter().map(run).collect::<Result<_>>()?
        };
        let mut statistics = RayStatistics::default();
        let mut diagnostics: Option<Diagnostics> = None;
        // Tiles are in order of pixels, then samples.
        let mut columns: Vec<Tensor<2>> = Vec::new();
        for (tile, result) in tiles.iter().zip(results) {
            statistics.merge(&result.statistics);
            if let Some(found) = &result.diagnostics {
                diagnostics.get_or_insert_default().merge(found);
            }
            if tile.from == 0 {
                columns.push(result.rows);
            } else if let Some(sum) = columns.pop() {
                columns.push(sum + result.rows);
            }
        }
        // A multiplication, since the backward pass of a division rounds 1/n to f32.
        let rows = Tensor::cat(columns, 1) * f64::from(self.options.samples).recip();
        Ok(Traced {
            rows,
            statistics,
            diagnostics,
        })
    }

    /// Returns the tiles of the forward pass and of the backward pass, whose tape grows with the length of its paths.
    /// Tiles have fewer rays if rays are paired with many triangles, on average over some camera rays.
    pub fn tiles(&self) -> Result<[Vec<Tile>; 2]> {
        let step = self.pixels().div_ceil(256);
        let probed = (0..self.pixels()).step_by(step);
        let rays = self.camera_rays(&probed.map(|i| (self.pixel(i), 0)).collect::<Vec<_>>())?;
        let pairs_a_ray = Tracer::new(self.transport()).pairs_a_ray(&rays)?;
        let surfaces = self.settings.bounces as usize + 1;
        let pairs = match is_cpu(&self.scene.context.device) {
            true => [1 << 18, (1 << 16) / surfaces],
            false => [1 << 23, (1 << 23) / surfaces],
        };
        let tiles = |pass: usize| {
            let rays = [1 << 13, ((1 << 14) / surfaces).max(256)][pass];
            let rays = rays
                .min((pairs[pass] as f64 / pairs_a_ray) as usize)
                .max(32);
            tiles(self.options, self.pixels(), 0..self.options.samples, rays)
        };
        Ok([tiles(0), tiles(1)])
    }

    fn pixels(&self) -> usize {
        let all = self.options.width * self.options.height;
        self.pixels.as_ref().map_or(all, |pixels| pixels.len())
    }

    fn pixel(&self, i: usize) -> u32 {
        self.pixels.as_ref().map_or(i as u32, |pixels| pixels[i])
    }

    fn transport(&self) -> Transport<'_> {
        Transport {
            scene: self.scene,
            settings: &self.settings,
            sampler: &self.sampler,
            lights: &self.lights,
            sky: self.sky.as_ref(),
            sight: &self.sight,
        }
    }

    /// Returns the sums over a tile's samples.
    pub fn tile(&self, tile: &Tile) -> Result<Traced> {
        let paths: Vec<(u32, u32)> = (tile.first..tile.first + tile.pixels)
            .map(|i| self.pixel(i))
            .flat_map(|pixel| (tile.from..tile.to).map(move |sample| (pixel, sample)))
            .collect();
        let rays = self.camera_rays(&paths)?;
        let samples = (tile.to - tile.from) as usize;
        let found = trace(self.transport(), rays, &paths, samples)?;
        let statistics = found.statistics.clone();
        let diagnostics = found.diagnostics.clone();
        let rows = Tensor::cat(outputs(self.scene, self.options.outputs, found), 0);
        let channels = rows.dims()[0];
        let rows = rows.reshape([channels * tile.pixels, samples]).sum_dim(1);
        Ok(Traced {
            rows: rows.reshape([channels, tile.pixels]),
            statistics,
            diagnostics,
        })
    }

    fn camera_rays(&self, paths: &[(u32, u32)]) -> Result<Rays> {
        let context = &self.scene.context;
        let (width, height) = (self.options.width, self.options.height);
        let film = |place: fn(usize, usize) -> usize, jitter: Vec<f64>, size: usize| {
            let pixels = paths.iter().map(|p| place(p.0 as usize, width) as f64);
            let values: Vec<f64> = pixels
                .zip(jitter)
                .map(|(p, j)| (p + j) / size as f64)
                .collect();
            context.row(&values)
        };
        let [x, y, ..] = self.sampler.uniform(paths, Dimensions::film());
        let [x, y] = match &self.filter {
            None => [x, y],
            Some(filter) => [x, y].map(|numbers| {
                let of = |u: f64| 0.5 + f64::from(filter.sample(u as f32));
                numbers.into_iter().map(of).collect()
            }),
        };
        let spread = match &self.filter {
            Some(filter) if filter.cone_radius() > 0.0 => {
                let row = |jitter: &[f64], size: usize| {
                    let of = |j: &f64| filter.spread(*j as f32 - 0.5) / size as f64;
                    context.row(&jitter.iter().map(of).collect::<Vec<_>>())
                };
                Some([row(&x, width), row(&y, height)])
            }
            _ => None,
        };
        let film = [
            film(|pixel, width| pixel % width, x, width),
            film(|pixel, width| pixel / width, y, height),
        ];
        let disk = self.camera.has_lens().then(|| {
            let [radius, angle, ..] = self.sampler.uniform(paths, Dimensions::lens_and_time());
            let on_disk = |along: fn(f64) -> f64| {
                let polar = radius.iter().zip(&angle);
                let values = polar.map(|(r, a)| r.sqrt() * along(std::f64::consts::TAU * a));
                context.row(&values.collect::<Vec<_>>())
            };
            [on_disk(f64::cos), on_disk(f64::sin)]
        });
        let moves = self.scene.triangles.velocity.is_some();
        let time = moves.then(|| {
            let [_, _, time, _] = self.sampler.uniform(paths, Dimensions::lens_and_time());
            context.row(&time)
        });
        let (origin, direction) = self.camera.rays(
            context,
            (self.scene.normalization.center, self.scene.unit),
            width as f64 / height as f64,
            &film,
            spread.as_ref(),
            disk.as_ref(),
        )?;
        Ok(Rays {
            origin,
            direction,
            time,
            departure: None,
            arrival: None,
        })
    }
}

/// Returns the visibility of a render, with the BVH that it needs, and the pixel filter.
fn sight(
    scene: &Flattened,
    camera: &Camera,
    options: &RenderOptions,
    hierarchy: Option<Arc<Hierarchy>>,
) -> Result<(Sight, Option<PixelFilter>)> {
    let hierarchy = || match hierarchy {
        Some(hierarchy) => Ok(hierarchy),
        None => {
            let cache = options.cache.clone().unwrap_or_default();
            hierarchy_of(&scene.triangles, &cache.scenes(1)[0].boxes)
        }
    };
    match options.form().form(scene.unit) {
        VisibilityForm::Cones { angle, pixels } => {
            let half_height = camera.half_height()?;
            let least = options.blur_slope();
            let wide = least * 0.5 * options.height as f64 / half_height;
            let cones = Cones::new(hierarchy()?, scene.holes.clone(), angle, &sampler(options));
            Ok((
                Sight::Cones(cones),
                Some(PixelFilter::of_cone(pixels, wide)),
            ))
        }
        VisibilityForm::Softmax(form, of_form) => {
            if scene.holes.is_some() {
                let expected = "none under the softmax: holes are for Visibility::cone";
                return Err(Error::invalid("scene", "alpha mask", "a mask", expected));
            }
            // Diagnostics count all pairs, and GPUs avoid the host.
            let is_dense =
                of_form.brute_force || options.diagnostics || !is_cpu(&scene.context.device);
            let candidates = match is_dense {
                true => None,
                false => Some(Candidates::new(hierarchy()?, of_form.cutoff)),
            };
            Ok((Sight::Softmax(form, candidates), None))
        }
    }
}
