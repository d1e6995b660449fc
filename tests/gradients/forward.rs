//! Forward mode: the derivatives of images beside gradients by the backward pass.

use burn::tensor::DType;
use softray::prelude::*;

use crate::common::errors::{message, says};
use crate::common::facets::facet_cases;
use crate::common::gradients::{CONES, Case, SHARP, all_classes, lights};
use crate::common::numbers::{mean_and_error, norm};
use crate::common::scenes::{floor, scene_file};
use crate::common::tensors::{gradient, leaf, tensor, values};

const SIZE: usize = 12;

/// The options of a case. With a list of edges that does not adapt, both modes draw the same samples.
fn options(case: &Case, visibility: Visibility, samples: u32) -> RenderOptions {
    RenderOptions::new(SIZE, SIZE)
        .with_samples(samples)
        .with_bounces(case.bounces)
        .with_visibility(visibility)
        .with_adaptive_edges(false)
        .with_seed(3)
}

/// Signs that follow no pattern.
fn signs(count: usize) -> Vec<f64> {
    let sign = |i: usize| f64::from((i * i * 7 + i * 13) % 11 < 5) * 2.0 - 1.0;
    (0..count).map(sign).collect()
}

/// ⟨w, J·v⟩ = ⟨Jᵀ·w, v⟩ at equal seeds for every class of parameter, with w of ±1 for all channels of all pixels. Where
/// the sum cancels, the derivatives of pixels set the scale.
#[test]
fn products_agree_with_the_backward_pass() {
    let device = Device::flex();
    let every = [
        all_classes(),
        facet_cases(),
        lights::still(),
        lights::moving(),
        lights::glowing(),
        lights::crossings(),
    ];
    let mut failures = Vec::new();
    for case in every.iter().flatten() {
        for visibility in [SHARP, CONES.visibility] {
            let options = options(case, visibility, 8).with_opacity();
            let number = |v: f64| tensor(&[v], [1], &device, DType::F64);
            let build = |v: &[f64]| Ok((case.build)(&device, DType::F64, number(v[0])));
            let (scene, camera, tangents) =
                Tangent::of_numbers(&[case.value], build).expect(case.name);
            let derivative =
                render_derivative(&scene, &camera, &options, &tangents).expect(case.name);
            let image = derivative.tangents.view(0);
            let by_pixel = [values(&image.radiance), values(&image.opacity.expect("it"))].concat();
            let w = signs(by_pixel.len());
            let forward: f64 = by_pixel.iter().zip(&w).map(|(by, w)| by * w).sum();

            let p = number(case.value).autodiff().require_grad();
            let (scene, camera) = (case.build)(&device, DType::F64, p.clone());
            let image = render(&scene, &camera, &options).expect(case.name);
            let plain = derivative.image.radiance.clone();
            let apart = values(&(image.radiance.clone().inner() - plain).abs().max())[0];
            assert!(apart < 1e-5, "{}: images differ by {apart}", case.name);
            let count = 3 * SIZE * SIZE;
            let of_color = tensor(&w[..count], [SIZE, SIZE, 3], &device, DType::F64);
            let of_opacity = tensor(&w[count..], [SIZE, SIZE], &device, DType::F64);
            let loss =
                (image.radiance * of_color).sum() + (image.opacity.expect("it") * of_opacity).sum();
            let backward = gradient(&p, &loss.backward())[0];

            let scale = by_pixel.iter().map(|v| v * v).sum::<f64>().sqrt().max(1e-6);
            let apart = (forward - backward).abs() / scale;
            println!(
                "{}: {forward:.6} {backward:.6}, apart {apart:.1e}",
                case.name
            );
            if apart.is_nan() || apart > 2e-6 {
                failures.push((case.name, visibility, forward, backward, apart));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// A ball over a floor, which moves and grows, before a camera that turns: two directions.
fn ball(device: &Device) -> (Scene, Camera, Vec<Tangent>) {
    let build = |v: &[f64]| {
        let ball = shapes::icosphere(1, device).scaled(0.5 + v[1]);
        let floor = floor(2.0, -0.6, device);
        let scene = Scene::new()
            .with_object(Object::new(ball.translated([v[0], 0.0, 0.0])).with_name("ball"))
            .with_object(Object::new(floor))
            .with_environment([1.0, 0.9, 0.8]);
        let eye = [0.3 * v[0], 0.7, 3.0 + v[1]];
        Ok((scene, Camera::look_at(eye, [0.0; 3])))
    };
    Tangent::of_numbers(&[0.1, 0.0], build).expect("tangents")
}

fn all_outputs() -> RenderOptions {
    RenderOptions::new(SIZE, SIZE)
        .with_samples(64)
        .with_bounces(1)
        .with_opacity()
        .with_depth()
        .with_normals()
}

/// Derivatives of depth, normals and opacity, and numbers of edges that adapt: the same means as those of backward passes.
#[test]
fn derivatives_of_all_outputs_are_unbiased() {
    let device = Device::flex();
    let column = |i: usize| (i % SIZE) as f64 / SIZE as f64;
    let weights: Vec<f64> = (0..8 * SIZE * SIZE)
        .map(|i| 0.5 + 2.0 * column(i))
        .collect();
    let weight = |k: usize| {
        tensor::<1>(
            &weights[k * SIZE * SIZE..][..SIZE * SIZE],
            [SIZE * SIZE],
            &device,
            DType::F32,
        )
    };
    let scalar = |image: &Image| -> Tensor<1> {
        let planes = |t: Tensor<3>| t.reshape([SIZE * SIZE, 3]);
        let colors = planes(image.radiance.clone());
        let normals = planes(image.normals.clone().expect("it"));
        let single = |t: &Option<Tensor<2>>| t.clone().expect("it").reshape([SIZE * SIZE, 1]);
        let all = [
            colors,
            single(&image.opacity),
            single(&image.depth),
            normals,
        ];
        let all = Tensor::cat(all.to_vec(), 1);
        (0..8)
            .map(|k| (all.clone().narrow(1, k, 1).reshape([SIZE * SIZE]) * weight(k)).sum())
            .reduce(|a, b| a + b)
            .expect("eight")
    };
    let (scene, camera, tangents) = ball(&device);
    let value = |t: Tensor<1>| values(&t.inner())[0];
    let mut apart = [Vec::new(), Vec::new()];
    let mut sizes = [0.0; 2];
    for seed in 0..40 {
        let options = all_outputs().with_samples(256).with_seed(seed);
        let derivative =
            render_derivative(&scene, &camera, &options, &tangents).expect("derivatives");
        let x = leaf(&[0.1], &device);
        let grow = leaf(&[0.5], &device);
        let zero = Tensor::zeros([2], &device);
        let moved = shapes::icosphere(1, &device)
            .scaled(grow.clone())
            .translated(Tensor::cat(vec![x.clone(), zero], 0));
        let scene = scene
            .clone()
            .map_object("ball", |o| o.map_mesh(|_| moved.clone()));
        let up = Tensor::from_floats([0.7], &device);
        let eye = Tensor::cat(vec![x.clone() * 0.3, up, grow.clone() + 2.5], 0);
        let scene = scene.expect("the ball");
        let image = render(
            &scene,
            &Camera::look_at(eye, [0.0; 3]),
            &options.with_seed(1000 + seed),
        )
        .expect("an image");
        let gradients = scalar(&image).backward();
        for (k, p) in [&x, &grow].into_iter().enumerate() {
            let backward = gradient(p, &gradients)[0];
            apart[k].push(value(scalar(&derivative.tangents.view(k))) - backward);
            sizes[k] += backward / 40.0;
        }
    }
    for (apart, size) in apart.iter().zip(sizes) {
        let (mean, error) = mean_and_error(apart);
        println!("{size}: apart by {mean} ± {error}");
        assert!(
            error < 0.05 * size.abs() && mean.abs() < 4.0 * error,
            "{mean} ± {error} of {size}"
        );
    }
}

/// Several directions in which the same values change have the same bits at once as alone, and a direction in which nothing
/// changes has a derivative of 0.
#[test]
fn directions_do_not_influence_each_other() {
    let device = Device::flex();
    let (scene, camera, mut tangents) = ball(&device);
    tangents.push(Tangent::new(&scene, &camera, |_, _| {}).expect("a tangent"));
    let options = all_outputs().with_samples(8).with_adaptive_edges(false);
    let of = |tangents: &[Tangent]| {
        let all = render_derivative(&scene, &camera, &options, tangents).expect("derivatives");
        all.tangents
    };
    let together = of(&tangents);
    let depth = |images: &ImageBatch, k| values(&images.view(k).depth.expect("it"));
    for (k, tangent) in tangents.iter().take(2).enumerate() {
        let alone = of(std::slice::from_ref(tangent));
        assert!(values(&alone.view(0).radiance) == values(&together.view(k).radiance));
        assert!(depth(&alone, 0) == depth(&together, k));
    }
    assert!(values(&together.view(2).radiance).iter().all(|&v| v == 0.0));
    let still = of(&tangents[2..]);
    assert!(values(&still.radiance).iter().all(|&v| v == 0.0));
}

#[test]
fn errors_name_what_is_wrong() {
    let device = Device::flex();
    let (scene, camera, tangents) = ball(&device);
    let of = |options: RenderOptions, tangents: &[Tangent]| {
        message(render_derivative(&scene, &camera, &options, tangents).map(drop))
    };
    let options = RenderOptions::new(4, 4).with_samples(1);
    says(of(options.clone(), &[]), ["tangents", "at least one"]);
    says(
        of(options.clone().with_engine(Engine::Tensors), &tangents),
        ["engine", "Kernels"],
    );
    let softmax = options.with_visibility(Visibility::softmax(1e-3, 1e-3));
    says(of(softmax, &tangents), ["visibility", "Cone"]);
    let set = |value: f32, rows: usize| {
        message(
            Tangent::new(&scene, &camera, |scene, _| {
                scene.objects[0].mesh.vertices = Tensor::full([rows, 3], value, &device);
            })
            .map(drop),
        )
    };
    says(set(1.0, 5), ["vertices", "15", "126"]);
    says(set(f32::NAN, 42), ["vertices", "finite"]);
    let grows = Tangent::of_numbers(&[1.0], |v| {
        let scene = Scene::new().with_object(Object::new(shapes::icosphere(v[0] as u32, &device)));
        Ok((scene, camera.clone()))
    });
    says(message(grows.map(drop)), ["vertices", "as in the scene"]);
}

/// Balls at several distances on a plain floor or a checkerboard, through a lens, by its radius and its focus distance.
fn lens(board: bool, device: &Device) -> (Scene, Camera, Vec<Tangent>) {
    let texels: Vec<f64> = (0..40 * 40)
        .flat_map(|i| {
            [if board && (i % 40 + i / 40) % 2 == 0 {
                0.7
            } else {
                0.15
            }; 3]
        })
        .collect();
    let texels = ColorTexture::texture(tensor(&texels, [40, 40, 3], device, DType::F32));
    let floor = shapes::plane_grid(9.0, 9.0, 1, 1, device).translated([0.0, 0.0, -1.5]);
    let mut scene = Scene::new()
        .with_object(Object::new(floor).with_material(Material::diffuse(texels)))
        .with_environment([0.8, 0.85, 0.9]);
    for i in 0..4 {
        let i = f64::from(i);
        let place = [0.55 * i - 0.75, 0.35, 1.6 - 1.5 * i];
        let ball = shapes::icosphere(2, device).scaled(0.35).translated(place);
        let color = [0.8 - 0.2 * i, 0.3, 0.2 + 0.2 * i];
        scene = scene.with_object(Object::new(ball).with_material(Material::diffuse(color)));
    }
    let build = |v: &[f64]| {
        let camera = Camera::look_at([0.0, 0.9, 5.0], [0.0, 0.35, 0.0]).with_fov_y(32.0);
        Ok((scene.clone(), camera.with_thin_lens(v[0], v[1])))
    };
    Tangent::of_numbers(&[0.2, 4.0], build).expect("tangents")
}

/// The noise of means over blocks of 8 × 8 pixels, relative to the derivatives: 64 × 64 pixels and 512 samples in the long
/// tier, a quarter of the pixels and an eighth of the samples in the short one.
#[test]
fn derivatives_by_a_lens_have_little_noise() {
    let (size, samples, limits) = match crate::common::long() {
        true => (64, 512, [0.1, 0.2]),
        false => (32, 64, [0.6, 1.2]),
    };
    let options = RenderOptions::new(size, size)
        .with_samples(samples)
        .with_bounces(0);
    let blocks = size / 8;
    let device = Device::flex();
    let file = scene_file("lens", &device);
    let of_file = |v: &[f64]| {
        let camera = file.camera.clone().with_thin_lens(v[0], v[1]);
        Ok((file.scene.clone(), camera))
    };
    let of_file = Tangent::of_numbers(&[0.2, 5.573], of_file).expect("tangents");
    let [plain, board] = [false, true].map(|board| lens(board, &device));
    let scenes = [
        ("a plain floor", plain, limits[0]),
        ("the reference", of_file, limits[0]),
        ("a checkerboard", board, limits[1]),
    ];
    for (name, (scene, camera, tangents), limit) in scenes {
        let of_seed = |seed: u64| {
            let options = options.clone().with_seed(seed);
            let all = render_derivative(&scene, &camera, &options, &tangents).expect("derivatives");
            [0, 1].map(|k| {
                let rows = all.tangents.view(k).radiance;
                let rows = rows.reshape([blocks, 8, blocks, 24]).sum_dim(1);
                let columns = rows.reshape([blocks * blocks, 8, 3]).sum_dim(1);
                values(&(columns / 64.0))
            })
        };
        let (a, b) = (of_seed(1), of_seed(2));
        for (k, (a, b)) in a.iter().zip(&b).enumerate() {
            let means: Vec<f64> = a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect();
            let halves: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
            let error = norm(&halves) / 2f64.sqrt() / norm(&means);
            println!("{name}, direction {k}: relative error {error:.4}");
            assert!(error < limit, "{name}, direction {k}: {error}");
        }
    }
}

/// How many corners of a flat face share a tangent depends on the rounding of its vertices, and so on the angle.
#[test]
fn tangents_of_turning_cubes_have_derivatives() {
    let device = Device::flex();
    let texels = Tensor::<1>::from_floats([0.3, -0.2, 0.9], &device).reshape([1, 1, 3]);
    let material = Material::diffuse([0.7; 3]).with_normal_map(texels, 1.0);
    let camera = Camera::look_at([0.0, 1.0, 4.0], [0.0; 3]).with_fov_y(40.0);
    let scene = |angle: Tensor<1>| {
        let turn = Transform::new().with_axis_angle([0.0, 1.0, 0.0], angle);
        let cube = shapes::cube(&device);
        let uvs = cube.vertices.clone().narrow(1, 0, 2) + cube.vertices.clone().narrow(1, 2, 1);
        let cube = cube.with_uvs(uvs).transformed(&turn);
        Scene::new()
            .with_object(Object::new(cube).with_material(material.clone()))
            .with_light(Light::directional([-0.3, -0.5, -1.0], [1.0; 3]))
    };
    for degrees in [3.0, 11.0, 25.0, 33.0, 41.0, 56.0, 67.0, 78.0] {
        let build = |v: &[f64]| {
            let angle = Tensor::from_floats([v[0] as f32], &device);
            Ok((scene(angle), camera.clone()))
        };
        let (at, camera, tangents) = Tangent::of_numbers(&[degrees], build).expect("tangents");
        let options = RenderOptions::new(SIZE, SIZE)
            .with_samples(64)
            .with_bounces(0);
        let options = options.with_adaptive_edges(false);
        let derivative = render_derivative(&at, &camera, &options, &tangents).expect("derivatives");
        let forward: f64 = values(&derivative.tangents.radiance).iter().sum();
        let angle = leaf(&[degrees as f32], &device);
        let image = render(&scene(angle.clone()), &camera, &options).expect("an image");
        let backward = gradient(&angle, &image.radiance.sum().backward())[0];
        println!("{degrees}: {forward} and {backward}");
        assert!(
            (forward - backward).abs() < 0.02 * backward.abs() + 1e-3,
            "{degrees}"
        );
    }
}
