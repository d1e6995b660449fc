//! What is fitted: a mesh, its textures and the light, and how they differ from photographs.

use burn::module::{Module, Param};
use burn::tensor::Int;
use burn::tensor::activation::sigmoid;
use softray::Result;
use softray::atlas::Atlas;
use softray::modules::{EnvironmentParams, NormalMapParams};
use softray::optim::Evaluation;
use softray::photographs::Photograph;
use softray::prelude::*;
use softray::scene::CornerAttribute;

/// The parameters.
#[derive(Module, Debug)]
pub struct Asset {
    pub vertices: Param<Tensor<2>>,
    /// Logits of the base color `[T, T, 3]`, and of metallic and roughness `[T, T, 2]` or `[1, 1, 2]`.
    pub base: Param<Tensor<3>>,
    pub surface: Param<Tensor<3>>,
    /// The last level has one.
    pub normals: Option<NormalMapParams>,
    pub sky: EnvironmentParams,
    /// Logarithms of the photographs' factors `[N, 3]`: exposure and white balance.
    pub gains: Param<Tensor<2>>,
}

/// What stays the same within a level.
pub struct Level {
    pub faces: Vec<[u32; 3]>,
    pub atlas: Atlas,
    /// The mesh of a level that does not move it, with normals and tangents.
    pub still: Option<Mesh>,
    /// Whether the light stands in the world, and not with the camera.
    pub world: bool,
}

impl Level {
    /// The mesh with other vertices, smooth normals and texture coordinates.
    pub fn mesh(&self, vertices: Tensor<2>, device: &Device) -> Mesh {
        let mut mesh = Mesh::new(vertices, self.faces.clone());
        let (uvs, faces) = (&self.atlas.uvs, self.atlas.faces.clone());
        mesh.uvs = Some(CornerAttribute::from_host(uvs, faces, device));
        mesh.smooth_normals()
    }
}

impl Asset {
    /// Base color `[T, T, 3]`, and metallic and roughness `[T, T]`.
    pub fn textures(&self) -> (Tensor<3>, [Tensor<2>; 2]) {
        let surface = sigmoid(self.surface.val());
        let channel = |k| surface.clone().narrow(2, k, 1).squeeze_dim::<2>(2);
        // Smoother surfaces would show more of the light than its map has.
        (
            sigmoid(self.base.val()),
            [channel(0), channel(1) * 0.9 + 0.1],
        )
    }

    /// The mesh with its material.
    pub fn object(&self, level: &Level, device: &Device) -> Object {
        let mesh = match &level.still {
            Some(still) => still.clone(),
            None => level.mesh(self.vertices.val(), device),
        };
        let (base, [metallic, roughness]) = self.textures();
        let mut material = Material::metallic_roughness(
            ColorTexture::texture(base),
            ScalarTexture::texture(metallic),
            ScalarTexture::texture(roughness),
        );
        if let Some(normals) = &self.normals {
            material = material.with_normal_map(normals.texels(), 1.0);
        }
        Object::new(mesh).with_name("asset").with_material(material)
    }

    /// The scenes and cameras of photographs.
    pub fn batch(&self, level: &Level, views: &[&Photograph], device: &Device) -> Result<Batch> {
        let object = self.object(level, device);
        let (mut scenes, mut cameras) = (Vec::new(), Vec::new());
        for view in views {
            let mut object = object.clone();
            if !level.world {
                object.mesh = object.mesh.transformed(&pose(view, device));
            }
            if !level.world || scenes.is_empty() {
                let scene = Scene::new().with_object(object);
                scenes.push(scene.with_environment(self.sky.environment()));
            }
            cameras.push(camera(view, level.world)?);
        }
        Batch::new(scenes, cameras)
    }
}

/// The camera of a photograph: in the world, or in its own frame.
pub fn camera(view: &Photograph, world: bool) -> Result<Camera> {
    let camera = if world {
        view.camera
    } else {
        view.camera.in_own_frame()
    };
    camera.to_camera()
}

/// Moves the world to the frame of a photograph's camera.
fn pose(view: &Photograph, device: &Device) -> Transform {
    let m = view.camera.from_world();
    let column = |j: usize| [0, 1, 2].map(|i| m[i][j] as f32);
    let columns = [column(0), column(1)].concat();
    Transform::new()
        .with_six_d(Tensor::from_floats(columns.as_slice(), device))
        .with_translation(Tensor::from_floats(column(3), device))
}

