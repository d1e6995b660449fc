use std::time::Instant;

use serde::Deserialize;
use serde_json::json;
use softray::prelude::*;

use crate::Answer;
use crate::scenes::View;

/// Images of several seeds, for their noise, and their times.
#[derive(Deserialize)]
pub struct Request {
    #[serde(flatten)]
    view: View,
    /// `adaptive`, or none.
    method: String,
    /// Samples a pixel.
    samples: u32,
    seeds: u64,
}

impl Request {
    pub fn answer(&self) -> Answer {
        let file = self.view.load()?;
        let mut options = self.view.options().with_samples(self.samples);
        if self.method == "adaptive" {
            options = options.with_adaptive();
        }
        let (mut times, mut images) = (Vec::new(), Vec::new());
        for seed in 0..=self.seeds {
            let start = Instant::now();
            let image = render(&file.scene, &file.camera, &options.clone().with_seed(seed))?;
            let radiance: Vec<f32> = image.radiance.into_data().iter().collect();
            // The first is not counted.
            if seed > 0 {
                times.push(start.elapsed().as_secs_f64());
                images.push(radiance);
            }
        }
        Ok(json!({ "times": times, "images": images }))
    }
}
