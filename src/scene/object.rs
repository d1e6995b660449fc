use std::sync::Arc;

use super::{Material, Mesh, Parameter};

/// A mesh with its materials and its motion: what a file calls `o` or `g`.
#[derive(Clone)]
pub struct Object {
    /// For messages and look-up.
    pub name: String,
    /// The surface.
    pub mesh: Mesh,
    /// At least one.
    pub materials: Vec<Material>,
    /// The material of each face; empty where all faces have the first.
    pub face_materials: Arc<Vec<u32>>,
    /// Linear velocity in scene units over the shutter [0, 1).
    pub velocity: Option<Parameter<3>>,
}

impl Object {
    /// An object of mid-grey.
    pub fn new(mesh: Mesh) -> Self {
        Self {
            name: "object".into(),
            mesh,
            materials: vec![Material::default()],
            face_materials: Arc::default(),
            velocity: None,
        }
    }

    /// With a name.
    pub fn named(mut self, name: impl Into<String>) -> Self {
        self.name = name.into();
        self
    }

    /// With one material on all faces.
    pub fn material(mut self, material: Material) -> Self {
        self.materials = vec![material];
        self.face_materials = Arc::default();
        self
    }

    /// With a linear velocity `[3]`, scene units over the shutter.
    pub fn velocity(mut self, velocity: impl Into<Parameter<3>>) -> Self {
        self.velocity = Some(velocity.into());
        self
    }

    /// With its mesh changed.
    pub fn map_mesh(mut self, f: impl FnOnce(Mesh) -> Mesh) -> Self {
        self.mesh = f(self.mesh);
        self
    }
}
