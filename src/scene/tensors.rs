//! All tensors of a scene and its camera, visited in one order.

use burn::tensor::Tensor;

use super::{Albedo, Camera, Environment, Parameter, Scene};

/// What is done with each tensor.
pub(crate) trait Visit {
    /// Called with every tensor.
    fn visit<const D: usize>(&mut self, tensor: &mut Tensor<D>);

    /// Called with every parameter.
    fn parameter<const C: usize>(&mut self, p: &mut Parameter<C>) {
        if let Parameter::Tensor(t) = p {
            self.visit(t);
        }
    }

    /// Called with every albedo.
    fn albedo(&mut self, albedo: &mut Albedo) {
        match albedo {
            Albedo::Constant(p) => self.parameter(p),
            Albedo::Texture { texels, .. } => self.visit(texels),
        }
    }
}

/// Visits every tensor of a scene and camera.
pub(crate) fn visit_tensors(scene: &mut Scene, camera: &mut Camera, visit: &mut impl Visit) {
    visit_scene(scene, visit);
    visit_camera(camera, visit);
}

/// Visits every tensor of a scene.
pub(crate) fn visit_scene(scene: &mut Scene, visit: &mut impl Visit) {
    for object in &mut scene.objects {
        visit.visit(&mut object.mesh.vertices);
        let mesh = &mut object.mesh;
        for attribute in [&mut mesh.uvs, &mut mesh.normals].into_iter().flatten() {
            visit.visit(&mut attribute.values);
        }
        for material in &mut object.materials {
            visit.albedo(&mut material.diffuse);
            visit.albedo(&mut material.specular);
            visit.parameter(&mut material.shininess);
            visit.parameter(&mut material.emission);
        }
        if let Some(velocity) = &mut object.velocity {
            visit.parameter(velocity);
        }
    }
    match &mut scene.environment {
        Environment::Constant(p) => visit.parameter(p),
        Environment::Map(texels) => visit.visit(texels),
    }
}

/// Visits every tensor of a camera.
pub(crate) fn visit_camera(camera: &mut Camera, visit: &mut impl Visit) {
    for p in [&mut camera.eye, &mut camera.target, &mut camera.up] {
        visit.parameter(p);
    }
    visit.parameter(&mut camera.fov_y);
    if let Some((aperture, focus)) = &mut camera.lens {
        visit.parameter(aperture);
        visit.parameter(focus);
    }
}

/// Flattens the tensors that are in a graph into one.
#[derive(Default)]
pub(crate) struct Collect(pub Vec<Tensor<1>>);

impl Collect {
    /// A zero `[1]` that depends on all of them; None if there is none.
    pub(crate) fn of_value_zero(self) -> Option<Tensor<1>> {
        let first = self.0.into_iter().map(|t| t.slice([0..1]) * 0.0);
        first.reduce(|a, b| a + b)
    }
}

impl Visit for Collect {
    fn visit<const D: usize>(&mut self, tensor: &mut Tensor<D>) {
        if tensor.is_tracked() {
            let count: usize = tensor.dims().iter().product();
            self.0.push(tensor.clone().reshape([count]));
        }
    }
}

/// Puts parts of one tensor in the place of those that are in a graph.
pub(crate) struct Replace {
    /// The one tensor.
    pub parameters: Tensor<1>,
    /// Where the next part begins.
    pub next: usize,
}

impl Visit for Replace {
    fn visit<const D: usize>(&mut self, tensor: &mut Tensor<D>) {
        if tensor.is_tracked() {
            let shape: [usize; D] = tensor.dims();
            let count: usize = shape.iter().product();
            let part = self.parameters.clone();
            let part = part.slice([self.next..self.next + count]);
            *tensor = part.reshape(shape);
            self.next += count;
        }
    }
}

/// Takes every tensor out of its graph.
pub(crate) struct Plain;

impl Visit for Plain {
    fn visit<const D: usize>(&mut self, tensor: &mut Tensor<D>) {
        *tensor = crate::geometry::plain(tensor);
    }
}
