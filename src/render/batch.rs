//! Batches: the scenes and cameras of one call.

use std::borrow::Cow;

use burn::tensor::Tensor;

use crate::device::label;
use crate::error::{Error, Result, one_of};
use crate::geometry::{Context, detached};
use crate::scene::{Camera, Object, Scene, check_devices};

/// Scenes and the views to render of them.
///
/// Scenes may differ in everything: meshes, materials, lights. Views of one scene share its prepared data: checks,
/// triangles, BVH and lights. If all scenes have a mesh with the same faces but different vertices, such as a network's
/// predictions, pass the vertices as one tensor ([`Batch::with_vertices`]).
///
/// [`render_batch`](super::render_batch) has an example.
#[derive(Clone)]
pub struct Batch {
    pub(super) scenes: Vec<Scene>,
    pub(super) views: Vec<(usize, Camera)>,
    /// The vertices `[S, V, 3]`, for all scenes, of the objects with a name.
    pub(super) vertices: Vec<(String, Tensor<3>)>,
    /// Copies on the host, if they were made before the render.
    pub(super) on_host: Option<OnHost>,
}

/// The scenes, the cameras of the views, and the vertices of a batch, with all tensors on the host.
#[derive(Clone)]
pub(super) struct OnHost {
    pub scenes: Vec<Scene>,
    pub cameras: Vec<Camera>,
    pub vertices: Vec<Tensor<3>>,
    /// The device and the float type of the batch.
    pub context: Context,
}

impl OnHost {
    /// Returns a batch of these copies.
    pub fn batch(self, of: &Batch) -> Batch {
        let views = of.views.iter().zip(&self.cameras);
        let vertices = of.vertices.iter().zip(&self.vertices);
        Batch {
            scenes: self.scenes.clone(),
            views: views.map(|((s, _), camera)| (*s, camera.clone())).collect(),
            vertices: vertices.map(|((n, _), v)| (n.clone(), v.clone())).collect(),
            on_host: Some(self),
        }
    }
}

impl Batch {
    /// Pairs scenes and cameras. A single scene is paired with all cameras, and a single camera with all scenes.
    ///
    /// # Errors
    /// If the numbers of scenes and cameras differ and neither is one, or if there are none.
    pub fn new(scenes: Vec<Scene>, cameras: Vec<Camera>) -> Result<Self> {
        let (s, c) = (scenes.len(), cameras.len());
        let views = match (s, c) {
            (1, _) => cameras.into_iter().map(|camera| (0, camera)).collect(),
            (_, 1) => (0..s).map(|i| (i, cameras[0].clone())).collect(),
            _ if s == c => cameras.into_iter().enumerate().collect(),
            _ => {
                let (found, expected) = (
                    format!("{c} for {s} scenes"),
                    "as many as scenes, or one of either",
                );
                return Err(Error::invalid("batch", "cameras", found, expected));
            }
        };
        Self::views(scenes, views)
    }

    /// Combines every scene with every camera. View i·C + j is scene i with camera j of C cameras.
    ///
    /// # Errors
    /// If there is no scene or no camera.
    pub fn product(scenes: Vec<Scene>, cameras: &[Camera]) -> Result<Self> {
        let views = (0..scenes.len())
            .flat_map(|i| cameras.iter().map(move |camera| (i, camera.clone())))
            .collect();
        Self::views(scenes, views)
    }

    /// Makes a batch from views, each the index of a scene and a camera.
    ///
    /// # Errors
    /// If there is no view, or if an index is out of range.
    pub fn views(scenes: Vec<Scene>, views: Vec<(usize, Camera)>) -> Result<Self> {
        if views.is_empty() {
            let expected = "at least one scene and one camera";
            return Err(Error::invalid("batch", "views", "empty", expected));
        }
        let count = scenes.len();
        if let Some((scene, _)) = views.iter().find(|(scene, _)| *scene >= count) {
            let expected = format!("a number under {count}");
            return Err(Error::invalid("batch", "scene of a view", scene, expected));
        }
        Ok(Self {
            scenes,
            views,
            vertices: Vec::new(),
            on_host: None,
        })
    }

