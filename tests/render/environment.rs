//! Environment maps: orientation, energy, noise, gradients.

use crate::common;
use crate::common::errors::{message, says};
use crate::common::numbers::{mean, rmse};
use crate::common::scenes::{facing_down, on_axis};
use crate::common::tensors::{gradient, radiance, values};
use burn::tensor::{DType, Device};
use softray::gradcheck::{Checked, GradCheck, gradcheck};
use softray::prelude::*;

fn tensor<const D: usize>(v: &[f64], shape: [usize; D], dtype: DType) -> Tensor<D> {
    common::tensors::tensor(v, shape, &Device::flex(), dtype)
}

/// A map of 8 × 16 texels.
fn map(f: impl Fn(usize, usize) -> [f64; 3]) -> Vec<f64> {
    let at = |i: usize| f(i / 16, i % 16);
    (0..128).flat_map(at).collect()
}

fn sky(f: impl Fn(usize, usize) -> [f64; 3], dtype: DType) -> Environment {
    Environment::map(tensor(&map(f), [8, 16, 3], dtype))
}

fn ball(material: Material, dtype: DType) -> Scene {
    let mesh = shapes::icosphere(2, &Device::flex()).cast(dtype);
    Scene::new().with_object(Object::new(mesh).with_material(material))
}

/// A dim sky with a sun of two texels.
fn sunny(y: usize, x: usize) -> [f64; 3] {
    if y == 2 && (x == 11 || x == 12) {
        [60.0, 55.0, 45.0]
    } else {
        [0.2, 0.3, 0.4]
    }
}

fn of(scene: &Scene, sampling: Sampling, samples: u32, seed: u64) -> Vec<f64> {
    let camera = on_axis(4.0).with_fov_y(40.0);
    let options = RenderOptions::new(16, 16)
        .with_samples(samples)
        .with_bounces(1)
        .with_sampling(sampling)
        .with_seed(seed);
    radiance(scene, &camera, &options)
}

/// Red grows with the row, green with the column: the middle is towards −z, to its right +x, row 0
/// about +y.
#[test]
fn a_map_has_its_orientation() {
    let f = |y: usize, x: usize| [y as f64 + 0.5, x as f64 + 0.5, 1.0];
    let tiny = shapes::triangle(
        [0.0, 0.0, 90.0],
        [1e-3, 0.0, 90.0],
        [0.0, 1e-3, 90.0],
        &Device::flex(),
    );
    let scene = Scene::new()
        .with_object(Object::new(tiny))
        .with_environment(sky(f, DType::F32));
    let towards = |d: [f64; 3]| {
        let camera = Camera::look_at([0.0; 3], d)
            .with_up([0.1, 0.7, 0.3])
            .with_fov_y(0.5);
        let options = RenderOptions::new(1, 1).with_samples(16).with_bounces(0);
        radiance(&scene, &camera, &options)
    };
    for (direction, expected) in [
        ([0.0, 0.0, -1.0], [4.0, 8.0]),
        ([1.0, 0.0, 0.0], [4.0, 12.0]),
        ([-1.0, 0.0, 0.0], [4.0, 4.0]),
        (
            [0.3, 1.0, -0.3],
            [
                4.0 - 8.0 / std::f64::consts::PI * (1.0f64 / 0.18f64.sqrt()).atan(),
                10.0,
            ],
        ),
    ] {
        let found = towards(direction);
        for (a, b) in found.iter().zip(expected) {
            assert!(
                (a - b).abs() < 0.05,
                "{direction:?}: {found:?}, {expected:?}"
            );
        }
    }
}

/// A map of one radiance is the constant of that radiance: the image, and the gradient of its texels
/// together.
#[test]
fn a_uniform_map_is_a_constant() {
    let material = Material::phong([0.3, 0.4, 0.5], [0.4; 3], 20.0);
    let leaf =
        |v: Vec<f64>, shape: [usize; 3]| tensor(&v, shape, DType::F64).autodiff().require_grad();
    let texels = leaf(vec![0.8; 384], [8, 16, 3]);
    let constant = tensor(&[0.8; 3], [3], DType::F64).autodiff().require_grad();
    let image = |environment: Environment, sampling| {
        let scene = ball(material.clone(), DType::F64).with_environment(environment);
        let camera = on_axis(4.0).with_fov_y(40.0);
        let options = RenderOptions::new(8, 8)
            .with_samples(64)
            .with_bounces(2)
            .with_sampling(sampling);
        render(&scene, &camera, &options)
            .expect("an image")
            .radiance
            .mean()
    };
    let expected = image(constant.clone().into(), Sampling::default());
    let value = values(&expected)[0];
    let by_constant = gradient(&constant, &expected.backward());
    let total: f64 = by_constant.iter().sum();
    for sampling in [Sampling::default(), Sampling::paper()] {
        let found = image(Environment::map(texels.clone()), sampling);
        let mean = values(&found)[0];
        assert!((mean / value - 1.0).abs() < 0.01, "{mean}, {value}");
        let by_texel = gradient(&texels, &found.backward());
        let sum: f64 = by_texel.iter().sum();
        assert!((sum / total - 1.0).abs() < 0.01, "{sum}, {total}");
    }
}

