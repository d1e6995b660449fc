//! Renders by kernels: all views of a batch are one node of the graph, from the tensors of scenes and
//! cameras to the images. The backward pass traces the paths again; memory does not grow with them.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use burn::tensor::{DType, Element, Tensor, TensorData};
use rayon::prelude::*;

use super::batch::of_batch;
use super::film::{Means, Statistics};
use super::replay::{Retrace, replay};
use super::tensors::{Tile, sampler, tiles};
use super::{Batch, Diagnostics, RenderOptions};
use crate::error::{Error, Result};
use crate::geometry::Context;
use crate::kernel::{
    EdgeSets, HostCamera, KernelScene, PixelGradients, RayCounts, Seen, Sums, View, ViewSettings,
    Wanted, Work,
};
use crate::model::V3;
use crate::scene::{
    Camera, Collect, Detach, HostScene, ParameterId, Scene, check_camera, visit_camera, visit_scene,
};
use crate::visibility::Visibility;

/// Camera rays of a tile.
const RAYS: usize = 1 << 13;

/// Numbers in the sums of derivatives of all accumulators together.
const ACCUMULATED: usize = 1 << 24;

/// Views whose derivatives are held at once.
const VIEWS_AT_ONCE: usize = 16;

/// Where the derivatives of a view are in the parent.
#[derive(Clone, Default)]
struct Places {
    scene: Vec<(ParameterId, Range<usize>)>,
    camera: Vec<(ParameterId, Range<usize>)>,
}

/// A batch, ready to be traced.
struct Prepared {
    views: Vec<View>,
    places: Vec<Places>,
    /// All that is in a graph, in one row.
    parent: Option<Tensor<1>>,
    parent_size: usize,
    context: Context,
    /// Whether all scenes have light.
    lit: bool,
}

/// Rows that become one.
#[derive(Default)]
struct Parent {
    rows: Vec<Tensor<1>>,
    size: usize,
}

impl Parent {
    /// Where the rows begin.
    fn push(&mut self, rows: Vec<Tensor<1>>) -> usize {
        let first = self.size;
        self.size += rows.iter().map(|r| r.dims()[0]).sum::<usize>();
        self.rows.extend(rows);
        first
    }

    /// The tensors that were collected, and where they are.
    fn collect(&mut self, collected: Collect) -> Vec<(ParameterId, Range<usize>)> {
        let places = collected.places(self.size);
        self.push(collected.rows);
        places
    }
}

fn prepare(batch: &Batch, options: &RenderOptions, interior: bool) -> Result<Prepared> {
    let Visibility::Cone { angle, pixels } = options.visibility else {
        unreachable!("the softmax is for tensors");
    };
    // With a blur of all rays the camera's is as wide as the others.
    let camera_cone = options.blur.map_or(0.0, f64::tan);
    let read = |index: usize| {
        let mut scene = batch.scene(index, false);
        visit_scene(&mut scene, &mut Detach);
        HostScene::new(&scene).map_err(of_batch("scene", index))
    };
    let mut hosts: Vec<HostScene> = if batch.scenes.len() == 1 {
        vec![read(0)?]
    } else {
        let all = (0..batch.scenes.len()).into_par_iter();
        all.map(read).collect::<Result<_>>()?
    };
    let context = hosts[0].context.clone();
    let lit = hosts.iter().all(HostScene::has_light);
    let emitters = options.sampling.emitters;
    let first = KernelScene::new(&mut hosts[0], emitters, None, options.cache.as_ref());
    let first = Arc::new(first);
    let others: Vec<Arc<KernelScene>> = hosts[1..]
        .par_iter_mut()
        .map(|host| {
            Arc::new(KernelScene::new(
                host,
                emitters,
                Some(&first.hierarchy),
                None,
            ))
        })
        .collect();
    let scenes: Vec<Arc<KernelScene>> = std::iter::once(first).chain(others).collect();

    let mut parent = Parent::default();
    // Tensors of the batch first, then scenes, then cameras.
    let of_batch_vertices: Vec<Option<usize>> = batch
        .vertices
        .iter()
        .map(|v| {
            let [s, n, _] = v.values.dims();
            let tracked = v.values.is_tracked();
            tracked.then(|| parent.push(vec![v.values.clone().reshape([3 * s * n])]))
        })
        .collect();
    let mut scene_places = Vec::with_capacity(scenes.len());
    for (index, scene) in batch.scenes.iter().enumerate() {
        let mut rest = scene.clone();
        let mut places = Vec::new();
        for (v, start) in batch.vertices.iter().zip(&of_batch_vertices) {
            let Some(i) = rest.objects.iter().position(|o| o.name == v.name) else {
                continue;
            };
            let mesh = &mut rest.objects[i].mesh;
            mesh.vertices = crate::geometry::plain(&mesh.vertices);
            if let Some(start) = start {
                let length = 3 * v.values.dims()[1];
                let begin = start + index * length;
                places.push((ParameterId::Vertices(i), begin..begin + length));
            }
        }
        let mut collected = Collect::default();
        visit_scene(&mut rest, &mut collected);
        places.extend(parent.collect(collected));
        scene_places.push(places);
    }
    let mut views = Vec::with_capacity(batch.views.len());
    let mut all_places = Vec::with_capacity(batch.views.len());
    let mut edge_sets: Vec<Option<Arc<EdgeSets>>> = vec![None; scenes.len()];
    for (index, (scene, camera)) in batch.views.iter().enumerate() {
        let view_error = of_batch("view", index);
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
            camera_cone,
            bounces: options.bounces,
            roulette_after: options.roulette_after,
            multiple_importance: options.sampling.multiple_importance,
            sampler: sampler(&options.of_view(index)),
            interior,
        };
        let host = HostCamera::new(camera)?;
        let scene = scenes[*scene].clone();
        views.push(View::new(scene, host, &settings, wanted, edges));
        all_places.push(places);
    }
    Ok(Prepared {
        views,
        places: all_places,
        parent_size: parent.size,
        parent: (!parent.rows.is_empty()).then(|| Tensor::cat(parent.rows, 0)),
        context,
        lit,
    })
}

