use std::sync::Arc;

use super::{Material, Mesh, Parameter};

/// A mesh with its materials and its motion; an `o` or `g` of an OBJ file.
#[derive(Clone)]
pub struct Object {
    /// The name in messages and for [`Scene::object`](super::Scene::object).
    pub name: String,
    /// The surface.
    pub mesh: Mesh,
    /// The materials that [`Self::face_materials`] refers to, at least one.
    pub materials: Vec<Material>,
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
            materials: vec![Material::default()],
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
        self.materials = vec![material];
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
