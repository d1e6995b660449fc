use burn::module::{Module, Param};
use serde::Deserialize;
use serde_json::json;
use softray::loss;
use softray::prelude::*;

use super::{Request, adam, falling, sharp};
use crate::Answer;

#[derive(Deserialize)]
pub struct Pose {
    object: String,
    /// The unit direction in which fits start, and which parts of the place are fitted.
    way: [f64; 3],
    free: [f64; 3],
    /// Distances from the target and seeds, one fit each.
    starts: Vec<(f64, u64)>,
    /// Half-angles of cones at the start and at the end, radians.
    blur: [f64; 2],
    /// Of shadow rays and bounces alone; the view keeps its pixel filter.
    view_sharp: bool,
}

#[derive(Module, Debug)]
struct Place {
    /// Offset from the target's place `[3]`, scene units.
    offset: Param<Tensor<1>>,
}

impl Pose {
    pub fn answer(&self, request: &Request) -> Answer {
        let (file, options) = request.load()?;
        let device = request.view.device()?;
        let target = render(&file.scene, &file.camera, &sharp(&options))?.radiance;
        let free = Tensor::<1>::from_floats(self.free.map(|x| x as f32), &device);
        let scene = |offset: Tensor<1>| {
            let offset = offset * free.clone();
            let moved = |o: Object| o.map_mesh(|m| m.translated(offset.clone()));
            file.scene.clone().map_object(&self.object, moved)
        };
        let fit = |&(distance, seed): &(f64, u64)| -> Answer {
            let start = self.way.map(|x| (distance * x) as f32);
            let start = Tensor::from_floats(start, &device.clone().autodiff());
            let place = Place {
                offset: Param::from_tensor(start),
            };
            request.clock.run(
                place,
                adam(),
                seed,
                |place, share, seeds| {
                    let scene = scene(place.offset.val())?;
                    let angle = falling(self.blur, share).to_degrees();
                    let options = match self.view_sharp {
                        true => options
                            .clone()
                            .with_visibility(Visibility::Cone { angle, pixels: 0.5 }),
                        false => options.clone().with_blur(angle),
                    };
                    let see = |seed| render(&scene, &file.camera, &options.clone().with_seed(seed));
                    let [a, b] = seeds.map(see);
                    loss::mse_unbiased(a?.radiance, b?.radiance, target.clone())
                },
                |place| {
                    let offset = place.offset.val().into_data();
                    let offset = offset.iter::<f64>().zip(self.free);
                    let square: f64 = offset.map(|(x, f)| (f * x).powi(2)).sum();
                    Ok(json!(square.sqrt()))
                },
            )
        };
        let fits = self.starts.iter().map(fit).collect::<Result<Vec<_>, _>>()?;
        Ok(json!({ "fits": fits }))
    }
}
