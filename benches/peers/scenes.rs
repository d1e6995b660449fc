use std::path::PathBuf;

use serde::Deserialize;
use softray::prelude::*;

/// A scene's file, and how it is rendered.
#[derive(Deserialize)]
pub struct View {
    scene: PathBuf,
    /// Pixels of a side.
    pub size: usize,
    pub bounces: u32,
    /// `flex` unless another is named.
    device: Option<String>,
    /// The paper's form in place of cones: σ in scene units squared, with γ = 1e-3.
    softmax: Option<f64>,
    /// Radius of the pixel filter beyond the pixel itself, in pixels, where it is not the default.
    pixels: Option<f64>,
}

impl View {
    pub fn device(&self) -> softray::Result<Device> {
        softray::device::named(Some(self.device.as_deref().unwrap_or("flex")))
    }

    pub fn load(&self) -> softray::Result<SceneFile> {
        let limits = LoadLimits::default();
        SceneFile::load_within(&self.scene, &self.device()?, &limits)
    }

    pub fn options(&self) -> RenderOptions {
        let options = RenderOptions::new(self.size, self.size).with_bounces(self.bounces);
        match (self.softmax, self.pixels) {
            (Some(sigma), _) => options.with_visibility(Visibility::softmax(sigma, 1e-3)),
            (None, Some(pixels)) => {
                options.with_visibility(Visibility::Cone { angle: 0.0, pixels })
            }
            (None, None) => options,
        }
    }
}

/// How one number x moves an object.
#[derive(Deserialize)]
pub struct Motion {
    object: String,
    /// By x times this.
    translate: Option<[f64; 3]>,
    /// By x radians about this axis through `center`.
    turn: Option<[f64; 3]>,
    #[serde(default)]
    center: [f64; 3],
}

impl Motion {
    /// The scene with the object where x `[1]` puts it.
    pub fn apply(&self, scene: &Scene, x: &Tensor<1>) -> softray::Result<Scene> {
        let scene = scene.clone();
        scene.map_object(&self.object, |o| {
            o.map_mesh(|m| {
                let vertices = self.moved(m.vertices.clone(), x);
                m.with_vertices(vertices)
            })
        })
    }

    fn moved(&self, vertices: Tensor<2>, x: &Tensor<1>) -> Tensor<2> {
        let row = |v: [f64; 3]| {
            let v = v.map(|c| c as f32);
            Tensor::<1>::from_floats(v, &vertices.device()).reshape([1, 3])
        };
        let mut vertices = vertices.clone();
        if let Some(axis) = self.turn {
            let center = row(self.center);
            let turn = Transform::new().with_axis_angle(axis, x.clone() * 1f64.to_degrees());
            vertices = turn.apply(vertices - center.clone()) + center;
        }
        if let Some(way) = self.translate {
            vertices = vertices + row(way) * x.clone().reshape([1, 1]);
        }
        vertices
    }
}
