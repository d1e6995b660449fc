//! Sizes of data, network and training.

use softray::optim::BlurSchedule;

use super::render::pixel;

/// Sizes of data, network and training.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The numbers of training and validation objects.
    pub train: usize,
    pub validation: usize,
    /// Images per object. The first is the input of the network.
    pub views: usize,
    /// Subdivisions of the ball for training, and for measurements and figures. Offsets are functions on the sphere,
    /// so one network serves both. The coarse ball renders in a fraction of the time, since blur reaches fewer of its
    /// faces.
    pub subdivisions: [u32; 2],
    /// The highest degree of the harmonics of the offsets.
    pub degree: usize,
    /// Channels after each halving of the image, and features of the hidden layer.
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
}

impl Settings {
    /// Takes under a minute on two cores.
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

    /// Takes a few seconds, for tests.
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

    /// Takes about half an hour on two idle cores.
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

    /// Returns a schedule with cones of 4 pixels at first, and of half a pixel after half of the steps.
    pub fn blur(&self) -> softray::Result<BlurSchedule> {
        BlurSchedule::decay(4.0 * pixel(), 0.5 * pixel(), (self.steps / 2).max(1))
    }
}
