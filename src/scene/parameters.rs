//! Visits of all differentiable values of a scene and its camera, in one order.

use std::collections::HashSet;
use std::ops::Range;

use burn::tensor::Tensor;

use super::parameter::{Described, Range as Values};
use super::texture::Value;
use super::{Camera, Light, Object, Parameter, Projection, Scene};
use softray_kernels::host::ParameterId;

impl Described for ParameterId {
    fn described(self) -> (&'static str, Values) {
        match self {
            Self::Vertices(_) => ("vertices", Values::Finite),
            Self::Uvs(_) => ("uvs", Values::Finite),
            Self::Normals(_) => ("normals", Values::Finite),
            Self::Colors(_) => ("colors", Values::Finite),
            Self::Tangents(_) => ("tangents", Values::Finite),
            Self::NormalMap(_) => ("normal map", Values::Finite),
            Self::Velocity(_) => ("velocity", Values::Finite),
            Self::Material(_, channel) => channel.described(),
            Self::Light(_, part) => part.described(),
            Self::Environment => ("environment", Values::Light),
            Self::Eye => ("eye", Values::Finite),
            Self::Target => ("target", Values::Finite),
            Self::Up => ("up", Values::Finite),
            Self::FieldOfView => ("fov_y", Values::Degrees(0, 180)),
            Self::FocalLength => ("focal length", Values::Positive),
            Self::PrincipalPoint => ("principal point", Values::Finite),
            Self::ViewHeight => ("height", Values::Positive),
            Self::Aperture => ("aperture radius", Values::NotNegative),
            Self::Focus => ("focus distance", Values::Positive),
        }
    }
}

/// An operation on each tensor of a scene and a camera.
pub(crate) trait Visit {
    /// Called with every tensor.
    fn visit<const D: usize>(&mut self, id: ParameterId, tensor: &mut Tensor<D>);

    /// Called with every parameter.
    fn parameter<const C: usize>(&mut self, id: ParameterId, p: &mut Parameter<C>) {
        if let Parameter::Tensor(t) = p {
            self.visit(id, t);
        }
    }

    /// Called with every image.
    fn image<const D: usize>(&mut self, id: ParameterId, texels: &mut Tensor<D>) {
        self.visit(id, texels);
    }

