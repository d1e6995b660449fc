use std::sync::Arc;

use burn::module::Module;
use burn::tensor::{Device, Tensor};

use super::{
    MeshParams, NormalMapParams, NormalMapParamsConfig, SurfaceNetwork, TextureParams,
    TextureParamsConfig,
};
use crate::atlas::{Atlas, AtlasOptions, Textured, transfer};
use crate::error::{Error, Result};
use crate::io::HostImage;
use crate::meshing::{SurfacePoint, TriangleMesh};
use crate::optim::loss;
use crate::scene::{ColorTexture, CornerAttribute, Material, Mesh, Object, ScalarTexture};

/// The part of an atlas that charts cover, about.
const COVERED: f64 = 0.6;
/// The least number of texels along a side.
const LEAST: usize = 32;
/// Up to this number of texels along a side, each texel has a metallic share and roughness of its own; above it, each block
/// of 2 × 2 texels.
const FINE: usize = 160;

/// A mesh with smooth normals and a metallic-roughness material in an atlas of its own, for a fit from coarse to fine:
/// vertices, base color, a network for metallic and roughness, and in the end a normal map are trained.
///
/// ```
/// use softray::meshing::TriangleMesh;
/// use softray::modules::{SurfaceNetworkConfig, TexturedMeshParams};
/// use softray::prelude::*;
/// let device = Device::flex().autodiff();
/// let ball = TriangleMesh::try_from(&shapes::icosphere(2, &Device::flex()))?;
/// let network = SurfaceNetworkConfig::new().init(&device)?;
/// let coarse = TexturedMeshParams::from_mesh(&ball, 0.1, [0.5; 3], network, &device)?;
/// // After a fit: a finer mesh near the first, with texels of half the size.
/// let finer = TriangleMesh::try_from(&shapes::icosphere(3, &Device::flex()))?;
/// let fine = coarse.remeshed(&finer, 0.05)?;
/// let object: Object = fine.with_normal_map()?.object()?;
/// assert!(object.mesh.tangents.is_some() && object.mesh.uvs.is_some());
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module)]
pub struct TexturedMeshParams {
    /// The vertices.
    pub mesh: MeshParams,
    /// The base color.
    pub base_color: TextureParams,
    /// Metallic and roughness, by base color and position.
    pub surface: SurfaceNetwork,
    /// The normal map of a mesh that stays as it is.
    pub normal_map: Option<NormalMapParams>,
    /// The points of the surface for which metallic and roughness are computed `[S, S, 3]`: those of texels, or the means of
    /// blocks.
    points: Tensor<3>,
    #[module(skip)]
    atlas: Arc<Atlas>,
}

impl TexturedMeshParams {
    /// Creates parameters for a mesh, with an atlas whose texels are about `texel` scene units wide on the surface, a base
    /// color, and a network. The network sees positions, so the mesh has about the size of the unit ball.
    ///
    /// # Errors
    /// If the mesh is not valid, a color is outside of [0, 1], or `texel` is not positive or so small that the atlas would
    /// be too large.
    pub fn from_mesh(
        mesh: &TriangleMesh,
        texel: f64,
        color: [f64; 3],
        surface: SurfaceNetwork,
        device: &Device,
    ) -> Result<Self> {
        let (atlas, block) = layout(mesh, texel)?;
        let side = atlas.size;
        let base_color = TextureParamsConfig::new(side, side)
            .with_color(color)
            .init(device)?;
        Self::of(mesh, atlas, block, base_color, surface, device)
    }

    fn of(
        mesh: &TriangleMesh,
        atlas: Atlas,
        block: usize,
        base_color: TextureParams,
        surface: SurfaceNetwork,
        device: &Device,
    ) -> Result<Self> {
        let points = atlas.texels().bake::<3>(|face, barycentric| {
            let point = SurfacePoint { face, barycentric };
            let position = point.interpolate(&mesh.faces, &mesh.positions);
            position.map(|x| x as f32)
        });
        let inner = device.clone().inner();
        let points = Tensor::<1>::from_floats(points.as_slice(), &inner);
        let points = means(points.reshape([atlas.size, atlas.size, 3]), block)?;
        let mut shape = Mesh::from_host(&mesh.positions, mesh.faces.clone(), &inner);
        let (uvs, faces) = (&atlas.uvs, atlas.faces.clone());
        shape.uvs = Some(CornerAttribute::from_host(uvs, faces, &inner));
        Ok(Self {
            mesh: MeshParams::from_mesh(&shape, device)?,
            base_color,
            surface,
            normal_map: None,
            points,
            atlas: Arc::new(atlas),
        })
    }

