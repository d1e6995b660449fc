//! What servers cost and gain beside the device of one process (docs/MACHINES.md): this program again as servers with
//! one thread each. Ratios are medians of pairs of runs that alternate.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::Instant;

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use clap::Parser;
use softray::burn;
use softray::optim::{Evaluation, Fit, Part};
use softray::prelude::*;
use softray::remote::{connect, finish};

#[allow(dead_code)] // an example is a program of its own
#[path = "../../examples/render_server.rs"]
mod render_server;

const SERVER: &str = "SOFTRAY_BENCH_SERVER";

struct Server {
    child: Child,
    device: Device,
}

impl Server {
    fn start() -> Self {
        let program = std::env::current_exe().expect("this program");
        let mut command = Command::new(program);
        let command = command.env(SERVER, "1").env("RAYON_NUM_THREADS", "1");
        let mut child = command.stdout(Stdio::piped()).spawn().expect("a server");
        let output = child.stdout.take().expect("its output");
        let lines = BufReader::new(output).lines().map_while(Result::ok);
        let line = lines.into_iter().find(|line| line.contains("ws://"));
        let line = line.expect("an address");
        let place = line
            .split_once("ws://")
            .and_then(|(_, rest)| rest.split_once(": "));
        let address = format!("ws://{}", place.expect("an address").0);
        let device = connect(&address, "").expect("a device");
        Self { child, device }
    }

    /// Seconds of CPU time so far.
    fn seconds(&self) -> f64 {
        cpu(&self.child.id().to_string())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Seconds of CPU time of a process (Linux).
fn cpu(process: &str) -> f64 {
    let path = format!("/proc/{process}/stat");
    let text = std::fs::read_to_string(path).expect("Linux's /proc");
    let fields: Vec<&str> = text
        .rsplit(") ")
        .next()
        .expect("fields")
        .split(' ')
        .collect();
    let ticks = |i: usize| fields[i].parse::<f64>().expect("ticks");
    (ticks(11) + ticks(12)) / 100.0
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// A ball with tracked vertices on a floor.
fn scene(subdivisions: u32, device: &Device) -> (Tensor<2>, Scene, Camera) {
    let ball = shapes::icosphere(subdivisions, device);
    let vertices = ball.vertices.clone().autodiff().require_grad();
    let ball = Object::new(ball.with_vertices(vertices.clone()));
    let floor =
        Object::new(shapes::plane_grid(6.0, 6.0, 2, 2, device).translated([0.0, -1.0, 0.0]));
    let scene = Scene::new().with_object(ball).with_object(floor);
    let scene = scene.with_environment([1.0; 3]);
    (vertices, scene, Camera::look_at([0.0, 1.0, 4.0], [0.0; 3]))
}

/// Seconds of the forward and of the backward pass.
fn step(subdivisions: u32, options: &RenderOptions, device: &Device) -> [f64; 2] {
    let (vertices, scene, camera) = scene(subdivisions, device);
    let begin = Instant::now();
    let image = render(&scene, &camera, options).expect("an image");
    let forward = begin.elapsed().as_secs_f64();
    let gradients = image.radiance.mean().backward();
    let sum = vertices.grad(&gradients).expect("a gradient").sum();
    assert!(sum.into_scalar::<f32>().is_finite());
    finish(device).expect("a gradient");
    [forward, begin.elapsed().as_secs_f64() - forward]
}

fn shares_of_cpu(server: &Server) {
    let options = RenderOptions::new(64, 64).with_samples(64);
    step(2, &options, &server.device);
    let before = [cpu("self"), server.seconds()];
    for seed in 0..10 {
        step(2, &options.clone().with_seed(seed), &server.device);
    }
    let [client, server] = [cpu("self") - before[0], server.seconds() - before[1]];
    println!(
        "64², 64 samples, a step: CPU time of the client {:.0} ms, of the server {:.0} ms, {:.1} %",
        100.0 * client,
        100.0 * server,
        100.0 * client / server
    );
}

fn against_flex(server: &Server) {
    for (subdivisions, samples) in [(2, 64), (5, 1), (5, 64)] {
        let options = RenderOptions::new(64, 64).with_samples(samples);
        let flex = Device::flex();
        let mut ratios = [Vec::new(), Vec::new()];
        let mut seconds = [0.0; 2];
        for seed in 0..9 {
            let options = options.clone().with_seed(seed);
            let [remote, own] = [&server.device, &flex].map(|d| step(subdivisions, &options, d));
            (0..2).for_each(|pass| ratios[pass].push(remote[pass] / own[pass]));
            seconds = own;
        }
        let [forward, backward] = ratios.map(median);
        println!(
            "{} faces, 64², {samples} samples: server over Flex forward {forward:.2} (of {:.1} ms), backward \
             {backward:.2} (of {:.1} ms)",
            20 << (2 * subdivisions),
            1e3 * seconds[0],
            1e3 * seconds[1]
        );
    }
}

#[derive(Module, Debug)]
struct Offsets {
    offsets: Param<Tensor<2>>,
}

/// Seconds of ten steps of a fit to eight views.
fn fit(devices: &[Device], samples: u32) -> f64 {
    let ball = shapes::icosphere(3, &Device::flex());
    let start = ball.vertices.zeros_like().autodiff();
    let module = Offsets {
        offsets: Param::from_tensor(start),
    };
    let views: Vec<f64> = (0..8).map(|i| 45.0 * f64::from(i)).collect();
    let fit = Fit::new(module, AdamConfig::new().init(), 10).with_progress(false);
    let begin = Instant::now();
    let result = fit.run_over(devices, |module: &Offsets, step, part: &Part| {
        let ball = shapes::icosphere(3, &part.device);
        let moved = ball.vertices.clone() + module.offsets.val();
        let scene = Scene::new()
            .with_object(Object::new(ball.with_vertices(moved)))
            .with_environment([1.0; 3]);
        let view = |degrees: &f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            Camera::look_at([4.0 * sin, 0.5, 4.0 * cos], [0.0; 3])
        };
        let batch = Batch::new(vec![scene], part.of(&views).map(view).collect())?;
        let options = RenderOptions::new(64, 64).with_samples(samples);
        let images = render_batch(&batch, &step.options(&options, part.index as u64))?;
        Ok(Evaluation::new(images.radiance.powf_scalar(2.0).mean()))
    });
    result.expect("a fit");
    begin.elapsed().as_secs_f64()
}

fn one_and_two(servers: &[Server; 2]) {
    let both = servers.each_ref().map(|server| server.device.clone());
    for samples in [16, 64] {
        let mut ratios = Vec::new();
        let mut last = 0.0;
        for _ in 0..3 {
            last = fit(&both[..1], samples);
            ratios.push(fit(&both, samples) / last);
        }
        println!(
            "fit to 8 views of 64², {samples} samples: two servers over one {:.2} (of {:.0} ms a step)",
            median(ratios),
            100.0 * last
        );
    }
}

fn main() {
    if std::env::var_os(SERVER).is_some() {
        let arguments = ["render_server", "--bind", "127.0.0.1:0", "--without-token"];
        return render_server::serve(&render_server::Arguments::parse_from(arguments))
            .expect("a server");
    }
    if std::env::var_os("RAYON_NUM_THREADS").is_none() {
        let program = std::env::current_exe().expect("this program");
        let status = Command::new(program).env("RAYON_NUM_THREADS", "1").status();
        assert!(status.expect("this program with one thread").success());
        return;
    }
    let servers = [Server::start(), Server::start()];
    shares_of_cpu(&servers[0]);
    against_flex(&servers[0]);
    one_and_two(&servers);
}
