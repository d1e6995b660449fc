//! What servers cost and gain beside the device of one process (docs/MACHINES.md): this program again as servers with
//! one thread each. Ratios are medians of pairs of runs that alternate. Arguments select among `client`, `flex`, `two`
//! and `speeds`, as in `cargo bench --features remote-server --bench machines -- two`.

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
    /// The process that stops and continues the server by turns.
    brake: Option<Child>,
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
        Self {
            child,
            device,
            brake: None,
        }
    }

    /// A server that runs in some of each 100 ms, as one of a slower machine.
    fn slowed(milliseconds: u32) -> Self {
        let mut server = Self::start();
        let [runs, rests] = [milliseconds, 100 - milliseconds].map(|m| f64::from(m) / 1000.0);
        let turns = format!(
            "while kill -STOP $0; do sleep {rests}; kill -CONT $0; sleep {runs}; done 2>/dev/null"
        );
        let id = server.child.id().to_string();
        let brake = Command::new("sh").args(["-c", &turns, &id]).spawn();
        server.brake = Some(brake.expect("a shell"));
        server
    }

    /// Seconds of CPU time so far.
    fn seconds(&self) -> f64 {
        cpu(&self.child.id().to_string())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        for child in self.brake.iter_mut().chain([&mut self.child]) {
            let _ = child.kill();
            let _ = child.wait();
        }
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

fn shares_of_cpu() {
    let server = Server::start();
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

fn against_flex() {
    let server = Server::start();
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

/// The steps of a fit that is measured.
const STEPS: usize = 4;

/// Seconds of a step of a fit to some views, of which each device has a share.
fn fit(devices: &[Device], views: usize, samples: u32, weights: &[f64]) -> f64 {
    let ball = shapes::icosphere(3, &Device::flex());
    let start = ball.vertices.zeros_like().autodiff();
    let module = Offsets {
        offsets: Param::from_tensor(start),
    };
    let views: Vec<f64> = (0..views)
        .map(|i| 360.0 * i as f64 / views as f64)
        .collect();
    let fit = Fit::new(module, AdamConfig::new().init(), STEPS).with_progress(false);
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
        let batch = Batch::new(
            vec![scene],
            part.weighted(&views, weights)?.map(view).collect(),
        )?;
        let options = RenderOptions::new(64, 64).with_samples(samples);
        let images = render_batch(&batch, &step.options(&options, part.index as u64))?;
        Ok(Evaluation::new(images.radiance.powf_scalar(2.0).mean()))
    });
    result.expect("a fit");
    begin.elapsed().as_secs_f64() / STEPS as f64
}

fn one_and_two() {
    let both = [Server::start(), Server::start()];
    let both = both.each_ref().map(|server| server.device.clone());
    for samples in [64, 256] {
        let pairs =
            (0..5).map(|_| [1, 2].map(|count| fit(&both[..count], 8, samples, &[1.0; 2][..count])));
        let pairs: Vec<_> = pairs.collect();
        println!(
            "fit to 8 views of 64², {samples} samples: two servers over one {:.2} (of {:.0} ms a step)",
            median(pairs.iter().map(|[one, two]| two / one).collect()),
            1e3 * median(pairs.iter().map(|pair| pair[0]).collect())
        );
    }
}

/// Three servers, of which one runs half and one a quarter of the time.
fn different_speeds() {
    const VIEWS: usize = 7;
    let servers = [Server::start(), Server::slowed(50), Server::slowed(25)];
    let all = servers.each_ref().map(|server| server.device.clone());
    let shares: [(&str, &[f64]); 4] = [
        ("the fast one alone", &[1.0]),
        ("the first two, equal parts", &[1.0; 2]),
        ("all three, equal parts", &[1.0; 3]),
        ("all three, parts of 4 : 2 : 1", &[4.0, 2.0, 1.0]),
    ];
    let runs =
        (0..3).map(|_| shares.map(|(_, weights)| fit(&all[..weights.len()], VIEWS, 64, weights)));
    let runs: Vec<_> = runs.collect();
    for (i, (name, _)) in shares.iter().enumerate() {
        println!(
            "fit to {VIEWS} views of 64², 64 samples, servers of speed 1, 1/2 and 1/4: {name} {:.0} ms a step, {:.2} of \
             the fast one's",
            1e3 * median(runs.iter().map(|run| run[i]).collect()),
            median(runs.iter().map(|run| run[i] / run[0]).collect())
        );
    }
}

fn main() {
    if std::env::var_os(SERVER).is_some() {
        let arguments = ["render_server", "--bind", "127.0.0.1:0", "--without-token"];
        return render_server::serve(&render_server::Arguments::parse_from(arguments))
            .expect("a server");
    }
    let named: Vec<String> = std::env::args().skip(1).collect();
    if std::env::var_os("RAYON_NUM_THREADS").is_none() {
        let program = std::env::current_exe().expect("this program");
        let mut command = Command::new(program);
        let status = command.args(named).env("RAYON_NUM_THREADS", "1").status();
        assert!(status.expect("this program with one thread").success());
        return;
    }
    let parts: [(&str, fn()); 4] = [
        ("client", shares_of_cpu),
        ("flex", against_flex),
        ("two", one_and_two),
        ("speeds", different_speeds),
    ];
    let all = !parts
        .iter()
        .any(|(name, _)| named.iter().any(|n| n == name));
    for (name, part) in parts {
        if all || named.iter().any(|n| n == name) {
            part();
        }
    }
}
