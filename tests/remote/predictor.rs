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

/// After more steps, a distance that rounds to the other side of 0 changes the faces.
const STEPS: usize = 3;

/// The losses, their parts and the first overlaps of a training over some devices, with the network on the client.
fn trained(devices: Vec<Device>, name: &str) -> Vec<f64> {
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
    let curve = |(name, steps)| {
        let values = fitted.history.curve(name).into_iter();
        values.map(|(_, value)| value).take(steps)
    };
    let parts = ["loss", "image", "silhouette", "soft", "shape"].map(|name| (name, STEPS));
    // Later overlaps could differ by a pixel at their threshold.
    let overlaps = ["IoU input", "IoU other"].map(|name| (name, 1));
    parts.into_iter().chain(overlaps).flat_map(curve).collect()
}

#[test]
fn a_training_over_two_servers_is_that_of_one_device() {
    let servers = [Server::start(), Server::start()];
    let one = trained(vec![Device::flex()], "predictor-one");
    let two = servers.each_ref().map(Server::device);
    let two = trained(two.to_vec(), "predictor-two");
    assert_eq!(one.len(), 5 * STEPS + 2);
    let most = largest(pairs(&one, &two).map(|(a, b)| (a - b) / (1.0 + a.abs())));
    println!("{most:e}");
    assert!(most < 1e-5, "{one:?} {two:?}");
}
