//! The example `mesh_predictor` over servers.

use softray::prelude::*;

use crate::common::numbers::{largest, pairs};
use crate::common::target_folder;
use crate::server::Server;
use mesh_predictor::common::study::Arguments;
use mesh_predictor::dataset::Dataset;
use mesh_predictor::network::Network;
use mesh_predictor::settings::Settings;
use mesh_predictor::train::{Place, Trainer};

#[allow(dead_code, clippy::duplicate_mod)] // an example is a program of its own
#[path = "../../examples/mesh_predictor/main.rs"]
mod mesh_predictor;

const STEPS: usize = 2;

/// The first loss with its parts and the overlaps, the norms of the gradients, and the second loss, of a training over
/// some devices, with the network on the client.
fn trained(devices: Vec<Device>, name: &str) -> [Vec<f64>; 3] {
    let settings = Settings {
        steps: STEPS,
        batch: 5,
        ..Settings::tiny()
    };
    let device = Device::flex();
    let data = |name, seed| Dataset::new((name, seed), 6, &settings, &device);
    let [data, validation] =
        [("training", 1), ("validation", 2)].map(|(name, seed)| data(name, seed).expect("renders"));
    let places = devices.into_iter().map(|d| Place::new(&settings, d));
    let trainer = Trainer {
        settings: &settings,
        data: &data,
        validation: &validation,
        places: places.collect::<softray::Result<_>>().expect("a decoder"),
    };
    let network = Network::new(&settings, 1, &device);
    let arguments = Arguments::for_tests(target_folder(name));
    let fitted = trainer.train(network, &arguments).expect("a training");
    let parts = [
        "image",
        "silhouette",
        "soft",
        "shape",
        "IoU input",
        "IoU other",
    ];
    let first = parts.map(|name| fitted.history.curve(name)[0].1);
    let rows = &fitted.history.rows;
    let norms = rows.iter().map(|row| row.gradient_norm).collect();
    let first = first.into_iter().chain([rows[0].loss]).collect();
    [first, norms, vec![rows[1].loss]]
}

/// A distance that rounds to the other side of 0 changes faces, and with them the noise of the gradient. So the norms of
/// gradients and the second loss agree less than the first loss.
#[test]
fn a_training_over_two_servers_is_that_of_one_device() {
    let servers = [Server::start(), Server::start()];
    let one = trained(vec![Device::flex()], "predictor-one");
    let two = servers.each_ref().map(Server::device);
    let two = trained(two.to_vec(), "predictor-two");
    let bounds = [1e-5, 0.05, 1e-3];
    for ((one, two), bound) in one.iter().zip(&two).zip(bounds) {
        let most = largest(pairs(one, two).map(|(a, b)| (a - b) / (1.0 + a.abs())));
        println!("{most:e}");
        assert!(most < bound, "{one:?} {two:?}");
    }
}
