//! What `{:?}` shows: sizes, names and a few numbers.

use std::fmt::Debug;

use crate::common;
use crate::common::mistakes::{ball, camera, flex, lit, row, small};
use burn::tensor::Tensor;
use softray::prelude::*;

fn leaf<const D: usize>(t: Tensor<D>) -> Tensor<D> {
    t.autodiff().require_grad()
}

fn same(value: &dyn Debug, expected: &str) {
    assert_eq!(format!("{value:?}"), expected);
}

#[test]
fn scenes_are_read_object_by_object() {
    let ball = ball()
        .with_material(Material::diffuse([0.3, 0.4, 0.5]).with_name("red"))
        .with_velocity(leaf(row([1.0, 0.0, 0.5])));
    let cube = Object::new(shapes::cube(&flex()).translated(leaf(row([0.0; 3]))))
        .with_name("box")
        .with_material(Material::phong([0.0; 3], [0.5; 3], row([9.0])));
    let scene = Scene::new()
        .with_object(ball)
        .with_object(cube)
        .with_environment([0.1; 3]);
    let ball = r#""ball": Mesh { 12 vertices, 20 faces, on flex }, Material "red" { diffuse: [0.3, 0.4, 0.5] }, velocity [1.0, 0.0, 0.5] in the graph"#;
    let cube = r#""box": Mesh { 8 vertices in the graph, 12 faces, on flex }, Material "material" { diffuse: [0.0, 0.0, 0.0], specular: [0.5, 0.5, 0.5], shininess: 9.0 }"#;
    let line = format!("Scene {{ objects: [{ball}, {cube}], environment: [0.1, 0.1, 0.1] }}");
    same(&scene, &line);
    let lines = format!(
        "Scene {{\n    objects: [\n        {ball},\n        {cube},\n    ],\n    \
         environment: [0.1, 0.1, 0.1],\n}}"
    );
    assert_eq!(format!("{scene:#?}"), lines);
    let many = (0..40).fold(Scene::new(), |s, _| s.with_object(common::mistakes::ball()));
    let shown = format!("{many:?}");
    assert!(
        shown.contains("and 8 more objects]") && shown.len() < 5000,
        "{shown}"
    );
}

#[test]
fn parts_of_scenes() {
    same(
        &camera().with_thin_lens(0.1, 4.0),
        "Camera { eye: [0.3, 0.4, 4.0], target: [0.0, 0.0, 0.0], up: [0.0, 1.0, 0.0], \
         projection: Perspective { fov_y: 40.0 }, \
         lens: Some(ThinLens { aperture_radius: 0.1, focus_distance: 4.0 }) }",
    );
    same(
        &Material::emitter([2.0; 3]).with_name("lamp"),
        r#"Material "lamp" { diffuse: [0.0, 0.0, 0.0], emission: [2.0, 2.0, 2.0] }"#,
    );
    let texels = Tensor::<3>::ones([2, 4, 3], &flex());
    same(
        &ColorTexture::texture(texels.clone()),
        "texture [2, 4, 3] on flex, Repeat",
    );
    let map = Environment::map(leaf(texels));
    same(&map, "map [2, 4, 3] on flex in the graph");
    let moved = Transform::new().with_translation(row([1.0, 2.0, 3.0]));
    same(&moved, "Transform { translation: [1.0, 2.0, 3.0] }");
    same(
        &Transform::new().with_quaternion(row([1.0, 0.0, 0.0, 0.0])),
        "Transform { rotation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] }",
    );
}

#[test]
fn images_show_no_pixels() {
    let image = HostImage::new(4, 2, vec![0.25; 24]).expect("an image");
    same(
        &image,
        "HostImage { width: 4, height: 2, pixels: 24 numbers from 0.25 to 0.25 }",
    );
    let batch = Batch::new(vec![lit(ball()); 2], vec![camera()]).expect("a batch");
    let vertices = leaf(Tensor::<3>::ones([2, 12, 3], &flex()));
    let batch = batch.with_vertices("ball", vertices).expect("vertices");
    let shown = format!("{batch:?}");
    for part in [
        "scenes: 2, views: 2",
        "[\"ball\": [2, 12, 3] on flex in the graph]",
    ] {
        assert!(shown.contains(part) && shown.len() < 400, "{shown}");
    }
    let options = small().with_opacity().with_object_ids();
    let images = render_batch(&batch, &options).expect("images");
    let shown = format!("{images:?}");
    for part in [
        "ImageBatch { radiance: [2, 4, 4, 3] on flex in the graph",
        "opacity: [2, 4, 4] on flex in the graph, object_ids: [2, 4, 4] on flex, rays: ",
    ] {
        assert!(shown.contains(part) && shown.len() < 400, "{shown}");
    }
    let shown = format!("{:?}", images.view(0));
    let start = "Image { radiance: [4, 4, 3] on flex in the graph, opacity: [4, 4] on flex";
    assert!(shown.starts_with(start) && shown.len() < 400, "{shown}");
}

#[test]
fn modules_show_their_parameters() {
    let device = flex().autodiff();
    same(
        &MeshParams::from_mesh(&shapes::icosphere(3, &device), &device).expect("a mesh"),
        "MeshParams { vertices: [642, 3] on flex in the graph }",
    );
    same(
        &RigidTransformConfig::new().init(&flex()).expect("a pose"),
        "RigidTransform { rotation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0], translation: [0.0, 0.0, 0.0] }",
    );
    same(
        &TextureParamsConfig::new(8, 16)
            .init(&device)
            .expect("a texture"),
        "TextureParams { logit_texels: [8, 16, 3] on flex in the graph }",
    );
    let camera = CameraParamsConfig::new([0.0, 0.0, 4.0], [0.0; 3]);
    let camera = camera.init(&device).expect("a camera").freeze_eye();
    let shown = format!("{camera:?}");
    let start = "CameraParams { eye: [0.0, 0.0, 4.0], aim.Target: [0.0, 0.0, 0.0] in the graph, up: \
                 [0.0, 1.0, 0.0], logit_fov: ";
    assert!(shown.starts_with(start), "{shown}");
}

/// Wrong shapes are what is looked for by printing.
#[test]
fn what_is_malformed_is_shown() {
    let mesh = Mesh::new(Tensor::zeros([3, 2], &flex()), vec![[0, 1, 9]]);
    same(&mesh, "Mesh { vertices of shape [3, 2], 1 faces, on flex }");
    let albedo: ColorTexture = row([0.5; 4]).into();
    same(&albedo, "a tensor of shape [4], not [3]");
    same(
        &Material::emitter(row([])).with_name("lamp"),
        r#"Material "lamp" { diffuse: [0.0, 0.0, 0.0], emission: a tensor of shape [0], not [3] }"#,
    );
    let image = HostImage {
        width: 9,
        height: 9,
        pixels: vec![f32::NAN; 13],
    };
    same(
        &image,
        "HostImage { width: 9, height: 9, pixels: 13 numbers, none of them finite }",
    );
    let wrong = Transform::new().with_scale(row([1.0, 2.0]));
    same(
        &wrong,
        r#"Transform { mistake: Mistake { found: "a scale of shape [2]", expected: "[1] or [3]" } }"#,
    );
}
