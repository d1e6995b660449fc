//! A server of a GPU, or of a software driver of one. `SOFTRAY_GPU` names the device, as for the program `gpu`.

use softray::prelude::*;

use crate::common::numbers::{furthest, norm};
use crate::common::scenes::scene_file;
use crate::common::tensors::{gradient, values, with_leaves};
use crate::device::{Flips, device, name};
use crate::server::Server;

const SAMPLES: u32 = 16;

/// What a device computes for a scene.
#[derive(Debug, PartialEq)]
struct Found {
    program: Program,
    image: Vec<f64>,
    depth: Vec<f64>,
    /// Of a loss of both by all vertices.
    gradients: Vec<f64>,
}

/// Two steps, of which the second sends no faces.
fn found(device: &Device) -> [Found; 2] {
    let file = scene_file("cornell", device);
    let scene = with_leaves(file.scene);
    [2, 3].map(|seed| {
        let options = RenderOptions::new(32, 32)
            .with_samples(SAMPLES)
            .with_bounces(1)
            .with_depth()
            .with_seed(seed)
            // On a CPU these draw other edges.
            .with_adaptive_edges(false);
        let image = render(&scene, &file.camera, &options).expect("an image");
        let depth = image.depth.expect("depth");
        let loss = image.radiance.clone().powi_scalar(2).mean() + depth.clone().mean();
        let gradients = loss.backward();
        let of = |object: &Object| gradient(&object.mesh.vertices, &gradients);
        Found {
            program: image.statistics.program,
            image: values(&image.radiance),
            depth: values(&depth),
            gradients: scene.objects.iter().flat_map(of).collect(),
        }
    })
}

/// The same numbers as the device in this process computes, to the bit, and those of Flex within the tolerances of the
/// program `gpu`.
#[test]
fn kernels_run_on_the_gpu_of_a_server() {
    let server = Server::with(&format!("--bind 127.0.0.1:0 --device {}", name()));
    let remote = found(&server.device());
    assert_eq!(remote, found(&device()));
    for (remote, host) in remote.iter().zip(&found(&Device::flex())) {
        assert_eq!(remote.program, Program::DeviceKernels);
        assert_eq!(host.program, Program::HostKernels);
        let flips = Flips::of(&remote.image, &host.image);
        let apart = furthest(&remote.gradients, &host.gradients) / norm(&host.gradients);
        println!("{flips:?}, gradients {apart:e} apart");
        flips.assert_at_most(3, SAMPLES);
        assert!(apart < 1e-5, "{apart}");
    }
}
