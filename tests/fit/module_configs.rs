//! Renderers and losses from configurations, which are written to files and read back.

use crate::common;
use crate::common::errors::{message, says};
use crate::common::scenes::{ahead, glowing};
use crate::common::values;
use burn::config::Config;
use burn::module::Module;
use burn::tensor::TensorData;
use softray::loss;
use softray::modules::RotationForm;
use softray::prelude::*;

#[test]
fn renderers_and_configurations() {
    let scene = glowing(shapes::cube(&Device::flex()));
    let softmax = Visibility::softmax(1e-2, 0.01);
    let options = RenderOptions::new(8, 6)
        .with_samples(2)
        .with_bounces(1)
        .with_visibility(softmax)
        .with_russian_roulette(1)
        .with_rays_per_tile(64)
        .with_opacity();
    let path = common::target_folder("renderer").join("renderer.json");
    options.save(&path).expect("a file");
    let loaded = RenderOptions::load(&path).expect("options");
    assert_eq!(format!("{loaded:?}"), format!("{options:?}"));
    std::fs::write(
        &path,
        r#"{"width": 8, "height": 6, "outputs": {"depth": true}}"#,
    )
    .expect("a file");
    let few = RenderOptions::load(&path).expect("options");
    let same = RenderOptions::new(8, 6).with_depth();
    assert_eq!(format!("{few:?}"), format!("{same:?}"));
    std::fs::write(&path, r#"{"width": 8, "heigth": 6}"#).expect("a file");
    says(message(RenderOptions::load(&path)), ["heigth"]);
    std::fs::write(&path, r#"{"width": 8}"#).expect("a file");
    let flat = RenderOptions::load(&path).expect("options");
    says(message(Renderer::new(flat)), ["height is 0"]);

    let renderer = Renderer::new(loaded).expect("a renderer");
    let image = |r: &Renderer, seed| r.forward(&scene, &ahead(), seed).expect("a render");
    let same = render(&scene, &ahead(), &options.clone().with_seed(7)).expect("a render");
    let equal = |a: &Tensor<3>, b: &Tensor<3>| assert!(values(a) == values(b), "{a} {b}");
    equal(&image(&renderer, 7).radiance, &same.radiance);
    let [a, b] = renderer
        .forward_pair(&scene, &ahead(), 3)
        .expect("two renders");
    equal(&a.radiance, &image(&renderer, 6).radiance);
    equal(&b.radiance, &image(&renderer, 7).radiance);
    assert!(a.opacity.is_some());
    let other = Renderer::new(options.clone().with_seed(1)).expect("a renderer");
    let apart = values(&image(&other, 7).radiance) != values(&same.radiance);
    assert!(apart, "the renderer's seed counts");

    let fails = |options: RenderOptions, said: &str| says(message(Renderer::new(options)), [said]);
    fails(
        options.clone().with_visibility(Visibility::cone(-1.0)),
        "angle is -1",
    );
    fails(options.clone().with_samples(0), "samples is 0");
    fails(RenderOptions::new(0, 6), "width is 0");
    // A blur stays, whichever is set first.
    let blurred = |form: Visibility| options.clone().with_blur(70.0).with_visibility(form);
    fails(blurred(Visibility::cone(0.0)), "blur angle is 70");
    fails(blurred(softmax), "blur is 70");
    let few =
        r#"{"width": 4, "height": 4, "visibility": {"Softmax": {"sigma": 0.1, "gamma": 0.2}}}"#;
    let few: RenderOptions = serde_json::from_str(few).expect("options");
    assert_eq!(few.visibility, Visibility::softmax(0.1, 0.2));
    let half = SoftmaxOptions::new(1e-3, 1e-3).with_cutoff(2.0);
    fails(options.clone().with_visibility(half), "cutoff is 2");
    fails(
        options.with_visibility(Visibility::softmax(1e-3, 0.0)),
        "gamma is 0",
    );
    says(
        message(renderer.with_blur(f64::NAN)),
        ["blur is NaN", "SoftmaxOptions::sigma"],
    );
}

#[test]
fn configurations_in_files() {
    let path = common::target_folder("configurations").join("part.json");
    let camera = CameraParamsConfig::new([0.0, 0.0, 4.0], [0.0; 3]).with_lens(Some([0.1, 2.0]));
    let material = MaterialParamsConfig::new().with_specular(Some([0.2; 3]));
    let pose = RigidTransformConfig::new().with_rotation(RotationForm::Quaternion);
    let loss = RenderLossConfig::new().with_l1(0.5);
    camera.save(&path).expect("a file");
    let loaded = CameraParamsConfig::load(&path).expect("a configuration");
    assert_eq!(format!("{loaded}"), format!("{camera}"));
    material.save(&path).expect("a file");
    let loaded = MaterialParamsConfig::load(&path).expect("a configuration");
    assert_eq!(format!("{loaded}"), format!("{material}"));
    pose.save(&path).expect("a file");
    let loaded = RigidTransformConfig::load(&path).expect("a configuration");
    assert_eq!(loaded.rotation, RotationForm::Quaternion);
    loss.save(&path).expect("a file");
    assert_eq!(
        RenderLossConfig::load(&path).expect("a configuration"),
        loss
    );

    let device = Device::flex();
    let wide = camera.clone().with_fov_y(175.0);
    says(message(wide.init(&device)), ["fov_y"]);
    let closed = camera.clone().with_lens(Some([0.0, 1.0]));
    says(message(closed.init(&device)), ["aperture"]);
    let along = camera.with_up([0.0, 0.0, 1.0]);
    says(message(along.init(&device)), ["up"]);
    let mirrored = pose.with_scale(Some(-1.0));
    says(message(mirrored.init(&device)), ["scale is -1"]);
    let bright = material.with_diffuse([0.9; 3]);
    says(message(bright.init(&device)), ["at most 1"]);
    says(message(loss.clone().with_levels(0).init()), ["levels"]);
    says(
        message(loss.clone().with_dssim(-1.0).init()),
        ["dssim is -1"],
    );
    let nothing = loss.with_mse(0.0).with_l1(0.0);
    says(message(nothing.init()), ["weights"]);
}

#[test]
fn losses_are_weighted_sums_over_batches() {
    let device = Device::flex();
    let noise = |k: f64| {
        let values: Vec<f64> = (0..2 * 12 * 13 * 3)
            .map(|i| 0.5 + 0.4 * (i as f64 * k).sin())
            .collect();
        Tensor::<4>::from_data(TensorData::new(values, [2, 12, 13, 3]), &device)
    };
    let (a, b, target) = (noise(0.37), noise(0.91), noise(0.11));
    let view = |t: &Tensor<4>, i: usize| t.clone().narrow(0, i, 1).reshape([12, 13, 3]);
    let number = |t: softray::Result<Tensor<1>>| values(&t.expect("a loss"))[0];
    let near = |found: f64, expected: f64| {
        assert!((found / expected - 1.0).abs() < 1e-5, "{found} {expected}");
    };
    let loss_of = RenderLossConfig::new()
        .with_mse(0.7)
        .with_l1(0.4)
        .with_dssim(0.3)
        .with_range(2.0)
        .with_levels(3)
        .with_silhouette(0.25)
        .init()
        .expect("a loss");
    type Loss = fn(Tensor<3>, Tensor<3>) -> softray::Result<Tensor<1>>;
    let at = |image: Tensor<3>, target: Tensor<3>, f: Loss| {
        number(loss::multi_scale(image, target, 3, f))
    };
    let dssim = |image, target| loss::dssim(image, target, 2.0);
    let single = |i: usize| {
        let (image, target) = (view(&a, i), view(&target, i));
        0.7 * at(image.clone(), target.clone(), loss::mse)
            + 0.4 * at(image.clone(), target.clone(), loss::l1)
            + 0.3 * at(image, target, dssim)
    };
    near(
        number(loss_of.forward(view(&a, 1), view(&target, 1))),
        single(1),
    );
    let batch = number(loss_of.forward(a.clone(), target.clone()));
    near(batch, 0.5 * (single(0) + single(1)));
    let unbiased = |i: usize| {
        let (a, b, target) = (view(&a, i), view(&b, i), view(&target, i));
        let both = (a.clone() + b.clone()) * 0.5;
        0.7 * number(loss::multi_scale_unbiased(a, b, target.clone(), 3))
            + 0.4 * at(both.clone(), target.clone(), loss::l1)
            + 0.3 * at(both, target, dssim)
    };
    let batch = number(loss_of.forward_unbiased(a.clone(), b.clone(), target.clone()));
    near(batch, 0.5 * (unbiased(0) + unbiased(1)));
    let opacity = |t: &Tensor<4>| t.clone().narrow(3, 0, 1).reshape([2, 12, 13]);
    let silhouette = |i: usize| {
        let [a, t] = [&a, &target].map(|t| opacity(t).narrow(0, i, 1).reshape([12, 13]));
        number(loss::silhouette_iou(a, t))
    };
    let batch = number(loss_of.silhouette(opacity(&a), opacity(&target)));
    near(batch, 0.25 * 0.5 * (silhouette(0) + silhouette(1)));
    assert_eq!(loss_of.num_params(), 0);
}

#[test]
fn losses_do_not_broadcast() {
    let loss = RenderLossConfig::new().init().expect("a loss");
    let image = |shape: [usize; 4]| Tensor::<4>::zeros(shape, &Device::flex());
    let (some, other) = (image([2, 4, 4, 3]), image([2, 4, 4, 1]));
    let parts = [
        "render loss: shape is [2, 4, 4, 3]",
        "[2, 4, 4, 1] like the target",
    ];
    says(message(loss.forward(some.clone(), other.clone())), parts);
    let of_two = loss.forward_unbiased(other.clone(), some.clone(), other);
    says(message(of_two), parts);
    let none = image([0, 4, 4, 3]);
    says(
        message(loss.silhouette(none.clone(), none)),
        ["shape is [0, 4, 4, 3]", "at least 1 along every axis"],
    );
}
