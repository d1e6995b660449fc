//! Images and gradients of a server are those of its device, to the bit.

use std::sync::LazyLock;

use burn::tensor::{DType, Gradients, TensorData};
use softray::burn;
use softray::prelude::*;

use crate::common::facets::facet_cases;
use crate::common::gradients::{Case, cases, lights};
use crate::server::Server;

static SERVER: LazyLock<Server> = LazyLock::new(Server::start);

fn both() -> [Device; 2] {
    [Device::flex(), SERVER.device()]
}

fn data<const D: usize>(tensor: &Tensor<D>) -> TensorData {
    tensor.clone().inner().into_data()
}

fn gradient<const D: usize>(tensor: &Tensor<D>, gradients: &Gradients) -> TensorData {
    tensor.grad(gradients).expect("a gradient").into_data()
}

fn lights() -> impl Iterator<Item = Case> {
    let all = [
        lights::still(),
        lights::moving(),
        lights::glowing(),
        lights::crossings(),
    ];
    all.into_iter().flatten()
}

fn options() -> RenderOptions {
    RenderOptions::new(10, 8).with_samples(8).with_seed(5)
}

/// The sum of the squares of all outputs that have gradients.
fn loss(image: &Image) -> Tensor<1> {
    let mut loss = image.radiance.clone().powf_scalar(2.0).sum();
    if let Some(depth) = &image.depth {
        loss = loss + depth.clone().powf_scalar(2.0).sum();
    }
    if let Some(normals) = &image.normals {
        loss = loss + (normals.clone() * 0.3 + 0.1).powf_scalar(2.0).sum();
    }
    if let Some(opacity) = &image.opacity {
        loss = loss + opacity.clone().powf_scalar(2.0).sum();
    }
    loss
}

fn of_case(case: &Case, dtype: DType, options: &RenderOptions, device: &Device) -> [TensorData; 3] {
    let value = Tensor::<1>::from_data(TensorData::from([case.value]), (device, dtype));
    let value = value.autodiff().require_grad();
    let (scene, camera) = (case.build)(device, dtype, value.clone());
    let options = options.clone().with_bounces(case.bounces);
    let image = render(&scene, &camera, &options).expect(case.name);
    let loss = loss(&image);
    let gradients = loss.backward();
    [
        data(&image.radiance),
        data(&loss),
        gradient(&value, &gradients),
    ]
}

#[test]
fn every_class_of_parameter() {
    let all: Vec<Case> = cases()
        .into_iter()
        .chain(facet_cases())
        .chain(lights())
        .collect();
    assert!(all.len() > 40, "{} cases", all.len());
    for (i, case) in all.iter().enumerate() {
        let options = match i % 3 {
            0 => options().with_depth().with_normals(),
            1 => options().with_opacity().with_object_ids(),
            _ => options(),
        };
        let dtype = if i % 4 == 3 { DType::F64 } else { DType::F32 };
        let [own, remote] = both().map(|device| of_case(case, dtype, &options, &device));
        assert_eq!(own, remote, "{}", case.name);
    }
}

#[test]
fn the_softmax_and_the_tensor_program() {
    let forms = [
        options().with_visibility(Visibility::softmax(0.05, 0.05)),
        options().with_engine(Engine::Tensors),
    ];
    let cases = cases();
    for options in forms {
        let [own, remote] = both().map(|device| of_case(&cases[0], DType::F32, &options, &device));
        assert_eq!(own, remote);
    }
}

#[test]
fn batches_by_vertices_and_pixels() {
    let results = both().map(|device| {
        let ball = shapes::icosphere(1, &device);
        let tensor = |values: &[f32]| Tensor::<1>::from_floats(values, &device);
        let widths = tensor(&[0.8, 1.0, 1.2]).autodiff().require_grad();
        let color = tensor(&[0.3, 0.5, 0.7]).autodiff().require_grad();
        let object = Object::new(ball.clone()).with_material(Material::diffuse(color.clone()));
        let scene = Scene::new()
            .with_object(object.with_name("body"))
            .with_object(Object::new(shapes::plane_grid(4.0, 4.0, 2, 2, &device)))
            .with_environment([1.0, 1.0, 1.0]);
        let camera = Camera::look_at([0.0, 1.0, 4.0], [0.0, 0.0, 0.0]);
        let cache = HierarchyCache::new();
        let mut all = Vec::new();
        for seed in 0..2 {
            let vertices = Tensor::stack::<3>(vec![ball.vertices.clone(); 3], 0);
            let vertices = vertices * widths.clone().reshape([3, 1, 1]);
            let batch = Batch::new(vec![scene.clone(); 3], vec![camera.clone()]);
            let batch = batch.expect("a batch");
            let batch = batch.with_vertices("body", vertices).expect("the object");
            let options = options().with_seed(seed).with_cache(&cache);
            let images = render_batch(&batch, &options.with_statistics()).expect("images");
            let loss = images.radiance.clone().powf_scalar(2.0).mean();
            let gradients = loss.backward();
            all.push(data(&images.radiance));
            all.extend([&widths, &color].map(|p| gradient(p, &gradients)));
            assert!(images.statistics.iter().all(|s| s.rays > 0));
        }
        let image = render_pixels(&scene, &camera, &options().with_albedo(), &[7, 3, 7]);
        let image = image.expect("pixels");
        all.extend([data(&image.radiance), data(&image.albedo.expect("it"))]);
        all
    });
    assert_eq!(results[0], results[1]);
}

/// An object without faces has no weight, and no number of its own.
#[test]
fn object_ids() {
    let [own, remote] = both().map(|device| {
        let (room, camera) = cornell_box(&device);
        let empty = Object::new(Mesh::from_host(&[], Vec::new(), &device));
        let options = options().with_object_ids().with_bounces(1);
        let image = render(&room.with_object(empty), &camera, &options).expect("an image");
        let ids = image.object_ids.expect("it").into_data();
        ids.iter::<i64>().collect::<Vec<_>>()
    });
    assert_eq!(own, remote);
}
