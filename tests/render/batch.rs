//! Batches: what they return is what their views return one by one, with the same gradients.

use crate::common::cached::steps_are_those_without_a_cache;
use crate::common::errors::{message, says};
use crate::common::mistakes;
use crate::common::numbers::{apart, norm};
use crate::common::scenes::{facing_down, floor, on_axis, under_sky};
use crate::common::tensors::{gradient, tensor, values};
use burn::tensor::{DType, Device, Tensor};
use softray::prelude::*;

fn leaf<const D: usize>(values: &[f64], shape: [usize; D], device: &Device) -> Tensor<D> {
    tensor(values, shape, device, DType::F64)
        .autodiff()
        .require_grad()
}

fn ground(device: &Device) -> Object {
    Object::new(floor(3.0, -1.2, device).cast(DType::F64)).with_name("floor")
}

fn lamp(device: &Device, radiance: impl Into<Parameter<3>>) -> Object {
    let quad = facing_down([-1.0, 1.0], [-1.0, 1.0], 3.0, device).cast(DType::F64);
    Object::new(quad)
        .with_name("lamp")
        .with_material(Material::emitter(radiance))
}

/// Leaves, scenes and cameras that differ in everything: meshes, materials, lights, lens.
struct World {
    offset: Tensor<1>,
    texels: Tensor<3>,
    radiance: Tensor<1>,
    eye: Tensor<1>,
    scenes: Vec<Scene>,
    cameras: Vec<Camera>,
}

fn world(device: &Device) -> World {
    let offset = leaf(&[0.1, 0.0, 0.2], [3], device);
    let texels: Vec<f64> = (0..27).map(|i| 0.2 + 0.02 * f64::from(i)).collect();
    let texels = leaf(&texels, [3, 3, 3], device);
    let radiance = leaf(&[7.0, 8.0, 9.0], [3], device);
    let eye = leaf(&[1.0, 1.5, 4.0], [3], device);
    let ball = |n| shapes::icosphere(n, device).cast(DType::F64);
    let moved = Object::new(ball(2).translated(offset.clone())).with_name("ball");
    let vertices = ball(1).host_vertices().expect("vertices");
    let uvs: Vec<f64> = vertices.iter().flat_map(|v| [v[0], v[1]]).collect();
    let uvs = tensor(&uvs, [vertices.len(), 2], device, DType::F64);
    let smooth = ball(1);
    let smooth = smooth.clone().with_normals(smooth.vertices);
    let painted = Material::diffuse(ColorTexture::texture(texels.clone()));
    let scenes = vec![
        Scene::new()
            .with_object(moved)
            .with_object(ground(device))
            .with_object(lamp(device, radiance.clone())),
        Scene::new()
            .with_object(Object::new(smooth.with_uvs(uvs)).with_material(painted))
            .with_environment([0.5, 0.6, 0.7]),
        Scene::new()
            .with_object(Object::new(
                ball(0)
                    .translated(offset.clone())
                    .scaled(offset.clone() + 0.6),
            ))
            .with_object(lamp(device, [5.0; 3])),
    ];
    let cameras = vec![
        Camera::look_at(eye.clone(), [0.0; 3]).with_fov_y(40.0),
        Camera::look_at([-2.0, 0.5, 3.0], [0.0; 3])
            .with_fov_y(50.0)
            .with_thin_lens(0.1, 3.5),
        Camera::look_at(eye.clone(), [0.1, 0.0, 0.0]).with_fov_y(35.0),
    ];
    World {
        offset,
        texels,
        radiance,
        eye,
        scenes,
        cameras,
    }
}

impl World {
    fn gradients(&self, loss: Tensor<1>) -> Vec<Vec<f64>> {
        let gradients = loss.backward();
        let texels = gradient(&self.texels, &gradients);
        let [offset, radiance, eye] =
            [&self.offset, &self.radiance, &self.eye].map(|leaf| gradient(leaf, &gradients));
        vec![offset, texels, radiance, eye]
    }
}

fn options() -> RenderOptions {
    RenderOptions::new(12, 10)
        .with_samples(4)
        .with_bounces(1)
        .with_seed(5)
}

