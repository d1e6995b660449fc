//! Renders against the images of an independent renderer, which has no blur.

use crate::common;
use crate::common::gradients::SHARP;
use crate::common::materials::base;
use crate::common::scenes::scene_file;
use crate::common::tensors::points;
use crate::images::{REFERENCES, compare, image, target};
use burn::tensor::Device;
use softray::prelude::*;

/// The clipped RMSE of the references, which are path traced themselves: over blocks of 8 × 8 pixels their
/// differences from renders fall to an eighth, as noise does.
const NOISE_OF_REFERENCES: f64 = 0.0018;

/// All references within a share of the mean and a clipped RMSE.
fn agree(samples: u32, visibility: Visibility, mean: f64, rmse: f64) {
    for (name, bounces) in REFERENCES {
        // The noisiest scene is the cheapest.
        let samples = if name == "cornell" {
            2 * samples
        } else {
            samples
        };
        let found = compare(name, bounces, samples, visibility, &Device::flex());
        assert!(
            (found.mean_ratio - 1.0).abs() < mean,
            "{name} {bounces}: {found:?}"
        );
        assert!(found.rmse_clipped < rmse, "{name} {bounces}: {found:?}");
    }
}

/// The paper's form has to be next to sharp. What is left of it then is its bias: of the lens 1.3 % of the
/// mean and an RMSE of 0.0119.
#[test]
fn softmax_in_the_unblurred_limit() {
    let (samples, mean, rmse) = if common::long() {
        (512, 0.015, 0.0125)
    } else {
        (16, 0.025, 0.04)
    };
    agree(samples, Visibility::softmax(1e-7, 1e-5), mean, rmse);
}

/// A pixel filter keeps the mean, and blurs edges by less than a pixel.
#[test]
fn cones_with_pixel_filters() {
    for (pixels, rmse) in [(0.0, 0.005), (0.25, 0.009), (0.5, 0.02), (1.0, 0.04)] {
        let visibility = Visibility::Cone { angle: 0.0, pixels };
        agree(256, visibility, 0.005, rmse);
    }
}

/// Cones soften shadows and reflections: the light that there is stays.
#[test]
fn cones_with_angles() {
    for (angle, mean) in [(0.573, 0.006), (2.865, 0.03)] {
        agree(256, Visibility::cone(angle), mean, 0.09);
    }
}

/// Without a filter nothing but noise is left: that of the render, which two seeds tell and which falls at least
/// as 1/√samples, and that of the reference.
#[test]
fn only_noise_is_left() {
    for (name, bounces) in REFERENCES {
        let most = if common::long() { 4096 } else { 256 };
        let of = |samples, seed| image(name, bounces, (samples, seed), SHARP, &Device::flex());
        let noise = |samples| {
            let [a, b] = [5, 6].map(|seed| of(samples, seed));
            let noise = a.rmse(&b, true).expect("the same size") / 2f64.sqrt();
            let error = a.rmse(&target(name, bounces), true);
            (noise, error.expect("the same size"))
        };
        let (few, _) = noise(16);
        let (own, error) = noise(most);
        println!("{name}: {own:.5} of noise, {error:.5} from the reference");
        assert!(
            own < 1.2 * (16.0 / f64::from(most)).sqrt() * few,
            "{name}: {few}, {own}"
        );
        assert!(
            error < own.hypot(NOISE_OF_REFERENCES),
            "{name}: {own}, {error}"
        );
    }
}

/// The ball of a reference by Mitsuba (`tests/data/bsdf/make.py`) in its material. Roughness is √α.
fn ball(name: &str) -> Material {
    let (eta, k) = ([0.143, 0.375, 1.442], [3.983, 2.386, 1.603]);
    // Mitsuba does not give back what is lost between facets.
    let of = |m: Material| m.with_compensated(false);
    match name {
        "conductor" => of(Material::conductor(eta, k, 0.3)),
        "conductor-rough" => of(Material::conductor(eta, k, 0.5)),
        "metal" => of(Material::metallic_roughness([0.9, 0.6, 0.3], 1.0, 0.4)),
        "black" => of(Material::metallic_roughness([0.0; 3], 0.0, 0.3)),
        "glass" => of(Material::dielectric(1.5, 0.0)),
        "glass-rough" => of(Material::dielectric(1.5, 0.4)),
        other => panic!("{other}"),
    }
}

/// Metal and glass are those of Mitsuba: conductors, its principled BSDF as metal and as what is black below clear
/// facets, smooth and rough dielectrics, four bounces.
#[test]
fn bsdfs_of_facets() {
    let device = Device::flex();
    let path = |file: &str| common::reference(&format!("bsdf/{file}"));
    let samples = if common::long() { 2048 } else { 256 };
    let mut failures = Vec::new();
    for name in [
        "conductor",
        "conductor-rough",
        "metal",
        "black",
        "glass",
        "glass-rough",
    ] {
        let target = HostImage::read(path(&format!("{name}.exr"))).expect("a reference");
        let scene = Scene::load(path("scene.obj"), &device).expect("a scene");
        let scene = scene.map_object("ball", |o| o.with_material(ball(name)));
        let scene = scene.expect("a ball").with_environment([0.3, 0.35, 0.4]);
        let camera = Camera::look_at([0.4, 1.5, 5.2], [0.0, 0.95, 0.0]).with_fov_y(36.0);
        let options = RenderOptions::new(64, 64)
            .with_samples(samples)
            .with_bounces(4)
            .with_visibility(SHARP)
            .with_seed(5);
        let image = render(&scene, &camera, &options).expect("an image");
        let image = HostImage::from_tensor(&image.radiance).expect("values");
        let ratio = image.mean_ratio(&target);
        let rmse = image.rmse(&target, true).expect("the same size");
        println!("{name}: {ratio:.4} of the mean, {rmse:.4} clipped RMSE");
        if (ratio - 1.0).abs() > 0.01 || rmse > 0.01 {
            failures.push(name);
        }
    }
    assert!(failures.is_empty(), "{failures:?}");
}

/// The function's box and camera are those of the reference's files.
#[test]
fn the_cornell_box() {
    let device = Device::flex();
    let (scene, camera) = cornell_box(&device);
    let file = scene_file("cornell", &device);
    assert_eq!(scene.objects.len(), file.scene.objects.len());
    let corners = |o: &Object| {
        let points = points(&o.mesh.vertices);
        let of_face = |f: &[u32; 3]| f.map(|i| (points[i as usize] * 1e3).round().to_array());
        let mut faces: Vec<_> = o.mesh.faces.iter().map(of_face).collect();
        faces.sort_by(|a, b| a.partial_cmp(b).expect("numbers"));
        faces
    };
    let color = |texture: &ColorTexture| match texture {
        ColorTexture::Constant(p) => p.values().expect("numbers"),
        ColorTexture::Texture { .. } => panic!("a texture"),
    };
    for object in scene.objects.iter() {
        let other = file.scene.object(&object.name).expect("an object");
        assert_eq!(corners(object), corners(other), "{}", object.name);
        let [a, b] = [object, other].map(|o| &o.materials[0]);
        assert_eq!(color(base(a)), color(base(b)), "{}", object.name);
        assert_eq!(color(&a.emission), color(&b.emission), "{}", object.name);
    }
    let eyes = [&camera, &file.camera].map(|c| c.eye.values().expect("numbers"));
    assert_eq!(eyes[0], eyes[1]);
}