#[test]
fn a_white_ball_vanishes_in_a_uniform_map() {
    let white = sky(|_, _| [1.0; 3], DType::F32);
    let scene = ball(Material::diffuse([1.0; 3]), DType::F32).with_environment(white);
    let image = of(&scene, Sampling::default(), 256, 1);
    assert!((mean(&image) - 1.0).abs() < 0.005, "{}", mean(&image));
}

/// Glass loses the samples that its facets turn to the wrong side. No light is gathered along them: the mean is the one
/// without MIS, also under a lamp.
#[test]
fn lost_samples_gather_no_light() {
    let glass = ball(Material::dielectric(1.5, 0.9), DType::F32);
    let lamp = facing_down([-3.0, 3.0], [-3.0, 3.0], 2.0, &Device::flex());
    let lamp = Object::new(lamp).with_material(Material::emitter([1.0; 3]));
    let map = sky(|_, _| [0.5; 3], DType::F32);
    let camera = on_axis(4.0).with_fov_y(25.0);
    for scene in [glass.clone().with_environment(map), glass.with_object(lamp)] {
        let of = |sampling, samples, engine| {
            let options = RenderOptions::new(8, 8)
                .with_samples(samples)
                .with_bounces(1)
                .with_engine(engine)
                .with_sampling(sampling);
            mean(&radiance(&scene, &camera, &options))
        };
        let kernels = |sampling| of(sampling, 16_384, Engine::Kernels);
        let (found, expected) = (kernels(Sampling::default()), kernels(Sampling::paper()));
        assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
        // Both engines draw the same paths.
        let [a, b] = [Engine::Kernels, Engine::Tensors].map(|e| of(Sampling::default(), 64, e));
        assert!((a / b - 1.0).abs() < 1e-3, "{a} {b}");
    }
}

/// A sun in a map: drawn from the map and from the BSDF together the mean stays, and the noise falls
/// manifold.
#[test]
fn a_sun_is_found() {
    for (material, share) in [
        (Material::diffuse([0.6; 3]), 0.4),
        // The BSDF alone finds so large a sun well.
        (Material::phong([0.1; 3], [0.8; 3], 300.0), 0.85),
    ] {
        let scene = ball(material, DType::F32).with_environment(sky(sunny, DType::F32));
        let expected = of(&scene, Sampling::paper(), 4096, 2);
        let noise = |sampling| {
            let image = of(&scene, sampling, 64, 3);
            (mean(&image), rmse(&image, &expected))
        };
        let (plain, default) = (noise(Sampling::paper()), noise(Sampling::default()));
        println!("{}: plain {plain:?}, default {default:?}", mean(&expected));
        assert!((default.0 / mean(&expected) - 1.0).abs() < 0.02);
        assert!(default.1 < share * plain.1, "{default:?}, {plain:?}");
    }
}

