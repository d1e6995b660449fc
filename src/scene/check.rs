//! Checks of a scene and a camera. Errors name the object and the field.

use std::collections::HashSet;

use burn::tensor::Tensor;

use super::bsdf::range_of_constants;
use super::parameter::Described;
use super::parameters::{Visit, look_at_scene, visit_camera};
use super::texture::{ScalarTexture, Value};
use super::{Bsdf, Camera, ColorTexture, Material, Object, Parameter, Scene};
use crate::device::{self, label};
use crate::error::{Error, Result};
use crate::geometry::{Context, first_outside, place_of};
use softray_kernels::host::{MIN_CONTRAST, ParameterId};

/// Checks that all tensors of a scene are of one device and float type, and returns these.
pub(crate) fn check_devices(scene: &Scene) -> Result<Context> {
    let triangles: usize = scene.objects.iter().map(|o| o.mesh.faces.len()).sum();
    if triangles == 0 {
        return Err(Error::NoTriangles {
            path: None,
            objects: scene.objects.len(),
        });
    }
    let first = &scene.objects[0].mesh.vertices;
    let context = Context {
        device: first.device().inner(),
        dtype: first.dtype(),
    };
    device::check(&context.device)?;
    let mut check = SameDevice {
        context: &context,
        place: &|id| scene.place_of(id),
        result: Ok(()),
    };
    look_at_scene(scene, &mut check);
    check.result?;
    Ok(context)
}

/// Checks all of a scene.
pub(crate) fn check_scene(scene: &Scene) -> Result<()> {
    check_devices(scene)?;
    check_values(scene)
}

/// Checks that values of a scene are finite and in range.
pub(super) fn check_values(scene: &Scene) -> Result<()> {
    let mut check = Values {
        place: &|id| scene.place_of(id),
        result: Ok(()),
        seen: HashSet::new(),
    };
    look_at_scene(scene, &mut check);
    check.result?;
    scene.objects.iter().try_for_each(Object::check)?;
    let mut lights = scene.lights.iter().enumerate();
    lights.try_for_each(|(i, light)| light.host(&light_name(i)).map(drop))
}

impl Camera {
    /// Checks that values are in range, and tensors of the scene's device and float type if there is a scene.
    pub(crate) fn check(&self, context: Option<&Context>) -> Result<()> {
        if let Some(context) = context {
            self.check_device(context)?;
        }
        let mut check = Values {
            place: &|_| "camera".into(),
            result: Ok(()),
            seen: HashSet::new(),
        };
        visit_camera(&mut self.clone(), &mut check);
        check.result?;
        self.check_view()
    }

    /// Checks that tensors are of the scene's device and float type.
    pub(crate) fn check_device(&self, context: &Context) -> Result<()> {
        let mut check = SameDevice {
            context,
            place: &|_| "camera".into(),
            result: Ok(()),
        };
        visit_camera(&mut self.clone(), &mut check);
        check.result
    }
}

impl Material {
    /// That constants make no energy and are in their ranges. Tensors may wander outside for a step of a fit.
    pub(crate) fn check_energy(&self, name: &str) -> Result<()> {
        for (channel, value) in self.clone().bsdf.channels() {
            let range = range_of_constants(channel);
            range.check(name, channel.name(), value.constants())?;
        }
        match &self.bsdf {
            Bsdf::Phong {
                diffuse, specular, ..
            } => check_sum(name, diffuse, specular),
            Bsdf::Dielectric { ior, .. } => check_contrast(name, ior),
            _ => Ok(()),
        }
    }
}

/// That constant albedos are at most 1 together.
fn check_sum(name: &str, diffuse: &ColorTexture, specular: &ColorTexture) -> Result<()> {
    let (Some(d), Some(s)) = (diffuse.constant(), specular.constant()) else {
        return Ok(());
    };
    let sum: [f64; 3] = std::array::from_fn(|i| d[i] + s[i]);
    if sum.iter().all(|&x| x <= 1.0 + 1e-6) {
        return Ok(());
    }
    let field = match (diffuse.reflects(), specular.reflects()) {
        (_, false) => "diffuse",
        (false, _) => "specular",
        _ => "diffuse + specular",
    };
    let expected = "at most 1: divide 8-bit colors by 255, and convert them from sRGB";
    Err(Error::invalid(name, field, format!("{sum:?}"), expected))
}

/// That a constant index of refraction is not 1.
fn check_contrast(name: &str, ior: &ScalarTexture) -> Result<()> {
    let ScalarTexture::Constant(Parameter::Constant([ior])) = *ior else {
        return Ok(());
    };
    let expected = "a number that is at least 0.001 away from 1, or nothing is refracted";
    let refracts = (ior - 1.0).abs() >= MIN_CONTRAST;
    Error::unless(refracts, name, "ior", ior, expected)
}

/// Checks the device and the float type of every tensor, up to the first mistake.
struct SameDevice<'a> {
    context: &'a Context,
    /// The name of the object of a parameter.
    place: &'a dyn Fn(ParameterId) -> String,
    result: Result<()>,
}

impl Visit for SameDevice<'_> {
    fn visit<const D: usize>(&mut self, id: ParameterId, tensor: &mut Tensor<D>) {
        let context = self.context;
        let (device, dtype) = (tensor.device(), tensor.dtype());
        let like = "like the scene's first object";
        let (found, expected) = if device != context.device {
            let there = label(&context.device);
            let expected =
                format!("{there} {like}: make it there, or move it by Tensor::to_device");
            (format!("on the device {}", label(&device)), expected)
        } else if dtype != context.dtype {
            let expected = format!("{:?} {like}: Tensor::cast changes it", context.dtype);
            (format!("of dtype {dtype:?}"), expected)
        } else {
            return;
        };
        if self.result.is_ok() {
            let place = (self.place)(id);
            self.result = Err(Error::invalid(place, id.name(), found, expected));
        }
    }
}