/// The rows of an image: radiance, opacity, depth, normal, share of each object and the background.
#[derive(Clone, Copy, Debug)]
struct Rows {
    opacity: bool,
    depth: bool,
    normals: bool,
    /// How many objects, if their shares are asked for.
    objects: Option<usize>,
}

impl Rows {
    fn new(options: &RenderOptions, objects: usize) -> Self {
        let outputs = options.outputs;
        Self {
            opacity: outputs.opacity || outputs.depth || outputs.normals,
            depth: outputs.depth,
            normals: outputs.normals,
            objects: outputs.object_ids.then_some(objects),
        }
    }

    fn count(&self) -> usize {
        let normals = if self.normals { 3 } else { 0 };
        let objects = self.objects.map_or(0, |n| n + 1);
        3 + usize::from(self.opacity) + usize::from(self.depth) + normals + objects
    }

    /// All but the shares of objects, in a scene whose distances are in so many scene units.
    fn of(&self, p: &Seen, unit: f64) -> impl Iterator<Item = f64> {
        let opacity = self.opacity.then_some(f64::from(p.opacity));
        let depth = self.depth.then_some(f64::from(p.depth) * unit);
        let normal = self.normals.then_some(p.normal.to_f64());
        let radiance = p.radiance.to_f64().into_iter();
        let rows = radiance.chain(opacity).chain(depth);
        rows.chain(normal.into_iter().flatten())
    }

    /// From rows of derivatives by the rows.
    fn upstream(&self, row: impl Fn(usize) -> f64, unit: f64) -> Seen {
        let mut next = 0;
        let mut take = |wanted: bool| {
            if !wanted {
                return 0.0;
            }
            next += 1;
            row(next - 1)
        };
        let radiance: V3 = [take(true), take(true), take(true)].into();
        let opacity = take(self.opacity) as f32;
        let depth = (take(self.depth) * unit) as f32;
        let normals = self.normals;
        Seen {
            radiance,
            opacity,
            depth,
            normal: [take(normals), take(normals), take(normals)].into(),
        }
    }
}

/// Pixels of a list, or all.
fn pixels_or_all(options: &RenderOptions, pixels: Option<Arc<Vec<u32>>>) -> Arc<Vec<u32>> {
    pixels.unwrap_or_else(|| {
        let count = (options.width * options.height) as u32;
        Arc::new((0..count).collect())
    })
}

