//! Late steps: renders on a GPU that wait for nothing. The device places tensors of meshes, materials, lights and environments
//! into its lists. The host works with values that it has read before, and gets to know a render later how far vertices have
//! moved and how much light has changed. Another thread prepares newer values meanwhile.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;

use burn::tensor::{DType, Device, Tensor};

use super::batch::Batch;
use super::cache::HierarchyCache;
use super::options::RenderOptions;
use super::standing::{Group, Look, Places, Preparing, Standing, Views};
use crate::error::Result;
use crate::geometry::{Context, detached};
use crate::gpu::{FAR_MOVE, Reading, Row, identity_and_strides};
use crate::scene::{
    Camera, Detach, Object, Parameter, Projection, Value, Visit, host_device, look_at_scene,
    visit_camera, visit_scene,
};
use softray_kernels::host::{LightPart, ParameterId};
use softray_kernels::kernel::View;

/// How a render gets the values of its tensors, and what it leaves to the next one.
#[derive(Default)]
pub(super) struct Late {
    /// The look of the render, if the next one may be late.
    look: Option<Look>,
    age: u32,
    moved: f32,
    newer: f32,
    /// Values of the last render's row, which have arrived.
    pub values: Option<Vec<f64>>,
    /// Views that another thread prepares, and those that it has prepared if this render is to use them.
    pub preparing: Option<Preparing>,
    pub views: Option<Result<Views>>,
    /// The data of the last render, which the host takes in place of its own.
    pub standing: Option<Standing>,
    /// The row from which the device places tensors, if the host takes other values.
    pub row: Option<Row>,
    /// The values of this row, if they are to arrive in the next render.
    reading: Option<Reading>,
}

impl Late {
    /// Decides how a render gets the values of its tensors.
    pub fn new(batch: &Batch, options: &RenderOptions) -> Self {
        let Some(cache) = options.cache.as_ref().filter(|cache| cache.every > 1) else {
            return Self::default();
        };
        let last = cache.take_standing();
        let mut this = Self {
            look: Look::new(batch, options),
            ..Self::default()
        };
        let (Some(look), Some(mut last)) = (&this.look, last) else {
            return this;
        };
        let mut moved = 0.0f32;
        for reading in std::mem::take(&mut last.moves) {
            let own = reading.numbers().filter(|own| own[0].is_finite());
            let Some(own) = own else {
                return this;
            };
            moved = moved.max(own[0]);
        }
        if *look != last.look {
            return this;
        }
        this.age = last.age + 1;
        (this.moved, this.newer) = (last.moved + moved, last.newer + moved);
        this.preparing = last.preparing.take();
        if let Some(reading) = last.values.take() {
            let values = reading.numbers();
            this.values = values.map(|values| values.into_iter().map(f64::from).collect());
            (this.age, this.newer) = (0, 0.0);
        }
        let is_far = this.moved > FAR_MOVE;
        if is_far || this.age + 1 >= cache.every {
            let near = this.preparing.take().filter(|_| this.newer <= FAR_MOVE);
            this.views = near.and_then(Preparing::finish);
        }
        match this.views {
            // The device finds how far vertices have moved since the values of the views.
            Some(_) => this.moved = 0.0,
            None if is_far => this.read(),
            None => this.standing = Some(last),
        }
        this
    }

    /// Lets the device place tensors of a row. In one of `every` renders their values are read.
    pub fn place(&mut self, row: &Tensor<1>, cache: &HierarchyCache) {
        if let Some((row, reading)) = Row::new(row, self.age + 1 >= cache.every) {
            (self.row, self.reading) = (Some(row), reading);
        }
    }

    /// Lets the host read all values.
    pub fn read(&mut self) {
        let look = self.look.take();
        *self = Self {
            look,
            ..Self::default()
        };
    }

    /// Keeps the data of a render for the next one.
    pub fn keep(
        self,
        cache: &HierarchyCache,
        views: &Arc<Vec<(View, Places)>>,
        groups: &[Group],
        (context, lit): (&Context, bool),
    ) {
        let Some(look) = self.look.filter(|_| serve(views)) else {
            return;
        };
        let moves = groups.iter().filter_map(|(_, group)| group.buffers.moved());
        let group = |(views, group): &Group| (views.clone(), Arc::new(group.without_buffers()));
        cache.set_standing(Standing {
            look,
            views: views.clone(),
            groups: groups.iter().map(group).collect(),
            context: context.clone(),
            lit,
            age: self.age,
            moved: self.moved,
            newer: self.newer,
            moves: moves.collect(),
            values: self.reading,
            preparing: self.preparing,
        });
    }
}

/// Returns whether views serve for other values of their tensors.
pub(super) fn serve(views: &[(View, Places)]) -> bool {
    let crosses = |view: &View| {
        let sets = view.edge_sets.as_ref();
        sets.is_some_and(|sets| sets.crossings_move(&view.scene, &view.wanted))
    };
    // Copies of triangles that are not in the tree may move apart.
    let serves = |view: &View| view.scene.hierarchy.is_complete() && !crosses(view);
    views.iter().all(|(view, _)| serves(view))
}

