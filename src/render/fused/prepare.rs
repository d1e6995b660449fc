//! From a batch to what its views are traced with, and the one tensor that gradients flow to.

use std::sync::Arc;

use burn::tensor::Tensor;
use rayon::prelude::*;

use crate::accel::Hierarchy;
use crate::error::Result;
use crate::geometry::{Context, plain};
use crate::render::batch::of_batch;
use crate::render::tensors::{sampler, settings};
use crate::render::{Batch, RenderOptions};
use crate::scene::{Attached, Collect, Detach, Flattened, Scene, TrackedMesh, visit_scene};
use crate::transport::{Fused, FusedParts, Gradient, Host, Lights, Sky, Tables};
use crate::visibility::{cutoff_of_triangle, host_triangles};

/// A batch, ready to be traced.
pub(super) struct Prepared {
    pub views: Vec<View>,
    /// All that is in a graph, in one row.
    pub parent: Option<Tensor<1>>,
    pub parent_size: usize,
    pub context: Context,
}

/// A view, ready to be traced.
pub(super) struct View {
    pub fused: Fused,
    /// Objects of its scene.
    pub objects: usize,
    /// The length of depths, in scene units.
    pub unit: f64,
    pub places: Places,
}

/// Where the derivatives of a view are in the parent.
#[derive(Clone, Default)]
pub(super) struct Places {
    /// First numbers and lengths of the scene's: rows of tensors of the batch, then its own.
    scene: Vec<(usize, usize)>,
    camera: Option<usize>,
}

impl Places {
    /// Adds a view's derivatives to those by the parent.
    pub fn add(&self, gradient: &Gradient, all: &mut [f64]) {
        let mut add = |first: usize, values: &[f64]| {
            let to = all[first..first + values.len()].iter_mut();
            to.zip(values).for_each(|(a, b)| *a += b);
        };
        let mut next = 0;
        for &(first, length) in &self.scene {
            add(first, &gradient.scene[next..next + length]);
            next += length;
        }
        if let Some(camera) = self.camera {
            add(camera, &gradient.camera);
        }
    }
}

/// A scene on the host.
struct HostScene {
    flattened: Flattened,
    hierarchy: Arc<Hierarchy>,
    lights: Arc<Lights>,
    host: Host,
}

impl HostScene {
    fn new(scene: &Scene, options: &RenderOptions, like: Option<&Self>) -> Result<Self> {
        let like_scene = like.map(|l| &l.flattened);
        let flattened = Flattened::of_scene(scene, options.bounds, like_scene)?;
        let triangles = host_triangles(&flattened.triangles)?;
        let hierarchy = match (like, &options.cache) {
            (Some(like), _) => Arc::new(Hierarchy::like(triangles, &like.hierarchy)),
            (None, Some(cache)) => cache.take(triangles),
            (None, None) => Arc::new(Hierarchy::new(triangles)),
        };
        Ok(Self {
            hierarchy,
            lights: Arc::new(Lights::new(&flattened, options.sampling.emitters)?),
            host: Host::new(&flattened, Sky::new(&flattened)?)?,
            flattened,
        })
    }
}

