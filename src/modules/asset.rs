use std::path::Path;

use burn::module::Module;
use burn::tensor::{Device, Tensor};

use super::{
    EnvironmentParams, EnvironmentParamsConfig, ExposureParams, ExposureParamsConfig,
    SurfaceNetworkConfig, TexturedMeshParams, ViewpointParams,
};
use crate::error::{Error, Result};
use crate::io::HostImage;
use crate::meshing::TriangleMesh;
use crate::optim::Comparison;
use crate::optim::loss::{self, PhotographErrors, PhotographLoss};
use crate::photographs::{Photograph, Region};
use crate::render::{Batch, HierarchyCache, RenderOptions, render_batch};
use crate::scene::{Camera, Environment, Object, Scene};

/// The mean base color at the start. What photographs show does not tell it from the brightness of the light.
const ALBEDO: f64 = 0.5;

/// What is fitted to photographs of an object: the object, the light, the exposures of the photographs, and their poses if
/// these are not exact.
///
/// The object is about as large as the unit ball about the origin ([`Region::make_unit`](crate::photographs::Region)), and the
/// light comes from far away. In photographs that were taken by walking around the object, the light stands in the world; in
/// those of a turntable it turns with the camera, as seen from the object.
///
/// ```
/// use softray::meshing::TriangleMesh;
/// use softray::modules::AssetParams;
/// use softray::photographs::{PhotographOptions, Photographs, Region};
/// use softray::prelude::*;
/// let set = Photographs::open("tests/data/photographs")?;
/// let options = PhotographOptions::new().with_longest_side(16).with_black_backdrop(true);
/// let mut photographs = set.load(&[0, 5, 10], &options)?.photographs;
/// Region::of_masks(&photographs)?.make_unit(&mut photographs);
/// let ball = TriangleMesh::try_from(&shapes::icosphere(2, &Device::flex()))?;
/// let asset = AssetParams::from_photographs(&photographs, &ball, 0.1, true, &Device::flex().autodiff())?;
/// // A step of a fit with two of the photographs. Gradients of the loss are those of all parameters.
/// let options = RenderOptions::new(16, 16).with_samples(2).with_bounces(0);
/// let object = asset.object.object()?;
/// let seeds = [0, 1].map(|seed| options.clone().with_seed(seed));
/// let errors = asset.errors(&object, &photographs, &[2, 0], seeds)?;
/// let loss = errors.color + errors.silhouette + asset.regularizer(asset.object.surface()?)? * 0.02;
/// assert!(loss.into_scalar::<f32>() > 0.0);
/// assert!(asset.compare(&photographs, &options, false)?.iou > 0.2);
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module, Debug)]
pub struct AssetParams {
    /// The mesh and its material.
    pub object: TexturedMeshParams,
    /// The light.
    pub sky: EnvironmentParams,
    /// The exposures of the photographs.
    pub exposure: ExposureParams,
    /// Corrections of the photographs' cameras.
    pub viewpoints: Option<ViewpointParams>,
    /// Whether the light stands in the world, and does not turn with the camera.
    pub light_stands: bool,
}

impl AssetParams {
    /// Creates parameters for photographs of an object of about the shape of a mesh, with texels of the width `texel` on it in
    /// scene units. The light is white and comes from everywhere, and the base color is what the photographs show in it: of the
    /// light's brightness and the base color, only the product is known, so that the mean base color is 0.5.
    ///
    /// # Errors
    /// If there is no photograph, and those of [`TexturedMeshParams::from_mesh`].
    pub fn from_photographs(
        photographs: &[Photograph],
        mesh: &TriangleMesh,
        texel: f64,
        light_stands: bool,
        device: &Device,
    ) -> Result<Self> {
        let count = photographs.len();
        let exposure = ExposureParamsConfig::new(count).init(device)?;
        let colors: Vec<_> = photographs.iter().map(Photograph::mean_color).collect();
        let mean = |c: usize| colors.iter().map(|color| color[c]).sum::<f64>() / count as f64;
        let color = [0, 1, 2].map(mean);
        let light = (color.iter().sum::<f64>() / 3.0 / ALBEDO).max(1e-3);
        let color = color.map(|c| (c / light).min(0.95));
        let network = SurfaceNetworkConfig::new().init(device)?;
        Ok(Self {
            object: TexturedMeshParams::from_mesh(mesh, texel, color, network, device)?,
            sky: EnvironmentParamsConfig::new(16, 32)
                .with_radiance([light; 3])
                .init(device)?,
            exposure,
            viewpoints: None,
            light_stands,
        })
    }