/// Checks every value, up to the first mistake.
struct Values<'a> {
    place: &'a dyn Fn(ParameterId) -> String,
    result: Result<()>,
    /// Where the numbers of images lie that were looked at, which many materials may share.
    seen: HashSet<(usize, Vec<usize>)>,
}

impl Values<'_> {
    /// Where nothing was found, the result for the object and the field.
    fn add(&mut self, id: ParameterId, check: impl Fn(&str, &str) -> Result<()>) {
        // The name is looked for where there is a mistake: for each value of many objects it would take long.
        if self.result.is_ok() && check("", id.name()).is_err() {
            self.result = check(&(self.place)(id), id.name());
        }
    }
}

impl Visit for Values<'_> {
    fn visit<const D: usize>(&mut self, _: ParameterId, _: &mut Tensor<D>) {}

    fn parameter<const C: usize>(&mut self, id: ParameterId, p: &mut Parameter<C>) {
        self.add(id, |object, field| {
            p.check(object, field, id.range()).map(drop)
        });
    }

    fn image<const D: usize>(&mut self, id: ParameterId, texels: &mut Tensor<D>) {
        let place = place_of(texels).map(|(first, dims)| (first, dims.to_vec()));
        if place.is_some_and(|place| !self.seen.insert(place)) {
            return;
        }
        self.add(id, |object, field| {
            let dims = texels.dims();
            let (h, w) = (dims[0], dims[1]);
            let (channels, expected) = match D {
                2 => (1, "shape [H, W]"),
                _ => (3, "shape [H, W, 3]"),
            };
            if h == 0 || w == 0 || dims[2..].iter().any(|&c| c != channels) {
                let found = format!("of shape {dims:?}");
                return Err(Error::invalid(object, field, found, expected));
            }
            let range = id.range();
            let Some((i, value)) = first_outside(texels, |v| range.holds(v))? else {
                return Ok(());
            };
            let texel = i / channels;
            let field = format!("{field} texel ({}, {})", texel / w, texel % w);
            Err(Error::invalid(object, field, value, range.expected(2)))
        });
    }
}

/// The name of a light in messages.
fn light_name(index: usize) -> String {
    format!("light {index}")
}

impl Scene {
    /// The name of the object of a tensor, for messages.
    fn place_of(&self, id: ParameterId) -> String {
        use ParameterId as Id;
        match id {
            Id::Vertices(i)
            | Id::Uvs(i)
            | Id::Normals(i)
            | Id::Colors(i)
            | Id::Tangents(i)
            | Id::Velocity(i) => self.objects[i].name.clone(),
            Id::Material(m, _) | Id::NormalMap(m) => {
                let all = self.objects.iter();
                let mut all = all.flat_map(|o| (0..o.materials.len()).map(|i| o.material_name(i)));
                all.nth(m).unwrap_or_default()
            }
            Id::Light(i, _) => light_name(i),
            _ => "scene".into(),
        }
    }
}

impl Object {
    pub(super) fn material_name(&self, index: usize) -> String {
        format!("{}, material {}", self.name, self.materials[index].name)
    }

    fn check(&self) -> Result<()> {
        self.mesh.check(&self.name)?;
        let wrong = |field: &str, found: String, expected: String| {
            Err(Error::invalid(&self.name, field, found, expected))
        };
        let (faces, count) = (self.mesh.faces.len(), self.materials.len());
        let of_face = &self.face_materials;
        if count == 0 {
            return wrong("materials", "empty".into(), "at least one material".into());
        }
        if !of_face.is_empty() && of_face.len() != faces {
            let expected = format!("one for each of the {faces} faces, or empty");
            let found = format!("of length {}", of_face.len());
            return wrong("face_materials", found, expected);
        }
        if let Some(f) = of_face.iter().position(|&m| m as usize >= count) {
            let field = format!("material of face {f}");
            let expected = format!("an index under {count}");
            return wrong(&field, of_face[f].to_string(), expected);
        }
        let mut used = vec![false; count];
        match of_face.as_slice() {
            [] => used[0] = faces > 0,
            list => list.iter().for_each(|&m| used[m as usize] = true),
        }
        for (i, material) in self.materials.iter().enumerate() {
            let name = self.material_name(i);
            material.check_energy(&name)?;
            if !used[i] || self.mesh.uvs.is_some() {
                continue;
            }
            let mut material = material.clone();
            for (field, has) in [
                ("normal map", material.normal_map.is_some()),
                ("alpha mask", material.alpha_mask.is_some()),
            ] {
                if has {
                    let expected = "none, since the mesh has no texture coordinates: \
                                    Mesh::with_uvs adds them";
                    return Err(Error::invalid(name, field, "an image", expected));
                }
            }
            let is_image = |v: &Value| matches!(v, Value::Image(..) | Value::ScalarImage(..));
            let mut channels = material.channels();
            if let Some((channel, _)) = channels.find(|(_, v)| is_image(v)) {
                let expected =
                    "a color, since the mesh has no texture coordinates: Mesh::with_uvs adds them";
                return Err(Error::invalid(name, channel.name(), "a texture", expected));
            }
        }
        Ok(())
    }
}