    /// Returns parameters for another mesh of nearly the same shape, with an atlas of its own as in
    /// [`TexturedMeshParams::from_mesh`]. The base color is taken from the nearest points; the network stays. There is no
    /// normal map.
    ///
    /// # Errors
    /// As [`TexturedMeshParams::from_mesh`], or if a tensor cannot be read.
    pub fn remeshed(&self, mesh: &TriangleMesh, texel: f64) -> Result<Self> {
        let old = self.triangle_mesh()?;
        let texels = HostImage::from_tensor(&self.base_color.texels())?;
        let textured = Textured {
            positions: &old.positions,
            faces: &old.faces,
            uvs: &self.atlas.uvs,
            uv_faces: &self.atlas.faces,
            texels: &texels.pixels,
            shape: [self.atlas.size; 2],
        };
        let (atlas, block) = layout(mesh, texel)?;
        let side = atlas.size;
        let texels = transfer::<3>(&textured, &mesh.positions, &mesh.faces, &atlas.texels())?;
        let device = self.mesh.vertices.val().device();
        let image = HostImage::new(side, side, texels)?.into_tensor(&device.clone().inner());
        let base_color = TextureParams::from_image(&image, &device)?;
        Self::of(
            mesh,
            atlas,
            block,
            base_color,
            self.surface.clone(),
            &device,
        )
    }

    /// Ends the training of the vertices, and adds a normal map without tilt.
    ///
    /// # Errors
    /// If a tensor cannot be read.
    pub fn with_normal_map(mut self) -> Result<Self> {
        let vertices = self.mesh.vertices.val();
        let (device, inner) = (vertices.device(), vertices.device().inner());
        let mut still = self.mesh.mesh();
        still.vertices = vertices.detach().to_device(&inner);
        let still = still.smooth_normals().mikktspace_tangents();
        self.mesh = MeshParams::from_mesh(&still, &device)?.no_grad();
        let side = self.atlas.size;
        self.normal_map = Some(NormalMapParamsConfig::new(side, side).init(&device)?);
        Ok(self)
    }

    /// Returns the mesh as lists.
    ///
    /// # Errors
    /// If the vertices cannot be read.
    pub fn triangle_mesh(&self) -> Result<TriangleMesh> {
        TriangleMesh::try_from(&self.mesh.mesh())
    }

    /// Returns the metallic shares and the values of roughness, as textures `[S, S]`, in the graph of the network. The base
    /// color enters without gradients.
    ///
    /// # Errors
    /// If the base color has another size than at the start.
    pub fn surface(&self) -> Result<[Tensor<2>; 2]> {
        let [size, ..] = self.points.dims();
        let colors = means(self.base_color.texels().detach(), self.atlas.size / size)?;
        let rows = |map: Tensor<3>| map.reshape([size * size, 3]);
        let outputs = self
            .surface
            .forward(rows(colors), rows(self.points.clone()));
        Ok(outputs.map(|output| output.reshape([size, size])))
    }

    /// Returns the mesh with its material, in the graph of the parameters. Its smooth normals follow the vertices.
    ///
    /// # Errors
    /// As [`TexturedMeshParams::surface`].
    pub fn object(&self) -> Result<Object> {
        Ok(self.object_of(self.surface()?))
    }

    /// Returns the mesh with a material of these metallic shares and values of roughness `[S, S]`, for losses that take what
    /// [`TexturedMeshParams::surface`] returned.
    pub fn object_of(&self, [metallic, roughness]: [Tensor<2>; 2]) -> Object {
        let mut mesh = self.mesh.mesh();
        if mesh.normals.is_none() {
            mesh = mesh.smooth_normals();
        }
        let mut material = Material::metallic_roughness(
            ColorTexture::texture(self.base_color.texels()),
            ScalarTexture::texture(metallic),
            ScalarTexture::texture(roughness),
        );
        if let Some(normals) = &self.normal_map {
            material = material.with_normal_map(normals.texels(), 1.0);
        }
        Object::new(mesh).with_material(material)
    }
}

