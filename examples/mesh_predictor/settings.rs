//! How large everything is.

use softray::optim::BlurSchedule;

use super::render::footprint;

/// Sizes of data, network and training.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Objects to learn from, and others to validate with.
    pub train: usize,
    pub validation: usize,
    /// Images of each object; the first is what the network may see.
    pub views: usize,
    /// Subdivisions of the ball, and the highest degree of its offsets.
    pub subdivisions: u32,
    pub degree: usize,
    /// Channels after each halving of the image, and of the hidden layer.
    pub channels: Vec<usize>,
    pub hidden: usize,
    pub steps: usize,
    /// Objects of a step, each rendered from two views, twice.
    pub batch: usize,
    /// Paths a pixel of each render.
    pub samples: u32,
    pub rate: f64,
    /// Evaluations by the validation set during training.
    pub evaluations: usize,
}

impl Settings {
    /// Under a minute on two cores.
    pub fn quick() -> Self {
        Self {
            train: 96,
            validation: 12,
            views: 3,
            subdivisions: 2,
            degree: 4,
            channels: vec![8, 16, 32, 32],
            hidden: 64,
            steps: 120,
            batch: 8,
            samples: 1,
            rate: 3e-3,
            evaluations: 5,
        }
    }

    /// A few seconds, for tests.
    #[cfg(test)]
    pub fn tiny() -> Self {
        Self {
            train: 32,
            validation: 6,
            views: 2,
            subdivisions: 1,
            degree: 2,
            hidden: 32,
            steps: 60,
            batch: 4,
            evaluations: 2,
            ..Self::quick()
        }
    }

    /// Half an hour on two cores.
    pub fn full() -> Self {
        Self {
            train: 640,
            validation: 48,
            views: 3,
            subdivisions: 3,
            degree: 8,
            channels: vec![16, 32, 64, 128],
            hidden: 256,
            steps: 600,
            batch: 16,
            samples: 1,
            rate: 1e-3,
            evaluations: 6,
        }
    }

    /// Edges two pixels wide at first, and half a pixel after two thirds of the steps.
    pub fn blur(&self) -> softray::Result<BlurSchedule> {
        let square = |pixels: f64| (pixels * footprint()).powi(2);
        BlurSchedule::decay(square(2.0), square(0.5), (self.steps * 2 / 3).max(1))
    }
}
