//! Faults are errors with a sentence: no panic, and no wait without an end.

use std::net::TcpListener;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use burn::backend::Flex;
use burn::optim::AdamConfig;
use burn::server::{RemoteServer, WebSocketTransport};
use burn::tensor::{DType, TensorData};
use softray::burn;
use softray::optim::{Evaluation, Fit, Part, Report, Step};
use softray::prelude::*;
use softray::remote::{RenderService, ServiceLimits, connect, finish, set_time_limit};

use crate::common::process::{again, alone};
use crate::server::{Server, TOKEN};
use crate::training::Offsets;

/// A ball on a device, with tracked vertices.
fn ball(device: &Device) -> (Tensor<2>, Scene, Camera) {
    let mesh = shapes::icosphere(1, device);
    let vertices = mesh.vertices.clone().autodiff().require_grad();
    let object = Object::new(mesh.with_vertices(vertices.clone()));
    let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0]);
    let scene = Scene::new().with_object(object).with_environment([1.0; 3]);
    (vertices, scene, camera)
}

fn options() -> RenderOptions {
    RenderOptions::new(8, 8).with_samples(2)
}

#[track_caller]
fn says(error: softray::Result<impl Sized>, parts: &[&str]) {
    let said = error.err().expect("an error").to_string();
    println!("{said}");
    for part in parts {
        assert!(said.contains(part), "no {part:?} in {said}");
    }
}

#[test]
fn a_wrong_token_is_an_error() {
    let server = Server::start();
    let address = format!("ws://{}", server.address);
    for token in ["", "another token"] {
        says(connect(&address, token), &[&address, "credential", "token"]);
    }
    assert!(connect(&address, TOKEN).is_ok());
}

#[test]
fn a_server_that_is_not_there_is_an_error() {
    let begin = Instant::now();
    // The port was free a moment ago.
    let port = TcpListener::bind("127.0.0.1:0")
        .expect("a port")
        .local_addr()
        .expect("it");
    says(
        connect(&format!("ws://{port}"), ""),
        &["reached", "where it listens"],
    );
    assert!(begin.elapsed() < Duration::from_secs(60));
}

/// Both passes go on after a scene that is wrong, in the same session.
#[test]
fn a_wrong_scene_is_the_error_of_its_device() {
    let server = Server::start();
    let errors = [Device::flex(), server.device()].map(|device| {
        let (vertices, scene, camera) = ball(&device);
        let broken = Tensor::<2>::full([42, 3], f32::NAN, &device);
        let moved = |vertices: &Tensor<2>| {
            let change = |o: Object| o.map_mesh(|m| m.with_vertices(vertices.clone()));
            scene
                .clone()
                .map_object("object", change)
                .expect("the object")
        };
        let wrong = render(&moved(&broken), &camera, &options());
        let none = Scene::new().with_object(Object::new(Mesh::from_host(
            &[[0.0; 3]],
            Vec::new(),
            &device,
        )));
        let none = render(&none, &camera, &options());
        assert!(matches!(
            none,
            Err(softray::Error::NoTriangles { objects: 1, .. })
        ));
        let image = render(&scene, &camera, &options()).expect("an image");
        let gradients = image.radiance.mean().backward();
        assert!(vertices.grad(&gradients).is_some());
        wrong.expect_err("NaN is no vertex").to_string()
    });
    assert_eq!(errors[0], errors[1]);
}

#[test]
fn limits_of_a_server() {
    let server = Server::with("--bind 127.0.0.1:0 --max-pixels 100 --max-samples 1000 --kept 1");
    let device = server.device();
    let (vertices, scene, camera) = ball(&device);
    let large = RenderOptions::new(20, 20).with_samples(1);
    says(
        render(&scene, &camera, &large),
        &["pixels is 400", "at most 100"],
    );
    let long = options().with_samples(1 << 20);
    says(render(&scene, &camera, &long), &["samples", "at most 1000"]);
    // The first pass is dropped when the second is kept, and its gradient repeats it.
    let images =
        [0, 1].map(|seed| render(&scene, &camera, &options().with_seed(seed)).expect("an image"));
    let of = |image: &Image| {
        let gradients = image.radiance.clone().powf_scalar(2.0).mean().backward();
        vertices.grad(&gradients).expect("a gradient").into_data()
    };
    let remote = images.each_ref().map(of);
    finish(&device).expect("the gradients");
    let (vertices, scene, camera) = ball(&Device::flex());
    for (seed, remote) in remote.into_iter().enumerate() {
        let image = render(&scene, &camera, &options().with_seed(seed as u64)).expect("an image");
        let gradients = image.radiance.powf_scalar(2.0).mean().backward();
        assert_eq!(
            vertices.grad(&gradients).expect("a gradient").into_data(),
            remote
        );
    }
}

