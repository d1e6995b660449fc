//! Scenes are read back and packed, and views made of them.

use std::sync::Arc;

use burn::tensor::Tensor;
use rayon::prelude::*;

use super::places::{Parent, Places};
use crate::error::Result;
use crate::geometry::Context;
use crate::kernel::{EdgeSets, HostCamera, KernelScene, View, ViewSettings, Wanted};
use crate::render::batch::{Batch, in_batch};
use crate::render::options::RenderOptions;
use crate::render::tiles::sampler;
use crate::scene::{Collect, Detach, HostScene, check_camera, visit_camera, visit_scene};
use crate::visibility::Visibility;

/// A batch, ready to be traced.
pub(super) struct Prepared {
    pub views: Vec<(View, Places)>,
    /// All that is in a graph, in one row.
    pub parent: Option<Tensor<1>>,
    pub context: Context,
    /// Whether all scenes have light.
    pub lit: bool,
}

/// The scenes of a batch, on the host.
fn read(batch: &Batch) -> Result<Vec<HostScene>> {
    let read = |index: usize| {
        let mut scene = batch.scene(index, false);
        visit_scene(&mut scene, &mut Detach);
        HostScene::new(&scene).map_err(in_batch("scene", index))
    };
    if batch.scenes.len() == 1 {
        return Ok(vec![read(0)?]);
    }
    let all = (0..batch.scenes.len()).into_par_iter();
    all.map(read).collect()
}

/// The scenes as kernels have them; the boxes of the first serve the others.
fn pack(hosts: &mut [HostScene], options: &RenderOptions) -> Vec<Arc<KernelScene>> {
    let emitters = options.sampling.emitters;
    let first = KernelScene::new(&mut hosts[0], emitters, None, options.cache.as_ref());
    let first = Arc::new(first);
    let others: Vec<Arc<KernelScene>> = hosts[1..]
        .par_iter_mut()
        .map(|host| {
            let like = Some(&*first.hierarchy);
            Arc::new(KernelScene::new(host, emitters, like, None))
        })
        .collect();
    std::iter::once(first).chain(others).collect()
}

/// Makes the views of a batch; `interior` says whether the backward pass goes along paths, or over jumps alone.
pub(super) fn prepare(batch: &Batch, options: &RenderOptions, interior: bool) -> Result<Prepared> {
    let Visibility::Cone { angle, pixels } = options.visibility else {
        unreachable!("the softmax is for tensors");
    };
    let mut hosts = read(batch)?;
    let context = hosts[0].context.clone();
    let lit = hosts.iter().all(HostScene::has_light);
    let scenes = pack(&mut hosts, options);

    let mut parent = Parent::default();
    let scene_places = parent.collect_scenes(batch);
    let mut views = Vec::with_capacity(batch.views.len());
    let mut edge_sets: Vec<Option<Arc<EdgeSets>>> = vec![None; scenes.len()];
    for (index, (scene, camera)) in batch.views.iter().enumerate() {
        let view_error = in_batch("view", index);
        check_camera(camera, &context).map_err(view_error)?;
        let mut collected = Collect::default();
        visit_camera(&mut camera.clone(), &mut collected);
        let places = Places {
            scene: scene_places[*scene].clone(),
            camera: parent.collect(collected),
        };
        let ids = places.scene.iter().chain(&places.camera).map(|p| p.0);
        let wanted = Wanted::new(&scenes[*scene], ids);
        let edges = wanted.moves().then(|| {
            edge_sets[*scene]
                .get_or_insert_with(|| {
                    Arc::new(EdgeSets::new(&hosts[*scene], &scenes[*scene], &wanted))
                })
                .clone()
        });
        let settings = ViewSettings {
            width: options.width as u32,
            height: options.height as u32,
            pixels,
            cone: angle.tan(),
            // With a blur of all rays the camera's is as wide as the others.
            camera_cone: options.blur.map_or(0.0, f64::tan),
            bounces: options.bounces,
            roulette_after: options.roulette_after,
            multiple_importance: options.sampling.multiple_importance,
            sampler: sampler(&options.of_view(index)),
            interior,
        };
        let host = HostCamera::new(camera)?;
        let scene = scenes[*scene].clone();
        let view = View::new(scene, host, settings, wanted, edges);
        views.push((view, places));
    }
    Ok(Prepared {
        views,
        parent: parent.row(),
        context,
        lit,
    })
}
