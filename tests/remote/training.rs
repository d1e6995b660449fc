//! Trainings over two servers end where those of one Flex device end.

use std::sync::LazyLock;

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use softray::burn;
use softray::optim::{Evaluation, Fit, Part};
use softray::prelude::*;

use crate::common::numbers::furthest;
use crate::common::views::squares;
use crate::server::Server;

static SERVERS: LazyLock<[Server; 2]> = LazyLock::new(|| [Server::start(), Server::start()]);

const STEPS: usize = 20;

#[derive(Module, Debug)]
pub struct Offsets {
    offsets: Param<Tensor<2>>,
}

impl Offsets {
    pub fn new(device: &Device) -> Self {
        let start = shapes::icosphere(1, device).vertices.zeros_like();
        Self {
            offsets: Param::from_tensor(start.autodiff()),
        }
    }

    /// The sum of the squares of the images of the moved ball from some directions, in degrees.
    pub fn loss(&self, views: &[f64], device: &Device) -> softray::Result<Tensor<1>> {
        let ball = shapes::icosphere(1, device);
        let moved = ball.vertices.clone() + self.offsets.val();
        let scene = Scene::new()
            .with_object(Object::new(ball.with_vertices(moved)))
            .with_environment([1.0; 3]);
        let options = RenderOptions::new(12, 12).with_samples(4);
        squares(&scene, views, &options)
    }

    pub fn values(&self) -> Vec<f32> {
        self.offsets.val().inner().into_data().iter().collect()
    }
}

fn views() -> Vec<f64> {
    (0..4).map(|i| 90.0 * f64::from(i)).collect()
}

/// Fits with a share of the views for each device.
fn fitted(devices: &[Device], weights: &[f64]) -> Vec<f32> {
    let (module, views) = (Offsets::new(&Device::flex()), views());
    let fit = Fit::new(module, AdamConfig::new().init(), STEPS).with_progress(false);
    let fitted = fit.run_over(devices, |module: &Offsets, _, part: &Part| {
        let share = part.weighted(&views, weights)?;
        let loss = module.loss(share.as_slice(), &part.device)?;
        Ok(Evaluation::new(loss * (views.len() as f64).recip()))
    });
    fitted.expect("a fit").module.values()
}

fn largest_difference(a: &[f32], b: &[f32]) -> f64 {
    assert!(a.iter().any(|v| v.abs() > 1e-3));
    let [a, b] = [a, b].map(|list| list.iter().copied().map(f64::from).collect::<Vec<_>>());
    furthest(&a, &b)
}

#[test]
fn a_fit_over_two_servers_is_that_of_one_device() {
    let one = fitted(&[Device::flex()], &[1.0]);
    let both = SERVERS.each_ref().map(Server::device);
    for weights in [[1.0, 1.0], [3.0, 1.0]] {
        let two = fitted(&both, &weights);
        assert_eq!(two, fitted(&both, &weights));
        let far = largest_difference(&one, &two);
        assert!(far < 1e-5, "{far}");
    }
}

#[test]
fn shares_of_views() {
    let share = |weights: &[f64], index| {
        let (device, count) = (Device::flex(), 3);
        let part = Part {
            device,
            index,
            count,
        };
        let views = [0, 1, 2, 3, 4, 5, 6];
        Ok::<_, softray::Error>(part.weighted(&views, weights)?.copied().collect::<Vec<_>>())
    };
    let all = |weights: [f64; 3]| [0, 1, 2].map(|i| share(&weights, i).expect("weights"));
    assert_eq!(
        all([4.0, 2.0, 1.0]),
        [vec![0, 1, 2, 3], vec![4, 5], vec![6]]
    );
    assert_eq!(
        all([0.0, 1.0, 0.0]),
        [vec![], vec![0, 1, 2, 3, 4, 5, 6], vec![]]
    );
    for weights in [
        &[1.0, 1.0][..],
        &[0.0; 3],
        &[1.0, -1.0, 1.0],
        &[f64::NAN; 3],
    ] {
        let said = share(weights, 0).expect_err("no weights").to_string();
        assert!(
            said.contains("weights is") && said.contains("3 numbers"),
            "{said}"
        );
    }
}

/// burn's Learner.
#[cfg(feature = "train")]
mod learner {
    use burn::data::dataloader::{DataLoaderBuilder, batcher::Batcher};
    use burn::data::dataset::InMemDataset;
    use burn::optim::SgdConfig;
    use burn::tensor::ExecutionError;
    use burn::train::metric::{Adaptor, LossInput, LossMetric};
    use burn::train::{
        ExecutionStrategy, InferenceStep, ItemLazy, Learner, MultiDeviceOptim, SupervisedTraining,
        TrainOutput, TrainStep,
    };

    use super::*;

    /// Directions of views, and the device of their scenes.
    pub type Views = (Vec<f64>, Device);

    pub struct Loss(Tensor<1>);

    impl Adaptor<LossInput> for Loss {
        fn adapt(&self) -> LossInput {
            LossInput::new(self.0.clone())
        }
    }

    impl ItemLazy for Loss {
        fn sync(self) -> Result<Self, ExecutionError> {
            Ok(Self(self.0.without_autodiff()))
        }
    }

    impl TrainStep for Offsets {
        type Input = Views;
        type Output = Loss;

        fn step(&self, (views, device): Views) -> TrainOutput<Loss> {
            // A sum over views is one over devices too.
            let loss = self.loss(&views, &device).expect("a loss");
            TrainOutput::new(self, loss.backward(), Loss(loss))
        }
    }

    impl InferenceStep for Offsets {
        type Input = Views;
        type Output = Loss;

        fn step(&self, _: Views) -> Loss {
            unreachable!("nothing is validated")
        }
    }

    struct Gather;

    impl Batcher<f64, Views> for Gather {
        fn batch(&self, views: Vec<f64>, device: &Device) -> Views {
            (views, device.clone().inner())
        }
    }

    /// Each device takes its half of the views in order, so that one device takes both halves by turns.
    fn trained(devices: &[Device], name: &str) -> Vec<f32> {
        let count = 2 * STEPS;
        let view = |i: usize| 9.0 * i as f64;
        let order: Vec<f64> = match devices.len() {
            1 => (0..STEPS)
                .flat_map(|i| [view(i), view(i + STEPS)])
                .collect(),
            _ => (0..count).map(view).collect(),
        };
        let loader = |views: Vec<f64>| {
            let loader = DataLoaderBuilder::new(Gather).batch_size(2 / devices.len());
            loader.build(InMemDataset::new(views))
        };
        let out = std::env::temp_dir().join(format!("softray-{name}-{}", std::process::id()));
        let on: Vec<Device> = devices.iter().map(|d| d.clone().autodiff()).collect();
        let model = Offsets::new(&devices[0]);
        let training = SupervisedTraining::new(&out, loader(order), loader(Vec::new()))
            .metrics((LossMetric::new(),))
            .with_application_logger(None)
            .with_training_strategy(
                ExecutionStrategy::multi(on, MultiDeviceOptim::OptimMainDevice).into(),
            )
            .num_epochs(1);
        let result = training.launch(Learner::new(model, SgdConfig::new().init(), 0.05));
        assert!(result.error.is_none());
        std::fs::remove_dir_all(out).expect("a folder");
        result.model.values()
    }

    #[test]
    fn multi_device_over_two_servers_is_one_device() {
        let one = trained(&[Device::flex()], "one");
        let two = trained(&SERVERS.each_ref().map(Server::device), "two");
        let far = largest_difference(&one, &two);
        assert!(far < 1e-5, "{far}");
    }
}
