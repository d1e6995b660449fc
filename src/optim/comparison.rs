//! Renders beside photographs.

use burn::tensor::Tensor;

use super::{loss, metrics};
use crate::error::Result;
#[cfg(feature = "fit")]
use crate::figure::{Figure, Panel};
use crate::io::HostImage;
use crate::photographs::Photograph;
use crate::render::{RenderOptions, render};
use crate::scene::{Camera, Detach, Object, Scene, shapes, visit_camera, visit_scene};

/// How well renders of a scene's objects agree with photographs that have masks, such as held-out views.
///
/// ```
/// use softray::optim::Comparison;
/// use softray::photographs::{PhotographOptions, Photographs};
/// use softray::prelude::*;
/// let set = Photographs::open("tests/data/photographs")?;
/// let options = PhotographOptions::new().with_longest_side(16).with_black_backdrop(true);
/// let photographs = set.load(&[0, 5], &options)?.photographs;
/// let ball = Object::new(shapes::icosphere(2, &Device::flex()).scaled(1.3));
/// let scene = Scene::new().with_object(ball).with_environment([0.4; 3]);
/// let options = RenderOptions::new(1, 1).with_samples(16).with_bounces(0);
/// let found = Comparison::new(&photographs, &options, |p| Ok((scene.clone(), p.camera.to_camera()?)))?;
/// assert!(found.iou > 0.4 && found.images.len() == 2);
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Debug, serde::Serialize)]
pub struct Comparison {
    /// The renders: the objects before black, where the photographs' pixels are.
    #[serde(skip)]
    pub images: Vec<HostImage>,
    /// [`metrics::psnr_srgb`] in the boxes of the masks, in dB.
    pub psnr_srgb: f64,
    /// [`metrics::psnr_linear`] inside of the masks, in dB.
    pub psnr_linear: f64,
    /// [`metrics::ssim_srgb`].
    pub ssim: f64,
    /// The mean over views of the intersection over union of opacity and mask above 0.5 ([`loss::iou`]).
    pub iou: f64,
}

impl Comparison {
    /// Renders the scene and camera that `view` returns for each photograph, and compares. `view` is called once for each, in
    /// order. The environment that is seen beside the objects is left out, and the size is the photograph's (that of
    /// `options` does not count).
    ///
    /// # Errors
    /// If there is no photograph, a mask has no pixel above 0.5, or a render fails; and those of `view`.
    pub fn new(
        photographs: &[Photograph],
        options: &RenderOptions,
        mut view: impl FnMut(&Photograph) -> Result<(Scene, Camera)>,
    ) -> Result<Self> {
        let (mut images, mut iou) = (Vec::new(), 0.0);
        let mut device = None;
        for photograph in photographs {
            let [width, height] = photograph.camera.size;
            let mut options = options.clone().with_opacity();
            (options.width, options.height) = (width, height);
            let (scene, camera) = view(photograph)?;
            let (image, opacity) = foreground(scene, camera, &options)?;
            let mask = Tensor::<1>::from_floats(photograph.mask.as_slice(), &opacity.device());
            iou += loss::iou(&opacity, &mask.reshape([height, width]), 0.5)?;
            device = Some(opacity.device());
            images.push(image);
        }
        let inside = |p: &Photograph| p.mask.iter().map(|&m| m > 0.5).collect();
        let masks: Vec<Vec<bool>> = photographs.iter().map(inside).collect();
        let views = images.iter().zip(photographs).zip(&masks);
        let views = views.map(|((i, p), m)| metrics::View::new(i, &p.color, m));
        let views: Vec<_> = views.collect::<Result<_>>()?;
        Ok(Self {
            psnr_srgb: metrics::psnr_srgb(&views)?,
            psnr_linear: metrics::psnr_linear(&views)?,
            ssim: metrics::ssim_srgb(&views, &device.unwrap_or_default())?,
            iou: iou / photographs.len() as f64,
            images,
        })
    }

    /// Draws about `count` photographs above their renders and the differences.
    ///
    /// # Errors
    /// If the photographs are not those that were compared.
    #[cfg(feature = "fit")]
    pub fn figure(&self, photographs: &[Photograph], count: usize) -> Result<Figure> {
        let step = self.images.len().div_ceil(count.max(1)).max(1);
        let few = || self.images.iter().zip(photographs).step_by(step);
        let difference =
            |(i, p): (_, &Photograph)| Panel::difference("render − photograph", i, &p.color);
        let differences = few().map(difference).collect::<Result<Vec<_>>>()?;
        Ok(Figure::new("")
            .with_height(200)
            .with_row(few().map(|(_, p)| (p.name.as_str(), &p.color)))
            .with_row(few().map(|(image, _)| ("render", image)))
            .with_row(differences))
    }
}

/// A render of the objects before black, and their opacity. What is seen beside them is subtracted; it is that of a scene whose
/// only object is too small to be seen.
fn foreground(
    mut scene: Scene,
    mut camera: Camera,
    options: &RenderOptions,
) -> Result<(HostImage, Tensor<2>)> {
    visit_scene(&mut scene, &mut Detach);
    visit_camera(&mut camera, &mut Detach);
    let image = render(&scene, &camera, options)?;
    let opacity = image.opacity.expect("requested");
    let dot = shapes::cube(&opacity.device()).scaled(1e-6);
    let dot = dot.translated(camera.target.values()?);
    scene.objects = vec![Object::new(dot)].into();
    let beside = render(&scene, &camera, options)?.radiance;
    let beside = beside * (opacity.clone().neg() + 1.0).unsqueeze_dim(2);
    Ok((HostImage::from_tensor(&(image.radiance - beside))?, opacity))
}