/// Texels, what turns the camera, and geometry under a map, against central differences.
#[test]
fn gradients_are_those_of_differences() {
    // √σ is a thirtieth of an edge. At a tenth the hard order of the faces of a glossy ball takes 22 %
    // off the gradient of its shape, and 11 % off the eye's (docs/VISIBILITY.md).
    let options = RenderOptions::new(8, 8).with_samples(16).with_bounces(1);
    let precision = if common::long() { 0.01 } else { 0.1 };
    let settings = GradCheck::new(options, &Device::flex())
        .with_precision(precision)
        .with_tolerance(0.02)
        .with_seeds(32, if common::long() { 20_000 } else { 1000 });
    let parameters = [
        Checked::new("texel", [1.0], 0.5),
        Checked::new("eye", [0.0, 0.3, 4.0], 0.02).with_direction([1.0, 0.4, 0.2]),
        Checked::new("stretch", [1.0], 0.02),
        Checked::new("albedo", [0.4], 0.1),
    ];
    let report = gradcheck(&parameters, &settings, |point| {
        let smooth = |y: usize, x: usize| {
            let (a, b) = (x as f64 * 0.39, y as f64 * 0.3);
            [
                1.0 + 0.8 * a.sin() * b.sin(),
                1.0 + 0.5 * a.cos(),
                0.5 + 0.3 * b.cos(),
            ]
        };
        let rest = tensor(&map(smooth), [8, 16, 3], point.dtype);
        let one = map(|y, x| [f64::from(u8::from(y == 2 && x > 8 && x < 12)); 3]);
        let one = tensor(&one, [8, 16, 3], point.dtype);
        let texels = rest + one * point.get("texel")?.reshape([1, 1, 1]);
        let gloss = Material::phong(point.get("albedo")?.expand([3]), [0.3; 3], 10.0);
        let scene = ball(gloss, point.dtype).map_object("object", |o| o)?;
        let stretch = point.get("stretch")?;
        let mut scene = scene.with_environment(Environment::map(texels));
        for object in &mut scene.objects {
            let m = object.mesh.clone();
            let x = m.vertices.clone().narrow(1, 0, 1) * stretch.clone().reshape([1, 1]);
            let rest = m.vertices.clone().narrow(1, 1, 2);
            object.mesh = m.with_vertices(Tensor::cat(vec![x, rest], 1));
        }
        Ok((
            scene,
            Camera::look_at(point.get("eye")?, [0.0; 3]).with_fov_y(40.0),
        ))
    })
    .expect("a report");
    println!("{report}");
    assert!(report.agrees(), "{report}");
}

#[test]
fn a_bad_map_is_named() {
    let of = |environment: Environment| {
        let scene = ball(Material::default(), DType::F32).with_environment(environment);
        message(render(&scene, &on_axis(4.0), &RenderOptions::new(2, 2)))
    };
    let nan = of(sky(
        |y, x| [if (y, x) == (3, 5) { f64::NAN } else { 1.0 }; 3],
        DType::F32,
    ));
    says(nan, ["environment texel (3, 5)"]);
    let gray = of(Environment::map(tensor(&[0.5; 6], [2, 3, 1], DType::F32)));
    says(gray, ["[2, 3, 1]"]);
    says(of(sky(|_, _| [1.0; 3], DType::F64)), ["environment"]);
}

/// Files of Radiance and of OpenEXR, as `scene.json` names them, light a scene like their texels do.
#[test]
fn maps_of_files_are_the_texels_in_them() {
    let folder = common::folder::Folder::new("environment-files");
    let device = Device::flex();
    let pixels: Vec<f32> = map(sunny).iter().map(|&v| v as f32).collect();
    let image = image::Rgb32FImage::from_raw(16, 8, pixels.clone()).expect("an image");
    image.save(folder.path("sky.hdr")).expect("a file");
    let host = HostImage::new(16, 8, pixels).expect("an image");
    host.write(folder.path("sky.exr")).expect("a file");
    let object = ball(Material::diffuse([0.8, 0.6, 0.4]), DType::F32);
    object.write(folder.path("ball.obj")).expect("a file");
    let options = RenderOptions::new(8, 8).with_samples(16).with_bounces(1);
    let camera = on_axis(4.0).with_fov_y(40.0);
    let lit = object.with_environment(sky(sunny, DType::F32));
    let expected = radiance(&lit, &camera, &options);
    // Radiance has 8 bits of each number beside an exponent that all three share: 60, 55, 45 are whole there.
    for (file, tolerance) in [("sky.hdr", 0.005), ("sky.exr", 1e-6)] {
        let json = format!(
            r#"{{"obj": "ball.obj", "environment": "{file}", "camera": {{"eye": [0, 0, 4],
            "target": [0, 0, 0], "fov_y_degrees": 40, "width": 8, "height": 8}}}}"#
        );
        let path = folder.write("scene.json", json);
        let scene = SceneFile::load(&path, &device).expect("a scene").scene;
        let Environment::Map(texels) = &scene.environment else {
            panic!("no map");
        };
        for (found, texel) in values(texels).iter().zip(map(sunny)) {
            assert!(
                (found - texel).abs() <= tolerance * texel,
                "{file}: {found} {texel}"
            );
        }
        let seen = radiance(&scene, &camera, &options);
        assert!(mean(&seen) > 0.1 && rmse(&seen, &expected) < tolerance * mean(&expected));
    }
    folder.write(
        "sky.hdr",
        "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n",
    );
    let json = r#"{"obj": "ball.obj", "environment": "sky.hdr", "camera": {"eye": [0, 0, 4],
        "target": [0, 0, 0], "fov_y_degrees": 40, "width": 8, "height": 8}}"#;
    let path = folder.write("scene.json", json);
    says(
        message(SceneFile::load(&path, &device)),
        ["sky.hdr", "can't be decoded"],
    );
}