/// Scenes are read back on all cores; what is in a graph is gathered by one thread.
pub(super) fn prepare(batch: &Batch, options: &RenderOptions) -> Result<Prepared> {
    let read = |index: usize, like: Option<&HostScene>| {
        let mut scene = batch.scene(index, false);
        visit_scene(&mut scene, &mut Detach);
        HostScene::new(&scene, options, like).map_err(of_batch("scene", index))
    };
    let first = read(0, None)?;
    let others = (1..batch.scenes.len()).into_par_iter();
    let others = others.map(|i| read(i, Some(&first)));
    let others = others.collect::<Result<Vec<_>>>()?;
    let context = first.flattened.context.clone();
    let hosts: Vec<HostScene> = std::iter::once(first).chain(others).collect();

    let mut parent = Parent::default();
    // Tensors of the batch first, then scenes, then cameras.
    let of_batch_vertices: Vec<Option<usize>> = batch
        .vertices
        .iter()
        .map(|v| {
            let [s, n, _] = v.values.dims();
            let tracked = v.values.is_tracked();
            tracked.then(|| parent.push(v.values.clone().reshape([3 * s * n])))
        })
        .collect();
    let mut scenes = Vec::with_capacity(hosts.len());
    for (index, host) in hosts.into_iter().enumerate() {
        let (meshes, mut places) = meshes(batch, index, &of_batch_vertices);
        let scene = &batch.scenes[index];
        let attached = is_attached(scene).then(|| {
            let unit = host.flattened.unit;
            Attached::new(scene, &context, unit)
        });
        let mut tables = Tables::new(&host.flattened, host.host, attached.as_ref(), meshes);
        if let Some(row) = tables.take_parent() {
            let [length] = row.dims();
            places.scene.push((parent.push(row), length));
        }
        let parts = FusedParts {
            tables: Arc::new(tables),
            hierarchy: host.hierarchy,
            lights: host.lights,
            sampler: sampler(options),
            settings: settings(&host.flattened, options),
            size: [options.width, options.height],
            cutoff: cutoff_of_triangle(options.cutoff),
        };
        scenes.push((host.flattened, parts, places));
    }
    let mut views = Vec::with_capacity(batch.views.len());
    for (index, (scene, camera)) in batch.views.iter().enumerate() {
        let (flattened, parts, places) = &scenes[*scene];
        let mut places = places.clone();
        let parts = FusedParts {
            sampler: sampler(&options.of_view(index)),
            ..parts.clone()
        };
        let seen = flattened.clone().seen_by(camera);
        let fused = seen.and_then(|seen| Fused::new(seen, camera, parts));
        let mut fused = fused.map_err(of_batch("view", index))?;
        if let Some(row) = fused.take_camera() {
            places.camera = Some(parent.push(row));
        }
        views.push(View {
            fused,
            objects: flattened.objects(),
            unit: flattened.unit,
            places,
        });
    }
    Ok(Prepared {
        views,
        parent_size: parent.size,
        parent: (!parent.rows.is_empty()).then(|| Tensor::cat(parent.rows, 0)),
        context,
    })
}

/// Rows that become one.
#[derive(Default)]
struct Parent {
    rows: Vec<Tensor<1>>,
    size: usize,
}

impl Parent {
    /// Where the row begins.
    fn push(&mut self, row: Tensor<1>) -> usize {
        let [length] = row.dims();
        self.rows.push(row);
        self.size += length;
        self.size - length
    }
}

/// The meshes of a scene whose vertices are in a graph, and where those of tensors of the batch are.
fn meshes(batch: &Batch, index: usize, starts: &[Option<usize>]) -> (Vec<TrackedMesh>, Places) {
    let (mut of_batch, mut own) = (Vec::new(), Vec::new());
    let mut places = Places::default();
    let mut first = 0;
    for object in &batch.scenes[index].objects {
        let mesh = &object.mesh;
        let mut all = batch.vertices.iter().zip(starts);
        let tracked = |vertices: Option<Tensor<2>>, count| TrackedMesh {
            vertices,
            count,
            faces: mesh.faces.clone(),
            first,
        };
        match all.find(|(v, _)| v.name == object.name) {
            Some((v, Some(start))) => {
                let [_, count, _] = v.values.dims();
                places.scene.push((start + 3 * index * count, 3 * count));
                of_batch.push(tracked(None, count));
            }
            Some((_, None)) => {}
            None if mesh.vertices.is_tracked() => {
                let [count, _] = mesh.vertices.dims();
                own.push(tracked(Some(mesh.vertices.clone()), count));
            }
            None => {}
        }
        first += mesh.faces.len();
    }
    of_batch.extend(own);
    (of_batch, places)
}

/// Whether anything of a scene but positions of vertices is in a graph.
fn is_attached(scene: &Scene) -> bool {
    let mut rest = scene.clone();
    for object in &mut rest.objects {
        object.mesh.vertices = plain(&object.mesh.vertices);
    }
    let mut collected = Collect::default();
    visit_scene(&mut rest, &mut collected);
    !collected.rows.is_empty()
}