/// A loss that looks at everything, with another weight for every pixel.
fn loss_of(image: &Image) -> Tensor<1> {
    let weights = |n: usize| {
        let weight = |i: usize| 0.5 + ((i * 37) % 11) as f64 / 11.0;
        let w: Vec<f64> = (0..n).map(weight).collect();
        tensor(&w, [n], &image.radiance.device().inner(), DType::F64)
    };
    let weighed = |t: Tensor<1>| {
        let n = t.dims()[0];
        (t.clone() * t * weights(n)).sum()
    };
    let mut sum = weighed(image.radiance.clone().flatten(0, 2));
    for plane in [&image.opacity, &image.depth].into_iter().flatten() {
        sum = sum + weighed(plane.clone().flatten(0, 1));
    }
    if let Some(normals) = &image.normals {
        sum = sum + weighed(normals.clone().flatten(0, 2));
    }
    sum
}

fn assert_close(what: &str, a: &[f64], b: &[f64], bound: f64) {
    assert_eq!(a.len(), b.len(), "{what}");
    assert!(norm(b) > 0.0, "{what}: nothing to compare");
    let apart = apart(a, b);
    assert!(apart <= bound, "{what}: {apart:e} apart");
}

fn batch_and_views(options: &RenderOptions, device: &Device, bound: f64) {
    // A graph goes back once.
    let (together, alone) = (world(device), world(device));
    let batch = Batch::new(together.scenes.clone(), together.cameras.clone()).expect("a batch");
    let images = render_batch(&batch, options).expect("images");
    assert_eq!(images.radiance.dims(), [3, 10, 12, 3]);
    let (mut losses, mut losses_alone) = (Vec::new(), Vec::new());
    for (i, (scene, camera)) in alone.scenes.iter().zip(&alone.cameras).enumerate() {
        let image = render(scene, camera, &options.of_view(i)).expect("an image");
        let view = images.view(i);
        let of = |image: &Image| {
            let mut all = values(&image.radiance);
            all.extend(values(image.opacity.as_ref().expect("opacity")));
            all.extend(values(image.depth.as_ref().expect("depth")));
            all.extend(values(image.normals.as_ref().expect("normals")));
            all
        };
        assert_close(&format!("view {i}"), &of(&view), &of(&image), bound);
        let ids = |image: &Image| {
            let ids = image.object_ids.clone().expect("ids").into_data();
            ids.iter::<i64>().collect::<Vec<_>>()
        };
        assert_eq!(ids(&view), ids(&image), "view {i}");
        assert_eq!(view.statistics.rays, image.statistics.rays, "view {i}");
        losses.push(loss_of(&view));
        losses_alone.push(loss_of(&image));
    }
    let total = |list: Vec<Tensor<1>>| Tensor::cat(list, 0).sum();
    let together = together.gradients(total(losses));
    let alone = alone.gradients(total(losses_alone));
    let names = ["offset", "texels", "radiance", "eye"];
    for ((name, a), b) in names.iter().zip(&together).zip(&alone) {
        assert_close(&format!("gradient of {name}"), a, b, bound);
    }
}

fn everything() -> RenderOptions {
    options()
        .with_opacity()
        .with_depth()
        .with_normals()
        .with_object_ids()
}

#[test]
fn a_batch_is_its_views_one_by_one() {
    batch_and_views(&everything(), &Device::flex(), 1e-12);
}

#[test]
fn in_tensors_too() {
    let device = Device::flex();
    let softmax = Visibility::softmax(1e-2, 1e-2);
    batch_and_views(&everything().with_visibility(softmax), &device, 1e-12);
}

#[cfg(feature = "ndarray")]
#[test]
#[allow(deprecated)]
fn on_ndarray_too() {
    batch_and_views(&everything(), &Device::ndarray(), 1e-12);
}

