use burn::module::{Module, Param};
use burn::tensor::TensorData;
use serde::Deserialize;
use serde_json::json;
use softray::prelude::*;

use super::{Request, adam, sharp};
use crate::Answer;

#[derive(Deserialize)]
pub struct Surface {
    /// The plate with the texture, a square about the origin of this half side, and the lamp.
    object: String,
    light: String,
    half: f64,
    eyes: Vec<[f64; 3]>,
    /// Texels [H, W, 3] of the target.
    texels: Vec<Vec<[f32; 3]>>,
    /// k_s, which is known.
    specular: f64,
    /// Of the lobe, as the width α = √(2/(n + 2)): the target's and that of the start.
    alpha: [f64; 2],
    /// Radiance of the lamp: the target's and that of the start.
    radiance: [[f64; 3]; 2],
    /// Seeds, one fit each.
    seeds: Vec<u64>,
}

#[derive(Module, Debug)]
struct Parts {
    /// Logits of the texels.
    texture: TextureParams,
    /// ln n.
    shininess: Param<Tensor<1>>,
    /// ln of the radiance.
    radiance: Param<Tensor<1>>,
}

fn exponent(alpha: f64) -> f64 {
    2.0 / (alpha * alpha) - 2.0
}

impl Surface {
    pub fn answer(&self, request: &Request) -> Answer {
        let (file, options) = request.load()?;
        let device = request.view.device()?;
        let (height, width) = (self.texels.len(), self.texels[0].len());
        let flat = self.texels.iter().flatten().flatten().copied();
        let texels: Vec<f32> = flat.collect();
        let eye = |&eye: &[f64; 3]| Camera::look_at(eye, [0.0; 3]).with_fov_y(40.0);
        let cameras: Vec<Camera> = self.eyes.iter().map(eye).collect();
        let scene = |texels: Tensor<3>, n: Parameter<1>, radiance: Parameter<3>| {
            let texels = ColorTexture::texture(texels);
            let surface = Material::phong(texels, [self.specular; 3], n);
            let scene = file.scene.clone().map_object(&self.object, |o| {
                let mesh = o.mesh.clone();
                let uvs = self.uvs(&mesh);
                o.map_mesh(|m| m.with_uvs(uvs))
                    .with_material(surface.clone())
            })?;
            let lamp = Material::emitter(radiance);
            let scene = scene.map_object(&self.light, |o| o.with_material(lamp.clone()))?;
            Batch::product(vec![scene], &cameras)
        };
        let still = TensorData::new(texels.clone(), [height, width, 3]);
        let still = Tensor::from_data(still, &device);
        let n = exponent(self.alpha[0]);
        let still = scene(still, [n].into(), self.radiance[0].into())?;
        let target = render_batch(&still, &sharp(&options))?.radiance;
        let fit = |&seed: &u64| {
            let device = device.clone().autodiff();
            let leaf = |v: &[f64]| {
                let v: Vec<f32> = v.iter().map(|x| x.ln() as f32).collect();
                Param::from_tensor(Tensor::<1>::from_floats(v.as_slice(), &device))
            };
            let parts = Parts {
                texture: TextureParamsConfig::new(height, width).init(&device)?,
                shininess: leaf(&[exponent(self.alpha[1])]),
                radiance: leaf(&self.radiance[1]),
            };
            request.clock.run(
                parts,
                adam(),
                seed,
                |parts, _, seeds| {
                    let (n, radiance) = (parts.shininess.val().exp(), parts.radiance.val().exp());
                    let batch = scene(parts.texture.texels(), n.into(), radiance.into())?;
                    let see = |seed| render_batch(&batch, &options.clone().with_seed(seed));
                    let [a, b] = seeds.map(see);
                    let (a, b) = (a?.radiance, b?.radiance);
                    Ok(((a - target.clone()) * (b - target.clone())).mean())
                },
                |parts| {
                    let numbers = |t: Tensor<1>| t.exp().into_data().iter::<f64>().collect::<Vec<_>>();
                    let found: Vec<f32> = parts.texture.texels().into_data().iter().collect();
                    let n = numbers(parts.shininess.val())[0];
                    let radiance = numbers(parts.radiance.val());
                    Ok(json!({ "texels": found, "alpha": (2.0 / (n + 2.0)).sqrt(), "radiance": radiance }))
                },
            )
        };
        let fits = self.seeds.iter().map(fit).collect::<Result<Vec<_>, _>>()?;
        Ok(json!({ "fits": fits }))
    }

    /// Texture coordinates by place, seen from above.
    fn uvs(&self, mesh: &Mesh) -> Tensor<2> {
        let vertices = mesh.vertices.clone();
        let [count, _] = vertices.dims();
        let x = vertices.clone().slice([0..count, 0..1]);
        let z = vertices.slice([0..count, 2..3]);
        Tensor::cat(vec![x, z], 1).div_scalar(2.0 * self.half) + 0.5
    }
}
