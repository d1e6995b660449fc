#[path = "../tests/common/mod.rs"]
mod common;
#[path = "../tests/gradients/classes/random_scenes/mod.rs"]
mod random_scenes;
use burn::tensor::{DType, Device};
use common::gradients as g;
use random_scenes::RandomScene;
use softray::prelude::*;
use std::io::Write;
fn main() {
    let device = Device::flex();
    let path = std::env::args().nth(1).unwrap();
    let mut out = std::fs::File::create(path).unwrap();
    let mut put = |name: String, values: Vec<f32>| {
        writeln!(out, "{name}").unwrap();
        for v in values {
            write!(out, "{v:e} ").unwrap();
        }
        writeln!(out).unwrap();
    };
    for seed in 5000..5040 {
        let s = RandomScene::new(seed);
        let mut scene = s.scene.clone();
        for o in &mut scene.objects {
            let v = o.mesh.vertices.clone().autodiff().require_grad();
            o.mesh = o.mesh.clone().with_vertices(v);
        }
        let image = render(&scene, &s.camera, &s.options.clone().seed(3)).unwrap();
        put(
            format!("image {seed} {}", s.description),
            image.radiance.clone().into_data().iter::<f32>().collect(),
        );
        let grads = (image.radiance.powf_scalar(2.0)).sum().backward();
        for (i, o) in scene.objects.iter().enumerate() {
            let v = o
                .mesh
                .vertices
                .grad(&grads)
                .map(|t| t.into_data().iter::<f32>().collect())
                .unwrap_or_default();
            put(format!("gradient {seed} {i}"), v);
        }
    }
    let all = g::all_classes()
        .into_iter()
        .chain(g::lights::glowing())
        .chain(g::lights::crossings());
    for case in all {
        let v = g::of_seed(&case, (&device, |o| o), DType::F32, g::CONES, 5);
        let w = g::of_seed(&case, (&device, |o| o), DType::F64, g::CONES, 6);
        put(format!("class {}", case.name), vec![v as f32, w as f32]);
    }
}