/// What jumps of visibility add to the gradient of a view's tensors (as one row) from that of its rows
/// `[P, C]`.
pub(super) fn jumps(
    (scene, camera): (&Scene, &Camera),
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
    upstream: &TensorData,
) -> Result<Vec<f64>> {
    let batch = Batch::views(vec![scene.clone()], vec![(0, camera.clone())])?;
    let prepared = prepare(&batch, options, false)?;
    if !prepared.views.iter().any(View::has_edges) {
        return Ok(vec![0.0; prepared.parent_size]);
    }
    let pixels = pixels_or_all(options, pixels);
    let objects = prepared.views[0].scene.counted.len();
    let backward = Backward {
        views: prepared.views,
        places: prepared.places,
        tiles: tiles(options, pixels.len(), RAYS),
        rows: Rows::new(options, objects),
        pixels,
        samples: options.samples,
        size: prepared.parent_size,
    };
    Ok(backward.gradient(upstream))
}

/// Renders pixels of all views (all pixels, if there is no list).
pub(super) fn render(
    batch: &Batch,
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
) -> Result<Means> {
    let Prepared {
        views,
        places,
        parent,
        parent_size,
        context,
        lit,
    } = prepare(batch, options, true)?;
    let objects = views.iter().map(|v| v.scene.counted.len()).max();
    let objects = objects.unwrap_or(0);
    let rows = Rows::new(options, objects);
    let count = match &pixels {
        Some(pixels) => pixels.len(),
        None => options.width * options.height,
    };
    let tiles = tiles(options, count, RAYS);
    let pass = Forward {
        options,
        pixels: pixels.as_deref(),
        tiles: &tiles,
        rows: &rows,
        all: tiles.len() * views.len(),
        done: &AtomicUsize::new(0),
    };
    let (means, traced) = if context.dtype == DType::F64 {
        pass.views(&views, count, |value| value)?
    } else {
        pass.views(&views, count, |value| value as f32)?
    };
    // Where scenes have no light that was told already.
    if lit
        && pixels.is_none()
        && let Some(black) = traced.iter().position(|t| !t.lit)
    {
        log::warn!(
            "the image of view {black} is black though its scene has light: does the camera look at \
             something lit? Emitters shine from their front alone, and a closed object hides what is \
             inside of it"
        );
    }
    let mut statistics = Vec::with_capacity(views.len());
    let mut diagnostics = Vec::new();
    for (view, traced) in views.iter().zip(traced) {
        statistics.push(Statistics::of_rays(traced.counts));
        if options.diagnostics {
            diagnostics.push(Diagnostics {
                degenerate_triangles: view.scene.degenerate(),
                non_finite_light: traced.non_finite,
                effective_surfaces: 1.0,
                ..Diagnostics::default()
            });
        }
    }
    let mean = Tensor::from_data(means, (&context.device, context.dtype));
    let mean = match parent {
        Some(parent) => {
            let dtype = context.dtype;
            let backward = Backward {
                views,
                places,
                pixels: pixels_or_all(options, pixels),
                tiles,
                rows,
                samples: options.samples,
                size: parent_size,
            };
            let retrace = Retrace(Arc::new(move |upstream| {
                let all = backward.gradient(&upstream);
                TensorData::new(all, [parent_size]).convert_dtype(dtype)
            }));
            replay(parent, mean, retrace)
        }
        None => mean,
    };
    Ok(Means {
        mean: mean.reshape([statistics.len(), count, rows.count()]),
        objects,
        statistics,
        diagnostics,
    })
}

/// What the views of a forward pass have in common.
struct Forward<'a> {
    options: &'a RenderOptions,
    /// The pixels, if not all.
    pixels: Option<&'a Vec<u32>>,
    tiles: &'a [Tile],
    rows: &'a Rows,
    /// Tiles of all views.
    all: usize,
    done: &'a AtomicUsize,
}

/// What was found on the way.
#[derive(Default)]
struct Traced {
    counts: RayCounts,
    /// Numbers of radiance that are not finite.
    non_finite: u64,
    /// Whether a pixel is not black; known of means, not of tiles.
    lit: bool,
}

impl Traced {
    fn add(&mut self, other: &Self) {
        self.counts.rays += other.counts.rays;
        self.counts.add_bounces(&other.counts);
        self.non_finite += other.non_finite;
        self.lit |= other.lit;
    }
}