/// A template with vertices of its own in every scene, seen by two cameras each, in one batch or one
/// by one: images, and gradients of what scales and colors the templates.
fn deformed(options: &RenderOptions, together: bool) -> [Vec<f64>; 3] {
    let device = Device::flex();
    let ball = shapes::icosphere(2, &device).cast(DType::F64);
    let count = ball.vertices.dims()[0];
    let scales = [0.8, 1.0, 1.1, 1.1, 0.7, 0.9, 0.9, 1.2, 0.6];
    let scales = leaf(&scales, [3, 1, 3], &device);
    let albedos = [0.7, 0.4, 0.2, 0.3, 0.5, 0.6, 0.6, 0.6, 0.6];
    let albedos = leaf(&albedos, [3, 3], &device);
    let vertices = ball.vertices.clone().unsqueeze::<3>() * scales.clone();
    let scene = |i: usize, mesh: Mesh| {
        let albedo = albedos.clone().slice([i..i + 1]).reshape([3]);
        Scene::new()
            .with_object(ground(&device))
            .with_object(
                Object::new(mesh)
                    .with_name("body")
                    .with_material(Material::diffuse(albedo)),
            )
            .with_object(lamp(&device, [6.0; 3]))
    };
    let cameras = [
        Camera::look_at([0.0, 1.0, 4.0], [0.0; 3]).with_fov_y(40.0),
        Camera::look_at([3.0, 1.0, 1.0], [0.0; 3]).with_fov_y(50.0),
    ];
    let mut images = Vec::new();
    if together {
        let templates = (0..3).map(|i| scene(i, ball.clone())).collect();
        let batch = Batch::product(templates, &cameras).expect("a batch");
        assert_eq!(batch.len(), 6);
        let batch = batch.with_vertices("body", vertices).expect("vertices");
        let rendered = render_batch(&batch, options).expect("images");
        images.extend((0..6).map(|i| rendered.view(i)));
    } else {
        for i in 0..3 {
            let rows = vertices.clone().slice([i..i + 1]).reshape([count, 3]);
            let scene = scene(i, ball.clone().with_vertices(rows));
            for (j, camera) in cameras.iter().enumerate() {
                let options = options.of_view(2 * i + j);
                images.push(render(&scene, camera, &options).expect("an image"));
            }
        }
    }
    let losses = images.iter().map(loss_of).collect();
    let gradients = Tensor::cat(losses, 0).sum().backward();
    [
        images.iter().flat_map(|i| values(&i.radiance)).collect(),
        gradient(&scales, &gradients),
        gradient(&albedos, &gradients),
    ]
}

#[test]
fn a_deformed_template() {
    let forms = [Visibility::default(), Visibility::softmax(1e-2, 1e-2)];
    for form in forms {
        let options = options().with_visibility(form);
        let (together, alone) = (deformed(&options, true), deformed(&options, false));
        let names = ["images", "scales", "albedos"];
        // Boxes are fitted in one and built in the other: triangles are met in another order.
        for ((name, a), b) in names.iter().zip(&together).zip(&alone) {
            assert_close(name, a, b, 1e-5);
        }
    }
}

/// What is made of a scene is made once for all of its views.
#[test]
fn views_of_a_scene_share_its_hierarchy() {
    let device = Device::flex();
    let scene = under_sky(shapes::icosphere(3, &device));
    let view = |i: usize| {
        let angle = i as f64;
        let eye = [4.0 * angle.sin(), 0.5, 4.0 * angle.cos()];
        Camera::look_at(eye, [0.0; 3]).with_fov_y(40.0)
    };
    let cameras = (0..7).map(view).collect();
    let cache = HierarchyCache::default();
    let batch = Batch::new(vec![scene], cameras).expect("a batch");
    let options = RenderOptions::new(8, 8).with_samples(1).with_cache(&cache);
    let images = render_batch(&batch, &options).expect("images");
    assert_eq!(images.len(), 7);
    assert_eq!(cache.counts(), [1, 0]);
}

#[test]
fn bodies_move_and_shrink_back() {
    steps_are_those_without_a_cache(&Device::flex());
}

/// What does not change the images has a gradient of 0.
#[test]
fn out_of_sight_is_a_gradient_of_zero() {
    let device = Device::flex();
    let offset = Tensor::<1>::zeros([3], &device).autodiff().require_grad();
    let ball = shapes::icosphere(1, &device).translated(offset.clone());
    let scene = under_sky(ball);
    let camera = Camera::look_at([0.0, 0.0, 9.0], [0.0, 0.0, 18.0]);
    let batch = Batch::new(vec![scene; 2], vec![camera]).expect("a batch");
    let options = RenderOptions::new(4, 4).with_samples(1).with_bounces(0);
    let images = render_batch(&batch, &options).expect("images");
    let gradients = images.radiance.sum().backward();
    assert_eq!(gradient(&offset, &gradients), [0.0; 3]);
}

