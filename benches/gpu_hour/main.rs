//! What should be known of a GPU, meant for ten minutes of its time: paths a second, training steps of batches and of large
//! meshes with the times of their stages, and how far images and gradients are from the host's. It writes one JSON file
//! and one page.
//!
//! ```sh
//! cargo bench --features vulkan --bench gpu_hour -- --device vulkan
//! ```

mod page;
mod step;

use std::path::PathBuf;
use std::time::Instant;

use clap::Parser;
use serde_json::{Value, json};

use step::Step;

#[derive(Parser)]
#[command(about = "Measures a GPU, and writes a JSON file and a page")]
struct Arguments {
    /// The device, such as `vulkan`, `wgpu` or `vulkan:cpu`.
    #[arg(long, default_value = "vulkan")]
    device: String,
    /// Folder for the files.
    #[arg(long, default_value = "out")]
    out: PathBuf,
    /// Steps of which the fastest counts, after one that compiles.
    #[arg(long, default_value_t = 5)]
    runs: usize,
    /// Small images and few samples, for a software driver.
    #[arg(long)]
    quick: bool,
    /// Only steps whose names contain this.
    #[arg(long)]
    only: Option<String>,
    /// Passed by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() {
    let arguments = Arguments::parse();
    let start = Instant::now();
    let device = softray::device::named(Some(&arguments.device)).expect("a device");
    let adapter = adapter(&device);
    let large = if arguments.quick { (64, 2) } else { (512, 64) };
    let small = (64, if arguments.quick { 2 } else { 8 });
    let two = [81_920, 81_920];
    let mut steps = vec![
        Step::new("one small view", 1, [1_280, 0], small),
        Step::new("one small view, many faces", 1, [81_920, 0], small),
        Step::new("one large view", 1, [1_280, 0], large),
        Step::new("one large view, many faces", 1, [81_920, 0], large),
        Step::new("a moved mesh beside one that stands", 1, two, small),
        Step::new("the same, late", 1, two, small).late(),
        Step::new("colors alone", 1, [0, 81_920], small),
        Step::new("colors alone, late", 1, [0, 81_920], small).late(),
    ];
    for scenes in [16, 64] {
        for faces in [1_280, 20_480, 81_920] {
            let skipped = arguments.quick && scenes * faces > 100_000;
            if !skipped {
                let batch = |name| Step::new(name, scenes, [faces, 0], (64, 1));
                steps.extend([batch("a batch"), batch("a batch, late").late()]);
            }
        }
    }
    if let Some(only) = &arguments.only {
        steps.retain(|step| step.name.contains(only.as_str()));
    }
    std::fs::create_dir_all(&arguments.out).expect("the folder");
    let write = |name: &str, text: String| {
        let path = arguments.out.join(name);
        std::fs::write(&path, text).expect("a file");
    };
    let mut report = json!({
        "device": arguments.device,
        "adapter": adapter,
        "quick": arguments.quick,
        "apart": apart(&device),
        "steps": [],
    });
    println!("{}", report["apart"]);
    // The files have all steps that were measured, also if the program is ended early.
    for step in steps {
        let row = step.measure(&device, arguments.runs);
        println!("{}", page::line(&row));
        report["steps"].as_array_mut().expect("steps").push(row);
        report["seconds"] = json!(start.elapsed().as_secs());
        write("gpu_hour.md", page::page(&report));
        let text = serde_json::to_string_pretty(&report).expect("JSON");
        write("gpu_hour.json", text + "\n");
    }
    println!("{}", arguments.out.join("gpu_hour.md").display());
}

/// The adapter and what its kernels are compiled for.
#[cfg(feature = "wgpu")]
fn adapter(device: &burn::tensor::Device) -> Value {
    match device.identity() {
        Some(identity) => json!(format!("{identity:?}")),
        None => Value::Null,
    }
}

#[cfg(not(feature = "wgpu"))]
fn adapter(_: &burn::tensor::Device) -> Value {
    Value::Null
}

/// How far an image and its gradient by vertices are from those of the host, over the largest numbers of these.
fn apart(device: &burn::tensor::Device) -> Value {
    let step = Step::new("compared", 1, [1_280, 0], (64, 4));
    let [found, wanted] = [device, &burn::tensor::Device::flex()].map(|on| step.values(on));
    let apart = |k: usize| {
        let most = wanted[k].iter().fold(0.0f32, |m, x| m.max(x.abs()));
        let pairs = found[k].iter().zip(&wanted[k]);
        let mut off: Vec<f32> = pairs.map(|(a, b)| (a - b).abs() / most).collect();
        off.sort_by(f32::total_cmp);
        let at = |share: f64| off[((off.len() - 1) as f64 * share) as usize];
        json!({ "median": at(0.5), "99 %": at(0.99), "most": at(1.0) })
    };
    json!({ "image": apart(0), "gradient": apart(1) })
}