    /// Returns parameters for another mesh near the present one, as [`TexturedMeshParams::remeshed`], with a light of `rows` ×
    /// 2 · `rows` texels.
    ///
    /// # Errors
    /// As [`TexturedMeshParams::remeshed`] and [`EnvironmentParams::resized`].
    pub fn remeshed(self, mesh: &TriangleMesh, texel: f64, rows: usize) -> Result<Self> {
        Ok(Self {
            object: self.object.remeshed(mesh, texel)?,
            sky: self.sky.resized(rows)?,
            ..self
        })
    }

    /// Adds corrections of cameras: `photographs` are those given to [`AssetParams::from_photographs`], in the same order, at
    /// any size.
    ///
    /// # Errors
    /// If their number is another, and those of [`ViewpointParams::from_cameras`].
    pub fn with_viewpoints(self, photographs: &[Photograph]) -> Result<Self> {
        self.check_count(photographs.len())?;
        let given = |p: &Photograph| {
            let own = p.camera.in_own_frame();
            let camera = if self.light_stands { p.camera } else { own };
            camera.to_camera()
        };
        let cameras = photographs.iter().map(given).collect::<Result<Vec<_>>>()?;
        let away = |p: &Photograph| glam::DVec3::from(p.camera.position()).length();
        let distance = photographs.iter().map(away).sum::<f64>() / photographs.len() as f64;
        let device = self.object.mesh.vertices.val().device();
        let viewpoints = ViewpointParams::from_cameras(&cameras, distance, &device)?;
        Ok(Self {
            viewpoints: Some(viewpoints),
            ..self
        })
    }

    /// Checks that there are as many photographs as those to which this is fitted.
    pub(super) fn check_count(&self, count: usize) -> Result<()> {
        let [expected, _] = self.exposure.log_factors.val().dims();
        Error::unless(
            count == expected,
            "asset",
            "photographs",
            count,
            &expected.to_string(),
        )
    }

    /// Returns the same object and light for other photographs, such as held-out ones: only corrections of their cameras are
    /// trained. The common factor of the focal lengths stays.
    ///
    /// # Errors
    /// As [`ExposureParamsConfig::init`] and [`ViewpointParams::from_cameras`].
    pub fn for_photographs(&self, photographs: &[Photograph]) -> Result<Self> {
        let device = self.object.mesh.vertices.val().device();
        let exposure = ExposureParamsConfig::new(photographs.len()).init(&device)?;
        let known = Self {
            exposure,
            viewpoints: None,
            ..self.clone()
        };
        let mut asset = known.no_grad().with_viewpoints(photographs)?;
        if let Some(new) = &mut asset.viewpoints {
            let known = self.viewpoints.as_ref().unwrap_or(new);
            new.log_focal = known.log_focal.clone().no_grad();
        }
        Ok(asset)
    }

    /// Returns the scene and the camera of a photograph, with an object such as [`TexturedMeshParams::object`]. If the light
    /// turns with the camera, both are in the camera's frame. With an index, the camera is corrected as that of the
    /// photograph with this index; without one, only its focal length is.
    ///
    /// # Errors
    /// If the camera is not valid, or there is no correction of this index.
    pub fn view(
        &self,
        object: &Object,
        sky: &Environment,
        photograph: &Photograph,
        index: Option<usize>,
    ) -> Result<(Scene, Camera)> {
        let (mut object, mut camera) = (object.clone(), photograph.camera);
        if !self.light_stands {
            let device = object.mesh.vertices.device().inner();
            object.mesh = object.mesh.transformed(&camera.world_to_own_frame(&device));
            camera = camera.in_own_frame();
        }
        let scene = Scene::new()
            .with_object(object)
            .with_environment(sky.clone());
        let camera = match (&self.viewpoints, index) {
            (Some(viewpoints), Some(index)) => Camera {
                projection: viewpoints.with_focal(camera.to_camera()?)?.projection,
                ..viewpoints.camera(index)?
            },
            (Some(viewpoints), None) => viewpoints.with_focal(camera.to_camera()?)?,
            (None, _) => camera.to_camera()?,
        };
        Ok((scene, camera))
    }

