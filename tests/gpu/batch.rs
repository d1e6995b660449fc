//! Batches on a GPU: views in one launch, of scenes that they share and of others, and what a training step reads back.

use crate::common::cached::steps_are_those_without_a_cache;
use crate::common::grids;
use crate::common::numbers::{apart, pairs};
use crate::common::process::alone;
use crate::common::scenes::{diffuse, floor, lamp};
use crate::common::tensors::{gradient, leaf, tensor, values};
use crate::device::device;
use burn::cubecl::future::block_on;
use burn::tensor::{DType, Device, Tensor};
use softray::device::work;
use softray::prelude::*;

/// Three bodies, of which the last is of two scenes with a map and a lens: kernels of their own.
fn batch(device: &Device) -> (Batch, Tensor<3>, Tensor<1>) {
    let ball = shapes::icosahedron(device).scaled([0.5; 3]);
    let widths = leaf(&[0.8, 1.0, 1.3], device);
    let stack = Tensor::stack::<3>(vec![ball.vertices.clone(); 3], 0);
    let vertices = stack.autodiff().require_grad();
    let scene = Scene::new()
        .with_object(diffuse(floor(2.0, -0.6, device), [0.5, 0.4, 0.3]).with_name("floor"))
        .with_object(lamp(0.5, 2.0, [5.0, 4.0, 3.0], device))
        .with_object(diffuse(ball, [0.3, 0.5, 0.6]).with_name("body"));
    let texels: Vec<f64> = (0..384).map(|i| 0.5 + 0.5 * f64::from(i).sin()).collect();
    let map = Environment::map(tensor(&texels, [8, 16, 3], device, DType::F32));
    let other = scene.clone().with_environment(map);
    let from = |x: f64| Camera::look_at([x, 1.0, 4.0], [0.0, 0.0, 0.0]).with_fov_y(40.0);
    let views = vec![
        (0, from(0.3)),
        (1, from(-0.5)),
        (0, from(1.0)),
        (2, from(0.1)),
        (2, from(0.2).with_thin_lens(0.1, 4.0)),
    ];
    let scaled = vertices.clone() * widths.clone().reshape([3, 1, 1]);
    let scenes = vec![scene.clone(), scene, other];
    let batch = Batch::views(scenes, views).and_then(|b| b.with_vertices("body", scaled));
    (batch.expect("a batch"), vertices, widths)
}

/// The image of the batch, derivatives by all bodies, and what the process read back for each.
fn on(device: &Device, samples: u32) -> (Vec<f64>, Vec<f64>, [u64; 2]) {
    let (batch, vertices, widths) = batch(device);
    let options = RenderOptions::new(12, 10)
        .with_samples(samples)
        .with_bounces(1);
    let before = work();
    let images = render_batch(&batch, &options.with_seed(4)).expect("images");
    let of_render = (work() - before).read_backs;
    let weights: Vec<f64> = (0..5 * 360).map(|i| (0.37 * f64::from(i)).sin()).collect();
    let weights = tensor(&weights, [5, 10, 12, 3], device, DType::F32);
    let loss = (images.radiance.clone() * weights).sum();
    let before = work();
    let gradients = loss.backward();
    let of_backward = (work() - before).read_backs;
    let mut by = gradient(&vertices, &gradients);
    by.extend(gradient(&widths, &gradients));
    (values(&images.radiance), by, [of_render, of_backward])
}

#[test]
fn batches_are_those_of_the_host() {
    if !alone(batches_are_those_of_the_host) {
        return;
    }
    // A pixel's samples are those of one thread, and of several.
    for samples in [1, 9] {
        let (image, by, read) = on(&device(), samples);
        let (wanted, wanted_by, none) = on(&Device::flex(), samples);
        let (off, off_by) = (apart(&image, &wanted), apart(&by, &wanted_by));
        println!("{samples} samples: image {off:e}, derivatives {off_by:e}, {read:?} read-backs");
        assert!(off < 1e-5, "{off}");
        assert!(off_by < 1e-5, "{off_by}");
        assert_eq!(none, [0, 0]);
        // Scenes and cameras together.
        assert_eq!(read, [1, 0]);
    }
}