impl Look {
    /// Returns the look of a render, or `None` if the next one can't be late: if tensors are tracked that the device does
    /// not place, if surfaces with holes change, if surfaces that emit move, on a CPU, or if the host has no tensors of its own.
    fn new(batch: &Batch, options: &RenderOptions) -> Option<Self> {
        let placed = batch.on_host.is_none() && !options.adaptive && !options.diagnostics;
        let placed = placed && host_device().is_some();
        let first = placed.then(|| batch.scenes.first()?.objects.first())??;
        let mut hash = Hash64 {
            state: DefaultHasher::new(),
            device: first.mesh.vertices.device().inner(),
            faces: Vec::new(),
            indices: Vec::new(),
            moving: Vec::new(),
            mapped: Vec::new(),
            is_right: true,
        };
        let seedless = options.clone().with_seed(0);
        serde_json::to_string(&seedless).ok()?.hash(&mut hash.state);
        for (name, vertices) in &batch.vertices {
            name.hash(&mut hash.state);
            hash.visit(ParameterId::Vertices(0), &mut vertices.clone());
        }
        for scene in &batch.scenes {
            hash.moving.clear();
            hash.mapped.clear();
            look_at_scene(scene, &mut hash);
            for (i, object) in scene.objects.iter().enumerate() {
                let named = |v: &(String, Tensor<3>)| v.0 == object.name && v.1.is_tracked();
                let moves = hash.moving.contains(&i) || batch.vertices.iter().any(named);
                let mapped = hash.mapped.contains(&i);
                hash.add_object(object, moves, mapped);
            }
            scene.lights.len().hash(&mut hash.state);
        }
        for (scene, camera) in &batch.views {
            scene.hash(&mut hash.state);
            if let Projection::Intrinsics { size, .. } = &camera.projection {
                size.hash(&mut hash.state);
            }
            visit_camera(&mut camera.clone(), &mut hash);
        }
        let mut scenes = batch.scenes.clone();
        scenes.iter_mut().for_each(|s| visit_scene(s, &mut Detach));
        let mut cameras: Vec<Camera> = batch.views.iter().map(|v| v.1.clone()).collect();
        cameras
            .iter_mut()
            .for_each(|c| visit_camera(c, &mut Detach));
        let vertices = batch.vertices.iter().map(|v| detached(&v.1));
        hash.is_right.then(|| Self {
            hash: hash.state.finish(),
            faces: hash.faces,
            indices: hash.indices,
            _scenes: scenes,
            _cameras: cameras,
            _vertices: vertices.collect(),
        })
    }
}

/// Hashes scenes and cameras: constants by value, tensors by their places in memory. Lists are collected.
struct Hash64 {
    state: DefaultHasher,
    device: Device,
    faces: Vec<Arc<Vec<[u32; 3]>>>,
    indices: Vec<Arc<Vec<u32>>>,
    /// The objects of the scene whose vertices or uvs are tracked, and those whose uvs are.
    moving: Vec<usize>,
    mapped: Vec<usize>,
    /// Whether the device places all tracked tensors.
    is_right: bool,
}

impl Hash64 {
    fn add_object(&mut self, object: &Object, moves: bool, mapped: bool) {
        let state = &mut self.state;
        let mesh = &object.mesh;
        self.is_right &= mesh.mistake.is_none();
        object.name.hash(state);
        self.faces.push(mesh.faces.clone());
        self.indices.push(object.face_materials.clone());
        for (_, _, attribute) in mesh.attributes() {
            attribute.is_some().hash(state);
            self.faces.extend(attribute.map(|a| a.faces.clone()));
        }
        for material in &object.materials {
            let kind = material.kind();
            self.is_right &= !(moves && kind.emits);
            format!("{kind:?}").hash(&mut self.state);
            let wrap = material.normal_map.as_ref().map(|map| map.wrap);
            format!("{wrap:?}").hash(&mut self.state);
            if let Some(mask) = &material.alpha_mask {
                self.is_right &= !mapped;
                format!("{:?} {}", mask.wrap, mask.cutoff).hash(&mut self.state);
                self.add_constant(&mask.alpha);
            }
        }
    }

    fn add_constant<const D: usize>(&mut self, tensor: &Tensor<D>) {
        let identity = identity_and_strides(&detached(tensor));
        self.is_right &= !tensor.is_tracked() && identity.is_some();
        identity.hash(&mut self.state);
    }
}

impl Visit for Hash64 {
    fn visit<const D: usize>(&mut self, id: ParameterId, tensor: &mut Tensor<D>) {
        use ParameterId as Id;
        id.hash(&mut self.state);
        tensor.dims().hash(&mut self.state);
        self.is_right &= tensor.device().inner() == self.device && tensor.dtype() == DType::F32;
        match id {
            _ if !tensor.is_tracked() => self.add_constant(tensor),
            Id::Vertices(i) => self.moving.push(i),
            Id::Uvs(i) => {
                self.moving.push(i);
                self.mapped.push(i);
            }
            Id::Normals(_) | Id::Colors(_) | Id::Tangents(_) | Id::NormalMap(_) => {}
            Id::Material(..) | Id::Environment => {}
            Id::Light(_, LightPart::Position | LightPart::Intensity | LightPart::Irradiance) => {}
            _ => self.is_right = false,
        }
    }

    fn parameter<const C: usize>(&mut self, id: ParameterId, p: &mut Parameter<C>) {
        match p {
            Parameter::Tensor(tensor) => self.visit(id, tensor),
            Parameter::Constant(numbers) => {
                id.hash(&mut self.state);
                numbers.map(f64::to_bits).hash(&mut self.state);
            }
        }
    }

    fn value(&mut self, id: ParameterId, value: Value<'_>) {
        match value {
            Value::Color(p) => self.parameter(id, p),
            Value::Scalar(p) => self.parameter(id, p),
            Value::Image(texels, wrap) => {
                format!("{wrap:?}").hash(&mut self.state);
                self.visit(id, texels);
            }
            Value::ScalarImage(texels, wrap) => {
                format!("{wrap:?}").hash(&mut self.state);
                self.visit(id, texels);
            }
        }
    }
}
