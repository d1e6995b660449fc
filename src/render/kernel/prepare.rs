//! Reads scenes back, packs them and makes views of them. All tracked tensors are concatenated into one row, the only
//! parent of the images of a batch.

use std::collections::HashSet;
use std::sync::Arc;

#[cfg(feature = "gpu")]
use burn::tensor::DType;
use burn::tensor::Tensor;
use rayon::prelude::*;

use crate::device::stage;
use crate::error::Result;
use crate::geometry::{Context, detached, host_values, now};
use crate::render::batch::{Batch, OnHost, in_batch};
use crate::render::cache::{HierarchyCache, LastScene};
#[cfg(feature = "gpu")]
use crate::render::late::Late;
use crate::render::mistakes::warn_of_views;
use crate::render::options::{RenderOptions, sampler};
#[cfg(feature = "gpu")]
use crate::render::standing::Group;
use crate::render::standing::{Places, TensorPlaces};
use crate::scene::{
    Camera, Collect, Identity, Transfer, Visit, host_device, look_at_scene, visit_camera,
};
use crate::tensors::Visibility;
use softray_kernels::accel::Hierarchy;
use softray_kernels::host::{HostScene, ParameterId};
use softray_kernels::kernel::{EdgeSets, KernelScene, View, ViewSettings, Wanted};
use softray_kernels::model::camera::HostCamera;
use softray_kernels::model::filter::Filters;

/// A batch that is ready to trace.
pub(super) struct Prepared {
    pub views: Vec<(View, Places)>,
    /// All tracked tensors, in one row.
    pub parent: Option<Tensor<1>>,
    pub context: Context,
    /// Whether all scenes have light.
    pub lit: bool,
    /// The groups of the last render with the present values, if they serve.
    #[cfg(feature = "gpu")]
    pub groups: Option<Vec<Group>>,
    #[cfg(feature = "gpu")]
    pub late: Late,
}

/// Copies the scenes and cameras of a batch to the host. Constants in the cache are not read again. `read` returns the
/// values of a tensor.
pub(in crate::render) async fn copy(
    batch: &Batch,
    last: &HierarchyCache,
    read: impl AsyncFnOnce(Tensor<1>) -> Result<Vec<f64>>,
) -> Result<OnHost> {
    let context = batch.context()?;
    let mut cameras: Vec<Camera> = batch.views.iter().map(|v| v.1.clone()).collect();
    // A device with insufficient limits is an error before any kernel runs on it.
    #[cfg(feature = "gpu")]
    crate::gpu::check(&context.device, std::iter::empty(), None)?;
    // The vertices of the batch are read together, not scene by scene.
    let device = host_device().unwrap_or(context.device.clone());
    let mut scenes = batch.scenes_with(|_| Tensor::zeros([1, 3], &device));
    let mut vertices: Vec<Tensor<3>> = batch.vertices.iter().map(|v| v.1.clone()).collect();
    let transfer = Transfer {
        scenes: &mut scenes,
        cameras: &mut cameras,
        more: &mut vertices,
    };
    // The lock is released meanwhile, since other renders may share the cache.
    let mut constants = std::mem::take(&mut *last.constants());
    let fetched = transfer.fetch(&context, &mut constants, identity, read);
    fetched.await?;
    *last.constants() = constants;
    Ok(OnHost {
        scenes,
        cameras,
        vertices,
        context,
    })
}

/// Reads and checks the scenes and cameras of a batch.
fn read(
    batch: &Batch,
    last: &HierarchyCache,
) -> Result<(Vec<HostScene>, Vec<HostCamera>, Context)> {
    let on_host = match &batch.on_host {
        Some(on_host) => on_host.clone(),
        None => now(copy(batch, last, async |tensor| host_values(&tensor)))?,
    };
    let context = on_host.context.clone();
    let batch = on_host.batch(batch);
    let read = |index: usize| {
        let scene = batch.scene(index, false);
        scene.host().map_err(in_batch("scene", index))
    };
    let hosts = (0..batch.scenes.len()).into_par_iter().map(read);
    let hosts = hosts.collect::<Result<Vec<_>>>()?;
    let camera = |(index, (_, camera)): (usize, &(usize, Camera))| {
        let checked = camera.check(None).and_then(|()| camera.host());
        checked.map_err(in_batch("view", index))
    };
    let cameras = batch.views.iter().enumerate().map(camera);
    Ok((hosts, cameras.collect::<Result<_>>()?, context))
}

/// The identity of a tensor on a GPU.
fn identity(tensor: &Tensor<1>) -> Option<Identity> {
    #[cfg(feature = "gpu")]
    return crate::gpu::identity(tensor);
    #[cfg(not(feature = "gpu"))]
    {
        let _ = tensor;
        None
    }
}

/// Returns whether kernels run on a GPU.
pub(in crate::render) fn on_gpu(context: &Context) -> bool {
    #[cfg(feature = "gpu")]
    return context.dtype == DType::F32 && crate::device::runs_kernels(&context.device);
    #[cfg(not(feature = "gpu"))]
    {
        let _ = context;
        false
    }
}

/// Packs the scenes for the kernels. Scenes without a cached BVH start from the first scene's.
fn pack(
    hosts: &mut [HostScene],
    last: &[LastScene],
    options: &RenderOptions,
) -> Vec<Arc<KernelScene>> {
    let pack = |(host, last): (&mut HostScene, &LastScene), like: Option<&Arc<Hierarchy>>| {
        let emitters = options.sampling.emitters;
        Arc::new(KernelScene::new(host, emitters, like, &last.boxes))
    };
    let (host, others) = hosts.split_first_mut().expect("a batch has a scene");
    let first = pack((host, &last[0]), None);
    let others = others.par_iter_mut().zip(&last[1..]);
    let others = others.map(|of_scene| pack(of_scene, Some(&first.hierarchy)));
    let others: Vec<Arc<KernelScene>> = others.collect();
    std::iter::once(first).chain(others).collect()
}

