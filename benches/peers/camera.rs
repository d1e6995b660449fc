use burn::tensor::{DType, TensorData};
use serde::Deserialize;
use serde_json::json;
use softray::gradcheck::{Checked, GradCheck, gradcheck};
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
    /// What is checked, and the step of its differences; of vectors along [`WAY`].
    parameters: Vec<(String, f64)>,
}

/// Vectors are moved along this.
const WAY: [f64; 3] = [0.6, 0.64, 0.48];

impl Request {
    /// Gradients beside central differences, both with standard errors, of an image that is weighted by how the
    /// parameter changes it.
    pub fn answer(&self) -> Answer {
        let file = self.view.load()?;
        let rows: Result<Vec<_>, _> = self
            .parameters
            .iter()
            .map(|(name, step)| self.row(&file, name, *step))
            .collect();
        Ok(json!({ "rows": rows? }))
    }

    fn row(&self, file: &SceneFile, name: &str, step: f64) -> Answer {
        let options = self.view.options().with_samples(self.samples);
        let settings = GradCheck::new(options, &self.view.device()?)
            .with_precision(self.precision)
            .with_seeds(16, self.budget);
        let values = self.values(name);
        let checked = Checked::new(name, values.clone(), step);
        let checked = match values.len() {
            1 => checked,
            _ => checked.with_direction(WAY),
        };
        let report = gradcheck(&[checked], &settings, |point| {
            let changed = point.get(name)?;
            self.build(file, (&point.device, point.dtype), name, &changed)
        })?;
        let [row] = &report.rows[..] else {
            return Err("one row a parameter".into());
        };
        Ok(json!({
            "parameter": name,
            "gradient": [row.gradient.mean, row.gradient.error],
            "difference": [row.difference.mean, row.difference.error],
        }))
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

    /// The scene and camera with one parameter as given.
    fn build(
        &self,
        file: &SceneFile,
        kind: (&Device, DType),
        changed: &str,
        value: &Tensor<1>,
    ) -> softray::Result<(Scene, Camera)> {
        let get = |name: &str| {
            if name == changed {
                return value.clone();
            }
            let values = self.values(name);
            let count = values.len();
            Tensor::<1>::from_data(TensorData::new(values, [count]), kind)
        };
        let mut scene = file.scene.clone();
        for object in &mut scene.objects {
            object.mesh = object.mesh.clone().cast(kind.1);
        }
        if let Some((name, _)) = &self.moving {
            let velocity = get("velocity");
            scene = scene.map_object(name, |o| o.with_velocity(velocity.clone()))?;
        }
        let mut camera =
            Camera::look_at(get("eye"), get("target")).with_fov_y(get("field of view"));
        if self.lens.is_some() {
            camera = camera.with_thin_lens(get("aperture"), get("focus distance"));
        }
        Ok((scene, camera))
    }
}