#[test]
fn what_is_wrong_is_named() {
    let device = Device::flex();
    let ball = shapes::icosphere(0, &device);
    let scene = Scene::new()
        .with_object(Object::new(ball.clone()).with_name("ball"))
        .with_environment([1.0; 3]);
    let camera = on_axis(4.0);
    let batch = Batch::new(vec![scene.clone(); 2], vec![camera.clone(); 3]);
    assert!(message(batch).contains("3 for 2 scenes"));
    assert!(message(Batch::new(Vec::new(), Vec::new())).contains("views is empty"));
    let batch = Batch::views(vec![scene.clone()], vec![(1, camera.clone())]);
    assert!(message(batch).contains("scene of a view is 1"));
    let batch = || Batch::new(vec![scene.clone(); 2], vec![camera.clone()]).expect("a batch");
    let vertices = Tensor::zeros([3, 12, 3], &device);
    let said = message(batch().with_vertices("ball", vertices));
    assert!(said.contains("[2, 12, 3]"), "{said}");
    let vertices = Tensor::zeros([2, 12, 3], &device);
    let said = message(batch().with_vertices("cube", vertices));
    says(said, ["scene 0", "cube"]);

    let options = RenderOptions::new(4, 4);
    let broken = ball.vertices.clone() * f64::NAN;
    let vertices = Tensor::stack::<3>(vec![ball.vertices.clone(), broken], 0);
    let batch = batch().with_vertices("ball", vertices).expect("a batch");
    let said = message(render_batch(&batch, &options));
    assert!(said.contains("scene 1 of the batch: ball"), "{said}");
    let behind = Camera::look_at([0.0; 3], [0.0; 3]);
    let batch = Batch::new(vec![scene], vec![camera, behind]).expect("a batch");
    let said = message(render_batch(&batch, &options));
    assert!(said.contains("view 1 of the batch"), "{said}");
}

#[test]
fn mistakes_are_errors() {
    let mut errors = mistakes::Mistakes::default();
    let scenes = || vec![mistakes::lit(mistakes::ball()); 2];
    let batch = || Batch::new(scenes(), vec![mistakes::camera()]);
    errors.expect("cameras and scenes", &["3", "2 scenes"], || {
        Batch::new(scenes(), vec![mistakes::camera(); 3])
    });
    errors.expect("no scenes", &["batch", "empty", "scene", "camera"], || {
        Batch::new(Vec::new(), vec![mistakes::camera()])
    });
    errors.expect("no cameras", &["batch", "empty", "camera"], || {
        Batch::product(scenes(), &[])
    });
    errors.expect(
        "a scene that is not there",
        &["scene", "2", "under 2"],
        || Batch::views(scenes(), vec![(2, mistakes::camera())]),
    );
    let vertices = |shape: [usize; 3]| Tensor::<3>::ones(shape, &mistakes::flex());
    errors.expect(
        "vertices of no object",
        &["scene 0", "\"bal\"", "\"ball\""],
        || batch()?.with_vertices("bal", vertices([2, 12, 3])),
    );
    errors.expect(
        "too few vertices",
        &["ball", "[2, 5, 3]", "[2, 12, 3]"],
        || {
            render_batch(
                &batch()?.with_vertices("ball", vertices([2, 5, 3]))?,
                &mistakes::small(),
            )
        },
    );
    errors.expect(
        "too many vertices",
        &["ball", "[2, 50, 3]", "[2, 12, 3]"],
        || {
            render_batch(
                &batch()?.with_vertices("ball", vertices([2, 50, 3]))?,
                &mistakes::small(),
            )
        },
    );
    errors.expect(
        "vertices of a scene too few",
        &["ball", "[1, 12, 3]", "[2, 12, 3]"],
        || batch()?.with_vertices("ball", vertices([1, 12, 3])),
    );
    errors.expect("a scene of a batch", &["scene 1", "ball", "NaN"], || {
        let bad = mistakes::ball().with_velocity([f64::NAN, 0.0, 0.0]);
        render_batch(
            &Batch::new(
                vec![mistakes::lit(mistakes::ball()), mistakes::lit(bad)],
                vec![mistakes::camera()],
            )?,
            &mistakes::small(),
        )
    });
    errors.expect("a view of a batch", &["view 1", "fov_y"], || {
        let views = vec![mistakes::camera(), mistakes::camera().with_fov_y(200.0)];
        render_batch(
            &Batch::new(vec![mistakes::lit(mistakes::ball())], views)?,
            &mistakes::small(),
        )
    });
}
