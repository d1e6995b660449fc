//! Late steps that change emission, lights or the environment.

use softray::device::{Work, work};
use softray::prelude::*;

use super::{Bodies, Step, Waves, options};
use crate::common::numbers::mean_and_error;
use crate::common::process::alone;
use crate::common::scenes::{diffuse, facing_down};
use crate::common::tensors::{leaf, values};
use crate::device::device;

/// Returns the bodies and the meshes of two lamps.
fn bodies_and_lamps() -> (Bodies, [Mesh; 2]) {
    let lamp = |x: f64| facing_down([x, x + 0.4], [0.0, 0.4], 1.5, &device());
    (Bodies::new(&device()), [-0.8, 0.6].map(lamp))
}

/// Renders step `i` with two lamps, two delta lights and an environment, a map or a constant, that depend on `i`. Returns
/// the image and the gradients by their tensors, and the work.
fn step(
    (bodies, lamps): &(Bodies, [Mesh; 2]),
    i: u64,
    mapped: bool,
    options: &RenderOptions,
) -> (Vec<Vec<f64>>, Work) {
    let mut waves = Waves::new(i);
    let mut wave = |count, low, high| waves.next(count, low, high);
    let lamp = |lamp: usize, radiance: ColorTexture| {
        let material = Material::diffuse([0.5; 3]).with_emission(radiance);
        Object::new(lamps[lamp].clone()).with_material(material)
    };
    let environment = match mapped {
        true => Environment::map(wave(4 * 8 * 3, 0.1, 0.9).reshape([4, 8, 3])),
        false => Environment::Constant(wave(3, 0.1, 0.5).into()),
    };
    let glowing = ColorTexture::texture(wave(2 * 3 * 3, 1.0, 9.0).reshape([2, 3, 3]));
    let scene = bodies.scene.clone();
    let scene = scene
        .with_object(diffuse(bodies.ball.clone(), [0.3, 0.5, 0.6]))
        .with_object(lamp(0, wave(3, 1.0, 9.0).into()))
        .with_object(lamp(1, glowing))
        .with_light(Light::point(wave(3, 0.8, 1.2), wave(3, 1.0, 2.0)))
        .with_light(Light::directional([0.1, -1.0, 0.2], wave(3, 0.2, 0.6)))
        .with_environment(environment);
    let before = work();
    let image = render(&scene, &bodies.camera, options).expect("an image");
    let gradients = image.radiance.clone().powf_scalar(2.0).sum().backward();
    let during = work() - before;
    let by = waves.gradients(&gradients);
    let image = std::iter::once(values(&image.radiance));
    (image.chain(by).collect(), during)
}

/// The device places emission, positions and strengths of lights, and environments. Where the choice of an emitter does not
/// depend on them, images and gradients are those of steps that read.
#[test]
fn late_steps_of_lights() {
    if !alone(late_steps_of_lights) {
        return;
    }
    let bodies = bodies_and_lamps();
    let [late, reading] = [3, 1].map(|every| {
        let mut options = options(every);
        options.sampling.emitters = EmitterSampling::Uniform;
        options
    });
    for i in 0..6 {
        let (found, work) = step(&bodies, i, false, &late.clone().with_seed(7 + i));
        let (wanted, usual) = step(&bodies, i, false, &reading.clone().with_seed(7 + i));
        for (k, (found, wanted)) in found.iter().zip(&wanted).enumerate() {
            assert!(wanted.iter().any(|d| *d != 0.0), "list {k}");
            assert_eq!(found, wanted, "step {i}, list {k}");
        }
        assert_eq!(usual.read_backs, 1);
        assert_eq!(work.read_backs, u64::from(i == 0), "step {i}: {work:?}");
    }
}

/// A lamp that becomes much brighter is found in the next step, which reads. So is one that was black.
#[test]
fn large_changes_of_light_are_found() {
    if !alone(large_changes_of_light_are_found) {
        return;
    }
    let (bodies, [lamp, _]) = bodies_and_lamps();
    let options = options(100);
    let steps = [
        (1.0, 1),
        (1.4, 0),
        (1.8, 0),
        (2.2, 0),
        (2.2, 1),
        (3.0, 0),
        (0.0, 0),
        (0.0, 1),
        (1e-3, 0),
        (1e-3, 1),
        (1e-3, 0),
    ];
    for (i, (radiance, wanted)) in steps.into_iter().enumerate() {
        let radiance = leaf(&[radiance; 3], &device());
        let lamp = Object::new(lamp.clone()).with_material(Material::emitter(radiance));
        let before = work();
        let image = render(
            &bodies.scene.clone().with_object(lamp),
            &bodies.camera,
            &options,
        );
        image.expect("an image").radiance.sum().backward();
        assert_eq!((work() - before).read_backs, wanted, "step {i}");
    }
}

/// Otherwise emitters and directions are chosen by the values in use: images and gradients have other noise, and the same
/// means within four standard errors.
#[test]
fn lights_are_chosen_without_bias() {
    const SEEDS: u64 = 24;
    let bodies = bodies_and_lamps();
    let (late, reading) = (options(1000), options(1));
    step(&bodies, 0, true, &late);
    let sums = |options: &RenderOptions, seed: u64| {
        let options = options.clone().with_seed(seed);
        let (lists, _) = step(&bodies, 6, true, &options);
        lists.into_iter().map(|list| list.iter().sum::<f64>())
    };
    let pairs: Vec<Step> = (0..SEEDS)
        .map(|seed| [&late, &reading].map(|options| sums(options, seed).collect()))
        .collect();
    for k in 0..pairs[0][0].len() {
        let usual: Vec<f64> = pairs.iter().map(|pair| pair[1][k]).collect();
        let differences: Vec<f64> = pairs.iter().map(|[a, b]| a[k] - b[k]).collect();
        let (mean, error) = mean_and_error(&differences);
        let (size, noise) = mean_and_error(&usual);
        println!("list {k}: {size:.4} ± {noise:.4}, late {mean:.4} ± {error:.4} more");
        // Two renders of independent noise differ by √2 of it; choices by earlier values are a little worse.
        assert!(
            error > 0.0 && error < 3.0 * noise,
            "list {k}: {error}, {noise}"
        );
        assert!(mean.abs() < 4.0 * error, "list {k}");
    }
}