/// Makes the views of a batch. With `interior`, the backward pass computes interior and boundary terms, otherwise only
/// boundary terms. Derivatives are those by the `chosen` tensors if there are any, and otherwise by the tracked tensors.
pub(super) fn prepare(
    batch: &Batch,
    options: &RenderOptions,
    interior: bool,
    chosen: Option<HashSet<ParameterId>>,
) -> Result<Prepared> {
    let Visibility::Cone { angle, pixels } = options.form() else {
        unreachable!("the softmax is for tensors");
    };
    let last = options.cache.clone().unwrap_or_default();
    // What is kept for a late step would keep the last lists from being reused.
    #[cfg(feature = "gpu")]
    drop(last.take_standing());
    let (mut hosts, cameras, context) = stage("read and check", || read(batch, &last))?;
    let lit = hosts.iter().all(HostScene::has_light);
    if interior && !options.quiet {
        stage("warnings", || {
            warn_of_views(batch, &hosts, &cameras, options);
        });
    }
    let last = last.scenes(hosts.len());
    let scenes = stage("lists and boxes", || pack(&mut hosts, &last, options));

    let mut row = Collect {
        chosen,
        ..Collect::default()
    };
    let scene_places = collect_scenes(&mut row, batch);
    let mut of_views = Vec::with_capacity(batch.views.len());
    // For each scene the first view whose gradient has boundary terms.
    let mut moving = vec![None; scenes.len()];
    for (index, (scene, camera)) in batch.views.iter().enumerate() {
        visit_camera(&mut camera.clone(), &mut row);
        let places = Places {
            scene: scene_places[*scene].clone(),
            camera: std::mem::take(&mut row.places),
        };
        let ids = places.scene.iter().chain(&places.camera).map(|p| p.0);
        let wanted = Wanted::new(&scenes[*scene], ids);
        let settings = settings_of(&options.of_view(index), angle, interior);
        let jumps = settings.has_jumps(&scenes[*scene], &wanted);
        if jumps {
            moving[*scene].get_or_insert(index);
        }
        of_views.push((wanted, places, settings, jumps));
    }
    let for_gpu = interior && on_gpu(&context);
    let edges = |(s, view): (usize, &Option<usize>)| {
        let wanted = &of_views[(*view)?].0;
        let last = &last[s].edges;
        Some(EdgeSets::new(&hosts[s], &scenes[s], wanted, last, for_gpu))
    };
    let edge_sets: Vec<Option<Arc<EdgeSets>>> = stage("edges", || {
        moving.par_iter().enumerate().map(edges).collect()
    });
    let mut filters = Filters::default();
    let of_batch = batch.views.iter().zip(&cameras);
    let of_batch = of_batch.zip(of_views);
    let views = of_batch.map(
        |(((scene, _), camera), (wanted, places, settings, jumps))| {
            // With a blur of all rays, the camera rays' cone is as wide as the others.
            let wide = options.blur_slope();
            let pixels_per_tangent = 0.5 * options.height as f64 / camera.half_height;
            let filter = filters.of_cone(pixels, wide * pixels_per_tangent);
            let edges = edge_sets[*scene].clone().filter(|_| jumps);
            let scene = scenes[*scene].clone();
            let view = View::new(scene, *camera, filter, settings, wanted, edges);
            view.warn_of_hard_shadows();
            (view, places)
        },
    );
    Ok(Prepared {
        views: views.collect(),
        parent: (!row.rows.is_empty()).then(|| Tensor::cat(row.rows, 0)),
        context,
        lit,
        #[cfg(feature = "gpu")]
        groups: None,
        #[cfg(feature = "gpu")]
        late: Late::default(),
    })
}

/// Returns the settings of a view whose cones have a half-angle in degrees.
fn settings_of(options: &RenderOptions, angle: f64, interior: bool) -> ViewSettings {
    ViewSettings {
        width: options.width as u32,
        height: options.height as u32,
        cone: angle.to_radians().tan(),
        bounces: options.bounces,
        roulette_after: options.roulette_after,
        clamp: options.indirect_clamp.map(|limit| limit as f32),
        least_roughness: options.path_regularization.map(|least| least as f32),
        albedo: options.outputs.albedo,
        multiple_importance: options.sampling.multiple_importance,
        sampler: sampler(options),
        interior,
    }
}

/// Adds the batch's vertices to the row, then the tensors of its scenes. Returns the ranges of each scene's tensors.
pub(super) fn collect_scenes(row: &mut Collect, batch: &Batch) -> Vec<TensorPlaces> {
    let mut starts = Vec::with_capacity(batch.vertices.len());
    for (_, values) in &batch.vertices {
        starts.push(row.size);
        row.visit(ParameterId::Vertices(0), &mut values.clone());
    }
    row.places.clear();
    let mut all = Vec::with_capacity(batch.scenes.len());
    for (index, scene) in batch.scenes.iter().enumerate() {
        let mut rest = scene.clone();
        for ((name, values), start) in batch.vertices.iter().zip(&starts) {
            let Some(i) = rest.objects.iter().position(|o| o.name == *name) else {
                continue;
            };
            let mesh = &mut rest.objects[i].mesh;
            mesh.vertices = detached(&mesh.vertices);
            if values.is_tracked() {
                let length = 3 * values.dims()[1];
                let begin = start + index * length;
                row.places
                    .push((ParameterId::Vertices(i), begin..begin + length));
            }
        }
        look_at_scene(&rest, row);
        all.push(std::mem::take(&mut row.places));
    }
    all
}
