//! How large everything is.

use softray::optim::BlurSchedule;

use super::render::pixel;

/// Sizes of data, network and training.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Objects to learn from, and others to validate with.
    pub train: usize,
    pub validation: usize,
    /// Images of each object; the first is what the network may see.
    pub views: usize,
    /// Subdivisions of the ball: of that which is trained, and of that which is measured and shown.
    /// Offsets are functions on the sphere, so that one network serves both; the coarse one is rendered
    /// in a fraction of the time, as blur reaches fewer of its faces.
    pub subdivisions: [u32; 2],
    /// The highest degree of the offsets.
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
            train: 80,
            validation: 12,
            views: 3,
            subdivisions: [2, 3],
            degree: 4,
            channels: vec![8, 16, 32, 32],
            hidden: 64,
            steps: 100,
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
            subdivisions: [1, 2],
            degree: 2,
            hidden: 32,
            steps: 60,
            batch: 4,
            evaluations: 2,
            ..Self::quick()
        }
    }

    /// About half an hour on two cores that have nothing else to do.
    pub fn full() -> Self {
        Self {
            train: 3072,
            validation: 96,
            views: 3,
            subdivisions: [2, 3],
            degree: 8,
            channels: vec![16, 32, 64, 128],
            hidden: 256,
            steps: 4800,
            batch: 16,
            samples: 1,
            rate: 1.5e-3,
            evaluations: 12,
        }
    }

    /// Cones of 4 pixels at first, and of half a pixel after half of the steps.
    pub fn blur(&self) -> softray::Result<BlurSchedule> {
        BlurSchedule::decay(4.0 * pixel(), 0.5 * pixel(), (self.steps / 2).max(1))
    }
}