    /// Compares renders with those photographs of a list whose indices are in `views`, by [`PhotographLoss`] of two renders that
    /// share one [`HierarchyCache`]. The first options are those of the render for the errors, the others those of the render for the
    /// derivatives; they need other seeds. The size is that of the photographs.
    ///
    /// # Errors
    /// If an index is out of range, and those of [`AssetParams::view`], [`PhotographLoss`] and [`render_batch`].
    pub fn errors(
        &self,
        object: &Object,
        photographs: &[Photograph],
        views: &[usize],
        options: [RenderOptions; 2],
    ) -> Result<PhotographErrors> {
        let count = photographs.len();
        let shown = |&i: &usize| {
            let expected = format!("less than {count}");
            let missing = || Error::invalid("asset", "view", i, expected);
            photographs.get(i).ok_or_else(missing)
        };
        let shown = views.iter().map(shown).collect::<Result<Vec<_>>>()?;
        let loss = PhotographLoss::new(&shown, &object.mesh.vertices.device())?;
        let sky = self.sky.environment();
        let pairs = views.iter().zip(&shown);
        let pairs = pairs.map(|(&i, p)| self.view(object, &sky, p, Some(i)));
        let (mut scenes, cameras): (Vec<_>, Vec<_>) =
            pairs.collect::<Result<Vec<_>>>()?.into_iter().unzip();
        if self.light_stands {
            scenes.truncate(1);
        }
        let batch = Batch::new(scenes, cameras)?;
        let cache = HierarchyCache::new();
        let [errors, image] = options.map(|options| {
            let mut options = options.with_opacity().with_cache(&cache);
            [options.width, options.height] = shown[0].camera.size;
            render_batch(&batch, &options)
        });
        loss.forward(&errors?, &image?, Some(self.exposure.factors(views)?))
    }

    /// Returns a penalty `[1]`, to add to a loss whose value is about 1, from the metallic shares and values of roughness
    /// `[S, S]` that [`TexturedMeshParams::surface`] returns. Light and textures are smooth ([`loss::smoothness`] of logarithms
    /// and logits). Light is white, relative to its power, because colors are judged under it (as in nvdiffrec, Munkberg et al.
    /// 2022). What looks the same as paint and as rough metal is paint, as most things are (metallic · roughness).
    ///
    /// # Errors
    /// If a texture is empty.
    pub fn regularizer(&self, [metallic, roughness]: [Tensor<2>; 2]) -> Result<Tensor<1>> {
        let sky = self.sky.texels();
        let gray = sky.clone().mean_dim(2);
        let power = gray.clone().detach().powi_scalar(2).mean();
        let mut sum = (metallic * roughness).mean() * 0.03
            + (sky - gray).powi_scalar(2).mean() * 0.06 / power
            + loss::smoothness(self.sky.log_radiance.val())? * 3e-4
            + loss::smoothness(self.object.base_color.logit_texels.val())? * 0.005;
        if let Some(normals) = &self.object.normal_map {
            sum = sum + loss::smoothness(normals.slopes.val())? * 0.02;
        }
        Ok(sum)
    }

    /// Writes `asset.glb`, the object where it is in the world of the files of
    /// [`ObjectPhotographs`](crate::photographs::ObjectPhotographs), and `light.exr`, the
    /// environment map, into a folder that is there.
    ///
    /// # Errors
    /// If a tensor can't be read or a file can't be written.
    pub fn write(&self, folder: impl AsRef<Path>, region: &Region) -> Result<()> {
        let (asset, folder) = (self.valid(), folder.as_ref());
        let mut object = asset.object.object()?.with_name("asset");
        object.mesh = object.mesh.scaled(region.radius).translated(region.center);
        Scene::new()
            .with_object(object)
            .write(folder.join("asset.glb"))?;
        HostImage::from_tensor(&asset.sky.texels())?.write(folder.join("light.exr"))
    }

    /// Measures how well photographs agree. If `corrected`, these are all that are fitted to, in their order, and their cameras
    /// are corrected; else they can be any, and only the common factor of the focal lengths corrects their cameras.
    ///
    /// # Errors
    /// If `corrected` and there are no corrections or those of another number of photographs, and those of
    /// [`Comparison::new`].
    pub fn compare(
        &self,
        photographs: &[Photograph],
        options: &RenderOptions,
        corrected: bool,
    ) -> Result<Comparison> {
        if corrected {
            self.check_count(photographs.len())?;
            let there = self.viewpoints.is_some();
            Error::unless(there, "asset", "viewpoints", "none", "with_viewpoints")?;
        }
        let asset = self.valid();
        let (object, sky) = (asset.object.object()?, asset.sky.environment());
        let mut indices = 0..;
        Comparison::new(photographs, options, |p| {
            asset.view(&object, &sky, p, indices.next().filter(|_| corrected))
        })
    }
}