#[test]
fn surfaces_of_grids_are_those_of_the_host() {
    let [gpu, host] = [device(), Device::flex()].map(|d| grids::of_grids(&d));
    // The precision of tanh is that of the driver.
    grids::assert_close(&gpu, &host, 1e-4);
}

/// An image whose scene is read by `await` is that of `render`, with its gradient and one transfer from the device.
#[test]
fn a_scene_is_read_without_waiting() {
    if !alone(a_scene_is_read_without_waiting) {
        return;
    }
    let device = device();
    let camera = Camera::look_at([0.0, 1.0, 4.0], [0.0, 0.0, 0.0]).with_fov_y(40.0);
    let on = |awaits: bool| {
        let place = leaf(&[0.1, 0.0, -0.1], &device);
        let ball = shapes::icosahedron(&device).translated(place.clone());
        let scene = Scene::new()
            .with_object(diffuse(ball, [0.3, 0.5, 0.6]))
            .with_object(lamp(0.5, 2.0, [5.0, 4.0, 3.0], &device));
        let options = RenderOptions::new(10, 8).with_samples(2).with_bounces(1);
        let before = work();
        let image = match awaits {
            true => block_on(render_async(&scene, &camera, &options)),
            false => render(&scene, &camera, &options),
        };
        let image = image.expect("an image");
        let gradients = image.radiance.clone().mean().backward();
        let read_backs = (work() - before).read_backs;
        let by = gradient(&place, &gradients);
        (values(&image.radiance), by, read_backs)
    };
    let wanted = on(false);
    assert!(wanted.1.iter().any(|g| g.abs() > 1e-3), "{:?}", wanted.1);
    assert_eq!(wanted.2, 1);
    assert_eq!(on(true), wanted);
}

/// A training step has few launches, sends what it needs at once for an image and for its gradient, however many views
/// there are, and reads back no more than what is in the graph, where another step was before it.
#[test]
fn work_of_a_step() {
    if !alone(work_of_a_step) {
        return;
    }
    for scenes in [1, 64] {
        let device = device();
        let ball = shapes::icosahedron(&device).scaled([0.5; 3]);
        let numbers = ball.vertices.dims()[0] * 3 * scenes;
        let scene = Scene::new()
            .with_object(diffuse(floor(2.0, -0.6, &device), [0.5, 0.4, 0.3]))
            .with_object(lamp(0.5, 2.0, [5.0, 4.0, 3.0], &device))
            .with_object(diffuse(ball.clone(), [0.3, 0.5, 0.6]).with_name("body"));
        let stack = Tensor::stack::<3>(vec![ball.vertices; scenes], 0);
        let camera = Camera::look_at([0.3, 1.0, 4.0], [0.0, 0.0, 0.0]).with_fov_y(40.0);
        let batch = Batch::new(vec![scene; scenes], vec![camera]).expect("a batch");
        let cache = HierarchyCache::default();
        let options = RenderOptions::new(8, 8)
            .with_samples(2)
            .with_bounces(1)
            .with_cache(&cache);
        let step = |scale: f64| {
            let vertices = (stack.clone() * scale).autodiff().require_grad();
            let batch = batch.clone().with_vertices("body", vertices.clone());
            let before = work();
            let images = render_batch(&batch.expect("a batch"), &options).expect("images");
            let gradients = images.radiance.sum().backward();
            let step = work() - before;
            let by = gradient(&vertices, &gradients);
            assert!(by.iter().any(|&g| g != 0.0));
            println!("{scenes} scenes: {step:?}");
            // One for what of the scene has changed, one for what follows from it, two for the image, and of the gradient
            // four where the loss is looked at, eight for the sizes of derivatives, six for paths, two for films, and one
            // behind.
            assert!(step.launches <= 25, "{step:?}");
            assert_eq!((step.uploads, step.read_backs), (2, 1), "{step:?}");
            step.read_bytes
        };
        let [first, second] = [1.0, 1.1].map(step);
        assert_eq!(second, 4 * numbers as u64);
        assert!(first > second);
    }
}