/// Photographs as tensors.
pub struct Targets {
    color: Tensor<4>,
    mask: Tensor<3>,
    /// The pixels that show nothing but the object.
    inside: Tensor<4>,
    /// The slope of the sRGB curve, so that errors count as they look.
    slope: Tensor<4>,
    /// Clipped values, of which one only knows that they are at least that bright.
    clipped: Tensor<4>,
}

impl Targets {
    pub fn new(views: &[&Photograph], device: &Device) -> Self {
        let color = views.iter().map(|v| v.color.clone().into_tensor(device));
        let color = Tensor::stack::<4>(color.collect(), 0);
        let size = [color.dims()[1], color.dims()[2]];
        let stack = |value: fn(&Photograph) -> Vec<f32>| {
            let map = |v: &&Photograph| Tensor::<1>::from_floats(value(v).as_slice(), device);
            let maps = views.iter().map(|v| map(v).reshape(size)).collect();
            Tensor::stack::<3>(maps, 0)
        };
        let inside = |v: &Photograph| {
            let all = v.mask.iter().zip(&v.weight);
            all.map(|(&m, &w)| if m > 0.99 { w } else { 0.0 }).collect()
        };
        Self {
            mask: stack(|v| v.mask.clone()),
            inside: stack(inside).unsqueeze_dim(3),
            slope: color.clone().clamp(0.02, 1.0).powf_scalar(1.0 / 2.4 - 1.0) * (1.055 / 2.4),
            clipped: color.clone().greater_equal_elem(0.96).float(),
            color,
        }
    }
}

/// The loss between renders and the photographs `indices`, with the PSNR of this step.
pub fn compare(
    asset: &Asset,
    image: &ImageBatch,
    to: Targets,
    indices: &[usize],
) -> Result<Evaluation> {
    let opacity = image.opacity.clone().expect("requested");
    // Only pixels without background count: a photograph has been masked, and the render has not.
    let covered = opacity.clone().detach().greater_equal_elem(0.999).float();
    let inside = to.inside * covered.inner().unsqueeze_dim(3);
    let rows: Vec<i32> = indices.iter().map(|&i| i as i32).collect();
    let rows = Tensor::<1, Int>::from_ints(rows.as_slice(), &inside.device());
    let gains = asset.gains.val();
    let gains = (gains.clone() - gains.mean_dim(0)).select(0, rows).exp();
    let error = image.radiance.clone() * gains.reshape([indices.len(), 1, 1, 3]) - to.color;
    let error = error.clone() - error.clamp_min(0.0) * to.clipped;
    let error = error * to.slope;
    let count = inside.clone().sum() * 3.0 + 1.0;
    let squared = (error.clone().powi_scalar(2) * inside.clone()).sum() / count.clone();
    // Quadratic up to 0.2 and linear beyond (pseudo-Huber).
    let huber = ((error / 0.2).powi_scalar(2) + 1.0).sqrt() - 1.0;
    let color = (huber * inside).sum() / count * 0.08;
    let shape = loss::mse(opacity, to.mask.clone())? / to.mask.mean();
    let mut smooth =
        slopes(asset.sky.log_radiance.val()) * 3e-4 + slopes(asset.surface.val()) * 1e-3;
    if let Some(normals) = &asset.normals {
        smooth = smooth + slopes(normals.slopes.val()) * 0.02;
    }
    let psnr = -10.0 * f64::from(squared.detach().into_scalar::<f32>()).log10();
    Ok(Evaluation::new(color * 40.0 + shape + smooth).with_value("PSNR", psnr))
}

/// The mean squared difference of neighbors along both axes.
fn slopes(map: Tensor<3>) -> Tensor<1> {
    let along = |axis: usize| {
        let length = map.dims()[axis] - 1;
        if length == 0 {
            return Tensor::zeros([1], &map.device());
        }
        let step = map.clone().narrow(axis, 1, length) - map.clone().narrow(axis, 0, length);
        step.powi_scalar(2).mean()
    };
    along(0) + along(1)
}
