//! Scenes of tensors: meshes, materials, transforms, objects, environments and cameras.

mod albedo;
mod bounds;
mod camera;
mod check;
mod corners;
mod debug;
mod details;
mod environment;
mod flatten;
mod holes;
mod host;
mod host_textures;
mod light;
mod list;
mod maps;
mod material;
mod material_planes;
mod mesh;
mod normals;
mod parameter;
mod parameters;
mod placement;
pub mod shapes;
mod tangents;
mod transfer;
mod transform;
mod viewpoint;
mod wrap;

pub use albedo::{Albedo, ScalarTexture};
pub use bounds::Bounds;
pub(crate) use camera::HostProjection;
pub use camera::{Camera, Projection, ThinLens};
pub(crate) use check::{check_devices, check_scene};
pub use corners::CornerAttribute;
pub use environment::Environment;
pub(crate) use flatten::{EnvironmentMap, Flattened, Normalization, SkyTensors};
pub(crate) use holes::{Holes, OF_MASKED};
pub(crate) use host::{HostAttribute, HostMaterial, HostObject, HostScene, SceneFrame};
pub(crate) use host_textures::HostTexture;
pub use light::Light;
pub(crate) use light::{HostLight, LightKind, LightPart, LightPlanes};
pub use list::List;
pub use maps::{AlphaMask, NormalMap};
pub use material::{Bsdf, Material};
pub(crate) use material::{
    CHANNELS, Channel, LEAST_CONTRAST, LEAST_IOR, MOST_IOR, MOST_OF_METAL, MaterialKind,
};
pub(crate) use material_planes::ChannelPlanes;
pub use mesh::Mesh;
pub(crate) use mesh::{host_tensor, take_rows};
pub use parameter::Parameter;
pub(crate) use parameter::Range;
pub(crate) use parameters::{
    Collect, Detach, ParameterId, Replace, Visit, look_at_scene, visit_camera, visit_scene,
    visit_tensors,
};
pub use placement::Scale;
pub(crate) use transfer::{Constants, Identity, Transfer, host_device};
pub use transform::Transform;
pub(crate) use viewpoint::Framing;
pub use viewpoint::Matrix;
pub use wrap::Wrap;

use std::sync::Arc;

use crate::error::{Error, Result, one_of};

/// A scene: objects, lights and an environment.
#[derive(Clone)]
pub struct Scene {
    /// The objects, in the order of their ids.
    pub objects: List<Object>,
    /// Lights without a surface.
    pub lights: List<Light>,
    /// The radiance that arrives from infinity where rays miss all surfaces.
    pub environment: Environment,
}

impl Default for Scene {
    fn default() -> Self {
        Self::new()
    }
}

impl Scene {
    /// An empty scene with a black environment.
    pub fn new() -> Self {
        Self {
            objects: List::default(),
            lights: List::default(),
            environment: Environment::Constant(Parameter::Constant([0.0; 3])),
        }
    }

    /// Adds an object.
    pub fn with(mut self, object: Object) -> Self {
        self.objects.push(object);
        self
    }

    /// Adds a light without a surface.
    pub fn light(mut self, light: Light) -> Self {
        self.lights.push(light);
        self
    }

    /// Sets the environment: a constant radiance, or an [`Environment::map`]. The field of the same name holds it.
    pub fn environment(mut self, radiance: impl Into<Environment>) -> Self {
        self.environment = radiance.into();
        self
    }

    /// Whether any object emits, any light shines or the environment is not black: whether any of their values is
    /// above 0, those of textures and of tensors on devices included.
    pub fn has_light(&self) -> bool {
        let mut materials = self.objects.iter().flat_map(|o| &o.materials);
        let lights = self.lights.iter().any(Light::shines);
        lights || self.environment.has_light() || materials.any(|m| m.emission.shines())
    }

    /// Whether any material refracts.
    pub(crate) fn refracts(&self) -> bool {
        let mut all = self.objects.iter().flat_map(|o| &o.materials);
        all.any(|m| m.bsdf.refracts())
    }

    /// The names of its objects.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.objects.iter().map(|o| o.name.as_str())
    }

    /// The first object of a name, or None.
    pub fn object(&self, name: &str) -> Option<&Object> {
        self.objects.iter().find(|o| o.name == name)
    }

    /// Changes the objects of a name by a function; others stay as they are.
    ///
    /// # Errors
    /// If there is no object of that name; the error lists the names that there are.
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

/// A mesh with its materials and its motion; an `o` or `g` of an OBJ file.
#[derive(Clone)]
pub struct Object {
    /// The name in messages and for [`Scene::object`].
    pub name: String,
    /// The surface.
    pub mesh: Mesh,
    /// The materials that [`Self::face_materials`] refers to, at least one.
    pub materials: List<Material>,
    /// The material of each face; empty where all faces have the first.
    pub face_materials: Arc<Vec<u32>>,
    /// Linear velocity in scene units over the shutter [0, 1).
    pub velocity: Option<Parameter<3>>,
}

impl Object {
    /// An object of the material [`Material::default`].
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
    pub fn named(mut self, name: impl Into<String>) -> Self {
        self.name = name.into();
        self
    }

    /// Sets one material for all faces.
    pub fn material(mut self, material: Material) -> Self {
        self.materials = vec![material].into();
        self.face_materials = Arc::default();
        self
    }

    /// Sets a linear velocity `[3]`, in scene units over the shutter.
    pub fn velocity(mut self, velocity: impl Into<Parameter<3>>) -> Self {
        self.velocity = Some(velocity.into());
        self
    }

    /// Changes the mesh by a function.
    pub fn map_mesh(mut self, f: impl FnOnce(Mesh) -> Mesh) -> Self {
        self.mesh = f(self.mesh);
        self
    }
}