/// What has not changed since the last render with a cache is not sent again. Images and gradients are those without a cache,
/// also of an image whose graph is kept while others are rendered.
#[test]
fn scenes_stay_on_the_device() {
    if !alone(scenes_stay_on_the_device) {
        return;
    }
    let device = device();
    let camera = Camera::look_at([0.3, 1.0, 4.0], [0.0, 0.0, 0.0]).with_fov_y(40.0);
    let options = RenderOptions::new(12, 12).with_samples(2).with_bounces(1);
    let kept = options.clone().with_cache(&HierarchyCache::default());
    let beside = shapes::icosphere(4, &device).scaled([0.5; 3]);
    let beside = beside.translated([1.2, 0.0, 0.0]);
    // The sum of an image with a color and a size of a body beside a larger one, and both in its graph.
    let render = |color: f32, size: f32, options: &RenderOptions| {
        let color = leaf(&[color, 0.5, 0.6], &device);
        let size = leaf(&[size], &device);
        let body = shapes::icosphere(3, &device).scaled(size.clone());
        let scene = Scene::new()
            .with_object(diffuse(floor(2.0, -0.6, &device), [0.5, 0.4, 0.3]))
            .with_object(lamp(0.5, 2.0, [5.0, 4.0, 3.0], &device))
            .with_object(Object::new(body).with_material(Material::diffuse(color.clone())))
            .with_object(diffuse(beside.clone(), [0.6, 0.5, 0.3]));
        let before = work();
        let image = render(&scene, &camera, options).expect("an image");
        let sent = (work() - before).uploaded_bytes;
        (image.radiance.powf_scalar(2.0).sum(), [color, size], sent)
    };
    type Rendered = (Tensor<1>, [Tensor<1>; 2], u64);
    let numbers = |(loss, parameters, _): &Rendered| {
        let gradients = loss.backward();
        let by = parameters.iter().flat_map(|p| gradient(p, &gradients));
        by.chain(values(loss)).collect::<Vec<f64>>()
    };
    let mut sent = Vec::new();
    let steps = [(0.3, 0.5), (0.4, 0.5), (0.4, 0.55), (0.4, 0.55), (0.2, 0.5)];
    for (color, size) in steps {
        let step = render(color, size, &kept);
        sent.push(step.2);
        assert_eq!(numbers(&step), numbers(&render(color, size, &options)));
    }
    println!("bytes sent: {sent:?}");
    // A color, the body, nothing, both.
    assert!(sent[1] * 20 < sent[0] && sent[3] == 0);
    assert!(sent[2] > sent[1] && sent[2] * 3 < sent[0] && sent[4] * 3 < sent[0]);
    // From another thread all is sent again.
    let elsewhere = std::thread::scope(|s| s.spawn(|| render(0.2, 0.5, &kept)).join());
    let elsewhere = elsewhere.expect("a thread");
    assert_eq!(elsewhere.2, sent[0]);
    assert_eq!(numbers(&elsewhere), numbers(&render(0.2, 0.5, &options)));
    // So it is here after a backward pass there, but not after one here.
    let again = render(0.2, 0.5, &kept);
    let there = std::thread::scope(|s| s.spawn(|| numbers(&again)).join());
    assert_eq!(
        there.expect("a thread"),
        numbers(&render(0.2, 0.5, &options))
    );
    drop(again);
    let after = [0.2, 0.3].map(|color| {
        let step = render(color, 0.5, &kept);
        numbers(&step);
        step.2
    });
    assert!(after[0] == sent[0] && after[1] * 20 < sent[0], "{after:?}");
    let first = render(0.3, 0.5, &kept);
    let second = render(0.9, 0.6, &kept);
    for (step, (color, size)) in [(&second, (0.9, 0.6)), (&first, (0.3, 0.5))] {
        assert_eq!(numbers(step), numbers(&render(color, size, &options)));
    }
}

