use serde::Deserialize;
use serde_json::json;
use softray::gradcheck::{Checked, GradCheck, Point, gradcheck};
use softray::prelude::*;

use crate::Answer;
use crate::scenes::View;

#[derive(Deserialize)]
pub struct Request {
    #[serde(flatten)]
    view: View,
    samples: u32,
    /// Seeds of each side, at most.
    budget: u64,
    /// Of both standard errors, as a share of the difference.
    precision: f64,
    eye: [f64; 3],
    target: [f64; 3],
    fov: f64,
    /// Aperture and focus distance of a thin lens.
    lens: Option<[f64; 2]>,
    /// An object that moves while the shutter is open, and its velocity.
    moving: Option<(String, [f64; 3])>,
    /// What is checked, and the step of its differences; of vectors along (0.6, 0.64, 0.48).
    parameters: Vec<(String, f64)>,
}

impl Request {
    /// Gradients beside central differences, both with standard errors. `gradcheck` asks for f64, which the file's
    /// meshes are cast to.
    pub fn answer(&self) -> Answer {
        let file = self.view.load()?;
        let options = self.view.options().samples(self.samples);
        let settings = GradCheck::new(options, &self.view.device()?);
        let size = self.view.size;
        let squares = (0..size * size).map(|p| (p / size / 4 + p % size / 4) % 2);
        let weights: Vec<f32> = squares.map(|odd| 1.0 - 2.0 * odd as f32).collect();
        let settings = settings
            .precision(self.precision)
            .seeds(16, self.budget)
            .objective(move |radiance| {
                let plain = radiance.device().inner();
                let weights = Tensor::<1>::from_floats(weights.as_slice(), &plain);
                let weights = weights.cast(radiance.dtype()).reshape([size, size, 1]);
                (radiance * weights).mean()
            });
        let parameters: Vec<Checked> = self
            .parameters
            .iter()
            .map(|(name, step)| {
                let values = self.values(name);
                let checked = Checked::new(name, values.clone(), *step);
                match values.len() {
                    1 => checked,
                    _ => checked.along([0.6, 0.64, 0.48]),
                }
            })
            .collect();
        let report = gradcheck(&parameters, &settings, |point| self.build(&file, point))?;
        let row = |r: &softray::gradcheck::Row| {
            json!({
                "parameter": r.parameter,
                "gradient": [r.gradient.mean, r.gradient.error],
                "difference": [r.difference.mean, r.difference.error],
            })
        };
        Ok(json!({ "rows": report.rows.iter().map(row).collect::<Vec<_>>() }))
    }

    fn values(&self, name: &str) -> Vec<f64> {
        let lens = self.lens.unwrap_or([0.0, 1.0]);
        match name {
            "eye" => self.eye.to_vec(),
            "target" => self.target.to_vec(),
            "field of view" => vec![self.fov],
            "aperture" => vec![lens[0]],
            "focus distance" => vec![lens[1]],
            _ => self.moving.as_ref().map_or(vec![0.0; 3], |m| m.1.to_vec()),
        }
    }

    fn build(&self, file: &SceneFile, point: &Point) -> softray::Result<(Scene, Camera)> {
        let get = |name: &str| -> Tensor<1> {
            point.get(name).unwrap_or_else(|_| {
                let values = self.values(name);
                let data = burn::tensor::TensorData::new(values.clone(), [values.len()]);
                Tensor::from_data(data, (&point.device, point.dtype))
            })
        };
        let mut scene = file.scene.clone();
        for object in &mut scene.objects {
            object.mesh = object.mesh.clone().cast(point.dtype);
        }
        if let Some((name, _)) = &self.moving {
            let velocity = get("velocity");
            scene = scene.map_object(name, |o| o.velocity(velocity.clone()))?;
        }
        let mut camera = Camera::look_at(get("eye"), get("target")).fov_y(get("field of view"));
        if self.lens.is_some() {
            camera = camera.thin_lens(get("aperture"), get("focus distance"));
        }
        Ok((scene, camera))
    }
}
