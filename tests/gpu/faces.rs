//! Scenes of few and of many faces on a GPU and on the host.

use burn::tensor::{DType, Device};
use softray::prelude::*;

use crate::common::numbers::apart;
use crate::common::scenes::{diffuse, facing_front, floor, lamp, scene_file};
use crate::common::tensors::{gradient, tensor, values, with_leaves};
use crate::device::{Flips, device};

/// A scene of so many faces; over 32 those of a ball over a floor and under a lamp.
fn of_faces(faces: usize, device: &Device) -> (Scene, Camera) {
    let camera = Camera::look_at([0.3, 1.4, 4.0], [0.0, 0.3, 0.0]);
    let sky = [0.2, 0.3, 0.4];
    if faces == 2 {
        let square = facing_front([-0.5, 0.7], [-0.4, 0.8], 0.0, device);
        let scene = Scene::new().with_object(diffuse(square, [0.3, 0.5, 0.6]));
        return (scene.with_environment(sky), camera);
    }
    if faces == 32 {
        let file = scene_file("cornell", device);
        return (file.scene, file.camera);
    }
    let subdivisions = (faces / 20).ilog2() / 2;
    let ball = shapes::icosphere(subdivisions, device).scaled([0.6; 3]);
    assert_eq!(ball.faces.len(), faces);
    let scene = Scene::new()
        .with_object(diffuse(floor(2.0, 0.0, device), [0.5, 0.4, 0.3]))
        .with_object(lamp(0.5, 2.4, [5.0, 4.0, 3.0], device))
        .with_object(diffuse(ball.translated([0.1, 0.8, 0.1]), [0.3, 0.5, 0.6]))
        .with_environment(sky);
    (scene, camera)
}

/// Images and derivatives by vertices and by places of objects. At some seeds rounding decides what edge is drawn.
#[test]
fn scenes_of_few_and_of_many_faces() {
    const SIZE: usize = 16;
    const SAMPLES: u32 = 8;
    let at = |faces: usize, seed: u64, device: &Device| {
        let (scene, camera) = of_faces(faces, device);
        let scene = with_leaves(scene);
        let options = RenderOptions::new(SIZE, SIZE).with_samples(SAMPLES);
        let options = options.with_bounces(1).with_seed(seed);
        let image = render(&scene, &camera, &options).expect("an image");
        let weights: Vec<f64> = (0..3 * SIZE * SIZE)
            .map(|i| 0.6 + (0.37 * i as f64).sin())
            .collect();
        let weights = tensor(&weights, [SIZE, SIZE, 3], device, DType::F32);
        let gradients = (image.radiance.clone() * weights).sum().backward();
        let of_object = |o: &Object| gradient(&o.mesh.vertices, &gradients);
        let by_vertices: Vec<Vec<f64>> = scene.objects.iter().map(of_object).collect();
        let by_place = |g: &Vec<f64>| -> Vec<f64> {
            let along = |axis: usize| g.iter().skip(axis).step_by(3).sum();
            (0..3).map(along).collect()
        };
        let by_places: Vec<f64> = by_vertices.iter().flat_map(by_place).collect();
        (values(&image.radiance), by_places, by_vertices.concat())
    };
    for faces in [2, 32, 320, 1280, 20_480] {
        let mut agreeing = [5, 6, 7].into_iter().filter(|&seed| {
            let [found, wanted] = [device(), Device::flex()].map(|on| at(faces, seed, &on));
            let flips = Flips::of(&found.0, &wanted.0);
            let (places, vertices) = (apart(&found.1, &wanted.1), apart(&found.2, &wanted.2));
            println!("{faces} faces: {flips:?}, derivatives by {places:e} and {vertices:e}");
            flips.assert_at_most(1, SAMPLES);
            let most = places.max(vertices);
            assert!(most < 0.05, "{faces}: {most}");
            most < 5e-4
        });
        // The long tier prints all seeds.
        let agrees = match crate::common::long() {
            true => agreeing.count() > 0,
            false => agreeing.next().is_some(),
        };
        assert!(agrees, "{faces}");
    }
}