#[test]
fn bodies_move_and_shrink_back() {
    steps_are_those_without_a_cache(&device());
}

/// A scene of over 64 MiB is sent in parts, and its image is that of the host.
#[test]
fn large_scenes_are_sent_in_parts() {
    if !alone(large_scenes_are_sent_in_parts) {
        return;
    }
    const SIZE: [usize; 3] = [1_500, 4_000, 3];
    let image = |device: &Device| {
        let texel = |i: usize| 1.0 + (i as f32 * 2e-6).sin();
        let texels = (0..SIZE.iter().product()).map(texel);
        let texels = Tensor::<1>::from_floats(&*texels.collect::<Vec<f32>>(), device);
        let scene = Scene::new()
            .with_object(diffuse(floor(2.0, -0.6, device), [0.5, 0.4, 0.3]))
            .with_environment(Environment::map(texels.reshape(SIZE)));
        let camera = Camera::look_at([0.3, 1.0, 4.0], [0.0, 0.0, 0.0]);
        let options = RenderOptions::new(8, 8).with_samples(4).with_bounces(1);
        let before = work();
        let image = render(&scene, &camera, &options).expect("an image");
        (values(&image.radiance), (work() - before).uploads)
    };
    let ((found, uploads), (wanted, _)) = (image(&device()), image(&Device::flex()));
    assert!(uploads >= 2, "{uploads}");
    let apart = apart(&found, &wanted);
    assert!(apart < 1e-5, "{apart:e}");
}

/// Points that make as many searches for edges are in one warp: few lanes wait.
#[test]
fn searches_fill_their_lanes() {
    if !alone(searches_fill_their_lanes) {
        return;
    }
    let (batch, vertices, _) = batch(&device());
    let options = RenderOptions::new(16, 16).with_samples(16).with_bounces(2);
    let before = work();
    let images = render_batch(&batch, &options.with_statistics()).expect("images");
    let gradients = images.radiance.sum().backward();
    assert!(gradient(&vertices, &gradients).iter().any(|&g| g != 0.0));
    let step = work() - before;
    println!("{} searches in {} lanes", step.searches, step.search_lanes);
    assert!(step.searches > 1000);
    assert!(step.searches * 10 > step.search_lanes * 6, "{step:?}");
}

/// The images that say where noise is differ by rounding, by which few pixels have another number of samples.
#[test]
fn adaptive_images_are_those_of_the_host() {
    let on = |device: &Device| {
        let options = RenderOptions::new(12, 10).with_samples(32).with_bounces(1);
        let options = options.with_seed(4).with_adaptive().with_statistics();
        let images = render_batch(&batch(device).0, &options).expect("images");
        let paths = images.statistics.iter().map(|s| s.bounces[0]);
        (values(&images.radiance), paths.collect::<Vec<u64>>())
    };
    let ((gpu, counted), (host, wanted)) = (on(&device()), on(&Device::flex()));
    println!("paths {counted:?} and {wanted:?}");
    assert_eq!((counted.len(), wanted.len()), (5, 5));
    for (a, b) in counted.iter().zip(&wanted) {
        assert!(a.abs_diff(*b) * 50 < *b, "{a} and {b}");
    }
    let same =
        |(a, b): &(&[f64], &[f64])| pairs(a, b).all(|(a, b)| (a - b).abs() < 1e-5 * (1.0 + b));
    let all = gpu.chunks(3).zip(host.chunks(3));
    let (same, all) = (all.clone().filter(same).count(), all.count());
    println!("{same} of {all} pixels are the same");
    assert!(same * 20 > all * 19, "{same} of {all}");
    assert!(apart(&gpu, &host) < 0.05);
}
