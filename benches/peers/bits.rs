use serde::Deserialize;
use serde_json::json;
use softray::prelude::*;

use crate::Answer;
use crate::scenes::View;

#[derive(Deserialize)]
pub struct Request {
    #[serde(flatten)]
    view: View,
    samples: u32,
    seed: u64,
    /// The object whose vertices have gradients.
    object: String,
}

impl Request {
    /// The image and the gradient of Σ image² by the object's vertices, as the bits of f32.
    pub fn answer(&self) -> Answer {
        let file = self.view.load()?;
        let options = self
            .view
            .options()
            .with_samples(self.samples)
            .with_seed(self.seed);
        let object = file.scene.object(&self.object).ok_or("no such object")?;
        let leaf = object.mesh.vertices.clone().autodiff().require_grad();
        let moved = |o: Object| o.map_mesh(|m| m.with_vertices(leaf.clone()));
        let scene = file.scene.clone().map_object(&self.object, moved)?;
        let image = render(&scene, &file.camera, &options)?.radiance;
        let bits = |data: burn::tensor::TensorData| -> Vec<u32> {
            data.iter::<f32>().map(f32::to_bits).collect()
        };
        let gradients = image.clone().powf_scalar(2.0).sum().backward();
        let gradient = leaf.grad(&gradients).ok_or("no gradient")?.into_data();
        Ok(json!({ "image": bits(image.into_data()), "gradient": bits(gradient) }))
    }
}
