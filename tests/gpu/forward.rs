//! Forward mode on a GPU, beside the host and beside backward passes.

use burn::tensor::{DType, Device};
use softray::device::work;
use softray::prelude::*;

use crate::common::errors::{message, says};
use crate::common::gradients::{CONES, Case, all_classes};
use crate::common::numbers::{largest, norm, pairs};
use crate::common::process::alone;
use crate::common::scenes::{diffuse, floor, lamp};
use crate::common::tensors::{gradient, tensor, values};
use crate::device::device;
use crate::kernels::each;

const SIZE: usize = 8;

/// A class of each kind of sums: meshes, objects, materials, textures, lights, environments, cameras, lenses.
const CASES: [&str; 10] = [
    "vertex",
    "translation",
    "velocity",
    "texel",
    "shininess",
    "light translation",
    "environment",
    "point position",
    "field of view",
    "focus distance",
];

fn cases() -> Vec<Case> {
    let mut all = all_classes();
    all.retain(|case| CASES.contains(&case.name));
    assert_eq!(all.len(), CASES.len());
    all
}

/// The scene and the camera of a case at a number `[1]`.
fn at(case: &Case, number: Tensor<1>, dtype: DType) -> (Scene, Camera) {
    (case.build)(&number.device().inner(), dtype, number)
}

/// The direction of a case's number, found in f64 on the host.
fn direction(case: &Case) -> Vec<Tangent> {
    let build = |v: &[f64]| {
        let number = tensor(&[v[0]], [1], &Device::flex(), DType::F64);
        Ok(at(case, number, DType::F64))
    };
    Tangent::of_numbers(&[case.value], build)
        .expect(case.name)
        .2
}

fn options(case: &Case) -> RenderOptions {
    RenderOptions::new(SIZE, SIZE)
        .with_samples(5)
        .with_bounces(case.bounces)
        .with_visibility(CONES.visibility)
        .with_opacity()
        .with_depth()
        .with_normals()
        .with_adaptive_edges(false)
        .with_seed(3)
}

/// The planes of an image: radiance, opacity, depth and normals.
fn outputs(image: &Image) -> [Vec<f64>; 4] {
    let plane = |plane: &Option<Tensor<2>>| values(&plane.clone().expect("a plane"));
    [
        values(&image.radiance),
        plane(&image.opacity),
        plane(&image.depth),
        values(&image.normals.clone().expect("normals")),
    ]
}

/// The image and the derivatives of a case on a device.
fn derivative(case: &Case, device: &Device, tangents: &[Tangent]) -> ImageDerivative {
    let number = tensor(&[case.value], [1], device, DType::F32);
    let (scene, camera) = at(case, number, DType::F32);
    render_derivative(&scene, &camera, &options(case), tangents).expect(case.name)
}

/// By how much the pixels of a plane differ from those wanted, relative to the length of these.
fn by_pixels(found: &[f64], wanted: &[f64]) -> Vec<f64> {
    let scale = norm(wanted).max(1e-3);
    let each: Vec<f64> = pairs(found, wanted).map(|(a, b)| (a - b) / scale).collect();
    let of_pixel = each.len() / (SIZE * SIZE);
    each.chunks_exact(of_pixel).map(norm).collect()
}

/// The derivative, by a case's number, of the sum of radiance and opacity under weights, by a backward pass on a device.
fn by_backward(case: &Case, device: &Device, weights: &[f64]) -> f64 {
    let p = tensor(&[case.value], [1], device, DType::F32);
    let p = p.autodiff().require_grad();
    let (scene, camera) = at(case, p.clone(), DType::F32);
    let image = render(&scene, &camera, &options(case)).expect(case.name);
    let (colors, planes) = weights.split_at(3 * SIZE * SIZE);
    let colors = tensor(colors, [SIZE, SIZE, 3], device, DType::F32);
    let planes = tensor(planes, [SIZE, SIZE], device, DType::F32);
    let opacity = image.opacity.expect("opacity");
    let loss = (image.radiance * colors).sum() + (opacity * planes).sum();
    gradient(&p, &loss.backward())[0]
}

