use std::path::PathBuf;

use burn::module::{Module, Param};
use burn::optim::ModuleOptimizer;
use serde::Deserialize;
use serde_json::json;
use softray::optim::{LargeSteps, LargeStepsConfig};
use softray::prelude::*;

use super::{Request, falling, sharp};
use crate::Answer;

#[derive(Deserialize)]
pub struct Views {
    object: String,
    /// A scene whose object of that name is the mesh to start from.
    start: PathBuf,
    eyes: Vec<[f64; 3]>,
    /// Seeds, one fit each.
    seeds: Vec<u64>,
    /// λ of the large steps.
    lambda: f64,
    /// Half-angles of cones at the start and at the end, radians.
    blur: [f64; 2],
}

#[derive(Module, Debug)]
struct Body {
    /// `[V, 3]`, scene units.
    vertices: Param<Tensor<2>>,
}

impl Views {
    pub fn answer(&self, request: &Request) -> Answer {
        let (file, options) = request.load()?;
        let start = SceneFile::load(&self.start, &request.view.device()?)?.scene;
        let start = start.object(&self.object).ok_or("no such object")?;
        let start = start.mesh.clone();
        let eye = |&eye: &[f64; 3]| Camera::look_at(eye, [0.0; 3]).with_fov_y(40.0);
        let cameras: Vec<Camera> = self.eyes.iter().map(eye).collect();
        let all = |scene: &Scene| Batch::product(vec![scene.clone()], &cameras);
        let target = render_batch(&all(&file.scene)?, &sharp(&options).with_samples(256))?.radiance;
        let config = LargeStepsConfig::default().with_lambda(self.lambda);
        let steps = LargeSteps::from_mesh(&start, &config)?;
        let fit = |&seed: &u64| {
            let body = Body {
                vertices: Param::from_tensor(start.vertices.clone().autodiff()),
            };
            request.clock.run(
                body,
                ModuleOptimizer::from(steps.clone()),
                seed,
                |body, share, seeds| {
                    let mesh = start.clone().with_vertices(body.vertices.val());
                    let scene = file.scene.clone();
                    let scene = scene.map_object(&self.object, |o| o.map_mesh(|_| mesh.clone()))?;
                    let batch = all(&scene)?;
                    let options = options
                        .clone()
                        .with_blur(falling(self.blur, share).to_degrees());
                    let see = |seed| render_batch(&batch, &options.clone().with_seed(seed));
                    let [a, b] = seeds.map(see);
                    let (a, b) = (a?.radiance, b?.radiance);
                    Ok(((a - target.clone()) * (b - target.clone())).mean())
                },
                |body| {
                    let vertices = body.vertices.val().into_data();
                    Ok(json!(vertices.iter::<f32>().collect::<Vec<_>>()))
                },
            )
        };
        let fits = self.seeds.iter().map(fit).collect::<Result<Vec<_>, _>>()?;
        Ok(json!({ "fits": fits, "faces": start.faces.to_vec() }))
    }
}
