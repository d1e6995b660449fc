use std::time::{Instant, SystemTime, UNIX_EPOCH};

use serde::Deserialize;
use serde_json::json;
use softray::prelude::*;

use crate::Answer;
use crate::scenes::View;

#[derive(Deserialize)]
pub struct Request {
    #[serde(flatten)]
    view: View,
    /// Samples a pixel.
    samples: u32,
    /// With gradients of all vertices.
    backward: bool,
    /// The seconds to fill with runs after the first; at least three runs.
    seconds: f64,
}

impl Request {
    pub fn answer(&self) -> Answer {
        let start = Instant::now();
        let file = self.view.load()?;
        let reading = start.elapsed().as_secs_f64();
        let cache = HierarchyCache::default();
        let options = self
            .view
            .options()
            .with_samples(self.samples)
            .with_cache(&cache);
        let triangles: usize = file.scene.objects.iter().map(|o| o.mesh.faces.len()).sum();
        let run = |k: u64| -> softray::Result<()> {
            let options = options.clone().with_seed(k);
            if self.backward {
                backward(&file, &options, k)
            } else {
                let image = render(&file.scene, &file.camera, &options)?;
                let _ = image.radiance.into_data();
                Ok(())
            }
        };
        let start = Instant::now();
        run(0)?;
        let first = start.elapsed().as_secs_f64();
        let first_at = SystemTime::now().duration_since(UNIX_EPOCH)?.as_secs_f64();
        let mut times = Vec::new();
        while times.len() < 3 || times.iter().sum::<f64>() < self.seconds {
            let start = Instant::now();
            run(1 + times.len() as u64)?;
            times.push(start.elapsed().as_secs_f64());
        }
        Ok(json!({
            "triangles": triangles,
            "reading": reading,
            "first": first,
            "first_at": first_at,
            "times": times,
        }))
    }
}

/// Gradients of Σ image² by all vertices, which a step of a fit has moved a little.
fn backward(file: &SceneFile, options: &RenderOptions, k: u64) -> softray::Result<()> {
    let mut scene = file.scene.clone();
    let scale = 1.0 + 1e-6 * k as f64;
    for object in &mut scene.objects {
        let vertices = object.mesh.vertices.clone().mul_scalar(scale);
        let vertices = vertices.autodiff().require_grad();
        object.mesh = object.mesh.clone().with_vertices(vertices);
    }
    let image = render(&scene, &file.camera, options)?;
    let gradients = image.radiance.powf_scalar(2.0).sum().backward();
    for object in &scene.objects {
        let gradient = object.mesh.vertices.grad(&gradients);
        let _ = gradient.map(Tensor::into_data);
    }
    Ok(())
}