/// The images and the derivatives of all outputs of one seed. The short tier takes each second case here, and the others in
/// the next test. In a pixel or two a path may meet another surface by rounding.
#[test]
fn derivatives_are_those_of_the_host() {
    let (gpu, cpu) = (device(), Device::flex());
    let mut flipped = 0;
    for case in each(cases(), 2) {
        let tangents = direction(&case);
        let [found, wanted] = [&gpu, &cpu].map(|device| derivative(&case, device, &tangents));
        let programs = [&found, &wanted].map(|all| all.tangents.statistics[0].program);
        assert_eq!(programs, [Program::DeviceKernels, Program::HostKernels]);
        let [found, wanted] = [found, wanted].map(|all| {
            let images = [all.image, all.tangents.view(0)];
            images.each_ref().map(outputs).concat()
        });
        let planes = found.iter().zip(&wanted);
        let apart: Vec<f64> = planes.flat_map(|(a, b)| by_pixels(a, b)).collect();
        let most = largest(apart.iter().copied());
        println!("{}: pixels differ by {most:.1e}", case.name);
        assert!(most < 1e-2, "{}: {most:e}", case.name);
        flipped += apart.iter().filter(|&&apart| apart > 1e-5).count();
    }
    assert!(flipped <= 2, "{flipped}");
}

/// ⟨w, J·v⟩ = ⟨Jᵀ·w, v⟩ at equal seeds, with w of ±1 for all channels of all pixels, both on the device. Where the sum
/// cancels, the derivatives of pixels set the scale.
#[test]
fn products_agree_with_the_backward_pass() {
    let device = device();
    let sign = |i: usize| f64::from((i * i * 7 + i * 13) % 11 < 5) * 2.0 - 1.0;
    let signs: Vec<f64> = (0..4 * SIZE * SIZE).map(sign).collect();
    let mut failures = Vec::new();
    let mut cases = cases();
    cases.rotate_left(1);
    for case in each(cases, 2) {
        let all = derivative(&case, &device, &direction(&case));
        let [radiance, opacity, ..] = outputs(&all.tangents.view(0));
        let by_pixel = [radiance, opacity].concat();
        let forward: f64 = pairs(&by_pixel, &signs).map(|(by, w)| by * w).sum();
        let backward = by_backward(&case, &device, &signs);
        let off = (forward - backward).abs() / norm(&by_pixel).max(1e-6);
        println!("{}: {forward:.6} {backward:.6}, {off:.1e}", case.name);
        if off.is_nan() || off > 1e-4 {
            failures.push((case.name, forward, backward, off));
        }
    }
    assert!(failures.is_empty(), "{failures:?}");
}

/// A body between a floor and a lamp, by its place, its color, the lamp's light and the field of view, and by a direction
/// in which nothing changes.
fn room(device: &Device) -> (Scene, Camera, Vec<Tangent>) {
    let build = |device: &Device, v: &[f64]| {
        let body = shapes::icosahedron(device).scaled(0.5);
        let scene = Scene::new()
            .with_object(diffuse(floor(2.0, -0.6, device), [0.5, 0.4, 0.3]))
            .with_object(lamp(0.5, 2.0, [v[2], 4.0, 3.0], device))
            .with_object(diffuse(body.translated([v[0], 0.0, 0.0]), [v[1], 0.5, 0.6]));
        let camera = Camera::look_at([0.3, 1.0, 4.0], [0.0; 3]);
        Ok((scene, camera.with_fov_y(v[3])))
    };
    let numbers = [0.1, 0.3, 5.0, 40.0];
    let of_numbers = Tangent::of_numbers(&numbers, |v| build(&Device::flex(), v));
    let (scene, camera, mut tangents) = of_numbers.expect("tangents");
    tangents.push(Tangent::new(&scene, &camera, |_, _| {}).expect("a tangent"));
    let (scene, camera) = build(device, &numbers).expect("a scene");
    (scene, camera, tangents)
}