/// A server of this process.
fn serve(server: RemoteServer) -> Device {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address");
    std::thread::spawn(move || server.serve(WebSocketTransport::from_listener(listener)));
    connect(&format!("ws://{address}"), "").expect("a device")
}

#[test]
fn a_server_without_these_operations_is_an_error() {
    let device = serve(RemoteServer::new([Device::flex()]));
    let (_, scene, camera) = ball(&device);
    says(
        render(&scene, &camera, &options()),
        &["ws://", "operation of softray", "render_server"],
    );
}

#[test]
fn a_server_of_another_version_is_an_error() {
    let other = RemoteServer::new([Device::flex()]).with_custom_op::<Flex, _>(
        "softray::version",
        |handles, operation, device| {
            let _ = device;
            let words = TensorData::from([77i32]);
            let words =
                Tensor::<1, burn::tensor::Int>::from_data(words, (&Device::flex(), DType::I32));
            let words = words.try_into_primitive::<Flex>().expect("Flex");
            handles.register_int_tensor::<Flex>(&operation.outputs[0].id, words);
        },
    );
    let device = serve(other);
    let (_, scene, camera) = ball(&device);
    says(
        render(&scene, &camera, &options()),
        &["version 77", "this program 2"],
    );
}

/// A training resumes in a new process: in this one the device stays dead, as burn has it.
#[test]
fn a_server_that_dies_in_a_step_is_an_error() {
    if !alone(a_server_that_dies_in_a_step_is_an_error) {
        return;
    }
    let mut server = Server::start();
    let device = server.device();
    let (_, scene, camera) = ball(&device);
    render(&scene, &camera, &options()).expect("an image");
    let id = server.child.id();
    let killer = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(300));
        let killed = Command::new("kill")
            .args(["-KILL", &id.to_string()])
            .status();
        assert!(killed.expect("kill").success());
    });
    let long = RenderOptions::new(256, 256).with_samples(1 << 16);
    let begin = Instant::now();
    says(
        render(&scene, &camera, &long),
        &["ws://", "ended the session", "checkpoint"],
    );
    says(
        render(&scene, &camera, &options()),
        &["ws://", "checkpoint"],
    );
    assert!(begin.elapsed() < Duration::from_secs(30));
    killer.join().expect("the killer");
    server.child.wait().expect("its end");
    // Another server at the same place is of use to a new process alone.
    let again = Server::with(&format!("--bind {}", server.address));
    let (_, scene, camera) = ball(&device);
    says(
        render(&scene, &camera, &options()),
        &["ws://", "checkpoint"],
    );
    drop(again);
}

/// Ends the server in the fourth step of a fit. A new process with a new server ends as one that nobody stopped.
#[test]
fn a_fit_resumes_in_a_new_process() {
    const PHASE: &str = "SOFTRAY_PHASE";
    let folder = |id: u32| std::env::temp_dir().join(format!("softray-resume-{id}"));
    let fit = |folder: &Path| {
        let fit = Fit::new(Offsets::new(&Device::flex()), AdamConfig::new().init(), 8);
        fit.with_progress(false)
            .with_folder(folder)
            .with_checkpoint_every(1)
    };
    let loss = |module: &Offsets, _: &Step, part: &Part| {
        Ok(Evaluation::new(module.loss(&[0.0, 90.0], &part.device)?))
    };
    match std::env::var(PHASE) {
        Err(_) => {
            let own = folder(std::process::id());
            for phase in ["stop", "resume"] {
                let mut process = again(a_fit_resumes_in_a_new_process);
                let process = process.env(PHASE, format!("{phase} {}", std::process::id()));
                assert!(process.status().expect("a process").success(), "{phase}");
            }
            std::fs::remove_dir_all(own).expect("a folder");
        }
        Ok(phase) => {
            let (phase, id) = phase.split_once(' ').expect("a phase");
            let folder = folder(id.parse().expect("a number"));
            let server = Server::start();
            let device = server.device();
            if phase == "stop" {
                let id = server.child.id().to_string();
                let stopped = fit(&folder).on_step(1, move |report: &Report<Offsets>| {
                    if report.step.index == 3 {
                        Command::new("kill")
                            .args(["-KILL", &id])
                            .status()
                            .expect("kill");
                    }
                    Ok(true)
                });
                says(stopped.run_over(&[device], loss), &["ws://", "checkpoint"]);
                return;
            }
            let resumed = fit(&folder).run_over(&[device], loss).expect("a fit");
            assert!(resumed.resumed >= Some(3), "{:?}", resumed.resumed);
            let whole = Fit::new(Offsets::new(&Device::flex()), AdamConfig::new().init(), 8);
            let whole = whole
                .with_progress(false)
                .run_over(&[Device::flex()], loss)
                .expect("a fit");
            assert_eq!(resumed.module.values(), whole.module.values());
        }
    }
}