impl Forward<'_> {
    /// The rows of all pixels of all views `[B·P, C]`, each number of a type of its own; they are all that
    /// is held at once.
    fn views<T: Element + Send>(
        &self,
        views: &[View],
        count: usize,
        cast: impl Fn(f64) -> T + Sync,
    ) -> Result<(TensorData, Vec<Traced>)> {
        let channels = self.rows.count();
        let of_view = count * channels;
        let mut means: Vec<T> = Vec::new();
        means
            .try_reserve_exact(views.len() * of_view)
            .map_err(|_| {
                let size = format!("{} × {}", self.options.width, self.options.height);
                let bytes = (views.len() * of_view * size_of::<T>()) as f64;
                let expected = format!(
                    "an image that fits into memory; it takes {:.1} GB",
                    bytes / 1e9
                );
                Error::invalid("options", "width × height", size, expected)
            })?;
        means.resize(views.len() * of_view, cast(0.0));
        let traced = means
            .par_chunks_mut(of_view)
            .zip(views)
            .map(|(means, view)| self.view(view, means, &cast))
            .collect();
        let shape = [views.len() * count, channels];
        Ok((TensorData::new(means, shape), traced))
    }

    /// Fills the rows of a view's pixels `[P, C]`.
    fn view<T: Send>(
        &self,
        view: &View,
        means: &mut [T],
        cast: &(impl Fn(f64) -> T + Sync),
    ) -> Traced {
        let channels = self.rows.count();
        let same_pixels = |a: &Tile, b: &Tile| a.first == b.first;
        let groups: Vec<&[Tile]> = self.tiles.chunk_by(same_pixels).collect();
        let each = self.tiles[0].pixels * channels;
        let of_group = |(tiles, means): (&[Tile], &mut [T])| {
            let sums: Vec<(Vec<f64>, Traced)> =
                tiles.par_iter().map(|tile| self.tile(view, tile)).collect();
            let mut traced = Traced::default();
            sums.iter().for_each(|s| traced.add(&s.1));
            for (i, mean) in means.iter_mut().enumerate() {
                let sum: f64 = sums.iter().map(|s| s.0[i]).sum();
                traced.lit |= sum != 0.0 && i % channels < 3;
                *mean = cast(sum / f64::from(self.options.samples));
            }
            traced
        };
        let groups = groups.into_par_iter().zip(means.par_chunks_mut(each));
        let found: Vec<Traced> = groups.map(of_group).collect();
        let mut traced = Traced::default();
        found.iter().for_each(|f| traced.add(f));
        traced
    }

    /// Sums over the samples of a tile `[P, C]`.
    fn tile(&self, view: &View, tile: &Tile) -> (Vec<f64>, Traced) {
        let own = view.scene.counted.len();
        let range = tile.first..tile.first + tile.pixels;
        let all: Vec<u32>;
        let pixels = match self.pixels {
            Some(pixels) => &pixels[range],
            None => {
                all = range.map(|i| i as u32).collect();
                &all
            }
        };
        let mut work = Work::new(self.options.bounces);
        let mut objects = self
            .rows
            .objects
            .map(|_| vec![0.0; (own + 1) * tile.pixels]);
        let samples = tile.from..tile.to;
        let sums = view.render(pixels, samples, &mut work, objects.as_deref_mut());
        let channels = self.rows.count();
        let mut rows = vec![0.0; channels * tile.pixels];
        let mut non_finite = 0;
        for (i, (sum, row)) in sums.iter().zip(rows.chunks_exact_mut(channels)).enumerate() {
            let values = self.rows.of(sum, view.scene.frame.unit);
            row.iter_mut().zip(values).for_each(|(r, v)| *r = v);
            non_finite += row[..3].iter().filter(|v| !v.is_finite()).count() as u64;
            if let (Some(objects), Some(all)) = (&objects, self.rows.objects) {
                let first = channels - all - 1;
                for (k, share) in objects[i * (own + 1)..][..=own].iter().enumerate() {
                    // The background comes last, whatever the number of objects.
                    row[first + if k == own { all } else { k }] = f64::from(*share);
                }
            }
        }
        let n = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        if let Some(progress) = &self.options.progress {
            progress(n, self.all);
        }
        let counts = work.counts;
        let traced = Traced {
            counts,
            non_finite,
            ..Traced::default()
        };
        (rows, traced)
    }
}

/// What the backward pass needs.
struct Backward {
    views: Vec<View>,
    places: Vec<Places>,
    pixels: Arc<Vec<u32>>,
    tiles: Vec<Tile>,
    rows: Rows,
    samples: u32,
    /// Numbers of the parent.
    size: usize,
}

