//! Sizes of data, network and training.

use softray::modules::TetrahedralGrid;
use softray::optim::BlurSchedule;
use softray::prelude::RenderOptions;

use super::render::{options, pixel};

/// Sizes of data, network and training.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Rows and columns of an image, a multiple of 2^(number of `channels`).
    pub size: usize,
    /// The numbers of training and validation objects.
    pub train: usize,
    pub validation: usize,
    /// Images per object. The first is the input of the network.
    pub views: usize,
    /// Small silhouettes per object, at least `views`, with `nodes` rows and columns: of the images' cameras, and of others.
    pub silhouettes: usize,
    /// Nodes along each axis of the grid of distances: the size divided by 2, 4, … or 2^(number of `channels`).
    pub nodes: usize,
    /// Channels after each halving of the image, multiples of 4, and features of the hidden layer.
    pub channels: Vec<usize>,
    pub hidden: usize,
    pub steps: usize,
    /// Objects per step. Each is rendered twice from two views.
    pub batch: usize,
    /// Paths per pixel of each render.
    pub samples: u32,
    pub rate: f64,
    /// Evaluations on the validation set during training.
    pub evaluations: usize,
    /// Whether renders are compared with depth, too.
    pub depth: bool,
    /// Whether bodies are deformed balls in place of surfaces of any topology.
    pub template: bool,
}

impl Settings {
    /// Takes about two minutes on two cores.
    pub fn quick() -> Self {
        Self {
            size: 64,
            train: 200,
            validation: 16,
            nodes: 32,
            channels: vec![16, 32, 48, 64],
            hidden: 64,
            steps: 150,
            rate: 2e-3,
            evaluations: 4,
            ..Self::full()
        }
    }

    /// Takes a few seconds, for tests.
    #[cfg(test)]
    pub fn tiny() -> Self {
        Self {
            size: 32,
            train: 32,
            validation: 6,
            views: 2,
            silhouettes: 5,
            nodes: 16,
            channels: vec![8, 16, 16],
            hidden: 32,
            steps: 60,
            batch: 4,
            evaluations: 2,
            ..Self::quick()
        }
    }

    /// Takes one to three hours on two cores.
    pub fn full() -> Self {
        Self {
            size: 128,
            train: 2048,
            validation: 96,
            views: 3,
            silhouettes: 9,
            nodes: 32,
            channels: vec![16, 32, 64, 96, 128],
            hidden: 256,
            steps: 4000,
            batch: 8,
            samples: 1,
            rate: 1.5e-3,
            evaluations: 10,
            depth: false,
            template: false,
        }
    }

    /// The name of the picture and of the folder with checkpoints.
    pub fn name(&self) -> &'static str {
        match (self.template, self.depth) {
            (false, false) => "mesh_predictor",
            (false, true) => "mesh_predictor_depth",
            (true, false) => "mesh_predictor_template",
            (true, true) => "mesh_predictor_template_depth",
        }
    }

    /// The grid of distances. It covers 87 % of the input image's width at the origin, and all of it at the front.
    pub fn grid(&self) -> softray::Result<TetrahedralGrid> {
        TetrahedralGrid::new(self.nodes - 1, 1.9)
    }

    /// Returns a schedule with cones of 2 pixels of the input image at first, and of half a pixel after half of the steps.
    pub fn blur(&self) -> softray::Result<BlurSchedule> {
        let pixel = pixel(self.size);
        BlurSchedule::decay(2.0 * pixel, 0.5 * pixel, (self.steps / 2).max(1))
    }

    /// Returns [`options`] with depth if it is compared.
    pub fn options(&self, size: usize, samples: u32) -> RenderOptions {
        let options = options(size, samples);
        if self.depth {
            options.with_depth()
        } else {
            options
        }
    }

    /// The share of training that is done before a step, from 0 to 1.
    pub fn done(&self, step: usize) -> f64 {
        step as f64 / self.steps as f64
    }

    /// Rows and columns of the renders of a step: as many as nodes, then twice as many, then those of the images.
    pub fn render_size(&self, step: usize) -> usize {
        let size = match self.done(step) {
            ..0.5 => self.nodes,
            0.5..0.85 => 2 * self.nodes,
            _ => self.size,
        };
        size.min(self.size)
    }
}