/// An atlas, and the number of texels along a side of a block that has one metallic share and roughness.
fn layout(mesh: &TriangleMesh, texel: f64) -> Result<(Atlas, usize)> {
    let side = ((mesh.area() / COVERED).sqrt() / texel).ceil();
    Error::unless(
        side.is_finite() && texel > 0.0,
        "textured mesh",
        "texel",
        texel,
        "a width > 0",
    )?;
    let block = if side > FINE as f64 { 2 } else { 1 };
    let side = (side as usize).max(LEAST).next_multiple_of(block);
    let options = AtlasOptions {
        gutter: 2 * block,
        ..AtlasOptions::default()
    };
    Ok((
        Atlas::new(&mesh.positions, &mesh.faces, side, &options)?,
        block,
    ))
}

/// A map of the means of blocks with 1 or 2 texels along a side.
fn means(map: Tensor<3>, block: usize) -> Result<Tensor<3>> {
    Ok(loss::pyramid(map.clone(), block)?.pop().unwrap_or(map))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::host_values;
    use crate::modules::SurfaceNetworkConfig;
    use crate::render::{RenderOptions, render};
    use crate::scene::{Camera, Scene, shapes};

    fn ball(subdivisions: u32) -> Result<TriangleMesh> {
        TriangleMesh::try_from(&shapes::icosphere(subdivisions, &Device::flex()))
    }

    /// Colors that depend on the position stay there on a finer mesh with another atlas, and the network stays.
    #[test]
    fn colors_stay_where_they_are() -> Result<()> {
        let device = Device::flex().autodiff();
        let network = SurfaceNetworkConfig::new().init(&device)?;
        let of = |texel| {
            TexturedMeshParams::from_mesh(&ball(2)?, texel, [0.5; 3], network.clone(), &device)
        };
        let mut coarse = of(0.06)?;
        let color = |points: &Tensor<3>| points.clone() * 0.4 + 0.5;
        coarse.base_color = TextureParams::from_image(&color(&coarse.points), &device)?;
        let fine = coarse.remeshed(&ball(3)?, 0.04)?;
        let [found, expected] = [fine.base_color.texels(), color(&fine.points).autodiff()];
        assert_ne!(found.dims(), coarse.points.dims());
        let off = host_values(&(found - expected).abs())?;
        let far = off.iter().filter(|&&d| d > 0.03).count();
        assert!(far * 100 < off.len(), "{far} of {}", off.len());
        assert_eq!(
            host_values(&fine.surface.last.weight.val())?,
            host_values(&coarse.surface.last.weight.val())?
        );
        assert!(of(0.0).is_err());
        Ok(())
    }

    /// All parameters get gradients; with a normal map, it does and the vertices do not.
    #[test]
    fn what_is_trained() -> Result<()> {
        let device = Device::flex().autodiff();
        let network = SurfaceNetworkConfig::new().init(&device)?;
        let moving = TexturedMeshParams::from_mesh(&ball(1)?, 0.2, [0.5; 3], network, &device)?;
        let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]);
        let sky = shapes::icosphere(0, &Device::flex())
            .vertices
            .slice([0..8, 0..3]);
        let sky = crate::scene::Environment::map(sky.abs().reshape([2, 4, 3]));
        let options = RenderOptions::new(12, 12).with_samples(4).with_bounces(0);
        let gradients = |asset: &TexturedMeshParams| -> Result<_> {
            let scene = Scene::new().with_object(asset.object()?);
            let scene = scene.with_environment(sky.clone());
            let image = render(&scene, &camera, &options)?.radiance;
            Ok(image.powi_scalar(2).sum().backward())
        };
        let found = gradients(&moving)?;
        let any = |g: Option<Vec<f64>>| g.is_some_and(|g| g.iter().any(|&x| x != 0.0));
        let values = |t: Option<Tensor<2>>| t.map(|t| host_values(&t)).transpose();
        let texels = moving.base_color.logit_texels.val().grad(&found);
        assert!(any(values(moving.mesh.vertices.val().grad(&found))?));
        assert!(any(values(moving.surface.last.weight.val().grad(&found))?));
        assert!(any(values(texels.map(|t| t.flatten(0, 1)))?));

        let still = moving.with_normal_map()?;
        let found = gradients(&still)?;
        assert!(still.mesh.vertices.val().grad(&found).is_none());
        let slopes = still.normal_map.as_ref().map(|map| map.slopes.val());
        let slopes = slopes.and_then(|slopes| slopes.grad(&found));
        assert!(any(values(slopes.map(|t| t.flatten(0, 1)))?));
        Ok(())
    }
}