impl Backward {
    /// The gradient of the parent from that of the rows of all views `[B·P, C]`.
    fn gradient(&self, upstream: &TensorData) -> Vec<f64> {
        let upstream: Vec<f64> = upstream.iter::<f64>().collect();
        let of_view = self.rows.count() * self.pixels.len();
        let mut all = vec![0.0; self.size];
        let views: Vec<_> = self.views.iter().zip(&self.places).collect();
        let pieces = views.chunks(VIEWS_AT_ONCE);
        for (views, upstream) in pieces.zip(upstream.chunks(VIEWS_AT_ONCE * of_view)) {
            let gradients: Vec<Sums> = views
                .par_iter()
                .zip(upstream.par_chunks(of_view))
                .map(|((view, _), upstream)| self.of_view(view, upstream))
                .collect();
            for ((view, places), sums) in views.iter().zip(&gradients) {
                sums.write(&view.scene, &places.scene, &mut all);
                view.write_camera(&sums.camera, &places.camera, &mut all);
            }
        }
        all
    }

    fn of_view(&self, view: &View, upstream: &[f64]) -> Sums {
        let channels = self.rows.count();
        let per_sample = f64::from(self.samples).recip();
        let unit = view.scene.frame.unit;
        let upstream: Vec<(u32, Seen)> = self
            .pixels
            .iter()
            .enumerate()
            .map(|(i, &pixel)| {
                let row = |row: usize| upstream[i * channels + row] * per_sample;
                (pixel, self.rows.upstream(row, unit))
            })
            .collect();
        // Tiles in accumulators that have their sums to themselves: as many whatever the machine, so that
        // sums come out the same.
        let typical = View::typical(&upstream);
        let zero = Sums::new(&view.scene, &view.wanted);
        let accumulators = (ACCUMULATED / zero.len()).clamp(4, 64);
        let each = self.tiles.len().div_ceil(accumulators).max(1);
        let of_accumulator = |tiles: &[Tile]| {
            let mut sums = zero.clone();
            let mut work = Work::new(0);
            for tile in tiles {
                let pixels = &upstream[tile.first..tile.first + tile.pixels];
                view.backward(pixels, typical, tile.from..tile.to, &mut work, &mut sums);
            }
            sums
        };
        let sums: Vec<Sums> = self.tiles.par_chunks(each).map(of_accumulator).collect();
        let mut all = zero.clone();
        sums.iter().for_each(|s| all.add(s));
        if view.has_edges() {
            self.on_film(view, upstream, &zero, accumulators, &mut all);
        }
        all.resolve(&view.scene);
        all
    }

    /// Adds what jumps on the film.
    fn on_film(
        &self,
        view: &View,
        mut upstream: Vec<(u32, Seen)>,
        zero: &Sums,
        accumulators: usize,
        all: &mut Sums,
    ) {
        let samples = self.samples as f32;
        for (_, g) in &mut upstream {
            g.radiance = g.radiance * samples;
            g.opacity *= samples;
            g.depth *= samples;
            g.normal = g.normal * samples;
        }
        let [width, height] = view.size();
        let asked = upstream.iter().filter(|p| p.1 != Seen::default()).count();
        let pixels = PixelGradients::new(&upstream, width, height, view.reach());
        let edges = view.film_edges(&pixels);
        if edges.is_empty() {
            return;
        }
        let paths = asked as f64 * f64::from(self.samples);
        let count = (FILM_SAMPLES * paths).max(FEW.min(8.0 * paths)).ceil();
        let count = count.clamp(1.0, 1e9) as u32;
        let each = count.div_ceil(accumulators as u32).max(256);
        let sums: Vec<Sums> = (0..count.div_ceil(each))
            .into_par_iter()
            .map(|i| {
                let mut sums = zero.clone();
                let mut work = Work::new(0);
                let range = i * each..((i + 1) * each).min(count);
                view.film_backward(&edges, &pixels, range, count, &mut work, &mut sums);
                sums
            })
            .collect();
        sums.iter().for_each(|s| all.add(s));
    }
}

/// Samples of edges on the film for each path of the image.
const FILM_SAMPLES: f64 = 0.125;

/// So many samples of edges on the film take no time.
const FEW: f64 = 1024.0;