/// Sends a signal to a server.
fn signal(server: &Server, name: &str) {
    let id = server.child.id().to_string();
    let sent = Command::new("kill").args([name, &id]).status();
    assert!(sent.expect("kill").success());
}

/// A server that goes on is used again in the same session.
#[test]
fn a_server_that_hangs_is_an_error() {
    if !alone(a_server_that_hangs_is_an_error) {
        return;
    }
    let server = Server::start();
    let device = server.device();
    let (_, scene, camera) = ball(&device);
    let image = || render(&scene, &camera, &options());
    let before = image().expect("an image").radiance.inner().into_data();
    set_time_limit(Duration::from_secs(1));
    signal(&server, "-STOP");
    says(image(), &["within 1 s", "set_time_limit"]);
    signal(&server, "-CONT");
    set_time_limit(Duration::from_secs(60));
    let after = image().expect("an image").radiance.inner().into_data();
    assert_eq!(before, after);
}

/// Whether the logger of this program panics at a warning, as a part of softray or burn might.
static PANICS: AtomicBool = AtomicBool::new(false);

struct Logger;

impl log::Log for Logger {
    /// A warning that is not logged is repeated.
    fn enabled(&self, _: &log::Metadata<'_>) -> bool {
        PANICS.load(Ordering::SeqCst)
    }
    fn log(&self, record: &log::Record<'_>) {
        let warning = record.args().to_string().contains("nothing of the scene");
        assert!(!(warning && self.enabled(record.metadata())), "no room");
    }
    fn flush(&self) {}
}

/// The session goes on after a panic in a render and in a gradient, whose error the next call returns.
#[test]
fn a_panic_is_an_error() {
    if !alone(a_panic_is_an_error) {
        return;
    }
    log::set_logger(&Logger).expect("the only logger");
    log::set_max_level(log::LevelFilter::Warn);
    let mut limits = ServiceLimits::default();
    limits.kept = 1;
    let server = RemoteServer::new([Device::flex()]);
    let server = RenderService::new(limits).add_to(server, &Device::flex());
    let device = serve(server.expect("a server"));
    let (vertices, scene, camera) = ball(&device);
    // The server warns once of each distance: the ball is behind the camera.
    let turned = |distance: f64| Camera::look_at([0.0, 0.0, distance], [0.0, 0.0, 20.0]);
    let parts = ["ws://", "in the program", "no room"];
    PANICS.store(true, Ordering::SeqCst);
    says(render(&scene, &turned(3.0), &options()), &parts);
    PANICS.store(false, Ordering::SeqCst);
    let image = |camera: &Camera| render(&scene, camera, &options()).expect("an image");
    // The second render drops the first forward pass, which the gradient repeats with its warning.
    let failed_gradient = |distance: f64| {
        let [first, _] = [image(&turned(distance)), image(&camera)];
        PANICS.store(true, Ordering::SeqCst);
        let gradients = first.radiance.mean().backward();
        let gradient = vertices.grad(&gradients).expect("a gradient").into_data();
        PANICS.store(false, Ordering::SeqCst);
        assert_eq!(gradient.shape().to_vec(), [42, 3]);
        assert!(gradient.iter::<f32>().all(f32::is_nan));
    };
    failed_gradient(4.0);
    says(render(&scene, &camera, &options()), &parts);
    image(&camera);
    failed_gradient(5.0);
    says(finish(&device), &parts);
    finish(&device).expect("no more gradients");
    let gradients = image(&camera).radiance.mean().backward();
    let gradient = vertices.grad(&gradients).expect("a gradient").into_data();
    assert!(gradient.iter::<f32>().all(f32::is_finite));
    finish(&device).expect("a gradient");
}

#[test]
fn a_server_ends_by_a_signal() {
    let server = Server::start();
    let device = server.device();
    let (_, scene, camera) = ball(&device);
    render(&scene, &camera, &options()).expect("an image");
    let (success, rest) = server.end();
    assert!(success && rest.contains("ended"), "{rest}");
}