    fn value(&mut self, id: ParameterId, value: Value<'_>) {
        match value {
            Value::Color(p) => self.parameter(id, p),
            Value::Image(texels, _) => self.image(id, texels),
            Value::Scalar(p) => self.parameter(id, p),
            Value::ScalarImage(texels, _) => self.image(id, texels),
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
    let mut material = 0;
    for (i, object) in scene.objects.iter_mut().enumerate() {
        visit_object(object, i, &mut material, visit);
    }
    for (i, light) in scene.lights.iter_mut().enumerate() {
        visit_light(light, i, visit);
    }
    visit.value(ParameterId::Environment, scene.environment.value());
}

/// Like [`visit_scene`], for visitors that only read tensors: objects are cloned one after the other.
pub(crate) fn look_at_scene(scene: &Scene, visit: &mut impl Visit) {
    let mut material = 0;
    for (i, object) in scene.objects.iter().enumerate() {
        visit_object(&mut object.clone(), i, &mut material, visit);
    }
    for (i, light) in scene.lights.iter().enumerate() {
        visit_light(&mut light.clone(), i, visit);
    }
    let mut environment = scene.environment.clone();
    visit.value(ParameterId::Environment, environment.value());
}

/// Visits the tensors of the object with index `i`. `material` is the index of its first material, and afterwards the
/// index of the next object's first material.
fn visit_object(object: &mut Object, i: usize, material: &mut usize, visit: &mut impl Visit) {
    use ParameterId::{Colors, Material, NormalMap, Normals, Tangents, Uvs, Velocity, Vertices};
    let mesh = &mut object.mesh;
    visit.visit(Vertices(i), &mut mesh.vertices);
    let ids = [Uvs(i), Normals(i), Colors(i), Tangents(i)];
    for (id, attribute) in ids.into_iter().zip(mesh.attributes_mut()) {
        if let Some(attribute) = attribute {
            visit.visit(id, &mut attribute.values);
        }
    }
    for m in &mut object.materials {
        for (channel, value) in m.channels() {
            visit.value(Material(*material, channel), value);
        }
        if let Some(map) = &mut m.normal_map {
            visit.image(NormalMap(*material), &mut map.texels);
        }
        *material += 1;
    }
    if let Some(velocity) = &mut object.velocity {
        visit.parameter(Velocity(i), velocity);
    }
}

fn visit_light(light: &mut Light, i: usize, visit: &mut impl Visit) {
    for (part, value) in light.parts() {
        visit.value(ParameterId::Light(i, part), value);
    }
}

/// Visits every tensor of a camera.
pub(crate) fn visit_camera(camera: &mut Camera, visit: &mut impl Visit) {
    visit.parameter(ParameterId::Eye, &mut camera.eye);
    visit.parameter(ParameterId::Target, &mut camera.target);
    visit.parameter(ParameterId::Up, &mut camera.up);
    match &mut camera.projection {
        Projection::Perspective { fov_y } => visit.parameter(ParameterId::FieldOfView, fov_y),
        Projection::Intrinsics {
            focal, principal, ..
        } => {
            visit.parameter(ParameterId::FocalLength, focal);
            visit.parameter(ParameterId::PrincipalPoint, principal);
        }
        Projection::Orthographic { height } => visit.parameter(ParameterId::ViewHeight, height),
    }
    if let Some(lens) = &mut camera.lens {
        visit.parameter(ParameterId::Aperture, &mut lens.aperture_radius);
        visit.parameter(ParameterId::Focus, &mut lens.focus_distance);
    }
}

impl Scene {
    /// Whether any tensor of the scene is tracked.
    pub(crate) fn is_tracked(&self) -> bool {
        struct Tracked(bool);
        impl Visit for Tracked {
            fn visit<const D: usize>(&mut self, _: ParameterId, tensor: &mut Tensor<D>) {
                self.0 |= tensor.is_tracked();
            }
        }
        let mut tracked = Tracked(false);
        look_at_scene(self, &mut tracked);
        tracked.0
    }
}

/// The tracked or chosen tensors, flattened, and the range of each in their concatenation.
#[derive(Default)]
pub(crate) struct Collect {
    /// The tensors to collect, in place of those that are tracked.
    pub chosen: Option<HashSet<ParameterId>>,
    pub places: Vec<(ParameterId, Range<usize>)>,
    pub rows: Vec<Tensor<1>>,
    /// The length of the concatenation.
    pub size: usize,
}

impl Collect {
    /// Returns a zero `[1]` that depends on all of them, or None if there are none.
    pub fn tracked_zero(self) -> Option<Tensor<1>> {
        let first = self.rows.into_iter().map(|t| t.slice([0..1]) * 0.0);
        first.reduce(|a, b| a + b)
    }
}

impl Visit for Collect {
    fn visit<const D: usize>(&mut self, id: ParameterId, tensor: &mut Tensor<D>) {
        let chosen = self.chosen.as_ref().map(|ids| ids.contains(&id));
        if chosen.unwrap_or_else(|| tensor.is_tracked()) {
            let count: usize = tensor.dims().iter().product();
            self.places.push((id, self.size..self.size + count));
            self.rows.push(tensor.clone().reshape([count]));
            self.size += count;
        }
    }
}

/// Replaces the tracked tensors by slices of one tensor.
pub(crate) struct Replace {
    /// The tensor that is sliced.
    pub parameters: Tensor<1>,
    /// The start of the next slice.
    pub next: usize,
}

impl Visit for Replace {
    fn visit<const D: usize>(&mut self, _: ParameterId, tensor: &mut Tensor<D>) {
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

/// Detaches every tensor from its graph.
pub(crate) struct Detach;

impl Visit for Detach {
    fn visit<const D: usize>(&mut self, _: ParameterId, tensor: &mut Tensor<D>) {
        *tensor = crate::geometry::detached(tensor);
    }
}
