//! What is fitted: a mesh, its textures and the light.

use burn::module::{Module, Param};
use softray::Result;
use softray::atlas::Atlas;
use softray::modules::{
    EnvironmentParams, ExposureParams, NormalMapParams, SurfaceNetwork, TextureParams,
};
use softray::photographs::Photograph;
use softray::prelude::*;
use softray::scene::CornerAttribute;

/// The parameters.
#[derive(Module, Debug)]
pub struct Asset {
    pub vertices: Param<Tensor<2>>,
    pub base: TextureParams,
    pub surface: SurfaceNetwork,
    /// The last level has one.
    pub normals: Option<NormalMapParams>,
    pub sky: EnvironmentParams,
    pub exposure: ExposureParams,
}

/// What stays the same within a level.
pub struct Level {
    pub faces: Vec<[u32; 3]>,
    pub atlas: Atlas,
    /// The points of the surface `[S, S, 3]` for which metallic and roughness are computed; texels of the base color, or means
    /// of them.
    pub places: Tensor<3>,
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
    /// Metallic and roughness `[S, S]`. The base color enters the network without gradients.
    pub fn surface(&self, level: &Level) -> Result<[Tensor<2>; 2]> {
        let [size, ..] = level.places.dims();
        let colors = shrunk(self.base.texels().detach(), level.atlas.size / size)?;
        let rows = |map: Tensor<3>| map.reshape([size * size, 3]);
        let outputs = self
            .surface
            .forward(rows(colors), rows(level.places.clone()));
        Ok(outputs.map(|output| output.reshape([size, size])))
    }

    /// The mesh with its material.
    pub fn object(&self, level: &Level, [metallic, roughness]: [Tensor<2>; 2]) -> Object {
        let mesh = match &level.still {
            Some(still) => still.clone(),
            None => level.mesh(self.vertices.val(), &level.places.device()),
        };
        let mut material = Material::metallic_roughness(
            ColorTexture::texture(self.base.texels()),
            ScalarTexture::texture(metallic),
            ScalarTexture::texture(roughness),
        );
        if let Some(normals) = &self.normals {
            material = material.with_normal_map(normals.texels(), 1.0);
        }
        Object::new(mesh).with_name("asset").with_material(material)
    }

    /// The scenes and cameras of photographs.
    pub fn batch(&self, object: &Object, world: bool, views: &[&Photograph]) -> Result<Batch> {
        let device = object.mesh.vertices.device().inner();
        let (mut scenes, mut cameras) = (Vec::new(), Vec::new());
        for view in views {
            let mut object = object.clone();
            if !world {
                object.mesh = object.mesh.transformed(&pose(view, &device));
            }
            if !world || scenes.is_empty() {
                let scene = Scene::new().with_object(object);
                scenes.push(scene.with_environment(self.sky.environment()));
            }
            cameras.push(camera(view, world)?);
        }
        Batch::new(scenes, cameras)
    }
}

/// A map with means of `share` × `share` texels, of which there are 1 or 4.
pub fn shrunk(map: Tensor<3>, share: usize) -> Result<Tensor<3>> {
    Ok(loss::pyramid(map.clone(), share)?.pop().unwrap_or(map))
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
