//! The search for the place of a ring of which only the shadow is seen.

use burn::module::{Module, Param};
use burn::optim::{AdamConfig, GradientsParams, ModuleOptimizer};
use softray::prelude::*;
use wasm_bindgen::prelude::*;

use crate::rgba;
use crate::room::Parts;

/// Columns and rows of the images that are compared.
const SIZE: usize = 32;
const SAMPLES: u32 = 4;
const STEPS: usize = 150;

#[derive(Module, Debug)]
struct Caster {
    place: Param<Tensor<1>>,
}

/// A fit of the ring's place to an image of its shadow.
#[wasm_bindgen]
pub struct Search {
    parts: Parts,
    camera: Camera,
    cache: HierarchyCache,
    target: Tensor<3>,
    caster: Caster,
    optimizer: ModuleOptimizer,
    blur: BlurSchedule,
    step: usize,
    /// The mean of the renders of the last steps.
    seen: Option<Tensor<3>>,
}

fn options(samples: u32) -> RenderOptions {
    RenderOptions::new(SIZE, SIZE)
        .with_samples(samples)
        .with_bounces(0)
}

#[wasm_bindgen]
impl Search {
    /// Starts at one place and searches for another, of which the image is given alone.
    #[wasm_bindgen(constructor)]
    pub fn new(start: &[f64], target: &[f64]) -> Result<Self, JsError> {
        let parts = Parts::new();
        // It looks down at the floor, so that the ring is above the image.
        let camera = Camera::look_at([0.0, 1.3, 4.0], [0.0, 0.0, 0.0]).with_fov_y(36.0);
        let place = |at: &[f64]| Tensor::<1>::from_floats(at, &parts.device);
        let scene = parts.scene(place(target).into());
        let target = render(&scene, &camera, &options(256))?.radiance;
        let caster = Caster {
            place: Param::from_tensor(place(start).autodiff()),
        };
        Ok(Self {
            camera,
            cache: HierarchyCache::new(),
            target,
            caster,
            optimizer: AdamConfig::new().with_beta_2(0.99).init(),
            blur: BlurSchedule::decay(50.0, 1.0, STEPS * 2 / 3)?,
            step: 0,
            seen: None,
            parts,
        })
    }

    /// Takes a step, and returns the place x, y, z, the loss, the number of steps so far, and how many there are.
    pub fn step(&mut self) -> Result<Vec<f64>, JsError> {
        let place = self.caster.place.val();
        let scene = self.parts.scene(place.into());
        // Two images of different random numbers, so that noise is no part of the loss.
        let see = |k: usize| {
            let options = options(SAMPLES)
                .with_seed((2 * self.step + k) as u64)
                .with_visibility(Visibility::Cone {
                    angle: self.blur.at(self.step),
                    pixels: 0.5,
                })
                .with_cache(&self.cache);
            render(&scene, &self.camera, &options)
        };
        let (a, b) = (see(0)?.radiance, see(1)?.radiance);
        let both = ((a.clone() + b.clone()) * 0.5).inner();
        self.seen = Some(match self.seen.take() {
            Some(seen) => seen * 0.6 + both * 0.4,
            None => both,
        });
        let loss = loss::mse_unbiased(a, b, self.target.clone())?;
        let value = f64::from(loss.clone().into_scalar::<f32>());
        let gradients = GradientsParams::from_grads(loss.backward(), &self.caster);
        let rate = 0.09 * 0.1f64.powf(self.step as f64 / STEPS as f64);
        self.caster = (self.optimizer).step(rate, self.caster.clone(), gradients);
        self.step += 1;
        let place = Parameter::<3>::from(self.caster.place.val()).values()?;
        Ok([&place[..], &[value, self.step as f64, STEPS as f64]].concat())
    }

    /// The number of paths of a step.
    pub fn paths() -> usize {
        2 * SIZE * SIZE * SAMPLES as usize
    }

    /// Returns the image that is searched for.
    pub fn target(&self) -> Result<Vec<u8>, JsError> {
        Ok(rgba(&HostImage::from_tensor(&self.target)?))
    }

    /// Returns the mean of the images of the last steps.
    pub fn seen(&self) -> Result<Vec<u8>, JsError> {
        let seen = self.seen.as_ref().unwrap_or(&self.target);
        Ok(rgba(&HostImage::from_tensor(seen)?))
    }

    /// Returns the differences of the pixels of both images, as means of their channels.
    pub fn difference(&self) -> Result<Vec<f32>, JsError> {
        let seen = self.seen.as_ref().unwrap_or(&self.target).clone();
        let difference = HostImage::from_tensor(&(seen - self.target.clone()))?;
        let pixels = difference.pixels.chunks_exact(3);
        Ok(pixels.map(|p| p.iter().sum::<f32>() / 3.0).collect())
    }
}
