//! Descriptions of scenes by tensors: meshes, materials, transforms, objects, lights, environments and cameras.

mod angles;
mod bounds;
mod bsdf;
mod camera;
mod check;
mod cornell;
mod corners;
mod debug;
mod details;
mod environment;
mod flatten;
mod host;
mod host_textures;
mod lens;
mod light;
mod list;
mod maps;
mod material;
mod material_planes;
mod mesh;
mod normals;
mod parameter;
mod parameters;
mod pixel_rays;
mod placement;
pub mod shapes;
#[cfg(feature = "remote")]
pub(crate) mod slots;
mod tangents;
mod texture;
mod transfer;
mod transform;
mod viewpoint;

pub(crate) use angles::{narrow_in_radians, warn_of_narrow_view, warn_of_radians};
pub use bsdf::Bsdf;
pub use camera::{Camera, Projection};
pub(crate) use check::{check_devices, check_scene};
pub use cornell::cornell_box;
pub use corners::CornerAttribute;
pub use environment::Environment;
pub(crate) use flatten::{EnvironmentMap, Flattened, Normalization, SkyTensors};
pub use lens::ThinLens;
pub use light::Light;
pub(crate) use light::LightPlanes;
pub use list::List;
pub use maps::{AlphaMask, NormalMap};
pub use material::Material;
pub(crate) use material_planes::ChannelPlanes;
pub use mesh::Mesh;
pub(crate) use mesh::{host_tensor, take_rows};
pub use parameter::Parameter;
pub(crate) use parameter::{Described, Range};
pub(crate) use parameters::{
    Collect, Detach, Replace, Visit, look_at_scene, visit_camera, visit_scene, visit_tensors,
};
pub use placement::Scale;
#[cfg(feature = "gpu")]
pub(crate) use texture::Value;
pub use texture::{ColorTexture, ScalarTexture};
pub(crate) use transfer::{Constants, Identity, Transfer, host_device};
pub use transform::Transform;
pub(crate) use viewpoint::Framing;
pub use viewpoint::Matrix;

use std::sync::Arc;

use crate::error::{Error, Result, one_of};
#[doc(inline)]
pub use softray_kernels::host::{Bounds, Wrap};

/// A scene: objects, lights and an environment.
#[derive(Clone)]
#[cfg_attr(feature = "remote", derive(serde::Serialize, serde::Deserialize))]
pub struct Scene {
    /// The objects, in the order of their ids.
    pub objects: List<Object>,
    /// Delta lights: point, spot and directional lights.
    pub lights: List<Light>,
    /// The radiance that arrives from infinity along rays that miss all surfaces.
    pub environment: Environment,
}

impl Default for Scene {
    fn default() -> Self {
        Self::new()
    }
}

impl Scene {
    /// Creates an empty scene with a black environment.
    pub fn new() -> Self {
        Self {
            objects: List::default(),
            lights: List::default(),
            environment: Environment::Constant(Parameter::Constant([0.0; 3])),
        }
    }

    /// Adds an object.
    pub fn with_object(mut self, object: Object) -> Self {
        self.objects.push(object);
        self
    }

    /// Adds a delta light.
    pub fn with_light(mut self, light: Light) -> Self {
        self.lights.push(light);
        self
    }

    /// Sets the environment: a constant radiance or an [`Environment::map`]. The field `environment` stores it.
    pub fn with_environment(mut self, radiance: impl Into<Environment>) -> Self {
        self.environment = radiance.into();
        self
    }

    /// Returns whether any object emits, any light shines or the environment is not black.
    /// This is true if any of their values is above 0, including values of textures and of tensors on devices. A value
    /// that can't be read counts as above 0.
    pub fn has_light(&self) -> bool {
        let mut materials = self.objects.iter().flat_map(|o| &o.materials);
        let lights = self.lights.iter().any(Light::shines);
        lights || self.environment.has_light() || materials.any(|m| m.emission.shines())
    }

    /// Whether any material refracts.
    pub(crate) fn refracts(&self) -> bool {
        let mut all = self.objects.iter().flat_map(|o| &o.materials);
        all.any(|m| m.bsdf.kind().refracts())
    }

    /// The names of the objects.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.objects.iter().map(|o| o.name.as_str())
    }

    /// Returns the first object with this name, or None.
    pub fn object(&self, name: &str) -> Option<&Object> {
        self.objects.iter().find(|o| o.name == name)
    }

    /// Applies a function to all objects with this name. Other objects stay unchanged.
    ///
    /// # Errors
    /// If no object has this name. The error lists the names of the scene's objects.
    pub fn map_object(mut self, name: &str, f: impl Fn(Object) -> Object) -> Result<Self> {
        if self.object(name).is_none() {
            let field = "the name given to map_object";
            let names = one_of(self.names());
            return Err(Error::invalid("scene", field, format!("{name:?}"), names));
        }
        let objects = self.objects.into_iter();
        let changed = objects.map(|o| if o.name == name { f(o) } else { o });
        self.objects = changed.collect();
        Ok(self)
    }
}

/// A mesh with its materials and its motion, like an `o` or `g` of an OBJ file.
///
/// [`Scene::bounds`] has an example.
#[derive(Clone)]
#[cfg_attr(feature = "remote", derive(serde::Serialize, serde::Deserialize))]
pub struct Object {
    /// The name in error messages and for [`Scene::object`].
    pub name: String,
    /// The surface.
    pub mesh: Mesh,
    /// The materials that [`Self::face_materials`] indexes, at least one.
    pub materials: List<Material>,
    /// The index of each face's material. If the list is empty, all faces have the first material.
    #[cfg_attr(feature = "remote", serde(with = "slots::indices"))]
    pub face_materials: Arc<Vec<u32>>,
    /// Linear velocity `[3]`, in scene units over the shutter [0, 1).
    pub velocity: Option<Parameter<3>>,
}

impl Object {
    /// Creates an object with the name `object`, the material [`Material::default`] and no velocity.
    pub fn new(mesh: Mesh) -> Self {
        Self {
            name: "object".into(),
            mesh,
            materials: vec![Material::default()].into(),
            face_materials: Arc::default(),
            velocity: None,
        }
    }

    /// Sets the name.
    pub fn with_name(mut self, name: impl Into<String>) -> Self {
        self.name = name.into();
        self
    }

    /// Sets one material for all faces.
    pub fn with_material(mut self, material: Material) -> Self {
        self.materials = vec![material].into();
        self.face_materials = Arc::default();
        self
    }

    /// Sets a linear velocity `[3]`, in scene units over the shutter.
    pub fn with_velocity(mut self, velocity: impl Into<Parameter<3>>) -> Self {
        self.velocity = Some(velocity.into());
        self
    }

    /// Applies a function to the mesh.
    pub fn map_mesh(mut self, f: impl FnOnce(Mesh) -> Mesh) -> Self {
        self.mesh = f(self.mesh);
        self
    }
}