    /// Replaces the vertices of the objects with a name.
    ///
    /// `values` has shape `[S, V, 3]` for S scenes and V vertices of each mesh, in scene units. The tensor is a direct
    /// parent of the images: the graph contains no slices or gathers, and the other scenes reuse the BVH and the
    /// adjacency of the first one.
    ///
    /// # Errors
    /// If the shape is wrong, or if a scene does not have exactly one object with that name.
    pub fn with_vertices(mut self, name: impl Into<String>, values: Tensor<3>) -> Result<Self> {
        let name = name.into();
        let scenes = self.scenes.len();
        for (index, scene) in self.scenes.iter().enumerate() {
            let named = |o: &&Object| o.name == name;
            let error = match scene.objects.iter().filter(named).count() {
                0 => {
                    let field = "the name given to with_vertices";
                    Error::invalid("scene", field, format!("{name:?}"), one_of(scene.names()))
                }
                1 => {
                    let object = scene.object(&name);
                    let count = object.map_or(0, |o| o.mesh.vertices.dims()[0]);
                    if values.dims() == [scenes, count, 3] && count > 0 {
                        continue;
                    }
                    let found = format!("of shape {:?}", values.dims());
                    let expected = format!(
                        "shape [{scenes}, {count}, 3]: there are {scenes} scenes, and the mesh has \
                         {count} vertices"
                    );
                    let field = "tensor given to with_vertices";
                    Error::invalid(name, field, found, expected)
                }
                n => Error::invalid(
                    "scene",
                    "objects",
                    format!("{n} of the name {name:?}"),
                    "one",
                ),
            };
            return Err(in_batch("scene", index)(error));
        }
        self.vertices.retain(|v| v.0 != name);
        self.vertices.push((name, values));
        Ok(self)
    }

    /// The number of views.
    pub fn len(&self) -> usize {
        self.views.len()
    }

    /// Whether there is no view. A batch has at least one, so this is false.
    pub fn is_empty(&self) -> bool {
        self.views.is_empty()
    }

    /// Whether the first mesh is on a device of a server, where the others must be too.
    #[cfg(feature = "remote")]
    pub(super) fn is_remote(&self) -> bool {
        let object = self.scenes.first().and_then(|scene| scene.objects.first());
        object.is_some_and(|o| crate::device::remote::remote(&o.mesh.vertices.device()).is_some())
    }

    /// Returns the batch, with tangents added to meshes that have a normal map and no tangents.
    pub(super) fn with_tangents(&self) -> Cow<'_, Self> {
        let mut all = Cow::Borrowed(self);
        for (index, scene) in self.scenes.iter().enumerate() {
            if !scene.objects.iter().any(Object::lacks_tangents) {
                continue;
            }
            let moved = self.scene(index, true);
            let objects = all.to_mut().scenes[index].objects.iter_mut();
            for (object, moved) in objects.zip(moved.objects).filter(|o| o.0.lacks_tangents()) {
                object.mesh.tangents = moved.mesh.mikktspace_tangents().tangents;
            }
        }
        all
    }

    /// Returns all scenes, with `of` applied to the batch's vertices as the vertices of the named objects.
    pub(super) fn scenes_with(&self, of: impl Fn(&Tensor<3>) -> Tensor<2>) -> Vec<Scene> {
        let mut scenes = self.scenes.clone();
        for (name, values) in &self.vertices {
            let vertices = of(values);
            let objects = scenes.iter_mut().flat_map(|scene| &mut scene.objects);
            let named = objects.filter(|o| o.name == *name);
            named.for_each(|o| o.mesh.vertices = vertices.clone());
        }
        scenes
    }

    /// Checks that all tensors of scenes and cameras are of one device and float type, and returns these.
    pub(super) fn context(&self) -> Result<Context> {
        // The first scene's vertices have the device and shape of all.
        let scenes = self.scenes_with(|vertices| {
            let [_, count, _] = vertices.dims();
            detached(vertices).slice([0..1]).reshape([count, 3])
        });
        let of_scene = |(index, scene): (usize, &Scene)| {
            check_devices(scene).map_err(in_batch("scene", index))
        };
        let contexts = scenes.iter().enumerate().map(of_scene);
        let contexts = contexts.collect::<Result<Vec<_>>>()?;
        let context = &contexts[0];
        for (index, other) in contexts.iter().enumerate() {
            let same = other.device == context.device && other.dtype == context.dtype;
            if !same {
                let name = |c: &Context| format!("{:?} on {}", c.dtype, label(&c.device));
                let expected = format!("{} like the first scene's", name(context));
                let error = Error::invalid("scene", "tensors", name(other), expected);
                return Err(in_batch("scene", index)(error));
            }
        }
        for (index, (_, camera)) in self.views.iter().enumerate() {
            let checked = camera.check_device(context);
            checked.map_err(in_batch("view", index))?;
        }
        Ok(context.clone())
    }

    /// Returns a scene with the batch's vertices, tracked or detached.
    pub(super) fn scene(&self, index: usize, tracked: bool) -> Scene {
        let mut scene = self.scenes[index].clone();
        for (name, values) in &self.vertices {
            let values = if tracked {
                values.clone()
            } else {
                detached(values)
            };
            let [_, count, _] = values.dims();
            let rows = values.slice([index..index + 1]).reshape([count, 3]);
            if let Some(object) = scene.objects.iter_mut().find(|o| o.name == *name) {
                object.mesh.vertices = rows;
            }
        }
        scene
    }
}

/// Adds the part of a batch (`scene` or `view`) and its index to an error.
pub(super) fn in_batch(part: &'static str, index: usize) -> impl FnOnce(Error) -> Error {
    move |source| Error::InBatch {
        part,
        index,
        source: Box::new(source),
    }
}