fn of_room(samples: u32) -> RenderOptions {
    RenderOptions::new(SIZE, SIZE)
        .with_samples(samples)
        .with_bounces(1)
        .with_seed(7)
}

/// The numbers of all images.
fn numbers(all: &ImageDerivative) -> [Vec<f64>; 2] {
    [
        &all.image.radiance.clone().unsqueeze(),
        &all.tangents.radiance,
    ]
    .map(|t: &Tensor<4>| values(t))
}

/// The same call has the same bits, also with a cache, and reads back as often as a render. Directions in which the same
/// values change have the bits that they have alone, and one in which nothing changes has a derivative of 0.
#[test]
fn bits_repeat() {
    if !alone(bits_repeat) {
        return;
    }
    let device = device();
    let (scene, camera, tangents) = room(&device);
    let options = of_room(8);
    let of = |options: &RenderOptions, tangents: &[Tangent]| {
        let before = work();
        let all = render_derivative(&scene, &camera, options, tangents).expect("derivatives");
        let read = (work() - before).read_backs;
        (numbers(&all), read)
    };
    let (first, read) = of(&options, &tangents);
    assert_eq!(read, 1);
    assert!(first.iter().flatten().all(|v| v.is_finite()));
    let cached = options.clone().with_cache(&HierarchyCache::default());
    for options in [&options, &cached, &cached] {
        assert!(of(options, &tangents).0 == first);
    }
    let image = render(&scene, &camera, &options).expect("an image");
    assert!(values(&image.radiance) == first[0]);
    let each: Vec<&[f64]> = first[1].chunks_exact(3 * SIZE * SIZE).collect();
    let [some, .., last] = &each[..] else {
        panic!("a derivative for each direction")
    };
    assert!(some.iter().any(|&v| v != 0.0) && last.iter().all(|&v| v == 0.0));
    let twice = [&tangents[..1], &tangents[..1]].concat();
    let ([_, alone], _) = of(&options, &tangents[..1]);
    let ([_, both], _) = of(&options, &twice);
    assert!(both == [&alone[..], &alone[..]].concat());
}

/// What is too large for a buffer of the device is an error before anything is launched.
#[test]
fn too_many_directions_are_an_error() {
    if !alone(too_many_directions_are_an_error) {
        return;
    }
    let (scene, camera, tangents) = room(&device());
    // 18.9 GB, more than a list of any device may have.
    let many: Vec<Tangent> = tangents.iter().cycle().take(300).cloned().collect();
    let options = RenderOptions::new(1024, 1024).with_samples(1);
    let before = work().launches;
    let said = message(render_derivative(&scene, &camera, &options, &many).map(drop));
    says(said, ["the sums of derivatives"]);
    assert_eq!(work().launches, before);
}

/// A derivative that is not finite is that of its pixel alone: the others see the sky.
#[test]
fn what_is_not_finite_stays_in_its_pixel() {
    let device = device();
    let body = diffuse(shapes::icosahedron(&device).scaled(0.3), [0.5; 3]);
    let scene = Scene::new().with_object(body).with_environment([40.0; 3]);
    let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]).with_fov_y(40.0);
    let tangent = Tangent::new(&scene, &camera, |scene, _| {
        scene.objects[0].materials[0] = Material::diffuse([3e38; 3]);
    });
    let options = of_room(2).with_bounces(0);
    let all = render_derivative(&scene, &camera, &options, &[tangent.expect("a tangent")]);
    let [_, by] = numbers(&all.expect("derivatives"));
    let middle = 3 * (SIZE / 2 * SIZE + SIZE / 2);
    assert!(by[middle..][..3].iter().all(|v| !v.is_finite()), "{by:?}");
    let sky: Vec<f64> = [&by[..3 * SIZE], &by[3 * SIZE * (SIZE - 1)..]].concat();
    assert!(sky.iter().all(|&v| v == 0.0), "{by:?}");
}
