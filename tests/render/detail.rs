//! Scenes of colors at corners, normal maps and holes.

use burn::tensor::{DType, Device, Tensor};
use softray::prelude::*;
use softray::scene::CornerAttribute;

use crate::common::scenes::{diffuse, emitting, facing_down, facing_front, floor};
use crate::common::tensors::{radiance, tensor};

pub const ENGINES: [Engine; 2] = [Engine::Kernels, Engine::Tensors];

pub fn options(engine: Engine) -> RenderOptions {
    let options = RenderOptions::new(24, 24).with_samples(16).with_bounces(1);
    options.with_engine(engine).with_seed(3)
}

pub fn constant<const D: usize>(values: &[f64], shape: [usize; D]) -> Tensor<D> {
    tensor(values, shape, &Device::flex(), DType::F32)
}

/// A wall in the light of a lamp, over a floor.
pub fn lit(wall: Object) -> (Scene, Camera) {
    let device = Device::flex();
    let lamp = emitting(
        facing_down([-1.0, 1.0], [0.5, 2.0], 2.5, &device),
        [4.0, 3.5, 3.0],
    );
    let scene = Scene::new()
        .with_object(wall)
        .with_object(lamp)
        .with_object(diffuse(floor(3.0, -1.2, &device), [0.5, 0.4, 0.3]))
        .with_environment([0.2, 0.25, 0.3]);
    (
        scene,
        Camera::look_at([0.3, 0.4, 4.5], [0.0; 3]).with_fov_y(36.0),
    )
}

pub fn wall() -> Mesh {
    facing_front([-1.0, 1.0], [-1.0, 1.0], 0.0, &Device::flex())
}

pub fn seen(wall: Object, engine: Engine) -> Vec<f64> {
    let (scene, camera) = lit(wall);
    radiance(&scene, &camera, &options(engine))
}

/// The share of numbers that differ by less than that.
pub fn share_of_close(a: &[f64], b: &[f64], than: f64) -> f64 {
    assert_eq!(a.len(), b.len());
    let close = a.iter().zip(b).filter(|(a, b)| (*a - *b).abs() < than);
    close.count() as f64 / a.len() as f64
}

/// A ball with texture coordinates that mirror the image and have seams: those of vertices, of one eighth others.
pub fn ball() -> Mesh {
    let ball = shapes::icosphere(2, &Device::flex());
    let places = ball.host_vertices().expect("places");
    let at = |p: &[f64; 3], turn: f64| [p[0] * p[0] + 0.3 * p[1] + turn, 0.7 * p[2] - 0.4 * p[0]];
    let uvs: Vec<f64> = [0.0, 0.5]
        .iter()
        .flat_map(|&turn| places.iter().flat_map(move |p| at(p, turn)))
        .collect();
    let other = |f: &[u32; 3]| {
        f.iter()
            .all(|&v| places[v as usize].iter().all(|&x| x >= 0.0))
    };
    let count = places.len() as u32;
    let faces: Vec<[u32; 3]> = (ball.faces.iter())
        .map(|f| if other(f) { f.map(|v| v + count) } else { *f })
        .collect();
    let normals = ball.vertices.clone();
    let mut ball = ball.with_normals(normals);
    ball.uvs = Some(CornerAttribute::new(
        constant(&uvs, [2 * places.len(), 2]),
        faces,
    ));
    ball
}

/// A mask that is open where u is under ½.
pub fn half_open(material: Material) -> Material {
    let mut material = material.with_alpha_mask(constant(&[0.0, 1.0], [1, 2]), 0.5);
    if let Some(mask) = &mut material.alpha_mask {
        mask.wrap = Wrap::Clamp;
    }
    material
}
